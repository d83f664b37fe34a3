"""Regressors of the response over control cycles, linear in coefficients that are products of the mass properties.

Rotation. The growth of the cycle-mean rate is the impulse under the triangular window (:mod:`massprop_cli.prepare.align`):

    I (w[k+1] − w[k]) = rising moment of k + falling moment of k+1,   moment = that of commands and plant about the CG − ω × I ω

Multiplied by J = I⁻¹ it is linear in the coefficients φ of :mod:`massprop_cli.model.plant` (:func:`regressors`). The products of rates in
it come from the *measured* mean rate of each cycle, with the motion within the cycle rebuilt (:mod:`massprop_cli.model.intracycle`).
Because the rate is a state (derivatives ``leaving`` and ``entering`` below) the gyroscopic term works on the rate that is estimated, and
noise in the measured one enters to second order only.

Translation. The accelerometer feels the CG's specific force ``+ ω̇ × ρ + ω × (ω × ρ)``, with ω̇ from the same model and ω the measured
rate, from which the state's departs by noise, and by what the gyro's bias is beyond the reference's.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross_matrix, inverse, tensor, times
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import kernel
from massprop_cli.model import kernelargs
from massprop_cli.model.gyroscopic import products_by_rate
from massprop_cli.model.intracycle import STEEP, Within, integrals, motion_within, turned_beyond
from massprop_cli.model.layout import RATE, Layout
from massprop_cli.model.momentum import held, impulse_by_damping, moments_by_scale
from massprop_cli.model.plant import Motion, Plant, Reference, plant_of
from massprop_cli.model.plant.plant import MU as THETA_MU
from massprop_cli.model.plant.plant import Turning
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.windows import Windows, windows
from massprop_cli.prepare.compensate import Samples, Source


@dataclass(frozen=True)
class Steps:
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
class Regressors(Steps):
    """The same response with the N coefficients φ of :mod:`massprop_cli.model.plant` left free, or c combinations of them.

    Its states are the rate and the nuisances; each of a drive's and a measurement's columns but the first multiplies a coefficient.
    """

    drive: Array
    """(K − 1, n, 1 + N)"""
    measured: Array
    """(K, 6, 1 + N); what multiplies φ has the sign that it has beside the measured value."""

    def beyond(self, coefficients: Array, state: Array) -> tuple[Array, Array]:
        """(K − 1, n) the state one step on, and (K, 6) what is measured beyond what the state (K, n) gives, of ``coefficients``."""
        driven, measured = (part[..., 0] + part[..., 1:] @ coefficients for part in (self.drive, self.measured))
        return times(self.transition, state[:-1]) + driven, measured - times(self.observation, state)


def regressors(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, onto: Array | None = None) -> Regressors:
    """The response of ``cycles`` (a slice with both ends given). Row k uses data of cycles k and before only.

    ``reference`` gives the motion within a cycle, and multiplies what is small: noise in the rates, products of errors. With ``onto``
    (N, c) there is a column for each of these combinations of coefficients instead.
    Where there is a compiled kernel that knows the vehicle, its equations run instead of what stands here.
    """
    plant, layout, here = plant_of(vehicle), Layout.of(samples, vehicle), samples.part(cycles)
    phi_map = ResponseMap(plant)
    if compiled(vehicle):
        return _as_read(_compiled(here, layout, phi_map, reference, vehicle, onto), here)
    within = motion_within(here, reference, phi_map)
    step, whole, known = integrals(here, phi_map, within.theta, within)
    coupling = _coupling(here, phi_map, within, reference)
    acting = _acting(here, layout, vehicle, plant, reference, within)
    tilting = _tilting(here, plant, within, reference) if layout.has(layout.tilt) else None
    about = _About(here, layout, phi_map, reference, within, coupling, acting, tilting)
    steps = times(within.response, step) + known
    if "scale" in acting and len(reference.scale):
        steps = steps + acting["scale"].step @ reference.scale
    transition, drive = _rotation(about, step, known, onto)
    observation, measured = _translation(about, whole, vehicle, onto)
    return _as_read(Regressors(transition, observation, coupling.to_rate, steps, drive, measured), here)


def _as_read(found: Regressors, here: Samples) -> Regressors:
    """With specific force along the axes that it is measured along, and nothing in channels that the log doesn't have."""
    for part in (found.observation, found.measured):
        as_read(part, here)
    return found


