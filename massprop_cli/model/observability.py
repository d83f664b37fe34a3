"""Observability of the quantities by any motion of the vehicle, and excitation of each channel by the log's commands."""

import numpy as np

from massprop_cli import INERTIA, QUANTITIES
from massprop_cli.base.arrays import ROUNDING, TINY, Array, BoolArray, singular
from massprop_cli.base.moments import Moments
from massprop_cli.base.rigidbody import angular_acceleration, cross, times, torque_regressor
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.layout import CG, PARAMETERS, RATE, Layout
from massprop_cli.model.linearise import linearise, without_tilt
from massprop_cli.model.parameters import parameters
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Source, blocks

DROWNED = 1 / 3
DROWNED = 1 / 3
"""Power of the disturbance in a channel over the power explained there, above which the channel does not inform the estimate."""
NONE: BoolArray = np.zeros(6, dtype=bool)
"""(6,) no absent channels."""
_MOTIONS = 60
GENERIC = Reference(np.array([[0.8, 0.05, -0.07], [0.05, 1.0, 0.06], [-0.07, 0.06, 1.2]]), np.array([0.03, -0.05, 0.07]), 0.1)
"""A body without symmetries: its motion informs whatever the environment permits."""


def observable(capability: Array, reference: Reference, vehicle: Vehicle, unread: BoolArray = NONE) -> BoolArray:
    """(10,) whether any motion of this vehicle informs each quantity (thesis eq. 3.17: rank of the stacked regressors).

    ``unread`` (6,) are channels that the log doesn't have. Motions without a pattern, with commands from the span of ``capability`` (r, 6),
    stand for all motions. A quantity is observable if the null space of their regressors does not contain it. The test uses ``reference``
    and a body without symmetries, because ``reference`` may be a divergent estimate.
    """
    return _observable_with(capability, reference, vehicle, unread) | _observable_with(capability, GENERIC, vehicle, unread)


def _observable_with(capability: Array, reference: Reference, vehicle: Vehicle, unread: BoolArray) -> BoolArray:
    # incommensurate waves: no column is a linear combination of others
    waves = np.cos(np.outer(np.arange(1, _MOTIONS + 1), np.sqrt(np.arange(len(capability) + 6) + 0.5)))
    wrench = waves[:, 6:] @ capability if len(capability) else np.zeros((_MOTIONS, 6))
    torque, force = wrench[:, :3], wrench[:, 3:]
    largest = np.abs(torque).max() or 1.0
    rate = waves[:, :3] * np.sqrt(largest / np.trace(reference.inertia))
    up = waves[:, 3:6] / np.linalg.norm(waves[:, 3:6], axis=1, keepdims=True)
    plant = plant_of(vehicle)
    if not plant.translates:
        by_weight = vehicle.environment.gravity_m_s2 / reference.mu * cross(reference.cg - plant.pivot, up)
        torque, force = plant.command_input(wrench) - by_weight, np.zeros_like(force)
    rate_dot = angular_acceleration(reference.inertia, reference.cg, rate, torque, force)
    if vehicle.estimator.method == "thesis":
        gravity = vehicle.environment.gravity_m_s2 if vehicle.on_air_bearing else 0.0
        reaction = gravity / reference.mu * up
        rows = np.concatenate([torque_regressor(rate, rate_dot, force + reaction), (force * reference.mu)[..., None]], -1)
        rows = np.concatenate([rows, np.zeros((_MOTIONS, 3, 10))], 1)
        rows[:, 3:, 9] = rows[:, :3, 9]
        rows[:, :3, 9] = 0.0
    else:
        rows = plant.regressor(reference, rate, rate_dot, force, up)
    return _in_row_space(np.concatenate([rows[:, ~unread].reshape(-1, 10), _known_inertia(rows, vehicle)]))


