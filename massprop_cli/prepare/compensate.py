"""Conversion of aligned data to :class:`Samples` in body axes: IMU mounting, attitude, vertical and lever arm."""

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
    FORCE_SCATTER,
    PEDESTAL_SCATTER,
    BiasInformation,
    attitude_error,
    bias_information,
    initial_attitude,
    integrate_attitude,
    without_offset,
    world_up_b,
)
from massprop_cli.prepare.attitudefilter import ReferenceAttitude
from massprop_cli.prepare.sensor import KernelEffect


class Mounted(Protocol):
    """Properties of the measurements and actuators that determine the estimator's states."""

    @property
    def attitude_logged(self) -> bool:
        """Whether logged attitudes measure the error of the reference attitude; only about a pivot."""

    @property
    def kernel_effect(self) -> KernelEffect | None:
        """Difference between mean readings and mean motion; None if there is none."""

    @property
    def pulsed(self) -> bool:
        """Whether impulses have independent errors, from pulse scatter or lost commands."""

    @property
    def free_inertia(self) -> Array:
        """(A,) ``free_inertia`` of :class:`massprop_cli.prepare.stored.Stored`, kg m²."""


class Source(Mounted, Protocol):
    """The control cycles of a log, computed for any range on request."""

    @property
    def wrench(self) -> Array:
        """(C, 6) torque about O and force of each command channel at full thrust."""

    @property
    def capability(self) -> Array:
        """(r, 6) wrenches that this vehicle can command."""

    @property
    def unread(self) -> BoolArray:
        """(6,) True for channels that the log lacks: rate x y z, specific force x y z."""

    @property
    def end_s(self) -> Array:
        """(K,) end of each cycle, s."""

    def __len__(self) -> int: ...

    def part(self, cycles: slice) -> Samples:
        """Samples of the given cycles; the slice has both ends."""


@dataclass(frozen=True)
class Samples:
    """Input of the estimators: measurements and executed wrenches of K control cycles, body axes."""

    executed: Aligned
    """Executed wrenches and the IMU data in IMU axes."""
    rate_rad_s: Array
    """(K, 3) mean body rate, rad/s."""
    rate_step_rad_s: Array
    """(K, 3) change of the mean rate from the previous cycle, rad/s; zero in the first."""
    carried_rad_s: Array
    """(K, 3) mean rate that propagates the reference attitude through the cycle, rad/s."""
    attitude_error_rad: Array
    """(K, 3, 5) rotation vector from the reference to the true attitude at the start of each cycle. Column 0: known part, rad. Columns
    1 to 3: derivative by the gyro bias, s. Column 4: sigma from gyro noise, over the noise of the rate, s. Zeros with ``measured``."""
    specific_force_m_s2: Array
    """(K, 3) mean specific force at the IMU, m/s²; on a planar table without the support's force."""
    up_b: Array
    """(K + 1, 3) world vertical in body axes at the start of each cycle and the end of the last; zeros in free flight."""
    measured: ReferenceAttitude | None = None
    """Reference attitude and its measurements by logged attitudes; None without logged attitudes."""
    room_torque_n_m: Array | None = None
    """(K, 3) mean of the stated torque that is fixed in the room, body axes, N m; None if none is stated."""

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
        """Whether logged attitudes measure the error of the reference attitude; only about a pivot."""
        return self.measured is not None

    @property
    def kernel_effect(self) -> KernelEffect | None:
        """Difference between mean readings and mean motion; None if there is none."""
        return self.executed.kernel_effect

    @property
    def pulsed(self) -> bool:
        """Whether impulses have independent errors, from pulse scatter or lost commands."""
        return self.executed.pulse_covariance is not None

    @property
    def free_inertia(self) -> Array:
        """(A,) ``free_inertia`` of :class:`massprop_cli.prepare.stored.Stored`, kg m²."""
        return np.zeros(0) if self.executed.stored is None else self.executed.stored.free_inertia

    @property
    def unread(self) -> BoolArray:
        """(6,) True for channels that the log lacks: rate x y z, specific force x y z."""
        return self.executed.unread

    @property
    def end_s(self) -> Array:
        """(K,) end of each cycle, s."""
        return self.executed.end_s

    def part(self, cycles: slice) -> Samples:
        """Samples of the given cycles; the slice has both ends."""
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
"""Number of cycles that are processed at once; limits memory."""


def blocks(cycles: slice, size: int = BLOCK) -> Iterator[slice]:
    """Split cycles into parts that overlap by one cycle, so that every step between two cycles is in one part."""
    for first in range(cycles.start, cycles.stop - 1, size):
        yield slice(first, min(first + size + 1, cycles.stop))


