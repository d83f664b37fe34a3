"""Records to control cycles as they were flown."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import ACCEL, DELTA_THETA, DELTA_V, GYRO, QUATERNION
from massprop_cli.inputs.telemetry import ABSURD, GAP, LONG
from massprop_cli.live.records import Columns, Record, RecordError


class Cycle(NamedTuple):
    """One control cycle."""

    end_s: float
    numbers: Array
    """As :func:`massprop_cli.estimate.flown.cycles_of` has them."""


class Gatherer:
    """Counts records into cycles. The first interval stands for the usual one."""

    def __init__(self, columns: Columns, period_s: float) -> None:
        self.columns, self.period_s = columns, period_s
        self.usual_s = 0.0
        self.records = 0
        """Of a cycle; 0 until the second has come."""
        self._first: Record | None = None
        self._last_s = -math.inf
        self._own: list[tuple[Record, float]] = []

    def add(self, record: Record) -> list[Cycle]:
        """Cycles that are whole with it. :class:`RecordError` where it must be left out, :class:`InputError` where nothing can follow."""
        interval = record.time_s - self._last_s
        if not interval > 0:
            raise RecordError(f"time {record.time_s:.9g} s does not come after {self._last_s:.9g} s")
        if self._first is None and not self.records:
            self._first, self._last_s = record, record.time_s
            return []
        absurd = self._absurd(record, interval)
        if absurd:
            raise RecordError(absurd)
        if self._first is not None:
            self._counted(interval)
            first, self._first = self._first, None
            absurd = self._absurd(first, self.usual_s)
            if absurd:
                raise InputError(f"standard input: the first record: {absurd}; begin a new recording")
            return self._added(first, self.usual_s) + self._next(record, interval)
        self._follows(record, interval)
        return self._next(record, interval)

    def _next(self, record: Record, interval: float) -> list[Cycle]:
        made = self._added(record, interval)
        self._last_s = record.time_s
        return made

    def _absurd(self, record: Record, interval: float) -> str:
        """Which increment is more than any vehicle moves in that time; empty where none is."""
        increments = (*(() if self.columns.rates else DELTA_THETA), *(() if self.columns.accelerations else DELTA_V))
        for name in increments:
            if abs(record.numbers[name]) > ABSURD * interval:
                return f"column {name}: {record.numbers[name] / interval:.3g} per second is no motion of a vehicle"
        return ""

    def _counted(self, interval: float) -> None:
        records = round(self.period_s / interval)
        if records < 1 or abs(records * interval / self.period_s - 1) > 0.2:
            raise InputError(
                f"standard input: the first interval of {interval:.6g} s does not divide the control cycle of {self.period_s:g} s; "
                "is time in seconds ([columns] can scale it), is cycle.period_s right?"
            )
        self.usual_s, self.records = interval, records

    def _follows(self, record: Record, interval: float) -> None:
        most = GAP if self.records == 1 else LONG
        if interval > most * self.usual_s:
            lost = "" if self.records == 1 else f", and a cycle of {self.records} records would lack one"
            raise InputError(
                f"standard input: {interval:.6g} s without a record before {record.time_s:.9g} s (the usual interval is "
                f"{self.usual_s:.6g} s{lost}); begin a new recording"
            )

    def _added(self, record: Record, interval: float) -> list[Cycle]:
        first = self._own[0][0] if self._own else record
        for name in self.columns.commands:
            value = record.numbers[name]
            if first is record and math.isnan(value):
                raise InputError(
                    f"standard input: no {name} in the first record of its control cycle, {record.time_s:.9g} s; write 0 for none"
                )
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

    def _cycle(self, own: list[tuple[Record, float]]) -> Cycle:
        columns, last = self.columns, own[-1][0]
        theta = _summed(own, GYRO if columns.rates else DELTA_THETA, columns.rates)
        velocity = _summed(own, ACCEL if columns.accelerations else DELTA_V, columns.accelerations)
        attitude = np.zeros(4)
        if columns.attitude:
            attitude = np.array([last.numbers[name] for name in QUATERNION])
            attitude /= np.linalg.norm(attitude)
        commands = [own[0][0].numbers[name] for name in columns.commands]
        length = float(np.array([interval for _, interval in own]).sum())
        return Cycle(last.time_s, np.array([last.time_s, length, *theta, *velocity, *attitude, 0.0, 0.0, 0.0, *commands]))


def _summed(own: list[tuple[Record, float]], names: tuple[str, ...], rates: bool) -> Array:
    each = np.array([[record.numbers[name] * (interval if rates else 1.0) for name in names] for record, interval in own])
    found: Array = each.sum(0)
    return found