def _known_inertia(rows: Array, vehicle: Vehicle) -> Array:
    """(n, 10) rows of known inertias on a pedestal, as informative as all motion; without commands motion informs only ratios."""
    if not vehicle.on_pedestal:
        return np.zeros((0, 10))
    index = [QUANTITIES.index(name) for name in vehicle.known if name in INERTIA]
    return np.asarray(np.eye(10)[index] * np.sqrt((rows**2).sum((0, 1))))


def _in_row_space(rows: Array) -> BoolArray:
    size = np.sqrt((rows**2).sum(0))
    seen = size > 0
    scaled = rows / np.where(seen, size, 1.0)
    _, values, right = singular(scaled)
    null = right[values < ROUNDING * max(values[0], TINY)]
    return np.asarray(seen & ~(np.abs(null) > 1e-6).any(0))


def excitation(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved) -> tuple[Array, BoolArray]:
    """Information share of each channel, and channels in which a disturbance exceeds the response to the commands.

    Returns (10, 6), the share of each channel (rate x y z, specific force x y z) in the information on each quantity. Returns (6,), whether
    the non-white part of a channel's residual exceeds ``DROWNED`` of the part that commands and mass properties explain.
    """
    gyro, accel, plain = vehicle.imu.gyro_noise_rad_s, vehicle.noise[3:], vehicle.imu.accel_noise_m_s2
    theta = parameters(reference)
    commanded = theta.copy()
    commanded[CG] = 0.0  # the CG's part in the specific force is itself in question: it does not count as explained
    slow = vehicle.environment.disturbance_walk_n_m > 0  # the filter follows a slow torque: only changes between steps count
    tilt, sloping = Layout.of(samples, vehicle).tilt, plant_of(vehicle).tilt_sigma > 0
    information, before = np.zeros((6, 10)), np.zeros((2, 0, 3))
    rate_response, force_response, rate_residuals = (Moments(3, False) for _ in range(3))
    force_residuals = Moments(3, vehicle.imu.accel_bias_sigma_m_s2 > 0)
    for part in blocks(cycles):
        system = linearise(samples, part, reference, vehicle)
        new = slice(None, None if part.stop == cycles.stop else -1)
        rate_jacobian, force_jacobian = system.transition[:, RATE, PARAMETERS], system.observation[new, 3:, PARAMETERS]
        information[:3] += (rate_jacobian**2).sum(0) / gyro**2
        information[3:] += (force_jacobian**2).sum(0) / accel[:, None] ** 2
        here = samples.part(part)
        used = np.asarray(~here.executed.ignored.reshape(-1, 2, 3).any(2))
        residual = (np.diff(here.rate_rad_s, axis=0) - system.steps) * (used[1:, :1] & used[:-1, :1])
        force_residual: Array = system.specific_force - times(system.observation[:, 3:, PARAMETERS], theta)
        force_residual = without_tilt(system, force_residual, tilt) if sloping else force_residual
        force_residuals.add((force_residual * used[:, 1:])[new])
        force_response.add(times(force_jacobian, commanded))
        steps = np.concatenate([before, [system.steps, residual]], 1)
        before = steps[:, -1:] if slow else before
        response, unexplained_steps = np.diff(steps, axis=1) if slow else steps
        rate_response.add(response)
        rate_residuals.add(unexplained_steps)
    share = (information / np.maximum(information.sum(0), TINY)).T
    explained = np.concatenate([rate_response.variance, force_response.variance])
    variance = np.concatenate([rate_residuals.variance, force_residuals.variance])
    lagged = np.concatenate([rate_residuals.lagged, force_residuals.lagged])
    coloured = np.concatenate([variance[:3] + 2 * np.minimum(lagged[:3], 0.0), np.maximum(lagged[3:], 0.0)])
    noise = np.concatenate([np.full(3, 2 * gyro**2), np.full(3, plain**2)])
    significant = (coloured > 0.5 * np.minimum(noise, variance)) & (coloured > 5 * variance / np.sqrt(force_residuals.count))
    return share, (coloured > DROWNED * explained) & significant & ~samples.unread
