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

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross_matrix, inverse, tensor, times
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import kernel
from massprop_cli.model import kernelargs
from massprop_cli.model.gyroscopic import products_by_rate
from massprop_cli.model.intracycle import STEEP, integrals, motion_within, turned_beyond
from massprop_cli.model.layout import RATE, Layout
from massprop_cli.model.momentum import impulse_by_damping, moments_by_scale, momentum_integrals
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.plant.plant import MU as THETA_MU
from massprop_cli.model.plant.plant import MeanMotion
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
    layout, here = Layout.of(samples, vehicle), samples.part(cycles)
    by = _compiled if compiled(vehicle) else _by_numpy
    found = by(here, layout, ResponseMap(plant_of(vehicle)), reference, vehicle, onto)
    for part in (found.observation, found.measured):
        as_read(part, here)
    return found


def as_read(rows: Array, here: Samples) -> Array:
    """Rows (K, 6, ...) of rate and specific force along the axes that these are read along, from body axes in place.

    Nothing in channels that the log doesn't have.
    """
    if here.executed.force_axes is not None:
        rows[:, 3:] = np.einsum("ij,kj...->ki...", here.executed.force_axes, rows[:, 3:])
    if here.unread.any():
        rows[:, here.unread] = 0.0
    return rows


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


class _Equations:
    """Cycles, and what moves the body in them, linear about a reference.

    The step from one cycle's rate into the next one's is (1 − A) w[k+1] = (1 + B) w[k] + what acts.
    """

    def __init__(self, here: Samples, layout: Layout, phi_map: ResponseMap, reference: Reference, vehicle: Vehicle) -> None:
        self.here, self.layout, self.phi_map, self.reference, self.vehicle = here, layout, phi_map, reference, vehicle
        self.plant, self.within = phi_map.plant, motion_within(here, reference, phi_map)
        self.rate, self.duration = here.rate_rad_s - reference.gyro_bias, here.executed.duration_s
        self.bin_s = self.duration / self.within.motion.rate.shape[1]
        self.own = self.plant.inverse_inertia(self.within.theta)
        """(3, 3) of a moment to the angular acceleration."""
        self.leaving, self.entering = self._coupling()
        """(K − 1, 3, 3) B and A."""
        self.solve = inverse(np.eye(3) - self.entering)
        """(K − 1, 3, 3) (1 − A)⁻¹"""
        self.to_rate = self.solve @ self.own
        """(K − 1, 3, 3) of a moment's impulse to the growth of the rate."""
        self.acting = self._acting()
        self.tilting = self._tilting() if layout.has(layout.tilt) else None

    def _coupling(self) -> tuple[Array, Array]:
        """Of the derivative of ω × I ω with respect to the rate, which is linear in the rate; and what hangs on a bearing turns meanwhile.

        The step's derivatives with respect to the rates of the cycle that it leaves and of the one that it enters make it implicit.
        """
        within, executed, own = self.within, self.here.executed, self.own
        mean = windows(within.motion.rate, self.bin_s, (within.rates[1] - within.rates[0]) * self.bin_s[:, None] / 12)
        by_rate = within.response[:, -6:] @ products_by_rate(np.eye(3))
        leaving, entering = (np.einsum("kl,lij->kij", part, by_rate) for part in (mean.rising[:-1], mean.falling[1:]))
        if executed.stored is not None:
            momentum = momentum_integrals(executed.stored, self.bin_s)
            leaving, entering = leaving + own @ cross_matrix(momentum.rising[:-1]), entering + own @ cross_matrix(momentum.falling[1:])
        if self.reference.damping.any():
            half = own @ np.diag(self.reference.damping) * self.duration[:, None, None] / 2
            leaving, entering = leaving - half[:-1], entering - half[1:]
        leaving, entering = _bounded(leaving), _bounded(entering)
        if self.plant.pivoted:
            (rising, falling), turned = self._moments_by_tilt(), own * self.duration[:, None, None]
            leaving = leaving + (turned @ rising)[:-1] * (2 / 3)
            entering = entering + (turned @ falling)[1:] / 3
        return leaving, entering

    def _moments_by_tilt(self) -> tuple[Array, Array]:
        """(K, 3, t) of an error of the attitude to the moment under both halves of the triangular window."""
        up, executed = windows(self.within.motion.up, self.bin_s), self.here.executed
        pairs = (up.rising, executed.rising), (up.falling, executed.falling)
        steady = self._room_torque_by_tilt() * (self.duration[:, None, None] / 2)
        rising, falling = (self.plant.moment_by_tilt(self.reference, part, push[:, 3:]) + steady for part, push in pairs)
        return rising, falling

    def _room_torque_by_tilt(self) -> Array:
        """(K, 3, 3) the moment by an error of the attitude in which a torque that stands still in the room is known; or nothing."""
        torque = self.here.room_torque_n_m
        return np.zeros((1, 1, 1)) if torque is None else cross_matrix(torque)

    def _acting(self) -> dict[str, Windows]:
        """(K, 3, n) impulses of angular acceleration under a cycle's windows by the n states of each block that turn the body."""
        found, layout, within = dict[str, Windows](), self.layout, self.within
        if layout.has(layout.damping):
            found["damping"] = impulse_by_damping(within.motion, within.rates, self.bin_s)
        if layout.has(layout.scale):
            found["scale"] = moments_by_scale(self.here.executed, self.vehicle, self.plant, self.reference, within.motion)
        found = {name: Windows(*(self.own @ part for part in moment)) for name, moment in found.items()}
        if layout.has(layout.torque):  # an angular acceleration, of the axes which the body turns about
            steady = self.duration[:, None, None] * np.diag(np.diag(self.own) > 0)
            found["torque"] = Windows(steady / 2, steady / 2, steady)
        return found

    def _tilting(self) -> _Tilting:
        kept, by_error = self.plant.tilt_step(self.rate, self.duration)
        early, late, mean = self.plant.tilt_in_cycle(self.rate, self.duration)
        rising, falling = self._moments_by_tilt()
        whole, force = (part @ mean for part in self._by_tilt())
        return _Tilting(kept, by_error, ((rising @ early)[:-1], (falling @ late)[1:]), whole, force)

    def _by_tilt(self) -> tuple[Array, Array]:
        """(K, 3, t) the mean moment, and (K, 3, t) the mean specific force of the centre, by an error of the attitude in the middle."""
        up = windows(self.within.motion.up, self.bin_s).whole / self.duration[:, None]
        push = self.here.executed.whole[:, 3:] / self.duration[:, None]
        moment = self.plant.moment_by_tilt(self.reference, up, push) + self._room_torque_by_tilt()
        return moment, self.plant.force_by_tilt(self.reference, up, push)

    def rotation(self, step: Array, known: Array, onto: Array | None) -> tuple[Array, Array]:
        """(K − 1, n, n) transition and (K − 1, n, 1 + c) drive of the states."""
        here, layout, channels, solve = self.here, self.layout, self.phi_map.plant.channels, self.solve
        turning, damping, tilt = (layout.in_states(block) for block in (RATE, layout.damping, layout.tilt))
        transition = np.zeros((len(step), layout.states, layout.states))
        transition[:] = np.eye(layout.states)
        transition[:, turning, turning] = solve @ (np.eye(3) + self.leaving)
        drive = np.zeros((len(step), layout.states, 1 + (self.phi_map.size if onto is None else onto.shape[1])))
        drive[:, turning, 0] = times(solve, known - times(self.leaving, self.rate[:-1]) - times(self.entering, self.rate[1:]))
        if onto is None:
            each = drive[:, turning, 1 : 1 + 3 * channels].reshape(len(step), 3, 3, channels)
            np.multiply(solve[..., None], step[:, None, None, :], out=each)
            drive[:, turning, 1 : 1 + 3 * channels] = each.reshape(len(step), 3, -1)
        else:
            drive[:, turning, 1:] = solve @ _by_axis(step, onto)
        for name, impulse in self.acting.items():
            transition[:, turning, layout.in_states(getattr(layout, name))] = solve @ impulse.step
        drive[:, turning, 0] -= transition[:, turning, damping] @ self.reference.damping[: damping.stop - damping.start]
        if self.tilting is not None:
            kept, by_error, leaving, entering = (
                self.tilting.kept,
                self.tilting.by_error,
                *(self.to_rate @ part for part in self.tilting.halves),
            )
            transition[:, turning, tilt] = leaving + entering @ kept
            transition[:, tilt, tilt], transition[:, tilt, turning] = kept, by_error
            carried = here.carried_rad_s - turned_beyond(self.within, here) if self.plant.pivoted else here.carried_rad_s
            drive[:, tilt, 0] = -times(by_error, carried[:-1])
            transition[:, turning, turning] += entering @ by_error
            drive[:, turning, 0] += times(entering, drive[:, tilt, 0])
        return transition, drive

    def translation(self, whole: Array, onto: Array | None) -> tuple[Array, Array]:
        """(K, 6, n) rate and specific force by the states, and (K, 6, 1 + c) what was measured of them."""
        here, layout, duration = self.here, self.layout, self.duration
        damping, turning = layout.in_states(layout.damping), layout.in_states(RATE)
        euler, felt, offset = self._felt(whole, onto)
        observation = np.zeros((len(duration), 6, layout.states))
        observation[:, :3, turning] = np.eye(3)
        observation[:, 3:, turning] = by_rate = self._felt_by_rate(euler)
        for rows, block in ((slice(0, 3), layout.gyro_bias), (slice(3, 6), layout.accel_bias)):
            observation[:, rows, layout.in_states(block)] = np.eye(3)[:, : block.stop - block.start]
        for name, impulse in self.acting.items():
            observation[:, 3:, layout.in_states(getattr(layout, name))] = euler @ (impulse.whole / duration[:, None, None])
        if self.tilting is not None:
            observation[:, 3:, layout.in_states(layout.tilt)] = self.tilting.force + euler @ self.own @ self.tilting.whole
        if layout.has(layout.scale) and self.vehicle.thrust.scale_sigma > 0 and self.plant.translates:
            observation[:, 3:, layout.in_states(layout.scale).start] += self.within.theta[THETA_MU] * whole[:, self.plant.force]
        measured = np.zeros((len(duration), 6, 1 + felt.shape[2]))
        measured[:, :3, 0] = here.rate_rad_s
        measured[:, 3:, 0] = here.specific_force_m_s2 - offset + times(by_rate, self.rate)
        measured[:, 3:, 0] += observation[:, 3:, damping] @ self.reference.damping[: damping.stop - damping.start]
        np.negative(felt, out=measured[:, 3:, 1:])
        return observation, measured

    def _felt(self, whole: Array, onto: Array | None) -> tuple[Array, Array, Array]:
        """The specific force: (K, 3, 3) by angular acceleration, (K, 3, N or c) by the coefficients, (K, 3) the rest."""
        rate_dot = times(self.within.response, whole) + self.reference.acceleration
        square = tensor(whole[:, -6:])  # the mean of ω ωᵀ
        centripetal = square - np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        turning = MeanMotion(whole, rate_dot, centripetal, centripetal + cross_matrix(rate_dot))
        euler, own, offset = self.plant.specific_force(self.reference, self.within.motion, turning, np.array(self.vehicle.imu.position_m))
        if onto is not None:
            return euler, euler @ _by_axis(whole, onto) + own @ onto[3 * self.phi_map.plant.channels :], offset
        by_response = (euler[..., None] * whole[:, None, None, :]).reshape(len(whole), 3, -1)
        return euler, np.concatenate([by_response, own], -1), offset

    def _felt_by_rate(self, euler: Array) -> Array:
        """(K, 3, 3) of the specific force by an error of the rate; ``euler`` is that by ω̇, E = −[ρ]×.

        ``d(ω × (ω × ρ) + ω̇ × ρ) = (2 [ω]× E − E [ω]×) dω + E dω̇``, and ω̇ changes by the gyroscopic coupling. What hangs on a bearing
        turns under its weight meanwhile, by half a cycle's turn in the mean.
        """
        half_s, turn = self.duration[:, None, None] / 2, cross_matrix(self.rate)
        coupled = _bounded(self.within.response[:, -6:] @ products_by_rate(self.rate) * half_s) / half_s
        found: Array = 2 * turn @ euler + euler @ (coupled - turn)
        if self.plant.pivoted:
            moment, force = self._by_tilt()
            found += (force + euler @ self.own @ moment) * half_s
        return found


