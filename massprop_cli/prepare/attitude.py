"""Attitude integrated from the gyro, corrected for the drift of a gyro bias that gravity shows.

The estimators are linear in the attitude error φ. The neglected term g φ²/2 reaches 5 mm/s² after half a minute with a bias of
1 mrad/s. So massprop removes an expected bias from the reference attitude as it becomes known. A gyro bias b turns the integrated
attitude R (world from body) by the rotation vector

    ε = ∫R dt b

in world axes. The specific force over gravity then deviates from the vertical z by ε × z. The accelerometer's bias over gravity, β, adds
R β. A regression of the deviation on b and β, with their stated sigmas as priors, estimates ε from the cycles before. The reference
attitude may be rough: the estimators know how it was propagated, so its choice has no first-order effect.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.quaternion import matrices, quaternion_of, quaternion_product, turns_between
from massprop_cli.base.rigidbody import times
from massprop_cli.inputs.vehicle import Vehicle

FORCE_SCATTER = 0.02
"""Assumed scatter of specific force over gravity, including thrust and rotation. A lower value makes an initial push look like a tilt; a
higher value delays the bias estimate."""
PEDESTAL_SCATTER = 0.001
"""The same scatter on a pedestal, where the specific force is referred to the pivot and contains gravity alone."""
BIAS_LIMIT = 3.0
"""Limit of the estimated bias in stated sigmas. A misaligned IMU or wrong units can produce any apparent bias."""


def world_up_b(attitude_wxyz: Array) -> Array:
    """(..., 3) world Z in body axes: the last row of the rotation from body to world."""
    w, x, y, z = np.moveaxis(attitude_wxyz, -1, 0)
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1)


def integrate_attitude(initial_wxyz: Array, turns: Array, turn_before: Array | None = None) -> Array:
    """(K + 1, 4) attitude at cycle edges from angle increments (K, 3), rad, by :func:`rotation_vectors`."""
    attitude = np.vstack([initial_wxyz, quaternion_of(rotation_vectors(turns, turn_before))])
    # prefix products by doubling: each pass doubles the number of factors
    reach = 1
    while reach < len(attitude):
        attitude[reach:] = quaternion_product(attitude[:-reach], attitude[reach:])
        reach *= 2
    return np.asarray(attitude / np.linalg.norm(attitude, axis=1, keepdims=True))


def initial_attitude(vehicle: Vehicle, rate_rad_s: Array, duration_s: Array, late_s: float) -> Array:
    """(4,) attitude at the start of the motion that the first cycle records, ``late_s`` after the cycle's label.

    The stated initial attitude holds at the label. ``rate_rad_s`` (K, 3) and ``duration_s`` (K,) are those of the first cycles. The rate
    in between is extrapolated linearly from the first two.
    """
    rate = rate_rad_s[0]
    if len(rate_rad_s) > 1:
        rate = rate - (rate_rad_s[1] - rate) * (duration_s[0] + late_s) / (duration_s[0] + duration_s[1])
    return quaternion_product(np.array(vehicle.environment.initial_attitude_wxyz), quaternion_of(rate * late_s))


def rotation_vectors(turns: Array, turn_before: Array | None = None) -> Array:
    """(K, 3) rotation vectors of angle increments (K, 3), rad, with the first-order coning correction.

    The rotation vector of one increment is ``Δθ[k] + Δθ[k−1] × Δθ[k] / 12`` (Savage 1998, two-interval form); Δθ[−1] is ``turn_before``.
    """
    before = np.vstack([np.zeros(3) if turn_before is None else turn_before, turns[:-1]])
    return turns + np.cross(before, turns) / 12


class BiasInformation(NamedTuple):
    """Information on gyro and accelerometer bias at a cycle edge; with a leading axis, at many edges."""

    window: Array
    """(3, 3) ∫R dt, s."""
    information: Array
    """(6, 6) information matrix of gyro bias [s²] and accelerometer bias over gravity [1], for measurement noise of variance 1."""
    vector: Array
    """(6,) information vector: information matrix times biases."""

    @staticmethod
    def none() -> BiasInformation:
        """No information, at the start of a log."""
        return BiasInformation(np.zeros((3, 3)), np.zeros((6, 6)), np.zeros(6))

    def at(self, edge: int) -> BiasInformation:
        """Information at one of many edges."""
        return BiasInformation(*(part[edge] for part in self))

    def offset(self, gyro_sigma: float, accel_sigma: float = 0.0, scatter: float = FORCE_SCATTER) -> Array:
        """(..., 3) rotation vector ε, world axes, by which the integrated attitude is off.

        ``gyro_sigma``: prior sigma of the gyro bias, rad/s. ``accel_sigma``: that of the accelerometer bias over gravity; 0 leaves it out.
        """
        prior = np.repeat([scatter / gyro_sigma, scatter / accel_sigma] if accel_sigma > 0 else [scatter / gyro_sigma], 3)
        used = slice(len(prior))
        bias = np.linalg.solve(self.information[..., used, used] + np.diag(prior**2), self.vector[..., used, None])[..., :3, 0]
        size = np.linalg.norm(bias, axis=-1, keepdims=True)
        return times(self.window, bias * np.minimum(1.0, BIAS_LIMIT * gyro_sigma / np.maximum(size, gyro_sigma)))


def bias_information(attitude_wxyz: Array, force_g: Array, duration_s: Array, initial: BiasInformation) -> BiasInformation:
    """Information on the biases at K + 1 cycle edges, from ``initial`` at the first edge and all cycles before each other edge.

    ``attitude_wxyz``: (K + 1, 4) integrated attitude. ``force_g``: (K, 3) specific force over gravity, zeros where it is not used.
    """
    mean = _mean_matrices(attitude_wxyz)
    window = _summed(initial.window, mean * duration_s[:, None, None])
    force_w = times(mean, force_g)
    # ε × z = (ε_y, −ε_x, 0), so (−f_y, f_x) measures (ε_x, ε_y)
    regressors = np.concatenate([(window[:-1, :2] + window[1:, :2]) / 2, np.stack([-mean[:, 1], mean[:, 0]], 1)], -1)
    regressors *= np.any(force_g, axis=1, keepdims=True)[..., None]
    vector = times(regressors.transpose(0, 2, 1), np.stack([-force_w[:, 1], force_w[:, 0]], 1))
    information = regressors.transpose(0, 2, 1) @ regressors
    return BiasInformation(window, _summed(initial.information, information), _summed(initial.vector, vector))


def without_offset(attitude_wxyz: Array, turns: Array, offset: Array) -> tuple[Array, Array]:
    """(K + 1, 4) integrated attitude corrected by its ``offset`` (K + 1, 3), and (K, 3) turns that propagate it from edge to edge, rad."""
    back = quaternion_of(-offset)
    step = -2 * turns_between(back)[:, 1:]
    return quaternion_product(back, attitude_wxyz), turns - times(_mean_matrices(attitude_wxyz).transpose(0, 2, 1), step)


def attitude_error(attitude_wxyz: Array, offset: Array, bias: BiasInformation) -> Array:
    """(K, 3, 4) rotation vector, body axes, from the corrected attitude of ``attitude_wxyz`` (K, 4) to the true attitude.

    First column: its known part, R⁻¹ ``offset``. Other columns: its derivative by the gyro bias, −R⁻¹ ∫R dt.
    """
    back = np.swapaxes(matrices(attitude_wxyz), -1, -2)
    return np.concatenate([times(back, offset)[..., None], -back @ bias.window], -1)


def _mean_matrices(attitude_wxyz: Array) -> Array:
    """(K, 3, 3) rotation world from body, mean of those at both edges (K + 1, 4) of each cycle."""
    rotations = matrices(attitude_wxyz)
    return (rotations[:-1] + rotations[1:]) / 2


def _summed(initial: Array, steps: Array) -> Array:
    """(K + 1, ...) cumulative sums of ``steps`` (K, ...), from ``initial``."""
    return np.cumsum(np.concatenate([initial[None], steps]), axis=0)
