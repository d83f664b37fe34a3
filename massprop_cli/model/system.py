"""State-space matrices of the nuisance filter for each cycle: transition, drive, measurement and noise.

Drives and measurements have columns: the log's own, one for each coefficient φ of :mod:`massprop_cli.model.plant`, one for each assumption
considered (:mod:`massprop_cli.model.sensitivity`). Where mass properties are said to drift, their departure from where they began is ten
more states.
"""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model import attitude
from massprop_cli.model.layout import MU, RATE, Layout
from massprop_cli.model.momentum import scale_sigmas
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import Regressors, regressors
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider, fed
from massprop_cli.prepare.compensate import Mounted, Samples, Source, biased_attitude

WIDE = 1e3
"""rad/s, rad/s²; of a rate, and of what a steady torque makes of it, of which nothing is known."""
DEAF = 1e8
"""By how much louder the noise is of a reading that is not used."""


@dataclass(frozen=True)
class System:
    """Of K cycles: step k leads from cycle k to k + 1; C columns, n states."""

    transition: Array
    """(K − 1, n, n)"""
    drive: Array
    """(K − 1, n, C)"""
    process: Array | None
    """(K − 1, n, q) root of the process noise."""
    observation: Array
    """(K, m, n); m is 6, or 9 with a logged attitude: rate, specific force, rotation vector from the carried to the logged attitude."""
    measured: Array
    """(K, m, C)"""
    noise: Array
    """(K, m, m) root of the measurement noise."""
    begun: Array
    """(n, 1 + n) the states at its beginning: known, and by what is unknown of each."""

    def part(self, first: int, end: int) -> System:
        """Of the cycles from ``first`` to before ``end``, counted from the system's own first."""
        steps, cycles = slice(first, end - 1), slice(first, end)
        return System(
            self.transition[steps],
            self.drive[steps],
            None if self.process is None else self.process[steps],
            self.observation[cycles],
            self.measured[cycles],
            self.noise[cycles],
            self.begun,
        )


def system_of(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider, phi_map: ResponseMap) -> System:
    """The system of ``cycles`` about ``reference``, with a column for each coefficient of ``phi_map``."""
    free, here = regressors(samples, cycles, reference, vehicle, phi_map.onto), samples.part(cycles)
    layout, drive, measured, observation = Layout.of(samples, vehicle), free.drive, free.measured, free.observation
    roots, noise = _noise(here, layout, reference, vehicle, free)
    logged = attitude.seen(here, layout, reference)
    if logged is not None:
        observation = np.concatenate([observation, logged.observation], 1)
        columns = np.zeros((len(measured), 3, measured.shape[2]))
        columns[..., 0] = logged.offset
        measured, both = np.concatenate([measured, columns], 1), np.zeros((len(noise), 9, 9))
        both[:, :6, :6], both[:, 6:, 6:] = noise, logged.noise
        noise = both
    if consider.columns(len(samples.wrench)) or consider.kinds:
        driven, seen = fed(free, samples, cycles, reference, vehicle, consider, phi_map)
        drive, measured = np.concatenate([drive, driven], -1), np.concatenate([measured, seen], -1)
    transition = free.transition
    walk = drift(vehicle)
    if walk.any():
        walk[MU] *= reference.mu**2
        theta = phi_map.plant.theta(reference)
        by_parameter = phi_map.coefficients(theta)[1] @ np.linalg.inv(phi_map.plant.slopes(theta))
        states = transition.shape[1]
        grown = np.zeros((len(transition), states + 10, states + 10))
        grown[:, :states, :states], grown[:, states:, states:] = transition, np.eye(10)
        grown[:, :3, states:] = free.drive[:, :3, 1:] @ by_parameter
        transition = grown
        wider = np.zeros((*observation.shape[:2], states + 10))
        wider[..., :states] = observation
        wider[:, 3:6, states:] = -free.measured[:, 3:, 1:] @ by_parameter
        observation = wider
        drive = np.concatenate([drive, np.zeros((len(drive), 10, drive.shape[2]))], 1)
        roots = [np.concatenate([root, np.zeros((len(root), 10, root.shape[2]))], 1) for root in roots]
        step = np.zeros((len(drive), states + 10, 10))
        step[:, states:] = np.diag(walk) * np.sqrt(here.executed.duration_s[1:])[:, None, None]
        roots.append(step)
    return System(
        transition, drive, np.concatenate(roots, -1) if roots else None, observation, measured, noise, beginnings(here, samples, vehicle)
    )