def as_read(rows: Array, here: Samples) -> Array:
    """The same of rows (K, 6, ...) along body axes, in place."""
    if here.executed.force_axes is not None:
        rows[:, 3:] = np.einsum("ij,kj...->ki...", here.executed.force_axes, rows[:, 3:])
    if here.unread.any():
        rows[:, here.unread] = 0.0
    return rows


class _Coupling(NamedTuple):
    """The step from one cycle's rate into the next one's, (1 − A) w[k+1] = (1 + B) w[k] + what acts."""

    leaving: Array
    """(K − 1, 3, 3) B"""
    entering: Array
    """(K − 1, 3, 3) A"""
    own: Array
    """(3, 3) of a moment to the angular acceleration."""
    solve: Array
    """(K − 1, 3, 3) (1 − A)⁻¹"""
    to_rate: Array
    """(K − 1, 3, 3) of a moment's impulse to the growth of the rate."""


class _Tilting(NamedTuple):
    """What t states that say where the weight pulls do, as they are at the start of a cycle."""

    kept: Array
    """(K − 1, t, t) to themselves in the next cycle, ..."""
    by_error: Array
    """(K − 1, t, 3) ... into which an error of the rate comes, rad/s."""
    halves: tuple[Array, Array]
    """(K − 1, 3, t) to the moment under the triangular window: in the cycle that a step leaves; in the one it enters, as they are there."""
    whole: Array
    """(K, 3, t) to its mean over the cycle, N m."""
    force: Array
    """(K, 3, t) to the mean specific force of the centre, m/s²."""


class _About(NamedTuple):
    """Cycles, and what they are linear about."""

    here: Samples
    layout: Layout
    phi_map: ResponseMap
    reference: Reference
    within: Within
    coupling: _Coupling
    acting: Mapping[str, Windows]
    """As of :func:`_acting`."""
    tilting: _Tilting | None
    """Where an error of the attitude is a state."""


def _bin_s(here: Samples, motion: Motion) -> Array:
    """(K,) length of a bin of each cycle."""
    return here.executed.duration_s / motion.rate.shape[1]


def _coupling(here: Samples, phi_map: ResponseMap, within: Within, reference: Reference) -> _Coupling:
    """Of the derivative of ω × I ω with respect to the rate, which is linear in the rate; and what hangs on a bearing turns meanwhile.

    The step's derivatives with respect to the rates of the cycle that it leaves and of the one that it enters make it implicit.
    """
    bin_s = _bin_s(here, within.motion)
    mean = windows(within.motion.rate, bin_s, (within.rates[1] - within.rates[0]) * bin_s[:, None] / 12)
    by_rate = within.response[:, -6:] @ products_by_rate(np.eye(3))
    leaving, entering = (np.einsum("kl,lij->kij", part, by_rate) for part in (mean.rising[:-1], mean.falling[1:]))
    own = phi_map.plant.turning(within.theta)
    if here.executed.stored is not None:
        momentum = held(here.executed.stored, bin_s)
        leaving, entering = leaving + own @ cross_matrix(momentum.rising[:-1]), entering + own @ cross_matrix(momentum.falling[1:])
    if reference.damping.any():
        half = own @ np.diag(reference.damping) * here.executed.duration_s[:, None, None] / 2
        leaving, entering = leaving - half[:-1], entering - half[1:]
    leaving, entering = _bounded(leaving), _bounded(entering)
    if phi_map.plant.pivoted:
        up, executed, turned = windows(within.motion.up, bin_s), here.executed, own * here.executed.duration_s[:, None, None]
        leaving = leaving + (turned @ phi_map.plant.moment_by_tilt(reference, up.rising, executed.rising[:, 3:]))[:-1] * (2 / 3)
        entering = entering + (turned @ phi_map.plant.moment_by_tilt(reference, up.falling, executed.falling[:, 3:]))[1:] / 3
    solve = inverse(np.eye(3) - entering)
    return _Coupling(leaving, entering, own, solve, solve @ own)


