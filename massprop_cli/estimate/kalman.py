"""A square-root Kalman filter in two pure functions.

The covariance is carried as P = S Sᵀ with S from an orthogonal (QR) factorisation, so it can't lose positive semi-definiteness
whatever the conditioning (Kaminski, Bryson, Schmidt 1971). State x has n entries, a measurement z has m.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of


class State(NamedTuple):
    """Mean x, shape (n,), and square root S of the covariance, shape (n, n), or wider after a prediction with noise.

    The recursion is linear in the mean, so a mean of shape (n, c) carries c columns through it at once, each driven and measured on its
    own (drive (n, c), z (m, c)).
    """

    mean: Array
    root: Array

    @property
    def covariance(self) -> Array:
        """P = S Sᵀ, shape (n, n)."""
        return self.root @ self.root.T


class Innovation(NamedTuple):
    """z − H x: whitened, shape (m,) or (m, c), and the lower-triangular root of its covariance H P Hᵀ + R, shape (m, m)."""

    normalised: Array
    """Independent standard normal if the model holds."""
    root: Array

    @property
    def value(self) -> Array:
        """Z − H x itself."""
        return self.root @ self.normalised


def predict(state: State, transition: Array, drive: Array, noise_root: Array | None) -> State:
    """X ← F x + u, P ← F P Fᵀ + G Gᵀ; ``noise_root`` G has shape (n, q).

    The root becomes [F S, G], q columns wider; the next update makes it square again, so that a cycle costs one factorisation.
    """
    mean = transition @ state.mean + drive
    root: Array = transition @ state.root
    return State(mean, root if noise_root is None else np.hstack([root, noise_root]))


def update(state: State, measured: Array, observation: Array, noise_root: Array) -> tuple[State, Innovation]:
    """Condition on z = H x + v, v ~ N(0, V Vᵀ), with H ``observation`` (m, n) and V ``noise_root`` (m, m).

    The array form: one QR turns [[V, H S], [0, S]] into [[root of H P Hᵀ + R, 0], [gain × root, updated S]].
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
    """The lower-triangular T with a positive diagonal and T Tᵀ = A Aᵀ, A with at least as many columns as rows."""
    lower = triangle_of(wide.T).T
    return lower * np.where(np.diagonal(lower) < 0, -1.0, 1.0)
