"""World directions in body axes, integrated from a gyro, and their derivatives by gyro errors."""

from collections.abc import Collection

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import DIFFERENCE
from massprop_cli.base.quaternion import matrices
from massprop_cli.base.rigidbody import rotation
from massprop_cli.errorparameters.environment import LEVEL
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.attitude import initial_attitude
from massprop_cli.prepare.compensate import Samples


def verticals_by_errors(samples: Samples, vehicle: Vehicle) -> list[tuple[str, Array]]:
    """(K + 1, 3) derivatives of the vertical, integrated from the gyro, by each gyro error."""
    rate, mounting, unit = samples.rate_rad_s, np.array(vehicle.imu.body_from_imu), np.eye(3)
    changes = {}
    for i in range(3):
        changes[f"gyro_scale {i}"] = -np.outer(rate @ mounting[:, i], mounting[:, i])
        changes[f"gyro_bias {i}"] = np.broadcast_to(-unit[i], rate.shape)
    rate_changes = np.stack(list(changes.values()))
    ups = verticals(
        np.concatenate([rate + DIFFERENCE * rate_changes, rate - DIFFERENCE * rate_changes]), samples.executed.duration_s, samples.up_b[0]
    )
    slopes = (ups[: len(rate_changes)] - ups[len(rate_changes) :]) / (2 * DIFFERENCE)
    (world,) = matrices(initial_attitude(vehicle, rate, samples.executed.duration_s, samples.executed.late_s[0])[None])
    level = verticals(np.broadcast_to(rate, (2, *rate.shape)), samples.executed.duration_s, world[:2])
    return [*zip(LEVEL, level, strict=True), *zip(changes, slopes, strict=True)]


def logged_axes(attitude_wxyz: Array) -> list[tuple[str, Array]]:
    """(K + 1, 3) the world's X and Y in body axes, from measured attitudes (K + 1, 4)."""
    return list(zip(LEVEL, np.moveaxis(matrices(attitude_wxyz)[:, :2], 1, 0), strict=True))


def verticals(rate: Array, duration_s: Array, start: Array) -> Array:
    """(n, K + 1, 3) a world direction in body axes, integrated with n rates (n, K, 3) from ``start`` (3,) or (n, 3)."""
    turns = rate * duration_s[:, None]
    vectors = turns.copy()
    vectors[:, 1:] += np.cross(turns[:, :-1], turns[:, 1:]) / 12
    back = rotation(-vectors)
    directions = np.empty((len(rate), rate.shape[1] + 1, 3))
    directions[:, 0] = start
    for k in range(rate.shape[1]):
        directions[:, k + 1] = (back[:, k] * directions[:, k, None]).sum(-1)
    return directions


def walking(places: Collection[str], clock_s: tuple[float, float], vehicle: Vehicle, biases: Collection[str]) -> dict[str, float]:
    """Sigmas of an initial tilt and a gyro bias equivalent to the walk of an integrated attitude over a segment.

    The least-squares line through a random walk of unit density, from t on over T, has an initial variance t + 2 T / 15 and a slope
    variance 6 / (5 T). Without those in ``biases``; empty if the attitude is not integrated.
    """
    if "gyro_bias 0" not in places:
        return {}
    middle_s, length_s = clock_s
    density = float(vehicle.imu.gyro_noise_rad_s or 0.0) * vehicle.cycle.period_s**0.5
    before_s = max(middle_s - length_s / 2, 0.0)
    sigmas = {"tilt": density * (before_s + length_s * 2 / 15) ** 0.5, "gyro_bias": density * (1.2 / length_s) ** 0.5}
    return {name: sigma for name, sigma in sigmas.items() if name not in biases}
