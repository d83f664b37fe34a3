"""Regressors of the response over control cycles, linear in coefficients φ that are products of the mass properties.

Rotation. The growth of the cycle-mean rate is the impulse under the triangular window (:mod:`massprop_cli.prepare.align`):

    I (w[k+1] − w[k]) = rising moment of k + falling moment of k+1,   moment = that of commands and plant about the CG − ω × I ω

Multiplied by J = I⁻¹ it is linear in the coefficients φ of :mod:`massprop_cli.model.plant`. The rate products come from the *measured* mean
rate of each cycle and the motion within the cycle (:mod:`massprop_cli.model.intracycle`). Because the rate is a state, the derivatives
``leaving`` and ``entering`` make the gyroscopic term act on the estimated rate. Noise in the measured rate then enters to second order
only.

Translation. The accelerometer measures the CG's specific force ``+ ω̇ × ρ + ω × (ω × ρ)``, with ω̇ from the same model and ω the measured
rate. The state's rate differs from the measured one by noise and by the gyro bias beyond the reference's.
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
from massprop_cli.model.intracycle import MAX_COUPLING, integrals, intra_cycle_motion, unpropagated_rate
from massprop_cli.model.layout import RATE, Layout
from massprop_cli.model.momentum import impulse_by_damping, moments_by_scale, momentum_integrals
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.plant.plant import MU as THETA_MU
from massprop_cli.model.plant.plant import MeanMotion
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.windows import Windows, windows
from massprop_cli.prepare.compensate import Samples, Source

ORDERS = 4
"""Order of the exponential series over a bin of a swing."""


@dataclass(frozen=True)
class Steps:
    """Response of K cycles to the state; step k leads from cycle k to cycle k + 1; n states."""

    transition: Array
    """(K − 1, n, n) transition matrix."""
    observation: Array
    """(K, 6, n) measurement Jacobian of rate and specific force."""
    moment_to_rate: Array
    """(K − 1, 3, 3) derivative of the mean rate's growth [rad/s] with respect to the impulse of a moment [N m s]."""
    steps: Array
    """(K − 1, 3) growth of the mean rate by the reference's mass properties, rad/s."""


@dataclass(frozen=True)
class Regressors(Steps):
    """Response of K cycles, linear in the N coefficients φ of :mod:`massprop_cli.model.plant`, or in c combinations of them.

    The states are rate and nuisances. Column 0 of ``drive`` and ``measured`` is known; each other column multiplies a coefficient.
    """

    drive: Array
    """(K − 1, n, 1 + N) what drives the state."""
    measured: Array
    """(K, 6, 1 + N) measured rate and specific force; the columns of φ have the sign of the measured value."""

    def one_step(self, coefficients: Array, state: Array) -> tuple[Array, Array]:
        """(K − 1, n) one-step prediction of the state (K, n), and (K, 6) measurement residuals, with the coefficients (N,)."""
        driven, measured = (part[..., 0] + part[..., 1:] @ coefficients for part in (self.drive, self.measured))
        return times(self.transition, state[:-1]) + driven, measured - times(self.observation, state)


def regressors(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, onto: Array | None = None) -> Regressors:
    """The response of ``cycles`` (a slice with both ends). Row k uses data up to cycle k only.

    ``reference`` gives the motion within a cycle, and the second-order terms. With ``onto`` (N, c) the columns are these combinations of
    coefficients. The compiled kernel computes the same if it supports the vehicle.
    """
    layout, here = Layout.of(samples, vehicle), samples.part(cycles)
    compute = _compiled if in_kernel(vehicle) else _by_numpy
    response = compute(here, layout, ResponseMap(plant_of(vehicle)), reference, vehicle, onto)
    for part in (response.observation, response.measured):
        to_measured_axes(part, here)
    return response


def to_measured_axes(rows: Array, here: Samples) -> Array:
    """Rows (K, 6, ...) of rate and specific force, rotated in place from body axes to the measured axes; absent axes become zero."""
    if here.executed.force_axes is not None:
        rows[:, 3:] = np.einsum("ij,kj...->ki...", here.executed.force_axes, rows[:, 3:])
    if here.unread.any():
        rows[:, here.unread] = 0.0
    return rows


class _TiltEffects(NamedTuple):
    """Effect of t tilt states at the start of a cycle: errors of the direction in which the weight acts."""

    transition: Array
    """(K − 1, t, t) tilt states to those of the next cycle."""
    by_rate_error: Array
    """(K − 1, t, 3) derivative of the next tilt states with respect to a rate error, rad/s."""
    halves: tuple[Array, Array]
    """(K − 1, 3, t) derivative of the moment under the triangular window, in the cycle that a step leaves and in the one that it enters."""
    mean_moment: Array
    """(K, 3, t) derivative of the mean moment, N m."""
    mean_force: Array
    """(K, 3, t) derivative of the mean specific force of the plant's centre, m/s²."""