def _rotation(about: _About, step: Array, known: Array, onto: Array | None) -> tuple[Array, Array]:
    """(K − 1, n, n) transition and (K − 1, n, 1 + c) drive of the states."""
    here, layout, phi_map, reference = about.here, about.layout, about.phi_map, about.reference
    (leaving, entering, _, solve, to_rate), rate = about.coupling, here.rate_rad_s - reference.gyro_bias
    turning, damping, tilt = (layout.own(block) for block in (RATE, layout.damping, layout.tilt))
    transition = np.zeros((len(step), layout.states, layout.states))
    transition[:] = np.eye(layout.states)
    transition[:, turning, turning] = solve @ (np.eye(3) + leaving)
    drive = np.zeros((len(step), layout.states, 1 + (phi_map.size if onto is None else onto.shape[1])))
    drive[:, turning, 0] = times(solve, known - times(leaving, rate[:-1]) - times(entering, rate[1:]))
    if onto is None:
        each = drive[:, turning, 1 : 1 + 3 * phi_map.channels].reshape(len(step), 3, 3, phi_map.channels)
        np.multiply(solve[..., None], step[:, None, None, :], out=each)
        drive[:, turning, 1 : 1 + 3 * phi_map.channels] = each.reshape(len(step), 3, -1)
    else:
        drive[:, turning, 1:] = solve @ _by_axis(step, onto)
    for name, windows_of in about.acting.items():
        transition[:, turning, layout.own(getattr(layout, name))] = solve @ windows_of.step
    drive[:, turning, 0] -= transition[:, turning, damping] @ reference.damping[: damping.stop - damping.start]
    if about.tilting is not None:
        kept, by_error, leaving, entering = about.tilting.kept, about.tilting.by_error, *(to_rate @ part for part in about.tilting.halves)
        transition[:, turning, tilt] = leaving + entering @ kept
        transition[:, tilt, tilt], transition[:, tilt, turning] = kept, by_error
        carried = here.carried_rad_s - turned_beyond(about.within, here) if phi_map.plant.pivoted else here.carried_rad_s
        drive[:, tilt, 0] = -times(by_error, carried[:-1])
        transition[:, turning, turning] += entering @ by_error
        drive[:, turning, 0] += times(entering, drive[:, tilt, 0])
    return transition, drive


def _translation(about: _About, whole: Array, vehicle: Vehicle, onto: Array | None) -> tuple[Array, Array]:
    """(K, 6, n) rate and specific force by the states, and (K, 6, 1 + c) what was measured of them."""
    here, layout, phi_map, within = about.here, about.layout, about.phi_map, about.within
    damping, duration = layout.own(layout.damping), here.executed.duration_s
    euler, felt, offset = _felt(whole, phi_map, about.reference, within.response, within.motion, np.array(vehicle.imu.position_m), onto)
    observation = np.zeros((len(duration), 6, layout.states))
    observation[:, :3, layout.own(RATE)] = np.eye(3)
    observation[:, 3:, layout.own(RATE)] = by_rate = _felt_by_rate(about, euler)
    for rows, block in ((slice(0, 3), layout.gyro_bias), (slice(3, 6), layout.accel_bias)):
        observation[:, rows, layout.own(block)] = np.eye(3)[:, : block.stop - block.start]
    for name, windows_of in about.acting.items():
        observation[:, 3:, layout.own(getattr(layout, name))] = euler @ (windows_of.whole / duration[:, None, None])
    if about.tilting is not None:
        observation[:, 3:, layout.own(layout.tilt)] = about.tilting.force + euler @ about.coupling.own @ about.tilting.whole
    if layout.has(layout.scale) and vehicle.thrust.scale_sigma > 0 and phi_map.plant.translates:
        observation[:, 3:, layout.own(layout.scale).start] += within.theta[THETA_MU] * whole[:, phi_map.plant.force]
    measured = np.zeros((len(duration), 6, 1 + (phi_map.size if onto is None else onto.shape[1])))
    measured[:, :3, 0] = here.rate_rad_s
    measured[:, 3:, 0] = here.specific_force_m_s2 - offset + times(by_rate, here.rate_rad_s - about.reference.gyro_bias)
    measured[:, 3:, 0] += observation[:, 3:, damping] @ about.reference.damping[: damping.stop - damping.start]
    np.negative(felt, out=measured[:, 3:, 1:])
    return observation, measured


