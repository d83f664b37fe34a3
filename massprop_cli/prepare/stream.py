"""Control cycles of a log, aligned and compensated in parts on request, so that memory does not grow with the log."""

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
from massprop_cli.prepare.attitude import BiasInformation, bias_information, initial_attitude, integrate_attitude
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.compensate import PreviousCycle, Samples, biased_attitude, compensate, force_over_gravity
from massprop_cli.prepare.referenceattitude import reference_attitude
from massprop_cli.prepare.sensor import kernel_effect, motion_offset_s
from massprop_cli.prepare.stored import free_inertia, last_known_s
from massprop_cli.prepare.sums import of_records
from massprop_cli.prepare.timing import Timing

GRID = 256
"""Computed parts start at multiples of this number of cycles."""
MIN_PART = 24 * GRID
"""Minimum length of a computed part, cycles. A causal pass looks back by less than a third of it, so it seldom
recomputes. Of a log that is no longer, each of many streams keeps all cycles."""


class Alignment:
    """Aligned data of one log under one timing; it keeps the last part, because streams with another IMU request the same part."""

    def __init__(self, log: Log, vehicle: Vehicle, timing: Timing) -> None:
        self.log, self.vehicle, self.timing = recorded.corrected_log(log, vehicle), vehicle, timing
        self.usable_s = first_usable_s(log, vehicle, timing.delay * vehicle.cycle.period_s, timing.lag_s(vehicle))
        self._last: tuple[slice, Aligned] | None = None

    def part(self, cycles: slice) -> Aligned:
        """Aligned data of the given cycles."""
        if self._last is None or self._last[0] != cycles:
            self._last = cycles, align(self.log, self.vehicle, self.timing.delay, self.timing.lag_s(self.vehicle), cycles)
        return self._last[1]


