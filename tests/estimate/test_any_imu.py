"""IMUs that are sampled, low-pass filtered and on clocks of their own, against motion that is integrated apart (tests/anyimu.py).

Over many of them: benchmarks/imus.py.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.report import timing
from massprop_cli.result import build
from tests import anyimu
from tests.flown import fly

QUIET = 1e-4
"""rad/s"""


def found_of(
    seed: int,
    imu: anyimu.Imu,
    period_s: float,
    auto: bool = False,
    noise: float = 1.0,
    bare: bool = False,
    count: int = 2,
    wheels: str = "",
    **kind: bool,
) -> list[tuple[Analysis, Array]]:
    """Estimates of some bodies, and their deviations in sigmas; without noise, which is stated then, what is systematic of them.

    With jets, and wheels by a column ``wheels`` where there is one.
    """
    rng = np.random.default_rng(seed)
    own = anyimu.bodies(rng, count, **kind)
    own = anyimu.wheeled(rng, own, jets=True) if wheels else own
    flown, found = anyimu.fly(rng, own, imu, period_s, 16.0, 2 * period_s, noise=noise), []
    for body in range(count):
        used = anyimu.vehicle_of(own, body, flown, imu, period_s, 2 * period_s, auto, stated=noise == 0, wheels=wheels)
        used = anyimu.unstated(used) if bare else used
        answer = flow.examine(anyimu.log_of(flown, body, imu, used), VehicleSource(used, "any-imu", ""))
        told = answer.conclusions[0].estimates
        value, sigma = (np.array([getattr(told[name], part) for name in QUANTITIES], dtype=float) for part in ("value", "sigma"))
        found.append((answer, (value - anyimu.truth_of(own, body)) / sigma))
    return found


@pytest.mark.parametrize(
    ("imu", "period_s", "most"),
    [
        pytest.param(anyimu.Imu(measures="mean", gyro_noise=QUIET), 1 / 30, 0.05, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param(anyimu.Imu(measures="sample", offset_s=0.0037, ppm=50.0, gyro_noise=QUIET), 0.05, 0.05, marks=pytest.mark.thorough),
        (anyimu.Imu(measures="sample", order=1, rate_hz=97.0, gyro_noise=QUIET), 0.05, 0.02),
        pytest.param(
            anyimu.Imu(measures="mean", order=2, cutoff_hz=25.0, latency_s=0.003, gyro_noise=QUIET),
            0.025,
            0.1,
            marks=[pytest.mark.thorough, pytest.mark.seeds],
        ),
    ],
)
def test_without_noise_nothing_is_left(imu: anyimu.Imu, period_s: float, most: float) -> None:
    """The mean of samples, or of filtered rates, is not the mean rate; with a low-noise gyro that moves ω × I ω by several sigma."""
    for answer, deviation in found_of(3, imu, period_s, noise=0.0):
        assert not [notice.code for notice in answer.notices if not notice.code.startswith("noise")]
        assert np.abs(deviation).max() < most


def test_a_wheel_that_a_pulse_turns_the_body_about_is_left_behind_within_the_cycle() -> None:
    """Of wheels with 0.2 % of the body's inertia, read once in a cycle: taken to turn evenly they show a delay that is none."""
    quiet = anyimu.Imu(20.0, "increment", gyro_noise=3e-5, accel_noise=0.005)
    for answer, deviation in found_of(4, quiet, 0.05, wheels="speed", noise=0.0):
        assert not [notice.code for notice in answer.notices if not notice.code.startswith("noise")]
        assert np.abs(deviation).max() < 0.3