def _felt_by_rate(about: _About, euler: Array) -> Array:
    """(K, 3, 3) of the specific force by an error of the rate; ``euler`` is that by ω̇, E = −[ρ]×.

    ``d(ω × (ω × ρ) + ω̇ × ρ) = (2 [ω]× E − E [ω]×) dω + E dω̇``, and ω̇ changes by the gyroscopic coupling. What hangs on a bearing turns
    under its weight meanwhile, by half a cycle's turn in the mean.
    """
    rate, half_s = about.here.rate_rad_s - about.reference.gyro_bias, about.here.executed.duration_s[:, None, None] / 2
    turn, coupled = cross_matrix(rate), _bounded(about.within.response[:, -6:] @ products_by_rate(rate) * half_s) / half_s
    found: Array = 2 * turn @ euler + euler @ (coupled - turn)
    if about.phi_map.plant.pivoted:
        moment, force = _by_tilt(about.here, about.phi_map.plant, about.within, about.reference)
        found += (force + euler @ about.coupling.own @ moment) * half_s
    return found


def _by_tilt(here: Samples, plant: Plant, within: Within, reference: Reference) -> tuple[Array, Array]:
    """(K, 3, t) the mean moment, and (K, 3, t) the mean specific force of the centre, by an error of the attitude in the middle."""
    duration, executed = here.executed.duration_s[:, None], here.executed
    up = windows(within.motion.up, _bin_s(here, within.motion)).whole / duration
    push = executed.whole[:, 3:] / duration
    return plant.moment_by_tilt(reference, up, push), plant.force_by_tilt(reference, up, push)


def compiled(vehicle: Vehicle) -> bool:
    """Whether the compiled kernel is there and knows this vehicle."""
    return kernel().library is not None and not kernelargs.unknown(vehicle)


def _compiled(
    here: Samples, layout: Layout, phi_map: ResponseMap, reference: Reference, vehicle: Vehicle, onto: Array | None
) -> Regressors:
    """The same by the compiled kernel."""
    numbers, size = kernelargs.vehicle_numbers(here, vehicle), phi_map.size if onto is None else onto.shape[1]
    about, states = kernelargs.reference_numbers(reference, phi_map), layout.size - RATE.start
    return Regressors(*kernelargs.regressors(numbers, about, kernelargs.packed(here), states, size, onto))


def expected(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, state: Array) -> tuple[Array, Array]:
    """(K − 1, n) the state one step on, and (K, 6) what is measured beyond what the state (K, n) gives, by a reference."""
    part, phi_map = samples.part(cycles), ResponseMap(plant_of(vehicle))
    phi = phi_map.coefficients(phi_map.theta(reference))[0]
    if not compiled(vehicle):
        return regressors(samples, cycles, reference, vehicle, phi[:, None]).beyond(np.ones(1), state)
    given = kernelargs.vehicle_numbers(samples, vehicle), kernelargs.reference_numbers(reference, phi_map), phi
    driven, measured = kernelargs.beyond(*given, kernelargs.packed(part), state[:, :3], state.shape[1])
    return driven, as_read(measured, part)


