"""What a method could learn from this vehicle at all, and what this log's commands told it."""

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
"""A channel tells nothing where disturbances exceed this part of the power that commands and mass properties explain in it."""
NONE: BoolArray = np.zeros(6, dtype=bool)
_MOTIONS = 60
GENERIC = Reference(np.array([[0.8, 0.05, -0.07], [0.05, 1.0, 0.06], [-0.07, 0.06, 1.2]]), np.array([0.03, -0.05, 0.07]), 0.1)
"""A body without symmetries."""


def observable(capability: Array, reference: Reference, vehicle: Vehicle, unread: BoolArray = NONE) -> BoolArray:
    """(10,) whether any motion of this vehicle informs each quantity (thesis eq. 3.17: rank of the stacked regressors).

    ``unread`` (6,): channels that the log doesn't have.

    Motions without a pattern, with commands from the span of ``capability`` (r, 6), stand for all motions; a quantity is observable if it
    does not enter the null space of what they show, of the ``reference`` or of a body without symmetries: an estimate that went astray is
    none.
    """
    return _shown(capability, reference, vehicle, unread) | _shown(capability, GENERIC, vehicle, unread)


def _shown(capability: Array, reference: Reference, vehicle: Vehicle, unread: BoolArray) -> BoolArray:
    # incommensurate waves: no column follows from others
    drawn = np.cos(np.outer(np.arange(1, _MOTIONS + 1), np.sqrt(np.arange(len(capability) + 6) + 0.5)))
    wrench = drawn[:, 6:] @ capability if len(capability) else np.zeros((_MOTIONS, 6))
    torque, force = wrench[:, :3], wrench[:, 3:]
    size = np.abs(torque).max() or 1.0
    rate = drawn[:, :3] * np.sqrt(size / np.trace(reference.inertia))
    up = drawn[:, 3:6] / np.linalg.norm(drawn[:, 3:6], axis=1, keepdims=True)
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
    return _in_row_space(np.concatenate([rows[:, ~unread].reshape(-1, 10), _weighed(rows, vehicle)]))


def _weighed(rows: Array, vehicle: Vehicle) -> Array:
    """(n, 10) what is known of inertia on a pedestal, where without commands motion tells ratios alone: as clear as any motion."""
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
    """Which channel told what, and which channels told nothing of the commands.

    Returns the share (10, 6) of each channel (rate x y z, specific force x y z) in the information on each quantity, and (6,) whether in
    that channel the part of the residual that is not white noise is more than ``DROWNED`` of what commands and mass properties explain.
    """
    gyro, accel, plain = vehicle.imu.gyro_noise_rad_s, vehicle.noise[3:], vehicle.imu.accel_noise_m_s2
    theta = parameters(reference)
    commanded = theta.copy()
    commanded[CG] = 0.0  # what the accelerometer sees of the CG is in question itself, so it doesn't count as explained
    slow = vehicle.environment.disturbance_walk_n_m > 0  # then the filter follows slow torques, and what is left is judged
    tilt, sloping = Layout.of(samples, vehicle).tilt, plant_of(vehicle).tilt_sigma > 0
    told, before = np.zeros((6, 10)), np.zeros((2, 0, 3))
    stepped, pushed, unexplained, felt = (Moments(3, centred) for centred in (False, False, False, vehicle.imu.accel_bias_sigma_m_s2 > 0))
    for part in blocks(cycles):
        system = linearise(samples, part, reference, vehicle)
        own = slice(None, None if part.stop == cycles.stop else -1)
        turning, pushing = system.transition[:, RATE, PARAMETERS], system.observation[own, 3:, PARAMETERS]
        told[:3] += (turning**2).sum(0) / gyro**2
        told[3:] += (pushing**2).sum(0) / accel[:, None] ** 2
        here = samples.part(part)
        used = np.asarray(~here.executed.ignored.reshape(-1, 2, 3).any(2))
        beyond = (np.diff(here.rate_rad_s, axis=0) - system.steps) * (used[1:, :1] & used[:-1, :1])
        left: Array = system.specific_force - times(system.observation[:, 3:, PARAMETERS], theta)
        left = without_tilt(system, left, tilt) if sloping else left
        felt.add((left * used[:, 1:])[own])
        pushed.add(times(pushing, commanded))
        steps = np.concatenate([before, [system.steps, beyond]], 1)
        before = steps[:, -1:] if slow else before
        turned, rest = np.diff(steps, axis=1) if slow else steps
        stepped.add(turned)
        unexplained.add(rest)
    share = (told / np.maximum(told.sum(0), TINY)).T
    explained = np.concatenate([stepped.variance, pushed.variance])
    variance, lagged = (np.concatenate(both) for both in ((unexplained.variance, felt.variance), (unexplained.lagged, felt.lagged)))
    coloured = np.concatenate([variance[:3] + 2 * np.minimum(lagged[:3], 0.0), np.maximum(lagged[3:], 0.0)])
    noise = np.concatenate([np.full(3, 2 * gyro**2), np.full(3, plain**2)])
    significant = (coloured > 0.5 * np.minimum(noise, variance)) & (coloured > 5 * variance / np.sqrt(felt.count))
    return share, (coloured > DROWNED * explained) & significant & ~samples.unread