@pytest.mark.parametrize("held", [False, True])
def test_what_the_drives_of_wheels_hold_is_found_beside_jets(held: bool) -> None:
    """Of wheels with 1 to 5 % of the body's inertia; taken for the other kind, logs had a delay that is none, and values 6 sigma off."""
    rng = np.random.default_rng(31)
    own = anyimu.wheeled(rng, anyimu.bodies(rng, 1), jets=True)
    own, imu = replace(own, spin_inertia=10 * own.spin_inertia), anyimu.Imu(20.0, "increment", gyro_noise=1e-4, accel_noise=0.01)
    flown = anyimu.fly(rng, own, imu, 0.05, 16.0, 0.1, held=held)
    used = anyimu.vehicle_of(own, 0, flown, imu, 0.05, 0.1, stated=True, wheels="speed")
    answer = flow.examine(anyimu.log_of(flown, 0, imu, used), VehicleSource(used, "any-imu", ""))
    assert {wheel.holds for wheel in answer.vehicle.wheels} == {"speed" if held else None}
    assert [notice.code for notice in answer.notices] == ["noise-estimated"] * held
    assert_within_four_sigmas(answer, anyimu.truth_of(own, 0))


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.numerical
@pytest.mark.parametrize(
    ("imu", "column"),
    [
        (anyimu.Imu(measures="mean", order=1, rate_hz=97.0, ppm=50.0, offset_s=0.003, gyro_noise=QUIET), "torque"),
        (anyimu.Imu(measures="sample", order=2, cutoff_hz=30.0, gyro_noise=QUIET), "speed"),
    ],
)
def test_wheels_are_told_by_another_clock(imu: anyimu.Imu, column: str) -> None:
    """By torques with times of their own, whose sum is their speed; or by speeds at the records."""
    ((answer, deviation),) = found_of(3, imu, 0.05, count=1, wheels=column, noise=0.0)
    assert not [notice.code for notice in answer.notices if not notice.code.startswith("noise")]
    assert all(one.verdict == "converged" for one in answer.conclusions[0].estimates.values())
    assert np.abs(deviation).max() < 0.3  # in turns of 0.25 rad in a control cycle


@pytest.mark.parametrize(
    ("seed", "imu", "period_s", "decimals"),
    [
        pytest.param(23, anyimu.Imu(gyro_noise=5e-4, accel_noise=0.01), 0.05, 12, marks=pytest.mark.thorough),
        pytest.param(26, anyimu.Imu(gyro_noise=5e-4, accel_noise=0.01), 0.05, 12, marks=pytest.mark.thorough),
        (23, anyimu.Imu(rate_hz=150.0, gyro_noise=5e-4, accel_noise=0.01), 1 / 30, 6),
    ],
)
@pytest.mark.parametrize("auto", [False, pytest.param(True, marks=pytest.mark.thorough)])
def test_commands_at_samples_times_are_before_or_after_them(seed: int, imu: anyimu.Imu, period_s: float, decimals: int, auto: bool) -> None:
    """Of one clock, where a delay that is off by a microsecond makes half of a pulse's samples another's; nothing rounds them."""
    rng = np.random.default_rng(seed)
    own = anyimu.bodies(rng, 1)
    flown = anyimu.fly(rng, own, imu, period_s, 20.0, 2 * period_s)
    flown = replace(flown, time_s=np.round(flown.time_s, decimals), command_s=np.round(flown.command_s, decimals))
    used = anyimu.vehicle_of(own, 0, flown, imu, period_s, 2 * period_s)
    used = used.model_copy(update={"cycle": used.cycle.model_copy(update={"command_delay_cycles": "auto"})}) if auto else used
    answer = flow.examine(anyimu.log_of(flown, 0, imu, used), VehicleSource(used, "any-imu", ""))
    assert not [notice.code for notice in answer.notices if not notice.code.startswith("noise")]
    assert all(one.verdict == "converged" for one in answer.conclusions[0].estimates.values())
    assert_within_four_sigmas(answer, anyimu.truth_of(own, 0))


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("auto", [False, True])
def test_pulses_that_end_at_samples_times_do_so_before_or_after_them(auto: bool) -> None:
    """Cycles begin half-way between samples: a delay off by 0.001 cycles had been named, by eight sigma, and all was contradicted."""
    rng, imu = np.random.default_rng(23), anyimu.Imu(rate_hz=100.0, gyro_noise=1e-4, accel_noise=0.01)
    own, late_s = anyimu.bodies(rng, 1), 2.1 * 0.05
    flown = anyimu.fly(rng, own, imu, 0.05, 20.0, late_s, parts=10)
    flown = replace(flown, time_s=np.round(flown.time_s, 9), command_s=np.round(flown.command_s, 9))
    used = anyimu.vehicle_of(own, 0, flown, imu, 0.05, late_s)
    used = used.model_copy(update={"cycle": used.cycle.model_copy(update={"command_delay_cycles": "auto"})}) if auto else used
    answer = flow.examine(anyimu.log_of(flown, 0, imu, used), VehicleSource(used, "any-imu", ""))
    assert not [notice.code for notice in answer.notices if not notice.code.startswith("noise")]
    assert all(one.verdict == "converged" for one in answer.conclusions[0].estimates.values())
    assert_within_four_sigmas(answer, anyimu.truth_of(own, 0))


