"""Validation of a telemetry table into a :class:`Log`. A record covers ``(previous time_s, time_s]``."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, frozen, median
from massprop_cli.base.dataclass import dataclass, sliced
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import commands, imurecords, lostrecords, pulses, stamps, supply
from massprop_cli.inputs.actuators.actuator import MomentumLog
from massprop_cli.inputs.columns import COMMAND_TIME, DELTA_THETA, DELTA_V, PULSE_JET
from massprop_cli.inputs.formats import agreement
from massprop_cli.inputs.logtable import GAP, LONG, LogTable
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.supply import SupplyLevel
from massprop_cli.inputs.tablefile import MapConversion, Table
from massprop_cli.inputs.vehicle import Vehicle

CommandKind = commands.CommandKind
COARSE = 1e-3
"""Maximum resolution of float64 times, as a fraction of a control cycle; at Unix times (1.7e9 s) the resolution is 2.4e-7 s."""
SATURATED = ("gyro-saturated", "accelerometer-saturated")
"""Codes of notices that a sensor reached its range."""
UNREAD = (*SATURATED, "sensor-frozen", "readings-held")
"""Codes of notices that a sensor's readings are not its measurements; massprop does not diagnose such logs."""
VOID = (*UNREAD, "cycle-period")
"""Codes of notices that invalidate all estimates and that massprop cannot correct."""
LONGEST_S = 0.06
"""Longest group of records if commands have their own times, s; short against the body's rotation, long against a pulse."""
PACE, CRYSTALS, CRYSTAL = 0.0025, 9e-5, 1e-5
"""Relative deviation of the recorded from the stated cycle length: limit for clocks without crystals, for two crystals, and for one
calibrated crystal. With increments and a wrench, inertia is proportional to its square."""
SHARED = 0.99
"""Minimum fraction of commands with time stamps of records for commands and records to count as on one clock."""
JITTER = 0.02
"""Maximum scatter of intervals over the median interval; each record counts with its own length, commands do not."""


