"""Live beside wheels whose speeds are measured, in free flight and on a pedestal: NumPy says the same of the log."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence

import numpy as np
import pyarrow.csv
import pytest

from massprop_cli import ABOUT_PIVOT, QUANTITIES
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate import compiled, engine
from massprop_cli.estimate.pivot import about_pivot
from massprop_cli.export import resolve
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import kernel
from massprop_cli.live import run
from massprop_cli.model import regressors
from massprop_cli.prepare.stream import Stream
from massprop_cli.testbed import output
from massprop_cli.testbed import scenario as scenarios
from tests import flown

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")


@pytest.mark.parametrize("scenario", ["pedestal", "wheels-and-jets"])
def test_beside_wheels_each_cycle_says_what_numpy_says_of_the_log(scenario: str) -> None:
    """On a pedestal: inertia and first moment about the pivot, which alone the motion depends on. The gyro is without bias."""
    flight = flown.fly(scenario, *flown.BY_SPEED, "sensors.gyro_bias_rad_s=[0.0, 0.0, 0.0]")
    text, warned = io.BytesIO(), list[str]()
    pyarrow.csv.write_csv(output.log_table(flight, 0, scenarios.load(scenario, flown.BY_SPEED).scenario), text)
    lines, source = (
        text.getvalue().decode().splitlines(keepends=True)[:400],
        VehicleSource(vehiclefile.changed(flight.vehicle, (*flown.EXACT, "imu.gyro_bias_sigma_rad_s=0.0")), "vehicle.toml", ""),
    )
    said = [json.loads(line) for line in run.follow(lines, source, io.StringIO().write, warned.append)]
    leg = resolve.stated(source).legs[0]
    log = flight.log(0).part(0, 399)
    samples = Stream.of(log, leg.own, stated_timing(leg.own))
    first = log.cycles - len(said)
    with pytest.MonkeyPatch.context() as numpy_alone:
        numpy_alone.setattr(compiled, "holds", lambda *_: False)
        numpy_alone.setattr(regressors, "compiled", lambda _: False)
        found = engine.replay(samples, slice(first, log.cycles), Phase(name="all", start_s=0.0, end_s=60.0), leg.own)
    names: Sequence[str] = QUANTITIES
    values, sigmas, key = found.values, found.sigmas, "estimates"
    if leg.own.on_pedestal:
        pivot, assumed_kg = np.array(leg.own.environment.bearing_position_m), np.array(leg.own.pedestal_mass_kg)
        values, covariance = about_pivot(values[-1:], found.covariance[None], pivot, assumed_kg)
        sigmas, names, key = np.sqrt(np.diagonal(covariance, 0, 1, 2)), ABOUT_PIVOT, "about_pivot"
    assert not warned
    for i, quantity in enumerate(names):
        one = said[-1][key][quantity]
        if np.isnan(values[-1, i]):
            assert one["value"] is None
            continue
        assert abs(one["value"] - values[-1, i]) < 1e-6 * sigmas[-1, i], quantity
        assert one["sigma"] == pytest.approx(sigmas[-1, i], rel=1e-6)
    told = sum(one["verdict"] == "converged" for one in said[-1][key].values())
    assert told >= 6
