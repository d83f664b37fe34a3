"""IMU mounting, attitude, gravity and lever arm: aligned data to :class:`Samples` in body axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.arrays import Array, BoolArray, frozen
from massprop_cli.base.dataclass import dataclass, sliced
from massprop_cli.base.quaternion import inverse, matrices, rotation_vector, turns_between
from massprop_cli.base.rigidbody import cross, lever_arm, times
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.align import Aligned
from massprop_cli.prepare.attitude import (
    FELT,
    LEVELLED,
    BiasSeen,
    at_first,
    attitude_error,
    bias_seen,
    freed,
    integrate_attitude,
    world_up_b,
)
from massprop_cli.prepare.attitudefilter import Measured
from massprop_cli.prepare.sensor import KernelEffect


class Mounted(Protocol):
    """What measures the motion."""

    @property
    def attitude_logged(self) -> bool:
        """Whether the log holds attitudes, which measure what the gyro carries; on an air bearing only."""

    @property
    def kernel_effect(self) -> KernelEffect | None:
        """Difference between mean readings and mean motion; None where there is none."""

    @property
    def pulsed(self) -> bool:
        """Whether impulses have errors of their own: of pulses, or because a command was lost."""

    @property
    def free_inertia(self) -> Array:
        """(A,) by how much each device's momentum relative to the body follows its rate within a cycle, kg m²."""


class Source(Mounted, Protocol):
    """The control cycles of a log, of which any part can be had."""

    @property
    def wrench(self) -> Array:
        """(C, 6) torque about O and force of each command channel at full thrust."""

    @property
    def capability(self) -> Array:
        """(r, 6) wrenches that this vehicle can command."""

    @property
    def unread(self) -> BoolArray:
        """(6,) channels that the log doesn't have: rate x y z, specific force x y z."""

    @property
    def end_s(self) -> Array:
        """(K,) end of each cycle."""

    def __len__(self) -> int: ...

    def part(self, cycles: slice) -> Samples:
        """Of these cycles alone, a slice with both ends given."""


@dataclass(frozen=True)
class Samples:
    """One control cycle each, body axes, gravity's direction known. What the estimators take."""

    executed: Aligned
    rate_rad_s: Array
    """(K, 3) mean body rate."""
    rate_step_rad_s: Array
    """(K, 3) difference to the previous cycle's mean rate; zero in the first."""
    carried_rad_s: Array
    """(K, 3) mean rate by which the attitude is carried through the cycle."""
    attitude_error_rad: Array
    """(K, 3, 5) rotation vector from the attitude as carried to the true one at the start of each cycle: what is known, by the gyro's bias,
    and of its noise, one sigma about each axis over that of a cycle, s. Zeros with ``measured``."""
    specific_force_m_s2: Array
    """(K, 3) mean specific force at the IMU; on a table without that of what carries the weight."""
    up_b: Array
    """(K + 1, 3) world vertical in body axes at the start of each cycle and the end of the last; zeros in free flight."""
    measured: Measured | None = None
    """What logged attitudes measure of the attitude as carried, where there are any."""
    room_torque_n_m: Array | None = None
    """(K, 3) mean of the stated torque that stands still in the room, body axes; None where none is stated."""

    def __len__(self) -> int:
        return len(self.rate_rad_s)

    @property
    def wrench(self) -> Array:
        """(C, 6) torque about O and force of each command channel at full thrust."""
        return self.executed.channels.wrench

    @property
    def capability(self) -> Array:
        """(r, 6) wrenches that this vehicle can command."""
        return self.executed.capability

    @property
    def attitude_logged(self) -> bool:
        """Whether the log holds attitudes, which measure what the gyro carries; on an air bearing only."""
        return self.measured is not None

    @property
    def kernel_effect(self) -> KernelEffect | None:
        """Difference between mean readings and mean motion; None where there is none."""
        return self.executed.kernel_effect

    @property
    def pulsed(self) -> bool:
        """Of all of them."""
        return self.executed.pulse_covariance is not None

    @property
    def free_inertia(self) -> Array:
        """(A,) by how much each device's momentum relative to the body follows its rate within a cycle, kg m²."""
        return np.zeros(0) if self.executed.stored is None else self.executed.stored.free_inertia

    @property
    def unread(self) -> BoolArray:
        """(6,) channels that the log doesn't have: rate x y z, specific force x y z."""
        return self.executed.unread

    @property
    def end_s(self) -> Array:
        """(K,) end of each cycle."""
        return self.executed.end_s

    def part(self, cycles: slice) -> Samples:
        """Of these cycles alone, a slice with both ends given."""
        of_imu = ("rate_rad_s", "rate_step_rad_s", "carried_rad_s", "attitude_error_rad", "specific_force_m_s2")
        return replace(
            self,
            **sliced(self, (*of_imu, "room_torque_n_m"), cycles),
            executed=self.executed.part(cycles),
            up_b=self.up_b[cycles.start : cycles.stop + 1],
            measured=None if self.measured is None else self.measured.part(cycles),
        )


