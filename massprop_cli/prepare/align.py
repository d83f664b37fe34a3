"""Commands to executed force and torque, averaged under the windows that the IMU data carry.

Differencing two cycle-mean rates gives the mean of the angular acceleration under a triangular window that spans both
cycles. So every impulse is split in two: the part weighted with the *rising* half of the window (weights 0 → 1 over the
cycle, which belongs to the step into the next cycle) and the *falling* half (1 → 0, the step from the previous one):

    rate[k+1] − rate[k]  =  I⁻¹ ( rising impulse of k + falling impulse of k+1 )      (no gyroscopic torque)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, frozen, runs
from massprop_cli.base.dataclass import dataclass, sliced
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import absentaxes, actuators
from massprop_cli.prepare.actuators import capability, channel_wrench, executed, longest_delay_s, longest_lag_s
from massprop_cli.prepare.clock import by_commands_clock, cycle_edges, pace
from massprop_cli.prepare.sensor import KernelEffect, Recorder, SensorKernel, kernel_effect, moving, sensors, shown, shown_late_s
from massprop_cli.prepare.signal import Signal, window_integrals
from massprop_cli.prepare.stored import Stored, first_known_s, turned
from massprop_cli.prepare.sums import Wrenches, of_records, windows, wrenches
from massprop_cli.prepare.tachometer import at_bends

LAGS_FORGOTTEN = 10.0
"""After this many time constants a lagging actuator has forgotten what it did before the log began: less than noise is left of it."""
LAGS_KEPT = 40.0
"""... and after these to the last digit of a number."""


@dataclass(frozen=True)
class Channels:
    """Impulses of each command channel over its full thrust, (K, C) s: under both halves of the triangular window, and plain."""

    rising: Array
    falling: Array
    whole: Array
    wrench: Array
    """(C, 6) torque about O and force of each at full thrust; on the body, of 1 N m on a momentum device."""
    thrusting: int
    """How many of them push; the others, the last, are momentum devices."""

    @property
    def windows(self) -> tuple[Array, Array, Array]:
        """The three."""
        return self.rising, self.falling, self.whole

    @property
    def step(self) -> Array:
        """(K − 1, C) under the whole triangular window, from each cycle into the next."""
        return self.rising[:-1] + self.falling[1:]


@dataclass(frozen=True)
class Aligned(Wrenches):
    """IMU data and executed wrench per control cycle. ``K`` cycles, ``B`` bins in each; wrench = torque about O, force."""

    start_s: Array
    """(K,) start of each cycle."""
    duration_s: Array
    """(K,) its length."""
    rate_imu_rad_s: Array
    """(K, 3) mean rate, IMU axes."""
    specific_force_imu_m_s2: Array
    """(K, 3) mean specific force, IMU axes."""
    channels: Channels
    """What each command channel did, in terms of its full thrust."""
    pulse_covariance: Array | None
    """(K, 6, 6) covariance of the cycle's impulse from independent pulse errors and lost commands, where there are any."""
    uncommanded: BoolArray
    """(K,) where a lost command acts."""
    capability: Array
    """(r, 6) wrenches that this vehicle can command."""
    usable: BoolArray
    """(K,) false where the executing command was issued before the log began."""
    ignored: BoolArray
    """(K, 6) readings of each channel that are not used: rate x y z, specific force x y z."""
    axes: tuple[bool, ...]
    """Which IMU axes the log has: gyro x y z, accelerometer x y z."""
    unread: BoolArray
    """(6,) channels that the log doesn't have (:mod:`massprop_cli.prepare.absentaxes`)."""
    force_axes: Array | None
    """(3, 3) axes, in its rows, along which specific force is measured; None: the body's."""
    stored: Stored | None = None
    """What momentum devices hold, where there are any."""
    late_s: tuple[float, float] = (0.0, 0.0)
    """By how much the motion that gyro and accelerometer show is later than cycles are labelled."""
    kernel_effect: KernelEffect | None = None
    """Difference between mean readings and mean motion; None where there is none."""

    @property
    def end_s(self) -> Array:
        """(K,) end of each cycle."""
        return self.start_s + self.duration_s

    def part(self, cycles: slice) -> Aligned:
        """Of some of its cycles."""
        of_imu = ("start_s", "duration_s", "rate_imu_rad_s", "specific_force_imu_m_s2", "usable", "ignored")
        of_commands = ("impulse_bins", "skew_bins", "rising", "falling", "whole", "pulse_covariance", "uncommanded")
        return replace(
            self,
            **sliced(self, (*of_imu, *of_commands), cycles),
            channels=replace(self.channels, **sliced(self.channels, ("rising", "falling", "whole"), cycles)),
            stored=None if self.stored is None else self.stored.part(cycles),
        )