@dataclass(frozen=True)
class Log:
    """A validated log: n IMU records, K control cycles of ``records_per_cycle`` records."""

    path: Path
    sha256: str
    rows: int
    records_per_cycle: int
    time_s: Array
    """(n,) end of each record, s."""
    interval_s: Array
    """(n,) length of each record, s."""
    delta_theta_imu_rad: Array
    """(n, 3) angle increments, IMU axes, rad."""
    delta_v_imu_m_s: Array
    """(n, 3) velocity increments (specific force), IMU axes, m/s."""
    command_kind: CommandKind
    command: Array
    """(K, jets) on-times, s; or (K, 6) mean torque about O [N m] and force [N], body axes; or (K, rotors) x of ``thrust_n``."""
    attitude_wxyz: Array | None
    """(n, 4) logged attitude at ``time_s``, world from body; NaN in records without one."""
    notices: tuple[Notice, ...]
    rate_columns: tuple[str, ...] = DELTA_THETA
    """(3,) standard names of the gyro columns."""
    force_columns: tuple[str, ...] = DELTA_V
    """(3,) standard names of the accelerometer columns."""
    axes: tuple[bool, ...] = (True,) * 6
    """(6,) logged IMU axes: gyro x y z, accelerometer x y z; increments of the other axes are zero."""
    empty: tuple[str, ...] = ()
    """Standard names of columns that are 0 in every row and count as absent."""
    made: MapConversion | None = None
    """Conversion from another recording by a map; None without a map."""
    ignored: BoolArray | None = None
    """(K, 2) cycles in which gyro or accelerometer are not used; None: all are used."""
    uncommanded: BoolArray | None = None
    """(K,) cycles whose command was lost; ``command`` holds an assumed value there."""
    spinning: tuple[MomentumLog, ...] = ()
    """Log of each device in :attr:`massprop_cli.inputs.vehicle.Vehicle.spinning`."""
    command_s: Array | None = None
    """(M,) issue time of each row of ``command`` on the commands' clock, s; None: the start of each control cycle, M = K."""
    sampled: tuple[bool, bool] = (False, False)
    """Whether a record of gyro or accelerometer is a sample (times its length) instead of the motion over the record."""
    cycles_apart: tuple[int, ...] = ()
    """Cycles between logged speeds of each rotor; 0 for a rotor with a logged command."""
    bends_s: tuple[float, ...] = ()
    """Time of each rotor's speed knots after the end of each cycle, s (:mod:`massprop_cli.prepare.tachometer`)."""
    supply: SupplyLevel | None = None
    """Supply pressure of jets or supply voltage of rotors; None: nominal throughout."""
    pace: float = 0.0
    """Recorded over stated cycle length, less 1; 0 if not significant."""
    began_s: float | None = None
    """Start of the whole log if this is a part of it, s; None: this is the whole log."""

    @property
    def cycles(self) -> int:
        """K, number of control cycles."""
        return len(self.time_s) // self.records_per_cycle

    def part(self, first: int, stop: int) -> Log:
        """Log of the control cycles from ``first`` to before ``stop``."""
        rows, cycles = slice(first * self.records_per_cycle, stop * self.records_per_cycle), slice(first, stop)
        return replace(
            self,
            **sliced(self, ("time_s", "interval_s", "delta_theta_imu_rad", "delta_v_imu_m_s", "attitude_wxyz"), rows),
            **sliced(self, ("ignored", "uncommanded"), cycles),
            **sliced(self, ("command", "command_s"), cycles if self.command_s is None else self._issued(first, stop)),
            spinning=tuple(one.part(rows) for one in self.spinning),
            began_s=self.origin_s,
        )

    @property
    def origin_s(self) -> float:
        """Start of the whole log, s."""
        return float(self.time_s[0] - self.interval_s[0]) if self.began_s is None else self.began_s

    def _issued(self, first: int, stop: int) -> slice:
        """Rows of commands issued in the cycles from ``first`` to before ``stop``."""
        assert self.command_s is not None
        edges = self.cycle_end_s[[first, stop - 1]]
        begin_s = edges[0] - float(self.interval_s[first * self.records_per_cycle : (first + 1) * self.records_per_cycle].sum())
        return slice(*np.searchsorted(self.command_s, [begin_s, edges[1]]).tolist())

    @property
    def command_start_s(self) -> Array:
        """(M,) issue time of each row of commands, s."""
        if self.command_s is not None:
            return self.command_s
        records = self.records_per_cycle
        return np.asarray(self.cycle_end_s - self.interval_s.reshape(-1, records).sum(1))

    @property
    def cycle_end_s(self) -> Array:
        """(K,) end of each control cycle, s."""
        return self.time_s[self.records_per_cycle - 1 :: self.records_per_cycle]


def jitter(interval_s: Array) -> float:
    """Robust sigma (scaled median absolute deviation) of the intervals (n,) over their median."""
    usual = median(interval_s)
    return stamps.ROBUST * median(np.abs(interval_s - usual)) / usual