def _tilting(here: Samples, plant: Plant, within: Within, reference: Reference) -> _Tilting:
    rate, duration = here.rate_rad_s - reference.gyro_bias, here.executed.duration_s
    kept, by_error = plant.tilt_step(rate, duration)
    early, late, mean = plant.tilt_within(rate, duration)
    up, executed = windows(within.motion.up, _bin_s(here, within.motion)), here.executed
    leaving = plant.moment_by_tilt(reference, up.rising, executed.rising[:, 3:]) @ early
    entering = plant.moment_by_tilt(reference, up.falling, executed.falling[:, 3:]) @ late
    whole, force = (part @ mean for part in _by_tilt(here, plant, within, reference))
    return _Tilting(kept, by_error, (leaving[:-1], entering[1:]), whole, force)


def _acting(here: Samples, layout: Layout, vehicle: Vehicle, plant: Plant, reference: Reference, within: Within) -> dict[str, Windows]:
    """(K, 3, n) impulses of angular acceleration under a cycle's windows by the n states of each block that turn the body."""
    found, own, lasting = dict[str, Windows](), plant.turning(within.theta), here.executed.duration_s[:, None, None]
    if layout.has(layout.torque):  # an angular acceleration, of the axes which the body turns about
        steady = lasting * np.diag(np.diag(own) > 0)
        found["torque"] = Windows(steady / 2, steady / 2, steady)
    moments = dict[str, Windows]()
    if layout.has(layout.damping):
        moments["damping"] = impulse_by_damping(within.motion, within.rates, _bin_s(here, within.motion))
    if layout.has(layout.scale):
        moments["scale"] = moments_by_scale(here.executed, vehicle, plant, reference, within.motion)
    return found | {name: Windows(*(own @ part for part in moment)) for name, moment in moments.items()}


def _bounded(derivative: Array) -> Array:
    """(K, 3, 3) the derivative, made smaller where an error would turn by more than ``STEEP`` within a step: it says nothing there."""
    size = np.sqrt((derivative**2).sum((1, 2)))
    return derivative * np.minimum(1.0, STEEP / np.maximum(size, STEEP))[:, None, None]


def integrals_about(samples: Samples, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array, Array]:
    """The same about a reference, with the motion within the cycles that it has."""
    phi_map = ResponseMap(plant_of(vehicle))
    if compiled(vehicle):
        numbers = kernelargs.vehicle_numbers(samples, vehicle)
        return kernelargs.integrals(numbers, kernelargs.reference_numbers(reference, phi_map), kernelargs.packed(samples), phi_map.channels)
    return integrals(samples, phi_map, phi_map.theta(reference), motion_within(samples, reference, phi_map))


def _by_axis(channels: Array, onto: Array) -> Array:
    """(K, 3, c) what Φ makes of channels (K, C) in combinations ``onto`` (N, c) of its coefficients."""
    count = 3 * channels.shape[1]
    by_channel = onto[:count].reshape(3, -1, onto.shape[1])
    return np.einsum("kc,acm->kam", channels, by_channel)


def _felt(
    whole: Array, phi_map: ResponseMap, reference: Reference, response: Array, motion: Motion, position: Array, onto: Array | None
) -> tuple[Array, Array, Array]:
    """The specific force: (K, 3, 3) by angular acceleration, (K, 3, N or c) by the coefficients, (K, 3) the rest."""
    plant, channels = phi_map.plant, phi_map.channels
    rate_dot = times(response, whole) + reference.acceleration
    square = tensor(whole[:, -6:])  # the mean of ω ωᵀ
    centripetal = square - np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    turning = Turning(whole, rate_dot, centripetal, centripetal + cross_matrix(rate_dot))
    euler, own, offset = plant.felt(reference, motion, turning, position)
    if onto is not None:
        return euler, euler @ _by_axis(whole, onto) + own @ onto[3 * channels :], offset
    by_response = (euler[..., None] * whole[:, None, None, :]).reshape(len(whole), 3, -1)
    return euler, np.concatenate([by_response, own], -1), offset
