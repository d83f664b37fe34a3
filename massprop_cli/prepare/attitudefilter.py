"""Kalman filters of logged attitudes and gyro: one computes a reference attitude, the other is linear about a reference.

Both estimate the rotation vector φ from the reference to the true attitude and the gyro bias b. b̂ is the bias estimate that propagates the
reference. In a cycle of length T the gyro turns by θ (multiplicative extended Kalman filter; Lefferts, Markley and Shuster, Journal of
Guidance, Control, and Dynamics 5, 1982):

    φ[k+1] = R(−θ) φ[k] − J(−θ) T (b − b̂) + gyro noise,      b a constant plus a random walk,

J(v) the mean of the rotations R(s v), s from 0 to 1. massprop_cli/kernel/attitude.c is the compiled version.
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
"""Number of states of :class:`LinearFilter`."""
SETTLED = 4.0
"""The reference counts as converged once its error variance is below this multiple of the log's median variance."""


@dataclass(frozen=True)
class ReferenceAttitude:
    """Reference attitude of K control cycles, and measurements of its error φ by the logged attitudes of each cycle."""

    attitude_wxyz: Array
    """(K + 1, 4) reference at the cycle edges, world from body."""
    correction_rad: Array
    """(K, 3) rotation of the reference through each cycle in addition to the gyro's, body axes, rad."""
    offset_rad: Array
    """(K, 3) mean of φ as measured by the cycle's logged attitudes, rad; 0 in cycles without one."""
    share: Array
    """(K,) elapsed fraction of the cycle at the mean time of its logged attitudes."""
    noise_rad: Array
    """(K,) sigma of the offset about each axis, rad; infinite in cycles without a logged attitude."""
    known: Array
    """(K + 1, 10) states of :class:`LinearFilter` from the attitudes logged before each edge."""
    covariance: Array
    """(K + 1, 10, 10) covariance of these states."""

    @property
    def settled(self) -> int:
        """First cycle in which the filter has converged (:data:`SETTLED`)."""
        spread = np.trace(self.covariance[:, :3, :3], axis1=1, axis2=2)
        return int(np.argmax(spread <= SETTLED * median(spread)))

    def part(self, cycles: slice) -> ReferenceAttitude:
        """Reference attitude and measurements of the given cycles."""
        edges = slice(cycles.start, cycles.stop + 1)
        per_cycle = sliced(self, ("correction_rad", "offset_rad", "share", "noise_rad"), cycles)
        return ReferenceAttitude(**per_cycle, **sliced(self, ("attitude_wxyz", "known", "covariance"), edges))


class GyroTurns(NamedTuple):
    """Angle increments of the gyro in K cycles."""

    duration_s: Array
    """(K,) length of each cycle, s."""
    turns: Array
    """(K, 3) angle increments, body axes, rad."""
    vectors: Array
    """(K, 3) rotation vectors from edge to edge, rad."""


class LoggedAttitudes(NamedTuple):
    """m logged attitudes, with latency removed from their times."""

    wxyz: Array
    """(m, 4) attitude, world from body."""
    cycle: IntArray
    """(m,) control cycle that contains its time."""
    share: Array
    """(m,) elapsed fraction of that cycle."""
    excess_turn: Array
    """(m, 3) gyro angle so far in the cycle less ``share`` of the cycle's angle, body axes, rad."""


class Noise(NamedTuple):
    """Noise sigmas of logged attitude and gyro."""

    attitude_rad: float
    """Sigma of a logged attitude about each axis, rad."""
    gyro_rad: float
    """Sigma of the gyro's angle increment over a cycle, rad."""


class FilterInput(NamedTuple):
    """Measurements and noise levels for both filters."""

    motion: GyroTurns
    logged: LoggedAttitudes
    edges: IntArray
    """(K + 1,) index of the first logged attitude of each cycle."""
    variance: Array
    """(K,) variance of the mean of each cycle's logged attitudes, rad²."""
    noise: Noise
    bias_sigma: float
    """Prior sigma of the gyro bias, rad/s."""
    bias_walk: float
    """Random walk of the gyro bias, rad/s/√s."""
    misalignment_sigma: float
    """Prior sigma of the misalignment between attitude axes and body axes, rad."""


class LinearFilter(NamedTuple):
    """Estimates of φ, gyro bias, misalignment and additional latency by a linear Kalman filter."""

    states: Array
    """(K + 1, 10) one-step predictions at the edges: φ [rad], bias [rad/s], misalignment [rad], latency beyond the stated one [s]."""
    covariance: Array
    """(K + 1, 10, 10) covariance of the states."""
    chi_square: float
    """Sum of squared normalised innovations."""


