"""On a bearing a logged attitude is a measurement: noisy, late, turned, seldom or with gaps, it makes no answer worse than none."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.quaternion import quaternion_of, quaternion_product
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.conclude.estimated import estimated
from massprop_cli.inputs.formats import agreement
from massprop_cli.inputs.tablefile import MapConversion
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.kernel import Kernel
from massprop_cli.prepare import attitudefilter as filters
from massprop_cli.prepare.referenceattitude import filter_input, reference_attitude
from massprop_cli.result import build
from massprop_cli.testbed import scenario, simulate

BEARINGS = {
    "balanced": (),
    "far off": ("truth.cg_z=-0.004", "vehicle.imu.gyro_noise_rad_s=3e-4"),
}
ENDS = (1e-4, 5e-3)
"""Least and greatest noise of an attitude, rad."""
LOGGED = "sensors.log_attitude=true"
MILLIRADIAN = (LOGGED, "sensors.attitude_noise_rad=1e-3")
TURNED = "sensors.attitude_misalignment_rad=[0.02, -0.01, 0.03]"
QUIET = ("sensors.gyro_noise_rad_s=1e-9", "sensors.accel_noise_m_s2=1e-9", LOGGED)


class Answer(NamedTuple):
    """Of one log."""

    z: Array
    """(10,) errors over sigmas."""
    sigma: Array
    """(10,)"""
    codes: frozenset[str]


def biased(seed: int) -> tuple[str, ...]:
    """Biases of gyro and accelerometer, drawn as the vehicle file states them."""
    drawn = np.random.default_rng([seed, 7]).normal(0.0, 1.0, 6)
    return (
        "vehicle.imu.gyro_bias_sigma_rad_s=1e-3",
        "vehicle.imu.accel_bias_sigma_m_s2=0.01",
        f"sensors.gyro_bias_rad_s={(1e-3 * drawn[:3]).tolist()}",
        f"sensors.accel_bias_m_s2={(1e-2 * drawn[3:]).tolist()}",
    )


@cache
def flown(seed: int, *settings: str) -> simulate.SimulatedFlight:
    return simulate.fly(scenario.load("testbed", settings), [seed])


def answer(flight: simulate.SimulatedFlight, log: Log | None = None, *stated: str) -> Answer:
    return beside_truth(flow.examine(log or flight.log(0), VehicleSource(changed(flight.vehicle, stated), "", "")), flight)


def beside_truth(analysis: Analysis, flight: simulate.SimulatedFlight) -> Answer:
    last = analysis.conclusions[-1]
    sigma = np.sqrt(np.diag(last.covariance))
    return Answer((last.values - flight.truth[0][-1]) / sigma, sigma, frozenset(notice.code for notice in analysis.notices))


CASES = [(seed, noise, bearing, bias) for seed, noise in enumerate(ENDS, 1) for bearing in BEARINGS for bias in (False, True)]
"""Each a log of its own."""


@cache
def of_seed(seed: int, bearing: str, bias: bool, *settings: str) -> Answer:
    return answer(flown(seed, *BEARINGS[bearing], *(biased(seed) if bias else ()), *settings))


@cache
def of_noise(seed: int, bearing: str, bias: bool, noise: float | None) -> Answer:
    """Of one flight's log with attitudes of such noise in it, or with none."""
    flight = flown(seed, *BEARINGS[bearing], *(biased(seed) if bias else ()), LOGGED, "sensors.attitude_noise_rad=0")
    log = flight.log(0)
    if noise is None or log.attitude_wxyz is None:
        return answer(flight, replace(log, attitude_wxyz=None))
    rng = np.random.default_rng([seed, list(BEARINGS).index(bearing), bias, 2])
    turns = noise * rng.standard_normal((log.rows, 3))
    return answer(flight, replace(log, attitude_wxyz=frozen(quaternion_product(log.attitude_wxyz, quaternion_of(turns)))))


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize(("bearing", "bias"), [*zip(BEARINGS, (False, True), strict=True)])
def test_no_sigma_is_larger_than_without_the_columns(bearing: str, bias: bool) -> None:
    """Of 0.1 and 5 mrad, but for a percent in the mean; by 0.1 mrad they are a fifth smaller at least."""
    for seed, noise in enumerate(ENDS, 1):
        without, found = (of_noise(seed, bearing, bias, one) for one in (None, noise))
        assert found.codes == {"noise-estimated"}
        assert (found.sigma / without.sigma).mean() < 1.01
        assert (found.sigma < 1.12 * without.sigma).all()  # where chance contradicts the stated start, 1 log in 10,000
        assert noise > 1e-4 or (found.sigma < 0.8 * without.sigma).all()
        assert np.abs(found.z).max() < 4.5