class Impulses(NamedTuple):
    """What each command channel did, whatever that makes of the body. K cycles, B bins, C channels."""

    labelled_s: Array
    """(K,) start of each cycle, as the IMU's clock labels it."""
    duration_s: Array
    integral: Array
    """(K, B, C) s of full thrust."""
    moment: Array
    """(K, B, C) s², first moment about each bin's beginning."""
    rising: Array
    """(K, C) s, under the rising half of the triangular window."""
    falling: Array
    """(K, C) s, under the falling half."""
    whole: Array
    """(K, C) s, as the accelerometer shows it."""
    thrusting: int
    stored: Stored | None
    usable: BoolArray


def impulses(log: Log, vehicle: Vehicle, delay_cycles: float, lag_s: float, cycles: slice | None = None) -> Impulses:
    """Commands as executed in each cycle. Of the vehicle its actuators' times count, and not where they are or how strong."""
    log, of = at_bends(log, vehicle), slice(0, log.cycles) if cycles is None else cycles
    delay_s = delay_cycles * vehicle.cycle.period_s
    usable_s = first_usable_s(log, vehicle, delay_s, lag_s)
    labelled, length = cycle_edges(log, of)
    start, duration = by_commands_clock(log, vehicle, labelled), length * pace(vehicle)
    # and those whose commands may still act, but for what a lag keeps below the last digit; the one that comes next may go on with a pulse
    ramps_s = max((jet.rise_s + jet.fall_s for jet in vehicle.jets), default=0.0)
    lags_s = LAGS_KEPT * longest_lag_s(vehicle, lag_s) + _shown_s(log, vehicle, LAGS_KEPT)
    begun, memory_s = log.command_start_s, delay_s + longest_delay_s(vehicle) + 3 * vehicle.cycle.period_s + ramps_s + lags_s
    before = max(int(np.searchsorted(begun, start[0] - memory_s)) - 1, 0)
    issued = slice(before, int(np.searchsorted(begun, max(float(start[-1]), float(labelled[-1])) + 2 * vehicle.cycle.period_s)))
    acted = _Acted(log, vehicle, issued, begun[issued] + delay_s, delay_s, lag_s)
    gyro, accelerometer = sensors(log, vehicle)
    bins = vehicle.estimator.bins_per_cycle
    if gyro.plain and accelerometer.plain:
        made = _by_bins(acted, _bin_edges(start, duration, bins), bins, duration)
    else:
        made = _by_sensors(acted, of, start, duration)
    return Impulses(labelled, duration, *made, labelled >= usable_s)


class _Acted(NamedTuple):
    """Commands and when they act."""

    log: Log
    vehicle: Vehicle
    issued: slice
    begin_s: Array
    delay_s: float
    lag_s: float


_Made = tuple[Array, Array, Array, Array, Array, int, Stored | None]
"""Of :class:`Impulses`, from ``integral`` to ``stored``."""


def _by_bins(acted: _Acted, edges: Array, bins: int, duration: Array) -> _Made:
    """What increments over cycles hold."""
    log, vehicle, issued, begin_s, delay_s, lag_s = acted
    integral, moment = executed(log, vehicle, issued, begin_s, edges, lag_s)
    thrusting, stored = integral.shape[1], None
    if log.spinning:
        by = partial(window_integrals, edges_s=edges)
        torques, stored = turned(log, vehicle, delay_s, edges, bins, by)
        integral, moment = (np.hstack(both) for both in zip((integral, moment), by(torques), strict=True))
    integral, moment = integral.reshape(len(duration), bins, -1), moment.reshape(len(duration), bins, -1)
    rising, whole = windows(integral, moment, duration)
    return integral, moment, frozen(rising), frozen(whole - rising), frozen(whole), thrusting, stored


