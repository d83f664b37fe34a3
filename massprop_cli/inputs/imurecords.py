"""Gyro, accelerometer and attitude of a log, with checks: increments of each record, absent axes, saturation."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import ACCEL, DELTA_THETA, DELTA_V, GYRO, QUATERNION
from massprop_cli.inputs.equipment import OFF_UNIT
from massprop_cli.inputs.held import moving_mean, periodic_repeats
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.marked import MissingReadings
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle

ABSURD = dict.fromkeys((*DELTA_THETA, *GYRO), 1e3) | dict.fromkeys((*DELTA_V, *ACCEL), 1e6)
"""Limits by column: rates of 1e3 rad/s and specific forces of 1e6 m/s² are not from a vehicle."""
SIMULTANEOUS = 1e-3
"""Interval over the usual interval below which two records count as simultaneous."""
YAW = 0.01
"""Maximum fraction of the squared yaw rate on absent gyro axes on a table."""
MIN_GRAVITY = 0.08
"""Median specific force over gravity below which an accelerometer does not measure gravity; one in units of g reads a tenth."""


class ImuRecords(NamedTuple):
    """IMU data of a log."""

    theta: Array
    """(n, 3) angle increments, IMU axes, rad."""
    velocity: Array
    """(n, 3) velocity increments, IMU axes, m/s."""
    rates: tuple[str, ...]
    """(3,) standard names of the gyro columns."""
    forces: tuple[str, ...]
    axes: tuple[bool, ...]
    empty: tuple[str, ...]
    missing_readings: tuple[MissingReadings, MissingReadings]
    """Missing readings of gyro and accelerometer."""


def read(source: LogTable, vehicle: Vehicle, time_s: Array, interval_s: Array) -> ImuRecords:
    """Read and check gyro and accelerometer; absent axes are 0."""
    rates, forces = source.sensed(DELTA_THETA, GYRO), source.sensed(DELTA_V, ACCEL)
    (theta, gyro), (velocity, accelerometer) = source.increments(rates, GYRO, interval_s), source.increments(forces, ACCEL, interval_s)
    axes, empty = _axes(source, vehicle, (*rates, *forces), (theta, velocity))
    if vehicle.estimator.method == "thesis" and not all(axes):
        raise InputError(
            f'{source.table.path}: estimator.method = "thesis" needs all three axes of gyro and accelerometer; take the default method'
        )
    _fill_absent_axes(theta, vehicle, axes[:3])
    for names, increments in ((rates, theta), (forces, velocity)):
        _check_magnitude(source, names, increments, interval_s)
    if all(axes[3:]):
        _check_gravity(source, vehicle, velocity, interval_s)
    _check_outliers(source, vehicle, time_s, interval_s)
    return ImuRecords(theta, velocity, rates, forces, axes, empty, (gyro, accelerometer))


def _axes(
    source: LogTable, vehicle: Vehicle, names: Sequence[str], increments: tuple[Array, Array]
) -> tuple[tuple[bool, ...], tuple[str, ...]]:
    """Logged IMU axes, and columns on a table that are 0 throughout. Raises :class:`InputError` for a missing rate that is needed."""
    planar = vehicle.environment.kind == "planar"
    yaw = np.array(vehicle.imu.body_from_imu)[2]
    may_be_empty = [*(planar and abs(part) < YAW for part in yaw), True, True, True]
    logged = [source.has(name) for name in names]
    values = [axis for sensor in increments for axis in sensor.T]
    empty = [has and may and not axis.any() for has, may, axis in zip(logged, may_be_empty, values, strict=True)]
    axes = tuple(has and not none for has, none in zip(logged, empty, strict=True))
    missing = [name for name, has in zip(names, axes[:3], strict=False) if not has]
    if float((yaw[list(axes[:3])] ** 2).sum()) < 1 - YAW if planar else missing:
        needed = "the rate about body Z" if planar else 'all three axes of the gyro (only environment.kind = "planar" needs one alone)'
        raise InputError(
            f"{source.table.path}: column {source.name(missing[0])!r} is missing; a log needs {needed}. Add it, or map it under [columns] "
            "of the vehicle file"
        )
    return axes, tuple(name for name, none in zip(names, empty, strict=True) if none)


def empty_notice(source: LogTable, empty: Sequence[str]) -> list[Notice]:
    """Notice of columns that are 0 in every row."""
    if not empty:
        return []
    named = ", ".join(map(source.name, empty))
    text = f"columns that are 0 in every row count as absent: {named}; if the sensor works, correct its logging"
    return [Notice("empty-columns", text)]


def _fill_absent_axes(theta: Array, vehicle: Vehicle, logged: Sequence[bool]) -> None:
    """Set absent gyro axes on a table to their part of the yaw rate, because the IMU's Z axis may be tilted. Changes ``theta``."""
    yaw, read = np.array(vehicle.imu.body_from_imu)[2], np.array(logged)
    if read.all():
        return
    for part in spill.parts(len(theta)):
        turned = theta[part][:, read] @ yaw[read] / (yaw[read] ** 2).sum()
        theta[part, ~read] = turned[:, None] * yaw[~read]


