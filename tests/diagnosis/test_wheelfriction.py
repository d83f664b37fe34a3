"""Friction of wheels whose torque is logged, by a simulator that takes it in parts of a cycle."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.diagnosis import wheelfriction
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import motion_of
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.errorparameters.setup import stating
from massprop_cli.model.resolved import Resolved
from tests import faulty
from tests.flown import fly


@pytest.mark.parametrize("name", ["wheels-and-jets", pytest.param("wheels", marks=[pytest.mark.thorough, pytest.mark.seeds])])
@pytest.mark.parametrize(
    "friction",
    [("coulomb_friction_n_m", 5e-4), pytest.param(("viscous_friction_n_m_s", 1e-5), marks=[pytest.mark.thorough, pytest.mark.seeds])],
)
def test_friction_of_wheels_is_found_by_what_their_torque_does_to_the_rate(name: str, friction: tuple[str, float]) -> None:
    key, true = friction
    by_torque = [f'vehicle.wheels.{n}.column="torque"' for n in range(3)]
    flight = fly(name, *by_torque, *(f"vehicle.wheels.{n}.{key}={true}" for n in range(3)))
    log = flight.log(0)

    def stated(value: float) -> Case:
        used = Resolved.stated(faulty.stated(flight.vehicle, *(f"wheels.{n}.{key}={value}" for n in range(3))))
        assert used is not None
        return Case(log, used, stated_timing(used))

    case, right = stated(0.0), stated(true)
    (found,) = wheelfriction.friction_hypotheses(case, motion_of(case.timing.of(log, case.vehicle)))
    corrected = stating(case.vehicle, found.key_values).wheels
    for wheel in corrected:  # Coulomb and viscous friction are told apart where the speed changes: what both give at 200 rad/s
        both = wheel.coulomb_friction_n_m + 200 * wheel.viscous_friction_n_m_s
        assert both == pytest.approx(true * (1 if key == "coulomb_friction_n_m" else 200), rel=0.15)
    assert not wheelfriction.friction_hypotheses(right, motion_of(right.timing.of(log, right.vehicle)))


@pytest.mark.seeds
@pytest.mark.thorough
def test_friction_of_wheels_is_named_and_corrected() -> None:
    by_torque = [f'vehicle.wheels.{n}.column="torque"' for n in range(3)]
    flight = fly("wheels", *by_torque, *(f"vehicle.wheels.{n}.coulomb_friction_n_m=5e-4" for n in range(3)))
    found = faulty.examined(flight.log(0), faulty.stated(flight.vehicle, *(f"wheels.{n}.coulomb_friction_n_m=0.0" for n in range(3))))
    assert [notice.code for notice in found.notices] == ["wheel-friction"]
    (answer,) = found.mended
    z = (answer.conclusions[0].values - flight.truth[0][0])[:9] / np.sqrt(np.diag(answer.conclusions[0].covariance))[:9]
    assert np.abs(z).max() < 4  # nothing pushes, so that mass can't be told


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_log_too_short_to_tell_has_none() -> None:
    flight = fly("wheels-and-jets", "vehicle.wheels.0.coulomb_friction_n_m=5e-4")
    used = Resolved.stated(faulty.stated(flight.vehicle, "wheels.0.coulomb_friction_n_m=0.0"))
    assert used is not None
    case = Case(flight.log(0), used, stated_timing(used))
    short = case._replace(timing=case.timing._replace(delay=float(case.log.cycles - 40)))
    assert wheelfriction.friction_hypotheses(short, motion_of(case.timing.of(case.log, used))) == []