def _by_sensors(acted: _Acted, cycles: slice, start: Array, duration: Array) -> _Made:
    """What sensors of any kernel show (:mod:`massprop_cli.prepare.sensor`), cycle k being a group of records.

    The gyro's mean over a group is that of ∫u behind its kernel, R[k]; with E[k] = ∫u, as late as the kernel is in the mean, where one
    group goes over into the next, ``R[k + 1] − R[k] = (E[k + 1] − R[k]) + (R[k + 1] − E[k + 1])`` are the rising and the falling part. Bins
    hold u itself, as late: the body turns by what acts, and not by what of it a low-pass lets through. Samples at records' ends are half a
    record later than what they stand for, so groups and their bins are as late.
    """
    log, vehicle, issued, begin_s, delay_s, lag_s = acted
    bins, records, count = vehicle.estimator.bins_per_cycle, log.records_per_cycle, len(start)
    rows = slice(cycles.start * records, cycles.stop * records)
    length, ends = log.interval_s[rows].reshape(count, records), by_commands_clock(log, vehicle, log.time_s[rows])
    share = length / length.sum(1, keepdims=True)
    gyro, accelerometer = sensors(log, vehicle, lag_s)
    bare = sensors(log, vehicle)
    late = float(np.mean(log.interval_s)) * pace(vehicle) / 2 if gyro.instant else 0.0
    edges = _bin_edges(start + late, duration, bins)
    signals, left = actuators.signals(log, vehicle, issued, begin_s, edges, lag_s)
    if left == 0.0 < lag_s:
        gyro, accelerometer = bare
    thrusting, stored = len(signals), None
    behind = [(signal, moving(bare[0], left), gyro, accelerometer) for signal in signals]
    if log.spinning:
        torques, stored = turned(
            log, vehicle, delay_s, edges, bins, partial(_in_bins, sensor=moving(bare[0]), edges=edges), _shown_s(log, vehicle, LAGS_KEPT)
        )
        behind += [(torque, moving(bare[0]), *bare) for torque in torques]
    if not behind:  # nothing acts, so no sensor shows it
        return _by_bins(acted, _bin_edges(start, duration, bins), bins, duration)

    def read(signal: Signal, body: SensorKernel, gyro: SensorKernel, accelerometer: SensorKernel) -> tuple[Array, ...]:
        """Integral and moment by bins as ``body`` moves; under the rising and the falling half by the gyro, whole by the accelerometer."""
        moved, by_gyro = shown(signal, body, edges), shown(signal, gyro, ends if gyro.instant else edges[::bins])
        felt = shown(signal, accelerometer, ends if accelerometer.instant else np.append(start, start[-1] + duration[-1]))
        boundary, late_s = moved.first[::bins], np.diff(edges) * moved.first[1:] - np.diff(moved.second)
        mean = (by_gyro.first.reshape(share.shape) * share).sum(1) if gyro.instant else np.diff(by_gyro.second) / duration
        whole = duration * (felt.value.reshape(share.shape) * share).sum(1) if accelerometer.instant else np.diff(felt.first)
        return np.diff(moved.first), late_s, boundary[1:] - mean, mean - boundary[:-1], whole

    parts = zip(*(read(*one) for one in behind), strict=True)
    integral, moment, rising, falling, whole = (np.stack(each, -1) for each in parts)
    shape = (count, bins, -1)
    return integral.reshape(shape), moment.reshape(shape), frozen(rising), frozen(falling), frozen(whole), thrusting, stored


def _in_bins(signals: Sequence[Signal], sensor: SensorKernel, edges: Array) -> tuple[Array, Array]:
    """Integrals and first moments of signals as a sensor shows them, (bins, signals) each."""
    each = [shown(signal, sensor, edges) for signal in signals]
    first, second = np.stack([one.first for one in each], 1), np.stack([one.second for one in each], 1)
    return np.diff(first, axis=0), np.diff(edges)[:, None] * first[1:] - np.diff(second, axis=0)


def align(
    log: Log, vehicle: Vehicle, delay_cycles: float, lag_s: float, cycles: slice | None = None, made: Impulses | None = None
) -> Aligned:
    """Sum records into cycles and pair each cycle with what was executed during it; all of them, or ``cycles`` with both ends given.

    ``delay_cycles`` (0 or more, may be fractional) shifts commands by that many nominal periods; thrust follows them with the first-order
    lag ``lag_s``. ``made`` is what :func:`impulses` gives, where that is at hand. :class:`InputError` if the log is shorter than the delay.
    """
    of, records = slice(0, log.cycles) if cycles is None else cycles, log.records_per_cycle
    made = made or impulses(log, vehicle, delay_cycles, lag_s, cycles)
    wrench, duration = channel_wrench(log, vehicle), made.duration_s
    channels = Channels(made.rising, made.falling, made.whole, wrench, made.thrusting)
    together = wrenches(made.integral, made.moment, duration, channels.windows, wrench)
    each = slice(of.start * records, of.stop * records)
    lost = _lost(log, vehicle, delay_cycles, lag_s, of, made)
    # an increment is over what the commands' clock shows, a rate is one by any clock
    over = [duration if named[0].startswith("delta") else duration / pace(vehicle) for named in (log.rate_columns, log.force_columns)]
    return Aligned(
        start_s=frozen(made.labelled_s),
        duration_s=frozen(duration),
        rate_imu_rad_s=frozen(of_records(log.delta_theta_imu_rad[each], records) / over[0][:, None]),
        specific_force_imu_m_s2=frozen(of_records(log.delta_v_imu_m_s[each], records) / over[1][:, None]),
        **{name: frozen(part) for name, part in vars(together).items()},
        channels=channels,
        pulse_covariance=_pulse_covariance(channels.whole[:, : made.thrusting], lost, wrench[: made.thrusting], vehicle.thrust.pulse_sigma),
        uncommanded=np.zeros(len(duration), dtype=bool) if lost is None else np.asarray((lost > 0).any(1)),
        capability=capability(log, vehicle),
        usable=made.usable,
        ignored=absentaxes.ignored(log, vehicle, of),
        axes=log.axes,
        unread=absentaxes.unread(log, vehicle),
        force_axes=absentaxes.force_axes(log, vehicle),
        stored=made.stored,
        late_s=shown_late_s(log, vehicle),
        kernel_effect=kernel_effect(log, vehicle),
    )


