from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.estimate.kalman import State, predict, update

pytestmark = pytest.mark.numerical


def run(z: Array, H: Array, prior: Array, noise: float) -> list[State]:
    state = State(np.zeros(len(prior)), np.diag(prior))
    states = []
    for measured, observation in zip(z, H, strict=True):
        state, _ = update(state, measured, observation, noise * np.eye(len(measured)))
        states.append(state)
    return states


def test_recursion_equals_batch_least_squares_at_every_prefix() -> None:
    rng = np.random.default_rng(1)
    H, theta = rng.standard_normal((30, 3, 9)), rng.standard_normal(9)
    z = H @ theta + 0.1 * rng.standard_normal((30, 3))
    prior = rng.uniform(1, 5, 9)
    for k, state in enumerate(run(z, H, prior, 0.1)):
        rows, measured = H[: k + 1].reshape(-1, 9), z[: k + 1].ravel()
        information = rows.T @ rows / 0.01 + np.diag(1 / prior**2)
        np.testing.assert_allclose(state.mean, np.linalg.solve(information, rows.T @ measured / 0.01), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(state.covariance, np.linalg.inv(information), rtol=1e-8, atol=1e-9)


def test_scaling_noise_and_prior_together_changes_nothing() -> None:
    rng = np.random.default_rng(2)
    H, z = rng.standard_normal((20, 2, 4)), rng.standard_normal((20, 2))
    one, other = run(z, H, np.ones(4), 0.5)[-1], run(z, H, 10 * np.ones(4), 5.0)[-1]
    np.testing.assert_allclose(one.mean, other.mean, atol=1e-12)
    np.testing.assert_allclose(100 * one.covariance, other.covariance, rtol=1e-9)


def test_covariance_stays_positive_where_the_textbook_form_fails() -> None:
    """A prior of 1e6 against noise of 1e-5, nearly collinear rows: P − P Hᵀ S⁻¹ H P goes negative, the root form can't."""
    rng = np.random.default_rng(3)
    state = State(np.zeros(3), 1e6 * np.eye(3))
    textbook = state.covariance
    went_negative = False
    for _ in range(200):
        row = np.array([[1.0, 1.0, 1.0]]) + 1e-7 * rng.standard_normal((1, 3))
        state, _ = update(state, np.zeros(1), row, np.array([[1e-5]]))
        gain = textbook @ row.T / (row @ textbook @ row.T + 1e-10)
        textbook = textbook - gain @ row @ textbook
        went_negative |= bool(np.linalg.eigvalsh(textbook)[0] < 0)
    assert went_negative
    assert np.linalg.svd(state.root, compute_uv=False)[-1] > 0


def test_prediction_adds_process_noise() -> None:
    state = State(np.array([1.0, 2.0]), np.diag([3.0, 4.0]))
    F, G = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.0], [0.5]])
    moved = predict(state, F, np.array([0.0, 1.0]), G)
    np.testing.assert_allclose(moved.mean, [1.2, 3.0])
    np.testing.assert_allclose(moved.covariance, F @ np.diag([9.0, 16.0]) @ F.T + G @ G.T)


def test_innovation_root_is_that_of_its_covariance() -> None:
    state = State(np.zeros(2), np.array([[2.0, 0.0], [1.0, 3.0]]))
    H = np.array([[1.0, 0.5]])
    _, innovation = update(state, np.array([4.0]), H, np.array([[0.7]]))
    np.testing.assert_allclose(innovation.root @ innovation.root.T, H @ state.covariance @ H.T + 0.49)
    np.testing.assert_allclose(innovation.value, [4.0])