def beginnings(here: Samples, samples: Source, vehicle: Resolved) -> Array:
    """(n, 1 + n) of the first of these cycles: by then bias and noise of the gyro have carried the attitude off."""
    layout, count = Layout.of(samples, vehicle), len(prior(samples, vehicle))
    found = np.eye(count, 1 + count, 1)
    tilt = layout.own(layout.tilt)
    if here.measured is not None:
        blocks = (tilt, layout.own(layout.gyro_bias), layout.own(layout.misalignment))
        own = np.concatenate([np.arange(count)[block] for block in blocks])
        known = np.concatenate([np.arange(3 * i, 3 * i + block.stop - block.start) for i, block in enumerate(blocks)])
        values, axes = np.linalg.eigh(here.measured.covariance[0][np.ix_(known, known)])
        found[np.ix_(own, 1 + own)] = axes * np.sqrt(np.maximum(values, 0.0)) / prior(samples, vehicle)[own]
        found[own, 0] = here.measured.known[0][known]
    elif vehicle.pivoted:
        found[tilt, 1:][:, tilt] = np.diag(here.attitude_error_rad[0, :, 4])
    if biased_attitude(samples.attitude_logged, vehicle):
        bias = layout.own(layout.gyro_bias)
        found[tilt, 0] = here.attitude_error_rad[0, :, 0]
        found[tilt, 1:][:, bias] = here.attitude_error_rad[0, :, 1:4]
    return found


def prior(samples: Mounted, vehicle: Vehicle) -> Array:
    """(n,) one sigma of each state in the first cycle about zero; wide for the rate, which that cycle measures, and for a steady torque."""
    layout = Layout.of(samples, vehicle)
    sigma = np.zeros(layout.size)
    sigma[RATE] = WIDE
    sigma[layout.gyro_bias] = vehicle.imu.gyro_bias_sigma_rad_s
    sigma[layout.accel_bias] = vehicle.imu.accel_bias_sigma_m_s2
    sigma[layout.torque] = WIDE
    sigma[layout.damping] = vehicle.environment.damping_sigma_n_m_s
    sigma[layout.tilt] = vehicle.imu.gyro_noise_rad_s if vehicle.pivoted else plant_of(vehicle).tilt_sigma
    if samples.attitude_logged:
        sigma[layout.tilt] = 1.0  # in units of what is known of it
    sigma[layout.scale] = scale_sigmas(vehicle)
    sigma[layout.misalignment] = vehicle.imu.attitude_misalignment_sigma_rad
    departed = np.zeros(10 if drift(vehicle).any() else 0)  # known to be none at first
    return np.concatenate([sigma[RATE.start :], departed])


def drift(vehicle: Vehicle) -> Array:
    """(10,) random walk of each quantity, per sqrt(s)."""
    return np.array([getattr(vehicle.drift, name) for name in type(vehicle.drift).model_fields])