def _check_magnitude(source: LogTable, names: Sequence[str], increments: Array, interval_s: Array) -> None:
    bad = np.argwhere(_beyond(increments, interval_s, ABSURD[names[0]]))
    if bad.size:
        row, axis = (int(i) for i in bad[0])
        usual = median(interval_s)
        if interval_s[row] < SIMULTANEOUS * usual:
            text = f"comes {interval_s[row]:.3g} s after the record before; the usual interval is {usual:.6g} s. Is a record there twice?"
            raise source.error(row, "time_s", text)
        value = f"{increments[row, axis] / interval_s[row]:.3g} per second"
        raise source.error(row, names[axis], f"{value} is too fast for a vehicle; is the unit right, is it a spike?")


def _check_gravity(source: LogTable, vehicle: Vehicle, velocity: Array, interval_s: Array) -> None:
    kind, gravity = vehicle.environment.kind, vehicle.environment.gravity_m_s2
    if kind == "free":
        return
    usual = median(np.concatenate([np.linalg.norm(velocity[part], axis=1) / interval_s[part] for part in spill.parts(len(velocity))]))
    if usual < MIN_GRAVITY * gravity:
        remedy = f'state environment.kind = "free" instead of "{kind}", or log specific force that includes gravity'
        if abs(usual / median(interval_s) / gravity - 1) < MIN_GRAVITY:
            remedy = "its columns seem to hold increments, not rates: rename them, or scale them under [columns]"
        raise InputError(
            f"{source.table.path}: the accelerometer reads {usual:.3g} m/s^2 (median), but on the ground it must read gravity, "
            f"{gravity:.4g} m/s^2; {remedy}"
        )


def sampled(source: LogTable, vehicle: Vehicle) -> tuple[bool, bool]:
    """Whether records of gyro and accelerometer are samples, as the map or the vehicle file states."""
    made = source.table.made
    if made is not None and any(made.sampled):
        return made.sampled
    sampled = vehicle.imu.measures == "sample"
    if sampled and made is not None:
        kept = next((f" ({line})" for line in made.conversions if line.startswith("gyro") and " values (" in line), "")
        raise InputError(
            f'{source.table.path}: imu.measures is "sample", but {made.map} makes no record a sample{kept}; leave imu.measures out, or '
            'keep samples in the map: values = "sample", gyro and accelerometer on one clock, [records] samples = 1, and commands that '
            "come one per row, at most one per sample"
        )
    increments = next((name for name in (*DELTA_THETA, *DELTA_V) if source.has(name)), None)
    if sampled and increments is not None:
        raise InputError(
            f'{source.table.path}, column {source.name(increments)}: an increment covers its record, but imu.measures is "sample"; '
            "leave imu.measures out, or log samples as gyro_x_rad_s … and accel_x_m_s2 …"
        )
    return sampled, sampled


