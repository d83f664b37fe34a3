"""Executed force and torque per cycle from commands, averaged under the windows of the IMU data.

The difference of two cycle-mean rates is the mean angular acceleration under a triangular window over both cycles. massprop therefore
splits every impulse into two parts. The *rising* half has weights 0 → 1 over the cycle and acts on the step into the next cycle. The
*falling* half has weights 1 → 0 and acts on the step from the previous cycle:

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
from massprop_cli.prepare.clock import by_commands_clock, clock_ratio, cycle_edges
from massprop_cli.prepare.sensor import KernelEffect, Recorder, SensorKernel, body_kernel, kernel_effect, motion_offset_s, sensed, sensors
from massprop_cli.prepare.signal import Signal, window_integrals
from massprop_cli.prepare.stored import Stored, device_torques, first_known_s
from massprop_cli.prepare.sums import Wrenches, of_records, windows, wrenches
from massprop_cli.prepare.tachometer import at_knots

LAGS_FORGOTTEN = 10.0
"""Time constants after which a lag's response to commands before the log is below noise: exp(−10) = 5e-5."""
LAGS_KEPT = 40.0
"""Time constants after which a lag's response is below double precision: exp(−40) = 4e-18."""


@dataclass(frozen=True)
class Channels:
    """Impulse of each command channel over its full thrust, K cycles, C channels."""

    rising: Array
    """(K, C) under the rising half of the triangular window, s."""
    falling: Array
    """(K, C) under the falling half, s."""
    whole: Array
    """(K, C) whole impulse, s."""
    wrench: Array
    """(C, 6) torque about O and force of each channel at full thrust, or on the body at 1 N m on a momentum device."""
    thrusting: int
    """Number of actuator channels, which come first; the others are momentum devices."""

    @property
    def windows(self) -> tuple[Array, Array, Array]:
        """Rising, falling and whole impulses, (K, C) each, s."""
        return self.rising, self.falling, self.whole

    @property
    def step(self) -> Array:
        """(K − 1, C) impulse under the whole triangular window from each cycle into the next, s."""
        return self.rising[:-1] + self.falling[1:]


@dataclass(frozen=True)
class Aligned(Wrenches):
    """IMU data and executed wrench per control cycle. ``K`` cycles, ``B`` bins in each; wrench = torque about O, force."""

    start_s: Array
    """(K,) start of each cycle on the IMU's clock, s."""
    duration_s: Array
    """(K,) length of each cycle on the commands' clock, s."""
    rate_imu_rad_s: Array
    """(K, 3) mean rate, IMU axes, rad/s."""
    specific_force_imu_m_s2: Array
    """(K, 3) mean specific force, IMU axes, m/s²."""
    channels: Channels
    """Impulse of each command channel over its full thrust."""
    pulse_covariance: Array | None
    """(K, 6, 6) covariance of the cycle's impulse from independent pulse errors and lost commands; None without either."""
    uncommanded: BoolArray
    """(K,) True where a lost command acts."""
    capability: Array
    """(r, 6) wrenches that this vehicle can command."""
    usable: BoolArray
    """(K,) False where a command from before the log still acts."""
    ignored: BoolArray
    """(K, 6) True for readings that are not used: rate x y z, specific force x y z."""
    axes: tuple[bool, ...]
    """(6,) IMU axes that the log has: gyro x y z, accelerometer x y z."""
    unread: BoolArray
    """(6,) True for channels that the log lacks (:mod:`massprop_cli.prepare.absentaxes`)."""
    force_axes: Array | None
    """(3, 3) axes along which specific force is measured, in rows; None: body axes."""
    stored: Stored | None = None
    """Momentum of momentum devices; None without any."""
    late_s: tuple[float, float] = (0.0, 0.0)
    """Time from a cycle's label to the motion that gyro and accelerometer record, s."""
    kernel_effect: KernelEffect | None = None
    """Difference between mean readings and mean motion; None if there is none."""

    @property
    def end_s(self) -> Array:
        """(K,) end of each cycle, s."""
        return self.start_s + self.duration_s

    def part(self, cycles: slice) -> Aligned:
        """Aligned data of the given cycles."""
        of_imu = ("start_s", "duration_s", "rate_imu_rad_s", "specific_force_imu_m_s2", "usable", "ignored")
        of_commands = ("impulse_bins", "skew_bins", "rising", "falling", "whole", "pulse_covariance", "uncommanded")
        return replace(
            self,
            **sliced(self, (*of_imu, *of_commands), cycles),
            channels=replace(self.channels, **sliced(self.channels, ("rising", "falling", "whole"), cycles)),
            stored=None if self.stored is None else self.stored.part(cycles),
        )