@pytest.mark.parametrize(
    "imu",
    [
        anyimu.Imu(measures="sample", gyro_noise=QUIET),
        pytest.param(
            anyimu.Imu(measures="sample", order=2, cutoff_hz=30.0, gyro_noise=QUIET), marks=[pytest.mark.seeds, pytest.mark.thorough]
        ),
    ],
)
def test_on_a_bearing_the_weight_is_where_the_sensors_show_it(imu: anyimu.Imu) -> None:
    """Samples are no mean rates, and late or early by some milliseconds; so is the attitude that the gyro carries."""
    for _, deviation in found_of(5, imu, 0.05, noise=0.0, bearing=True):
        assert np.abs(deviation).max() < 0.1


@pytest.mark.thorough
def test_a_cutoff_is_found_with_its_sigma() -> None:
    imu = anyimu.Imu(measures="sample", order=2, cutoff_hz=45.0, offset_s=0.002)
    for answer, deviation in found_of(7, imu, 0.05, auto=True, count=1):
        assert not [notice.code for notice in answer.notices if not notice.code.startswith("noise")]
        assert np.abs(deviation).max() < 4.5
        for low_pass in (answer.vehicle.imu.gyro_filter, answer.vehicle.imu.accel_filter):
            assert low_pass is not None
            assert 0 < low_pass.cutoff_sigma_hz < 15
            assert abs(low_pass.cutoff - 45.0) < 4.5 * low_pass.cutoff_sigma_hz


def test_delay_and_both_cutoffs_are_found_together() -> None:
    """They look alike; the search had gone to a delay of a whole cycle, with no low-pass and a chi-square of thousands."""
    imu, rng, period_s, delay = anyimu.Imu(order=1, cutoff_hz=24.0, gyro_noise=5e-4, accel_noise=0.01), np.random.default_rng(6), 0.1, 0.79
    own = anyimu.bodies(rng, 1, bearing=True)
    flown = anyimu.fly(rng, own, imu, period_s, 30.0, delay * period_s)
    used = anyimu.vehicle_of(own, 0, flown, imu, period_s, delay * period_s, auto=True)
    used = used.model_copy(update={"cycle": used.cycle.model_copy(update={"command_delay_cycles": "auto"})})
    answer = flow.examine(anyimu.log_of(flown, 0, imu, used), VehicleSource(used, "any-imu", ""))
    assert answer.detected is not None
    assert abs(answer.timing.delay - delay) < 4 * answer.detected.sigma.delay
    for low_pass in (answer.vehicle.imu.gyro_filter, answer.vehicle.imu.accel_filter):
        assert low_pass is not None
        assert abs(low_pass.cutoff - 24.0) < 4 * low_pass.cutoff_sigma_hz < 20.0
    assert_within_four_sigmas(answer, anyimu.truth_of(own, 0))


def test_on_a_bearing_the_weight_tells_how_late_the_accelerometer_is() -> None:
    """As well as the gyro's rates tell it of the gyro: the specific force turns with the attitude."""
    ((answer, deviation),) = found_of(
        8, anyimu.Imu(200.0, "mean", 1, 40.0, gyro_noise=2e-4, accel_noise=0.02), 0.14, auto=True, count=1, bearing=True
    )
    gyro, accelerometer = answer.vehicle.imu.gyro_filter, answer.vehicle.imu.accel_filter
    assert gyro is not None
    assert accelerometer is not None
    assert accelerometer.cutoff_sigma_hz < 1.4 * gyro.cutoff_sigma_hz
    assert abs(1 / accelerometer.cutoff - 1 / gyro.cutoff) < 2 * np.pi * 1e-4
    assert np.abs(deviation).max() < 4


def with_latency(used: Vehicle, delay: float | Literal["auto"]) -> Vehicle:
    """The vehicle file with both latencies to be found."""
    low_passes = {name: getattr(used.imu, name).model_copy(update={"latency_s": "auto"}) for name in ("gyro_filter", "accel_filter")}
    cycle = used.cycle.model_copy(update={"command_delay_cycles": delay})
    return used.model_copy(update={"imu": used.imu.model_copy(update=low_passes), "cycle": cycle})


def assert_within_four_sigmas(answer: Analysis, truth: Array) -> None:
    told = answer.conclusions[0].estimates
    for name, value in zip(QUANTITIES, truth, strict=True):
        one = told[name]
        assert one.value is not None
        assert one.sigma is not None
        assert abs(one.value - value) < 4 * one.sigma


