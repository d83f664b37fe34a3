"""Multicopters in mid-flight, flown by a simulator that shares no code with the estimator."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate import compiled, engine
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import Kernel, kernel
from massprop_cli.model import regressors
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.stream import Stream
from tests import anypedestal, anyrotors


@pytest.mark.thorough
@pytest.mark.numerical
def test_every_quantity_converges_within_its_sigma() -> None:
    """Four that turn by up to 0.2 rad a cycle: of 40 values one rms in a thousand is beyond 1.4 or below 0.65."""
    rng = np.random.default_rng(7)
    own = anyrotors.multicopters(rng, 4)
    flown = anyrotors.fly(rng, own, 0.0125, 1000)
    z = []
    for body in range(4):
        used = anyrotors.vehicle_of(own, body, flown)
        found = flow.examine(anypedestal.log_of(rng, own, body, flown, used), VehicleSource(used, "", ""))
        (conclusion,) = found.conclusions
        assert not found.notices
        assert {one.verdict for one in conclusion.estimates.values()} == {"converged"}
        z.append((conclusion.values - own.ten[body]) / conclusion.sigmas)
    assert 0.65 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.numerical
@pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
def test_the_compiled_kernel_says_the_same() -> None:
    rng = np.random.default_rng(7)
    own = anyrotors.multicopters(rng, 1)
    flown = anyrotors.fly(rng, own, 0.0125, 400)
    vehicle = Resolved.stated(anyrotors.vehicle_of(own, 0, flown))
    assert vehicle is not None
    log = anypedestal.log_of(rng, own, 0, flown, vehicle)
    samples, cycles, phase = Stream.of(log, vehicle, stated_timing(vehicle)), slice(20, 400), Phase(name="all", start_s=0.0, end_s=1.0)
    assert compiled.holds(samples, vehicle, Consider())
    by_kernel = engine.replay(samples, cycles, phase, vehicle)
    with pytest.MonkeyPatch.context() as numpy_alone:
        for module in (compiled, regressors):
            numpy_alone.setattr(module, "kernel", lambda: Kernel(None, "numpy"))
        assert not compiled.holds(samples, vehicle, Consider())
        by_numpy = engine.replay(samples, cycles, phase, vehicle)
    assert np.isfinite(by_kernel.values[-1]).all()
    assert np.nanmax(np.abs(by_kernel.values - by_numpy.values) / by_numpy.sigmas) < 1e-6