T = TypeVar("T", bound=np.generic)
BLOCK = 1024
"""Cycles that are looked at at once."""


def blocks(cycles: slice, size: int = BLOCK) -> Iterator[slice]:
    """Cycles in parts of which each begins with the one that the last ended with, so that every step between two is in one of them."""
    for first in range(cycles.start, cycles.stop - 1, size):
        yield slice(first, min(first + size + 1, cycles.stop))


def apart(cycles: slice, size: int = BLOCK) -> Iterator[slice]:
    """Cycles in parts of which each begins after the last, so that every cycle is in one of them."""
    for first in range(cycles.start, cycles.stop, size):
        yield slice(first, min(first + size, cycles.stop))


def gathered(samples: Source, cycles: slice, found: Callable[[Samples], NDArray[T]]) -> NDArray[T]:
    """What is found of each cycle, one part of the log after the other."""
    return np.concatenate([found(samples.part(part)) for part in apart(cycles)])


@dataclass(frozen=True)
class Before:
    """What a part of a log goes on from: the cycle before it."""

    rate_rad_s: Array
    """(3,) its mean body rate."""
    turn_rad: Array
    """(3,) by how much it turned."""
    attitude_wxyz: Array
    """(4,) at its end, as integrated; anything in free flight."""
    seen: BiasSeen
    """What gravity had shown by then of the gyro's bias."""
    squares_s2: float
    """Sum of the squares of all cycles' lengths by then: its root times the gyro's noise is what that has carried the attitude off by."""

    @staticmethod
    def begun(rate_rad_s: Array, duration_s: Array, vehicle: Vehicle, late_s: float) -> Before:
        """Start of a log with rates (K, 3) in cycles of ``duration_s`` (K,); the motion is ``late_s`` later than the labels."""
        return Before(rate_rad_s[0], np.zeros(3), at_first(vehicle, rate_rad_s, duration_s, late_s), BiasSeen.none(), 0.0)


def compensate(aligned: Aligned, vehicle: Vehicle, before: Before | None = None, measured: Measured | None = None) -> Samples:
    """Turn IMU data into body axes and find the vertical: as the gyro carries it, or of the reference attitude of ``measured``.

    Of a whole log, or of a part of it with what it goes on from. The lever arm stays in: :func:`acceleration` takes it out by the
    differenced rate, as the thesis does, and the default estimator's model by the angular acceleration that the commands cause.
    """
    body_from_imu = np.array(vehicle.imu.body_from_imu)
    rate = times(body_from_imu, aligned.rate_imu_rad_s)
    before = before or Before.begun(rate, aligned.duration_s, vehicle, aligned.late_s[0])
    up: Array = np.zeros((len(rate) + 1, 3))
    carried, error, attitude = rate, np.broadcast_to(0.0, (len(rate), 3, 5)), None
    if measured is not None:
        carried, attitude = rate + measured.drawn_rad / aligned.duration_s[:, None], measured.attitude_wxyz
    elif vehicle.pivoted:
        carried, error, attitude = _carried(aligned, vehicle, rate, before)
    steady = None
    if attitude is not None:
        up, torque = world_up_b(attitude), np.array(vehicle.environment.room_torque_n_m)
        aligned, steady = with_torque(aligned, attitude, torque) if torque.any() else (aligned, None)
    axes = np.eye(3) if aligned.force_axes is None else aligned.force_axes
    # what carries the weight on a table, as the IMU's axes that were logged feel it
    held = axes.T @ np.where(aligned.unread[3:], 0.0, axes @ vehicle.environment.steady_force_m_s2)
    force = times(body_from_imu, aligned.specific_force_imu_m_s2) - held
    effect = aligned.kernel_effect
    if effect is not None and vehicle.pivoted:  # the weight as it was when the gyro's motion was, and not smeared
        mean = (up[:-1] + up[1:]) / 2
        swung = cross(mean, rate)
        force = force - vehicle.environment.gravity_m_s2 * (effect.later_s * swung + effect.smearing_s2 * cross(swung, rate))
    return Samples(
        executed=aligned,
        rate_rad_s=frozen(rate),
        rate_step_rad_s=frozen(np.diff(rate, axis=0, prepend=before.rate_rad_s[None])),
        carried_rad_s=frozen(carried),
        attitude_error_rad=frozen(error),
        specific_force_m_s2=frozen(force),
        up_b=frozen(up),
        measured=measured,
        room_torque_n_m=steady,
    )