@pytest.mark.thorough
@pytest.mark.seeds
def test_latencies_are_estimated_and_not_apart_from_an_unknown_delay() -> None:
    """Both sensors are 4 ms late beyond their low-pass; a shift of the commands looks the same as one of both sensors."""
    imu, rng = anyimu.Imu(measures="sample", order=2, cutoff_hz=45.0, latency_s=0.004), np.random.default_rng(7)
    own = anyimu.bodies(rng, 1)
    flown = anyimu.fly(rng, own, imu, 0.05, 16.0, 0.1)
    used = with_latency(anyimu.vehicle_of(own, 0, flown, imu, 0.05, 0.1), 2.0)
    log = anyimu.log_of(flown, 0, imu, used)
    answer = flow.examine(log, VehicleSource(used, "any-imu", ""))
    for low_pass in (answer.vehicle.imu.gyro_filter, answer.vehicle.imu.accel_filter):
        assert low_pass is not None
        assert 0 < low_pass.latency_sigma_s < 2e-3
        assert abs(low_pass.latency - 0.004) < 4 * low_pass.latency_sigma_s
    shown = build.result(answer)
    assert [(one.sensor, one.cutoff_hz) for one in shown.low_passes] == [("gyro", None), ("accelerometer", None)]
    said = re.fullmatch(r"the accelerometer is ([\d.]+) ± ([\d.]+) ms late", timing.low_passes(shown)[1])
    assert said is not None
    assert abs(float(said[1]) - 4.0) < 4 * float(said[2])
    assert_within_four_sigmas(answer, anyimu.truth_of(own, 0))
    with pytest.raises(InputError, match="only their sums; state one"):
        flow.examine(log, VehicleSource(with_latency(used, "auto"), "any-imu", ""))


