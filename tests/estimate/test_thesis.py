from __future__ import annotations

import numpy as np

from massprop_cli.base.rigidbody import torque_regressor
from massprop_cli.estimate import thesis
from massprop_cli.estimate.kalman import State
from massprop_cli.inputs.vehicle import Phase
from tests import flight


def test_one_step_is_the_published_recursion() -> None:
    """θ⁺ = θ + P⁺ Hᵀ R⁻¹ (u − H θ) with P⁺ = P − P Hᵀ (R + H P Hᵀ)⁻¹ H P + Q, written out in full."""
    rng = np.random.default_rng(4)
    root = np.tril(rng.standard_normal((9, 9)))
    P, theta, u = root @ root.T, rng.standard_normal(9), rng.standard_normal(3)
    H = torque_regressor(*rng.standard_normal((3, 3)))
    q, r = rng.uniform(1e-6, 1e-3, 9), 0.05
    plus = P - P @ H.T @ np.linalg.inv(r * np.eye(3) + H @ P @ H.T) @ H @ P + np.diag(q)
    expected = theta + plus @ H.T / r @ (u - H @ theta)
    state, innovation, worst = thesis.step(State(theta, root), u, H, np.diag(np.sqrt(q)), r)
    np.testing.assert_allclose(state.mean, expected, atol=1e-10)
    np.testing.assert_allclose(state.covariance, plus, atol=1e-10)
    np.testing.assert_allclose(innovation.value, u - H @ theta)
    assert abs(worst - np.linalg.eigvals(H @ plus @ H.T / r).real.max()) < 1e-9


def test_mass_sags_to_zero_while_no_force_is_commanded() -> None:
    """The limit that the thesis names: noise in a looks like acceleration without force."""
    on = flight.pulses(300, last=60)
    flown = flight.fly(flight.vehicle(), on, flight.TRUTH)
    history, _ = thesis.replay(flown.samples(np.random.default_rng(0)), slice(2, 300), Phase(name="all", start_s=0, end_s=99), flown.used)
    assert history.values[60:, 9].max() > 1.5 * history.values[-1, 9]
    assert history.values[-1, 9] < 0.8 * flight.TRUTH[9]


def test_overshooting_gain_is_warned_of() -> None:
    loose = {"thesis": {"q1": [1e-1] * 9, "r1": 1e-6}}
    flown = flight.standard("free")
    phase = Phase(name="all", start_s=0, end_s=99)
    warned, _ = thesis.replay(flown.samples(), slice(2, 60), phase, flight.vehicle(estimator=loose))
    assert [n.code for n in warned.notices] == ["thesis-gain-divergent"]
    calm, _ = thesis.replay(flown.samples(), slice(2, 60), phase, flight.vehicle())
    assert calm.notices == ()


def test_estimates_go_on_and_covariances_start_afresh_in_a_new_phase() -> None:
    flown = flight.standard("free")
    phase = Phase(name="all", start_s=0, end_s=99)
    first, filters = thesis.replay(flown.samples(), slice(2, 60), phase, flown.used)
    second, _ = thesis.replay(flown.samples(), slice(60, 120), phase, flown.used, filters)
    assert np.abs(second.values[0] - first.values[-1]).max() < 1.0
    assert (second.sigmas[0] >= first.sigmas[-1]).all()
    assert second.sigmas[0, 9] > 2 * first.sigmas[-1, 9]
