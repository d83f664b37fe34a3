"""The attitude that a biased gyro gives, without_offset of what the bias carried it off by as gravity shows it."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.quaternion import matrices
from massprop_cli.base.rigidbody import rotation
from massprop_cli.prepare.attitude import (
    BIAS_LIMIT,
    BiasInformation,
    attitude_error,
    bias_information,
    integrate_attitude,
    without_offset,
    world_up_b,
)

CYCLE, BIAS = 0.05, np.array([1.2e-3, -0.8e-3, 0.5e-3])
START = np.array([0.98, 0.1, -0.15, 0.05]) / np.linalg.norm([0.98, 0.1, -0.15, 0.05])


def flown(cycles: int = 1200) -> tuple[Array, Array, Array, Array]:
    """(K + 1, 4) true and integrated attitude, (K, 3) measured turns, and specific force over gravity's with what rotation adds."""
    rng = np.random.default_rng(1)
    time = (np.arange(cycles) + 0.5) * CYCLE
    rate = np.stack([0.2 * np.sin(0.7 * time), 0.15 * np.cos(0.5 * time), 0.03 + 0.1 * np.sin(time)], 1)
    true = integrate_attitude(START, rate * CYCLE)
    turns = (rate + BIAS) * CYCLE
    up = world_up_b(true)
    felt = (up[:-1] + up[1:]) / 2 + 0.005 * rng.normal(size=(cycles, 3)) + 0.003 * np.sin(0.7 * time)[:, None]
    return true, integrate_attitude(START, turns), turns, felt


def test_gravity_shows_the_bias_and_the_attitude_is_freed_of_it() -> None:
    """Half a minute of 1.2 mrad/s is 44 mrad off; what is left of it is a tenth, and less as the log goes on."""
    true, attitude, turns, felt = flown()
    found = bias_information(attitude, felt, np.full(len(turns), CYCLE), BiasInformation.none())
    carried, _ = without_offset(attitude, turns, found.offset(1e-3))
    before, after = (np.linalg.norm(world_up_b(own) - world_up_b(true), axis=1) for own in (attitude, carried))
    assert before[600] > 0.03
    assert after[600] < before[600] / 8
    assert after[1200] < before[1200] / 20


def test_the_bias_of_the_accelerometer_is_none_of_the_gyro() -> None:
    """30 mg, steady in body axes: taken for a tilt it makes the attitude worse than it was; beside its stated sigma it does little."""
    true, attitude, turns, felt = flown()
    found = bias_information(attitude, felt + np.array([0.03, -0.02, 0.01]), np.full(len(turns), CYCLE), BiasInformation.none())

    def left(tilted: float) -> Array:
        carried, _ = without_offset(attitude, turns, found.offset(1e-3, tilted))
        size: Array = np.linalg.norm(world_up_b(carried) - world_up_b(true), axis=1)
        return size

    before = np.linalg.norm(world_up_b(attitude) - world_up_b(true), axis=1)
    assert left(0.0)[600] > before[600] / 2
    assert left(0.03)[600] < before[600] / 8
    assert left(0.03)[1200] < before[1200] / 15


def test_what_is_freed_is_carried_by_the_turns_that_are_given() -> None:
    """Integrated once more from its own beginning, by increments that hold the corrections: the same attitude."""
    _, attitude, turns, felt = flown()
    off = bias_information(attitude, felt, np.full(len(turns), CYCLE), BiasInformation.none()).offset(1e-3)
    carried, own = without_offset(attitude, turns, off)
    again = integrate_attitude(carried[0], own)
    assert np.abs(world_up_b(again) - world_up_b(carried)).max() < 2e-5
    assert np.abs(own - turns).max() > 1e-5


def test_where_the_attitude_may_be_is_what_the_bias_made_of_it() -> None:
    """At every edge the known part and the bias' own lead from the without_offset attitude to the true one, to the second order."""
    true, attitude, turns, felt = flown(400)
    found = bias_information(attitude, felt, np.full(len(turns), CYCLE), BiasInformation.none())
    off = found.offset(1e-3)
    by = attitude_error(attitude, off, found)
    carried, _ = without_offset(attitude, turns, off)
    turn = by[..., 0] + by[..., 1:] @ BIAS
    lead = matrices(carried) @ rotation(turn)
    apart = np.abs(lead - matrices(true)).max((1, 2))
    assert apart.max() < 2e-4
    assert np.linalg.norm(turn, axis=1).max() > 5e-3


def test_parts_give_what_the_whole_gives() -> None:
    _, attitude, turns, felt = flown()
    lasting = np.full(len(turns), CYCLE)
    whole = bias_information(attitude, felt, lasting, BiasInformation.none())
    first = bias_information(attitude[:501], felt[:500], lasting[:500], BiasInformation.none())
    rest = bias_information(attitude[500:], felt[500:], lasting[500:], first.at(-1))
    for own, one, other in zip(whole, first, rest, strict=True):
        np.testing.assert_array_equal(own, np.concatenate([one, other[1:]]))


@pytest.mark.parametrize("turned", [np.diag([1.0, -1.0, -1.0]), np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]), 9.8 * np.eye(3)])
def test_an_accelerometer_that_is_turned_or_in_other_units_is_no_bias(turned: Array) -> None:
    """However wrong it is, the attitude goes no farther than three sigmas of the bias would carry it."""
    _, attitude, turns, felt = flown()
    off = bias_information(attitude, felt @ turned.T, np.full(len(turns), CYCLE), BiasInformation.none()).offset(1e-4)
    assert (np.linalg.norm(off, axis=1) <= BIAS_LIMIT * 1e-4 * CYCLE * np.arange(len(off)) + 1e-12).all()


def test_what_is_not_felt_tells_nothing() -> None:
    _, attitude, turns, felt = flown()
    found = bias_information(attitude, np.zeros_like(felt), np.full(len(turns), CYCLE), BiasInformation.none())
    assert not found.offset(1e-3).any()
