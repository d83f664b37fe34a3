"""The filter on the nuisances, all columns at once, against the square-root filter on each column alone."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.kalman import State, predict, update
from massprop_cli.nuisance import Nuisances, filtered, ordered, unknown_beginnings
from massprop_cli.system import System

CYCLES, STATES, COLUMNS = 40, 6, 5


def system(torque: float | None, gyro: float = 1e-4) -> System:
    """Rates and three slow states that drive them."""
    rng = np.random.default_rng(1)
    transition = np.eye(STATES) + 0.05 * rng.standard_normal((CYCLES - 1, STATES, STATES))
    transition[:, 3:] = np.eye(STATES)[3:]
    observation = rng.standard_normal((CYCLES, 6, STATES))
    observation[:, :3] = np.eye(3, STATES)
    noise = np.zeros((CYCLES, 6, 6))
    noise[:] = np.diag([gyro] * 3 + [0.02] * 3)
    process = None if torque is None else np.tile(np.diag([torque] * 3 + [1e-3] * 3), (CYCLES - 1, 1, 1))
    return System(
        transition,
        1e-2 * rng.standard_normal((CYCLES - 1, STATES, COLUMNS)),
        process,
        observation,
        rng.standard_normal((CYCLES, 6, COLUMNS)),
        noise,
    )


def begun(one: System) -> Nuisances:
    return unknown_beginnings(np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.0]), one)


@pytest.mark.parametrize("new", [True, False])
@pytest.mark.parametrize("torque", [None, 1e-6, 1e-2, 10.0])
def test_all_columns_at_once_are_each_column_alone(torque: float | None, new: bool) -> None:
    one = system(torque)
    given, taken = filtered(begun(one), one, new)
    for column in range(COLUMNS + 5):
        own = column < COLUMNS
        state = State(begun(one).mean[:, column], np.zeros((STATES, STATES)))
        white = []
        for k in range(CYCLES):
            if k > 0:
                drive = one.drive[k - 1][:, column] if own else np.zeros(STATES)
                state = predict(state, one.transition[k - 1], drive, None if one.process is None else one.process[k - 1])
            if k > 0 or new:
                measured = one.measured[k][:, column] if own else np.zeros(6)
                state, innovation = update(state, measured, one.observation[k], one.noise[k])
                # roots of a covariance are alike up to the signs of their columns
                white.append(innovation.normalised * np.sign(np.diag(innovation.root)))
        np.testing.assert_allclose(taken.white[..., column], np.array(white), rtol=1e-7, atol=1e-7 * np.abs(white).max())
        np.testing.assert_allclose(given.mean[:, column], state.mean, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(given.covariance, state.covariance, rtol=1e-6, atol=1e-18)


def test_a_torque_far_above_the_gyro_leaves_the_gyro_s_own_variance() -> None:
    """Ten orders of magnitude between process and measurement noise: the covariance stays what the measurement makes it."""
    one = system(1.0, gyro=1e-10)
    given, _ = filtered(begun(one), one, True)
    variance = np.diag(given.covariance)
    assert (variance >= 0).all()
    np.testing.assert_allclose(variance[:3], 1e-20, rtol=1e-3)


def test_two_halves_are_the_whole() -> None:
    one = system(1e-2)
    whole, taken = filtered(begun(one), one, True)
    half, first = filtered(begun(one), one.part(0, 20), True)
    end, second = filtered(half, one.part(19, CYCLES), False)
    np.testing.assert_allclose(np.concatenate([first.white, second.white]), taken.white, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(end.mean, whole.mean, rtol=1e-12)


def test_rows_are_unknowns_then_what_is_measured_then_assumptions() -> None:
    white = np.arange(6.0 * 8).reshape(1, 6, 8)  # the log's own, three coefficients, two assumptions, two beginnings
    rows = ordered(white, 3, 2)
    np.testing.assert_array_equal(rows[0], [-6, -7, -1, -2, -3, 0, 4, 5])