class Stream:
    """Samples of a log, computed on request (a :class:`massprop_cli.prepare.compensate.Source`)."""

    def __init__(self, alignment: Alignment, vehicle: Vehicle, gyro: float | Array = 1.0) -> None:
        """``gyro``: scale factor of the gyro readings, a number or (3,) per axis, or a (3, 3) matrix.

        Raises :class:`InputError` if a logged attitude contradicts the gyro.
        """
        self.alignment, self.vehicle, self.gyro = alignment, vehicle, gyro
        self.log = alignment.log
        self.wrench, self.capability = channel_wrench(self.log, vehicle), capability(self.log, vehicle)
        self.end_s, self.usable_s, self.until_s = self.log.cycle_end_s, alignment.usable_s, last_known_s(self.log, vehicle)
        self._measured = reference_attitude(self.log, vehicle, gyro)
        self.attitude_logged = self._measured is not None
        self.unread = unread(self.log, vehicle)
        self.kernel_effect = kernel_effect(self.log, alignment.vehicle)
        self.pulsed = vehicle.thrust.pulse_sigma > 0 or lost_commands(self.log)
        self.free_inertia = free_inertia(self.log.records_per_cycle, vehicle)
        first = slice(0, min(2, len(self)))
        attitude = initial_attitude(vehicle, self._motion(first)[0], cycle_edges(self.log, first)[1], motion_offset_s(self.log, vehicle)[0])
        self._edges = [(attitude, BiasInformation.none(), 0.0)]
        self._held, self._min_part = slice(0, 0), MIN_PART
        self._samples: Samples | None = None
        self._last: tuple[slice, Samples] | None = None

    @staticmethod
    def of(log: Log, vehicle: Vehicle, timing: Timing) -> Stream:
        """Stream of a log under one timing. Raises :class:`InputError` if the log is shorter than the delay."""
        alignment = Alignment(log, vehicle, timing)
        return Stream(alignment, alignment.vehicle)

    def changed(self, vehicle: Vehicle | None = None, gyro: float | Array = 1.0) -> Stream:
        """Stream of the same commands with another IMU or another initial attitude."""
        return Stream(self.alignment, vehicle or self.vehicle, gyro)

    def light(self) -> Stream:
        """Reduce the cycles kept of a long log, for one of many streams in memory; returns itself."""
        self._min_part = GRID if len(self) > MIN_PART else MIN_PART
        return self

    def __len__(self) -> int:
        return self.log.cycles

    def part(self, cycles: slice) -> Samples:
        """Samples of the given cycles; the slice has both ends."""
        if self._last is not None and self._last[0] == cycles:
            return self._last[1]  # callers request each block several times
        if self._samples is None or cycles.start < self._held.start or cycles.stop > self._held.stop:
            first = cycles.start // GRID * GRID
            self._held = slice(first, min(max(first + self._min_part, cycles.stop), len(self)))
            self._samples = self._compensated(self._held)
        self._last = cycles, self._samples.part(slice(cycles.start - self._held.start, cycles.stop - self._held.start))
        return self._last[1]

    def _compensated(self, cycles: slice) -> Samples:
        spill.give_back()
        aligned = self.alignment.part(cycles)
        scaled = replace(aligned, rate_imu_rad_s=self.gyro * aligned.rate_imu_rad_s, force_axes=force_axes(self.log, self.vehicle))
        measured_part = None if self._measured is None else self._measured.part(cycles)
        if cycles.start == 0:
            return compensate(scaled, self.vehicle, None, measured_part)
        carried = self.vehicle.pivoted and self._measured is None
        rate, turn = self._motion(slice(cycles.start - 1, cycles.start))
        before = PreviousCycle(rate[0], turn[0], *(self._edge(cycles.start) if carried else self._edges[0]))
        return compensate(scaled, self.vehicle, before, measured_part)

    def _edge(self, cycle: int) -> tuple[Array, BiasInformation, float]:
        """Attitude, bias information and summed squared lengths (:class:`PreviousCycle`) at the start of a cycle on the grid."""
        for first in range((len(self._edges) - 1) * GRID, cycle, GRID):
            turns = self._motion(slice(max(first - 1, 0), first + GRID))[1]
            before, turns = (turns[0], turns[1:]) if first else (None, turns)
            initial, bias, squares = self._edges[-1]
            attitude = integrate_attitude(initial, turns, before)
            if biased_attitude(False, self.vehicle):
                bias = bias_information(attitude, *self._force_g(slice(first, first + GRID)), bias).at(-1)
            squares += float((cycle_edges(self.log, slice(first, first + GRID))[1] ** 2).sum())
            self._edges.append((attitude[-1], bias, squares))
        return self._edges[cycle // GRID]

    def _force_g(self, cycles: slice) -> tuple[Array, Array]:
        """(K, 3) specific force over gravity, body axes, and (K,) length of each cycle, s."""
        mean, duration = self._mean(self.log.delta_v_imu_m_s, cycles)
        rate = self._motion(slice(max(cycles.start - 1, 0), cycles.stop))[0]
        rate = rate if cycles.start else np.vstack([rate[:1], rate])
        return force_over_gravity(mean, ignored(self.log, self.vehicle, cycles), self.vehicle, rate, duration), duration

    def _motion(self, cycles: slice) -> tuple[Array, Array]:
        """(K, 3) mean body rate, rad/s, and (K, 3) angle increment, rad."""
        mean, duration = self._mean(self.log.delta_theta_imu_rad, cycles)
        rate = times(np.array(self.vehicle.imu.body_from_imu), self.gyro * mean)
        return rate, rate * duration[:, None]

    def _mean(self, increments: Array, cycles: slice) -> tuple[Array, Array]:
        """(K, 3) mean rate of change per cycle from the increments (n, 3) of all records, and (K,) length of each cycle, s."""
        records, (_, duration) = self.log.records_per_cycle, cycle_edges(self.log, cycles)
        return of_records(increments[cycles.start * records : cycles.stop * records], records) / duration[:, None], duration
