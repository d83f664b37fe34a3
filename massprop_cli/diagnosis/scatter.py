"""What is stated beside the IMU's noise: errors of impulses, unknown commands, torques, a bias that walks, a vertical by the gyro alone."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Samples

OF_MOTION = ("products", "constant", "up", "level", "precession")
"""Columns of what moves a body beside what is commanded."""
HARDLY = 0.03
"""Part of what most is done along any sum of columns below which nothing tells how the motion answers."""


class StatedScatter(NamedTuple):
    """What is stated beside the IMU's noise, errors of impulses and torques: variances over those of the noise."""

    turned: Array
    """(K,) of the rate's step up to each cycle, of what is white."""
    felt: Array
    """(K,) of the specific force."""
    walking: float
    """Of the change from one step to the next, by a torque that walks."""


def scatter_of(
    samples: Samples, vehicle: Resolved, places: Mapping[str, slice], growth: Array, mean: Array, rate: Array
) -> StatedScatter | None:
    """By how rate and specific force answer the wrench in the mean; half of each cycle's is in the rate's step up to it.

    A gyro's bias that walks shows as a white torque does. The vertical that the gyro carries walks by its noise, and the weight with it.
    """
    executed, duration, environment = samples.executed, samples.executed.duration_s, vehicle.environment
    torque, walk, drift = environment.disturbance_torque_n_m, environment.disturbance_walk_n_m, vehicle.imu.gyro_bias_walk_rad_s_sqrt_s
    swung = vehicle.pivoted
    if executed.pulse_covariance is None and torque == walk == drift == 0 and not swung:
        return None
    wrench = executed.rising[:-1] + executed.falling[1:], executed.whole / duration[:, None]
    names = [name for name in OF_MOTION if name in places]
    besides = [np.hstack([columns[:, places[name]] for name in names]) for columns in (growth, mean)]
    motion = np.diff(rate, axis=0), samples.specific_force_m_s2
    torque_of, force_of = (float(np.linalg.norm(part)) for part in np.hsplit(executed.channels.wrench, 2))
    arm_m = torque_of / max(force_of, TINY)
    rates, forces = (_answer(by, other, arm_m, moved) for by, other, moved in zip(wrench, besides, motion, strict=True))
    covariance = np.zeros((len(duration), 6, 6)) if executed.pulse_covariance is None else executed.pulse_covariance.copy()
    covariance[:, range(3), range(3)] += (torque * duration[:, None]) ** 2
    noise, cycle_s = (vehicle.imu.gyro_noise_rad_s, vehicle.imu.accel_noise_m_s2), float(duration.mean())
    turned, felt = (
        np.einsum("kab,ai,bi->k", covariance, by[:6], by[:6]) / (3 * own**2) for by, own in zip((rates, forces), noise, strict=True)
    )
    walking = float((rates[:3] ** 2).sum()) * (walk * cycle_s / noise[0]) ** 2
    if swung:
        first = 6 + sum(places[name].stop - places[name].start for name in names[: names.index("up")])
        # logged attitudes draw the vertical to them by as much as the gyro's noise carries it off
        by = 1.0 if samples.measured is None else 2.0
        walking += by * float((np.cross(samples.up_b[:-1].mean(0), rates[first : first + 3].T) ** 2).sum()) * cycle_s**4
    turned = (turned + np.append(0.0, turned[:-1])) / 2 + (drift / noise[0]) ** 2 * duration
    return StatedScatter(turned, felt / duration**2, walking / 3)


def _answer(wrench: Array, besides: Array, arm_m: float, moved: Array) -> Array:
    """(6 + p, 3) how a motion answers wrench and other columns: next to nothing along what is hardly done (Hoerl & Kennard 1970).

    A force counts as the torque that it has at an arm.
    """
    torques = np.hstack([wrench[:, :3], arm_m * wrench[:, 3:]])
    size = float(np.linalg.norm(torques, 2)) or 1.0
    weights = size / np.maximum(np.linalg.norm(besides, axis=0), TINY)
    columns = np.vstack([np.hstack([torques, besides * weights]), HARDLY * size * np.eye(6 + besides.shape[1])])
    if not (np.isfinite(columns).all() and np.isfinite(moved).all()):
        raise np.linalg.LinAlgError("the motion is no number")  # which LAPACK writes on stdout
    found: Array = np.linalg.lstsq(columns, np.vstack([moved, np.zeros((columns.shape[1], 3))]), rcond=None)[0]
    return np.concatenate([found[:3], arm_m * found[3:6], weights[:, None] * found[6:]])