class _Equations:
    """Equations of motion of K cycles, linearised about a reference.

    The step between the rates of two cycles is implicit: (1 − A) w[k+1] = (1 + B) w[k] + inputs.
    """

    def __init__(self, here: Samples, layout: Layout, phi_map: ResponseMap, reference: Reference, vehicle: Vehicle) -> None:
        self.here, self.layout, self.phi_map, self.reference, self.vehicle = here, layout, phi_map, reference, vehicle
        self.plant, self.intra = phi_map.plant, intra_cycle_motion(here, reference, phi_map)
        self.rate, self.duration = here.rate_rad_s - reference.gyro_bias, here.executed.duration_s
        self.bin_s = self.duration / self.intra.motion.rate.shape[1]
        self.inverse_inertia = self.plant.inverse_inertia(self.intra.theta)
        """(3, 3) matrix that maps a moment to the angular acceleration."""
        self.leaving, self.entering = self._coupling()
        """(K − 1, 3, 3) B and A."""
        self.solve = inverse(np.eye(3) - self.entering)
        """(K − 1, 3, 3) (1 − A)⁻¹"""
        self.to_rate = self.solve @ self.inverse_inertia
        """(K − 1, 3, 3) derivative of the rate's growth with respect to the impulse of a moment."""
        self.impulses = self._impulses()
        self.tilt = self._tilt_effects() if layout.has(layout.tilt) else None

    def _coupling(self) -> tuple[Array, Array]:
        """(K − 1, 3, 3) derivatives B and A of a step with respect to the rates of the cycle that it leaves, and that it enters.

        They hold the gyroscopic torques, damping, and on a support the rotation under the weight within a cycle.
        """
        intra, executed, inverse_inertia = self.intra, self.here.executed, self.inverse_inertia
        mean = windows(intra.motion.rate, self.bin_s, (intra.rates[1] - intra.rates[0]) * self.bin_s[:, None] / 12)
        by_rate = intra.response[:, -6:] @ products_by_rate(np.eye(3))
        leaving, entering = (np.einsum("kl,lij->kij", part, by_rate) for part in (mean.rising[:-1], mean.falling[1:]))
        if executed.stored is not None:
            momentum = momentum_integrals(executed.stored, self.bin_s)
            leaving = leaving + inverse_inertia @ cross_matrix(momentum.rising[:-1])
            entering = entering + inverse_inertia @ cross_matrix(momentum.falling[1:])
        if self.reference.damping.any():
            half = inverse_inertia @ np.diag(self.reference.damping) * self.duration[:, None, None] / 2
            leaving, entering = leaving - half[:-1], entering - half[1:]
        leaving, entering = _limited(leaving), _limited(entering)
        if self.plant.pivoted:
            (rising, falling), turned = self._moments_by_tilt(), inverse_inertia * self.duration[:, None, None]
            leaving = leaving + (turned @ rising)[:-1] * (2 / 3)
            entering = entering + (turned @ falling)[1:] / 3
        return leaving, entering

    def _moments_by_tilt(self) -> tuple[Array, Array]:
        """(K, 3, t) derivative of the moment, under each half of the triangular window, with respect to the attitude error."""
        up, executed = windows(self.intra.motion.up, self.bin_s), self.here.executed
        pairs = (up.rising, executed.rising), (up.falling, executed.falling)
        steady = self._room_torque_by_tilt() * (self.duration[:, None, None] / 2)
        rising, falling = (self.plant.moment_by_tilt(self.reference, part, push[:, 3:]) + steady for part, push in pairs)
        return rising, falling

    def _room_torque_by_tilt(self) -> Array:
        """(K, 3, 3) derivative of a torque constant in the room with respect to the attitude error; zero without such a torque."""
        torque = self.here.room_torque_n_m
        return np.zeros((1, 1, 1)) if torque is None else cross_matrix(torque)

    def _impulses(self) -> dict[str, Windows]:
        """(K, 3, n) impulses of angular acceleration by unit values of the n states of each block that acts on the rotation."""
        impulses, layout, intra = dict[str, Windows](), self.layout, self.intra
        if layout.has(layout.damping):
            impulses["damping"] = impulse_by_damping(intra.motion, intra.rates, self.bin_s)
        if layout.has(layout.scale):
            impulses["scale"] = moments_by_scale(self.here.executed, self.vehicle, self.plant, self.reference, intra.motion)
        impulses = {name: Windows(*(self.inverse_inertia @ part for part in moment)) for name, moment in impulses.items()}
        if layout.has(layout.torque):  # this state is an angular acceleration, about the axes that can rotate
            steady = self.duration[:, None, None] * np.diag(np.diag(self.inverse_inertia) > 0)
            impulses["torque"] = Windows(steady / 2, steady / 2, steady)
        return impulses

    def _tilt_effects(self) -> _TiltEffects:
        transition, by_error = self.plant.tilt_step(self.rate, self.duration)
        early, late, mean = self.plant.tilt_in_cycle(self.rate, self.duration)
        rising, falling = self._moments_by_tilt()
        whole, force = (part @ mean for part in self._by_tilt())
        return _TiltEffects(transition, by_error, ((rising @ early)[:-1], (falling @ late)[1:]), whole, force)

    def _by_tilt(self) -> tuple[Array, Array]:
        """(K, 3, t) mean moment and (K, 3, t) mean specific force of the centre, by an attitude error in the middle of the cycle."""
        up = windows(self.intra.motion.up, self.bin_s).whole / self.duration[:, None]
        push = self.here.executed.whole[:, 3:] / self.duration[:, None]
        moment = self.plant.moment_by_tilt(self.reference, up, push) + self._room_torque_by_tilt()
        return moment, self.plant.force_by_tilt(self.reference, up, push)

    def rotation(self, step: Array, known: Array, onto: Array | None) -> tuple[Array, Array]:
        """(K − 1, n, n) transition and (K − 1, n, 1 + c) drive of the states."""
        here, layout, channels, solve = self.here, self.layout, self.phi_map.plant.channels, self.solve
        rate, damping, tilt = (layout.in_states(block) for block in (RATE, layout.damping, layout.tilt))
        transition = np.zeros((len(step), layout.states, layout.states))
        transition[:] = np.eye(layout.states)
        transition[:, rate, rate] = solve @ (np.eye(3) + self.leaving)
        drive = np.zeros((len(step), layout.states, 1 + (self.phi_map.size if onto is None else onto.shape[1])))
        drive[:, rate, 0] = times(solve, known - times(self.leaving, self.rate[:-1]) - times(self.entering, self.rate[1:]))
        if onto is None:
            by_axis = drive[:, rate, 1 : 1 + 3 * channels].reshape(len(step), 3, 3, channels)
            np.multiply(solve[..., None], step[:, None, None, :], out=by_axis)
            drive[:, rate, 1 : 1 + 3 * channels] = by_axis.reshape(len(step), 3, -1)
        else:
            drive[:, rate, 1:] = solve @ _by_axis(step, onto)
        for name, impulse in self.impulses.items():
            transition[:, rate, layout.in_states(getattr(layout, name))] = solve @ impulse.step
        drive[:, rate, 0] -= transition[:, rate, damping] @ self.reference.damping[: damping.stop - damping.start]
        if self.tilt is not None:
            tilt_transition, by_rate_error, leaving, entering = (
                self.tilt.transition,
                self.tilt.by_rate_error,
                *(self.to_rate @ part for part in self.tilt.halves),
            )
            transition[:, rate, tilt] = leaving + entering @ tilt_transition
            transition[:, tilt, tilt], transition[:, tilt, rate] = tilt_transition, by_rate_error
            propagated = here.carried_rad_s - unpropagated_rate(self.intra, here) if self.plant.pivoted else here.carried_rad_s
            drive[:, tilt, 0] = -times(by_rate_error, propagated[:-1])
            transition[:, rate, rate] += entering @ by_rate_error
            drive[:, rate, 0] += times(entering, drive[:, tilt, 0])
            if self.vehicle.swings:
                both = np.r_[rate, tilt]
                exact = self._swing_step()
                less = exact - transition[:, both[:, None], both]
                drive[:, both, 0] -= times(less[..., :3], self.rate[:-1])
                transition[:, both[:, None], both] = exact
        return transition, drive

    def _swing_step(self) -> Array:
        """(K − 1, 6, 6) transition of mean rate and attitude error, rad/s and rad, by the matrix exponential of each bin.

        In a bin the state x = (δω, φ) has ẋ = A x with constant A: gyroscopic and stored momentum's torque, damping and weight by J, and
        φ̇ = δω − ω × φ. A state is the mean rate of a cycle, as recorded, and φ at its start. A swing near its instability magnifies every
        error of the transition some thousand times.
        """
        motion, inverse_inertia = self.intra.motion, self.inverse_inertia
        cycles, bins, _ = motion.rate.shape
        by_time = np.zeros((cycles, bins, 6, 6))
        by_time[..., :3, :3] = self.intra.response[:, -6:] @ products_by_rate(motion.rate) - inverse_inertia @ np.diag(self.intra.damping)
        if (stored := self.here.executed.stored) is not None:
            by_time[..., :3, :3] += inverse_inertia @ cross_matrix(stored.mean @ stored.axis)
        moments = self.plant.moment_by_tilt(self.reference, motion.up.reshape(-1, 3), np.zeros((cycles * bins, 3)))
        by_time[..., :3, 3:] = inverse_inertia @ (moments.reshape(cycles, bins, 3, 3) + self._room_torque_by_tilt()[:, None])
        by_time[..., 3:, :3], by_time[..., 3:, 3:] = np.eye(3), -cross_matrix(motion.rate)
        by_time *= self.bin_s[:, None, None, None]
        unit = np.broadcast_to(np.eye(6), (cycles, 6, 6))
        whole, means = unit, np.zeros((cycles, 6, 6))
        for b in range(bins):
            step = mean = term = unit
            for order in range(1, ORDERS + 1):
                term = term @ by_time[:, b] / order
                step, mean = step + term, mean + term / (order + 1)
            means, whole = means + mean @ whole / bins, step @ whole
        to_means = unit.copy()
        to_means[:, :3] = means[:, :3]
        return to_means[1:] @ whole[:-1] @ np.linalg.inv(to_means[:-1])

    def translation(self, whole: Array, onto: Array | None) -> tuple[Array, Array]:
        """(K, 6, n) measurement Jacobian, and (K, 6, 1 + c) measured rate and specific force."""
        here, layout, duration = self.here, self.layout, self.duration
        damping, rate = layout.in_states(layout.damping), layout.in_states(RATE)
        by_rate_dot, by_phi, offset = self._specific_force(whole, onto)
        observation = np.zeros((len(duration), 6, layout.states))
        observation[:, :3, rate] = np.eye(3)
        observation[:, 3:, rate] = by_rate = self._specific_force_by_rate(by_rate_dot)
        for rows, block in ((slice(0, 3), layout.gyro_bias), (slice(3, 6), layout.accel_bias)):
            observation[:, rows, layout.in_states(block)] = np.eye(3)[:, : block.stop - block.start]
        for name, impulse in self.impulses.items():
            observation[:, 3:, layout.in_states(getattr(layout, name))] = by_rate_dot @ (impulse.whole / duration[:, None, None])
        if self.tilt is not None:
            by_moment = by_rate_dot @ self.inverse_inertia @ self.tilt.mean_moment
            observation[:, 3:, layout.in_states(layout.tilt)] = self.tilt.mean_force + by_moment
        if layout.has(layout.scale) and self.vehicle.thrust.scale_sigma > 0 and self.plant.translates:
            observation[:, 3:, layout.in_states(layout.scale).start] += self.intra.theta[THETA_MU] * whole[:, self.plant.force]
        measured = np.zeros((len(duration), 6, 1 + by_phi.shape[2]))
        measured[:, :3, 0] = here.rate_rad_s
        measured[:, 3:, 0] = here.specific_force_m_s2 - offset + times(by_rate, self.rate)
        measured[:, 3:, 0] += observation[:, 3:, damping] @ self.reference.damping[: damping.stop - damping.start]
        np.negative(by_phi, out=measured[:, 3:, 1:])
        return observation, measured

    def _specific_force(self, whole: Array, onto: Array | None) -> tuple[Array, Array, Array]:
        """Specific force: (K, 3, 3) by angular acceleration, (K, 3, N or c) by the coefficients, (K, 3) the rest."""
        rate_dot = times(self.intra.response, whole) + self.reference.acceleration
        square = tensor(whole[:, -6:])  # the mean of ω ωᵀ
        centripetal = square - np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        mean = MeanMotion(whole, rate_dot, centripetal, centripetal + cross_matrix(rate_dot))
        position = np.array(self.vehicle.imu.position_m)
        by_rate_dot, by_phi, offset = self.plant.specific_force(self.reference, self.intra.motion, mean, position)
        if onto is not None:
            return by_rate_dot, by_rate_dot @ _by_axis(whole, onto) + by_phi @ onto[3 * self.phi_map.plant.channels :], offset
        by_response = (by_rate_dot[..., None] * whole[:, None, None, :]).reshape(len(whole), 3, -1)
        return by_rate_dot, np.concatenate([by_response, by_phi], -1), offset

    def _specific_force_by_rate(self, by_rate_dot: Array) -> Array:
        """(K, 3, 3) derivative of the specific force with respect to a rate error; ``by_rate_dot`` is E = −[ρ]×.

        ``d(ω × (ω × ρ) + ω̇ × ρ) = (2 [ω]× E − E [ω]×) dω + E dω̇``, where dω̇ is the gyroscopic coupling. On a support, a rate error also
        turns the body under its weight, on average by half a cycle's angle.
        """
        half_s, turn = self.duration[:, None, None] / 2, cross_matrix(self.rate)
        coupled = _limited(self.intra.response[:, -6:] @ products_by_rate(self.rate) * half_s) / half_s
        derivative: Array = 2 * turn @ by_rate_dot + by_rate_dot @ (coupled - turn)
        if self.plant.pivoted:
            moment, force = self._by_tilt()
            derivative += (force + by_rate_dot @ self.inverse_inertia @ moment) * half_s
        return derivative


