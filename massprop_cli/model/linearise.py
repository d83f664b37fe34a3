"""The vehicle's response over control cycles, linear: in coefficients that are products of its mass properties, or in these themselves.

Rotation. The growth of the cycle-mean rate is the impulse under the triangular window (:mod:`massprop_cli.prepare.align`):

    I (w[k+1] − w[k]) = rising moment of k + falling moment of k+1,   moment = that of commands and plant about the CG − ω × I ω

Multiplied by J = I⁻¹ it is linear in the coefficients φ of :mod:`massprop_cli.model.plant` (:func:`lifted`). The products of rates in it
come from the *measured* mean rate of each cycle, with the motion within the cycle rebuilt (:mod:`massprop_cli.model.within`). Because the
rate is a state (derivatives ``leaving`` and ``entering`` below) the gyroscopic term works on the rate that is estimated, and noise in the
measured one enters to second order only.

Translation. The accelerometer feels the CG's specific force ``+ ω̇ × ρ + ω × (ω × ρ)``, with ω̇ from the same model.

:func:`linearise` is the same about one reference. Its state x, in this order: ixx … izz, cg_x … cg_z, mu = 1/m; the cycle-mean rate (3);
then the nuisances that the vehicle file asks for: gyro bias (3), accelerometer bias (3), slowly varying disturbance torque (3), damping of
the turn about each axis (3); on a bearing, where the attitude comes from the gyro, its error at the start of the cycle (3, rotation vector
in body axes: true attitude = integrated attitude turned by it); on a table, what the accelerometer feels of its slope in the middle of the
cycle (2); of a vehicle with wheels, relative errors of scales that are uncertain, of all thrust and of each wheel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross_matrix, elements, inverse, tensor, times
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import kernel
from massprop_cli.model import handed
from massprop_cli.model.damping import impulse_by_damping, made_by_motion
from massprop_cli.model.gyroscopic import products, products_by_rate
from massprop_cli.model.lift import Lift
from massprop_cli.model.momentum import held, moments_by_scale, scale_sigmas
from massprop_cli.model.plant import Motion, Plant, Reference, plant_of
from massprop_cli.model.plant.plant import MU as THETA_MU
from massprop_cli.model.plant.plant import Turning
from massprop_cli.model.windows import Windows, windows
from massprop_cli.model.within import STEEP, Within, motion_within, response_of
from massprop_cli.prepare.compensate import Mounted, Samples, Source

PARAMETERS = slice(0, 10)
INERTIA, CG, MU = slice(0, 6), slice(6, 9), 9
RATE = slice(10, 13)


@dataclass(frozen=True)
class Layout:
    """Where the optional nuisance states stand; an absent one is an empty slice."""

    gyro_bias: slice
    accel_bias: slice
    torque: slice
    damping: slice
    tilt: slice
    scale: slice
    """Relative errors of the thrust's scale and of the wheels' inertias, of a vehicle that has wheels."""
    size: int

    @staticmethod
    def of(samples: Mounted, vehicle: Vehicle) -> Layout:
        """The states that this vehicle and log ask for."""
        sizes = (
            3 * (vehicle.imu.gyro_bias_sigma_rad_s > 0),
            3 * (vehicle.imu.accel_bias_sigma_m_s2 > 0),
            3 * (vehicle.environment.disturbance_walk_n_m > 0),
            3 * (vehicle.environment.damping_sigma_n_m_s > 0),
            plant_of(vehicle).tilts(samples.attitude_logged),
        )
        slices, end = [], RATE.stop
        for size in sizes:
            slices.append(slice(end, end + size))
            end += size
        gyro_bias, accel_bias, torque, damping, tilt = slices
        scale = slice(end, end + len(scale_sigmas(vehicle)))
        return Layout(gyro_bias, accel_bias, torque, damping, tilt, scale, scale.stop)

    @staticmethod
    def of_all(own: Array) -> Array:
        """What is of the rate and the nuisances, with zeros for the parameters, so that the layout's slices are of it."""
        return np.concatenate([np.zeros(RATE.start), own])


@dataclass(frozen=True)
class _Steps:
    """Of cycles ``first … first + K − 1``, in both forms: step k leads from cycle k to k + 1; n states."""

    transition: Array
    """(K − 1, n, n)"""
    observation: Array
    """(K, 6, n) rate and specific force in terms of the state."""
    moment_to_rate: Array
    """(K − 1, 3, 3) impulse of a moment [N m s] to its growth of the mean rate [rad/s]."""
    steps: Array
    """(K − 1, 3) growth of the rate that the reference expects, rad/s."""


@dataclass(frozen=True)
class Linear(_Steps):
    """A linear system about one reference."""

    drive: Array
    """(K − 1, n)"""
    measured: Array
    """(K, 6)"""


