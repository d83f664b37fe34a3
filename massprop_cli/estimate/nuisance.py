"""Square-root Kalman filter on the nuisance states: rate, biases, slow torques, tilt.

It runs for all coefficients φ of :mod:`massprop_cli.model.plant` at once. Its mean has a column for the log itself, for each coefficient,
for each assumption considered, and for each state's own unknown beginning; so its innovations are affine in all of these, white and of unit
variance (P. de Jong, The diffuse Kalman filter, Annals of Statistics 19, 1991). Since beginnings are columns, the covariance holds
only what the process noise adds, and starts at zero.
"""

from __future__ import annotations

import ctypes

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.estimate.kalman import State, predict, update
from massprop_cli.kernel import call, kernel
from massprop_cli.model.system import System

STRETCH = 16
"""Steps that a known motion is carried through at a time."""


@dataclass(frozen=True)
class Taken:
    """What K cycles brought."""

    white: Array
    """(K, m, 1 + N + e + u) whitened innovations, a column for each of the state's: of rate, force, then a logged attitude."""
    root: Array
    """(K, m, m) their lower-triangular root."""
    states: tuple[State, ...]
    """After each cycle, where they are kept."""


def known_rows(sigma: Array, columns: int) -> Array:
    """(m, columns) rows that say what is known of the states' beginnings."""
    return np.diag(1 / sigma[sigma > 0]) @ np.eye(int((sigma > 0).sum()), columns)


def unknown_beginnings(sigma: Array, system: System) -> State:
    """The states in a phase's first cycle: what is unknown of them is a column of its own."""
    mean = np.zeros((len(sigma), system.measured.shape[2] + int((sigma > 0).sum())))
    mean[:, 0], mean[:, system.measured.shape[2] :] = system.initial[:, 0], system.initial[:, 1:][:, sigma > 0]
    return State(mean, np.zeros((len(sigma), len(sigma))))


def ordered(white: Array, size: int, free: int) -> Array:
    """Whitened innovations (K, r, 1 + N + e + m) as rows (r K, m + N + 1 + e) of unknowns, then what is measured, then assumptions."""
    rows = white.reshape(-1, white.shape[2])
    return np.hstack([-rows[:, -free:], -rows[:, 1 : 1 + size], rows[:, :1], rows[:, 1 + size : -free]])


def filtered(state: State, system: System, new: bool, every: bool = False) -> tuple[State, Taken]:
    """The filter through a system, from the state in its first cycle; that is measured too where it is ``new``.

    With ``every`` the states after each cycle are kept; else the compiled kernel runs where there is one.
    """
    if system.process is None:
        return _known_motion(state, system, new)
    if not every and system.noise.shape[1] == 6 and kernel().library is not None:
        return _compiled(state, system, system.process, new)
    white, root, states = [], [], []
    own = state.mean.shape[1] - system.measured.shape[2]
    # nothing drives or measures the columns of the unknown beginnings
    drive, measured = (np.concatenate([part, np.zeros((*part.shape[:2], own))], -1) for part in (system.drive, system.measured))
    for k in range(int(not new), len(measured)):
        if k > 0:
            state = predict(state, system.transition[k - 1], drive[k - 1], system.process[k - 1])
        state, innovation = update(state, measured[k], system.observation[k], system.noise[k])
        white.append(innovation.normalised)
        root.append(innovation.root)
        states.append(state)
    return state, Taken(np.stack(white), np.stack(root), tuple(states))


def _compiled(state: State, system: System, process: Array, new: bool) -> tuple[State, Taken]:
    """The same in the kernel (massprop_cli/kernel/offline.c)."""
    first, (cycles, _, given), (states, columns), noises = int(not new), system.measured.shape, state.mean.shape, process.shape[2]
    sizes = np.array([cycles, first, states, given, columns - given, noises], ctypes.c_long)
    parts = (system.transition, system.drive, process, system.observation, system.measured, system.noise)
    room = np.empty((2 * states + 6) * columns + (6 + 2 * states) * (6 + states + noises))
    mean, root = np.array(state.mean, order="C"), np.array(state.root[:, :states], order="C")
    white, roots = np.empty((cycles - first, 6, columns)), np.empty((cycles - first, 6, 6))
    call(kernel().compiled.mp_host_filtered, sizes, *parts, room, mean, root, white, roots)
    return State(mean, root), Taken(white, roots, ())


def _known_motion(state: State, system: System, new: bool) -> tuple[State, Taken]:
    """The same where nothing is uncertain but the beginnings, which are columns: nothing is gained on the way."""
    given, first = system.measured.shape[2], int(not new)
    means = _carried(state.mean, system.transition, system.drive)
    left = -system.observation[first:] @ means[first:]
    left[..., :given] += system.measured[first:]
    noise = system.noise[first:]
    return State(means[-1].copy(), state.root), Taken(_whitened(noise, left), noise, ())


def _carried(mean: Array, transition: Array, drive: Array) -> Array:
    """(K, n, c) a mean carried through steps (K − 1, n, n), driven (K − 1, n, g) in its first columns.

    Stretches of :data:`STRETCH` steps side by side, each from nothing on, with what it makes of where it begins; then one after the other.
    """
    steps, n, given = drive.shape
    count = -(-steps // STRETCH)
    turn = np.zeros((count * STRETCH, n, n))
    push = np.zeros((count * STRETCH, n, n + given))
    turn[:steps], turn[steps:], push[:steps, :, n:] = transition, np.eye(n), drive
    turn, push = turn.reshape(count, STRETCH, n, n), push.reshape(count, STRETCH, n, -1)
    push[:, 0, :, :n] = turn[:, 0]
    for k in range(1, STRETCH):
        push[:, k] += turn[:, k] @ push[:, k - 1]
    found = np.empty((1 + count * STRETCH, *mean.shape))
    found[0] = mean
    for k, stretch in enumerate(push):
        first = 1 + k * STRETCH
        found[first : first + STRETCH] = stretch[..., :n] @ found[first - 1]
        found[first : first + STRETCH, :, :given] += stretch[..., n:]
    return found[: steps + 1]


def _whitened(root: Array, left: Array) -> Array:
    """(K, m, c) what is left (K, m, c), over the root (K, m, m) of its noise."""
    own = np.einsum("kii->ki", root)
    if np.count_nonzero(root) == np.count_nonzero(own):
        return np.asarray(left / own[..., None])
    return np.linalg.solve(root, left)