def _noise(here: Samples, layout: Layout, reference: Reference, vehicle: Resolved, free: Regressors) -> tuple[list[Array], Array]:
    """Roots of process noise, (K − 1, n, 3) each, and that of the measurements' (K, 6, 6)."""
    executed = here.executed
    duration = executed.duration_s
    states = free.transition.shape[1]
    torque, bias = layout.torque, layout.own(layout.gyro_bias)
    roots = list[Array]()
    if vehicle.imu.gyro_bias_walk_rad_s_sqrt_s > 0:
        wandering = np.zeros((len(duration) - 1, states, 3))
        wandering[:, bias] = np.eye(3) * (vehicle.imu.gyro_bias_walk_rad_s_sqrt_s * np.sqrt(duration[1:, None, None]))
        roots.append(wandering)
    if vehicle.environment.disturbance_torque_n_m > 0:
        impulse = vehicle.environment.disturbance_torque_n_m * duration[1:, None, None]
        roots.append(_in_rate(free.moment_to_rate * impulse, states))
    if torque.stop > torque.start:
        walk = np.zeros((len(duration) - 1, states, 3))
        plant = plant_of(vehicle)
        walk[:, layout.own(torque)] = plant.turning(plant.theta(reference)) * vehicle.environment.disturbance_walk_n_m
        roots.append(walk)
    measurement = np.zeros((len(duration), 6, 6))
    measurement[:] = np.diag(vehicle.noise)
    partly = here.unread[3:].any() and not here.unread[3:].all()
    if executed.pulse_covariance is not None:
        roots += [_in_rate(root, states) for root in _pulse_roots(executed.pulse_covariance, reference, vehicle, free)]
    if vehicle.environment.disturbance_torque_n_m > 0 or executed.pulse_covariance is not None:
        covariance = measurement[:, 3:, 3:] ** 2 + felt_noise(here, reference, vehicle)
        measurement[:, 3:, 3:] = np.linalg.cholesky(_apart(covariance, here) if partly else covariance)
    elif partly:
        measurement[:, 3:, 3:] = np.linalg.cholesky(_apart(measurement[:, 3:, 3:] ** 2, here))
    return roots, np.where((executed.ignored & ~here.unread)[:, :, None], DEAF, 1.0) * measurement


def _apart(covariance: Array, here: Samples) -> Array:
    """(K, 3, 3) covariance of specific force along the axes that it is measured along, independent along axes that are absent."""
    if here.executed.force_axes is not None:
        covariance = here.executed.force_axes @ covariance @ here.executed.force_axes.T
    absent = here.unread[3:]
    return np.where((absent[:, None] | absent) & ~np.eye(3, dtype=bool), 0.0, covariance)


def _in_rate(block: Array, states: int) -> Array:
    columns = np.zeros((len(block), states, 3))
    columns[:, :3] = block
    return columns


def _pulse_roots(covariance: Array, reference: Reference, vehicle: Resolved, free: Regressors) -> tuple[Array, Array]:
    """Roots (K − 1, 3, 3) of the rate's process noise from the pulse errors of the cycle that a step leaves, and of the one it enters.

    A pulse's error enters the rate over both steps; half of its variance counts in each, as if they were independent.
    """
    moment = plant_of(vehicle).jet_moment(reference)
    values, axes = np.linalg.eigh(moment @ covariance @ moment.T)
    root = axes * np.sqrt(np.clip(values, 0, None) / 2)[:, None, :]
    return free.moment_to_rate @ root[:-1], free.moment_to_rate @ root[1:]


def felt_noise(here: Samples, reference: Reference, vehicle: Resolved) -> Array:
    """(K, 3, 3) covariance of the specific force from disturbance torques and pulse errors: they push, and they swing the IMU.

    It counts as independent of what the same torques and errors do to the rate.
    """
    up = (here.up_b[:-1] + here.up_b[1:]) / 2
    _, felt = plant_of(vehicle).pushed(reference, np.eye(6), up, np.array(vehicle.imu.position_m))
    turned = vehicle.environment.disturbance_torque_n_m * felt[..., :3]
    found: Array = turned @ np.swapaxes(turned, 1, 2)
    if here.executed.pulse_covariance is not None:
        each = felt / here.executed.duration_s[:, None, None]
        found = found + each @ here.executed.pulse_covariance @ np.swapaxes(each, 1, 2)
    return found
