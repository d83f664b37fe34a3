"""Filters of logged attitudes beside the gyro: the one that draws a reference to them, and one that is linear about a reference.

Both are on the rotation vector φ from the reference to the true attitude, and on the gyro's bias b less the b̂ by which the reference is
carried, through cycles of T in which the gyro turns by θ (multiplicative extended Kalman filter; Lefferts, Markley and Shuster, Journal of
Guidance, Control, and Dynamics 5, 1982):

    φ[k+1] = R(−θ) φ[k] − J(−θ) T (b − b̂) + gyro noise,      b constant but for its random walk,

J(v) the mean of the rotations R(s v), s from 0 to 1. The compiled kernel has the same (massprop_cli/kernel/attitude.c).
"""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, IntArray, median
from massprop_cli.base.dataclass import dataclass, sliced
from massprop_cli.base.quaternion import inverse, quaternion_of, quaternion_product, rotation_vector
from massprop_cli.base.rigidbody import mean_rotation, rotation, times
from massprop_cli.kernel import call, kernel

STATES = 10
"""Of :class:`LinearFilter`."""
SETTLED = 4.0
"""Times the variance that it has most of the time, up to which a reference counts as drawn to the logged attitudes."""


@dataclass(frozen=True)
class Measured:
    """Of K control cycles: the reference attitude, and what the logged attitudes in each cycle measure of its error φ."""

    attitude_wxyz: Array
    """(K + 1, 4) reference at the cycles' edges, world from body."""
    drawn_rad: Array
    """(K, 3) what turns it through each cycle in addition to the gyro's turn, body axes."""
    offset_rad: Array
    """(K, 3) φ as the cycle's logged attitudes measure it, their mean; 0 in cycles without one."""
    share: Array
    """(K,) part of the cycle that has gone by at their mean time."""
    noise_rad: Array
    """(K,) one sigma of the offset about each axis; infinite in cycles without a logged attitude."""
    known: Array
    """(K + 1, 10) the states of :class:`LinearFilter`, by the attitudes logged before each edge, ..."""
    covariance: Array
    """(K + 1, 10, 10) ... and their covariance."""

    @property
    def settled(self) -> int:
        """The cycle from which on the reference is drawn to the logged attitudes as closely as it becomes."""
        spread = np.trace(self.covariance[:, :3, :3], axis1=1, axis2=2)
        return int(np.argmax(spread <= SETTLED * median(spread)))

    def part(self, cycles: slice) -> Measured:
        """Of these cycles."""
        edges = slice(cycles.start, cycles.stop + 1)
        own = sliced(self, ("drawn_rad", "offset_rad", "share", "noise_rad"), cycles)
        return Measured(**own, **sliced(self, ("attitude_wxyz", "known", "covariance"), edges))


class GyroTurns(NamedTuple):
    """What the gyro measured, K cycles."""

    duration_s: Array
    """(K,)"""
    turns: Array
    """(K, 3) angle increments, body axes."""
    vectors: Array
    """(K, 3) rotation vectors from edge to edge."""


class Logged(NamedTuple):
    """m logged attitudes, each at the time that it is of."""

    wxyz: Array
    """(m, 4)"""
    cycle: IntArray
    """(m,) its control cycle."""
    share: Array
    """(m,) part of the cycle that has gone by."""
    uneven: Array
    """(m, 3) what the gyro has turned by then beyond that share of the cycle's turn, body axes."""


class Noise(NamedTuple):
    """One sigma of noise."""

    attitude_rad: float
    """Of a logged attitude about each axis."""
    gyro_rad: float
    """Of the gyro's turn in a cycle."""


class Given(NamedTuple):
    """What the filter takes."""

    motion: GyroTurns
    logged: Logged
    edges: IntArray
    """(K + 1,) where each cycle's logged attitudes begin."""
    variance: Array
    """(K,) of their mean."""
    noise: Noise
    bias_sigma: float
    """Of the gyro, rad/s."""
    bias_walk: float
    """Of that, rad/s in a second."""
    misalignment_sigma: float
    """rad"""


class LinearFilter(NamedTuple):
    """What a linear filter on φ, gyro bias, misalignment and latency beyond the stated one makes of it."""

    states: Array
    """(K + 1, 10) at the edges, by the attitudes logged before: rad, rad/s, rad, s."""
    covariance: Array
    """(K + 1, 10, 10)"""
    chi_square: float
    """Of the innovations."""


