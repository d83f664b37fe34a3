"""Momentum stored in momentum devices in each part of a cycle, and the torque on them (:mod:`massprop_cli.inputs.actuators.actuator`)."""

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
    """Momentum along A axes of devices within K cycles of B bins each."""

    axis: Array
    """(A, 3) unit vectors, body axes, as far as they turn the vehicle."""
    mean: Array
    """(K, B, A) along the axes, mean of each bin, N m s."""
    skew: Array
    """(K, B, A) its first moment about the bin's middle, over the bin's length, N m s²."""
    begun: Array
    """(A,) what it was when the log began, N m s."""
    free_inertia: Array
    """(A,) by how much momentum relative to the body follows its rate within a cycle, kg m²."""

    def part(self, cycles: slice) -> Stored:
        """Of some cycles."""
        return replace(self, **sliced(self, ("mean", "skew"), cycles))

    @property
    def free_tensor(self) -> Array:
        """(3, 3) J a aᵀ of each, by which the body's inertia is less within a cycle than in its mean, kg m²."""
        return np.asarray(self.axis.T @ (self.free_inertia[:, None] * self.axis))

    def precession(self, rate_rad_s: Array) -> Array:
        """(K, 3) torque −ω × h of mean rates (K, 3) and mean momenta, N m."""
        return -cross(rate_rad_s, self.mean.mean(1) @ self.axis)


FADED, SPLINE, HALF = 1e-3, 6, 0.5
"""What is left of an error at a log's end where it is none; records of a spline; the part from which on it fades the other way."""
Integrals = Callable[[Sequence[Signal]], tuple[Array, Array]]
"""Of signals to their integrals and first moments in each bin, (bins, signals) each."""


def turned(
    log: Log, vehicle: Vehicle, delay_s: float, edges_s: Array, bins: int, by: Integrals, before_s: float = 0.0
) -> tuple[list[Signal], Stored]:
    """What momentum devices do: the torque along each axis, N m, and the momentum that they hold in bins of edges ``edges_s``.

    A cycle has ``bins`` of these; ``by`` gives integrals and first moments in each as the gyro shows them, up to ``before_s`` earlier.
    """
    logged = _times(log, vehicle, delay_s)
    whole = [device.momentum(said, logged) for device, said in zip(vehicle.spinning, log.spinning, strict=True)]
    span = edges_s[0] - before_s, edges_s[-1]
    torques, momenta = zip(*(_signals(time_s, along, *span) for time_s, momentum in whole for along in momentum), strict=True)
    begun = np.concatenate([momentum[:, 0] for _, momentum in whole])
    held, held_moment = by(momenta)
    length = np.diff(edges_s)[:, None]
    shape = (-1, bins, len(momenta))
    skew = held_moment / length - held / 2
    # on a table, what they do about Z alone
    axis = np.concatenate([device.axes for device in vehicle.spinning]) * vehicle.environment.moving[:3]
    mean, first = frozen((held / length).reshape(shape)), frozen(skew.reshape(shape))
    return list(torques), Stored(axis, mean, first, frozen(begun), free_inertia(log.records_per_cycle, vehicle))


def free_inertia(records_per_cycle: int, vehicle: Vehicle) -> Array:
    """(A,) of :class:`Stored`: of speeds that are read once in each cycle, at its end."""
    return np.array([inertia for device in vehicle.spinning for inertia in device.free_inertia]) * (records_per_cycle == 1)


def first_known_s(log: Log, vehicle: Vehicle) -> float:
    """From when on the torque of every device is known: a reading at a record's end tells it from then on, or from its next step."""
    steps_s = *(wheel.torque_steps_s for wheel in vehicle.wheels), *(gyro.gimbal_steps_s for gyro in vehicle.control_moment_gyros)
    after_s = max((step_s or 0.0 for step_s in steps_s), default=0.0)
    known_before, unsure = all(said.known_before for said in log.spinning), _unsure(log, vehicle)[0]
    if known_before and after_s == 0 and unsure == 0:
        return -np.inf
    window_s = max((wheel.speed_window_s for wheel in vehicle.wheels), default=0.0) * (not known_before)
    first_s = log.time_s[unsure : unsure + 1] - log.interval_s[0] * known_before
    return float(by_commands_clock(log, vehicle, first_s + window_s + after_s)[0])


def last_known_s(log: Log, vehicle: Vehicle) -> float:
    """Until when every device's momentum is known, by the IMU's clock: the last readings of a late tachometer are of the time before."""
    late_s = max((wheel.speed_latency_s + wheel.speed_window_s for wheel in vehicle.wheels), default=0.0)
    return float(log.time_s[-1 - _unsure(log, vehicle)[1]]) - late_s + 1e-6 * vehicle.cycle.period_s


def _unsure(log: Log, vehicle: Vehicle) -> tuple[int, int]:
    """How many records at a log's beginning and end have gimbal angles that depend on what was before and after the log.

    With a part x of a record before each bend, an error at an end fades by x / (1 − x) from one bend to the next.
    """
    found = [(0, 0)]
    for gyro in vehicle.control_moment_gyros:
        if gyro.gimbal_smooth:
            found.append((SPLINE, SPLINE))
        elif gyro.gimbal_steps_s:
            part = gyro.gimbal_steps_s / float(log.interval_s[0]) % 1.0
            fades = float(np.clip(min(part, 1 - part) / max(part, 1 - part), 1e-9, 0.9))
            count = int(np.ceil(np.log(FADED) / np.log(fades)))
            found.append((count * (part < HALF), count * (part >= HALF)))
    few = len(log.time_s) // 4
    return min(max(one for one, _ in found), few), min(max(other for _, other in found), few)


def _times(log: Log, vehicle: Vehicle, delay_s: float) -> LogTimes:
    edge_s = by_commands_clock(log, vehicle, np.append(log.time_s[0] - log.interval_s[0], log.time_s))
    begun = log.command_start_s
    at_once = by_commands_clock(log, vehicle, begun) if log.command_s is None else begun
    mounting = np.array(vehicle.imu.body_from_imu)

    def turn(rows: slice) -> Array:
        return times(mounting, log.delta_theta_imu_rad[rows])

    return LogTimes(edge_s, log.interval_s, vehicle.cycle.period_s, at_once, begun + delay_s, turn)


def _signals(time_s: Array, momentum: Array, begin_s: float, end_s: float) -> tuple[Signal, Signal]:
    """The torque along an axis, N m, and the momentum, N m s, linear between times by the commands' clock, as far as a span needs them.

    Before its first time the momentum is constant.
    """
    near = slice(max(int(np.searchsorted(time_s, begin_s, "right")) - 1, 0), int(np.searchsorted(time_s, end_s)) + 1)
    time_s, momentum = time_s[near], momentum[near]
    bends, none = np.diff(np.append(np.diff(momentum) / np.diff(time_s), 0.0), prepend=0.0), np.zeros_like(time_s)
    held = Signal(np.append(min(begin_s, time_s[0]), time_s), np.append(momentum[0], none), np.append(0.0, bends))
    return Signal(time_s, bends, none), held
