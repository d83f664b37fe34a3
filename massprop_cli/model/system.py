"""State-space matrices of the nuisance filter for each cycle: transition, drive, measurement and noise.

Drive and measurement have one column for the log, one for each coefficient φ of :mod:`massprop_cli.model.plant`, and one for each
considered assumption (:mod:`massprop_cli.model.sensitivity`). If the vehicle file states a drift of the mass properties, their change
since the first cycle is ten more states.
"""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model import attitude
from massprop_cli.model.assumptioncolumns import assumption_columns
from massprop_cli.model.layout import MU, RATE, Layout
from massprop_cli.model.momentum import scale_sigmas
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import Regressors, regressors
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Mounted, Samples, Source, biased_attitude

DIFFUSE_SIGMA = 1e3
"""Prior sigma of the rate [rad/s] and of the angular acceleration by a steady torque [rad/s²], on which nothing is known."""
UNUSED_NOISE = 1e8
"""Factor on the noise of a reading that is not used."""


@dataclass(frozen=True)
class System:
    """Linear system of K cycles with n states and C columns; step k leads from cycle k to cycle k + 1."""

    transition: Array
    """(K − 1, n, n) transition matrix."""
    drive: Array
    """(K − 1, n, C) drive."""
    process: Array | None
    """(K − 1, n, q) root of the process noise covariance; None without process noise."""
    observation: Array
    """(K, m, n) measurement Jacobian of rate, specific force and, with a logged attitude, the rotation vector from the propagated to the
    logged attitude; m is 6 or 9."""
    measured: Array
    """(K, m, C) measurements."""
    noise: Array
    """(K, m, m) root of the measurement noise covariance."""
    initial: Array
    """(n, 1 + n) states in the first cycle: known value, then derivative with respect to each unknown initial state."""

    def part(self, first: int, end: int) -> System:
        """The system of cycles ``first`` to ``end − 1``, counted from its first cycle."""
        steps, cycles = slice(first, end - 1), slice(first, end)
        return System(
            self.transition[steps],
            self.drive[steps],
            None if self.process is None else self.process[steps],
            self.observation[cycles],
            self.measured[cycles],
            self.noise[cycles],
            self.initial,
        )


def system_of(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider, phi_map: ResponseMap) -> System:
    """The linear system of ``cycles`` about ``reference``, with one column for each coefficient of ``phi_map``."""
    response, here = regressors(samples, cycles, reference, vehicle, phi_map.onto), samples.part(cycles)
    layout, drive, measured, observation = Layout.of(samples, vehicle), response.drive, response.measured, response.observation
    roots, noise = _noise(here, layout, reference, vehicle, response)
    logged = attitude.attitude_measurements(here, layout, reference)
    if logged is not None:
        observation = np.concatenate([observation, logged.observation], 1)
        columns = np.zeros((len(measured), 3, measured.shape[2]))
        columns[..., 0] = logged.offset
        measured, both = np.concatenate([measured, columns], 1), np.zeros((len(noise), 9, 9))
        both[:, :6, :6], both[:, 6:, 6:] = noise, logged.noise
        noise = both
    if consider.columns(len(samples.wrench)) or consider.kinds:
        driven, changes = assumption_columns(response, samples, cycles, reference, vehicle, consider, phi_map)
        drive, measured = (np.concatenate([own, more[..., 1:]], -1) for own, more in ((drive, driven), (measured, changes)))
        drive[..., 0] += driven[..., 0]
        measured[..., 0] += changes[..., 0]
    transition = response.transition
    walk = random_walk(vehicle)
    if walk.any():
        walk[MU] *= reference.mu**2
        theta = phi_map.plant.theta(reference)
        by_parameter = phi_map.coefficients(theta)[1] @ np.linalg.inv(phi_map.plant.slopes(theta))
        states = transition.shape[1]
        grown = np.zeros((len(transition), states + 10, states + 10))
        grown[:, :states, :states], grown[:, states:, states:] = transition, np.eye(10)
        grown[:, :3, states:] = response.drive[:, :3, 1:] @ by_parameter
        transition = grown
        wider = np.zeros((*observation.shape[:2], states + 10))
        wider[..., :states] = observation
        wider[:, 3:6, states:] = -response.measured[:, 3:, 1:] @ by_parameter
        observation = wider
        drive = np.concatenate([drive, np.zeros((len(drive), 10, drive.shape[2]))], 1)
        roots = [np.concatenate([root, np.zeros((len(root), 10, root.shape[2]))], 1) for root in roots]
        step = np.zeros((len(drive), states + 10, 10))
        step[:, states:] = np.diag(walk) * np.sqrt(here.executed.duration_s[1:])[:, None, None]
        roots.append(step)
    return System(
        transition,
        drive,
        np.concatenate(roots, -1) if roots else None,
        observation,
        measured,
        noise,
        initial_states(here, samples, vehicle),
    )


