"""Reaction wheels in time: the momentum that each holds along its axis, and the torque on it (:mod:`massprop_cli.inputs.wheel`).

By its speed at the records' ends, between which it grows evenly; or by the torque on it, held over each cycle, less friction. Momentum is
then the wheel's share relative to the body, or all of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross, times
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.wheel import Wheel, WheelLog
from massprop_cli.prepare.clock import by_commands_clock, cycle_edges
from massprop_cli.prepare.signal import Signal, window_integrals
from massprop_cli.prepare.sums import of_records

FOR_A_PARABOLA = 8
"""Records, of which fewer make one too noisy at its end."""


@dataclass(frozen=True)
class Stored:
    """Momentum of W wheels within K cycles of B bins each."""

    axis: Array
    """(W, 3) unit vectors, body axes, as far as they turn the vehicle."""
    mean: Array
    """(K, B, W) along the axes, mean of each bin, N m s."""
    skew: Array
    """(K, B, W) its first moment about the bin's middle, over the bin's length, N m s²."""
    begun: Array
    """(W,) what it was when the log began, N m s."""

    def part(self, cycles: slice) -> Stored:
        """Of some cycles."""
        return replace(self, mean=self.mean[cycles], skew=self.skew[cycles])

    def precession(self, rate_rad_s: Array) -> Array:
        """(K, 3) torque −ω × h of mean rates (K, 3) and mean momenta, N m."""
        return -cross(rate_rad_s, self.mean.mean(1) @ self.axis)


class _Grown(NamedTuple):
    """Momentum [N m s] at times [s] by the commands' clock, between which it grows evenly."""

    time_s: Array
    momentum: Array


def turned(log: Log, vehicle: Vehicle, delay_s: float, edges_s: Array, bins: int) -> tuple[Array, Array, Stored]:
    """What the wheels do in bins of edges ``edges_s``, ``bins`` of them in a cycle.

    Integral and first moment per bin, (bins, W), of the torque on each wheel, N m; and the momentum that they hold.
    """
    whole = [_grown(log, vehicle, wheel, said, delay_s) for wheel, said in zip(vehicle.spinning, log.wheels, strict=True)]
    grown, begun = [_near(one, edges_s) for one in whole], np.array([one.momentum[0] for one in whole])
    torque, torque_moment = window_integrals([_torque(one) for one in grown], edges_s)
    held, held_moment = window_integrals([_momentum(one, edges_s[0]) for one in grown], edges_s)
    length = np.diff(edges_s)[:, None]
    shape = (-1, bins, len(grown))
    skew = held_moment / length - held / 2
    # on a table, what they do about Z alone
    axis = np.array([wheel.direction for wheel in vehicle.spinning]) * vehicle.environment.moving[:3]
    return torque, torque_moment, Stored(axis, frozen((held / length).reshape(shape)), frozen(skew.reshape(shape)), frozen(begun))


def first_known_s(log: Log, vehicle: Vehicle) -> float:
    """From when on every wheel's torque is known: a speed tells it from its first reading on."""
    if all(said.speed_rad_s is None or said.start_rad_s is not None for said in log.wheels):
        return -np.inf
    return float(by_commands_clock(log, vehicle, log.time_s[:1])[0])


def _grown(log: Log, vehicle: Vehicle, wheel: Wheel, said: WheelLog, delay_s: float) -> _Grown:
    if said.torque_n_m is None:
        assert said.speed_rad_s is not None
        time_s, speed = log.time_s, said.speed_rad_s
        if said.start_rad_s is not None:
            time_s, speed = np.append(time_s[0] - log.interval_s[0], time_s), np.append(said.start_rad_s, speed)
        return _Grown(by_commands_clock(log, vehicle, time_s), wheel.spin_inertia_kg_m2 * speed)
    start, length = cycle_edges(log, slice(0, log.cycles))
    at = start + delay_s if wheel.torque_is == "commanded" else by_commands_clock(log, vehicle, start)
    time_s = np.append(at, at[-1] + length[-1])
    about = _about(log, vehicle, wheel)
    turning = np.append(_turning_at(log, vehicle, wheel, float(at[0])), np.interp(at[1:], start, about))
    return _Grown(time_s, _driven(wheel, said, np.diff(time_s), turning))


