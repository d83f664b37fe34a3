"""Live beside wheels, on testbeds, and with sampled, filtered and late sensors and jets: NumPy says the same of the log."""

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
CYCLES = 300
SURE = ("sensors.gyro_bias_rad_s=[0.0, 0.0, 0.0]", "vehicle.imu.gyro_bias_sigma_rad_s=0.0", "vehicle.imu.gyro_bias_walk_rad_s_sqrt_s=0.0")
TURNS = ("duration_s=15.0", 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0.0, end_s=15.0}]')

LATE = ("imu.gyro_filter.latency_s=0.004", "imu.accel_filter.latency_s=0.004")


def imu(measures: str, order: int, records: int = 1) -> tuple[str, ...]:
    """Settings of a gyro and an accelerometer behind different low-passes, or behind none."""
    cutoffs = {"gyro_filter": 24.0, "accel_filter": 17.0} if order else {}
    low_passes = (f"vehicle.imu.{name}={{order={order}, cutoff_hz={cutoff}}}" for name, cutoff in cutoffs.items())
    return (f'vehicle.imu.measures="{measures}"', *low_passes, f"sensors.records_per_cycle={records}")


CASES = {
    "pedestal": (("pedestal", *flown.BY_SPEED, *SURE[:1]), (*flown.EXACT, "imu.gyro_bias_sigma_rad_s=0.0")),
    "wheels-and-jets": (("wheels-and-jets", *flown.BY_SPEED, *SURE[:1]), (*flown.EXACT, "imu.gyro_bias_sigma_rad_s=0.0")),
    "means behind a lag": (("free-flyer", *flown.PLAN, *imu("mean", 1)), ()),
    "samples": (("free-flyer", *flown.PLAN, *imu("sample", 0, 5)), ()),
    "filtered samples of lagging thrust": (("free-flyer", *flown.PLAN, *imu("sample", 2, 5), "vehicle.thrust.lag_s=0.02"), ()),
    "pulses at the end, one jet late": (("free-flyer", *flown.PLAN, 'vehicle.cycle.pulse_at="end"', "vehicle.jets.0.delay_s=0.013"), ()),
    "commands within the sample": (("free-flyer", *flown.PLAN, *imu("sample", 1), "vehicle.cycle.command_delay_cycles=0.0"), ()),
    # thrust that is by as much sooner, which the sensors show by as much later
    "late means of second order": (("free-flyer", *flown.PLAN, *imu("mean", 2, 2)), (*LATE, "cycle.command_delay_cycles=1.92")),
    "on a bearing": (("testbed", *TURNS, *imu("sample", 2, 5), *SURE), ()),
}


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            marks=pytest.mark.thorough
            if case == "pedestal" or "filtered" in case or "means behind" in case or "bearing" in case or "late" in case
            else (),
        )
        for case in CASES
    ],
)
def test_the_last_cycle_says_what_numpy_says_of_the_log(case: str) -> None:
    """On a pedestal: inertia and first moment about the pivot, which alone the motion depends on. The gyro is without bias there."""
    (scenario, *settings), stated = CASES[case]
    flight = flown.fly(scenario, *settings)
    text, warned = io.BytesIO(), list[str]()
    pyarrow.csv.write_csv(output.log_table(flight, 0, scenarios.load(scenario, settings).scenario), text)
    log = flight.log(0)
    records, count = log.records_per_cycle, min(CYCLES, log.cycles)
    lines = text.getvalue().decode().splitlines(keepends=True)[: 1 + count * records]
    source = VehicleSource(vehiclefile.changed(flight.vehicle, stated), "vehicle.toml", "")
    said = [json.loads(line) for line in run.follow(lines, source, io.StringIO().write, warned.append)]
    phase, log = resolve.stated(source, records=records).phases[0], log.part(0, count)
    samples = Stream.of(log, phase.resolved, stated_timing(phase.resolved))
    with pytest.MonkeyPatch.context() as numpy_alone:
        numpy_alone.setattr(compiled, "supports", lambda *_: False)
        numpy_alone.setattr(regressors, "in_kernel", lambda _: False)
        found = engine.replay(samples, slice(count - len(said), count), Phase(name="all", start_s=0.0, end_s=60.0), phase.resolved)
    names: Sequence[str] = QUANTITIES
    values, sigmas, key = found.values, found.sigmas, "estimates"
    if phase.resolved.on_pedestal:
        pivot, assumed_kg = np.array(phase.resolved.environment.bearing_position_m), np.array(phase.resolved.pedestal_mass_kg)
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
    assert sum(one["verdict"] == "converged" for one in said[-1][key].values()) >= 6