def apart(cycles: slice, size: int = BLOCK) -> Iterator[slice]:
    """Split cycles into disjoint parts, so that every cycle is in one part."""
    for first in range(cycles.start, cycles.stop, size):
        yield slice(first, min(first + size, cycles.stop))


def gathered(samples: Source, cycles: slice, per_cycle: Callable[[Samples], NDArray[T]]) -> NDArray[T]:
    """Values of ``per_cycle`` for each of the cycles, computed in parts."""
    return np.concatenate([per_cycle(samples.part(part)) for part in apart(cycles)])


@dataclass(frozen=True)
class PreviousCycle:
    """State at the end of the cycle before a part of a log."""

    rate_rad_s: Array
    """(3,) mean body rate of that cycle, rad/s."""
    turn_rad: Array
    """(3,) angle increment of that cycle, rad."""
    attitude_wxyz: Array
    """(4,) integrated attitude at its end; not used in free flight."""
    bias: BiasInformation
    """Information on the biases from all cycles before."""
    squares_s2: float
    """Sum of squared cycle lengths so far, s²; its root times the gyro's rate noise is the sigma of the integrated attitude."""

    @staticmethod
    def initial(rate_rad_s: Array, duration_s: Array, vehicle: Vehicle, late_s: float) -> PreviousCycle:
        """State before the first cycle, from rates (K, 3) and lengths (K,) of cycles; the motion is ``late_s`` after the labels."""
        attitude = initial_attitude(vehicle, rate_rad_s, duration_s, late_s)
        return PreviousCycle(rate_rad_s[0], np.zeros(3), attitude, BiasInformation.none(), 0.0)


def compensate(
    aligned: Aligned, vehicle: Vehicle, before: PreviousCycle | None = None, measured: ReferenceAttitude | None = None
) -> Samples:
    """Convert IMU data to body axes and compute the vertical, from the integrated gyro or from the reference attitude ``measured``.

    ``before`` is the state before a part of a log; None for a whole log. The specific force still contains the lever arm.
    :func:`acceleration` subtracts it with the differenced rate, as the thesis does. The default estimator models it with the commanded
    angular acceleration.
    """
    body_from_imu = np.array(vehicle.imu.body_from_imu)
    rate = times(body_from_imu, aligned.rate_imu_rad_s)
    before = before or PreviousCycle.initial(rate, aligned.duration_s, vehicle, aligned.late_s[0])
    up: Array = np.zeros((len(rate) + 1, 3))
    carried, error, attitude = rate, np.broadcast_to(0.0, (len(rate), 3, 5)), None
    if measured is not None:
        carried, attitude = rate + measured.correction_rad / aligned.duration_s[:, None], measured.attitude_wxyz
    elif vehicle.pivoted:
        carried, error, attitude = _carried(aligned, vehicle, rate, before)
    steady = None
    if attitude is not None:
        up, torque = world_up_b(attitude), np.array(vehicle.environment.room_torque_n_m)
        aligned, steady = with_torque(aligned, attitude, torque) if torque.any() else (aligned, None)
    axes = np.eye(3) if aligned.force_axes is None else aligned.force_axes
    # the support's specific force on a planar table, as far as the log holds its axes
    support = axes.T @ np.where(aligned.unread[3:], 0.0, axes @ vehicle.environment.steady_force_m_s2)
    force = times(body_from_imu, aligned.specific_force_imu_m_s2) - support
    effect = aligned.kernel_effect
    if effect is not None and vehicle.pivoted:  # refer gravity to the time of the gyro's motion, without the kernel's smearing
        mean = (up[:-1] + up[1:]) / 2
        up_rate = cross(mean, rate)
        force = force - vehicle.environment.gravity_m_s2 * (effect.later_s * up_rate + effect.smearing_s2 * cross(up_rate, rate))
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


def _carried(aligned: Aligned, vehicle: Vehicle, rate: Array, before: PreviousCycle) -> tuple[Array, Array, Array]:
    """Reference attitude from the gyro alone: propagating mean rates (K, 3), attitude error (K, 3, 5), and attitude (K + 1, 4)."""
    turns: Array = rate * aligned.duration_s[:, None]
    attitude, carried = integrate_attitude(before.attitude_wxyz, turns, before.turn_rad), rate
    error = np.zeros((len(rate), 3, 5))
    squares = aligned.duration_s**2
    since = np.cumsum(squares) - squares + before.squares_s2
    error[..., 4] = np.sqrt(np.maximum(since, 0.0))[:, None]
    if biased_attitude(False, vehicle):
        rates = np.vstack([before.rate_rad_s, rate])
        force_g = force_over_gravity(aligned.specific_force_imu_m_s2, aligned.ignored, vehicle, rates, aligned.duration_s)
        bias = bias_information(attitude, force_g, aligned.duration_s, before.bias)
        accel_sigma = vehicle.imu.accel_bias_sigma_m_s2 / vehicle.environment.gravity_m_s2
        offset = bias.offset(vehicle.imu.gyro_bias_sigma_rad_s, accel_sigma, PEDESTAL_SCATTER if vehicle.on_pedestal else FORCE_SCATTER)
        offset = offset if not any(vehicle.imu.gyro_bias_rad_s) else np.zeros_like(offset)  # a stated bias is already subtracted
        error[..., :4] = attitude_error(attitude, offset, bias)[:-1]
        attitude, turns = without_offset(attitude, turns, offset)
        carried = turns / aligned.duration_s[:, None]
    return carried, error, attitude


