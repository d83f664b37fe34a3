"""Values under ``uncertain`` that are off by about one sigma: the log shows them, and no cause is named."""

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import written
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.testbed import scenario, simulate

SCALE, RISE_S, SEEDS = 0.005, 0.004, 6
AXES = '["roll", "pitch", "yaw", "x", "y", "z"]'
PLAN = ("duration_s=20.0", f'plan=[{{motion="random", axes={AXES}, start_s=1.0, end_s=20.0}}]')
GYRO = [{"gyro_factors": np.diag(1 + SCALE * axis).tolist()} for axis in np.eye(3)]


def flown(*more: str) -> simulate.SimulatedFlight:
    return simulate.fly(scenario.load("free-flyer", (*PLAN, *more)), range(1, SEEDS + 1))


def deviations(found: Analysis, truth: Array) -> Array:
    """(10,) sigmas."""
    estimates = found.conclusions[0].estimates
    return np.array([(estimates[name].value - true) / estimates[name].sigma for name, true in zip(QUANTITIES, truth, strict=True)])


def test_a_gyro_whose_scale_is_as_uncertain_as_stated_is_no_fault() -> None:
    """Estimated from noise-free readings: read with their noise, a scale would explain that noise."""
    flights, draw, off = flown(), np.random.default_rng(1), []
    for number in range(SEEDS):
        log = flights.log(number)
        log = replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad * (1 + SCALE * draw.normal(size=3)))
        used = changed(flights.vehicle, [f"uncertain={written(GYRO)}"])
        found = flow.examine(log, VehicleSource(used, "restated", ""))
        assert [notice.code for notice in found.notices] == []
        assert {one.verdict for name, one in found.conclusions[0].estimates.items() if name != "mass"} == {"converged"}
        off.append(deviations(found, flights.truth[number, 0]))
    assert np.abs(off).max() < 4
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.3


@pytest.mark.thorough
def test_valves_that_open_as_slowly_as_may_be_are_no_fault() -> None:
    jets = flown().vehicle.jets
    slow = {f"jets.{number}.{key}": RISE_S for number in range(len(jets)) for key in ("rise_s", "fall_s")}
    flights, off = flown(*(f"vehicle.{key}={value}" for key, value in slow.items())), []
    for number in range(SEEDS):
        stated = changed(flights.vehicle, [f"{key}=0.0" for key in slow] + [f"uncertain={written([slow])}"])
        found = flow.examine(flights.log(number), VehicleSource(stated, "restated", ""))
        assert [notice.code for notice in found.notices] == []
        assert not [one for one in found.conclusions[0].estimates.values() if one.verdict == "contradicted"]
        off.append(deviations(found, flights.truth[number, 0]))
    assert np.abs(off).max() < 4


def test_all_thrust_stays_as_uncertain_as_stated_for_no_log_can_tell_it() -> None:
    """As with the same sigma as ``thrust.scale_sigma``. A quiet log seemed to inform it by terms of second order."""
    flights = flown("duration_s=120.0", "plan.0.end_s=120.0", "vehicle.imu.gyro_noise_rad_s=1e-5", "vehicle.imu.accel_noise_m_s2=1e-3")
    stronger = {f"jets.{i}.force_n": [1.02 * part for part in jet.force_n] for i, jet in enumerate(flights.vehicle.jets)}
    scaled = [*range(6), 9]
    keys = ([f"uncertain={written([stronger])}"], ["thrust.scale_sigma=0.02"])
    for number in range(3):
        entry, scale = (
            flow.examine(flights.log(number), VehicleSource(changed(flights.vehicle, one), "restated", "")).conclusions[0] for one in keys
        )
        np.testing.assert_allclose(entry.sigmas[scaled], scale.sigmas[scaled], rtol=0.05)
        assert {one.verdict for one in entry.estimates.values()} == {"converged"}
