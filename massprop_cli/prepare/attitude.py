"""Attitude from the gyro: integrated, and freed of what a bias has carried it off by as gravity shows it.

The estimators are linear in the error of the attitude. What is of second order in an error φ is g φ²/2, 5 mm/s² after half a minute
with a bias of 1 mrad/s; so where a bias is to be expected it is taken out of the attitude as it becomes known. By a bias b, R in
world axes from body axes as integrated is

    ε = ∫R dt b

off (rotation vector, world axes), and the specific force, nearly all of it gravity's, points to ε × z beside the vertical z, and by the
accelerometer's own bias β, over gravity, to R β beside that. A regression of one on the others, with the stated sigmas of b and β as its
prior, gives ε from what came before. Which attitude the estimators are linear about does not matter to them in the first order, since they
are told how it was carried: it may be rough.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.quaternion import matrices, quaternion_of, quaternion_product, turns_between
from massprop_cli.base.rigidbody import times
from massprop_cli.inputs.vehicle import Vehicle

FELT = 0.02
"""Part of gravity's that specific force is taken to scatter by, with all that thrust and rotation make an IMU feel. With less a push at the
beginning looks like a tilt, with more the bias shows later."""
LEVELLED = 0.001
"""The same on a pedestal, whose pivot feels gravity alone."""
FARTHEST = 3.0
"""Sigmas of the bias beyond which it is none: an IMU that is turned or in other units shows any."""


def world_up_b(attitude_wxyz: Array) -> Array:
    """World Z in body axes, (..., 3): the last row of the rotation world ← body."""
    w, x, y, z = np.moveaxis(attitude_wxyz, -1, 0)
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1)


def integrate_attitude(initial_wxyz: Array, turns: Array, turn_before: Array | None = None) -> Array:
    """(K + 1, 4) attitude from angle increments (K, 3) in rad, by :func:`rotation_vectors`."""
    attitude = np.vstack([initial_wxyz, quaternion_of(rotation_vectors(turns, turn_before))])
    # all products of first factors, of twice as many with each pass
    reach = 1
    while reach < len(attitude):
        attitude[reach:] = quaternion_product(attitude[:-reach], attitude[reach:])
        reach *= 2
    return np.asarray(attitude / np.linalg.norm(attitude, axis=1, keepdims=True))


def at_first(vehicle: Vehicle, rate_rad_s: Array, duration_s: Array, late_s: float) -> Array:
    """(4,) attitude at the start of the motion that the first cycle shows, ``late_s`` after the label, at which the stated attitude holds.

    ``rate_rad_s`` (K, 3) and ``duration_s`` (K,) of the first cycles. The rate in between follows from a line through the first two.
    """
    rate = rate_rad_s[0]
    if len(rate_rad_s) > 1:
        rate = rate - (rate_rad_s[1] - rate) * (duration_s[0] + late_s) / (duration_s[0] + duration_s[1])
    return quaternion_product(np.array(vehicle.environment.initial_attitude_wxyz), quaternion_of(rate * late_s))


def rotation_vectors(turns: Array, turn_before: Array | None = None) -> Array:
    """(K, 3) rotation vectors of angle increments (K, 3), rad, with the first-order coning correction.

    A rotation vector over one increment is ``Δθ[k] + Δθ[k−1] × Δθ[k] / 12`` (Savage 1998, two-interval form); Δθ[−1] is ``turn_before``.
    """
    before = np.vstack([np.zeros(3) if turn_before is None else turn_before, turns[:-1]])
    return turns + np.cross(before, turns) / 12


class BiasSeen(NamedTuple):
    """What is known of the biases of gyro and accelerometer at a cycle's edge, or at many along a first axis."""

    window: Array
    """(3, 3) ∫R dt, s."""
    information: Array
    """(6, 6) of the biases: of the gyro's (s²) and of the accelerometer's over gravity (1)."""
    told: Array
    """(6,) information times biases."""

    @staticmethod
    def none() -> BiasSeen:
        """At a log's beginning."""
        return BiasSeen(np.zeros((3, 3)), np.zeros((6, 6)), np.zeros(6))

    def at(self, edge: int) -> BiasSeen:
        """Of one of many."""
        return BiasSeen(*(part[edge] for part in self))

    def off(self, sigma: float, tilted: float = 0.0, scatter: float = FELT) -> Array:
        """(..., 3) rotation vector in world axes by which the integrated attitude is off.

        ``sigma`` of the gyro's bias in rad/s, ``tilted`` that of the accelerometer's over gravity; ``scatter`` as :data:`FELT`.
        """
        prior = np.repeat([scatter / sigma, scatter / tilted] if tilted > 0 else [scatter / sigma], 3)
        own = slice(len(prior))
        bias = np.linalg.solve(self.information[..., own, own] + np.diag(prior**2), self.told[..., own, None])[..., :3, 0]
        size = np.linalg.norm(bias, axis=-1, keepdims=True)
        return times(self.window, bias * np.minimum(1.0, FARTHEST * sigma / np.maximum(size, sigma)))


def bias_seen(attitude_wxyz: Array, felt: Array, duration_s: Array, begun: BiasSeen) -> BiasSeen:
    """At K + 1 edges of cycles: in the first what is ``begun``, in the others by all cycles before.

    ``attitude_wxyz`` (K + 1, 4) as integrated; ``felt`` (K, 3) specific force over gravity's, zeros where it doesn't count.
    """
    mean = _mean_matrices(attitude_wxyz)
    window = _summed(begun.window, mean * duration_s[:, None, None])
    level = times(mean, felt)
    # ε × z has no part along z; (ε_x, ε_y) stand in (−f_y, f_x)
    slope = np.concatenate([(window[:-1, :2] + window[1:, :2]) / 2, np.stack([-mean[:, 1], mean[:, 0]], 1)], -1)
    slope *= np.any(felt, axis=1, keepdims=True)[..., None]
    told = times(slope.transpose(0, 2, 1), np.stack([-level[:, 1], level[:, 0]], 1))
    return BiasSeen(window, _summed(begun.information, slope.transpose(0, 2, 1) @ slope), _summed(begun.told, told))


def freed(attitude_wxyz: Array, turns: Array, off: Array) -> tuple[Array, Array]:
    """(K + 1, 4) integrated attitude less what it is ``off`` by (K + 1, 3), and (K, 3) ``turns`` that carry it from edge to edge."""
    back = quaternion_of(-off)
    step = -2 * turns_between(back)[:, 1:]
    return quaternion_product(back, attitude_wxyz), turns - times(_mean_matrices(attitude_wxyz).transpose(0, 2, 1), step)


def attitude_error(attitude_wxyz: Array, off: Array, seen: BiasSeen) -> Array:
    """(K, 3, 4) rotation vector, body axes, from what :func:`freed` gives of ``attitude_wxyz`` (K, 4) to the true attitude.

    What is known of it, R⁻¹ ``off``, and its derivative by the bias, −R⁻¹ ∫R dt.
    """
    back = np.swapaxes(matrices(attitude_wxyz), -1, -2)
    return np.concatenate([times(back, off)[..., None], -back @ seen.window], -1)


def _mean_matrices(attitude_wxyz: Array) -> Array:
    """(K, 3, 3) world from body, the mean of those at the edges (K + 1, 4) of each cycle."""
    found = matrices(attitude_wxyz)
    return (found[:-1] + found[1:]) / 2


def _summed(begun: Array, steps: Array) -> Array:
    return np.cumsum(np.concatenate([begun[None], steps]), axis=0)
