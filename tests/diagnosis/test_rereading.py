"""Columns of rotors that are read otherwise: which rotor a column is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis import rereading
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.actuators import channel_wrench
from massprop_cli.prepare.align import impulses
from tests import anypedestal, anyrotors


def logged(seed: int, cycles: int) -> tuple[Log, Resolved]:
    """A multicopter's log, and its vehicle."""
    rng = np.random.default_rng(seed)
    own = anyrotors.multicopters(rng, 1)
    flown = anyrotors.fly(rng, own, 0.02, cycles)
    vehicle = Resolved.stated(anyrotors.vehicle_of(own, 0, flown))
    assert vehicle is not None
    return anypedestal.log_of(rng, own, 0, flown, vehicle), vehicle


def answered(log: Log, vehicle: Resolved) -> tuple[Array, Array]:
    """Each column's answer, and its sigmas."""
    timing = stated_timing(vehicle)
    made = impulses(log, vehicle, timing.delay, timing.lag_s(vehicle))
    phase = Phase(name="all", start_s=0.0, end_s=1.0)
    return rereading._responses(rereading._Case(log, vehicle, timing, (phase, slice(20, 290)), made))


@pytest.mark.thorough
def test_a_rotors_own_answer_tells_which_column_is_its() -> None:
    """Of 720 orders the right one leaves least by far, whatever the body is."""
    log, vehicle = logged(1, 300)
    wired = [3, 0, 2, 1, 5, 4]  # column i is what rotor wired[i] does
    log = replace(log, command=log.command[:, wired])
    answers = answered(log, vehicle)
    orders = rereading._orders(6)
    left = rereading._order_costs(*answers, np.array(vehicle.imu.position_m), channel_wrench(log, vehicle), orders)
    first, second = np.sort(left)[:2]
    assert orders[int(np.argmin(left))].tolist() == wired
    assert second > 20 * first
    assert orders[int(np.argmin(left))].tolist() != list(range(6))


@pytest.mark.thorough
def test_a_rotor_whose_momentum_counts_answers_by_its_thrust() -> None:
    """Beside its thrust each speed then has a column of stored momentum, which is no rotor's."""
    rng = np.random.default_rng(1)
    own = anyrotors.multicopters(rng, 1)
    flown = anyrotors.fly(rng, own, 0.02, 300, measured=True)
    stated = Resolved.stated(anyrotors.vehicle_of(own, 0, flown))
    assert stated is not None
    for spin, count in ((None, 6), (1e-9, 12)):
        momentum = {"spin_inertia_kg_m2": spin}
        vehicle = stated.model_copy(update={"rotors": tuple(one.model_copy(update=momentum) for one in stated.rotors)})
        log = anypedestal.log_of(np.random.default_rng(2), own, 0, flown, vehicle)
        answers = answered(log, vehicle)
        assert len(answers[0]) == count
        orders, wrench = rereading._orders(6), channel_wrench(log, vehicle)[:6]
        best = orders[int(np.argmin(rereading._order_costs(*answers, np.array(vehicle.imu.position_m), wrench, orders)))]
        assert best.tolist() == list(range(6))


def test_no_unit_of_a_sensor_that_is_absent_is_supposed() -> None:
    """Its zeros fit with any unit: a log of a gyro alone was told to have its accelerometer in g."""
    log, _ = logged(1, 60)
    both = {reading.words for reading in rereading._other_units(log)}
    alone = {reading.words for reading in rereading._other_units(replace(log, axes=(True,) * 3 + (False,) * 3))}
    assert alone == {words for words in both if "accelerometer" not in words}
    assert any(words.startswith("its gyro columns are in degrees") for words in alone)
    yaw = {reading.words for reading in rereading._other_units(replace(log, axes=(False, False, True) + (False,) * 3))}
    assert {words.partition(";")[0] for words in yaw} == {"its gyro columns of z are in degrees, not radians"}


@pytest.mark.seeds
@pytest.mark.thorough
def test_rotors_that_are_permuted_are_named() -> None:
    log, vehicle = logged(3, 600)
    wired = [1, 0, 2, 3, 4, 5]
    with np.errstate(all="ignore"):
        found = flow.examine(replace(log, command=log.command[:, wired]), VehicleSource(vehicle, "", ""))
    assert "actuators-swapped" in [notice.code for notice in found.notices]
    assert found.mended[0].settings[:2] == (
        'columns.rotor_r0_command={ from = "rotor_r1_command", scale = 1 }',
        'columns.rotor_r1_command={ from = "rotor_r0_command", scale = 1 }',
    )