@dataclass(frozen=True)
class Lifted(_Steps):
    """The same response with the N coefficients φ of :mod:`massprop_cli.model.plant` left free, or c combinations of them.

    Its states are the rate and the nuisances; each of a drive's and a measurement's columns but the first multiplies a coefficient.
    """

    drive: Array
    """(K − 1, n, 1 + N)"""
    measured: Array
    """(K, 6, 1 + N); what multiplies φ has the sign that it has beside the measured value."""


def lifted(
    samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, onto: Array | None = None, rebuilt: Within | None = None
) -> Lifted:
    """The response of ``cycles`` (a slice with both ends given). Row k uses data of cycles k and before only.

    ``reference`` gives the motion within a cycle, and multiplies what is small: noise in the rates, products of errors. With ``onto``
    (N, c) there is a column for each of these combinations of coefficients instead; ``rebuilt`` is the motion within, where it is at hand.
    Where there is a compiled kernel that knows the vehicle, its equations run instead of what stands here.
    """
    plant, layout, here = plant_of(vehicle), Layout.of(samples, vehicle), samples.part(cycles)
    lift = Lift(plant)
    if compiled(vehicle):
        return _compiled(here, layout, lift, reference, vehicle, onto)
    within = motion_within(here, reference, lift) if rebuilt is None else rebuilt
    theta, response, motion = within.theta, within.response, within.motion
    duration = here.executed.duration_s
    bin_s = duration / motion.rate.shape[1]
    step, whole, known = integrals(here, lift, theta, within)
    steps = times(response, step) + known
    combined = lift.size if onto is None else onto.shape[1]

    rate = here.rate_rad_s - reference.gyro_bias
    # the derivative of ω × I ω with respect to the rate is linear in the rate; the step's derivatives with respect to the rate of the cycle
    # it leaves and of the one it enters make it implicit, (1 − A) w[k+1] = (1 + B) w[k] + …
    mean = windows(motion.rate, bin_s, (within.rates[1] - within.rates[0]) * bin_s[:, None] / 12)
    by_rate = response[:, -6:] @ products_by_rate(np.eye(3))
    leaving, entering = (np.einsum("kl,lij->kij", part, by_rate) for part in (mean.rising[:-1], mean.falling[1:]))
    own = plant.turning(theta)
    if here.executed.stored is not None:
        momentum = held(here.executed.stored, bin_s)
        leaving, entering = leaving + own @ cross_matrix(momentum.rising[:-1]), entering + own @ cross_matrix(momentum.falling[1:])
    if reference.damping.any():
        half = own @ np.diag(reference.damping) * duration[:, None, None] / 2
        leaving, entering = leaving - half[:-1], entering - half[1:]
    leaving, entering = _bounded(leaving), _bounded(entering)
    solve = inverse(np.eye(3) - entering)
    to_rate = solve @ own
    states = layout.size - RATE.start
    blocks = (RATE, layout.torque, layout.damping, layout.tilt)
    turning, torque, damping, tilt = (slice(s.start - RATE.start, s.stop - RATE.start) for s in blocks)
    transition = np.zeros((len(step), states, states))
    transition[:] = np.eye(states)
    transition[:, turning, turning] = solve @ (np.eye(3) + leaving)
    drive = np.zeros((len(step), states, 1 + combined))
    drive[:, turning, 0] = times(solve, known - times(leaving, rate[:-1]) - times(entering, rate[1:]))
    if onto is None:
        each = drive[:, turning, 1 : 1 + 3 * lift.channels].reshape(len(step), 3, 3, lift.channels)
        np.multiply(solve[..., None], step[:, None, None, :], out=each)
        drive[:, turning, 1 : 1 + 3 * lift.channels] = each.reshape(len(step), 3, -1)
    else:
        drive[:, turning, 1:] = solve @ _by_axis(step, onto)
    if torque.stop > torque.start:
        transition[:, turning, torque] = to_rate * ((duration[:-1] + duration[1:]) / 2)[:, None, None]
    damped = np.zeros((len(duration), 3, damping.stop - damping.start))
    if damping.stop > damping.start:
        by_damping = impulse_by_damping(motion, within.rates, bin_s)
        damped = by_damping.whole / duration[:, None, None]
        transition[:, turning, damping] = to_rate @ by_damping.step
        drive[:, turning, 0] -= transition[:, turning, damping] @ reference.damping
    tilting = np.zeros((len(duration), 3, tilt.stop - tilt.start))
    if tilt.stop > tilt.start:
        by_tilt = windows(plant.moment_by_tilt(reference, motion), bin_s)
        tilting = by_tilt.whole / duration[:, None, None]
        kept, by_error = plant.tilt_step(rate, duration)
        transition[:, turning, tilt] = to_rate @ by_tilt.step
        transition[:, tilt, tilt], transition[:, tilt, turning] = kept, by_error
        drive[:, tilt, 0] = -times(by_error, here.rate_rad_s[:-1])

    scaling = _scaling(here, vehicle, plant, reference, motion)
    if scaling is not None:
        transition[:, turning, layout.scale.start - RATE.start :] = to_rate @ scaling.step
        if len(reference.scale):
            steps = steps + own @ scaling.step @ reference.scale
    euler, felt, offset = _felt(whole, lift, reference, response, motion, np.array(vehicle.imu.position_m), onto)
    observation = np.zeros((len(duration), 6, states))
    observation[:, :3, turning] = np.eye(3)
    for rows, columns, matrix in (
        (slice(0, 3), layout.gyro_bias, np.eye(3)),
        (slice(3, 6), layout.accel_bias, np.eye(3)),
        (slice(3, 6), layout.torque, euler @ own),
        (slice(3, 6), layout.damping, euler @ own @ damped),
    ):
        if columns.stop > columns.start:
            observation[:, rows, columns.start - RATE.start : columns.stop - RATE.start] = matrix
    if tilt.stop > tilt.start:
        observation[:, 3:, tilt] = plant.force_by_tilt(motion).mean(1) + euler @ own @ tilting
    if scaling is not None:
        observation[:, 3:, layout.scale.start - RATE.start :] = euler @ own @ scaling.whole / duration[:, None, None]
        if vehicle.thrust.scale_sigma > 0:
            observation[:, 3:, layout.scale.start - RATE.start] += theta[THETA_MU] * whole[:, plant.force]
    measured = np.zeros((len(duration), 6, 1 + combined))
    measured[:, :3, 0] = here.rate_rad_s
    measured[:, 3:, 0] = here.specific_force_m_s2 - offset
    if damping.stop > damping.start:
        measured[:, 3:, 0] += observation[:, 3:, damping] @ reference.damping
    np.negative(felt, out=measured[:, 3:, 1:])
    return Lifted(transition, observation, to_rate, steps, drive, measured)


