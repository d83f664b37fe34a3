"""The filter on the nuisances, all columns at once, against the textbook's on each column alone."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.estimate.kalman import State
from massprop_cli.estimate.nuisance import filtered, initial_state, regression_rows
from massprop_cli.model.system import System

pytestmark = pytest.mark.numerical

CYCLES, STATES, COLUMNS = 40, 6, 5
EITHER = pytest.mark.parametrize("every", [False, True], ids=["in the kernel", "in NumPy"])
"""The kernel, where there is one, keeps no state but the last."""


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
        np.eye(STATES, 1 + STATES, 1),
    )


def begun(one: System) -> State:
    return initial_state(np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.0]), one)


@pytest.mark.parametrize("new", [True, False])
@pytest.mark.parametrize("torque", [None, 1e-6, 1e-4])
@EITHER
def test_all_columns_at_once_are_each_column_alone(torque: float | None, new: bool, every: bool) -> None:
    """The textbook's covariance form, column by column."""
    one = system(torque)
    given, whitened = filtered(begun(one), one, new, every)
    for column in range(COLUMNS + 5):
        own = column < COLUMNS
        mean, covariance, white = begun(one).mean[:, column], np.zeros((STATES, STATES)), []
        for k in range(CYCLES):
            if k > 0:
                mean = one.transition[k - 1] @ mean + own * one.drive[k - 1][:, min(column, COLUMNS - 1)]
                covariance = one.transition[k - 1] @ covariance @ one.transition[k - 1].T
                if one.process is not None:
                    covariance = covariance + one.process[k - 1] @ one.process[k - 1].T
            if k > 0 or new:
                observation, noise = one.observation[k], one.noise[k] @ one.noise[k].T
                left = own * one.measured[k][:, min(column, COLUMNS - 1)] - observation @ mean
                spread = observation @ covariance @ observation.T + noise
                gain = np.linalg.solve(spread, observation @ covariance).T
                white.append(np.linalg.solve(np.linalg.cholesky(spread), left))
                mean, covariance = mean + gain @ left, covariance - gain @ spread @ gain.T
        # roots of a covariance are alike up to the signs of their columns
        signs = np.sign(np.einsum("kii->ki", whitened.root))
        np.testing.assert_allclose(whitened.innovations[..., column] * signs, np.array(white), rtol=1e-6, atol=1e-6 * np.abs(white).max())
        np.testing.assert_allclose(given.mean[:, column], mean, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(given.covariance, covariance, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("gyro", [1e-6, 1e-10])
@EITHER
def test_a_torque_far_above_the_gyro_leaves_the_gyro_s_own_variance(gyro: float, every: bool) -> None:
    """Ten orders of magnitude between process and measurement noise: the covariance stays what the measurement makes it."""
    given, _ = filtered(begun(system(1.0, gyro)), system(1.0, gyro), True, every)
    np.testing.assert_allclose(np.diag(given.covariance)[:3], gyro**2, rtol=1e-3)


@EITHER
def test_two_halves_are_the_whole(every: bool) -> None:
    one = system(1e-2)
    whole, whitened = filtered(begun(one), one, True, every)
    half, first = filtered(begun(one), one.part(0, 20), True, every)
    end, second = filtered(half, one.part(19, CYCLES), False, every)
    np.testing.assert_allclose(np.concatenate([first.innovations, second.innovations]), whitened.innovations, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(end.mean, whole.mean, rtol=1e-12)


def test_rows_are_unknowns_then_what_is_measured_then_assumptions() -> None:
    white = np.arange(6.0 * 8).reshape(1, 6, 8)  # the log's own, three coefficients, two assumptions, two beginnings
    rows = regression_rows(white, 3, 2)
    np.testing.assert_array_equal(rows[0], [-6, -7, -1, -2, -3, 0, 4, 5])
