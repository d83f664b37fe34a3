"""Values under ``uncertain`` that are off by about one sigma: the log shows them, and no cause is named."""

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import written
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.result import build
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


@pytest.mark.parametrize(("off", "at_bound"), [(0.0, []), (1.5, [{"thrust.lag_s": 1e-5}])])
def test_a_pivot_that_may_be_elsewhere_is_in_the_cgs_sigma_alone(off: float, at_bound: list[dict[str, float]]) -> None:
    """It moves the CG with it, and is as far off as the CG hangs from it: nothing about the stated pivot is linear."""
    sigma = 3e-4
    flights = simulate.fly(
        scenario.load("pedestal", ("duration_s=30.0", "plan.0.end_cycle=500", "plan.1.start_cycle=500", "plan.1.end_cycle=600")), [1, 2, 3]
    )
    pivot = np.array(flights.vehicle.environment.bearing_position_m)
    key, x = "environment.bearing_position_m", np.array([sigma, 0.0, 0.0])
    stated = pivot - off * x
    used = changed(
        flights.vehicle, [f"{key}={written(stated.tolist())}", f"uncertain={written([{key: (stated + x).tolist()}, *at_bound])}"]
    )
    for number in range(3):
        found = flow.examine(flights.log(number), VehicleSource(used, "restated", ""))
        exact = flow.examine(flights.log(number), VehicleSource(flights.vehicle, "exact", "")).conclusions[0].sigmas
        assert [notice.code for notice in found.notices] == []
        assert np.nanmax(np.abs(deviations(found, flights.truth[number, 0]))) < 4
        assert build.result(found).vehicle.bearing_position_m == stated.tolist()
        sigmas = found.conclusions[0].sigmas
        np.testing.assert_allclose(sigmas[6], np.hypot(exact[6], sigma), rtol=0.05)
        others = [0, 1, 2, 3, 4, 5, 7, 8, 9]
        np.testing.assert_allclose(sigmas[others], exact[others], rtol=0.1)


@pytest.mark.parametrize("off", [-1.2, 1.2])
def test_rotors_that_answer_as_slowly_as_may_be_are_no_fault(off: float) -> None:
    """The response is curved in the lag, which the log tells to a hundredth of what is stated."""
    sigma, flights = 0.003, simulate.fly(scenario.load("multicopter"), [1, 2])
    lags = {f"rotors.{i}.{key}": getattr(one, key) for i, one in enumerate(flights.vehicle.rotors) for key in ("lag_up_s", "lag_down_s")}
    stated = {key: lag - off * sigma for key, lag in lags.items()}
    later = [{key: lag + sigma for key, lag in stated.items()}]
    used = changed(flights.vehicle, [*(f"{key}={lag}" for key, lag in stated.items()), f"uncertain={written(later)}"])
    for number in range(2):
        found = flow.examine(flights.log(number), VehicleSource(used, "restated", ""))
        assert [notice.code for notice in found.notices] == []
        assert np.nanmax(np.abs(deviations(found, flights.truth[number, 0]))) < 4


def test_a_known_value_under_uncertain_is_refused() -> None:
    """It would change nothing: the estimate takes its sigma from [known]."""
    with pytest.raises(InputError, match=r"values under \[known\] have sigmas of their own; state those instead"):
        changed(scenario.load("pedestal").scenario.vehicle, ['uncertain=[{"known.mass.value" = 12.1}]'])
