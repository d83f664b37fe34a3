"""What a filter on the nuisance states is fed, cycle by cycle: transitions, drives, measurements and their noise.

Drives and measurements have columns: the log's own, one for each coefficient φ of :mod:`massprop_cli.model.plant`, one for each assumption
considered (:mod:`massprop_cli.model.sensitivity`). Where mass properties are said to drift, their departure from where they began is ten
more states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.lift import Lift
from massprop_cli.model.linearise import MU, RATE, Layout, Lifted, lifted
from massprop_cli.model.momentum import scale_sigmas
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.sensitivity import Consider, fed
from massprop_cli.prepare.align import Aligned
from massprop_cli.prepare.compensate import Mounted, Source

STEADY = 1e3
"""A slowly varying torque may begin at this many of its changes per cycle, or at what the jets can do."""
WIDE = 1e3
"""rad/s; of a rate of which nothing is known."""
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
    """(K, 6, n)"""
    measured: Array
    """(K, 6, C)"""
    noise: Array
    """(K, 6, 6) root of the measurement noise."""

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
        )


def system_of(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, consider: Consider) -> System:
    """The system of ``cycles`` about ``reference``. Noise levels must be set in ``vehicle``."""
    free, executed = lifted(samples, cycles, reference, vehicle), samples.part(cycles).executed
    drive, measured = free.drive, free.measured
    if consider.columns(len(samples.wrench)) or consider.kinds:
        driven, seen = fed(free, samples, cycles, reference, vehicle, consider)
        drive, measured = np.concatenate([drive, driven], -1), np.concatenate([measured, seen], -1)
    transition, observation = free.transition, free.observation
    roots, noise = _noise(executed, Layout.of(samples, vehicle), reference, vehicle, free)
    walk = drift(vehicle)
    if walk.any():
        walk[MU] *= reference.mu**2
        lift = Lift(plant_of(vehicle))
        theta = lift.theta(reference)
        by_parameter = lift.coefficients(theta)[1] @ np.linalg.inv(lift.slopes(theta))
        states = transition.shape[1]
        grown = np.zeros((len(transition), states + 10, states + 10))
        grown[:, :states, :states], grown[:, states:, states:] = transition, np.eye(10)
        grown[:, :3, states:] = free.drive[:, :3, 1:] @ by_parameter
        transition = grown
        wider = np.zeros((len(observation), 6, states + 10))
        wider[..., :states] = observation
        wider[:, 3:, states:] = -free.measured[:, 3:, 1:] @ by_parameter
        observation = wider
        drive = np.concatenate([drive, np.zeros((len(drive), 10, drive.shape[2]))], 1)
        roots = [np.concatenate([root, np.zeros((len(root), 10, root.shape[2]))], 1) for root in roots]
        step = np.zeros((len(drive), states + 10, 10))
        step[:, states:] = np.diag(walk) * np.sqrt(executed.duration_s[1:])[:, None, None]
        roots.append(step)
    return System(transition, drive, np.concatenate(roots, -1) if roots else None, observation, measured, noise)


def prior(samples: Mounted, vehicle: Vehicle) -> Array:
    """(n,) one sigma of each state in the first cycle about zero; wide for the rate, which that cycle measures."""
    layout = Layout.of(samples, vehicle)
    jets = np.linalg.norm(vehicle.jet_wrench[:, :3], axis=1) if vehicle.jets else np.zeros(1)
    sigma = np.zeros(layout.size)
    sigma[RATE] = WIDE
    sigma[layout.gyro_bias] = vehicle.imu.gyro_bias_sigma_rad_s
    sigma[layout.accel_bias] = vehicle.imu.accel_bias_sigma_m_s2
    sigma[layout.torque] = max(STEADY * vehicle.environment.disturbance_walk_n_m, float(jets.max()))
    sigma[layout.damping] = vehicle.environment.damping_sigma_n_m_s
    sigma[layout.tilt] = plant_of(vehicle).tilt_sigma
    sigma[layout.scale] = scale_sigmas(vehicle)
    departed = np.zeros(10 if drift(vehicle).any() else 0)  # known to be none at first
    return np.concatenate([sigma[RATE.start :], departed])


def drift(vehicle: Vehicle) -> Array:
    """(10,) random walk of each quantity, per sqrt(s)."""
    return np.array([getattr(vehicle.drift, name) for name in type(vehicle.drift).model_fields])


def _noise(executed: Aligned, layout: Layout, reference: Reference, vehicle: Vehicle, free: Lifted) -> tuple[list[Array], Array]:
    """Roots of process noise, (K − 1, n, 3) each, and that of the measurements' (K, 6, 6)."""
    duration = executed.duration_s
    states = free.transition.shape[1]
    torque = layout.torque
    roots = []
    if vehicle.environment.disturbance_torque_n_m > 0:
        impulse = vehicle.environment.disturbance_torque_n_m * duration[1:, None, None]
        roots.append(_in_rate(free.moment_to_rate * impulse, states))
    if torque.stop > torque.start:
        walk = np.zeros((len(duration) - 1, states, 3))
        walk[:, torque.start - RATE.start : torque.stop - RATE.start] = vehicle.environment.disturbance_walk_n_m * np.eye(3)
        roots.append(walk)
    measurement = np.zeros((len(duration), 6, 6))
    scale = np.array(vehicle.estimator.accel_noise_scale or (1.0, 1.0, 1.0))
    stated = np.concatenate([[vehicle.imu.gyro_noise_rad_s] * 3, scale * (vehicle.imu.accel_noise_m_s2 or 0.0)])
    measurement[:] = np.diag(stated.astype(float))
    if executed.pulse_covariance is not None:
        rate, force = _pulse_noise(executed.pulse_covariance, reference, vehicle, free, duration)
        roots.append(_in_rate(rate, states))
        measurement[:, 3:, 3:] = np.linalg.cholesky(measurement[:, 3:, 3:] ** 2 + force)
    for part, ignored in zip((slice(0, 3), slice(3, 6)), executed.ignored.T, strict=True):
        measurement[ignored, part, part] *= DEAF
    return roots, measurement


def _in_rate(block: Array, states: int) -> Array:
    columns = np.zeros((len(block), states, 3))
    columns[:, :3] = block
    return columns


def _pulse_noise(covariance: Array, reference: Reference, vehicle: Vehicle, free: Lifted, duration: Array) -> tuple[Array, Array]:
    """Root of the rate's process noise (K − 1, 3, 3) and covariance of the specific force (K, 3, 3) from pulse errors.

    A pulse's error enters the rate once; here it enters with the step out of its cycle, and the accelerometer's share counts as
    independent of it.
    """
    moment = plant_of(vehicle).jet_moment(reference)
    values, axes = np.linalg.eigh(moment @ covariance[:-1] @ moment.T)
    root = free.moment_to_rate @ (axes * np.sqrt(np.clip(values, 0, None))[:, None, :])
    force = reference.mu**2 * covariance[:, 3:, 3:] / (duration**2)[:, None, None]
    return root, force