class Impulses(NamedTuple):
    """Impulse of each command channel over its full thrust. K cycles, B bins, C channels."""

    labelled_s: Array
    """(K,) start of each cycle on the IMU's clock, s."""
    duration_s: Array
    """(K,) length of each cycle on the commands' clock, s."""
    integral: Array
    """(K, B, C) impulse of each bin, s of full thrust."""
    moment: Array
    """(K, B, C) first moment about the start of the bin, s²."""
    rising: Array
    """(K, C) under the rising half of the triangular window, s."""
    falling: Array
    """(K, C) under the falling half, s."""
    whole: Array
    """(K, C) as measured by the accelerometer, s."""
    thrusting: int
    """Number of actuator channels, which come first; the others are momentum devices."""
    stored: Stored | None
    """Momentum of momentum devices; None without any."""
    usable: BoolArray
    """(K,) False where a command from before the log still acts."""


def impulses(log: Log, vehicle: Vehicle, delay_cycles: float, lag_s: float, cycles: slice | None = None) -> Impulses:
    """Executed impulses of all or the given ``cycles``.

    They depend on the timing of the actuators, and not on their positions, directions or full thrust.
    """
    log, cycles = at_knots(log, vehicle), slice(0, log.cycles) if cycles is None else cycles
    delay_s = delay_cycles * vehicle.cycle.period_s
    usable_s = first_usable_s(log, vehicle, delay_s, lag_s)
    labelled, length = cycle_edges(log, cycles)
    start, duration = by_commands_clock(log, vehicle, labelled), length * clock_ratio(vehicle)
    # include earlier commands that may still act, and the next command, which may continue a pulse
    ramps_s = max((jet.rise_s + jet.fall_s for jet in vehicle.jets), default=0.0)
    lags_s = LAGS_KEPT * longest_lag_s(vehicle, lag_s) + _memory_s(log, vehicle, LAGS_KEPT)
    begun, memory_s = log.command_start_s, delay_s + longest_delay_s(vehicle) + 3 * vehicle.cycle.period_s + ramps_s + lags_s
    before = max(int(np.searchsorted(begun, start[0] - memory_s)) - 1, 0)
    issued = slice(before, int(np.searchsorted(begun, max(float(start[-1]), float(labelled[-1])) + 2 * vehicle.cycle.period_s)))
    commands = _IssuedCommands(log, vehicle, issued, begun[issued] + delay_s, delay_s, lag_s)
    gyro, accelerometer = sensors(log, vehicle)
    bins = vehicle.estimator.bins_per_cycle
    if gyro.plain and accelerometer.plain:
        parts = _by_bins(commands, _bin_edges(start, duration, bins), bins, duration)
    else:
        parts = _by_sensors(commands, cycles, start, duration)
    return Impulses(labelled, duration, *parts, labelled >= usable_s)


class _IssuedCommands(NamedTuple):
    """Commands that may act in the requested cycles, and their execution times."""

    log: Log
    vehicle: Vehicle
    issued: slice
    """Rows of the log's commands."""
    begin_s: Array
    """Start of execution of each, s."""
    delay_s: float
    lag_s: float


_ImpulseParts = tuple[Array, Array, Array, Array, Array, int, Stored | None]
"""Fields of :class:`Impulses` from ``integral`` to ``stored``."""


def _by_bins(commands: _IssuedCommands, edges: Array, bins: int, duration: Array) -> _ImpulseParts:
    """Impulses as recorded by sensors whose records are plain means."""
    log, vehicle, issued, begin_s, delay_s, lag_s = commands
    integral, moment = executed(log, vehicle, issued, begin_s, edges, lag_s)
    thrusting, stored = integral.shape[1], None
    if log.spinning:
        by = partial(window_integrals, edges_s=edges)
        torques, stored = device_torques(log, vehicle, delay_s, edges, bins, by)
        integral, moment = (np.hstack(both) for both in zip((integral, moment), by(torques), strict=True))
    integral, moment = integral.reshape(len(duration), bins, -1), moment.reshape(len(duration), bins, -1)
    rising, whole = windows(integral, moment, duration)
    return integral, moment, frozen(rising), frozen(whole - rising), frozen(whole), thrusting, stored