def filtered(given: Given, begun: Array, covariance: Array) -> tuple[Array, Array]:
    """(K + 1, 4) the reference at the edges, and (K, 3) what turns it in addition to the gyro: the filter's loop.

    From an attitude (4,) and the covariance (3, 3) of its error.
    """
    motion, logged, edges, variance, *_ = given
    count = len(motion.turns)
    spread = given.bias_sigma**2 * np.eye(6)
    spread[:3, :3] = covariance
    attitude, drawn = spill.empty(count + 1, 4), spill.empty(count, 3)
    attitude[0] = begun
    bias, white, turn = np.zeros(3), _process(given, 6), _turn(motion)
    if (library := kernel().library) is not None:
        carried = (turn, white, motion.vectors, motion.duration_s, variance, edges.astype(ctypes.c_long))
        call(library.mp_host_reference_attitude, count, *carried, logged.wxyz, logged.share, logged.uneven, spread, attitude, drawn)
        return attitude, drawn
    transition, here = _transition(turn, 6), begun
    for k in range(count):
        vector = motion.vectors[k] - bias * motion.duration_s[k]
        spread = transition[k] @ spread @ transition[k].T + white[k]
        onward, own = quaternion_of(vector), slice(edges[k], edges[k + 1])
        if edges[k] < edges[k + 1]:
            path = quaternion_product(here, quaternion_of(logged.uneven[own] + logged.share[own, None] * vector))
            residual = rotation_vector(quaternion_product(inverse(path), logged.wxyz[own])).mean(0)
            gain = spread[:, :3] @ np.linalg.inv(spread[:3, :3] + variance[k] * np.eye(3))
            moved, spread = gain @ residual, spread - gain @ spread[:3]
            spread = (spread + spread.T) / 2
            bias = bias + moved[3:]
            onward = quaternion_product(onward, quaternion_of(moved[:3]))
        drawn[k] = rotation_vector(onward) - motion.vectors[k]
        here = quaternion_product(here, onward)
        attitude[k + 1] = here = here / np.linalg.norm(here)
    return attitude, drawn


def linear(
    given: Given, about: Measured, begun: Array, sigmas: tuple[float, float, float] | None = None, at: Array | None = None
) -> LinearFilter:
    """LinearFilter about a reference that stays as it is, from its error ``at`` the beginning (3,) with the covariance ``begun`` (3, 3).

    When a share s of a cycle has gone by, its attitudes measure ``R(−θ s) φ − J s T b − J s δ + μ − ω λ``, δ what turns the reference in
    addition to the gyro. ``sigmas`` of bias, misalignment and latency; None: as stated.
    """
    turns, duration = given.motion.turns, given.motion.duration_s
    gone_s, turn = about.share * duration, turns * about.share[:, None]
    drive, partly = times(mean_rotation(-turns), about.drawn_rad), times(mean_rotation(-turn), about.drawn_rad * about.share[:, None])
    observation = np.zeros((len(turns), 3, STATES))
    observation[..., :3], observation[..., 3:6] = rotation(-turn), -mean_rotation(-turn) * gone_s[:, None, None]
    observation[..., 6:9], observation[..., 9] = np.eye(3), -turns / duration[:, None]
    white, by_turn = _process(given, STATES), _turn(given.motion)
    stated = sigmas or (given.bias_sigma, given.misalignment_sigma, 0.0)
    state, spread, chi_square = np.zeros(STATES), np.diag(np.repeat([0.0, *stated], [3, 3, 3, 1]) ** 2), 0.0
    spread[:3, :3], state[:3] = begun, 0.0 if at is None else at
    states, each = spill.empty(len(turns) + 1, STATES), spill.empty(len(turns) + 1, STATES, STATES)
    states[0], each[0] = state, spread
    if (library := kernel().library) is not None:
        arrays = (by_turn, white, drive, observation, about.offset_rad + partly, about.noise_rad, states, each)
        return LinearFilter(states, each, call(library.mp_host_reference_error, len(turns), *arrays))
    transition = _transition(by_turn, STATES)
    for k, sigma in enumerate(about.noise_rad):
        if np.isfinite(sigma):
            residual = about.offset_rad[k] + partly[k] - observation[k] @ state
            by = spread @ observation[k].T
            information = np.linalg.inv(observation[k] @ by + sigma**2 * np.eye(3))
            chi_square += float(residual @ information @ residual)
            state, spread = state + by @ information @ residual, spread - by @ information @ by.T
        state, spread = transition[k] @ state, transition[k] @ ((spread + spread.T) / 2) @ transition[k].T + white[k]
        state[:3] -= drive[k]
        states[k + 1], each[k + 1] = state, spread
    return LinearFilter(states, each, chi_square)


def _process(given: Given, states: int) -> Array:
    """(K, n, n) covariance of what gyro noise and the bias's random walk add in each cycle."""
    found = np.zeros((len(given.motion.turns), states, states))
    found[:, np.arange(3), np.arange(3)] = given.noise.gyro_rad**2
    found[:, np.arange(3, 6), np.arange(3, 6)] = (given.bias_walk**2 * given.motion.duration_s)[:, None]
    return found


def _turn(motion: GyroTurns) -> Array:
    """(K, 3, 6) what an error in attitude and in the gyro's bias becomes of that in attitude in each cycle."""
    by_bias = -mean_rotation(-motion.turns) * motion.duration_s[:, None, None]
    return np.concatenate([rotation(-motion.turns), by_bias], -1)


def _transition(turn: Array, states: int) -> Array:
    """(K, n, n) of all states."""
    found = np.tile(np.eye(states), (len(turn), 1, 1))
    found[:, :3, :6] = turn
    return found
