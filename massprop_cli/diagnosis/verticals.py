"""Directions of the world in body axes that turn as a gyro shows, and how they move with what it may have wrong."""

from collections.abc import Collection

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.quaternion import matrices
from massprop_cli.base.rigidbody import rotation
from massprop_cli.errorparameters.environment import LEVEL
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.attitude import at_first
from massprop_cli.prepare.compensate import Samples

ANGLE = 1e-4
"""Half the difference behind a derivative of the vertical."""


def verticals_by_errors(samples: Samples, vehicle: Vehicle) -> list[tuple[str, Array]]:
    """(K + 1, 3) by how much the vertical, integrated from the gyro, moves for a unit of what it may have wrong."""
    rate, mounting, unit = samples.rate_rad_s, np.array(vehicle.imu.body_from_imu), np.eye(3)
    changes = {}
    for i in range(3):
        changes[f"gyro_scale {i}"] = -np.outer(rate @ mounting[:, i], mounting[:, i])
        changes[f"gyro_bias {i}"] = np.broadcast_to(-unit[i], rate.shape)
    moved = np.stack(list(changes.values()))
    ups = verticals(np.concatenate([rate + ANGLE * moved, rate - ANGLE * moved]), samples.executed.duration_s, samples.up_b[0])
    slopes = (ups[: len(moved)] - ups[len(moved) :]) / (2 * ANGLE)
    (world,) = matrices(at_first(vehicle, rate, samples.executed.duration_s, samples.executed.late_s[0])[None])
    level = verticals(np.broadcast_to(rate, (2, *rate.shape)), samples.executed.duration_s, world[:2])
    return [*zip(LEVEL, level, strict=True), *zip(changes, slopes, strict=True)]


def by_log(attitude_wxyz: Array) -> list[tuple[str, Array]]:
    """(K + 1, 3) the world's X and Y in the body's axes, of attitudes (K + 1, 4) that were logged."""
    return list(zip(LEVEL, np.moveaxis(matrices(attitude_wxyz)[:, :2], 1, 0), strict=True))


def verticals(rate: Array, duration_s: Array, start: Array) -> Array:
    """(n, K + 1, 3) a direction of the world in body axes that turn at n rates (n, K, 3) from ``start`` (3,) or (n, 3) on."""
    turns = rate * duration_s[:, None]
    vectors = turns.copy()
    vectors[:, 1:] += np.cross(turns[:, :-1], turns[:, 1:]) / 12
    back = rotation(-vectors)
    found = np.empty((len(rate), rate.shape[1] + 1, 3))
    found[:, 0] = start
    for k in range(rate.shape[1]):
        found[:, k + 1] = (back[:, k] * found[:, k, None]).sum(-1)
    return found


def walking(places: Collection[str], clock_s: tuple[float, float], vehicle: Vehicle, biases: Collection[str]) -> dict[str, float]:
    """One sigma of a tilt at the start and of a gyro's bias that do what the walk of the attitude does to a stretch, in the mean.

    Of the line of least squares through a random walk of unit density, from t on and T long: the beginning has the variance t + 2 T / 15,
    the slope 6 / (5 T). Without those that are ``biases`` already; nothing where the gyro does not carry the attitude (``places``).
    """
    if "gyro_bias 0" not in places:
        return {}
    middle_s, lasts_s = clock_s
    density = float(vehicle.imu.gyro_noise_rad_s or 0.0) * vehicle.cycle.period_s**0.5
    before_s = max(middle_s - lasts_s / 2, 0.0)
    found = {"tilt": density * (before_s + lasts_s * 2 / 15) ** 0.5, "gyro_bias": density * (1.2 / lasts_s) ** 0.5}
    return {name: sigma for name, sigma in found.items() if name not in biases}