def _by_sensors(commands: _IssuedCommands, cycles: slice, start: Array, duration: Array) -> _ImpulseParts:
    """Impulses as recorded by sensors of any kernel (:mod:`massprop_cli.prepare.sensor`).

    R[k] is the gyro's mean over cycle k of ∫u after its kernel. E[k] is ∫u at the start of cycle k, delayed by the kernel's mean delay.
    The rising part of cycle k is E[k + 1] − R[k] and its falling part is R[k] − E[k], so that R[k + 1] − R[k] is the sum of the rising
    part of k and the falling part of k + 1. Bins hold u itself, with the same delay, because the body moves by the unfiltered u. Samples
    at the ends of records are half a record later than the motion that they stand for, so cycles and bins shift by half a record.
    """
    log, vehicle, issued, begin_s, delay_s, lag_s = commands
    bins, records, count = vehicle.estimator.bins_per_cycle, log.records_per_cycle, len(start)
    rows = slice(cycles.start * records, cycles.stop * records)
    length, ends = log.interval_s[rows].reshape(count, records), by_commands_clock(log, vehicle, log.time_s[rows])
    share = length / length.sum(1, keepdims=True)
    gyro, accelerometer = sensors(log, vehicle, lag_s)
    unlagged = sensors(log, vehicle)
    late = float(np.mean(log.interval_s)) * clock_ratio(vehicle) / 2 if gyro.instant else 0.0
    edges = _bin_edges(start + late, duration, bins)
    signals, remaining_lag_s = actuators.signals(log, vehicle, issued, begin_s, edges, lag_s)
    if remaining_lag_s == 0.0 < lag_s:
        gyro, accelerometer = unlagged
    body = body_kernel(unlagged[0])
    thrusting, stored = len(signals), None
    channels = [(signal, body_kernel(unlagged[0], remaining_lag_s), gyro, accelerometer) for signal in signals]
    if log.spinning:
        by = partial(_in_bins, sensor=body, edges=edges)
        torques, stored = device_torques(log, vehicle, delay_s, edges, bins, by, _memory_s(log, vehicle, LAGS_KEPT))
        channels += [(torque, body, *unlagged) for torque in torques]
    if not channels:
        return _by_bins(commands, _bin_edges(start, duration, bins), bins, duration)

    def recorded(signal: Signal, body: SensorKernel, gyro: SensorKernel, accelerometer: SensorKernel) -> tuple[Array, ...]:
        """Integral and moment per bin by ``body``, rising and falling part by the gyro, whole impulse by the accelerometer."""
        motion, by_gyro = sensed(signal, body, edges), sensed(signal, gyro, ends if gyro.instant else edges[::bins])
        by_accel = sensed(signal, accelerometer, ends if accelerometer.instant else np.append(start, start[-1] + duration[-1]))
        boundary, moment = motion.first[::bins], np.diff(edges) * motion.first[1:] - np.diff(motion.second)
        mean = (by_gyro.first.reshape(share.shape) * share).sum(1) if gyro.instant else np.diff(by_gyro.second) / duration
        whole = duration * (by_accel.value.reshape(share.shape) * share).sum(1) if accelerometer.instant else np.diff(by_accel.first)
        return np.diff(motion.first), moment, boundary[1:] - mean, mean - boundary[:-1], whole

    parts = zip(*(recorded(*channel) for channel in channels), strict=True)
    integral, moment, rising, falling, whole = (np.stack(each, -1) for each in parts)
    shape = (count, bins, -1)
    return integral.reshape(shape), moment.reshape(shape), frozen(rising), frozen(falling), frozen(whole), thrusting, stored


def _in_bins(signals: Sequence[Signal], sensor: SensorKernel, edges: Array) -> tuple[Array, Array]:
    """Integrals and first moments per bin of signals after a sensor's kernel, (bins, signals) each."""
    filtered = [sensed(signal, sensor, edges) for signal in signals]
    first, second = np.stack([one.first for one in filtered], 1), np.stack([one.second for one in filtered], 1)
    return np.diff(first, axis=0), np.diff(edges)[:, None] * first[1:] - np.diff(second, axis=0)


