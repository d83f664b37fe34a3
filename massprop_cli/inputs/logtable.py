"""Columns of a log table by standard name, with the log's own names and scales."""

import difflib
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, IntArray, cubic, median
from massprop_cli.base.configfile import nearest
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import COMMAND_TIME, FIXED, TIME, Column
from massprop_cli.inputs.marked import MissingReadings, fill_values
from massprop_cli.inputs.section import LEAST
from massprop_cli.inputs.tablefile import Table

ALIKE = 0.75
"""Minimum ratio of matching characters (:mod:`difflib`) of a misspelt column name."""
SENSORS = "acc(?:el(?:eration|erometer)?)?|delta_?v|gyro?(?:scope)?|delta_?theta|omega"
"""Parts of IMU column names in other programs."""
GAP, LONG = 2.5, 1.5
"""Interval over the median interval above which it is a gap, or contains a lost record."""
MISSING = 5
"""Maximum number of successive missing control cycles; the motion in more is unknown."""
WHOLE = 0.25
"""Tolerance of a whole number of usual intervals, in usual intervals; such an interval contains lost records."""
HELD, SELDOM = 10, 0.1
"""Minimum number of repeated values for a slower recorder, and maximum fraction of values in a single row."""
EMPTY = 0.05
"""Maximum fraction of empty cells of a sensor."""


def interpolate(values: Array, unknown: BoolArray | None) -> Array:
    """(n,) values, with ``unknown`` ones interpolated linearly; changes ``values``."""
    if unknown is not None and unknown.any() and not unknown.all():
        rows = np.arange(len(values))
        values[unknown] = np.interp(rows[unknown], rows[~unknown], values[~unknown])
    return values


def resembles(column: str, other: str) -> bool:
    """Whether another name resembles an IMU column: misspelt, or with a sensor and the same axis in it."""
    axis = re.search("_([xyz])_", column)
    named = axis and re.search(rf"(?:{SENSORS})(?:.*[^a-z])?{axis[1]}(?![a-z])|(?:^|_)[agw]_?{axis[1]}(?![a-z])", other.lower())
    return bool(named) or difflib.SequenceMatcher(None, column, other.lower()).ratio() >= ALIKE