def compiled(vehicle: Vehicle) -> bool:
    """Whether the compiled kernel is there and knows this vehicle."""
    return kernel().library is not None and not handed.unknown(vehicle)


def _compiled(here: Samples, layout: Layout, lift: Lift, reference: Reference, vehicle: Vehicle, onto: Array | None) -> Lifted:
    """The same by the compiled kernel."""
    theta = lift.theta(reference)
    response = response_of(reference, lift, theta)
    about = (theta, reference.inertia.ravel(), reference.cg, [reference.mu], reference.gyro_bias, response.ravel())
    numbers, size = vehicle_numbers(layout, vehicle), lift.size if onto is None else onto.shape[1]
    return Lifted(*handed.lifted(numbers, np.concatenate(about), handed.packed(here, vehicle), layout.size - RATE.start, size, onto))


def vehicle_numbers(layout: Layout, vehicle: Vehicle, slow_torque_sigma: float = 0.0, reach_m: float = 0.0) -> Array:
    """All that is constant, as the kernel has it; what a flight begins with may be left out of a linearisation."""
    blocks = (layout.gyro_bias, layout.accel_bias, layout.torque, layout.tilt)
    return handed.vehicle_numbers(vehicle, [block.stop > block.start for block in blocks], slow_torque_sigma, reach_m)


def _scaling(here: Samples, vehicle: Vehicle, plant: Plant, reference: Reference, motion: Motion) -> Windows | None:
    return moments_by_scale(here.executed, vehicle, plant, reference, motion) if len(scale_sigmas(vehicle)) else None


def _bounded(derivative: Array) -> Array:
    """(K, 3, 3) the derivative, made smaller where an error would turn by more than ``STEEP`` within a step: it says nothing there."""
    size = np.sqrt((derivative**2).sum((1, 2)))
    found: Array = derivative * np.minimum(1.0, STEEP / np.maximum(size, STEEP))[:, None, None]
    return found