def _by_numpy(
    here: Samples, layout: Layout, phi_map: ResponseMap, reference: Reference, vehicle: Vehicle, onto: Array | None
) -> Regressors:
    equations = _Equations(here, layout, phi_map, reference, vehicle)
    within = equations.within
    step, whole, known = integrals(here, phi_map, within.theta, within)
    steps = times(within.response, step) + known
    if "scale" in equations.acting and len(reference.scale):
        steps = steps + equations.acting["scale"].step @ reference.scale
    transition, drive = equations.rotation(step, known, onto)
    observation, measured = equations.translation(whole, onto)
    return Regressors(transition, observation, equations.to_rate, steps, drive, measured)


def compiled(vehicle: Vehicle) -> bool:
    """Whether the compiled kernel is there and has all of this vehicle's motion."""
    return kernel().library is not None and not kernelargs.unmodelled(vehicle)


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
    phi = phi_map.coefficients(phi_map.plant.theta(reference))[0]
    if not compiled(vehicle):
        return regressors(samples, cycles, reference, vehicle, phi[:, None]).beyond(np.ones(1), state)
    given = kernelargs.vehicle_numbers(samples, vehicle), kernelargs.reference_numbers(reference, phi_map), phi
    driven, measured = kernelargs.beyond(*given, kernelargs.packed(part), state[:, :3], state.shape[1])
    return driven, as_read(measured, part)