def _by_numpy(
    here: Samples, layout: Layout, phi_map: ResponseMap, reference: Reference, vehicle: Vehicle, onto: Array | None
) -> Regressors:
    equations = _Equations(here, layout, phi_map, reference, vehicle)
    intra = equations.intra
    step, whole, known = integrals(here, phi_map, intra.theta, intra)
    steps = times(intra.response, step) + known
    if "scale" in equations.impulses and len(reference.scale):
        steps = steps + equations.impulses["scale"].step @ reference.scale
    transition, drive = equations.rotation(step, known, onto)
    observation, measured = equations.translation(whole, onto)
    return Regressors(transition, observation, equations.to_rate, steps, drive, measured)


def in_kernel(vehicle: Vehicle) -> bool:
    """Whether the compiled kernel is available and its equations hold for this vehicle."""
    return kernel().library is not None and not kernelargs.unsupported_motion(vehicle)


def _compiled(
    here: Samples, layout: Layout, phi_map: ResponseMap, reference: Reference, vehicle: Vehicle, onto: Array | None
) -> Regressors:
    """The same response, computed by the compiled kernel."""
    numbers, size = kernelargs.vehicle_numbers(here, vehicle), phi_map.size if onto is None else onto.shape[1]
    about, states = kernelargs.reference_numbers(reference, phi_map), layout.size - RATE.start
    return Regressors(*kernelargs.regressors(numbers, about, kernelargs.cycle_numbers(here), states, size, onto))