def _turning_at(log: Log, vehicle: Vehicle, wheel: Wheel, moment_s: float) -> float:
    """The body's own rate about the wheel's axis when the first torque acts, by the records before: those after it have answered already.

    What a parabola (of few records a line) through those of two cycles comes to then; where there is none, that of the first.
    """
    end_s = by_commands_clock(log, vehicle, log.time_s)
    last = int(np.searchsorted(end_s, moment_s + 1e-6 * log.interval_s[0], "right"))
    used = slice(max(last - 2 * log.records_per_cycle, 0), max(last, 1))
    interval = log.interval_s[used]
    rate = times(np.array(vehicle.imu.body_from_imu), log.delta_theta_imu_rad[used] / interval[:, None]) @ wheel.direction
    since = end_s[used] - interval / 2 - moment_s
    degree = 2 if len(rate) >= FOR_A_PARABOLA else min(len(rate) - 1, 1)
    return float(np.linalg.lstsq(np.vander(since, degree + 1), rate, rcond=None)[0][-1])


def _about(log: Log, vehicle: Vehicle, wheel: Wheel) -> Array:
    """(K,) the body's own mean rate about the wheel's axis."""
    _, length = cycle_edges(log, slice(0, log.cycles))
    rate = of_records(log.delta_theta_imu_rad, log.records_per_cycle) / length[:, None]
    about: Array = times(np.array(vehicle.imu.body_from_imu), rate) @ wheel.direction
    return about


def _driven(wheel: Wheel, said: WheelLog, length_s: Array, turning: Array) -> Array:
    """(K + 1,) momentum of a wheel by the torque on it, friction taken in the middle of each cycle."""
    assert said.torque_n_m is not None
    assert said.start_rad_s is not None
    inertia = wheel.spin_inertia_kg_m2
    begun = inertia * (said.start_rad_s + turning[0])
    if wheel.coulomb_friction_n_m == 0 and wheel.viscous_friction_n_m_s == 0:
        return np.asarray(begun + np.append(0.0, np.cumsum(said.torque_n_m * length_s)))
    found = [float(begun)]
    for torque, length, about in zip(said.torque_n_m.tolist(), length_s.tolist(), turning.tolist(), strict=True):
        speed = found[-1] / inertia - about
        middle = speed + (torque - wheel.friction(speed)) * length / 2 / inertia
        found.append(found[-1] + (torque - wheel.friction(middle)) * length)
    return np.array(found)


def _near(grown: _Grown, edges_s: Array) -> _Grown:
    """What of it concerns these bins."""
    first = max(int(np.searchsorted(grown.time_s, edges_s[0], "right")) - 1, 0)
    last = int(np.searchsorted(grown.time_s, edges_s[-1])) + 1
    return _Grown(grown.time_s[first:last], grown.momentum[first:last])


def _slopes(grown: _Grown) -> Array:
    """(P,) growth from each time on; none after the last."""
    return np.append(np.diff(grown.momentum) / np.diff(grown.time_s), 0.0)


def _torque(grown: _Grown) -> Signal:
    return Signal(grown.time_s, np.diff(_slopes(grown), prepend=0.0), np.zeros_like(grown.time_s))


def _momentum(grown: _Grown, begin_s: float) -> Signal:
    """What it is before its first time, it was all along."""
    step, slope = np.zeros(len(grown.time_s) + 1), np.diff(_slopes(grown), prepend=0.0)
    step[0] = grown.momentum[0]
    return Signal(np.append(min(begin_s, grown.time_s[0]), grown.time_s), step, np.append(0.0, slope))