def filtered_reference(inputs: FilterInput, initial: Array, covariance: Array) -> tuple[Array, Array]:
    """Reference attitude (K + 1, 4) at the edges, and its rotation (K, 3) in addition to the gyro's, by a multiplicative Kalman filter.

    ``initial``: (4,) initial attitude. ``covariance``: (3, 3) covariance of its error.
    """
    motion, logged, edges, variance, *_ = inputs
    count = len(motion.turns)
    P = inputs.bias_sigma**2 * np.eye(6)
    P[:3, :3] = covariance
    attitude, correction = spill.empty(count + 1, 4), spill.empty(count, 3)
    attitude[0] = initial
    bias, Q, attitude_rows = np.zeros(3), _process_noise(inputs, 6), _attitude_transition(motion)
    if (library := kernel().library) is not None:
        model = (attitude_rows, Q, motion.vectors, motion.duration_s, variance, edges.astype(ctypes.c_long))
        measurements = (logged.wxyz, logged.share, logged.excess_turn)
        call(library.mp_host_reference_attitude, count, *model, *measurements, P, attitude, correction)
        return attitude, correction
    transition, here = _transition(attitude_rows, 6), initial
    for k in range(count):
        vector = motion.vectors[k] - bias * motion.duration_s[k]
        P = transition[k] @ P @ transition[k].T + Q[k]
        step, rows = quaternion_of(vector), slice(edges[k], edges[k + 1])
        if edges[k] < edges[k + 1]:
            predicted = quaternion_product(here, quaternion_of(logged.excess_turn[rows] + logged.share[rows, None] * vector))
            innovation = rotation_vector(quaternion_product(inverse(predicted), logged.wxyz[rows])).mean(0)
            gain = P[:, :3] @ np.linalg.inv(P[:3, :3] + variance[k] * np.eye(3))
            update, P = gain @ innovation, P - gain @ P[:3]
            P = (P + P.T) / 2
            bias = bias + update[3:]
            step = quaternion_product(step, quaternion_of(update[:3]))
        correction[k] = rotation_vector(step) - motion.vectors[k]
        here = quaternion_product(here, step)
        attitude[k + 1] = here = here / np.linalg.norm(here)
    return attitude, correction


def linear_filter(
    inputs: FilterInput, about: ReferenceAttitude, P0: Array, sigmas: tuple[float, float, float] | None = None, initial: Array | None = None
) -> LinearFilter:
    """Linear Kalman filter about the fixed reference ``about``, from its ``initial`` error (3,) with covariance ``P0`` (3, 3).

    After a fraction s of a cycle, the logged attitudes measure ``R(−θ s) φ − J s T b − J s δ + μ − ω λ``. δ is the reference's rotation in
    addition to the gyro's, μ the misalignment, λ the additional latency. ``sigmas``: priors of b, μ and λ; None: as stated, λ = 0.
    """
    turns, duration = inputs.motion.turns, inputs.motion.duration_s
    elapsed_s, turn = about.share * duration, turns * about.share[:, None]
    drive, partial = (
        times(mean_rotation(-turns), about.correction_rad),
        times(mean_rotation(-turn), about.correction_rad * about.share[:, None]),
    )
    H = np.zeros((len(turns), 3, STATES))
    H[..., :3], H[..., 3:6] = rotation(-turn), -mean_rotation(-turn) * elapsed_s[:, None, None]
    H[..., 6:9], H[..., 9] = np.eye(3), -turns / duration[:, None]
    Q, attitude_rows = _process_noise(inputs, STATES), _attitude_transition(inputs.motion)
    prior = sigmas or (inputs.bias_sigma, inputs.misalignment_sigma, 0.0)
    x, P, chi_square = np.zeros(STATES), np.diag(np.repeat([0.0, *prior], [3, 3, 3, 1]) ** 2), 0.0
    P[:3, :3], x[:3] = P0, 0.0 if initial is None else initial
    states, covariances = spill.empty(len(turns) + 1, STATES), spill.empty(len(turns) + 1, STATES, STATES)
    states[0], covariances[0] = x, P
    if (library := kernel().library) is not None:
        arrays = (attitude_rows, Q, drive, H, about.offset_rad + partial, about.noise_rad, states, covariances)
        return LinearFilter(states, covariances, call(library.mp_host_reference_error, len(turns), *arrays))
    transition = _transition(attitude_rows, STATES)
    for k, sigma in enumerate(about.noise_rad):
        if np.isfinite(sigma):
            innovation = about.offset_rad[k] + partial[k] - H[k] @ x
            PHt = P @ H[k].T
            information = np.linalg.inv(H[k] @ PHt + sigma**2 * np.eye(3))
            chi_square += float(innovation @ information @ innovation)
            x, P = x + PHt @ information @ innovation, P - PHt @ information @ PHt.T
        x, P = transition[k] @ x, transition[k] @ ((P + P.T) / 2) @ transition[k].T + Q[k]
        x[:3] -= drive[k]
        states[k + 1], covariances[k + 1] = x, P
    return LinearFilter(states, covariances, chi_square)


def _process_noise(inputs: FilterInput, states: int) -> Array:
    """(K, n, n) process noise covariance of each cycle: gyro noise and random walk of the bias."""
    Q = np.zeros((len(inputs.motion.turns), states, states))
    Q[:, np.arange(3), np.arange(3)] = inputs.noise.gyro_rad**2
    Q[:, np.arange(3, 6), np.arange(3, 6)] = (inputs.bias_walk**2 * inputs.motion.duration_s)[:, None]
    return Q


def _attitude_transition(motion: GyroTurns) -> Array:
    """(K, 3, 6) rows of the transition matrix that give φ from φ and the gyro bias."""
    by_bias = -mean_rotation(-motion.turns) * motion.duration_s[:, None, None]
    return np.concatenate([rotation(-motion.turns), by_bias], -1)


def _transition(attitude_rows: Array, states: int) -> Array:
    """(K, n, n) transition matrix of all states."""
    matrix = np.tile(np.eye(states), (len(attitude_rows), 1, 1))
    matrix[:, :3, :6] = attitude_rows
    return matrix