def read(table: Table, vehicle: Vehicle) -> Log:
    """Validate a table. Raises :class:`InputError` with file, row (Parquet, from 0) or line (CSV), column, value and remedy."""
    whole = LogTable(table, vehicle.columns)
    source, duplicates = lostrecords.without_duplicates(lostrecords.without_lone_pulses(whole))
    recorded_s = source.required("time_s")
    stamped = stamps.examined(source, vehicle, recorded_s)
    source, time_s = lostrecords.with_lost_rows(source, stamped.time_s, vehicle)
    interval_s, notices = _intervals(source, time_s, stamped.remedy)
    rebuilt = [Notice("clock-rebuilt", f"{source.name('time_s')}: {stamped.message}")] if stamped.message else []
    pulsed = pulses.commands(whole, vehicle, float(time_s[0] - interval_s[0]), float(time_s[-1]))
    command_s = _command_times(source, time_s, recorded_s, stamped) if pulsed is None else pulsed.issued_s
    records, command_s, pace = _grouped(source, time_s, interval_s, command_s, vehicle.cycle.period_s)
    n = source.table.rows // records * records
    imu = imurecords.read(source, vehicle, time_s, interval_s)
    shown = imurecords.saturation(vehicle, imu.theta, imu.velocity, interval_s) + imurecords.held(imu, interval_s, table.made is None)
    kind, command = commands.commands(source, vehicle, records, n, pulsed)
    lost = lostrecords.lost_data(source, imu, command, records, n)
    attitude = imurecords.attitude(source, n)
    if table.made is not None:
        agreement.check(table.path, table.made, vehicle, imu.theta[:n], imu.velocity[:n] / interval_s[:n, None], attitude)
    return Log(
        path=table.path,
        sha256=table.sha256,
        rows=table.rows,
        records_per_cycle=records,
        time_s=frozen(time_s[:n]),
        interval_s=frozen(interval_s[:n]),
        delta_theta_imu_rad=frozen(imu.theta[:n]),
        delta_v_imu_m_s=frozen(imu.velocity[:n]),
        command_kind=kind,
        command=frozen(command),
        attitude_wxyz=None if attitude is None else frozen(attitude),
        notices=(*notices, *duplicates, *rebuilt, *pace.notices, *imurecords.empty_notice(source, imu.empty), *shown, *lost.notices),
        rate_columns=imu.rates,
        force_columns=imu.forces,
        axes=imu.axes,
        empty=imu.empty,
        ignored=lost.ignored,
        uncommanded=lost.uncommanded,
        made=table.made,
        command_s=command_s,
        sampled=imurecords.sampled(source, vehicle),
        spinning=commands.momentum(source, vehicle, records, n),
        cycles_apart=tuple(rotor.cycles_apart(source, records, n) for rotor in vehicle.rotors),
        supply=None if kind == "wrench" else supply.read(source, vehicle, time_s[:n], interval_s[:n], records),
        pace=pace.part,
    )


