"""A table of telemetry to a checked :class:`Log`.

A log is one row per IMU record; a record covers ``(previous time_s, time_s]``. Everything is checked here, once;
later stages trust the arrays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, frozen, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import commands, pulses, stamps, supply
from massprop_cli.inputs.actuators.actuator import MomentumLog
from massprop_cli.inputs.columns import ACCEL, COMMAND_TIME, DELTA_THETA, DELTA_V, GYRO, PULSE_JET, QUATERNION
from massprop_cli.inputs.equipment import OFF_UNIT
from massprop_cli.inputs.formats import agreement
from massprop_cli.inputs.logtable import GAP, LONG, LogTable
from massprop_cli.inputs.supply import Supply
from massprop_cli.inputs.tablefile import Made, Table
from massprop_cli.inputs.vehicle import Vehicle

CommandKind = commands.CommandKind
ABSURD = 1e6
"""No vehicle turns at 1e6 rad/s or accelerates at 1e6 m/s²."""
AT_ONCE = 1e-3
"""Part of the usual interval below which two records are of one moment."""
COARSE = 1e-3
"""Of a control cycle: so far numbers of time may be apart. At 1.7e9 s, as clocks of computers count, they are 2.4e-7 s apart."""
SATURATED = ("gyro-saturated", "accelerometer-saturated")
"""Codes of notices that a sensor was at the end of its range."""
UNREAD = (*SATURATED, "sensor-frozen")
"""... or repeated one reading: no cause is looked for in what such a sensor shows."""
VOID = (*UNREAD, "cycle-period")
"""Codes of notices beside which no value holds, and which nothing corrects."""
LONGEST_S = 0.06
"""s that are taken together where commands have times of their own: a body turns by little in them, and a pulse still stands out."""
PACE = 0.0025
"""Part by which recorded cycles may be longer or shorter than stated: with increments and a wrench, inertia follows its square."""
YAW = 0.01
"""Part of the yaw rate's square that gyro axes on a table may miss, being absent."""
JITTER = 0.02
"""Part of the usual interval that intervals may scatter by: each counts with its own length, commands do not."""
ROBUST = 1.4826
"""Median absolute deviation to standard deviation, of a normal distribution."""
FELT = 0.08
"""Part of gravity below which an accelerometer doesn't feel it: one that counts in g feels a tenth."""


@dataclass(frozen=True)
class Notice:
    """Something a reader must know; ``code`` is stable, ``message`` names numbers and a remedy."""

    code: str
    message: str


