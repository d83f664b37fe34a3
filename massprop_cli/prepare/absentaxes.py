"""Measurement channels (rate x y z, specific force x y z) of a log whose IMU lacks some axes.

An absent IMU axis u need not be a body axis. massprop therefore measures specific force along rotated axes: the smallest rotation F that
takes u to the nearest body axis. If two axes are absent, u is the remaining one. Channel k of specific force is row k of F. F is the
identity if the mounting only permutes axes. Channels along absent axes are not used.
A planar table has no rate about X and Y, so its only rate channel is the yaw rate about body Z, and rate needs no F.
"""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, frozen
from massprop_cli.base.rigidbody import cross_matrix
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle


def unread(log: Log, vehicle: Vehicle) -> BoolArray:
    """(6,) True for measurement channels along absent IMU axes."""
    mounting = np.array(vehicle.imu.body_from_imu)
    return np.concatenate([_nearest(mounting, ~np.array(log.axes[part])) for part in (slice(0, 3), slice(3, 6))])


def force_axes(log: Log, vehicle: Vehicle) -> Array | None:
    """(3, 3) measurement axes of specific force F, rows in body axes; None if they are the body axes."""
    absent = ~np.array(log.axes[3:])
    if absent.sum() not in (1, 2):
        return None
    imu_axis = np.array(vehicle.imu.body_from_imu)[:, absent if absent.sum() == 1 else ~absent][:, 0]
    body_axis = np.zeros(3)
    nearest = int(np.abs(imu_axis).argmax())
    body_axis[nearest] = np.sign(imu_axis[nearest])
    cross = cross_matrix(np.cross(imu_axis, body_axis))
    if not cross.any():
        return None
    return frozen(np.eye(3) + cross + cross @ cross / (1 + imu_axis @ body_axis))


def ignored(log: Log, vehicle: Vehicle, cycles: slice) -> BoolArray:
    """(K, 6) True for readings that are not used: channels along absent axes, and sensors in cycles that the log marks."""
    absent = np.tile(unread(log, vehicle), (cycles.stop - cycles.start, 1))
    return absent if log.ignored is None else absent | log.ignored[cycles].repeat(3, 1)


def _nearest(mounting: Array, absent: BoolArray) -> BoolArray:
    """(3,) True for the body axes nearest to the absent IMU axes (3,)."""
    if absent.sum() in (0, 3):
        return absent
    single = absent if absent.sum() == 1 else ~absent
    nearest = np.zeros(3, dtype=bool)
    nearest[int(np.abs(mounting[:, single][:, 0]).argmax())] = True
    return nearest if absent.sum() == 1 else ~nearest
