"""The vehicle's response over control cycles, linear: in coefficients that are products of its mass properties, or in these themselves.

Rotation. The growth of the cycle-mean rate is the impulse under the triangular window (:mod:`massprop_cli.align`):

    I (w[k+1] − w[k]) = rising moment of k + falling moment of k+1,   moment = that of commands and plant about the CG − ω × I ω

Multiplied by J = I⁻¹ it is linear in the coefficients φ of :mod:`massprop_cli.lift` (:func:`lifted`). The products of rates in it come
from the *measured* mean rate of each cycle, with the motion within the cycle rebuilt from the commands in a few bins: their means, first
moments and variances count, so that the error is of the fourth order in a bin's length. Because the rate is a state (derivatives
``leaving`` and ``entering`` below) the gyroscopic term works on the rate that is estimated, and noise in the measured one enters to second
order only.

Translation. The accelerometer feels the CG's specific force ``+ ω̇ × ρ + ω × (ω × ρ)``, with ω̇ from the same model.

:func:`linearise` is the same about one reference. Its state x, in this order: ixx … izz, cg_x … cg_z, mu = 1/m; the cycle-mean rate (3);
then the nuisances that the vehicle file asks for: gyro bias (3), accelerometer bias (3), slowly varying disturbance torque (3); on a
bearing, where the attitude comes from the gyro, its error at the start of the cycle (3, rotation vector in body axes: true attitude =
integrated attitude turned by it).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples
from massprop_cli.dynamics import cross, cross_matrix, elements, lever_arm, tensor, times
from massprop_cli.lift import MOMENT, J, Lift, products, products_by_rate
from massprop_cli.lift import MU as LIFT_MU
from massprop_cli.plant import BearingBody, Motion, Reference, plant_of
from massprop_cli.vehicle import Vehicle

PARAMETERS = slice(0, 10)
INERTIA, CG, MU = slice(0, 6), slice(6, 9), 9
RATE = slice(10, 13)
STEEP = 0.5
"""Largest part of a rate's error that the gyroscopic coupling may add to it or take off within half a step."""
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


def windows(per_bin: Array, bin_s: Array, lateness: Array | None = None) -> Windows:
    """Integrals of a (K, B, ...) quantity given as means over bins of length ``bin_s`` (K,).

    ``lateness`` (K, ...) is the sum of the bins' first moments, each about its own middle and over its own length: the rising half
    weights what comes late in a bin more.
    """
    bins = per_bin.shape[1]
    weight = (np.arange(bins) + 0.5) / bins
    bin_s = bin_s.reshape(-1, *(1,) * (per_bin.ndim - 2))
    rising, whole = np.einsum("b,kb...->k...", weight, per_bin) * bin_s, per_bin.sum(1) * bin_s
    if lateness is not None:
        rising += lateness / bins
    return Windows(rising, whole - rising, whole)


class Within(NamedTuple):
    """The motion in each bin, and what of it is needed beyond."""

    motion: Motion
    """Means over each bin."""
    rates: tuple[Array, Array]
    """(K, 3) the rate at the start and at the end of each cycle."""
    ups: tuple[Array, Array]
    """(K, 3) the vertical there."""


def motion_within(samples: Samples, cycles: slice, reference: Reference, lift: Lift) -> Within:
    """Rate, angular acceleration and attitude in each bin: measured cycle means, with the shape that the commands give them."""
    executed = samples.executed
    mean = samples.rate_rad_s[cycles] - reference.gyro_bias
    impulse, skew = executed.impulse_bins[cycles], executed.skew_bins[cycles]
    bin_s = (executed.duration_s[cycles] / impulse.shape[1])[:, None, None]
    theta = lift.theta(reference)
    response = _response(reference, lift, theta)
    shape = (*impulse.shape[:2], 3)
    up_start = samples.up_b[:-1][cycles]
    on_bearing = isinstance(lift.plant, BearingBody)
    motion = Motion(impulse / bin_s, np.broadcast_to(mean[:, None], shape), np.zeros(shape), np.broadcast_to(up_start[:, None], shape))
    ups = up_start, up_start
    for _ in range(_REFINEMENTS):
        coupled = times(response[:, -6:], products(motion.rate))
        coupled *= _bounded_share(coupled, motion.rate, bin_s * coupled.shape[1])
        rate_dot = times(response[:, :-6], _channels(lift, motion.wrench, motion.up)) + coupled
        # thrust that comes late in a bin leaves the bin's mean rate behind its middle's
        late = times(response[:, :-6], _channels(lift, skew, np.zeros(shape), motion.up))
        if on_bearing:
            rate_dot = rate_dot + _swing(theta, motion)
        change = np.cumsum(rate_dot * bin_s, 1)
        within = change - rate_dot * bin_s / 2 - late
        start = mean - within.mean(1)
        rate = start[:, None] + within
        up = motion.up
        if on_bearing:
            turned = np.cumsum(rate * bin_s, 1)
            up, end = (_turned(up_start, angle) for angle in (turned - rate * bin_s / 2 - rate_dot * bin_s**2 / 12, turned[:, -1:]))
            ups = up_start, end[:, 0]
        motion = Motion(motion.wrench, rate, rate_dot, up)
    return Within(motion, (start, start + change[:, -1]), ups)


