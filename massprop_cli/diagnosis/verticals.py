"""Directions of the world in body axes that turn as a gyro shows, and how they move with what it may have wrong."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.errorparameters.environment import level_of
from massprop_cli.inputs.vehicle import Vehicle
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
    east, north = verticals(np.broadcast_to(rate, (2, *rate.shape)), samples.executed.duration_s, level_of(samples.up_b[0]))
    return [("east", east), ("north", north), *zip(changes, slopes, strict=True)]


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