@pytest.mark.parametrize(
    "imu",
    [
        pytest.param(anyimu.Imu(measures="sample"), id="no low-pass", marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param(
            anyimu.Imu(measures="sample", order=2, cutoff_hz=25.0, gyro_noise=3e-4, accel_noise=5e-3),
            id="25 Hz",
            marks=pytest.mark.thorough,
        ),
        pytest.param(anyimu.Imu(measures="mean"), id="means", marks=[pytest.mark.thorough, pytest.mark.seeds]),
    ],
)
def test_what_the_imu_records_is_found_where_nobody_states_it(imu: anyimu.Imu) -> None:
    """The mass had been 6 to 17 % off, and no cause was found."""
    for answer, deviation in found_of(9, imu, 0.05, bare=True):
        codes = [notice.code for notice in answer.notices if not notice.code.startswith("noise")]
        assert codes == ([] if imu.measures == "mean" else ["imu-kernel"])
        used = answer.vehicle.imu
        assert ((used.gyro_filter is None) or (used.accel_filter is None)) is (imu.order == 0)
        # behind 25 Hz a mean over 10 ms looks like a sample 5 ms before
        assert imu.order or used.measures == ("sample" if imu.measures == "sample" else "increment")
        assert np.abs(deviation).max() < 4.5


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_low_pass_behind_increments_is_found_where_the_log_does_not_fit() -> None:
    """Of the second order, which no fault of the table is: it had been "cause unknown"."""
    for answer, deviation in found_of(11, anyimu.Imu(measures="increment", order=2, cutoff_hz=12.0), 0.05, bare=True, count=1):
        assert [notice.code for notice in answer.notices if not notice.code.startswith("noise")] == ["imu-kernel"]
        assert np.abs(deviation).max() < 4.5


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize(("columns", "bearing"), [("delta_theta_imu_rad", False), ("delta_v_imu_m_s", True)])
def test_a_sensor_that_is_later_than_the_other_is_found_and_its_latency_estimated(columns: str, bearing: bool) -> None:
    """By a record of 10 ms: values had been not_converged for an unknown cause, or corrected by a delay of the commands."""
    rng, imu = np.random.default_rng(12), anyimu.Imu(measures="increment", gyro_noise=1e-4, accel_noise=5e-3)
    own = anyimu.bodies(rng, 1, bearing=bearing)
    flown = anyimu.fly(rng, own, imu, 0.05, 16.0, 0.1)
    used = anyimu.vehicle_of(own, 0, flown, imu, 0.05, 0.1, stated=True)
    log = anyimu.log_of(flown, 0, imu, used)
    shown = getattr(log, columns)
    later: dict[str, Any] = {columns: np.concatenate([shown[:1], shown[:-1]])}
    late = replace(log, **later)
    answer = flow.examine(late, VehicleSource(used, "any-imu", ""))
    assert [notice.code for notice in answer.notices if not notice.code.startswith("noise")] == ["imu-kernel"]
    filters = answer.vehicle.imu.gyro_filter, answer.vehicle.imu.accel_filter
    low_pass, other = filters if columns == "delta_theta_imu_rad" else filters[::-1]
    assert other is None
    assert low_pass is not None
    assert low_pass.order == 0
    assert abs(low_pass.latency - 0.01) < 4 * low_pass.latency_sigma_s < 0.004
    assert_within_four_sigmas(answer, anyimu.truth_of(own, 0))
    assert {one.verdict for one in answer.conclusions[0].estimates.values()} == {"converged"}


@pytest.mark.parametrize("measures", [pytest.param("increment", marks=pytest.mark.thorough), "sample"])
def test_a_late_sensor_is_found_in_a_log_longer_than_the_part_that_is_searched(measures: Literal["increment", "sample"]) -> None:
    """1,393 cycles: its likelihood was that of 1,200 of them, so another cause or a low-pass was always likelier."""
    rng, imu = np.random.default_rng(12), anyimu.Imu(measures=measures, gyro_noise=1e-4, accel_noise=5e-3)
    own = anyimu.bodies(rng, 1)
    flown = anyimu.fly(rng, own, imu, 0.02, 28.0, 0.1)
    used = anyimu.vehicle_of(own, 0, flown, imu, 0.02, 0.1, stated=True)
    log = anyimu.log_of(flown, 0, imu, used)
    late = replace(log, delta_v_imu_m_s=np.concatenate([log.delta_v_imu_m_s[:1], log.delta_v_imu_m_s[:-1]]))
    answer = flow.examine(late, VehicleSource(used, "any-imu", ""))
    assert [notice.code for notice in answer.notices] == ["imu-kernel"]
    low_pass = answer.vehicle.imu.accel_filter
    assert low_pass is not None
    assert low_pass.order == 0
    assert abs(low_pass.latency - 0.01) < 4 * low_pass.latency_sigma_s < 0.002
    assert_within_four_sigmas(answer, anyimu.truth_of(own, 0))


@pytest.mark.seeds
@pytest.mark.thorough
def test_no_cause_is_named_in_the_little_that_a_late_gyro_leaves() -> None:
    """Two records of 20 ms, quiet sensors on a bearing: of fast turns the latency is known to first order, and no scale was wrong."""
    plan = ("duration_s=15.0", 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0.0, end_s=15.0}]')
    quiet = ("vehicle.cycle.period_s=0.02", "vehicle.imu.gyro_noise_rad_s=3e-5", "vehicle.imu.accel_noise_m_s2=3e-3")
    flown = fly("testbed", *plan, *quiet, "vehicle.environment.bearing_mass_kg=0.0")
    log = flown.log(0)
    seen = log.delta_theta_imu_rad
    late = replace(log, delta_theta_imu_rad=np.concatenate([np.repeat(seen[:1], 2, 0), seen[:-2]]))
    answer = flow.examine(late, VehicleSource(flown.vehicle, "late", ""))
    assert {notice.code for notice in answer.notices} == {"imu-kernel", "cause-unknown"}
    low_pass = answer.vehicle.imu.gyro_filter
    assert low_pass is not None
    assert abs(low_pass.latency - 0.04) < 4 * low_pass.latency_sigma_s < 1e-4
    assert not any(one.verdict == "converged" for one in answer.conclusions[0].estimates.values())


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_wrong_delay_is_no_low_pass() -> None:
    """Where the vehicle file states neither the low-passes nor the right delay: 0 cycles for 1."""
    rng, imu = np.random.default_rng([1, 5]), anyimu.Imu(rate_hz=125.0, measures="sample", gyro_noise=1e-4, accel_noise=0.01)
    own = anyimu.bodies(rng, 1)
    flown = anyimu.fly(rng, own, imu, 0.1, 15.0, 0.1)
    used = anyimu.vehicle_of(own, 0, flown, imu, 0.1, 0.0, stated=True)
    with np.errstate(all="ignore"):
        answer = flow.examine(anyimu.log_of(flown, 0, imu, used), VehicleSource(used, "any-imu", ""))
    assert "delay-mismatch" in [notice.code for notice in answer.notices]
    assert answer.timing.delay == 0.0
    key, value = answer.mended[0].settings[0].split("=")
    assert key == "cycle.command_delay_cycles"
    assert float(value) == pytest.approx(1.0, abs=1e-3)
