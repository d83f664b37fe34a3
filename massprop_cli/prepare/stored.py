"""Momentum stored in momentum devices per bin, and the torque on them (:mod:`massprop_cli.inputs.actuators.actuator`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.dataclass import dataclass, sliced
from massprop_cli.base.rigidbody import cross, times
from massprop_cli.inputs.actuators.actuator import LogTimes
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.clock import by_commands_clock
from massprop_cli.prepare.signal import Signal


@dataclass(frozen=True)
class Stored:
    """Momentum along the A axes of all momentum devices, in K cycles of B bins."""

    axis: Array
    """(A, 3) unit vectors, body axes; components about which the environment prevents rotation are zero."""
    mean: Array
    """(K, B, A) mean momentum along each axis in each bin, N m s."""
    skew: Array
    """(K, B, A) first moment of the momentum about the middle of the bin, over the bin's length, N m s²."""
    begun: Array
    """(A,) momentum at the start of the log, N m s."""
    free_inertia: Array
    """(A,) spin inertia J of devices whose momentum J (W + a · ω) grows evenly from one speed reading to the next, kg m²; 0 for others."""

    def part(self, cycles: slice) -> Stored:
        """Stored momentum of the given cycles."""
        return replace(self, **sliced(self, ("mean", "skew"), cycles))

    @property
    def free_tensor(self) -> Array:
        """(3, 3) Σ J a aᵀ by which the effective inertia within a cycle is lower than the inertia of the cycle means, kg m²."""
        return np.asarray(self.axis.T @ (self.free_inertia[:, None] * self.axis))

    def precession(self, rate_rad_s: Array) -> Array:
        """(K, 3) gyroscopic torque −ω × h of mean rates (K, 3) and mean stored momentum, N m."""
        return -cross(rate_rad_s, self.mean.mean(1) @ self.axis)


FADED, SPLINE, HALF = 1e-3, 6, 0.5
"""Fraction at which the error of an unknown end value counts as decayed; records that a spline's ends affect; fraction of a record
from which the error decays backward from the log's end instead of forward from its start."""
Integrals = Callable[[Sequence[Signal]], tuple[Array, Array]]
"""Function from signals to their integrals and first moments in each bin, (bins, signals) each."""


def device_torques(
    log: Log, vehicle: Vehicle, delay_s: float, edges_s: Array, bins: int, by: Integrals, before_s: float = 0.0
) -> tuple[list[Signal], Stored]:
    """Torque of momentum devices along each axis, N m, and their stored momentum in the bins between ``edges_s``.

    A cycle has ``bins`` bins. ``by`` gives integrals and first moments per bin as recorded by the gyro, whose memory is ``before_s``.
    """
    logged = _times(log, vehicle, delay_s)
    histories = [device.momentum(device_log, logged) for device, device_log in zip(vehicle.spinning, log.spinning, strict=True)]
    span = edges_s[0] - before_s, edges_s[-1]
    signals = (_torque_and_momentum(time_s, along, *span) for time_s, momentum in histories for along in momentum)
    torques, momenta = zip(*signals, strict=True)
    initial = np.concatenate([momentum[:, 0] for _, momentum in histories])
    integral, moment = by(momenta)
    length = np.diff(edges_s)[:, None]
    shape = (-1, bins, len(momenta))
    skew = moment / length - integral / 2
    # on a planar table only the component about Z counts
    axis = np.concatenate([device.axes for device in vehicle.spinning]) * vehicle.environment.moving[:3]
    mean, first = frozen((integral / length).reshape(shape)), frozen(skew.reshape(shape))
    return list(torques), Stored(axis, mean, first, frozen(initial), free_inertia(log.records_per_cycle, vehicle))


def free_inertia(records_per_cycle: int, vehicle: Vehicle) -> Array:
    """(A,) ``free_inertia`` of :class:`Stored`, kg m²; zero unless speeds are logged once per cycle."""
    return np.array([inertia for device in vehicle.spinning for inertia in device.free_inertia]) * (records_per_cycle == 1)


