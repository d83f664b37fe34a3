"""Stated noise other than the IMU's: impulse errors, unknown commands, torques, gyro bias walk, and the walk of an integrated vertical."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Samples

OF_MOTION = ("products", "constant", "up", "level", "precession")
"""Columns of motion that is not commanded."""
RIDGE = 0.03
"""Ridge, relative to the largest singular value of the torques."""


class StatedScatter(NamedTuple):
    """Variances of stated noise over those of the IMU noise."""

    rate_step: Array
    """(K,) white noise of the rate's step up to each cycle."""
    force: Array
    """(K,) white noise of the specific force."""
    random_walk: float
    """Random-walk torque: variance of the change of the step per cycle."""


def scatter_of(
    samples: Samples, vehicle: Resolved, places: Mapping[str, slice], growth: Array, mean: Array, rate: Array
) -> StatedScatter | None:
    """Stated scatter, from the mean response of rate and specific force to the wrench; None without any.

    Half of a cycle's impulse is in the rate's step up to it. A gyro bias walk acts as a white torque. The integrated vertical walks by gyro
    noise, and the torque of the weight with it.
    """
    executed, duration, environment = samples.executed, samples.executed.duration_s, vehicle.environment
    torque, walk, drift = environment.disturbance_torque_n_m, environment.disturbance_walk_n_m, vehicle.imu.gyro_bias_walk_rad_s_sqrt_s
    weighted = vehicle.pivoted
    if executed.pulse_covariance is None and torque == walk == drift == 0 and not weighted:
        return None
    wrench = executed.rising[:-1] + executed.falling[1:], executed.whole / duration[:, None]
    names = [name for name in OF_MOTION if name in places]
    other_columns = [np.hstack([columns[:, places[name]] for name in names]) for columns in (growth, mean)]
    motion = np.diff(rate, axis=0), samples.specific_force_m_s2
    torque_of, force_of = (float(np.linalg.norm(part)) for part in np.hsplit(executed.channels.wrench, 2))
    arm_m = torque_of / max(force_of, TINY)
    rates, forces = (
        _response(by, other, arm_m, motion_of_sensor) for by, other, motion_of_sensor in zip(wrench, other_columns, motion, strict=True)
    )
    covariance = np.zeros((len(duration), 6, 6)) if executed.pulse_covariance is None else executed.pulse_covariance.copy()
    covariance[:, range(3), range(3)] += (torque * duration[:, None]) ** 2
    noise, cycle_s = (vehicle.imu.gyro_noise_rad_s, vehicle.imu.accel_noise_m_s2), float(duration.mean())
    rate_step, force_noise = (
        np.einsum("kab,ai,bi->k", covariance, by[:6], by[:6]) / (3 * sigma**2) for by, sigma in zip((rates, forces), noise, strict=True)
    )
    random_walk = float((rates[:3] ** 2).sum()) * (walk * cycle_s / noise[0]) ** 2
    if weighted:
        first = 6 + sum(places[name].stop - places[name].start for name in names[: names.index("up")])
        # measured attitudes correct the vertical by as much as gyro noise disturbs it
        by = 1.0 if samples.measured is None else 2.0
        random_walk += by * float((np.cross(samples.up_b[:-1].mean(0), rates[first : first + 3].T) ** 2).sum()) * cycle_s**4
    rate_step = (rate_step + np.append(0.0, rate_step[:-1])) / 2 + (drift / noise[0]) ** 2 * duration
    return StatedScatter(rate_step, force_noise / duration**2, random_walk / 3)


def _response(wrench: Array, others: Array, arm_m: float, motion: Array) -> Array:
    """(6 + p, 3) response of a motion to wrench and other columns, by ridge regression (Hoerl & Kennard 1970).

    A force is scaled to the torque that it has at ``arm_m``.
    """
    torques = np.hstack([wrench[:, :3], arm_m * wrench[:, 3:]])
    size = float(np.linalg.norm(torques, 2)) or 1.0
    weights = size / np.maximum(np.linalg.norm(others, axis=0), TINY)
    columns = np.vstack([np.hstack([torques, others * weights]), RIDGE * size * np.eye(6 + others.shape[1])])
    if not (np.isfinite(columns).all() and np.isfinite(motion).all()):
        raise np.linalg.LinAlgError("the motion is no number")  # LAPACK would print on stdout
    response: Array = np.linalg.lstsq(columns, np.vstack([motion, np.zeros((columns.shape[1], 3))]), rcond=None)[0]
    return np.concatenate([response[:3], arm_m * response[3:6], weights[:, None] * response[6:]])