def _bounded(derivative: Array) -> Array:
    """(K, 3, 3) the derivative, made smaller where an error would turn by more than ``STEEP`` within a step: it says nothing there."""
    size = np.sqrt((derivative**2).sum((1, 2)))
    return np.asarray(derivative * np.minimum(1.0, STEEP / np.maximum(size, STEEP))[:, None, None])


def integrals_about(samples: Samples, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array, Array]:
    """The same about a reference, with the motion within the cycles that it has."""
    phi_map = ResponseMap(plant_of(vehicle))
    if compiled(vehicle):
        numbers = kernelargs.vehicle_numbers(samples, vehicle)
        return kernelargs.integrals(
            numbers, kernelargs.reference_numbers(reference, phi_map), kernelargs.packed(samples), phi_map.plant.channels
        )
    return integrals(samples, phi_map, phi_map.plant.theta(reference), motion_within(samples, reference, phi_map))


def _by_axis(channels: Array, onto: Array) -> Array:
    """(K, 3, c) what Φ makes of channels (K, C) in combinations ``onto`` (N, c) of its coefficients."""
    count = 3 * channels.shape[1]
    by_channel = onto[:count].reshape(3, -1, onto.shape[1])
    return np.asarray(np.einsum("kc,acm->kam", channels, by_channel))