def _turned(up: Array, angle: Array) -> Array:
    """(K, B, 3) the vertical (K, 3) after the body has turned by ``angle`` (K, B, 3), rad, to second order."""
    tilt = cross(up[:, None], angle)
    found: Array = up[:, None] + tilt + cross(tilt, angle) / 2
    return found


def _response(reference: Reference, lift: Lift, theta: Array) -> Array:
    """(3, C) Φ of a reference."""
    if reference.response is not None:
        return reference.response
    made: Array = lift.coefficients(theta)[0][: 3 * lift.channels].reshape(3, -1)
    return made


def _channels(lift: Lift, wrench: Array, up: Array, level_of: Array | None = None) -> Array:
    """(K, B, C − 6) what Φ multiplies in each bin but products of rates: of wrench (K, B, 6) and vertical (K, B, 3).

    ``level_of`` is the vertical that says what is level, if it is not ``up``.
    """
    if not isinstance(lift.plant, BearingBody):
        return wrench
    torque, force = wrench[..., :3], wrench[..., 3:]
    return np.concatenate([torque - cross(lift.plant.bearing, force), up, _level(up if level_of is None else level_of, force)], -1)


def _level(up: Array, v: Array) -> Array:
    """The part of vectors that lies in the level plane, P v."""
    part: Array = v - up * np.einsum("...i,...i->...", up, v)[..., None]
    return part


def _swing(theta: Array, motion: Motion) -> Array:
    """(K, B, 3) angular acceleration, on a bearing, by the acceleration that the CG's own swing gives the base: second order in κ."""
    kappa = theta[MOMENT]
    swung = cross(kappa, _level(motion.up, lever_arm(motion.rate, motion.rate_dot, kappa))) * theta[LIFT_MU]
    return times(tensor(theta[J]), swung)


@dataclass(frozen=True)
class Lifted:
    """The same response with the N coefficients φ of :mod:`massprop_cli.lift` left free.

    The n' states are the rate and the nuisances; each of a drive's and a measurement's columns but the first multiplies a coefficient.
    """

    transition: Array
    """(K − 1, n', n')"""
    drive: Array
    """(K − 1, n', 1 + N)"""
    observation: Array
    """(K, 6, n')"""
    measured: Array
    """(K, 6, 1 + N); what multiplies φ has the sign that it has beside the measured value."""
    moment_to_rate: Array
    """(K − 1, 3, 3) impulse of a moment [N m s] to its growth of the mean rate [rad/s]."""
    steps: Array
    """(K − 1, 3) growth of the rate that the reference expects, rad/s."""


