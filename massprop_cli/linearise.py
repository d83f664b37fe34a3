"""The vehicle's response over control cycles, linear in its mass properties about a reference.

State x, in this order: ixx … izz, cg_x … cg_z, mu = 1/m; the cycle-mean rate (3); then the nuisances that the vehicle file asks
for: gyro bias (3), accelerometer bias (3), slowly varying disturbance torque (3); on a bearing, where the attitude comes from the gyro, its
error at the start of the cycle (3, rotation vector in body axes: true attitude = integrated attitude turned by it).

Rotation. The growth of the cycle-mean rate is the impulse under the triangular window (:mod:`massprop_cli.align`):

    I (w[k+1] − w[k]) = rising moment of k + falling moment of k+1,   moment = plant's moment about the CG − ω × I ω

It is linearised about the reference and about the *measured* mean rate of each cycle, with the motion within the cycle rebuilt from
the commands. Because the rate enters as a state (derivatives ``into``/``out of`` below) the gyroscopic term works on the filtered rate;
because the regressors come from the commands, an axis that was never driven gains no information from noise.

Translation. The accelerometer feels ``plant's force + ω̇ × ρ + ω × (ω × ρ)``, with ω̇ from the same model: linear in (c, mu), and in I
through ω̇.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples
from massprop_cli.dynamics import cross_matrix, elements, inertia_regressor, lever_arm, tensor, times
from massprop_cli.plant import Motion, Plant, Reference, plant_of
from massprop_cli.vehicle import Vehicle

PARAMETERS = slice(0, 10)
INERTIA, CG, MU = slice(0, 6), slice(6, 9), 9
RATE = slice(10, 13)
_REFINEMENTS = 3
"""Passes that rebuild the motion within a cycle; each gains a factor of rate × cycle."""


@dataclass(frozen=True)
class Layout:
    """Where the optional nuisance states stand; an absent one is an empty slice."""

    gyro_bias: slice
    accel_bias: slice
    torque: slice
    tilt: slice
    size: int

    @staticmethod
    def of(samples: Samples, vehicle: Vehicle) -> Layout:
        """The states that this vehicle and log ask for."""
        wanted = (
            vehicle.imu.gyro_bias_sigma_rad_s > 0,
            vehicle.imu.accel_bias_sigma_m_s2 > 0,
            vehicle.environment.disturbance_walk_n_m > 0,
            vehicle.on_air_bearing and samples.executed.attitude_wxyz is None,
        )
        slices, end = [], RATE.stop
        for want in wanted:
            slices.append(slice(end, end + 3 * want))
            end += 3 * want
        gyro_bias, accel_bias, torque, tilt = slices
        return Layout(gyro_bias, accel_bias, torque, tilt, end)


@dataclass(frozen=True)
class Linear:
    """Cycles ``first … first + K − 1`` as a linear system: step k leads from cycle k to k + 1."""

    transition: Array
    """(K − 1, n, n)"""
    drive: Array
    """(K − 1, n)"""
    observation: Array
    """(K, 6, n) rate and specific force in terms of the state."""
    measured: Array
    """(K, 6)"""
    moment_to_rate: Array
    """(K − 1, 3, 3) impulse of a moment [N m s] to its growth of the mean rate [rad/s]."""
    steps: Array
    """(K − 1, 3) growth of the rate that the reference expects, rad/s."""


class Windows(NamedTuple):
    """An integral over each cycle: under the rising and falling halves of the triangular window, and plain."""

    rising: Array
    falling: Array
    whole: Array

    @property
    def step(self) -> Array:
        """(K − 1, ...) from each cycle into the next."""
        joined: Array = self.rising[:-1] + self.falling[1:]
        return joined


def windows(per_bin: Array, bin_s: Array) -> Windows:
    """Integrals of a (K, B, ...) quantity given per bin of length ``bin_s`` (K,)."""
    bins = per_bin.shape[1]
    weight = (np.arange(bins) + 0.5) / bins
    trailing = per_bin.ndim - 2
    area = per_bin * bin_s.reshape(-1, 1, *(1,) * trailing)
    rising = (area * weight.reshape(1, -1, *(1,) * trailing)).sum(1)
    whole = area.sum(1)
    return Windows(rising, whole - rising, whole)


def motion_within(samples: Samples, cycles: slice, reference: Reference, plant: Plant) -> Motion:
    """Rate, angular acceleration and attitude in each bin: measured cycle means, with the shape that the commands give them."""
    rate_mean = (samples.rate_rad_s[cycles] - reference.gyro_bias)[:, None]
    impulse = samples.executed.impulse_bins[cycles]
    bin_s = (samples.executed.duration_s[cycles] / impulse.shape[1])[:, None, None]
    inverse = np.linalg.inv(reference.inertia)
    jet_moment = plant.jet_moment(reference)
    shape = (*impulse.shape[:2], 3)
    up_start = samples.up_b[:-1][cycles][:, None]
    motion = Motion(impulse / bin_s, np.broadcast_to(rate_mean, shape), np.zeros(shape), np.broadcast_to(up_start, shape))
    for _ in range(_REFINEMENTS):
        gyroscopic = np.cross(motion.rate, times(reference.inertia, motion.rate))
        moment = times(jet_moment, motion.wrench) + plant.reaction_moment(reference, motion) - gyroscopic
        rate_dot = times(inverse, moment)
        change = np.cumsum(rate_dot * bin_s, 1) - rate_dot * bin_s / 2
        rate = rate_mean + change - change.mean(1, keepdims=True)
        angle = np.cumsum(rate * bin_s, 1) - rate * bin_s / 2
        tilt = np.cross(up_start, angle)
        motion = Motion(motion.wrench, rate, rate_dot, up_start + tilt + np.cross(tilt, angle) / 2)
    return motion


@dataclass(frozen=True)
class _Moments:
    """The moment about the CG over each cycle, N m s, and its derivatives."""

    total: Windows
    by_inertia: Windows
    by_cg_mu: Windows
    by_rate: Windows
    by_tilt: Windows


def _moments(samples: Samples, cycles: slice, reference: Reference, plant: Plant, motion: Motion) -> _Moments:
    bin_s = samples.executed.duration_s[cycles] / motion.rate.shape[1]
    momentum = times(reference.inertia, motion.rate)
    rate_cross = cross_matrix(motion.rate)
    # the mean of ω × I ω over a bin in which ω̇ is constant exceeds its middle value by ω̇ × I ω̇ h² / 12
    within = np.cross(motion.rate_dot, times(reference.inertia, motion.rate_dot)) * (bin_s**2 / 12)[:, None, None]
    rest = windows(plant.reaction_moment(reference, motion) - np.cross(motion.rate, momentum) - within, bin_s)
    executed = samples.executed
    exact = (times(plant.jet_moment(reference), part[cycles]) for part in (executed.rising, executed.falling, executed.impulse))
    return _Moments(
        total=Windows(*(jets + other for jets, other in zip(exact, rest, strict=True))),
        by_inertia=windows(-rate_cross @ inertia_regressor(motion.rate), bin_s),
        by_cg_mu=windows(plant.moment_slopes(reference, motion), bin_s),
        by_rate=windows(cross_matrix(momentum) - rate_cross @ reference.inertia, bin_s),
        by_tilt=windows(plant.moment_by_tilt(reference, motion), bin_s),
    )


def linearise(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle) -> Linear:
    """The linear system of ``cycles`` (a slice with both ends given) about ``reference``. Row k uses data of cycles k and before only."""
    plant, layout = plant_of(vehicle), Layout.of(samples, vehicle)
    motion = motion_within(samples, cycles, reference, plant)
    moments = _moments(samples, cycles, reference, plant, motion)
    system = _rotation(samples, cycles, reference, layout, moments)
    return _with_observations(system, samples, cycles, reference, vehicle, motion, moments)


def _rotation(
    samples: Samples, cycles: slice, reference: Reference, layout: Layout, moments: _Moments
) -> tuple[Array, Array, Array, Array]:
    """Transition, drive, moment-to-rate map and expected growth of the steps.

    The step's derivatives with respect to the rate of the cycle it leaves and of the cycle it enters make it implicit,
    ``(1 − A) w[k+1] = (1 + B) w[k] + …``, solved here once per step.
    """
    rate, duration = samples.rate_rad_s[cycles] - reference.gyro_bias, samples.executed.duration_s[cycles]
    inverse = np.linalg.inv(reference.inertia)
    leaving, entering = inverse @ moments.by_rate.rising[:-1], inverse @ moments.by_rate.falling[1:]
    solve = np.linalg.inv(np.eye(3) - entering)
    to_rate = solve @ inverse
    steps = times(inverse, moments.total.step)
    transition = np.zeros((len(steps), layout.size, layout.size))
    transition[:] = np.eye(layout.size)
    transition[:, RATE, INERTIA] = to_rate @ (moments.by_inertia.step - inertia_regressor(steps))
    transition[:, RATE, 6:10] = to_rate @ moments.by_cg_mu.step
    transition[:, RATE, RATE] = solve @ (np.eye(3) + leaving)
    if layout.torque.stop > layout.torque.start:
        transition[:, RATE, layout.torque] = to_rate * ((duration[:-1] + duration[1:]) / 2)[:, None, None]
    drive = np.zeros((len(steps), layout.size))
    if layout.tilt.stop > layout.tilt.start:
        # the integrated attitude turned with the measured rate, the vehicle with the true one
        transition[:, RATE, layout.tilt] = to_rate @ moments.by_tilt.step
        transition[:, layout.tilt, layout.tilt] -= cross_matrix(rate[:-1]) * duration[:-1, None, None]
        transition[:, layout.tilt, RATE] = np.eye(3) * duration[:-1, None, None]
        drive[:, layout.tilt] = -samples.rate_rad_s[cycles][:-1] * duration[:-1, None]
    drive[:, RATE] = times(solve, steps - times(leaving, rate[:-1]) - times(entering, rate[1:]))
    drive[:, RATE] -= times(transition[:, RATE, PARAMETERS], parameters(reference))
    return transition, drive, to_rate, steps


def _with_observations(
    rotation: tuple[Array, Array, Array, Array],
    samples: Samples,
    cycles: slice,
    reference: Reference,
    vehicle: Vehicle,
    motion: Motion,
    moments: _Moments,
) -> Linear:
    plant, layout = plant_of(vehicle), Layout.of(samples, vehicle)
    duration = samples.executed.duration_s[cycles]
    inverse = np.linalg.inv(reference.inertia)
    arm = np.array(vehicle.imu.position_m) - plant.centre(reference)
    euler = -cross_matrix(arm) @ inverse
    rate_dot = times(inverse, moments.total.whole / duration[:, None])
    force, force_slopes = plant.force(reference, motion)
    observation = np.zeros((len(duration), 6, layout.size))
    observation[:, :3, RATE] = np.eye(3)
    observation[:, 3:, INERTIA] = euler @ (moments.by_inertia.whole / duration[:, None, None] - inertia_regressor(rate_dot))
    observation[:, 3:, 6:10] = force_slopes.mean(1) + euler @ moments.by_cg_mu.whole / duration[:, None, None]
    for block, columns, matrix in (
        (observation[:, :3], layout.gyro_bias, np.eye(3)),
        (observation[:, 3:], layout.accel_bias, np.eye(3)),
        (observation[:, 3:], layout.torque, euler),
        (observation[:, 3:], layout.tilt, plant.force_by_tilt(motion).mean(1) + euler @ moments.by_tilt.whole / duration[:, None, None]),
    ):
        if columns.stop > columns.start:
            block[:, :, columns] = matrix
    centripetal = lever_arm(motion.rate, np.zeros(3), arm).mean(1)
    expected = force.mean(1) + np.cross(rate_dot, arm) + centripetal
    offset = times(observation[:, 3:, PARAMETERS], parameters(reference)) - expected
    measured = np.hstack([samples.rate_rad_s[cycles], samples.specific_force_m_s2[cycles] + offset])
    transition, drive, moment_to_rate, steps = rotation
    return Linear(transition, drive, observation, measured, moment_to_rate, steps)


def parameters(reference: Reference) -> Array:
    """(10,) the reference as state entries: inertia, c, mu."""
    return np.concatenate([elements(reference.inertia), reference.cg, [reference.mu]])


def natural_sizes(reference: Reference) -> Array:
    """(10,) the size that each state parameter has by nature: trace, sqrt(trace/mass), 1/mass."""
    trace = float(np.trace(reference.inertia))
    sizes = np.empty(10)
    sizes[INERTIA], sizes[CG], sizes[MU] = trace, np.sqrt(trace * reference.mu), reference.mu
    return sizes


FARTHEST = 1e3
"""Factor on mass or a moment of inertia, and natural sizes of the CG's shift, that no single step may exceed."""


def stepped(reference: Reference, target: Array, gyro_bias: Array | None = None) -> Reference | None:
    """The reference moved to parameters ``target`` (10,) that a fit linear about it has found; None where that is no body.

    The response is linear in J = I⁻¹, so the step is taken there, ``J ← J − J δI J``: it lands right from a reference however far off.
    """
    if not np.isfinite(target).all() or not 1 / FARTHEST < target[MU] / reference.mu < FARTHEST:
        return None
    if np.linalg.norm(target[CG] - reference.cg) > FARTHEST * natural_sizes(reference)[CG][0]:
        return None
    inverse = np.linalg.inv(reference.inertia)
    response = inverse - inverse @ (tensor(target[INERTIA]) - reference.inertia) @ inverse
    principal = np.linalg.eigvalsh(response)
    root = np.linalg.cholesky(reference.inertia)
    change = np.linalg.eigvalsh(root.T @ response @ root)
    if principal[0] < 1e-3 * principal[2] or change[0] < 1 / FARTHEST or change[2] > FARTHEST:
        return None
    bias = reference.gyro_bias if gyro_bias is None else gyro_bias
    return Reference(np.linalg.inv(response), target[CG].copy(), float(target[MU]), bias)