def align(
    log: Log, vehicle: Vehicle, delay_cycles: float, lag_s: float, cycles: slice | None = None, made: Impulses | None = None
) -> Aligned:
    """Sum records into cycles and pair each cycle with the executed impulses, for all or the given ``cycles`` (both ends given).

    ``delay_cycles``: command delay in nominal periods, 0 or more, may be fractional. ``lag_s``: first-order lag of the thrust. ``made``:
    result of :func:`impulses`, if it is already computed. Raises :class:`InputError` if the log is shorter than the delay.
    """
    of, records = slice(0, log.cycles) if cycles is None else cycles, log.records_per_cycle
    made = made or impulses(log, vehicle, delay_cycles, lag_s, cycles)
    wrench, duration = channel_wrench(log, vehicle), made.duration_s
    channels = Channels(made.rising, made.falling, made.whole, wrench, made.thrusting)
    together = wrenches(made.integral, made.moment, duration, channels.windows, wrench)
    each = slice(of.start * records, of.stop * records)
    lost = _lost(log, vehicle, delay_cycles, lag_s, of, made)
    # a logged increment spans the time on the commands' clock; a logged rate was multiplied by the interval on the IMU's clock
    over = [
        duration if named[0].startswith("delta") else duration / clock_ratio(vehicle) for named in (log.rate_columns, log.force_columns)
    ]
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
        late_s=motion_offset_s(log, vehicle),
        kernel_effect=kernel_effect(log, vehicle),
    )


def first_usable_s(log: Log, vehicle: Vehicle, delay_s: float, lag_s: float) -> float:
    """Start of the first cycle in which only commands of the log act, s.

    Raises :class:`InputError` if fewer than two cycles remain.
    """
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
    """Time after the start of the log, s, until which sensors may still record effects of earlier commands."""
    return delay_s + longest_delay_s(vehicle) + LAGS_FORGOTTEN * longest_lag_s(vehicle, lag_s) + _memory_s(log, vehicle, LAGS_FORGOTTEN)


def _memory_s(log: Recorder, vehicle: Vehicle, lags: float) -> float:
    """Memory of the sensors beyond the record, s: latency plus ``lags`` time constants of the low-pass."""
    back = (one.latency_s + lags * float(np.abs(one.lags_s).max(initial=0.0)) for one in sensors(log, vehicle))
    return max(*back, 0.0)


def _bin_edges(start: Array, duration: Array, bins: int) -> Array:
    """(K B + 1,) edges of the bins of contiguous cycles, s."""
    inner = start[:, None] + duration[:, None] * (np.arange(bins) / bins)
    return np.append(inner.ravel(), start[-1] + duration[-1])


def _pulse_covariance(impulse: Array, lost: Array | None, wrench: Array, pulse_sigma: float) -> Array | None:
    """(K, 6, 6) covariance of the cycle's impulse from pulse scatter and ``lost`` commands (K, C); None without either."""
    if pulse_sigma == 0 and lost is None:
        return None
    variance = (pulse_sigma * impulse) ** 2 + (0.0 if lost is None else lost**2)
    return frozen(np.einsum("kj,ja,jb->kab", variance, wrench, wrench))


def lost_commands(log: Log) -> bool:
    """Whether any commands of actuators were lost."""
    return log.uncommanded is not None and bool(log.uncommanded.any()) and log.command.size > 0


def _lost(log: Log, vehicle: Vehicle, delay_cycles: float, lag_s: float, cycles: slice, made: Impulses) -> Array | None:
    """(K, C) sigma of the impulse of lost commands, s of full thrust; None if no command was lost.

    For jets and wrenches, the sigma of a lost command is the largest command of the log. Rotors keep their last command, so their sigma
    is the largest change of a command within the longest run of lost commands.
    """
    if not lost_commands(log):
        return None
    assert log.uncommanded is not None
    rotors, sigma = log.command_kind == "rotors", np.abs(log.command).max(0)
    if rotors:
        longest = int(np.diff(runs(log.uncommanded), axis=1).max(initial=1))
        sigma = np.max([np.abs(log.command[n:] - log.command[:-n]).max(0) for n in range(1, longest + 1)], 0)
    perturbed = log.command * rotors + log.uncommanded[:, None] * sigma
    whole = impulses(replace(log, command=frozen(perturbed), uncommanded=None), vehicle, delay_cycles, lag_s, cycles).whole
    return np.abs((whole - made.whole if rotors else whole)[:, : made.thrusting])