def lifted(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle) -> Lifted:
    """The response of ``cycles`` (a slice with both ends given). Row k uses data of cycles k and before only.

    ``reference`` gives the motion within a cycle, and multiplies what is small: noise in the rates, products of errors.
    """
    plant, layout = plant_of(vehicle), Layout.of(samples, vehicle)
    lift = Lift(plant)
    within = motion_within(samples, cycles, reference, lift)
    motion = within.motion
    theta = lift.theta(reference)
    response = _response(reference, lift, theta)
    inverse = tensor(theta[J])
    duration = samples.executed.duration_s[cycles]
    bin_s = duration / motion.rate.shape[1]
    step, whole, known = _integrals(samples, cycles, lift, theta, within)
    steps = times(response, step) + known
    growth = np.zeros((len(step), 3, lift.size))
    for axis in range(3):
        growth[:, axis, axis * lift.channels : (axis + 1) * lift.channels] = step

    rate = samples.rate_rad_s[cycles] - reference.gyro_bias
    # the derivative of ω × I ω with respect to the rate is linear in the rate; the step's derivatives with respect to the rate of the cycle
    # it leaves and of the one it enters make it implicit, (1 − A) w[k+1] = (1 + B) w[k] + …
    mean = windows(motion.rate, bin_s, (within.rates[1] - within.rates[0]) * bin_s[:, None] / 12)
    leaving, entering = (_bounded(response[:, -6:] @ products_by_rate(part)) for part in (mean.rising[:-1], mean.falling[1:]))
    solve = np.linalg.inv(np.eye(3) - entering)
    to_rate = solve @ inverse
    states = layout.size - RATE.start
    turning, torque, tilt = (slice(s.start - RATE.start, s.stop - RATE.start) for s in (RATE, layout.torque, layout.tilt))
    transition = np.zeros((len(step), states, states))
    transition[:] = np.eye(states)
    transition[:, turning, turning] = solve @ (np.eye(3) + leaving)
    drive = np.zeros((len(step), states, 1 + lift.size))
    drive[:, turning, 0] = times(solve, known - times(leaving, rate[:-1]) - times(entering, rate[1:]))
    drive[:, turning, 1:] = solve @ growth
    if torque.stop > torque.start:
        transition[:, turning, torque] = to_rate * ((duration[:-1] + duration[1:]) / 2)[:, None, None]
    tilting = np.zeros((len(duration), 3, 3))
    if tilt.stop > tilt.start:
        # the integrated attitude turned with the measured rate, the vehicle with the true one
        by_tilt = windows(plant.moment_by_tilt(reference, motion), bin_s)
        tilting = by_tilt.whole / duration[:, None, None]
        transition[:, turning, tilt] = to_rate @ by_tilt.step
        transition[:, tilt, tilt] -= cross_matrix(rate[:-1]) * duration[:-1, None, None]
        transition[:, tilt, turning] = np.eye(3) * duration[:-1, None, None]
        drive[:, tilt, 0] = -samples.rate_rad_s[cycles][:-1] * duration[:-1, None]

    euler, felt, offset = _felt(whole, lift, reference, response, motion, np.array(vehicle.imu.position_m))
    observation = np.zeros((len(duration), 6, states))
    observation[:, :3, turning] = np.eye(3)
    for rows, columns, matrix in (
        (slice(0, 3), layout.gyro_bias, np.eye(3)),
        (slice(3, 6), layout.accel_bias, np.eye(3)),
        (slice(3, 6), layout.torque, euler @ inverse),
        (slice(3, 6), layout.tilt, plant.force_by_tilt(motion).mean(1) + euler @ inverse @ tilting),
    ):
        if columns.stop > columns.start:
            observation[:, rows, columns.start - RATE.start : columns.stop - RATE.start] = matrix
    measured = np.zeros((len(duration), 6, 1 + lift.size))
    measured[:, :3, 0] = samples.rate_rad_s[cycles]
    measured[:, 3:, 0] = samples.specific_force_m_s2[cycles] - offset
    measured[:, 3:, 1:] = -felt
    return Lifted(transition, drive, observation, measured, to_rate, steps)


def _bounded(derivative: Array) -> Array:
    """(K, 3, 3) the derivative, made smaller where an error would turn by more than ``STEEP`` within a step: it says nothing there."""
    size = np.sqrt((derivative**2).sum((1, 2)))
    found: Array = derivative * np.minimum(1.0, STEEP / np.maximum(size, STEEP))[:, None, None]
    return found


def _bounded_share(coupled: Array, rate: Array, cycle_s: Array) -> Array:
    """(K, B, 1) part of the gyroscopic coupling that changes the rate by no more than ``STEEP`` of itself within a cycle."""
    most, change = (np.sqrt((v**2).sum(-1, keepdims=True)) for v in (STEEP * rate, coupled * cycle_s))
    found: Array = most / np.maximum(np.maximum(most, change), np.finfo(float).tiny)
    return np.where(change > most, found, 1.0)