def one_step(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, state: Array) -> tuple[Array, Array]:
    """(K − 1, n) one-step prediction of the state (K, n), and (K, 6) measurement residuals, for the mass properties of ``reference``."""
    part, phi_map = samples.part(cycles), ResponseMap(plant_of(vehicle))
    phi = phi_map.coefficients(phi_map.plant.theta(reference))[0]
    if not in_kernel(vehicle):
        return regressors(samples, cycles, reference, vehicle, phi[:, None]).one_step(np.ones(1), state)
    numbers = kernelargs.vehicle_numbers(samples, vehicle), kernelargs.reference_numbers(reference, phi_map), phi
    driven, measured = kernelargs.one_step(*numbers, kernelargs.cycle_numbers(part), state[:, :3], state.shape[1])
    return driven, to_measured_axes(measured, part)


def _limited(derivative: Array) -> Array:
    """(K, 3, 3) derivative, scaled down where a rate error would change by more than ``MAX_COUPLING`` of itself in half a step."""
    size = np.sqrt((derivative**2).sum((1, 2)))
    return np.asarray(derivative * np.minimum(1.0, MAX_COUPLING / np.maximum(size, MAX_COUPLING))[:, None, None])


def integrals_about(samples: Samples, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array, Array]:
    """:func:`massprop_cli.model.intracycle.integrals` for the motion about a reference."""
    phi_map = ResponseMap(plant_of(vehicle))
    if in_kernel(vehicle):
        numbers = kernelargs.vehicle_numbers(samples, vehicle)
        return kernelargs.integrals(
            numbers, kernelargs.reference_numbers(reference, phi_map), kernelargs.cycle_numbers(samples), phi_map.plant.channels
        )
    return integrals(samples, phi_map, phi_map.plant.theta(reference), intra_cycle_motion(samples, reference, phi_map))


def _by_axis(inputs: Array, onto: Array) -> Array:
    """(K, 3, c) product of Φ and inputs z (K, C), for each of the combinations ``onto`` (N, c) of coefficients."""
    count = 3 * inputs.shape[1]
    by_channel = onto[:count].reshape(3, -1, onto.shape[1])
    return np.asarray(np.einsum("kc,acm->kam", inputs, by_channel))
