"""A log's control cycles, aligned and compensated block by block on request, so that memory does not grow with the log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import times
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import recorded
from massprop_cli.prepare.absentaxes import force_axes, ignored, unread
from massprop_cli.prepare.actuators import capability, channel_wrench
from massprop_cli.prepare.align import Aligned, align, first_usable_s, lost_commands
from massprop_cli.prepare.attitude import BiasSeen, at_first, bias_seen, integrate_attitude
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.compensate import Before, Samples, biased_attitude, compensate, felt
from massprop_cli.prepare.measured import measured
from massprop_cli.prepare.sensor import kernel_effect, shown_late_s
from massprop_cli.prepare.stored import free_inertia, last_known_s
from massprop_cli.prepare.sums import of_records
from massprop_cli.prepare.timing import Timing

GRID = 256
"""Parts begin at multiples of so many cycles, ..."""
LEAST = 24 * GRID
"""... and are so long at least: a causal pass looks back by less than a third of that."""
HELD = LEAST
"""Cycles of a log of which all are held by each of many readings."""


class Alignment:
    """Of one log under one timing; the part that was asked for last is kept, since what is varied beside it asks for the same."""

    def __init__(self, log: Log, vehicle: Vehicle, timing: Timing) -> None:
        self.log, self.vehicle, self.timing = recorded.undone(log, vehicle), vehicle, timing
        self.usable_s = first_usable_s(log, vehicle, timing.delay * vehicle.cycle.period_s, timing.lag_s(vehicle))
        self._last: tuple[slice, Aligned] | None = None

    def part(self, cycles: slice) -> Aligned:
        """Of these cycles."""
        if self._last is None or self._last[0] != cycles:
            self._last = cycles, align(self.log, self.vehicle, self.timing.delay, self.timing.lag_s(self.vehicle), cycles)
        return self._last[1]


class Stream:
    """The cycles of a log as the estimators take them (:class:`massprop_cli.prepare.compensate.Source`)."""

    def __init__(self, alignment: Alignment, vehicle: Vehicle, gyro: float | Array = 1.0) -> None:
        """``gyro`` is a factor on what it measured, or (3,) one along each of its axes.

        :class:`InputError` where a logged attitude contradicts the gyro.
        """
        self.alignment, self.vehicle, self.gyro = alignment, vehicle, gyro
        self.log = alignment.log
        self.wrench, self.capability = channel_wrench(self.log, vehicle), capability(self.log, vehicle)
        self.end_s, self.usable_s, self.until_s = self.log.cycle_end_s, alignment.usable_s, last_known_s(self.log, vehicle)
        self._measured = measured(self.log, vehicle, gyro)
        self.attitude_logged = self._measured is not None
        self.unread = unread(self.log, vehicle)
        self.kernel_effect = kernel_effect(self.log, alignment.vehicle)
        self.pulsed = vehicle.thrust.pulse_sigma > 0 or lost_commands(self.log)
        self.free_inertia = free_inertia(self.log.records_per_cycle, vehicle)
        first = slice(0, min(2, len(self)))
        begun = at_first(vehicle, self._motion(first)[0], cycle_edges(self.log, first)[1], shown_late_s(self.log, vehicle)[0])
        self._edges = [(begun, BiasSeen.none(), 0.0)]
        self._held, self._least = slice(0, 0), LEAST
        self._samples: Samples | None = None
        self._last: tuple[slice, Samples] | None = None

    @staticmethod
    def of(log: Log, vehicle: Vehicle, timing: Timing) -> Stream:
        """A log under one timing; :class:`InputError` if it is shorter than the delay."""
        alignment = Alignment(log, vehicle, timing)
        return Stream(alignment, alignment.vehicle)

    def changed(self, vehicle: Vehicle | None = None, gyro: float | Array = 1.0) -> Stream:
        """The same commands with another IMU or another attitude at the beginning."""
        return Stream(self.alignment, vehicle or self.vehicle, gyro)

    def light(self) -> Stream:
        """Itself, of a long log holding no more cycles at a time than it must: one of many beside another."""
        self._least = GRID if len(self) > HELD else HELD
        return self

    def __len__(self) -> int:
        return self.log.cycles

    def part(self, cycles: slice) -> Samples:
        """Of these cycles alone, a slice with both ends given."""
        if self._last is not None and self._last[0] == cycles:
            return self._last[1]  # each block of cycles is asked for several times
        if self._samples is None or cycles.start < self._held.start or cycles.stop > self._held.stop:
            first = cycles.start // GRID * GRID
            self._held = slice(first, min(max(first + self._least, cycles.stop), len(self)))
            self._samples = self._compensated(self._held)
        self._last = cycles, self._samples.part(slice(cycles.start - self._held.start, cycles.stop - self._held.start))
        return self._last[1]

    def _compensated(self, cycles: slice) -> Samples:
        spill.give_back()
        aligned = self.alignment.part(cycles)
        scaled = replace(aligned, rate_imu_rad_s=self.gyro * aligned.rate_imu_rad_s, force_axes=force_axes(self.log, self.vehicle))
        of_these = None if self._measured is None else self._measured.part(cycles)
        if cycles.start == 0:
            return compensate(scaled, self.vehicle, None, of_these)
        carried = self.vehicle.pivoted and self._measured is None
        rate, turn = self._motion(slice(cycles.start - 1, cycles.start))
        before = Before(rate[0], turn[0], *(self._edge(cycles.start) if carried else self._edges[0]))
        return compensate(scaled, self.vehicle, before, of_these)

    def _edge(self, cycle: int) -> tuple[Array, BiasSeen, float]:
        """What :class:`Before` has of the attitude at the start of a cycle on the grid."""
        for first in range((len(self._edges) - 1) * GRID, cycle, GRID):
            turns = self._motion(slice(max(first - 1, 0), first + GRID))[1]
            before, turns = (turns[0], turns[1:]) if first else (None, turns)
            begun, seen, squares = self._edges[-1]
            attitude = integrate_attitude(begun, turns, before)
            if biased_attitude(False, self.vehicle):
                seen = bias_seen(attitude, *self._felt(slice(first, first + GRID)), seen).at(-1)
            squares += float((cycle_edges(self.log, slice(first, first + GRID))[1] ** 2).sum())
            self._edges.append((attitude[-1], seen, squares))
        return self._edges[cycle // GRID]

    def _felt(self, cycles: slice) -> tuple[Array, Array]:
        """(K, 3) what :func:`massprop_cli.prepare.attitude.bias_seen` takes, and (K,) the length of each cycle."""
        mean, duration = self._mean(self.log.delta_v_imu_m_s, cycles)
        rate = self._motion(slice(max(cycles.start - 1, 0), cycles.stop))[0]
        rate = rate if cycles.start else np.vstack([rate[:1], rate])
        return felt(mean, ignored(self.log, self.vehicle, cycles), self.vehicle, rate, duration), duration

    def _motion(self, cycles: slice) -> tuple[Array, Array]:
        """(K, 3) mean body rate, and the angle that it makes."""
        mean, duration = self._mean(self.log.delta_theta_imu_rad, cycles)
        rate = times(np.array(self.vehicle.imu.body_from_imu), self.gyro * mean)
        return rate, rate * duration[:, None]

    def _mean(self, increments: Array, cycles: slice) -> tuple[Array, Array]:
        """(K, 3) per second, of all records' increments (n, 3), and (K,) the length of each cycle."""
        records, (_, duration) = self.log.records_per_cycle, cycle_edges(self.log, cycles)
        return of_records(increments[cycles.start * records : cycles.stop * records], records) / duration[:, None], duration