def _integrals(samples: Samples, cycles: slice, lift: Lift, theta: Array, within: Within) -> tuple[Array, Array, Array]:
    """What Φ multiplies: (K − 1, C) under the triangular window, (K, C) mean over each cycle; (K − 1, 3) known growth of the rate."""
    plant, executed, motion = lift.plant, samples.executed, within.motion
    duration = executed.duration_s[cycles]
    bin_s = duration / motion.rate.shape[1]
    # the mean of a product over a bin in which ω̇ is constant exceeds its middle value by that of the accelerations times h² / 12
    second = products(motion.rate) + products(motion.rate_dot) * (bin_s**2 / 12)[:, None, None]
    lateness = np.zeros((len(duration), lift.channels))
    lateness[:, -6:] = (products(within.rates[1]) - products(within.rates[0])) * bin_s[:, None] / 12
    if isinstance(plant, BearingBody):
        lateness[:, 3:6] = (within.ups[1] - within.ups[0]) * bin_s[:, None] / 12
        lateness[:, 6:9] = _level(motion.up, executed.skew_bins[cycles][..., 3:]).sum(1)
    multiplied = np.concatenate([_channels(lift, motion.wrench, motion.up), second], -1)
    rising, _, whole = windows(multiplied, bin_s, lateness)
    # the commands' own, exactly
    jets = np.concatenate([executed.rising[cycles], executed.impulse[cycles]], -1).reshape(len(duration), 2, 6)
    if isinstance(plant, BearingBody):
        jets = jets[..., :3] - cross(plant.bearing, jets[..., 3:])
    rising[:, : jets.shape[2]], whole[:, : jets.shape[2]] = jets[:, 0], jets[:, 1]
    known = windows(_swing(theta, motion), bin_s).step if isinstance(plant, BearingBody) else np.zeros((len(duration) - 1, 3))
    return Windows(rising, whole - rising, whole).step, whole / duration[:, None], known


def _felt(whole: Array, lift: Lift, reference: Reference, response: Array, motion: Motion, position: Array) -> tuple[Array, Array, Array]:
    """The specific force: (K, 3, 3) by angular acceleration, (K, 3, N) by the coefficients, (K, 3) the rest."""
    plant, channels = lift.plant, lift.channels
    rate_dot = times(response, whole)
    square = tensor(whole[:, -6:])  # the mean of ω ωᵀ
    centripetal = square - np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    rotation = centripetal + cross_matrix(rate_dot)
    felt = np.zeros((len(whole), 3, lift.size))
    if isinstance(plant, BearingBody):
        theta = lift.theta(reference)
        arm, along = position - plant.bearing, cross_matrix(theta[LIFT_MU] * theta[MOMENT])
        level = np.eye(3) - np.einsum("kbi,kbj->kij", motion.up, motion.up) / motion.up.shape[1]
        euler = level @ along - cross_matrix(arm)
        felt[..., -4], felt[..., -3:] = whole[:, 6:9], -level @ rotation
        offset = plant.gravity * whole[:, 3:6] + times(centripetal, arm) - times(level @ along, rate_dot)
    else:
        euler = np.broadcast_to(-cross_matrix(position - reference.cg), rotation.shape)
        felt[..., -4], felt[..., -3:] = whole[:, 3:6], -rotation
        offset = times(centripetal, position) + cross(rate_dot, reference.cg)
    felt[..., : 3 * channels] = (euler[..., None] * whole[:, None, None, :]).reshape(len(whole), 3, -1)
    return euler, felt, offset


def linearise(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle) -> Linear:
    """The linear system of ``cycles`` (a slice with both ends given) about ``reference``. Row k uses data of cycles k and before only."""
    free = lifted(samples, cycles, reference, vehicle)
    lift, layout = Lift(plant_of(vehicle)), Layout.of(samples, vehicle)
    theta = lift.theta(reference)
    phi, slopes = lift.coefficients(theta)
    by_parameter = slopes @ np.linalg.inv(lift.slopes(theta))
    about = phi - by_parameter @ parameters(reference)
    states = slice(RATE.start, None)
    transition = np.zeros((len(free.drive), layout.size, layout.size))
    transition[:, PARAMETERS, PARAMETERS] = np.eye(10)
    transition[:, states, states] = free.transition
    transition[:, RATE, PARAMETERS] = free.drive[:, :3, 1:] @ by_parameter
    drive = np.zeros((len(free.drive), layout.size))
    drive[:, states] = free.drive[..., 0] + free.drive[..., 1:] @ about
    observation = np.zeros((len(free.measured), 6, layout.size))
    observation[..., states] = free.observation
    observation[:, 3:, PARAMETERS] = -free.measured[:, 3:, 1:] @ by_parameter
    measured = free.measured[..., 0] + free.measured[..., 1:] @ about
    return Linear(transition, drive, observation, measured, free.moment_to_rate, free.steps)


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
