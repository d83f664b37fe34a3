"""Records that a recorder lost: missing rows, empty cells, repeated readings, or zeros.

Lost records are restored, so that control cycles keep their length and commands act at their times. Their readings count as unknown. Their
command also does if no other record of the cycle has it: an impulse up to the largest of the log.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, median
from massprop_cli.base.lazy import pa
from massprop_cli.inputs.columns import ACCEL, COMMAND_TIME, DELTA_THETA, DELTA_V, GYRO, PULSE, TIME, WRENCH, is_jet
from massprop_cli.inputs.imurecords import ImuRecords
from massprop_cli.inputs.logtable import LONG, MISSING, WHOLE, LogTable, interpolate
from massprop_cli.inputs.marked import contain_both, repeated, zeros
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.tablefile import Cells
from massprop_cli.inputs.vehicle import Vehicle

SHARE = 0.25
"""Maximum fraction of lost records."""
HELD = 0.9
"""Minimum fraction of rows with a command for a command that is in each row of its cycle."""
MAX_DELAY = 0.5
"""Maximum delay of a repeated record's time stamp, in records."""
ENOUGH, MOSTLY = 4, 0.9
"""Minimum number of commands that show the start of cycles, and minimum fraction that agree, because a first row may be lost."""


def without_lone_pulses(source: LogTable) -> LogTable:
    """Log without rows that have a pulse but no record."""
    if not any(source.has(name) for name in PULSE) or not source.has(TIME):
        return source
    own = [source.optional(name) for name in (TIME, *DELTA_THETA, *DELTA_V, *GYRO, *ACCEL) if source.has(name)]
    rows = np.flatnonzero(~np.isnan(own).all(0))
    return source if len(rows) == source.table.rows else _of_rows(source, rows)


def without_duplicates(source: LogTable) -> tuple[LogTable, list[Notice]]:
    """Log without duplicate rows: all cells equal those of the previous row, and the time stamp is at most ``SOON`` later."""
    steps = np.diff(source.required("time_s"))
    again = np.flatnonzero((steps >= 0) & (steps <= MAX_DELAY * (median(steps) if len(steps) else 0.0))) + 1
    others = (cells.read() for name, cells in source.table.columns.items() if name != source.name("time_s"))
    if not len(again) or not all(column.take(again).equals(column.take(again - 1)) for column in others):
        return source, []
    rows = np.delete(np.arange(source.table.rows), again)
    message = f"{source.name('time_s')}: {len(again)} row(s) repeat the row before, the first at {source.place(int(again[0]))}; left out"
    return _of_rows(source, rows), [Notice("clock-rebuilt", message)]


def with_lost_rows(source: LogTable, time_s: Array, vehicle: Vehicle) -> tuple[LogTable, Array]:
    """Log with missing rows restored (also before its first row), and times (N,) of all rows; unchanged if too many are missing."""
    steps = np.diff(time_s)
    usual = median(steps) if len(steps) else 0.0
    if not usual > 0 or _loses_commands(source) or any(one.column == "torque" for one in vehicle.wheels):
        return source, time_s
    count = np.where(steps > LONG * usual, np.round(steps / usual) - 1, 0)
    off = np.abs(steps / usual - count - 1) > WHOLE
    per_cycle = max(round(vehicle.cycle.period_s / usual), 1)
    if (off & (count > 0)).any() or count.max() > MISSING * per_cycle or count.sum() > SHARE * len(time_s):
        return source, time_s
    place = np.append(0, np.cumsum(count + 1)).astype(int)
    ahead = 0 if source.has(COMMAND_TIME) else -_first_cycle(source, place, per_cycle) % per_cycle
    if (not count.any() and not ahead) or (count.any() and _cover_gaps(source, np.flatnonzero(count) + 1)):
        return source, time_s
    rows = np.append(np.zeros(ahead, dtype=int), np.repeat(np.arange(len(time_s)), np.append(0, count).astype(int) + 1))
    lost = np.ones(len(rows), dtype=bool)
    lost[ahead + place] = False
    times = np.interp(np.arange(len(rows)) - ahead, place, time_s)
    times[:ahead] -= usual * np.arange(ahead, 0, -1)
    return _of_rows(source, rows, lost), times


def _loses_commands(source: LogTable) -> bool:
    """Whether lost rows may have contained unique commands: pulses, or commands at irregular times."""
    if not source.has(COMMAND_TIME):
        return any(source.has(name) for name in PULSE)
    stamps = source.optional(COMMAND_TIME)
    steps = np.diff(stamps[np.isfinite(stamps)])
    return not len(steps) or bool(steps.max() > LONG * median(steps))