def initial_states(here: Samples, samples: Source, vehicle: Resolved) -> Array:
    """(n, 1 + n) states in the first cycle of ``here`` (:attr:`System.initial`), with the attitude error propagated up to that cycle."""
    layout, count = Layout.of(samples, vehicle), len(prior(samples, vehicle))
    initial = np.eye(count, 1 + count, 1)
    tilt = layout.in_states(layout.tilt)
    if here.measured is not None:
        blocks = (tilt, layout.in_states(layout.gyro_bias), layout.in_states(layout.misalignment))
        places = np.concatenate([np.arange(count)[block] for block in blocks])
        known = np.concatenate([np.arange(3 * i, 3 * i + block.stop - block.start) for i, block in enumerate(blocks)])
        values, axes = np.linalg.eigh(here.measured.covariance[0][np.ix_(known, known)])
        initial[np.ix_(places, 1 + places)] = axes * np.sqrt(np.maximum(values, 0.0)) / prior(samples, vehicle)[places]
        initial[places, 0] = here.measured.known[0][known]
    elif vehicle.pivoted:
        initial[tilt, 1:][:, tilt] = np.diag(here.attitude_error_rad[0, :, 4])
    if biased_attitude(samples.attitude_logged, vehicle):
        bias = layout.in_states(layout.gyro_bias)
        initial[tilt, 0] = here.attitude_error_rad[0, :, 0]
        initial[tilt, 1:][:, bias] = here.attitude_error_rad[0, :, 1:4]
    return initial


def prior(samples: Mounted, vehicle: Vehicle) -> Array:
    """(n,) prior sigma of each state in the first cycle, about zero; diffuse for the rate and for a slowly varying torque."""
    layout = Layout.of(samples, vehicle)
    sigma = np.zeros(layout.size)
    sigma[RATE] = DIFFUSE_SIGMA
    sigma[layout.gyro_bias] = vehicle.imu.gyro_bias_sigma_rad_s
    sigma[layout.accel_bias] = vehicle.imu.accel_bias_sigma_m_s2
    sigma[layout.torque] = DIFFUSE_SIGMA
    sigma[layout.damping] = vehicle.environment.damping_sigma_n_m_s
    sigma[layout.tilt] = vehicle.imu.gyro_noise_rad_s if vehicle.pivoted else plant_of(vehicle).tilt_sigma
    if samples.attitude_logged:
        sigma[layout.tilt] = 1.0  # System.initial holds the root of its covariance
    sigma[layout.scale] = scale_sigmas(vehicle)
    sigma[layout.misalignment] = vehicle.imu.attitude_misalignment_sigma_rad
    departed = np.zeros(10 if random_walk(vehicle).any() else 0)  # no drift yet in the first cycle
    return np.concatenate([sigma[RATE.start :], departed])


def random_walk(vehicle: Vehicle) -> Array:
    """(10,) random walk of each quantity, in its unit per √s."""
    return np.array([getattr(vehicle.drift, name) for name in type(vehicle.drift).model_fields])