class LogTable:
    """Table with columns by standard name, under the log's own names and scales."""

    def __init__(self, table: Table, columns: Mapping[str, Column], lost: BoolArray | None = None) -> None:
        self.table, self.columns, self.place = table, columns, table.place
        self.issued: IntArray | None = None
        """(M,) rows of commands with time stamps of their own (:data:`massprop_cli.inputs.columns.COMMAND_TIME`)."""
        self.lost = lost
        """(n,) rows that the recorder lost (:mod:`massprop_cli.inputs.lostrecords`); their cells are empty."""
        self.uncommanded: BoolArray | None = None
        """(K,) control cycles whose commands are lost."""
        for known, column in columns.items():
            if column.from_ not in table.columns:
                hint = nearest(column.from_, table.columns, "the nearest column is")
                raise InputError(f"{table.path}: column {column.from_!r} is missing, which [columns] maps to {known}{hint}")

    def name(self, column: str) -> str:
        """Column name in this log."""
        mapped = self.columns.get(column)
        return mapped.from_ if mapped else column

    @property
    def logged(self) -> list[str]:
        """All columns; mapped ones by standard name."""
        mapped = {column.from_: name for name, column in self.columns.items()}
        return [mapped.get(name, name) for name in self.table.columns]

    def has(self, column: str) -> bool:
        """Whether the log has the column."""
        return self.name(column) in self.table.columns

    def error(self, row: int, column: str, problem: str) -> InputError:
        """Error about a cell."""
        return InputError(f"{self.table.path}, {self.place(row)}, column {self.name(column)}: {problem}")

    def refuse(self, bad: BoolArray, column: str, problem: Callable[[int], str]) -> None:
        """Raise :class:`InputError` for the first ``bad`` row (n,) of a column."""
        if bad.any():
            row = int(np.argmax(bad))
            raise self.error(row, column, problem(row))

    def optional(self, column: str) -> Array:
        """Column with scale; NaN for null. Raises :class:`InputError` if it is missing."""
        name = self.name(column)
        if name not in self.table.columns:
            spare = self._unused()
            hint = nearest(name, spare, "the nearest unused column is")
            remedy = "rename it, or map it under [columns] of the vehicle file, or add it" if spare else "add it"
            remedy += ", with 0 in each row if that jet never fired" * name.startswith("jet_")
            remedy += ", with 0 in each row if none is commanded along that axis" * name.startswith("cmd_")
            raise InputError(f"{self.table.path}: column {name!r} is missing{hint}; {remedy}")
        numbers: Array = self.table.columns[name].numbers()
        scaled = np.multiply(numbers, self.columns[column].scale if column in self.columns else 1.0, out=spill.empty(len(numbers)))
        # values whose squares underflow are computed zeros
        scaled[(scaled < LEAST) & (scaled > -LEAST)] = 0.0
        return scaled

    def required(self, column: str) -> Array:
        """Column with scale, interpolated in lost rows. Raises :class:`InputError` for a cell that is not a finite number."""
        values = interpolate(self.optional(column), self.lost)
        problem = "is not a finite number; correct or cut the record"
        self.refuse(~np.isfinite(values), column, lambda row: f"{values[row]} {problem}".replace("nan", "nan or an empty cell", 1))
        return values

    def readings(self, column: str, marked: MissingReadings) -> Array:
        """Column of a sensor; a few empty cells are interpolated and recorded in ``marked``."""
        values = self.optional(column)
        filled = fill_values(values, self.columns[column].scale if column in self.columns else 1.0)
        values[filled] = np.nan
        none = np.isnan(values)
        if np.isinf(values).any() or np.sum(none if self.lost is None else none & ~self.lost) > EMPTY * len(values):
            return self.required(column)
        marked.add(values, self.lost, filled)
        return interpolate(values, none)

    def increments(self, columns: Sequence[str], rates: Sequence[str], interval_s: Array) -> tuple[Array, MissingReadings]:
        """(n, 3) increments (``rates`` times interval; 0 for absent axes), and the missing readings."""
        found, marked = spill.empty(self.table.rows, len(columns)), MissingReadings(self.table.rows)
        for axis, column in enumerate(columns):
            values = self.readings(column, marked) if self.has(column) else None
            for part in spill.parts(len(found)):
                found[part, axis] = 0.0 if values is None else values[part] * interval_s[part] if column in rates else values[part]
        return found, marked

    def sensed(self, names: Sequence[str], rates: Sequence[str]) -> tuple[str, ...]:
        """(3,) column of each axis, increments before rates. Raises :class:`InputError` if another column resembles an absent one."""
        found = tuple(rate if self.has(rate) and not self.has(name) else name for name, rate in zip(names, rates, strict=True))
        absent = [column for column in found if not self.has(column)]
        like = next(((name, other) for name in absent for other in self._unused() if resembles(name, other)), None)
        if like is not None:
            remedy = "rename it, or map it under [columns] of the vehicle file; if it is not an IMU reading, leave it out of the log"
            raise InputError(f"{self.table.path}: column {like[0]!r} is missing; the nearest unused column is {like[1]!r}; {remedy}")
        return found

    def _unused(self) -> list[str]:
        """Columns without a meaning so far."""
        used = {self.name(known) for known in FIXED if self.has(known)}
        return [present for present in self.table.columns if present not in used and not present.startswith("jet_")]

    def per_cycle(self, column: str, records: int, n: int) -> Array:
        """(K,) command in the first row of each cycle. Raises :class:`InputError` unless other rows are null or equal."""
        values = self.optional(column)[:n]
        if self.issued is not None:
            return self._of_issued(column, values)
        self.refuse(np.isinf(values), column, lambda row: f"{values[row]} is not a finite number; correct or cut the record")
        grid = values.reshape(-1, records)
        first = grid[:, 0] if self.lost is None else self._first(grid, self.lost[:n].reshape(-1, records))
        every = np.repeat(first, records)
        self.refuse(np.isnan(every), column, lambda row: self._uncommanded(row, values, records))
        held = (
            "differs from {:g} in the first row of its control cycle; commands change at cycle starts only: check cycle.period_s and the "
            "first row"
        )
        differs = ~np.isnan(values) & (values != every)
        self.refuse(differs, column, lambda row: f"{values[row]:g} {held.format(every[row])}{self._lost_record(row)}")
        return np.ascontiguousarray(first)

    def _uncommanded(self, row: int, values: Array, records: int) -> str:
        """Reason why the first row of a cycle has no command: none was written, or only the clock stepped."""
        missing, stepped = "no command in the first row of its control cycle", self._clock_step(row)
        if not stepped:
            return f"{missing}; write one (0 for none){self._lost_record(row)}"
        assert self.lost is not None
        intervals = np.diff(np.flatnonzero(~np.isnan(values[~self.lost[: len(values)]])))
        whole = f" (commands come every {records} rows, as if no record is missing)" if (intervals == records).all() else ""
        return (
            f"{missing}: {stepped}. Is a record missing there? If not{whole}, the clock stepped: state imu.clock_even = true. If one is "
            "missing, write a command in the first row of each cycle (0 for none)"
        )

    def _clock_step(self, row: int) -> str:
        """Text on the last long interval before a row in which lost rows were restored; empty without one."""
        if self.lost is None:
            return ""
        recorded = np.flatnonzero(~self.lost)
        own = recorded[: np.searchsorted(recorded, row) + 1]
        long = np.flatnonzero(np.diff(own) > 1)
        if not len(long):
            return ""
        time_s, before, at = self.required(TIME), own[long[-1]], own[long[-1] + 1]
        step, usual = time_s[at] - time_s[before], median(np.diff(time_s[recorded]))
        return f"the time increases by {step:.6g} s at {self.place(int(at))}, not by {usual:.6g} s"

    def _first(self, grid: Array, lost: BoolArray) -> Array:
        """(K,) command of each cycle (K, records); for a lost first row that of another row, or else of the cycle before."""
        cycles = np.arange(len(grid))
        first = np.where(lost[:, 0], grid[cycles, np.argmax(~np.isnan(grid), 1)], grid[:, 0])
        unknown = lost[:, 0] & np.isnan(first)
        known = np.maximum.accumulate(np.where(unknown, 0, cycles))
        self.uncommanded = unknown if self.uncommanded is None else self.uncommanded | unknown
        return np.where(unknown, np.nan_to_num(first[known]), first)  # 0 before the first command

    def _of_issued(self, column: str, values: Array) -> Array:
        """(M,) commands in rows with a command time. Raises :class:`InputError` unless all other cells are empty."""
        assert self.issued is not None
        issued, own = np.zeros(len(values), dtype=bool), self.name(COMMAND_TIME)
        issued[self.issued] = True
        self.refuse(issued & ~np.isfinite(values), column, lambda _: f"no command in a row with {own}; write one (0 for none)")
        self.refuse(~issued & np.isfinite(values), column, lambda row: f"{values[row]:g} has no {own} in its row; state when it was issued")
        return values[self.issued]

    def _lost_record(self, row: int) -> str:
        """Text on a lost record before a row, which shifts all later cycles; empty without one."""
        if stepped := self._clock_step(row):
            return f"; or {stepped}: if no record is missing there, state imu.clock_even = true"
        steps = np.diff(self.required(TIME)[: row + 1])
        long = np.flatnonzero(steps > LONG * median(steps)) if len(steps) else steps
        if not len(long):
            return ""
        at = int(long[0]) + 1
        return f"; or a record was lost before {self.place(at)}, {steps[at - 1]:.6g} s after the one above it: split the log there"

    def interpolated(self, column: str, n: int) -> Array:
        """(n,) column with cubic interpolation between its samples (:meth:`samples`)."""
        time_s, rows = self.required(TIME)[:n], self.samples(column, n)
        values = self.optional(column)[:n]
        return values if len(rows) == n else cubic(time_s, time_s[rows], values[rows])

    def samples(self, column: str, n: int) -> IntArray:
        """Rows with a sample: not empty, and not a repetition by a slower recorder."""
        values = self.optional(column)[:n]
        rows = np.flatnonzero(~np.isnan(values))
        if np.isinf(values).any() or not rows.size:
            self.required(column)
        changed = np.flatnonzero(np.diff(values[rows], prepend=np.nan))
        held = np.diff(changed)
        if len(held) < HELD or np.quantile(held, SELDOM) < 2:
            return rows
        # a longer repetition is an unchanged value at the usual sample rate
        since = np.arange(len(rows)) - changed[np.searchsorted(changed, np.arange(len(rows)), "right") - 1]
        return np.asarray(rows[since % int(np.median(held)) == 0])

    def ends(self, column: str, records: int, n: int) -> Array:
        """(K,) value at the end of each cycle, interpolated as in :meth:`interpolated`."""
        values = self.interpolated(column, n)
        return values[records - 1 :: records] if self.issued is None else values[np.append(self.issued[1:], n) - 1]
