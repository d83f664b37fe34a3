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
"""Least span of the first records that determine the number of records per cycle: intervals, and control cycles."""
LOST = 3.5
"""Least length of three consecutive intervals around a lost record, in usual intervals; jitter of the time stamps gives less."""


class RecordedCycle(NamedTuple):
    """One control cycle."""

    end_s: float
    numbers: Array
    """Kernel inputs (:func:`massprop_cli.estimate.kernelflight.cycles_of`)."""
    lacking: bool = False
    """Whether a record with an unknown command is missing before it."""


class Gatherer:
    """Assembles cycles from records; their number per cycle follows from the median of the first intervals, which jitter hardly changes."""

    def __init__(self, columns: StreamColumns, period_s: float) -> None:
        self.columns, self.period_s = columns, period_s
        self.usual_s = 0.0
        self.records = 0
        """Records per cycle; 0 until it is known."""
        self.ended = False
        """Whether no further cycle can follow."""
        self._begun: list[Record] = []
        self._last_s = -math.inf
        self._own: list[tuple[Record, float]] = []
        self._lengths = [1.0, 1.0, 1.0]

    def add(self, record: Record) -> list[RecordedCycle]:
        """Cycles that a record completes; :class:`RecordError` if the record is invalid, :class:`InputError` if the recording is."""
        interval = record.time_s - self._last_s
        if not interval > 0:
            raise RecordError(f"time {record.time_s:.9g} s does not come after {self._last_s:.9g} s")
        if self.ended:
            return self.end(record.time_s)
        if self._begun or self.records:
            absurd = self._absurd(record, interval)
            if absurd:
                raise RecordError(absurd)
        else:
            uncommanded = next((name for name in self.columns.commands if math.isnan(record.numbers[name])), None)
            if uncommanded is not None:
                raise RecordError(f"no {uncommanded}; the recording begins with the first record that has all commands (0 for none)")
        if self.records:
            return self._next(record, interval)
        self._begun.append(record)
        self._last_s = record.time_s
        told = len(self._begun) > STARTS and record.time_s - self._begun[0].time_s > SPAN * self.period_s
        return self.started() if told else []

    def end(self, time_s: float) -> list[RecordedCycle]:
        """End the recording; further records must be later than ``time_s``."""
        self.ended, self._last_s = True, time_s
        return []

    def started(self) -> list[RecordedCycle]:
        """Cycles of the first records; none from a single record."""
        begun, self._begun = self._begun, []
        if len(begun) < 2:
            return []
        steps = np.diff([record.time_s for record in begun])
        self._counted(median(steps))
        absurd = self._absurd(begun[0], self.usual_s)
        if absurd:
            raise InputError(f"standard input: the first record: {absurd}; begin a new recording")
        try:
            made = self._added(begun[0], self.usual_s)
            for record, interval in zip(begun[1:], map(float, steps), strict=True):
                made += self._next(record, interval)
        except RecordError as error:  # they have been kept
            raise InputError(f"standard input: {error}") from None
        return made

    def _next(self, record: Record, interval: float) -> list[RecordedCycle]:
        self._follows(record, interval)
        made = self._added(record, interval)
        self._last_s = record.time_s
        return made

    def _absurd(self, record: Record, interval: float) -> str:
        """Message of an increment larger than any vehicle's in that time; empty without one."""
        increments = (*(() if self.columns.rates else DELTA_THETA), *(() if self.columns.accelerations else DELTA_V))
        for name in increments:
            if abs(record.numbers[name]) > ABSURD[name] * interval:
                return f"column {name}: {record.numbers[name] / interval:.3g} per second is too fast for a vehicle"
        return ""

    def _counted(self, interval: float) -> None:
        records = round(self.period_s / interval)
        if records < 1 or abs(records * interval / self.period_s - 1) > 0.2:
            raise InputError(
                f"standard input: the usual interval of the first records, {interval:.6g} s, does not divide the control cycle of "
                f"{self.period_s:g} s; is time in seconds ([columns] can scale it), is cycle.period_s right?"
            )
        self.usual_s, self.records = interval, records

    def _follows(self, record: Record, interval: float) -> None:
        most = GAP if self.records == 1 else LONG
        if interval > most * self.usual_s:
            lost = "" if self.records == 1 else f", so a cycle of {self.records} records would lack one"
            raise InputError(
                f"standard input: {interval:.6g} s without a record before {record.time_s:.9g} s (the usual interval is "
                f"{self.usual_s:.6g} s{lost})"
            )

    def _added(self, record: Record, interval: float) -> list[RecordedCycle]:
        first = self._own[0][0] if self._own else record
        for name in self.columns.commands:
            value = record.numbers[name]
            if first is record and math.isnan(value):
                missing = f"no {name} in the first record of its control cycle, {record.time_s:.9g} s; write 0 for none"
                # left out, it takes its cycle with it; of several records the others would be none
                raise RecordError(missing) if self.records == 1 else InputError(f"standard input: {missing}")
            if not math.isnan(value) and value != first.numbers[name]:
                raise InputError(
                    f"standard input: {name} changes within a control cycle, at {record.time_s:.9g} s; commands change at cycle starts "
                    "only: check cycle.period_s and the first record"
                )
        self._own.append((record, interval))
        if len(self._own) < self.records:
            return []
        own, self._own = self._own, []
        return [self._cycle(own)]

    def _cycle(self, own: list[tuple[Record, float]]) -> RecordedCycle:
        columns, last = self.columns, own[-1][0]
        theta = _summed(own, GYRO if columns.rates else DELTA_THETA, columns.rates)
        velocity = _summed(own, ACCEL if columns.accelerations else DELTA_V, columns.accelerations)
        commands = [own[0][0].numbers[name] for name in columns.commands] + [last.numbers[name] for name in columns.speeds]
        length = float(np.array([interval for _, interval in own]).sum())
        self._lengths = [*self._lengths[-2:], length / self.usual_s]
        lacking = self.records == 1 and self._lengths[-2] > LONG and sum(self._lengths) > LOST
        return RecordedCycle(last.time_s, np.array([last.time_s, length, *theta, *velocity, 0.0, 0.0, 0.0, *commands]), lacking)


def _summed(own: list[tuple[Record, float]], names: tuple[str, ...], rates: bool) -> Array:
    each = np.array([[record.numbers[name] * (interval if rates else 1.0) for name in names] for record, interval in own])
    return np.asarray(each.sum(0))