def force_over_gravity(specific_force_imu_m_s2: Array, ignored: BoolArray, vehicle: Vehicle, rate_rad_s: Array, duration_s: Array) -> Array:
    """(K, 3) specific force over gravity, body axes; zeros where any axis is ``ignored`` (K, 6).

    On a pedestal it is referred to the fixed pivot, by the mean rates ``rate_rad_s`` (K + 1, 3), which include the cycle before the first.
    """
    body = times(np.array(vehicle.imu.body_from_imu), specific_force_imu_m_s2)
    if vehicle.on_pedestal:
        rate_dot = np.diff(rate_rad_s, axis=0) / duration_s[:, None]
        body = body - lever_arm(rate_rad_s[1:], rate_dot, np.array(vehicle.imu.position_m) - vehicle.environment.bearing_position_m)
    return np.where(ignored[:, 3:].any(1, keepdims=True), 0.0, body / vehicle.environment.gravity_m_s2)


def acceleration(samples: Samples, vehicle: Vehicle) -> Array:
    """(K, 3) acceleration of the rotation centre, m/s², body axes: specific force less lever arm and gravity (thesis 4.3, 4.4).

    The centre is O in free flight and the pivot on a testbed. ω̇ is the change of the mean rate over the cycle length.
    """
    centre = vehicle.environment.bearing_position_m if vehicle.pivoted else (0.0, 0.0, 0.0)
    arm = np.array(vehicle.imu.position_m) - np.array(centre)
    rate_dot = samples.rate_step_rad_s / samples.executed.duration_s[:, None]
    gravity = vehicle.environment.gravity_m_s2 * (samples.up_b[:-1] + samples.up_b[1:]) / 2
    return samples.specific_force_m_s2 - lever_arm(samples.rate_rad_s, rate_dot, arm) - gravity


def biased_attitude(attitude_logged: bool, vehicle: Vehicle) -> bool:
    """Whether the attitude is integrated from a gyro with a bias that only gravity can show."""
    return vehicle.pivoted and not attitude_logged and vehicle.imu.gyro_bias_sigma_rad_s > 0


def with_torque(aligned: Aligned, attitude_wxyz: Array, torque_n_m: Array) -> tuple[Aligned, Array]:
    """Add a torque (3,) fixed in the world, N m, to the executed impulses; also return its (K, 3) mean in body axes.

    ``attitude_wxyz`` (K + 1, 4) is at the cycle edges. Within a cycle, the torque in body axes is the parabola through its edge values
    with the curvature ``θ × (θ × τ)`` of a uniform turn θ.
    """
    edges, turn = times(matrices(inverse(attitude_wxyz)), torque_n_m), rotation_vector(turns_between(attitude_wxyz))
    curvature = cross(turn, cross(turn, (edges[:-1] + edges[1:]) / 2))
    bins = aligned.impulse_bins.shape[1]
    at = ((np.arange(bins) + 0.5) / bins)[:, None]
    first, step, curve = (part[:, None] for part in (edges[:-1], np.diff(edges, axis=0), curvature))
    duration = aligned.duration_s[:, None, None]
    mean = first + at * step - curve / 2 * (at * (1 - at) - 1 / (12 * bins**2))
    late = (step - curve * (0.5 - at)) / (12 * bins**2)
    impulse, skew = mean * duration / bins, late * duration
    whole = impulse.sum(1)
    rising = (at * impulse + skew / bins).sum(1)

    def added(wrench: Array, torque: Array) -> Array:
        return frozen(np.concatenate([wrench[..., :3] + torque, wrench[..., 3:]], -1))

    total = replace(
        aligned,
        impulse_bins=added(aligned.impulse_bins, impulse),
        skew_bins=added(aligned.skew_bins, skew),
        rising=added(aligned.rising, rising),
        falling=added(aligned.falling, whole - rising),
        whole=added(aligned.whole, whole),
    )
    return total, frozen(whole / aligned.duration_s[:, None])