def first_usable_s(log: Log, vehicle: Vehicle, delay_s: float, lag_s: float) -> float:
    """From when on all that is executed was commanded within the log; :class:`InputError` where that leaves less than two cycles."""
    first, last = (float(cycle_edges(log, slice(k, k + 1))[0][0]) for k in (0, log.cycles - 2))
    begun_s = max(first, float(log.command_start_s[0])) + shown_by_s(log, vehicle, delay_s, lag_s)
    usable_s = max(begun_s, first_known_s(log, vehicle)) - 1e-6 * vehicle.cycle.period_s
    if last < usable_s:
        raise InputError(
            f"{log.path}: lasts {log.cycle_end_s[-1] - first:.6g} s, too short for a command delay of {delay_s:.6g} s, a thrust lag of "
            f"{longest_lag_s(vehicle, lag_s):.6g} s and two cycles; record longer, or correct cycle.command_delay_cycles or thrust.lag_s"
        )
    return usable_s


def shown_by_s(log: Recorder, vehicle: Vehicle, delay_s: float, lag_s: float) -> float:
    """How long after a command no sensor shows any more of what was commanded before it."""
    return delay_s + longest_delay_s(vehicle) + LAGS_FORGOTTEN * longest_lag_s(vehicle, lag_s) + _shown_s(log, vehicle, LAGS_FORGOTTEN)


def _shown_s(log: Recorder, vehicle: Vehicle, lags: float) -> float:
    """How far back what a sensor shows may have been, beyond its record: so many time constants of its low-pass."""
    back = (one.latency_s + lags * float(np.abs(one.lags_s).max(initial=0.0)) for one in sensors(log, vehicle))
    return max(*back, 0.0)


def _bin_edges(start: Array, duration: Array, bins: int) -> Array:
    inner = start[:, None] + duration[:, None] * (np.arange(bins) / bins)
    return np.append(inner.ravel(), start[-1] + duration[-1])


def _pulse_covariance(impulse: Array, lost: Array | None, wrench: Array, pulse_sigma: float) -> Array | None:
    if pulse_sigma == 0 and lost is None:
        return None
    variance = (pulse_sigma * impulse) ** 2 + (0.0 if lost is None else lost**2)
    return frozen(np.einsum("kj,ja,jb->kab", variance, wrench, wrench))


def lost_commands(log: Log) -> bool:
    """Whether some commands of thrusters are unknown."""
    return log.uncommanded is not None and bool(log.uncommanded.any()) and log.command.size > 0


def _lost(log: Log, vehicle: Vehicle, delay_cycles: float, lag_s: float, cycles: slice, made: Impulses) -> Array | None:
    """(K, C) s of full thrust that commands may have given which were lost: one sigma is the largest command of the log.

    Of rotors, which go on as they were, it is the most that their commands change by in as many cycles as were lost in a row.
    """
    if not lost_commands(log):
        return None
    assert log.uncommanded is not None
    turn, sigma = log.command_kind == "rotors", np.abs(log.command).max(0)
    if turn:
        longest = int(np.diff(runs(log.uncommanded), axis=1).max(initial=1))
        sigma = np.max([np.abs(log.command[n:] - log.command[:-n]).max(0) for n in range(1, longest + 1)], 0)
    other = log.command * turn + log.uncommanded[:, None] * sigma
    found = impulses(replace(log, command=frozen(other), uncommanded=None), vehicle, delay_cycles, lag_s, cycles).whole
    return np.abs((found - made.whole if turn else found)[:, : made.thrusting])