def first_known_s(log: Log, vehicle: Vehicle) -> float:
    """Time on the commands' clock from which the torque of every device is known, s; −inf if known from the start.

    A reading at the end of a record determines the torque from that time, or from the next torque step.
    """
    steps_s = *(wheel.torque_steps_s for wheel in vehicle.wheels), *(gyro.gimbal_steps_s for gyro in vehicle.control_moment_gyros)
    after_s = max((step_s or 0.0 for step_s in steps_s), default=0.0)
    known_before, unknown = all(device_log.known_before for device_log in log.spinning), _unknown_records(log, vehicle)[0]
    if known_before and after_s == 0 and unknown == 0:
        return -np.inf
    window_s = max((wheel.speed_window_s for wheel in vehicle.wheels), default=0.0) * (not known_before)
    first_s = log.time_s[unknown : unknown + 1] - log.interval_s[0] * known_before
    return float(by_commands_clock(log, vehicle, first_s + window_s + after_s)[0])


def last_known_s(log: Log, vehicle: Vehicle) -> float:
    """Time on the IMU's clock until which the momentum of every device is known, s; a late tachometer ends it before the log's end."""
    late_s = max((wheel.speed_latency_s + wheel.speed_window_s for wheel in vehicle.wheels), default=0.0)
    return float(log.time_s[-1 - _unknown_records(log, vehicle)[1]]) - late_s + 1e-6 * vehicle.cycle.period_s


def _unknown_records(log: Log, vehicle: Vehicle) -> tuple[int, int]:
    """Numbers of records at the log's start and end whose gimbal angles depend on unlogged angles before and after the log.

    If the slope changes at a fraction x of each record, an end error decays by x / (1 − x) per record.
    """
    counts = [(0, 0)]
    for gyro in vehicle.control_moment_gyros:
        if gyro.gimbal_smooth:
            counts.append((SPLINE, SPLINE))
        elif gyro.gimbal_steps_s:
            part = gyro.gimbal_steps_s / float(log.interval_s[0]) % 1.0
            decay = float(np.clip(min(part, 1 - part) / max(part, 1 - part), 1e-9, 0.9))
            count = int(np.ceil(np.log(FADED) / np.log(decay)))
            counts.append((count * (part < HALF), count * (part >= HALF)))
    limit = len(log.time_s) // 4
    return min(max(one for one, _ in counts), limit), min(max(other for _, other in counts), limit)


def _times(log: Log, vehicle: Vehicle, delay_s: float) -> LogTimes:
    edge_s = by_commands_clock(log, vehicle, np.append(log.time_s[0] - log.interval_s[0], log.time_s))
    begun = log.command_start_s
    at_once = by_commands_clock(log, vehicle, begun) if log.command_s is None else begun
    mounting = np.array(vehicle.imu.body_from_imu)

    def turn(rows: slice) -> Array:
        return times(mounting, log.delta_theta_imu_rad[rows])

    return LogTimes(edge_s, log.interval_s, vehicle.cycle.period_s, at_once, begun + delay_s, turn)


def _torque_and_momentum(time_s: Array, momentum: Array, begin_s: float, end_s: float) -> tuple[Signal, Signal]:
    """Torque along an axis, N m, and momentum, N m s, from ``begin_s`` to ``end_s``.

    The momentum is linear between the times of the commands' clock, and constant before the first.
    """
    span = slice(max(int(np.searchsorted(time_s, begin_s, "right")) - 1, 0), int(np.searchsorted(time_s, end_s)) + 1)
    time_s, momentum = time_s[span], momentum[span]
    slope_changes, none = np.diff(np.append(np.diff(momentum) / np.diff(time_s), 0.0), prepend=0.0), np.zeros_like(time_s)
    momentum_signal = Signal(np.append(min(begin_s, time_s[0]), time_s), np.append(momentum[0], none), np.append(0.0, slope_changes))
    return Signal(time_s, slope_changes, none), momentum_signal