@pytest.mark.seeds
@pytest.mark.thorough
def test_sigmas_hold() -> None:
    """Of two bearings, without and with biases. CG and mass of a log go together, so that 80 values scatter as half as many."""
    z = np.array([of_noise(seed, bearing, bias, noise).z for seed, noise, bearing, bias in CASES])
    assert abs((np.abs(z) < 1.96).mean() - 0.95) < 2.5 * np.sqrt(0.95 * 0.05 / (z.size / 2))
    assert abs(np.sqrt((z**2).mean()) - 1) < 2.5 / np.sqrt(z.size)


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_twin_without_noise_gives_the_truth() -> None:
    """Noise as stated, and none in the log: the estimator's own error is below a tenth of a sigma."""
    stated = "vehicle.imu.attitude_sigma_rad=1e-3", "sensors.attitude_noise_rad=0"
    for bearing in BEARINGS.values():
        flight = flown(1, *bearing, *biased(1), *QUIET, *stated)
        source = VehicleSource(flight.vehicle, "", "")
        z = beside_truth(estimated(flight.log(0), source, (), lambda *_: None, check=False), flight).z
        assert np.sqrt((z**2).mean()) < 0.1


SIMULATED = {
    "between the cycles' ends": ("sensors.records_per_cycle=4", "sensors.attitude_every_records=3"),
    "several cycles late": ("sensors.attitude_latency_s=0.13", "vehicle.imu.attitude_latency_s=0.13"),
    "turned": (TURNED, "vehicle.imu.attitude_misalignment_sigma_rad=0.03"),
}


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize(
    "settings",
    [pytest.param(one, id=name, marks=pytest.mark.seeds if name != "between the cycles' ends" else ()) for name, one in SIMULATED.items()],
)
def test_what_is_stated_of_the_attitude_is_followed(settings: tuple[str, ...]) -> None:
    """Beside none at all; a log of four records a cycle has its own noise."""
    fine = settings[:1] if "records_per_cycle" in settings[0] else ()
    with_it, without = of_seed(1, "balanced", True, *MILLIRADIAN, *settings), of_seed(1, "balanced", True, *fine)
    assert with_it.codes == {"noise-estimated"}
    assert np.abs(with_it.z).max() < 3.5
    assert (with_it.sigma < 1.01 * without.sigma).all()


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_latency_that_is_left_to_the_log_is_found_within_its_sigma_and_told() -> None:
    flight = flown(2, *biased(2), *MILLIRADIAN, "sensors.attitude_latency_s=0.13")
    source = VehicleSource(changed(flight.vehicle, ['imu.attitude_latency_s="auto"']), "", "")
    found = flow.examine(flight.log(0), source)
    assert np.abs(beside_truth(found, flight).z).max() < 3.5
    (told,) = build.result(found).low_passes
    assert told.sensor == "attitude"
    assert told.latency_s == pytest.approx(0.13, abs=3 * (told.latency_sigma_s or 0.0))


@pytest.mark.seeds
@pytest.mark.thorough
def test_of_a_latency_that_is_stated_to_milliseconds_the_log_tells_more() -> None:
    """Where the stated sigma went into every value, those of a pedestal were up to 57 times as uncertain as without any attitude."""
    late = "imu.attitude_latency_s=0.127", "imu.attitude_latency_sigma_s=0.003"
    flight = flown(2, *biased(2), *MILLIRADIAN, "sensors.attitude_latency_s=0.13")
    found = flow.examine(flight.log(0), VehicleSource(changed(flight.vehicle, late), "", ""))
    assert np.abs(beside_truth(found, flight).z).max() < 3.5
    imu = found.vehicle.imu
    assert imu.attitude_latency_sigma_s < 0.0015
    assert imu.attitude_latency == pytest.approx(0.13, abs=3 * imu.attitude_latency_sigma_s)