def _check_outliers(source: LogTable, vehicle: Vehicle, time_s: Array, interval_s: Array) -> None:
    """Raise :class:`InputError` if a stated outlier time is not the time of a record."""
    for key in ("gyro_outliers_s", "accel_outliers_s"):
        times = np.array(getattr(vehicle.imu, key) or ())
        after = np.clip(np.searchsorted(time_s, times), 1, len(time_s) - 1)
        row = after - (times - time_s[after - 1] < time_s[after] - times)
        away = np.flatnonzero(np.abs(time_s[row] - times) > interval_s[row] / 2)
        if away.size:
            first = int(away[0])
            raise InputError(
                f"{source.table.path}: imu.{key} has {times[first]:.15g} s, at which no record is; the nearest is at "
                f"{time_s[row[first]]:.15g} s. State times of this log's records, or leave the key out to have them found"
            )


def attitude(source: LogTable, n: int) -> Array | None:
    """(n, 4) unit quaternions of the first n rows; None without any."""
    if not any(source.has(name) for name in QUATERNION):
        return None
    quaternion = spill.empty(source.table.rows, len(QUATERNION))
    for place, name in enumerate(QUATERNION):
        quaternion[:, place] = source.optional(name)
    empty = np.isnan(quaternion).sum(1)
    partial = np.flatnonzero((empty > 0) & (empty < len(QUATERNION)))
    if partial.size:
        lacking = QUATERNION[int(np.argmax(np.isnan(quaternion[partial[0]])))]
        raise source.error(
            int(partial[0]), lacking, "nan or an empty cell beside a number; an attitude is four numbers or four empty cells"
        )
    norm = np.sqrt(np.sum([component**2 for component in quaternion.T], 0))
    text = "the quaternion's norm is {:.4g}, not 1; quaternions are wxyz, world from body".format
    source.refuse((empty == 0) & ~(np.abs(norm - 1) <= OFF_UNIT), "quat_w", lambda row: text(norm[row]))
    quaternion /= norm[:, None]
    return None if empty.all() else quaternion[:n]


def _beyond(increments: Array, interval_s: Array, limit: float) -> BoolArray:
    """(n, 3) whether increments over intervals (n,) reach ``limit``."""
    found = [np.abs(increments[part] / interval_s[part, None]) >= limit for part in spill.parts(len(increments))]
    return np.concatenate(found)


def held(imu: ImuRecords, interval_s: Array, own: bool) -> list[Notice]:
    """Notices of sensors with repeated readings, or with smoothed readings if these are the log's ``own``."""
    found = []
    for name, increments, axes in (("gyro", imu.theta, imu.axes[:3]), ("accelerometer", imu.velocity, imu.axes[3:])):
        readings = increments[:, list(axes)] / interval_s[:, None]
        if (again := periodic_repeats(readings)).any():
            text = (
                f"the {name} repeats each reading {len(again) / (~again).sum():.3g} times, because it measures less often than the log has "
                "records: write records as long as its own, or read the file with a map, whose [records] use each reading once"
            )
            found.append(Notice("readings-held", text))
        elif own and (mean := moving_mean(readings)):
            text = f"each reading of the {name} is a moving mean over {mean} readings: log it as measured, or keep one reading in {mean}"
            found.append(Notice("readings-held", f"{text} as a mean over as many"))
    return found


def saturation(vehicle: Vehicle, theta: Array, velocity: Array, interval_s: Array) -> list[Notice]:
    """Notices of reached ranges, from increments (n, 3), rad and m/s, over intervals (n,), s."""
    gyro = "gyro", theta, vehicle.imu.gyro_range_rad_s, "rad/s"
    accelerometer = "accelerometer", velocity, vehicle.imu.accel_range_m_s2, "m/s^2"
    found = []
    for name, increments, limit, unit in (gyro, accelerometer):
        count = 0 if limit is None else int(_beyond(increments, interval_s, 0.999 * limit).any(1).sum())
        if count:
            text = f"{count} record(s) at the {name}'s range of {limit:g} {unit}; the log lacks the motion beyond it"
            found.append(Notice(f"{name}-saturated", text))
    return found