def _cover_gaps(source: LogTable, rows: IntArray) -> bool:
    """Whether increments after missing rows contain the whole time, because a tool computed them from rates and times."""
    sensors = [np.stack([source.optional(name) for name in own], 1) for own in (DELTA_THETA, DELTA_V) if all(map(source.has, own))]
    return contain_both([np.nan_to_num(one) for one in sensors], rows, 1)


def _first_cycle(source: LogTable, place: IntArray, per_cycle: int) -> int:
    """Number of records from the first one to the next start of a control cycle, from rows in which commands occur or change; else 0."""
    residues: list[int] = []
    for name in source.logged if per_cycle > 1 else ():
        if not (name in WRENCH or is_jet(name)):
            continue
        values = source.optional(name)
        known = np.flatnonzero(~np.isnan(values))
        if len(known) > HELD * len(values):
            known = known[1:][np.diff(values[known]) != 0]
        residues += (place[known] % per_cycle).tolist()
        if len(residues) >= ENOUGH:
            break
    if len(residues) < ENOUGH:
        return 0
    most = int(np.bincount(residues).argmax())
    return most if np.mean(np.array(residues) == most) > MOSTLY else 0


def _of_rows(source: LogTable, rows: IntArray, lost: BoolArray | None = None) -> LogTable:
    """Log with the given rows, empty where ``lost``; a lost row has the place of the next one."""

    def place(row: int) -> str:
        return source.place(int(rows[row]))

    def taken(cells: Cells) -> object:
        return cells.read().take(pa.array(rows, mask=lost))

    columns = {name: replace(cells, read=partial(taken, cells), place=place) for name, cells in source.table.columns.items()}
    return LogTable(replace(source.table, columns=columns, rows=len(rows), place=place), source.columns, lost)


class LostData(NamedTuple):
    """Lost readings and commands by control cycle; None without any."""

    ignored: BoolArray | None
    """(K, 2) cycles whose gyro or accelerometer is not used."""
    uncommanded: BoolArray | None
    """(K,) cycles with unknown command."""
    notices: list[Notice]


def lost_data(source: LogTable, imu: ImuRecords, command: Array, records: int, n: int) -> LostData:
    """Lost readings and commands (K, C) in cycles of ``records`` records; interpolates lost readings in ``imu``."""
    lost = np.zeros(n, dtype=bool) if source.lost is None else source.lost[:n]
    both = (imu.theta[:n], imu.velocity[:n])
    each = zip(*((one.empty, one.filled, zeros(one)) for one in imu.missing_readings), strict=True)
    empty, filled, zero = (np.stack([part[:n] for part in parts], 1) for parts in each)
    same = np.stack([(repeated([one]) | repeated(imu.missing_readings))[:n] for one in imu.missing_readings], 1)
    for own in [[0, 1]] if (zero[:, 0] == zero[:, 1]).all() else [[0], [1]]:
        if contain_both([both[i] for i in own], np.flatnonzero(zero[:, own[0]]) + 1, 2):
            zero[:, own] = False
    few = MISSING * records
    if n > few:
        blind: BoolArray = np.asarray(np.lib.stride_tricks.sliding_window_view(empty[:, 0], few + 1).all(1))
        message = f"more than {few} records in a row have no gyro reading, so the rotation is unknown; split the log there"
        source.refuse(blind, (imu.rates or DELTA_THETA)[0], lambda _: message)
    kinds = (
        ("missing", lost[:, None]),
        ("with empty cells", empty & ~filled),
        ("with a fill value", filled),
        ("that repeat the one before", same),
        ("of zeros", zero),
    )
    found = [f"{int(rows.any(1).sum())} {what}" for what, rows in kinds if rows.any()]
    if not found:
        return LostData(None, None, [])
    readings = lost[:, None] | empty | same | zero
    for increments, rows in zip(both, readings.T, strict=True):
        for axis in increments.T:
            axis[:] = interpolate(axis, rows)
    uncommanded = np.zeros(n // records, dtype=bool) if source.uncommanded is None else source.uncommanded
    if records == 1 and source.issued is None:
        uncommanded = uncommanded | (same.all(1) & (np.diff(command, axis=0, prepend=np.nan) == 0).all(1))
    also = f", nor the commands of {int(uncommanded.sum())} control cycle(s) in them" if uncommanded.any() else ""
    first = source.place(int(np.argmax(readings.any(1))))
    message = f"records lost: {', '.join(found)}, the first at {first}; massprop does not use their readings{also}"
    return LostData(readings.reshape(-1, records, 2).any(1), uncommanded, [Notice("records-lost", message)])
