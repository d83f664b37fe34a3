"""Which of the six measurement channels (rate x y z, specific force x y z) a log holds, where axes of its IMU are absent.

An absent IMU axis u tells nothing along u, which need not be a body axis. So specific force is measured along axes that stand as near to
the body's as can be with u among them: the least rotation F that takes u to the nearest body axis (of two absent axes, the one that is
left). Channel k of specific force is row k of F; F is the identity where the mounting only exchanges axes. Those along absent axes are not
read.
On a table the rates about X and Y are none, so that absent gyro axes leave the yaw alone to be read about a body axis as it is.
"""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, frozen
from massprop_cli.base.rigidbody import cross_matrix
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle


def unread(log: Log, vehicle: Vehicle) -> BoolArray:
    """(6,) channels along absent axes."""
    mounting = np.array(vehicle.imu.body_from_imu)
    return np.concatenate([_nearest(mounting, ~np.array(log.axes[part])) for part in (slice(0, 3), slice(3, 6))])


def force_axes(log: Log, vehicle: Vehicle) -> Array | None:
    """(3, 3) F, rows in body axes; None where they are the body's."""
    absent = ~np.array(log.axes[3:])
    if absent.sum() not in (1, 2):
        return None
    alone = np.array(vehicle.imu.body_from_imu)[:, absent if absent.sum() == 1 else ~absent][:, 0]
    near = np.zeros(3)
    place = int(np.abs(alone).argmax())
    near[place] = np.sign(alone[place])
    turn = cross_matrix(np.cross(alone, near))
    if not turn.any():
        return None
    return frozen(np.eye(3) + turn + turn @ turn / (1 + alone @ near))


def ignored(log: Log, vehicle: Vehicle, cycles: slice) -> BoolArray:
    """(K, 6) readings that are not used: of channels along absent axes, and of sensors in cycles that are marked."""
    found = np.tile(unread(log, vehicle), (cycles.stop - cycles.start, 1))
    return found if log.ignored is None else found | log.ignored[cycles].repeat(3, 1)


def _nearest(mounting: Array, absent: BoolArray) -> BoolArray:
    """(3,) the body axes next to the absent IMU axes (3,)."""
    if absent.sum() in (0, 3):
        return absent
    few = absent if absent.sum() == 1 else ~absent
    found = np.zeros(3, dtype=bool)
    found[int(np.abs(mounting[:, few][:, 0]).argmax())] = True
    return found if absent.sum() == 1 else ~found
