"""Assembly of control cycles from records as they arrive."""

import math
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, median
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import ACCEL, DELTA_THETA, DELTA_V, GYRO
from massprop_cli.inputs.imurecords import ABSURD
from massprop_cli.inputs.logtable import GAP, LONG
from massprop_cli.live.records import Record, RecordError, StreamColumns

STARTS, SPAN = 3, 1.5
"""Smallest span of the first records, which determine the number of records per cycle: intervals, and control cycles."""
LOST = 3.5
"""Smallest length of three consecutive intervals that contain a lost record, in usual intervals; jitter gives less."""


class RecordedCycle(NamedTuple):
    """One control cycle."""

    end_s: float
    """End of the cycle, s."""
    numbers: Array
    """Kernel inputs (:func:`massprop_cli.estimate.kernelflight.cycles_of`)."""
    command_lost: bool = False
    """Whether the record before it, and with it a command, is missing."""


class CycleAssembler:
    """Assembler of control cycles from records; the median of the first intervals gives the number of records per cycle."""

    def __init__(self, columns: StreamColumns, period_s: float) -> None:
        self.columns, self.period_s = columns, period_s
        self.usual_s = 0.0
        """Usual interval of the records, s."""
        self.records = 0
        """Records per cycle; 0 until it is known."""
        self.ended = False
        """Whether no further cycle can follow."""
        self._first: list[Record] = []
        """Records before their number per cycle is known."""
        self._last_s = -math.inf
        self._current: list[tuple[Record, float]] = []
        """Records of the incomplete cycle, with their intervals, s."""
        self._lengths = [1.0, 1.0, 1.0]
        """Lengths of the last three cycles, in usual intervals."""

    def add(self, record: Record) -> list[RecordedCycle]:
        """Add a record and return the cycles that it completes.

        Raise :class:`RecordError` if the record is invalid, and :class:`InputError` if the recording is.
        """
        interval = record.time_s - self._last_s
        if not interval > 0:
            raise RecordError(f"time {record.time_s:.9g} s does not come after {self._last_s:.9g} s")
        if self.ended:
            return self.end(record.time_s)
        if self._first or self.records:
            absurd = self._absurd(record, interval)
            if absurd:
                raise RecordError(absurd)
        else:
            uncommanded = next((name for name in self.columns.commands if math.isnan(record.numbers[name])), None)
            if uncommanded is not None:
                raise RecordError(f"no {uncommanded}; the recording begins with the first record that has all commands (0 for none)")
        if self.records:
            return self._next(record, interval)
        self._first.append(record)
        self._last_s = record.time_s
        enough = len(self._first) > STARTS and record.time_s - self._first[0].time_s > SPAN * self.period_s
        return self.start() if enough else []

    def end(self, time_s: float) -> list[RecordedCycle]:
        """End the recording; further records must be later than ``time_s``."""
        self.ended, self._last_s = True, time_s
        return []

    def start(self) -> list[RecordedCycle]:
        """Determine the number of records per cycle, and return the cycles of the first records; none from a single record."""
        first, self._first = self._first, []
        if len(first) < 2:
            return []
        steps = np.diff([record.time_s for record in first])
        self._set_records(median(steps))
        absurd = self._absurd(first[0], self.usual_s)
        if absurd:
            raise InputError(f"standard input: the first record: {absurd}; begin a new recording")
        try:
            cycles = self._added(first[0], self.usual_s)
            for record, interval in zip(first[1:], map(float, steps), strict=True):
                cycles += self._next(record, interval)
        except RecordError as error:  # too late to leave the record out: it is in the recording
            raise InputError(f"standard input: {error}") from None
        return cycles

    def _next(self, record: Record, interval: float) -> list[RecordedCycle]:
        """Cycles that a record completes; ``interval`` [s] is the time since the record before."""
        self._check_gap(record, interval)
        cycles = self._added(record, interval)
        self._last_s = record.time_s
        return cycles

    def _absurd(self, record: Record, interval: float) -> str:
        """Message of an increment larger than any vehicle's in that time; empty without one."""
        increments = (*(() if self.columns.rates else DELTA_THETA), *(() if self.columns.accelerations else DELTA_V))
        for name in increments:
            if abs(record.numbers[name]) > ABSURD[name] * interval:
                return f"column {name}: {record.numbers[name] / interval:.3g} per second is too fast for a vehicle"
        return ""

    def _set_records(self, interval: float) -> None:
        """Set the number of records per cycle from the usual interval [s]; raise :class:`InputError` if it does not divide the cycle."""
        records = round(self.period_s / interval)
        if records < 1 or abs(records * interval / self.period_s - 1) > 0.2:
            raise InputError(
                f"standard input: the usual interval of the first records, {interval:.6g} s, does not divide the control cycle of "
                f"{self.period_s:g} s; is time in seconds ([columns] can scale it), is cycle.period_s right?"
            )
        self.usual_s, self.records = interval, records

    def _check_gap(self, record: Record, interval: float) -> None:
        """Raise :class:`InputError` after a gap that the estimate cannot bridge."""
        most = GAP if self.records == 1 else LONG
        if interval > most * self.usual_s:
            lost = "" if self.records == 1 else f", so a cycle of {self.records} records would lack one"
            raise InputError(
                f"standard input: {interval:.6g} s without a record before {record.time_s:.9g} s (the usual interval is "
                f"{self.usual_s:.6g} s{lost})"
            )

    def _added(self, record: Record, interval: float) -> list[RecordedCycle]:
        """Add a record to the current cycle, and return the cycle if it is complete; raise an error for an unclear command."""
        first = self._current[0][0] if self._current else record
        for name in self.columns.commands:
            value = record.numbers[name]
            if first is record and math.isnan(value):
                missing = f"no {name} in the first record of its control cycle, {record.time_s:.9g} s; write 0 for none"
                # a cycle of one record can be left out; one of several records would be incomplete
                raise RecordError(missing) if self.records == 1 else InputError(f"standard input: {missing}")
            if not math.isnan(value) and value != first.numbers[name]:
                raise InputError(
                    f"standard input: {name} changes within a control cycle, at {record.time_s:.9g} s; commands change at cycle starts "
                    "only: check cycle.period_s and the first record"
                )
        self._current.append((record, interval))
        if len(self._current) < self.records:
            return []
        records, self._current = self._current, []
        return [self._cycle(records)]

    def _cycle(self, records: list[tuple[Record, float]]) -> RecordedCycle:
        """The cycle of these records with their intervals [s]."""
        columns, last = self.columns, records[-1][0]
        theta = _increment(records, GYRO if columns.rates else DELTA_THETA, columns.rates)
        velocity = _increment(records, ACCEL if columns.accelerations else DELTA_V, columns.accelerations)
        commands = [records[0][0].numbers[name] for name in columns.commands] + [last.numbers[name] for name in columns.speeds]
        length = float(np.array([interval for _, interval in records]).sum())
        self._lengths = [*self._lengths[-2:], length / self.usual_s]
        command_lost = self.records == 1 and self._lengths[-2] > LONG and sum(self._lengths) > LOST
        return RecordedCycle(last.time_s, np.array([last.time_s, length, *theta, *velocity, 0.0, 0.0, 0.0, *commands]), command_lost)


def _increment(records: list[tuple[Record, float]], names: tuple[str, ...], rates: bool) -> Array:
    """(n,) sum of increments over the records; ``rates``: the columns are rates, which the intervals [s] multiply."""
    each = np.array([[record.numbers[name] * (interval if rates else 1.0) for name in names] for record, interval in records])
    return np.asarray(each.sum(0))
