"""Causes on a fixed pedestal: of a free swing, which has no command, and of wheels that lead a fit astray."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import ABOUT_PIVOT, INERTIA, flow
from massprop_cli.base.rigidbody import rotation
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.inputs.actuators.wheel import WheelLog
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anypedestal

BODIES = 4


def flown(kind: anypedestal.Kind) -> tuple[np.random.Generator, anypedestal.Tables, anypedestal.Flown]:
    rng = np.random.default_rng(11)
    own = anypedestal.tables(rng, BODIES)
    return rng, own, anypedestal.fly(rng, own, kind, 0.05, 30.0)


def swung(body: int) -> tuple[Log, Vehicle]:
    """A table that swings by its weight, of known mass and inertia."""
    rng, own, motion = flown("swing")
    size = 0.01 * float(np.trace(own.inertia[body])) / 3
    known: dict[str, dict[str, float]] = {"mass": {"value": float(own.mass[body]), "sigma": 1e-3 * float(own.mass[body])}}
    for name, value in zip(INERTIA, own.inertia[body][np.triu_indices(3)], strict=True):
        known[name] = {"value": float(value + size * rng.normal()), "sigma": size}
    used = anypedestal.vehicle_of(own, body, motion, biases=False, **known)
    return anypedestal.log_of(rng, own, body, motion, used), used


def found(log: Log, used: Vehicle) -> Analysis:
    return flow.examine(log, VehicleSource(used, "", ""))


def named(answer: Analysis) -> list[str]:
    return [fault.notice.code for fault in answer.faults]


def test_a_gyros_scale_is_found_of_a_swing() -> None:
    log, used = swung(0)
    answer = found(replace(log, delta_theta_imu_rad=1.03 * log.delta_theta_imu_rad), used)
    assert named(answer) == ["gyro-scale"]
    cure = answer.faults[0].cure
    assert cure is not None
    assert np.diag(cure.gyro) == pytest.approx(np.full(3, 1 / 1.03), abs=1e-3)


@pytest.mark.thorough
def test_of_a_swing_a_turned_imu_or_a_tilted_beginning_is_named() -> None:
    log, used = swung(2)
    turn = rotation(np.array([[0.03, -0.01, 0.015]]))[0]
    turned = replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad @ turn.T, delta_v_imu_m_s=log.delta_v_imu_m_s @ turn.T)
    (code,) = named(found(turned, used))
    assert code in ("imu-mounting", "attitude-start")


@pytest.mark.thorough
def test_a_swing_of_which_nothing_is_known_has_no_cause() -> None:
    log, used = swung(1)
    answer = found(log, used.model_copy(update={"known": {}}))
    assert not answer.faults
    assert not answer.unknown
    assert {one.verdict for one in answer.conclusions[0].about_pivot.values()} == {"unobservable"}


def test_a_wheels_sign_is_found_where_every_fit_is_lost() -> None:
    rng, own, motion = flown("wheels")
    used = anypedestal.vehicle_of(own, 0, motion)
    log = anypedestal.log_of(rng, own, 0, motion, used)
    first, *rest = log.spinning
    assert isinstance(first, WheelLog)
    turned = WheelLog(-np.asarray(first.speed_rad_s), None, None)
    answer = found(replace(log, spinning=(turned, *rest)), used)
    assert named(answer) == ["command-sign"]
    (corrected,) = answer.mended[0].conclusions
    told = [corrected.about_pivot[name] for name in ABOUT_PIVOT]
    assert {one.verdict for one in told} == {"converged"}
    z = [((one.value or np.nan) - true) / (one.sigma or np.nan) for one, true in zip(told, own.nine[0], strict=True)]
    assert np.abs(z).max() < 4