@dataclass(frozen=True)
class Log:
    """A checked recording. ``n`` IMU records, ``K`` control cycles of ``records_per_cycle`` records each."""

    path: Path
    sha256: str
    rows: int
    records_per_cycle: int
    time_s: Array
    """(n,) end of each record."""
    interval_s: Array
    """(n,) length of each record."""
    delta_theta_imu_rad: Array
    """(n, 3) angle increments, IMU axes."""
    delta_v_imu_m_s: Array
    """(n, 3) velocity increments (specific force), IMU axes."""
    command_kind: CommandKind
    command: Array
    """(K, jets) on-times in s, (K, 6) mean torque about O [N m] and force [N], body axes, or (K, rotors) what they are told."""
    attitude_wxyz: Array | None
    """(n, 4) logged attitude at ``time_s``, world ← body; NaN in records without one."""
    notices: tuple[Notice, ...]
    rate_columns: tuple[str, ...] = DELTA_THETA
    """The contract's names of the columns that the gyro's increments came from."""
    force_columns: tuple[str, ...] = DELTA_V
    """The same of the accelerometer's."""
    axes: tuple[bool, ...] = (True,) * 6
    """Which IMU axes were logged: gyro x y z, accelerometer x y z; the increments of the others are zeros."""
    empty: tuple[str, ...] = ()
    """The contract's names of columns of absent axes that hold 0 in every row."""
    made: Made | None = None
    """How a map made it of another recording."""
    ignored: BoolArray | None = None
    """(K, 2) cycles whose gyro, whose accelerometer is not used; none of them by default."""
    spinning: tuple[MomentumLog, ...] = ()
    """Of each of the vehicle's :attr:`massprop_cli.inputs.vehicle.Vehicle.spinning`."""
    command_s: Array | None = None
    """(M,) when each row of ``command`` was issued, by the commands' clock; None: each begins a control cycle, M = K."""
    sampled: tuple[bool, bool] = (False, False)
    """Whether a record of the gyro, of the accelerometer is a sample at its time (times its length), not the motion over it."""
    cycles_apart: tuple[int, ...] = ()
    """Cycles from one logged speed of each rotor to the next, 0 of one whose command is logged."""
    supply: Supply | None = None
    """The pressure of the jets' supply; None: it is as stated throughout."""
    began_s: float | None = None
    """When the log began that this is a part of; None: it is the whole."""

    @property
    def cycles(self) -> int:
        """How many control cycles."""
        return len(self.time_s) // self.records_per_cycle

    def part(self, first: int, stop: int) -> Log:
        """Of control cycles from ``first`` to before ``stop`` alone."""
        rows = slice(first * self.records_per_cycle, stop * self.records_per_cycle)
        issued = slice(first, stop) if self.command_s is None else self._issued(first, stop)
        return replace(
            self,
            time_s=self.time_s[rows],
            interval_s=self.interval_s[rows],
            delta_theta_imu_rad=self.delta_theta_imu_rad[rows],
            delta_v_imu_m_s=self.delta_v_imu_m_s[rows],
            command=self.command[issued],
            command_s=None if self.command_s is None else self.command_s[issued],
            attitude_wxyz=None if self.attitude_wxyz is None else self.attitude_wxyz[rows],
            ignored=None if self.ignored is None else self.ignored[first:stop],
            spinning=tuple(one.part(rows) for one in self.spinning),
            began_s=self.origin_s,
        )

    @property
    def origin_s(self) -> float:
        """When the whole log began."""
        return float(self.time_s[0] - self.interval_s[0]) if self.began_s is None else self.began_s

    def _issued(self, first: int, stop: int) -> slice:
        """Commands issued in some cycles."""
        assert self.command_s is not None
        edges = self.cycle_end_s[[first, stop - 1]]
        begin_s = edges[0] - float(self.interval_s[first * self.records_per_cycle : (first + 1) * self.records_per_cycle].sum())
        return slice(*np.searchsorted(self.command_s, [begin_s, edges[1]]).tolist())

    @property
    def command_start_s(self) -> Array:
        """(M,) when each row of commands was issued."""
        if self.command_s is not None:
            return self.command_s
        records = self.records_per_cycle
        found: Array = self.cycle_end_s - self.interval_s.reshape(-1, records).sum(1)
        return found

    @property
    def cycle_end_s(self) -> Array:
        """(K,) end of each control cycle."""
        return self.time_s[self.records_per_cycle - 1 :: self.records_per_cycle]


def jitter(interval_s: Array) -> float:
    """By what part of the usual interval all of them (n,) scatter: the median deviation, as one sigma of a normal distribution."""
    usual = median(interval_s)
    return ROBUST * median(np.abs(interval_s - usual)) / usual


