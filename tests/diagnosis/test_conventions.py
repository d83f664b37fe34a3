"""Mistakes that go together: degrees with g, a whole convention of axes, all torques in another unit than forces."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array, frozen
from massprop_cli.diagnosis import explanation
from massprop_cli.diagnosis.corrections import Correction
from massprop_cli.flow import Analysis
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight
from tests import faulty
from tests.flown import PLAN

WRENCH = ("vehicle.jets=[]", "actuators.max_torque_n_m=[0.1, 0.4, 0.4]", "actuators.max_force_n=[2.0, 2.0, 2.0]")
DEGREE, GRAVITY = np.pi / 180, 9.80665


@cache
def flown() -> SimulatedFlight:
    return simulate.fly(scenario.load("free-flyer", (*PLAN, *WRENCH)), [3])


def commanding(factors: Array) -> tuple[Analysis, set[str], str]:
    """The log with commands times factors (6,): analysis, codes, and the first cause's message."""
    log = flown().log(0)
    found = faulty.examined(replace(log, command=frozen(log.command * factors)), flown().vehicle)
    return found, {notice.code for notice in found.notices}, " ".join(fault.notice.message for fault in found.faults)


@pytest.mark.parametrize("about", [0, pytest.param(1, marks=pytest.mark.thorough), pytest.param(2, marks=pytest.mark.thorough)])
def test_commands_in_another_convention_are_named_with_their_four_components(about: int) -> None:
    """Forward-right-down for forward-left-up is a half turn about X: Y and Z of torques and forces change their sign."""
    signs = np.tile(np.where(np.arange(3) == about, 1.0, -1.0), 2)
    found, named, message = commanding(signs)
    assert "command-sign" in named
    for axis, letter in enumerate("xyz"):
        assert (f"cmd_torque_{letter}_n_m" in message) == (f"cmd_force_{letter}_n" in message) == (axis != about)
    (fault,) = found.faults
    assert fault.cure is not None
    assert fault.cure.command == tuple(signs)


@pytest.mark.thorough
def test_degrees_and_g_are_named_together() -> None:
    log = flown().log(0)
    shown = replace(
        log, delta_theta_imu_rad=frozen(log.delta_theta_imu_rad / DEGREE), delta_v_imu_m_s=frozen(log.delta_v_imu_m_s / GRAVITY)
    )
    found = faulty.examined(shown, flown().vehicle)
    (fault,) = found.faults
    assert fault.notice.code == "gyro-units"
    assert "gyro columns are in degrees, not radians, and accelerometer columns in g" in fault.notice.message
    np.testing.assert_allclose(np.diag(fault.cure.gyro if fault.cure else np.eye(3)), DEGREE)
    np.testing.assert_allclose(np.diag(fault.cure.accelerometer if fault.cure else np.eye(3)), GRAVITY)


@pytest.mark.thorough
def test_torques_in_another_unit_than_forces_leave_neither_inertia_nor_mass() -> None:
    """The motion tells their ratio alone: as well the forces are a thousandth, and the body a thousand times as large."""
    found, named, message = commanding(np.repeat([1000.0, 1.0], 3))
    assert "thrust-scale" in named
    assert "or of the others" in message
    verdicts = faulty.verdicts(found)
    assert {verdicts[name] for name in (*INERTIA, "mass")} <= {"contradicted", "not_converged", "not_excited", "unobservable"}


@pytest.mark.parametrize(("factor", "others"), [(1000.0, [1e-3]), (-1000.0, [-1e-3]), (1.5, []), (-1.0, []), (0.0, [])])
def test_only_another_unit_may_as_well_be_that_of_the_others(factor: float, others: list[float]) -> None:
    """Neither a scale, nor a sign, nor torques that do nothing."""
    instead = [*explanation._other_half(Correction((), command=(*[factor] * 3, 1.0, 1.0, 1.0)))]
    assert [one.command for one in instead] == [(1.0, 1.0, 1.0, *[other] * 3) for other in others]


@pytest.mark.thorough
@pytest.mark.seeds
def test_beside_a_unit_a_tilted_imu_is_named_by_its_own_angle_and_mended_by_its_key() -> None:
    log, used = flown().log(0), flown().vehicle
    tilt, true = np.radians(12.0), np.array(used.imu.body_from_imu)
    turned = np.array([[np.cos(tilt), -np.sin(tilt), 0.0], [np.sin(tilt), np.cos(tilt), 0.0], [0.0, 0.0, 1.0]]) @ true
    stated = faulty.stated(used, f"imu.body_from_imu={turned.tolist()}")
    found = faulty.examined(replace(log, delta_theta_imu_rad=frozen(log.delta_theta_imu_rad / DEGREE)), stated)
    assert {"gyro-units", "imu-mounting"} == {fault.notice.code for fault in found.faults}
    assert all("12 degrees away" in fault.notice.message for fault in found.faults)
    cure = found.faults[0].cure
    assert cure is not None
    (said,) = (setting for setting in cure.settings if setting.startswith("imu.body_from_imu="))
    np.testing.assert_allclose(json.loads(said.partition("=")[2]), true, atol=2e-3)
    np.testing.assert_allclose(cure.gyro, DEGREE * np.eye(3), atol=1e-9)


@pytest.mark.parametrize("unit_m", [0.01, pytest.param(0.0254, marks=pytest.mark.thorough), pytest.param(1e-3, marks=pytest.mark.thorough)])
def test_an_imus_position_in_another_unit_is_no_scale_of_its_sensors(unit_m: float) -> None:
    """Centimetres in place of metres put it tens of metres away: far beyond what is looked for from there."""
    true_m = np.array(flown().vehicle.imu.position_m)
    stated = faulty.stated(flown().vehicle, f"imu.position_m={(true_m / unit_m).tolist()}")
    found = faulty.examined(flown().log(0), stated)
    assert {fault.notice.code for fault in found.faults} == {"imu-position"}
    key, value = found.mended[0].settings[0].split("=")
    assert key == "imu.position_m"
    np.testing.assert_allclose(json.loads(value), true_m, atol=0.01)