def _carried(aligned: Aligned, vehicle: Vehicle, rate: Array, before: Before) -> tuple[Array, Array, Array]:
    """Mean rates (K, 3) that carry the attitude, what of it is uncertain (K, 3, 5), and that (K + 1, 4): by the gyro alone."""
    turns: Array = rate * aligned.duration_s[:, None]
    attitude, carried = integrate_attitude(before.attitude_wxyz, turns, before.turn_rad), rate
    error = np.zeros((len(rate), 3, 5))
    squares = aligned.duration_s**2
    since = np.cumsum(squares) - squares + before.squares_s2
    error[..., 4] = np.sqrt(np.maximum(since, 0.0))[:, None]
    if biased_attitude(False, vehicle):
        level = felt(aligned.specific_force_imu_m_s2, aligned.ignored, vehicle, np.vstack([before.rate_rad_s, rate]), aligned.duration_s)
        found = bias_seen(attitude, level, aligned.duration_s, before.seen)
        tilted = vehicle.imu.accel_bias_sigma_m_s2 / vehicle.environment.gravity_m_s2
        off = found.off(vehicle.imu.gyro_bias_sigma_rad_s, tilted, LEVELLED if vehicle.on_pedestal else FELT)
        off = off if not any(vehicle.imu.gyro_bias_rad_s) else np.zeros_like(off)  # a bias that is known is in the rates no more
        error[..., :4] = attitude_error(attitude, off, found)[:-1]
        attitude, turns = freed(attitude, turns, off)
        carried = turns / aligned.duration_s[:, None]
    return carried, error, attitude


def felt(specific_force_imu_m_s2: Array, ignored: BoolArray, vehicle: Vehicle, rate_rad_s: Array, duration_s: Array) -> Array:
    """(K, 3) specific force over gravity's, body axes; zeros where a part of it is ignored, (K, 6).

    On a pedestal that of the pivot, which stands still: by the mean rates ``rate_rad_s`` (K + 1, 3), with the cycle before the first.
    """
    body = times(np.array(vehicle.imu.body_from_imu), specific_force_imu_m_s2)
    if vehicle.on_pedestal:
        rate_dot = np.diff(rate_rad_s, axis=0) / duration_s[:, None]
        body = body - lever_arm(rate_rad_s[1:], rate_dot, np.array(vehicle.imu.position_m) - vehicle.environment.bearing_position_m)
    return np.where(ignored[:, 3:].any(1, keepdims=True), 0.0, body / vehicle.environment.gravity_m_s2)


def acceleration(samples: Samples, vehicle: Vehicle) -> Array:
    """(K, 3) acceleration of the rotation centre, m/s², body axes: specific force less lever arm and gravity (thesis 4.3, 4.4).

    The centre is O in free flight and the bearing on a testbed; ω̇ is the differenced rate over the cycle.
    """
    centre = vehicle.environment.bearing_position_m if vehicle.pivoted else (0.0, 0.0, 0.0)
    arm = np.array(vehicle.imu.position_m) - np.array(centre)
    rate_dot = samples.rate_step_rad_s / samples.executed.duration_s[:, None]
    gravity = vehicle.environment.gravity_m_s2 * (samples.up_b[:-1] + samples.up_b[1:]) / 2
    return samples.specific_force_m_s2 - lever_arm(samples.rate_rad_s, rate_dot, arm) - gravity


def biased_attitude(attitude_logged: bool, vehicle: Vehicle) -> bool:
    """Whether the attitude is integrated from a gyro that has a bias, of which gravity alone tells."""
    return vehicle.pivoted and not attitude_logged and vehicle.imu.gyro_bias_sigma_rad_s > 0


def with_torque(aligned: Aligned, attitude_wxyz: Array, torque_n_m: Array) -> tuple[Aligned, Array]:
    """What acts with the torque (3,), world axes, of a body with the attitudes (K + 1, 4) at the cycles' edges; and (K, 3) its mean.

    Within a cycle it is the parabola through both edges with the curvature ``θ × (θ × τ)`` of an even turn θ from one to the other.
    """
    edges, turn = times(matrices(inverse(attitude_wxyz)), torque_n_m), rotation_vector(turns_between(attitude_wxyz))
    bent = cross(turn, cross(turn, (edges[:-1] + edges[1:]) / 2))
    bins = aligned.impulse_bins.shape[1]
    at = ((np.arange(bins) + 0.5) / bins)[:, None]
    first, step, curve = (part[:, None] for part in (edges[:-1], np.diff(edges, axis=0), bent))
    duration = aligned.duration_s[:, None, None]
    mean = first + at * step - curve / 2 * (at * (1 - at) - 1 / (12 * bins**2))
    late = (step - curve * (0.5 - at)) / (12 * bins**2)
    impulse, skew = mean * duration / bins, late * duration
    whole = impulse.sum(1)
    rising = (at * impulse + skew / bins).sum(1)

    def added(acting: Array, by: Array) -> Array:
        return frozen(np.concatenate([acting[..., :3] + by, acting[..., 3:]], -1))

    acting = replace(
        aligned,
        impulse_bins=added(aligned.impulse_bins, impulse),
        skew_bins=added(aligned.skew_bins, skew),
        rising=added(aligned.rising, rising),
        falling=added(aligned.falling, whole - rising),
        whole=added(aligned.whole, whole),
    )
    return acting, frozen(whole / aligned.duration_s[:, None])