def read(table: Table, vehicle: Vehicle) -> Log:
    """Check a table against the vehicle and the contract.

    Raises :class:`InputError` with file, row (Parquet, from 0) or line (CSV), column, value and remedy.
    """
    source = LogTable(table, vehicle.columns)
    stamped = stamps.examined(source, vehicle, source.required("time_s"))
    time_s = stamped.time_s
    interval_s, notices = _intervals(source, time_s, stamped.remedy)
    notices += [Notice("clock-rebuilt", f"{source.name('time_s')}: {stamped.message}")] if stamped.message else []
    pulsed = pulses.commands(source, vehicle, float(time_s[0] - interval_s[0]), float(time_s[-1]))
    command_s = _command_times(source, time_s, stamped.moved_s) if pulsed is None else pulsed.issued_s
    records, paced = _grouped(source, time_s, interval_s, command_s, vehicle.cycle.period_s)
    n = table.rows // records * records
    if command_s is not None and source.issued is not None:
        source.issued = source.issued[source.issued < n]
        command_s = command_s[: len(source.issued)]
    imu = _imu(source, vehicle, interval_s)
    theta, velocity = imu.theta, imu.velocity
    notices += [*paced, *_emptiness(source, imu.empty), *saturation(vehicle, theta, velocity, interval_s)]
    kind, command = commands.commands(source, vehicle, records, n, pulsed)
    attitude = _attitude(source, n)
    _check_outliers(source, vehicle, time_s, interval_s)
    if table.made is not None:
        agreement.check(table.path, table.made, vehicle, theta[:n], velocity[:n] / interval_s[:n, None], attitude)
    return Log(
        path=table.path,
        sha256=table.sha256,
        rows=table.rows,
        records_per_cycle=records,
        time_s=frozen(time_s[:n]),
        interval_s=frozen(interval_s[:n]),
        delta_theta_imu_rad=frozen(theta[:n]),
        delta_v_imu_m_s=frozen(velocity[:n]),
        command_kind=kind,
        command=frozen(command),
        attitude_wxyz=None if attitude is None else frozen(attitude),
        notices=tuple(notices),
        rate_columns=imu.rates,
        force_columns=imu.forces,
        axes=imu.axes,
        empty=imu.empty,
        made=table.made,
        command_s=command_s,
        sampled=_sampled(source, vehicle),
        spinning=commands.momentum(source, vehicle, records, n),
        cycles_apart=tuple(rotor.cycles_apart(source, records, n) for rotor in vehicle.rotors),
        supply=supply.read(source, vehicle, time_s[:n], interval_s[:n], records) if kind == "jets" else None,
    )


def _grouped(source: LogTable, time_s: Array, interval_s: Array, command_s: Array | None, period_s: float) -> tuple[int, list[Notice]]:
    """How many records are taken together: those of a control cycle, or of a group where commands have times of their own."""
    if command_s is None:
        records = _records_per_cycle(source, time_s, interval_s, period_s)
        notices = _pace(records * interval_s, period_s)
    else:
        records = _group(period_s / median(interval_s), median(interval_s))
        notices = [] if source.has(PULSE_JET) else _pace(np.diff(command_s), period_s)
    if len(time_s) < 2 * records:
        raise InputError(
            f"{source.table.path}: {len(time_s)} rows of {median(interval_s):g} s are not two control cycles of {period_s:g} s; record "
            "longer, or correct cycle.period_s"
        )
    return records, notices


def _group(records: float, interval_s: float) -> int:
    """How many records are taken together, where so many come in a control cycle: of all of it, or an equal part of a long one."""
    return max(round(records / math.ceil(records * interval_s / LONGEST_S)), 1)


def _command_times(source: LogTable, time_s: Array, moved_s: Array | None) -> Array | None:
    """(M,) when commands were issued, where they have times of their own; their rows are then :attr:`LogTable.issued`.

    ``moved_s`` (n,) is what was taken off the clock at each row.
    """
    if not source.has(COMMAND_TIME):
        return None
    issued_s = source.optional(COMMAND_TIME)
    rows = np.flatnonzero(~np.isnan(issued_s))
    found = issued_s[rows] - (0.0 if moved_s is None else moved_s[rows])
    if len(rows) < 2:
        raise InputError(f"{source.table.path}, column {source.name(COMMAND_TIME)}: {len(rows)} command(s); a log needs at least two")
    bad = np.flatnonzero(~np.isfinite(found))
    if bad.size:
        raise source.error(int(rows[bad[0]]), COMMAND_TIME, f"{found[bad[0]]} is not a finite number; correct or cut the record")
    back = np.flatnonzero(np.diff(found) <= 0)
    if back.size:
        row = int(rows[back[0] + 1])
        raise source.error(
            row, COMMAND_TIME, f"time goes back: {found[back[0] + 1]:.9g} s after {found[back[0]]:.9g} s; sort or cut the commands"
        )
    if found[-1] <= time_s[0] or found[0] >= time_s[-1]:
        raise InputError(
            f"{source.table.path}, column {source.name(COMMAND_TIME)}: commands from {found[0]:.9g} to {found[-1]:.9g} s, and the IMU from "
            f"{time_s[0]:.9g} to {time_s[-1]:.9g} s: no command is within the IMU's time; bring both clocks to one epoch"
        )
    source.issued = rows
    return frozen(found)