def _noise(here: Samples, layout: Layout, reference: Reference, vehicle: Resolved, response: Regressors) -> tuple[list[Array], Array]:
    """Roots of the process noise covariance, (K − 1, n, 3) for each source, and of the measurement noise covariance, (K, 6, 6)."""
    executed = here.executed
    duration = executed.duration_s
    states = response.transition.shape[1]
    torque, bias = layout.torque, layout.in_states(layout.gyro_bias)
    roots = list[Array]()
    if vehicle.imu.gyro_bias_walk_rad_s_sqrt_s > 0:
        bias_walk = np.zeros((len(duration) - 1, states, 3))
        bias_walk[:, bias] = np.eye(3) * (vehicle.imu.gyro_bias_walk_rad_s_sqrt_s * np.sqrt(duration[1:, None, None]))
        roots.append(bias_walk)
    if vehicle.environment.disturbance_torque_n_m > 0:
        impulse = vehicle.environment.disturbance_torque_n_m * duration[1:, None, None]
        roots.append(_rate_block(response.moment_to_rate * impulse, states))
    if torque.stop > torque.start:
        walk = np.zeros((len(duration) - 1, states, 3))
        plant = plant_of(vehicle)
        walk[:, layout.in_states(torque)] = plant.inverse_inertia(plant.theta(reference)) * vehicle.environment.disturbance_walk_n_m
        roots.append(walk)
    measurement = np.zeros((len(duration), 6, 6))
    measurement[:] = np.diag(vehicle.noise)
    partly = here.unread[3:].any() and not here.unread[3:].all()
    if executed.pulse_covariance is not None:
        roots += [_rate_block(root, states) for root in _pulse_roots(executed.pulse_covariance, reference, vehicle, response)]
    if vehicle.environment.disturbance_torque_n_m > 0 or executed.pulse_covariance is not None:
        covariance = measurement[:, 3:, 3:] ** 2 + specific_force_noise(here, reference, vehicle)
        measurement[:, 3:, 3:] = np.linalg.cholesky(_along_measured_axes(covariance, here) if partly else covariance)
    elif partly:
        measurement[:, 3:, 3:] = np.linalg.cholesky(_along_measured_axes(measurement[:, 3:, 3:] ** 2, here))
    return roots, np.where((executed.ignored & ~here.unread)[:, :, None], UNUSED_NOISE, 1.0) * measurement


def _along_measured_axes(covariance: Array, here: Samples) -> Array:
    """(K, 3, 3) covariance of specific force along the measured axes; absent axes are uncorrelated with the others."""
    if here.executed.force_axes is not None:
        covariance = here.executed.force_axes @ covariance @ here.executed.force_axes.T
    absent = here.unread[3:]
    return np.where((absent[:, None] | absent) & ~np.eye(3, dtype=bool), 0.0, covariance)


def _rate_block(block: Array, states: int) -> Array:
    columns = np.zeros((len(block), states, 3))
    columns[:, :3] = block
    return columns


def _pulse_roots(covariance: Array, reference: Reference, vehicle: Resolved, response: Regressors) -> tuple[Array, Array]:
    """Roots (K − 1, 3, 3) of the rate's process noise by pulse errors: of the cycle that a step leaves, and of the cycle that it enters.

    A pulse error enters the rate over both steps. Half of its variance counts in each, as if the two were independent.
    """
    moment = plant_of(vehicle).jet_moment(reference)
    values, axes = np.linalg.eigh(moment @ covariance @ moment.T)
    root = axes * np.sqrt(np.clip(values, 0, None) / 2)[:, None, :]
    return response.moment_to_rate @ root[:-1], response.moment_to_rate @ root[1:]


def specific_force_noise(here: Samples, reference: Reference, vehicle: Resolved) -> Array:
    """(K, 3, 3) covariance of the specific force by disturbance torques and pulse errors.

    It is treated as independent of the process noise that the same torques and errors add to the rate.
    """
    up = (here.up_b[:-1] + here.up_b[1:]) / 2
    _, felt = plant_of(vehicle).wrench_response(reference, np.eye(6), up, np.array(vehicle.imu.position_m))
    by_torque = vehicle.environment.disturbance_torque_n_m * felt[..., :3]
    covariance: Array = by_torque @ np.swapaxes(by_torque, 1, 2)
    if here.executed.pulse_covariance is not None:
        by_wrench = felt / here.executed.duration_s[:, None, None]
        covariance = covariance + by_wrench @ here.executed.pulse_covariance @ np.swapaxes(by_wrench, 1, 2)
    return covariance
