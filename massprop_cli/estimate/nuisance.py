"""Square-root Kalman filter on the nuisance states: rate, biases, slowly varying torque, tilt.

It runs for all coefficients φ of :mod:`massprop_cli.model.plant` at once. The mean has a column for the log, each coefficient, each
considered assumption, and each unknown initial state. The innovations are affine in all of these, white and of unit variance (P. de Jong,
The diffuse Kalman filter, Annals of Statistics 19, 1991). Because initial states are columns, the covariance holds only process noise and
starts at zero.
"""

from __future__ import annotations

import ctypes

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.estimate.kalman import State, predict, update
from massprop_cli.kernel import call, kernel
from massprop_cli.model.system import System

CHUNK = 16
"""Steps per chunk of a motion without process noise; chunks are propagated in parallel."""


@dataclass(frozen=True)
class Whitened:
    """Whitened innovations of K cycles."""

    innovations: Array
    """(K, m, 1 + N + e + u) by column of the mean; m: rate, specific force, then the logged attitude."""
    root: Array
    """(K, m, m) lower-triangular root of their covariance."""
    states: tuple[State, ...]
    """The state after each cycle; empty where these are not kept."""


def prior_rows(sigma: Array, columns: int) -> Array:
    """(m, columns) information rows of the prior of the unknown initial states."""
    return np.diag(1 / sigma[sigma > 0]) @ np.eye(int((sigma > 0).sum()), columns)


def initial_state(sigma: Array, system: System) -> State:
    """The state in a phase's first cycle, with a column for each initial state of nonzero prior ``sigma``."""
    mean = np.zeros((len(sigma), system.measured.shape[2] + int((sigma > 0).sum())))
    mean[:, 0], mean[:, system.measured.shape[2] :] = system.initial[:, 0], system.initial[:, 1:][:, sigma > 0]
    return State(mean, np.zeros((len(sigma), len(sigma))))


def regression_rows(innovations: Array, size: int, unknowns: int) -> Array:
    """(r K, m + N + 1 + e) rows of whitened innovations (K, r, 1 + N + e + m): initial states, φ, measured value, assumptions."""
    rows = innovations.reshape(-1, innovations.shape[2])
    return np.hstack([-rows[:, -unknowns:], -rows[:, 1 : 1 + size], rows[:, :1], rows[:, 1 + size : -unknowns]])


def filtered(state: State, system: System, new: bool, every: bool = False) -> tuple[State, Whitened]:
    """Run the filter through ``system``, from the state in its first cycle; with ``new`` that cycle's measurement counts too.

    With ``every`` the states after each cycle are kept; without, the compiled kernel runs if it is available.
    """
    if system.process is None:
        return _without_process_noise(state, system, new)
    if not every and system.noise.shape[1] == 6 and kernel().library is not None:
        return _compiled(state, system, system.process, new)
    innovations, root, states = [], [], []
    unknowns = state.mean.shape[1] - system.measured.shape[2]
    # drive and measurement are zero in the columns of the unknown initial states
    drive, measured = (np.concatenate([part, np.zeros((*part.shape[:2], unknowns))], -1) for part in (system.drive, system.measured))
    for k in range(int(not new), len(measured)):
        if k > 0:
            state = predict(state, system.transition[k - 1], drive[k - 1], system.process[k - 1])
        state, innovation = update(state, measured[k], system.observation[k], system.noise[k])
        innovations.append(innovation.normalised)
        root.append(innovation.root)
        states.append(state)
    return state, Whitened(np.stack(innovations), np.stack(root), tuple(states))


def _compiled(state: State, system: System, process: Array, new: bool) -> tuple[State, Whitened]:
    """:func:`filtered` by the compiled kernel (massprop_cli/kernel/offline.c)."""
    first, (cycles, _, measured_columns), (states, columns), noises = (
        int(not new),
        system.measured.shape,
        state.mean.shape,
        process.shape[2],
    )
    sizes = np.array([cycles, first, states, measured_columns, columns - measured_columns, noises], ctypes.c_long)
    parts = (system.transition, system.drive, process, system.observation, system.measured, system.noise)
    workspace = np.empty((2 * states + 6) * columns + (6 + 2 * states) * (6 + states + noises))
    mean, root = np.array(state.mean, order="C"), np.array(state.root[:, :states], order="C")
    innovations, roots = np.empty((cycles - first, 6, columns)), np.empty((cycles - first, 6, 6))
    call(kernel().compiled.mp_host_filtered, sizes, *parts, workspace, mean, root, innovations, roots)
    return State(mean, root), Whitened(innovations, roots, ())


def _without_process_noise(state: State, system: System, new: bool) -> tuple[State, Whitened]:
    """:func:`filtered` without process noise: only the initial states are unknown, so the gain is zero."""
    measured_columns, first = system.measured.shape[2], int(not new)
    means = _propagated(state.mean, system.transition, system.drive)
    residuals = -system.observation[first:] @ means[first:]
    residuals[..., :measured_columns] += system.measured[first:]
    noise = system.noise[first:]
    return State(means[-1].copy(), state.root), Whitened(_whiten(noise, residuals), noise, ())


def _propagated(mean: Array, transition: Array, drive: Array) -> Array:
    """(K, n, c) a mean (n, c) propagated through K − 1 steps, transition (K − 1, n, n); its first g columns have drive (K − 1, n, g).

    Chunks of :data:`CHUNK` steps are accumulated in parallel, as functions of the mean that they start from, and then joined.
    """
    steps, n, driven = drive.shape
    count = -(-steps // CHUNK)
    transitions = np.zeros((count * CHUNK, n, n))
    cumulated = np.zeros((count * CHUNK, n, n + driven))
    transitions[:steps], transitions[steps:], cumulated[:steps, :, n:] = transition, np.eye(n), drive
    transitions, cumulated = transitions.reshape(count, CHUNK, n, n), cumulated.reshape(count, CHUNK, n, -1)
    cumulated[:, 0, :, :n] = transitions[:, 0]
    for k in range(1, CHUNK):
        cumulated[:, k] += transitions[:, k] @ cumulated[:, k - 1]
    means = np.empty((1 + count * CHUNK, *mean.shape))
    means[0] = mean
    for k, chunk in enumerate(cumulated):
        first = 1 + k * CHUNK
        means[first : first + CHUNK] = chunk[..., :n] @ means[first - 1]
        means[first : first + CHUNK, :, :driven] += chunk[..., n:]
    return means[: steps + 1]


def _whiten(root: Array, residuals: Array) -> Array:
    """(K, m, c) residuals divided by the root (K, m, m) of their covariance."""
    diagonal = np.einsum("kii->ki", root)
    if np.count_nonzero(root) == np.count_nonzero(diagonal):
        return np.asarray(residuals / diagonal[..., None])
    return np.linalg.solve(root, residuals)