@pytest.mark.seeds
@pytest.mark.thorough
def test_gaps_and_signs_of_the_quaternion_do_no_harm() -> None:
    flight = flown(1, *biased(1), *MILLIRADIAN)
    log, rng = flight.log(0), np.random.default_rng(3)
    assert log.attitude_wxyz is not None
    attitude = log.attitude_wxyz * np.where(rng.random(len(log.attitude_wxyz)) < 0.5, -1.0, 1.0)[:, None]
    flipped = answer(flight, replace(log, attitude_wxyz=frozen(attitude)))
    np.testing.assert_allclose(flipped.z, of_seed(1, "balanced", True, *MILLIRADIAN).z, atol=1e-6)
    attitude[:7] = attitude[100:250] = attitude[-40:] = np.nan
    gaps = answer(flight, replace(log, attitude_wxyz=frozen(attitude)))
    assert gaps.codes == {"noise-estimated"}
    assert np.abs(gaps.z).max() < 3.5


GAPPED = {"free-flyer": 10, "testbed": 10, "pedestal": 25}
"""Seconds without an attitude in each of two gaps."""


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("name", list(GAPPED))
def test_gaps_of_many_seconds_name_no_cause(name: str) -> None:
    """Half the log to most of it has no attitude; read by a map, its gyro is compared with what is left."""
    flight = simulate.fly(scenario.load(name, MILLIRADIAN), [3])
    log, length = flight.log(0), GAPPED[name]
    assert log.attitude_wxyz is not None
    since = log.time_s - log.time_s[0]
    gone = (since % (length + 1.7) > 1.7) & (since < 2 * (length + 1.7))
    gapped = replace(log, attitude_wxyz=frozen(np.where(gone[:, None], np.nan, log.attitude_wxyz)))
    force = log.delta_v_imu_m_s / log.interval_s[:, None]
    agreement.check(log.path, MapConversion("m.toml", "0", ()), flight.vehicle, log.delta_theta_imu_rad, force, gapped.attitude_wxyz)
    found = answer(flight, gapped)
    assert found.codes <= {"noise-estimated"}
    assert np.abs(found.z).max() < 3.5


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_later_phase_knows_what_the_attitudes_before_it_told() -> None:
    """Half a second of attitudes, 12 s before: what is known of bias and attitude goes on to where the phase begins."""
    late = 'phases=[{name = "late", start_s = 12.0, end_s = 24.0}]'
    flight = flown(1, *biased(1), *MILLIRADIAN)
    log = flight.log(0)
    without = answer(flight, replace(log, attitude_wxyz=None), late)
    found = answer(flight, None, late)
    assert np.abs(found.z).max() < 3.5
    assert (found.sigma < 1.01 * without.sigma).all()


UNSTATED = {
    "bias": (("sensors.gyro_bias_rad_s=[1e-3, 2e-3, -1e-3]",), r"a gyro bias of \(0\.001, 0\.002, -0\.001\) rad/s; state imu.gyro_bias"),
    "turn": ((TURNED,), r"axes turned by \(0\.0[12]\d?, -0\.0\d+, 0\.0[23]\d?\) rad.*; state imu.attitude_misalignment_sigma_rad"),
    "late": (("sensors.attitude_latency_s=0.05",), r"a latency of 0\.05\d* s; state imu.attitude_latency_s = 0\.05"),
    "very late": (("sensors.attitude_latency_s=0.3",), r"a latency of 0\.(30?\d*|29\d) s; state imu.attitude_latency_s"),
    "scatter": (("vehicle.imu.attitude_sigma_rad=1e-4",), r"scatters by (0\.9\d?|1|1\.\d) mrad .* imu.attitude_sigma_rad is 0\.0001 rad"),
}


@pytest.mark.parametrize(
    "unstated",
    [pytest.param(one, id=name, marks=[pytest.mark.thorough] * (name != "turn")) for name, one in UNSTATED.items()],
)
def test_an_attitude_that_does_not_fit_is_left_out_with_what_to_state(unstated: tuple[tuple[str, ...], str]) -> None:
    settings, message = unstated
    flight = flown(1, *MILLIRADIAN, *settings)
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "", ""))
    said = next(notice.message for notice in found.notices if notice.code == "attitude-misfit")
    assert re.search(message, said)
    assert found.log.attitude_wxyz is None


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_vehicle_that_did_not_begin_level_is_found_where_it_stood() -> None:
    """By the attitude alone: the vehicle file says level, and the log one degree."""
    tilted = "vehicle.environment.initial_attitude_wxyz=[0.9999619, 0.0087265, 0, 0]"
    flight = flown(1, *MILLIRADIAN, tilted)
    found = answer(flight, None, "environment.initial_attitude_wxyz=[1, 0, 0, 0]")
    assert found.codes == {"noise-estimated"}
    assert np.abs(found.z).max() < 3.5