def _grouped(
    source: LogTable, time_s: Array, interval_s: Array, command_s: Array | None, period_s: float
) -> tuple[int, Array | None, _Pace]:
    """Records per control cycle (per group, if commands have their own times), command times within whole groups, and the pace."""
    if command_s is None:
        records = _records_per_cycle(source, time_s, interval_s, period_s)
        pace = _pace(records * interval_s, period_s)
    else:
        # records of a control cycle, or of an equal part of a long cycle
        usual_s = median(interval_s)
        records = max(round(period_s / usual_s / math.ceil(period_s / LONGEST_S)), 1)
        pace = _Pace(0.0, []) if source.has(PULSE_JET) else _pace(np.diff(command_s), period_s)
    if len(time_s) < 2 * records:
        raise InputError(
            f"{source.table.path}: {len(time_s)} rows of {median(interval_s):g} s are fewer than two control cycles of {period_s:g} s; "
            "record longer, or correct cycle.period_s"
        )
    if command_s is not None and source.issued is not None:
        source.issued = source.issued[source.issued < len(time_s) // records * records]
        command_s = command_s[: len(source.issued)]
    return records, command_s, pace


def _command_times(source: LogTable, time_s: Array, recorded_s: Array, stamped: stamps.Stamps) -> Array | None:
    """(M,) issue times of commands on the corrected clock, s; sets :attr:`LogTable.issued`. None without a column of command times."""
    if not source.has(COMMAND_TIME):
        return None
    issued_s = source.optional(COMMAND_TIME)
    rows = np.flatnonzero(~np.isnan(issued_s))
    found = issued_s[rows] - (0.0 if stamped.moved_s is None else stamped.moved_s[rows])
    if stamped.moved_s is None and (np.diff(recorded_s) > 0).all():
        # commands with the time stamps of records take the rebuilt times of these records
        row = np.minimum(np.searchsorted(recorded_s, found), len(recorded_s) - 1)
        same = recorded_s[row] == found
        found = np.where(same, stamped.time_s[row], found) if same.sum() > SHARED * len(same) else found
    if len(rows) < 2:
        raise InputError(f"{source.table.path}, column {source.name(COMMAND_TIME)}: {len(rows)} command(s); a log needs at least two")
    source.refuse(np.isinf(issued_s), COMMAND_TIME, lambda row: f"{issued_s[row]} is not a finite number; correct or cut the record")
    back = np.flatnonzero(np.diff(found) <= 0)
    if back.size:
        before_s, after_s = found[back[0] : back[0] + 2]
        text = f"time goes back: {after_s:.9g} s after {before_s:.9g} s; sort or cut the commands"
        raise source.error(int(rows[back[0] + 1]), COMMAND_TIME, text)
    if found[-1] <= time_s[0] or found[0] >= time_s[-1]:
        raise InputError(
            f"{source.table.path}, column {source.name(COMMAND_TIME)}: commands from {found[0]:.9g} to {found[-1]:.9g} s, and the IMU from "
            f"{time_s[0]:.9g} to {time_s[-1]:.9g} s: no command is within the IMU's time; bring both clocks to one epoch"
        )
    source.issued = rows
    return frozen(found)


def _intervals(source: LogTable, time_s: Array, remedy: str = "") -> tuple[Array, list[Notice]]:
    if len(time_s) < 2:
        raise InputError(f"{source.table.path}: one row only; a log needs at least two control cycles")
    steps = np.diff(time_s)
    back = np.flatnonzero(steps <= 0)
    if back.size:
        row = int(back[0]) + 1
        verb = "repeats" if steps[back[0]] == 0 else "goes back"
        raise source.error(row, "time_s", f"time {verb}: {time_s[row]:.9g} s after {time_s[row - 1]:.9g} s; sort or cut the log{remedy}")
    usual = median(steps)
    gap = np.flatnonzero(steps > GAP * usual)
    if gap.size:
        row = int(gap[0]) + 1
        text = f"a gap of {steps[gap[0]]:.6g} s after {time_s[row - 1]:.9g} s (median interval {usual:.6g} s); split the log there{remedy}"
        raise source.error(row, "time_s", text)
    long = np.flatnonzero(steps > LONG * usual)
    notices = []
    if long.size:
        text = (
            f"{long.size} record(s) longer than {LONG:g} times the median interval of {usual:.6g} s, the first at "
            f"{source.place(int(long[0]) + 1)} ({steps[long[0]]:.6g} s); each counts with its own length. A lost record also loses its "
            "command: if values are contradicted, split the log there"
        )
        notices.append(Notice("long-interval", text))
    interval_s = spill.empty(len(time_s))
    interval_s[0], interval_s[1:] = usual, steps
    return interval_s, notices


def _records_per_cycle(source: LogTable, time_s: Array, interval_s: Array, period_s: float) -> int:
    # the mean, because the median of rounded times is biased
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
            f"control cycle of {period_s:g} s; subtract the start time from all times"
        )
    return records


class _Pace(NamedTuple):
    """Deviation of the recorded from the stated cycle length."""

    part: float
    """Recorded over stated cycle length, less 1; 0 if not significant."""
    notices: list[Notice]


def _pace(cycle_s: Array, period_s: float) -> _Pace:
    """Deviation of the recorded cycle lengths (n,) from ``period_s``; cycles with a lost record are left out."""
    usual = cycle_s[cycle_s <= LONG * median(cycle_s)]
    lasts, chance = float(usual.mean()), 4 * float(usual.std()) / len(usual) ** 0.5 / period_s
    longer = lasts / period_s - 1
    if abs(longer) <= CRYSTAL + chance:
        return _Pace(0.0, [])
    if abs(longer) <= CRYSTALS + chance:
        return _Pace(longer, [])
    void = abs(longer) > PACE + chance
    message = (
        f"cycles last {lasts:.6g} s by the log's times, {100 * abs(longer):.2g} % {'longer' if longer > 0 else 'shorter'} than "
        f"cycle.period_s = {period_s:g} s: inertia or mass may be off by as much, or twice that{'' if void else ' (sigmas include this)'}; "
        f"if the times are right, state cycle.period_s = {lasts:.6g}, else scale them by {period_s / lasts:.6g} (columns.time_s.scale)"
    )
    return _Pace(longer, [Notice("cycle-period" if void else "cycle-pace", message)])
