"""Commanded wrenches that are not what was given: about another point, cut off, normalised."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli import CG, INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.flow import Analysis
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import changed
from massprop_cli.testbed.simulate import SimulatedFlight
from tests import faulty
from tests.flown import PLAN, fly

Mistake = Callable[[Log, Vehicle, Array], tuple[Log, Vehicle]]
WRENCH = ("vehicle.jets=[]", "actuators.max_torque_n_m=[0.1, 0.4, 0.4]", "actuators.max_force_n=[2.0, 2.0, 2.0]")
QUIET = ("vehicle.imu.gyro_noise_rad_s=1e-5", "vehicle.imu.accel_noise_m_s2=1e-3")
ASIDE = ("truth.cg_x=0.031", "truth.cg_y=-0.022", "truth.cg_z=0.017")


def flight() -> SimulatedFlight:
    return fly("free-flyer", *PLAN, *WRENCH, *ASIDE, "vehicle.imu.accel_noise_m_s2=0.001")


def about_its_cg(log: Log, used: Vehicle, truth: Array) -> tuple[Log, Vehicle]:
    """Torques as a controller has them."""
    torque = log.command[:, :3] - np.cross(truth[6:9], log.command[:, 3:])
    return replace(log, command=np.hstack([torque, log.command[:, 3:]])), used


def saturated(log: Log, used: Vehicle, _: Array, part: float = 0.8) -> tuple[Log, Vehicle]:
    """A part of the peaks is what an allocation of 80 % left of more."""
    peaks = (np.abs(log.command) > 0.999 * np.abs(log.command).max(0)) & (np.random.default_rng(1).random(log.command.shape) < 0.4)
    return replace(log, command=np.where(peaks, log.command / part, log.command)), used


def far_beyond(log: Log, used: Vehicle, truth: Array) -> tuple[Log, Vehicle]:
    """The commands of a controller of high gain: an eighth of them acts."""
    return saturated(log, used, truth, 0.12)


def saturated_late(log: Log, used: Vehicle, truth: Array) -> tuple[Log, Vehicle]:
    """Of an unknown delay, which the peaks put astray."""
    return saturated(log, changed(used, ['cycle.command_delay_cycles="auto"']), truth, 0.7)


def saturated_a_little(log: Log, used: Vehicle, _: Array) -> tuple[Log, Vehicle]:
    """Forces alone, by a few percent at most, each by another part."""
    rng, force = np.random.default_rng(1), np.arange(6) >= 3
    peaks = (np.abs(log.command) > 0.999 * np.abs(log.command).max(0)) & (rng.random(log.command.shape) < 0.5) & force
    return replace(log, command=np.where(peaks, log.command * rng.uniform(1.0, 1.05, peaks.shape), log.command)), used


def saturated_and_later(log: Log, used: Vehicle, truth: Array) -> tuple[Log, Vehicle]:
    """A delay that is stated wrongly besides."""
    return saturated(log, changed(used, ["cycle.command_delay_cycles=2.4"]), truth)


def normalised(log: Log, used: Vehicle, _: Array) -> tuple[Log, Vehicle]:
    return replace(log, command=log.command / np.append(np.abs(log.command[:, :3]).max(0), np.ones(3))), used


@cache
def examined(mistake: Mistake) -> tuple[Analysis, Array]:
    flown = flight()
    true = flown.truth[0][0]
    return faulty.examined(*mistake(flown.log(0), flown.vehicle, true)), true


@pytest.mark.parametrize(
    ("mistake", "code", "key"),
    [
        pytest.param(about_its_cg, "wrench-point", "thrust.wrench_point_m", marks=pytest.mark.thorough),
        (saturated, "commands-limited", "thrust.wrench_limits"),
        pytest.param(far_beyond, "commands-limited", "thrust.wrench_limits", marks=pytest.mark.thorough),
        pytest.param(saturated_late, "commands-limited", "thrust.wrench_limits", marks=pytest.mark.thorough),
        (saturated_a_little, "commands-limited", "thrust.wrench_limits"),
        (normalised, "commands-normalised", ""),
    ],
)
def test_what_a_commanded_wrench_may_be_otherwise_is_named(mistake: Mistake, code: str, key: str) -> None:
    found, _ = examined(mistake)
    assert [notice.code for notice in found.notices if notice.code != "unphysical-inertia"] == [code]
    assert not any(one.verdict == "converged" for name, one in found.conclusions[0].estimates.items() if name == "mass") or key
    if key:
        assert found.mended[0].settings[0].startswith(f"{key}=")


def test_limits_are_named_beside_a_wrong_delay() -> None:
    found, _ = examined(saturated_and_later)
    assert {"commands-limited", "delay-mismatch"} <= {notice.code for notice in found.notices}
    assert dict(setting.split("=", 1) for setting in found.mended[0].settings).keys() >= {
        "thrust.wrench_limits",
        "cycle.command_delay_cycles",
    }


def test_a_limit_is_as_uncertain_as_the_log_leaves_it_and_none_is_where_none_acts() -> None:
    found, _ = examined(saturated_a_little)
    limits, uncertain = (
        json.loads(setting.partition("=")[2].replace('"thrust.wrench_limits" =', '"limits":')) for setting in found.mended[0].settings
    )
    acted, asked = (np.abs(log.command).max(0) for log in (flight().log(0), found.log))
    np.testing.assert_allclose(limits[3:], acted[3:], rtol=2e-3)
    assert (np.array(limits[:3]) >= asked[:3] * (1 - 1e-8)).all()
    for one in uncertain:
        np.testing.assert_allclose(one["limits"], limits, rtol=5e-3)


@pytest.mark.parametrize(
    "mistake",
    [
        about_its_cg,
        saturated,
        saturated_a_little,
        saturated_and_later,
        far_beyond,
        pytest.param(saturated_late, marks=pytest.mark.thorough),
    ],
)
def test_mended_by_its_key_values_are_within_their_sigmas(mistake: Mistake) -> None:
    found, true = examined(mistake)
    estimates = found.mended[0].conclusions[0].estimates
    for (name, one), value in zip(estimates.items(), true, strict=True):
        assert one.value is not None, name
        assert one.sigma is not None, name
        assert abs(one.value - value) < 4 * one.sigma, name


@pytest.mark.parametrize("records", [1, pytest.param(5, marks=pytest.mark.thorough)])
def test_a_limit_is_the_largest_that_explains_a_quiet_log(records: int) -> None:
    """Commands that are as large whenever there are any fit with any smaller limit as well, which would be a scale; and free coefficients
    tell it to half a percent only, by which a gyro of 1e-5 rad/s is contradicted."""
    flown = fly("free-flyer", *PLAN, *WRENCH, "vehicle.imu.gyro_noise_rad_s=1e-5", f"sensors.records_per_cycle={records}")
    log, used = saturated(flown.log(0), flown.vehicle, flown.truth[0][0])
    (answer,) = faulty.examined(log, used).mended
    assert answer.settings[0].startswith("thrust.wrench_limits=")
    limits = np.array(json.loads(answer.settings[0].partition("=")[2]))
    np.testing.assert_allclose(limits, np.abs(flown.log(0).command).max(0), rtol=1e-3)


def test_largest_commands_of_one_are_told_in_a_log_that_fits() -> None:
    """All components divided by the same number: that makes a smaller body move alike, but no one number normalises torques and forces."""
    same = ("vehicle.jets=[]", "actuators.max_torque_n_m=[0.4, 0.4, 0.4]", "actuators.max_force_n=[0.4, 0.4, 0.4]")
    flown = fly("free-flyer", *PLAN, *same, *ASIDE, *QUIET)
    log = flown.log(0)
    assert not faulty.examined(log, flown.vehicle).notices
    ones = replace(log, command=log.command / 0.4)
    found = faulty.examined(ones, flown.vehicle)
    (said,) = found.notices
    assert (said.code, "the log does not show their scale" in said.message) == ("commands-normalised", True)
    assert {one.verdict for one in found.conclusions[0].estimates.values()} == {"converged"}
    limited = faulty.stated(flown.vehicle, "thrust.wrench_limits=[1, 1, 1, 1, 1, 1]")
    assert not faulty.examined(ones, limited).notices


def test_forces_that_are_limited_to_one_newton_are_none_that_are_normalised() -> None:
    """Where the log tells their scale; another cause is named as of any other forces."""
    forces = ("vehicle.jets=[]", WRENCH[1], "actuators.max_force_n=[1.0, 1.0, 1.0]")
    flown = fly("free-flyer", *PLAN, *forces, *ASIDE, *QUIET)
    log = flown.log(0)
    assert set(np.abs(log.command[:, 3:]).max(0)) == {1.0}
    found = faulty.examined(log, flown.vehicle)
    assert not found.notices
    assert {one.verdict for one in found.conclusions[0].estimates.values()} == {"converged"}
    for key, code in (
        ("cycle.command_delay_cycles=2.4", "delay-mismatch"),
        (f"imu.position_m={np.add(flown.vehicle.imu.position_m, (0.02, -0.015, 0.0)).tolist()}", "imu-position"),
    ):
        assert [notice.code for notice in faulty.examined(log, faulty.stated(flown.vehicle, key)).notices] == [code]


def test_torques_over_one_number_are_no_scale_of_the_forces() -> None:
    """Which makes the same motion, and a body of another size."""
    same = ("vehicle.jets=[]", "actuators.max_torque_n_m=[0.4, 0.4, 0.4]", "actuators.max_force_n=[2.0, 2.0, 2.0]")
    flown = fly("free-flyer", *PLAN, *same, *ASIDE, *QUIET)
    log = flown.log(0)
    found = faulty.examined(replace(log, command=log.command / np.repeat([0.4, 1.0], 3)), flown.vehicle)
    assert [notice.code for notice in found.notices if notice.code != "unphysical-inertia"] == ["commands-normalised"]
    assert not {found.conclusions[0].estimates[name].verdict for name in INERTIA} & {"converged"}
    assert not found.mended


def test_a_scale_of_torques_alone_is_untold_where_no_force_is_commanded() -> None:
    plan = 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0.0, end_s=15.0}]'
    torques = ("vehicle.jets=[]", "actuators.max_torque_n_m=[0.4, 0.4, 0.4]", "actuators.max_force_n=[0.0, 0.0, 0.0]")
    flown = fly("free-flyer", "duration_s=15.0", plan, *torques)
    log = flown.log(0)
    found = faulty.examined(replace(log, command=log.command / 0.4), flown.vehicle)
    assert "commands-normalised" in {notice.code for notice in found.notices}
    assert "converged" not in {found.conclusions[0].estimates[name].verdict for name in INERTIA}


def test_largest_torques_of_one_are_told_in_a_log_that_fits_beside_forces_in_newtons() -> None:
    """On a balanced table, where nothing but the torques turns the body."""
    same = ("actuators.max_torque_n_m=[0.4, 0.4, 0.4]", "truth.cg_x=0.0", "truth.cg_y=0.0", "truth.cg_z=0.0")
    flown = fly("free-flyer", *PLAN, "vehicle.jets=[]", "actuators.max_force_n=[0.7, 0.7, 0.7]", *same)
    log = flown.log(0)
    assert "commands-normalised" not in {notice.code for notice in faulty.examined(log, flown.vehicle).notices}
    found = faulty.examined(replace(log, command=log.command / np.repeat([0.4, 1.0], 3)), flown.vehicle)
    assert "commands-normalised" in {notice.code for notice in found.notices}
    verdicts = {name: one.verdict for name, one in found.conclusions[0].estimates.items()}
    assert "converged" not in {verdicts[name] for name in (*INERTIA, *CG)}
    assert verdicts["mass"] == "converged"


@pytest.mark.thorough
def test_torques_about_the_cg_of_a_balanced_body_are_named_where_all_forces_are_along_one_line() -> None:
    """On a bearing, which stands at 30 mm from O; where the point is along y makes no torque."""
    plan = 'plan=[{motion="random", axes=["roll", "pitch", "yaw", "y"], start_s=0.0, end_s=15.0}]'
    along = ("vehicle.jets=[]", "actuators.max_torque_n_m=[0.1, 0.4, 0.4]", "actuators.max_force_n=[0.0, 2.0, 0.0]")
    centre = ("vehicle.environment.bearing_position_m=[0.031, -0.022, 0.017]", *ASIDE[:2], "truth.cg_z=0.0165")
    flown = fly("testbed", "duration_s=15.0", plan, *along, *centre)
    true = flown.truth[0][0]
    found = faulty.examined(*about_its_cg(flown.log(0), flown.vehicle, true))
    assert "commanded torques are about the CG, (31, 0, 16.5) mm from O" in found.notices[0].message
    estimates = found.mended[0].conclusions[0].estimates
    for (name, one), value in zip(estimates.items(), true, strict=True):
        assert one.verdict == "converged", name
        assert abs((one.value or 0.0) - value) < 4 * (one.sigma or 0.0), name


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_misfit_puts_no_cg_at_the_origin() -> None:
    """1 mm off it, as the log tells to 5 µm; an IMU that stands elsewhere from some moment on widens that to 4 mm."""
    flown = fly("free-flyer", *PLAN, *WRENCH, *(f"truth.cg_{axis}={c}" for axis, c in zip("xyz", (1e-3, -1e-3, 1e-3), strict=True)), *QUIET)
    log, mounting, arm = flown.log(0), np.array(flown.vehicle.imu.body_from_imu), np.array([0.02, -0.02, 0.02])
    step_s, late = log.interval_s[:, None], (np.arange(log.rows) > 0.55 * log.rows)[:, None]
    rate = log.delta_theta_imu_rad @ mounting.T / step_s
    more = np.cross(np.gradient(rate, float(step_s[0, 0]), axis=0), arm) + np.cross(rate, np.cross(rate, arm))
    log = replace(log, delta_v_imu_m_s=log.delta_v_imu_m_s + (more * step_s * late) @ mounting)
    found = faulty.examined(log, flown.vehicle)
    assert (
        {"model-discrepancy"} <= {notice.code for notice in found.notices} <= {"model-discrepancy", "cause-unknown", "accelerometer-misfit"}
    )
    for one, value in zip((found.conclusions[0].estimates[name] for name in CG), (1e-3, -1e-3, 1e-3), strict=True):
        assert abs((one.value or 0.0) - value) < 4 * (one.sigma or 0.0) < 0.02


def test_torques_about_the_cg_put_it_at_the_origin_and_that_is_said() -> None:
    """Of a log in which the accelerometer hardly tells where it is itself; where its point is stated there is nothing to be said."""
    flown = fly("free-flyer", *PLAN, *WRENCH, *ASIDE)
    log, used = about_its_cg(flown.log(0), flown.vehicle, flown.truth[0][0])
    found = faulty.examined(log, used)
    (said,) = found.notices
    assert (said.code, "the estimated CG is at O" in said.message) == ("wrench-point", True)
    verdicts = {name: one.verdict for name, one in found.conclusions[0].estimates.items()}
    assert {verdicts[name] for name in INERTIA} == {"converged"}
    assert {verdicts[name] for name in CG} == {"not_converged"}
    assert "state thrust.wrench_point_m" in str(found.conclusions[0].estimates["cg_x"].reason)
    stated = faulty.examined(log, faulty.stated(used, "thrust.wrench_point_m=[0.031, -0.022, 0.017]"))
    assert stated.notices == ()
    estimates = stated.conclusions[0].estimates.values()
    for one, value in zip(estimates, flown.truth[0][0], strict=True):
        assert one.value is not None
        assert abs(one.value - value) < 4 * (one.sigma or 0.0)


def test_a_sigma_covers_what_each_of_two_causes_gives_that_cannot_be_told_apart() -> None:
    """An IMU 23 mm out of place, or torques about another point: each explains the log, with CGs 23 mm apart."""
    flown = fly("free-flyer", *PLAN, *WRENCH, *ASIDE, "vehicle.imu.accel_noise_m_s2=0.005")
    found = faulty.examined(flown.log(0), faulty.stated(flown.vehicle, "imu.position_m=[0.1117, -0.0787, 0.1127]"))
    (said,) = [notice.message for notice in found.notices if notice.code == "imu-position"]
    assert "or else commanded torques are about" in said
    (conclusion,), (answer,) = found.conclusions, found.mended
    for values in (answer.conclusions[0].values, *(rival[0] for rival in answer.rivals), flown.truth[0][0]):
        away = np.abs(values - conclusion.values) / conclusion.sigmas
        assert away[6:9].max() < 1.01
        assert away.max() < 3
    verdicts = [one.verdict for one in conclusion.estimates.values()]
    assert verdicts == ["converged"] * 6 + ["contradicted"] * 4