@pytest.mark.thorough
def test_attitudes_of_a_room_that_is_out_of_level_are_left_out_where_the_beginning_is_not_known_either() -> None:
    """Motion capture half a degree off the vertical, and a vehicle that is said to begin level in it."""
    flight = flown(1, *MILLIRADIAN, "vehicle.environment.initial_attitude_wxyz=[0.9999619, 0.0087265, 0, 0]")
    log, room = flight.log(0), quaternion_of(np.array([0.006, -0.006, 0.0]))
    assert log.attitude_wxyz is not None
    turned = replace(log, attitude_wxyz=frozen(quaternion_product(room, log.attitude_wxyz)))
    vehicle = changed(flight.vehicle, ("environment.initial_attitude_wxyz=[1, 0, 0, 0]",))
    found = flow.examine(turned, VehicleSource(vehicle, "", ""))
    assert [fault.notice.code for fault in found.faults] == ["attitude-start"]
    assert "attitude-misfit" in {notice.code for notice in found.notices}
    (corrected,) = found.mended[0].conclusions
    assert np.abs((corrected.values - flight.truth[0][-1]) / np.sqrt(np.diag(corrected.covariance))).max() < 4


@pytest.mark.parametrize("noise", [1e-3, *(pytest.param(noise, marks=pytest.mark.thorough) for noise in ENDS)])
def test_the_noise_is_estimated(noise: float) -> None:
    flight = flown(1, LOGGED, f"sensors.attitude_noise_rad={noise}")
    found = filter_input(flight.log(0), flight.vehicle)
    assert found is not None
    assert abs(found.noise.attitude_rad / noise - 1) < 0.1


@pytest.mark.thorough
def test_the_reference_stays_with_the_logged_attitude() -> None:
    """0.1 rad/s of bias, 40 degrees in the log: within 3 mrad after the first seconds."""
    flight = flown(1, *MILLIRADIAN, "sensors.gyro_bias_rad_s=[0.02, -0.03, 0.01]", "vehicle.imu.gyro_bias_sigma_rad_s=0.03")
    found = reference_attitude(flight.log(0), flight.vehicle)
    assert found is not None
    apart = np.abs(np.einsum("ki,ki->k", found.attitude_wxyz, flight.attitude_wxyz[0]))
    assert 2 * np.arccos(np.minimum(apart[100:], 1.0)).max() < 3e-3


@pytest.mark.thorough
def test_the_kernel_filters_attitudes_as_numpy_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noisy, late, between cycles' ends, seldom: the reference to 1e-11 rad, what is known of its error to 1e-9 of a sigma."""
    flight = flown(1, *MILLIRADIAN, *biased(1), *SIMULATED["between the cycles' ends"])
    log, vehicle = flight.log(0), flight.vehicle
    compiled = reference_attitude(log, vehicle)
    monkeypatch.setattr(filters, "kernel", lambda: Kernel(None, "none"))
    plain = reference_attitude(replace(log), vehicle)
    assert compiled is not None
    assert plain is not None
    assert np.abs(compiled.attitude_wxyz - plain.attitude_wxyz).max() < 1e-11
    assert np.abs(compiled.offset_rad - plain.offset_rad).max() < 1e-11
    sigma = np.sqrt(np.einsum("kii->ki", plain.covariance))
    np.testing.assert_allclose(compiled.covariance, plain.covariance, rtol=1e-6, atol=1e-15)
    assert (np.abs(compiled.known - plain.known) <= 1e-9 * sigma + 1e-13).all()


@pytest.mark.parametrize("seed", [3, pytest.param(6, marks=pytest.mark.thorough)])
def test_noise_of_a_gyro_that_nobody_states_carries_the_attitude_off(seed: int) -> None:
    """By attitudes alone it is a difference of two large numbers, which was none in a third of the logs: their walk was told as a bias."""
    flight = flown(seed, LOGGED, "sensors.attitude_noise_rad=3e-4", "vehicle.imu.gyro_noise_rad_s=3e-4")
    imu = flight.vehicle.imu.model_copy(update={"gyro_noise_rad_s": None, "attitude_sigma_rad": None})
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle.model_copy(update={"imu": imu}), "", ""))
    assert {notice.code for notice in found.notices} == {"noise-estimated"}
