"""IMU mounting, attitude, gravity and lever arm: aligned data to :class:`Samples` in body axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprop_cli.align import Aligned
from massprop_cli.arrays import Array, frozen
from massprop_cli.dynamics import lever_arm, times
from massprop_cli.errors import InputError
from massprop_cli.vehicle import Vehicle


@dataclass(frozen=True)
class Samples:
    """One control cycle each, body axes, gravity's direction known. What the estimators take."""

    executed: Aligned
    rate_rad_s: Array
    """(K, 3) mean body rate."""
    rate_step_rad_s: Array
    """(K, 3) difference to the previous cycle's mean rate; zero in the first."""
    specific_force_m_s2: Array
    """(K, 3) mean specific force at the IMU."""
    up_b: Array
    """(K + 1, 3) world vertical in body axes at the start of each cycle and the end of the last; zeros in free flight."""

    def __len__(self) -> int:
        return len(self.rate_rad_s)


def compensate(aligned: Aligned, vehicle: Vehicle) -> Samples:
    """Turn IMU data into body axes and find the vertical, from the logged attitude or by integrating the gyro.

    The lever arm is not taken out here: :func:`acceleration` does it with the differenced rate, as the thesis does, and the
    default estimator inside its model, with the angular acceleration that the commands cause.
    """
    body_from_imu = np.array(vehicle.imu.body_from_imu)
    rate = times(body_from_imu, aligned.rate_imu_rad_s)
    up: Array = np.zeros((len(rate) + 1, 3))
    if vehicle.on_air_bearing:
        up = world_up_b(_attitude_at_edges(aligned, vehicle, rate))
    return Samples(
        executed=aligned,
        rate_rad_s=frozen(rate),
        rate_step_rad_s=frozen(np.diff(rate, axis=0, prepend=rate[:1])),
        specific_force_m_s2=frozen(times(body_from_imu, aligned.specific_force_imu_m_s2)),
        up_b=frozen(up),
    )


def acceleration(samples: Samples, vehicle: Vehicle) -> Array:
    """(K, 3) acceleration of the rotation centre, m/s², body axes: specific force less lever arm and gravity (thesis 4.3, 4.4).

    The centre is O in free flight and the bearing on a testbed; ω̇ is the differenced rate over the cycle.
    """
    centre = vehicle.environment.bearing_position_m if vehicle.on_air_bearing else (0.0, 0.0, 0.0)
    arm = np.array(vehicle.imu.position_m) - np.array(centre)
    rate_dot = samples.rate_step_rad_s / samples.executed.duration_s[:, None]
    gravity = vehicle.environment.gravity_m_s2 * (samples.up_b[:-1] + samples.up_b[1:]) / 2
    compensated: Array = samples.specific_force_m_s2 - lever_arm(samples.rate_rad_s, rate_dot, arm) - gravity
    return compensated


def world_up_b(attitude_wxyz: Array) -> Array:
    """World Z in body axes, (..., 3): the last row of the rotation world ← body."""
    w, x, y, z = np.moveaxis(attitude_wxyz, -1, 0)
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1)


def _attitude_at_edges(aligned: Aligned, vehicle: Vehicle, rate: Array) -> Array:
    """(K + 1, 4) attitude at cycle edges, from the log where it has one, else integrated from the gyro."""
    turns = rate * aligned.duration_s[:, None]
    if aligned.attitude_wxyz is not None:
        _check_attitude(aligned.attitude_wxyz, turns)
        first = quaternion_product(aligned.attitude_wxyz[0], quaternion_of(-turns[0]))
        return np.vstack([first, aligned.attitude_wxyz])
    return integrate_attitude(np.array(vehicle.environment.initial_attitude_wxyz), turns)


def _check_attitude(attitude_wxyz: Array, turns: Array) -> None:
    """Refuse a logged attitude that doesn't turn as the gyro does: another order or direction of its quaternions."""
    back = attitude_wxyz[:-1] * np.array([1, -1, -1, -1])
    steps = np.stack([quaternion_product(a, b) for a, b in zip(back, attitude_wxyz[1:], strict=True)])
    logged = 2 * steps[:, 1:] * np.sign(steps[:, :1])
    apart, turned = (float(np.sqrt((v**2).sum())) for v in (logged - turns[1:], turns[1:]))
    if apart > 0.5 * turned and apart > 0.01 * np.sqrt(len(turns)):
        raise InputError(
            f"columns quat_w … quat_z: the attitude turns by {apart / turned:.2g} times the gyro's angles away from the gyro; "
            "quaternions are wxyz, world from body. Mend them, or leave them out"
        )


def integrate_attitude(initial_wxyz: Array, turns: Array) -> Array:
    """(K + 1, 4) attitude from angle increments (K, 3) in rad, with the first-order coning correction.

    A rotation vector over one increment is ``Δθ[k] + Δθ[k−1] × Δθ[k] / 12`` (Savage 1998, two-interval form).
    """
    vectors = turns.copy()
    vectors[1:] += np.cross(turns[:-1], turns[1:]) / 12
    attitude = np.empty((len(turns) + 1, 4))
    attitude[0] = initial_wxyz
    for k, step in enumerate(quaternion_of(vectors)):
        q = quaternion_product(attitude[k], step)
        attitude[k + 1] = q / np.sqrt(q @ q)
    return attitude


def quaternion_of(rotation_vector: Array) -> Array:
    """(..., 4) unit quaternion of a rotation vector in rad."""
    angle = np.linalg.norm(rotation_vector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * rotation_vector], -1)


def quaternion_product(a: Array, b: Array) -> Array:
    """Hamilton product of two quaternions (4,)."""
    w, x, y, z = a
    matrix = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    product: Array = matrix @ b
    return product