def _sampled(source: LogTable, vehicle: Vehicle) -> tuple[bool, bool]:
    """Whether records of gyro and accelerometer are samples at their times: as the map or the vehicle file states."""
    made = source.table.made
    if made is not None and any(made.sampled):
        return made.sampled
    sampled = vehicle.imu.measures == "sample"
    increments = next((name for name in (*DELTA_THETA, *DELTA_V) if source.has(name)), None)
    if sampled and increments is not None:
        raise InputError(
            f'{source.table.path}, column {source.name(increments)}: an increment is over its record, and imu.measures is "sample"; '
            "leave imu.measures out, or log samples as gyro_x_rad_s … and accel_x_m_s2 …"
        )
    return sampled, sampled


class _Imu(NamedTuple):
    """What the IMU's columns hold."""

    theta: Array
    """(n, 3) rad"""
    velocity: Array
    """(n, 3) m/s"""
    rates: tuple[str, ...]
    """(3,) columns of the gyro."""
    forces: tuple[str, ...]
    axes: tuple[bool, ...]
    empty: tuple[str, ...]


def _imu(source: LogTable, vehicle: Vehicle, interval_s: Array) -> _Imu:
    """Read gyro and accelerometer, and check them; zeros of axes that are absent."""
    rates, forces = source.sensed(DELTA_THETA, GYRO), source.sensed(DELTA_V, ACCEL)
    theta, velocity = source.increments(rates, GYRO, interval_s), source.increments(forces, ACCEL, interval_s)
    axes, empty = _axes(source, vehicle, (*rates, *forces), (theta, velocity))
    if vehicle.estimator.method == "thesis" and not all(axes):
        raise InputError(
            f'{source.table.path}: estimator.method = "thesis" needs all three axes of gyro and accelerometer; take the default method'
        )
    _by_yaw(theta, vehicle, axes[:3])
    for names, increments in ((rates, theta), (forces, velocity)):
        _check_magnitude(source, names, increments, interval_s)
    if all(axes[3:]):
        _check_gravity(source, vehicle, velocity, interval_s)
    return _Imu(theta, velocity, rates, forces, axes, empty)


def _axes(
    source: LogTable, vehicle: Vehicle, names: Sequence[str], increments: tuple[Array, Array]
) -> tuple[tuple[bool, ...], tuple[str, ...]]:
    """Which IMU axes were logged, and columns without a reading; :class:`InputError` where a rate is needed and absent.

    On a table the rate about body Z alone is needed, and the other axes of a gyro may be empty; elsewhere one that shows no rate reads 0.
    """
    planar = vehicle.environment.kind == "planar"
    yaw = np.array(vehicle.imu.body_from_imu)[2]
    may_be_empty = [*(planar and abs(part) < YAW for part in yaw), True, True, True]
    logged = [source.has(name) for name in names]
    empty = [
        has and may and not one.any() for has, may, one in zip(logged, may_be_empty, (*increments[0].T, *increments[1].T), strict=True)
    ]
    axes = tuple(has and not none for has, none in zip(logged, empty, strict=True))
    missing = [name for name, has in zip(names, axes[:3], strict=False) if not has]
    if float((yaw[list(axes[:3])] ** 2).sum()) < 1 - YAW if planar else missing:
        needed = "the rate about body Z" if planar else 'all three axes of the gyro (only environment.kind = "planar" needs one alone)'
        raise InputError(
            f"{source.table.path}: column {source.name(missing[0])!r} is missing; a log needs {needed}. Add it, or map it under [columns] "
            "of the vehicle file"
        )
    return axes, tuple(name for name, none in zip(names, empty, strict=True) if none)


