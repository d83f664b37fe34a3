"""Multicopters in mid-flight, flown by a simulator that shares no code with the estimator."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.inputs.vehiclefile import VehicleSource
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