def integrals(samples: Samples, lift: Lift, theta: Array, within: Within) -> tuple[Array, Array, Array]:
    """What Φ multiplies: (K − 1, C) under the triangular window, (K, C) mean over each cycle; (K − 1, 3) known growth of the rate."""
    plant, executed, motion = lift.plant, samples.executed, within.motion
    duration = executed.duration_s
    bin_s = duration / motion.rate.shape[1]
    # the mean of a product over a bin in which ω̇ is constant exceeds its middle value by that of the accelerations times h² / 12
    second = products(motion.rate) + products(motion.rate_dot) * (bin_s**2 / 12)[:, None, None]
    # the commands' own exactly, the rest by its bins
    jets = plant.commanded(np.stack([executed.rising, executed.impulse]))
    parts = [(second, (products(within.rates[1]) - products(within.rates[0])) * bin_s[:, None] / 12)]
    made = made_by_motion(executed.stored, within.damping, motion, bin_s[:, None, None])
    if made is not None:
        own = windows(made[0], bin_s, made[1].sum(1))
        jets = np.concatenate([jets[..., :3] + np.stack([own.rising, own.whole]), jets[..., 3:]], -1)
    parts = [*plant.by_attitude(motion, within.ups, executed.skew_bins, bin_s), *parts]
    each = [windows(channels, bin_s, lateness) for channels, lateness in parts]
    rising = np.concatenate([jets[0], *(one.rising for one in each)], -1)
    whole = np.concatenate([jets[1], *(one.whole for one in each)], -1)
    known = windows(plant.swing(theta, motion), bin_s).step if plant.pivoted else np.zeros((len(duration) - 1, 3))
    return Windows(rising, whole - rising, whole).step, whole / duration[:, None], known


def _by_axis(channels: Array, onto: Array) -> Array:
    """(K, 3, c) what Φ makes of channels (K, C) in combinations ``onto`` (N, c) of its coefficients."""
    count = 3 * channels.shape[1]
    by_channel = onto[:count].reshape(3, -1, onto.shape[1])
    found: Array = np.einsum("kc,acm->kam", channels, by_channel)
    return found


def _felt(
    whole: Array, lift: Lift, reference: Reference, response: Array, motion: Motion, position: Array, onto: Array | None
) -> tuple[Array, Array, Array]:
    """The specific force: (K, 3, 3) by angular acceleration, (K, 3, N or c) by the coefficients, (K, 3) the rest."""
    plant, channels = lift.plant, lift.channels
    rate_dot = times(response, whole)
    square = tensor(whole[:, -6:])  # the mean of ω ωᵀ
    centripetal = square - np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    turning = Turning(whole, rate_dot, centripetal, centripetal + cross_matrix(rate_dot))
    euler, own, offset = plant.felt(reference, motion, turning, position)
    if onto is not None:
        return euler, euler @ _by_axis(whole, onto) + own @ onto[3 * channels :], offset
    by_response = (euler[..., None] * whole[:, None, None, :]).reshape(len(whole), 3, -1)
    return euler, np.concatenate([by_response, own], -1), offset


def linearise(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> Linear:
    """The linear system of ``cycles`` (a slice with both ends given) about ``reference``. Row k uses data of cycles k and before only."""
    lift, layout = Lift(plant_of(vehicle)), Layout.of(samples, vehicle)
    theta = lift.theta(reference)
    phi, slopes = lift.coefficients(theta)
    by_parameter = slopes @ np.linalg.inv(lift.slopes(theta))
    about = phi - by_parameter @ parameters(reference)
    free = lifted(samples, cycles, reference, vehicle, np.column_stack([about, by_parameter]))
    states = slice(RATE.start, None)
    transition = np.zeros((len(free.drive), layout.size, layout.size))
    transition[:, PARAMETERS, PARAMETERS] = np.eye(10)
    transition[:, states, states] = free.transition
    transition[:, RATE, PARAMETERS] = free.drive[:, :3, 2:]
    drive = np.zeros((len(free.drive), layout.size))
    drive[:, states] = free.drive[..., 0] + free.drive[..., 1]
    observation = np.zeros((len(free.measured), 6, layout.size))
    observation[..., states] = free.observation
    observation[:, 3:, PARAMETERS] = -free.measured[:, 3:, 2:]
    measured = free.measured[..., 0] + free.measured[..., 1]
    return Linear(transition, observation, free.moment_to_rate, free.steps, drive, measured)


def less_tilt(system: Linear, left: Array, tilt: slice) -> Array:
    """(K, 3) specific force ``left`` over by the mass properties, without what the states ``tilt`` of an unknown beginning explain of it.

    Where an error of the rate leaves them alone: what a table holds of the weight's pull along its slope.
    """
    carried = np.empty((len(left), 3, tilt.stop - tilt.start))
    state: Array = np.eye(tilt.stop - tilt.start)
    for k, seen in enumerate(system.observation[:, 3:, tilt]):
        carried[k] = seen @ state
        state = state if k == len(left) - 1 else system.transition[k, tilt, tilt] @ state
    rows = np.concatenate([carried, system.observation[: len(left), 3:, PARAMETERS]], -1).reshape(-1, carried.shape[2] + 10)
    size = np.sqrt((rows**2).sum(0))
    size = np.where(size > 0, size, 1.0)
    held = np.linalg.lstsq(rows / size, left.ravel(), rcond=1e-9)[0] / size
    found: Array = left - carried @ held[: carried.shape[2]]
    return found


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