def _emptiness(source: LogTable, empty: Sequence[str]) -> list[Notice]:
    if not empty:
        return []
    said = (
        f"columns that are 0 in every row count as absent: {', '.join(map(source.name, empty))}; if the sensor works, correct its logging"
    )
    return [Notice("empty-columns", said)]


def _by_yaw(theta: Array, vehicle: Vehicle, logged: Sequence[bool]) -> None:
    """Gyro axes that are absent on a table show what the yaw makes of them: an IMU's Z may be a little askew. In place."""
    yaw, read = np.array(vehicle.imu.body_from_imu)[2], np.array(logged)
    if read.all():
        return
    for part in spill.parts(len(theta)):
        turned = theta[part][:, read] @ yaw[read] / (yaw[read] ** 2).sum()
        theta[part, ~read] = turned[:, None] * yaw[~read]


def _intervals(source: LogTable, time_s: Array, remedy: str = "") -> tuple[Array, list[Notice]]:
    if len(time_s) < 2:
        raise InputError(f"{source.table.path}: one row only; a log needs at least two control cycles")
    steps = np.diff(time_s)
    back = np.flatnonzero(steps <= 0)
    if back.size:
        row = int(back[0]) + 1
        verb = "stands still" if steps[back[0]] == 0 else "goes back"
        raise source.error(row, "time_s", f"time {verb}: {time_s[row]:.9g} s after {time_s[row - 1]:.9g} s; sort or cut the log{remedy}")
    usual = median(steps)
    gap = np.flatnonzero(steps > GAP * usual)
    if gap.size:
        row = int(gap[0]) + 1
        raise source.error(
            row,
            "time_s",
            f"a gap of {steps[gap[0]]:.6g} s after {time_s[row - 1]:.9g} s (median interval {usual:.6g} s); split the log there{remedy}",
        )
    long = np.flatnonzero(steps > LONG * usual)
    notices = []
    if long.size:
        row = int(long[0]) + 1
        notices.append(
            Notice(
                "long-interval",
                f"{long.size} record(s) longer than {LONG:g} times the median interval of {usual:.6g} s, the first at "
                f"{source.place(row)} ({steps[long[0]]:.6g} s); each counts with its own length. A record that was lost took its command "
                "with it: where values are contradicted, split the log there",
            )
        )
    interval_s = spill.empty(len(time_s))
    interval_s[0], interval_s[1:] = usual, steps
    return interval_s, notices


def _beyond(increments: Array, interval_s: Array, limit: float) -> BoolArray:
    """(n, 3) where increments over intervals (n,) are ``limit`` or more."""
    found = [np.abs(increments[part] / interval_s[part, None]) >= limit for part in spill.parts(len(increments))]
    return np.concatenate(found)


def _check_magnitude(source: LogTable, names: Sequence[str], increments: Array, interval_s: Array) -> None:
    bad = np.argwhere(_beyond(increments, interval_s, ABSURD))
    if bad.size:
        row, axis = (int(i) for i in bad[0])
        usual = median(interval_s)
        if interval_s[row] < AT_ONCE * usual:
            said = f"comes {interval_s[row]:.3g} s after the record before, where {usual:.6g} s are usual; is a record there twice?"
            raise source.error(row, "time_s", said)
        value = f"{increments[row, axis] / interval_s[row]:.3g} per second"
        raise source.error(row, names[axis], f"{value} is no motion of a vehicle; is the unit right, is it a spike?")


