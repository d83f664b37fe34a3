"""Square-root Kalman filter, in two pure functions.

The covariance is P = S Sᵀ, with S from an orthogonal (QR) factorisation. It stays positive semi-definite at any condition number
(Kaminski, Bryson, Schmidt 1971). The state x has n entries, a measurement z has m.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of


class State(NamedTuple):
    """Mean x, (n,), and square root S of the covariance, (n, n), or wider after a prediction with process noise.

    The recursion is linear in the mean. A mean of shape (n, c) propagates c columns at once, with drive (n, c) and measurements z (m, c).
    """

    mean: Array
    root: Array

    @property
    def covariance(self) -> Array:
        """P = S Sᵀ, shape (n, n)."""
        return self.root @ self.root.T


class Innovation(NamedTuple):
    """Innovation z − H x."""

    normalised: Array
    """(m,) or (m, c) whitened: independent standard normal if the model holds."""
    root: Array
    """(m, m) lower-triangular root of its covariance H P Hᵀ + R."""

    @property
    def value(self) -> Array:
        """(m,) or (m, c) z − H x."""
        return self.root @ self.normalised


def predict(state: State, transition: Array, drive: Array, noise_root: Array | None) -> State:
    """Predict the next state: x ← F x + u, P ← F P Fᵀ + G Gᵀ; ``noise_root`` G has shape (n, q).

    The root becomes [F S, G], which is q columns wider. The next update makes it square again, so a cycle costs one factorisation.
    """
    mean = transition @ state.mean + drive
    root: Array = transition @ state.root
    return State(mean, root if noise_root is None else np.hstack([root, noise_root]))


def update(state: State, measured: Array, observation: Array, noise_root: Array) -> tuple[State, Innovation]:
    """Condition on z = H x + v, v ~ N(0, V Vᵀ), with H ``observation`` (m, n) and V ``noise_root`` (m, m).

    Array form: one QR factorisation turns [[V, H S], [0, S]] into [[root of H P Hᵀ + R, 0], [gain × root, updated S]].
    """
    m, n = observation.shape
    joint = np.zeros((m + n, m + state.root.shape[1]))
    joint[:m, :m] = noise_root
    joint[:m, m:] = observation @ state.root
    joint[m:, m:] = state.root
    lower = _triangle(joint)
    innovation = Innovation(np.linalg.solve(lower[:m, :m], measured - observation @ state.mean), lower[:m, :m])
    return State(state.mean + lower[m:, :m] @ innovation.normalised, lower[m:, m:]), innovation


def _triangle(wide: Array) -> Array:
    """Lower-triangular T with a positive diagonal and T Tᵀ = A Aᵀ; A has at least as many columns as rows."""
    lower = triangle_of(wide.T).T
    return lower * np.where(np.diagonal(lower) < 0, -1.0, 1.0)