def _records_per_cycle(source: LogTable, time_s: Array, interval_s: Array, period_s: float) -> int:
    # times that were rounded have a median that is none of the intervals'
    usual = float(interval_s[interval_s <= LONG * median(interval_s)].mean())
    records = round(period_s / usual)
    if records < 1 or abs(records * usual / period_s - 1) > 0.2:
        raise InputError(
            f"{source.table.path}, column {source.name('time_s')}: a usual interval of {usual:.6g} s does not divide the control "
            f"cycle of {period_s:g} s; is time in seconds ([columns] can scale it), is cycle.period_s right?"
        )
    step = float(np.spacing(np.abs(time_s[[0, -1]]).max()))
    if step > COARSE * period_s:
        raise InputError(
            f"{source.table.path}, column {source.name('time_s')}: times this far from 0 have steps of {step:.2g} s, too coarse for a "
            f"control cycle of {period_s:g} s; take the log's beginning off"
        )
    return records


def _pace(cycle_s: Array, period_s: float) -> list[Notice]:
    """Whether cycles last as long by the recorded times (n,) as the vehicle file says, but for chance; long ones lost a record."""
    usual = cycle_s[cycle_s <= LONG * median(cycle_s)]
    lasts, chance = float(usual.mean()), 4 * float(usual.std()) / len(usual) ** 0.5
    if abs(lasts - period_s) <= PACE * period_s + chance:
        return []
    part = f"{100 * abs(lasts / period_s - 1):.2g} % {'longer' if lasts > period_s else 'shorter'}"
    message = (
        f"cycles last {lasts:.6g} s by the log's times, {part} than cycle.period_s = {period_s:g} s: inertia or mass may be off by as "
        f"much, or twice that; if the times are right, state cycle.period_s = {lasts:.6g}, else scale them by "
        f"{period_s / lasts:.6g} (columns.time_s.scale)"
    )
    return [Notice("cycle-period", message)]


def _check_gravity(source: LogTable, vehicle: Vehicle, velocity: Array, interval_s: Array) -> None:
    kind, gravity = vehicle.environment.kind, vehicle.environment.gravity_m_s2
    if kind == "free":
        return
    usual = median(np.concatenate([np.linalg.norm(velocity[part], axis=1) / interval_s[part] for part in spill.parts(len(velocity))]))
    if usual < FELT * gravity:
        remedy = f'state environment.kind = "free" instead of "{kind}", or log specific force without gravity taken off'
        if abs(usual / median(interval_s) / gravity - 1) < FELT:
            remedy = "its columns seem to hold increments, not rates: rename them, or scale them under [columns]"
        raise InputError(
            f"{source.table.path}: the accelerometer feels {usual:.3g} m/s^2 (median), and what stands on the ground feels gravity, "
            f"{gravity:.4g} m/s^2; {remedy}"
        )


def _check_outliers(source: LogTable, vehicle: Vehicle, time_s: Array, interval_s: Array) -> None:
    """Times of readings that are not to be used must be of records: what is left out would be none of them."""
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


def _attitude(source: LogTable, n: int) -> Array | None:
    """(n, 4) unit quaternions of the first rows; None where no row has one."""
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
    bad = np.flatnonzero((empty == 0) & ~(np.abs(norm - 1) <= OFF_UNIT))
    if bad.size:
        raise source.error(
            int(bad[0]), "quat_w", f"the quaternion's norm is {norm[bad[0]]:.4g}, not 1; quaternions are wxyz, world from body"
        )
    quaternion /= norm[:, None]
    return None if empty.all() else quaternion[:n]


def saturation(vehicle: Vehicle, theta: Array, velocity: Array, interval_s: Array) -> list[Notice]:
    """Warnings of a range that was reached; increments of angle [rad] and velocity [m/s] of each record, (n, 3), over its length (n,)."""
    found = []
    for name, increments, limit, unit in (
        ("gyro", theta, vehicle.imu.gyro_range_rad_s, "rad/s"),
        ("accelerometer", velocity, vehicle.imu.accel_range_m_s2, "m/s^2"),
    ):
        count = 0 if limit is None else int(_beyond(increments, interval_s, 0.999 * limit).any(1).sum())
        if count:
            found.append(
                Notice(
                    f"{name}-saturated",
                    f"{count} record(s) at the {name}'s range of {limit:g} {unit}; what they hid is not in the estimate",
                )
            )
    return found
