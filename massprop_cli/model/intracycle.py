"""Motion within a control cycle, reconstructed from mean rate and commands, and the integrals that the response coefficients multiply.

The gyro gives each cycle's mean rate; Φ of :mod:`massprop_cli.model.plant` times the inputs gives how the rate changes within the cycle.
Each of B equal bins counts with its mean, first moment and variance, so that the error is of fourth order in the bin's length. On a support
the body turns by a rotation vector φ with ``φ̇ = ω + ½ φ × ω + φ × (φ × ω) / 12`` (coning; Bortz 1971), to third order in the turn: with
pulsed jets coning is as large as the effect of the weight. Integrals are under the triangular window for the rate, and over the cycle for
the specific force (:mod:`massprop_cli.prepare.align`). Those of commands are exact; all others are sums over the bins.
"""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross, times
from massprop_cli.model.gyroscopic import products
from massprop_cli.model.momentum import made_by_motion
from massprop_cli.model.plant import Motion, Plant, Reference
from massprop_cli.model.plant.bearing import level
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.windows import Windows, windows
from massprop_cli.prepare.align import Aligned
from massprop_cli.prepare.compensate import Samples

MAX_COUPLING = 0.5
"""Bound on the gyroscopic coupling: largest part of a rate error that it may add or remove within half a step."""
_REFINEMENTS = 3
"""Passes of the reconstruction; each reduces the error by a factor of rate × cycle length."""


def by_component(vectors: Array) -> Array:
    """The same vectors (..., C), stored component by component: NumPy is several times faster there than on short rows."""
    rows = np.ascontiguousarray(vectors.transpose(-1, *range(vectors.ndim - 1)))
    return rows.transpose(*range(1, vectors.ndim), 0)


class IntraCycle(NamedTuple):
    """Motion within K cycles of B bins."""

    theta: Array
    """(10,) θ of the reference."""
    response: Array
    """(3, C) Φ of the reference."""
    motion: Motion
    """Means of each bin."""
    rates: tuple[Array, Array]
    """(K, 3) rate at the start and at the end of each cycle, rad/s."""
    ups: tuple[Array, Array]
    """(K, 3) vertical at the start and at the end of each cycle, body axes."""
    excess_rotation: Array
    """(K, 3) rotation vector of each cycle less its mean reading times its duration, rad; zeros in free flight. It holds the coning, and
    the difference between mean rate and mean reading that commands cause."""
    damping: Array
    """(3,) of the reference, N m s."""


def intra_cycle_motion(samples: Samples, reference: Reference, phi_map: ResponseMap) -> IntraCycle:
    """Rate, angular acceleration and vertical in each bin, consistent with the measured cycle means."""
    theta = phi_map.plant.theta(reference)
    response = response_of(reference, phi_map, theta)
    executed = samples.executed
    mean = samples.rate_rad_s - reference.gyro_bias
    impulse, skew = executed.impulse_bins, executed.skew_bins
    bin_s = (executed.duration_s / impulse.shape[1])[:, None, None]
    shape = (*impulse.shape[:2], 3)
    up_start = samples.up_b[:-1]
    plant = phi_map.plant
    wrench, skew = by_component(impulse / bin_s), by_component(skew)
    rate, up = (by_component(np.broadcast_to(v[:, None], shape)) for v in (mean, up_start))
    motion = Motion(wrench, rate, np.zeros_like(rate), up, np.zeros_like(rate))
    ups = up_start, up_start
    excess: Array = np.zeros_like(mean)
    stored = executed.stored
    driven: Array = np.zeros(3)
    rate_dot_moment: Array = np.zeros_like(rate)
    offset, kernel_growth = _mean_offset(samples, response, plant), np.zeros_like(mean)
    for iteration in range(_REFINEMENTS):
        coupled = times(response[:, -6:], products(motion.rate))
        coupled *= _coupling_limit(coupled, motion.rate, bin_s * coupled.shape[1])
        if plant.pivoted or stored is not None or reference.damping.any() or not iteration:
            torque, torque_moment = made_by_motion(stored, reference.damping, motion, bin_s) or (0.0, 0.0)
            driven = times(response[:, :-6], plant.inputs(_with_torque(motion.wrench, torque), motion.up, motion.up))
            # a later impulse makes the bin's mean rate less than the rate in its middle
            rate_dot_moment = times(response[:, :-6], plant.inputs(_with_torque(skew, torque_moment), np.zeros_like(rate), motion.up))
        rate_dot = driven + coupled
        if plant.pivoted:
            rate_dot = rate_dot + plant.nonlinear_acceleration(theta, motion)
        growth = rate_dot * bin_s
        change = _cumulative(growth)
        deviation = change - growth / 2 - rate_dot_moment
        rate_start = mean - offset - kernel_growth - deviation.sum(1) / deviation.shape[1]
        rate = rate_start[:, None] + deviation
        up = motion.up
        if plant.pivoted:
            up, end, turned = _verticals(up_start, rate, rate_dot, bin_s)
            ups, excess = (up_start, end), turned - mean * executed.duration_s[:, None]
        motion = Motion(motion.wrench, rate, rate_dot, up, rate_dot_moment)
        if samples.kernel_effect is not None:
            turning = times(response[:, -6:], products(rate_start + change[:, -1]) - products(rate_start))
            kernel_growth = samples.kernel_effect.curvature_s2 * turning / executed.duration_s[:, None]
    return IntraCycle(theta, response, motion, (rate_start, rate_start + change[:, -1]), ups, excess, reference.damping)


def _verticals(up_start: Array, rate: Array, rate_dot: Array, bin_s: Array) -> tuple[Array, Array, Array]:
    """(K, B, 3) vertical in the middle of each bin, (K, 3) vertical at the end, body axes, and (K, 3) rotation vector of the cycle, rad."""
    angle = rate * bin_s
    rotated, cone_of_bin = _cumulative(angle), cross(rate, rate_dot) * bin_s**3 / 12
    cone_of_bin += cross(rotated, angle) / 2
    cones, turned = _cumulative(cone_of_bin), rotated - angle / 2
    cone_of_bin += cross(cones - cone_of_bin / 2, angle) / 2 + cross(turned, cross(turned, angle)) / 12
    cones = _cumulative(cone_of_bin)
    middle = turned - rate_dot * bin_s**2 / 12 + cones - cone_of_bin / 2
    end = rotated[:, -1:] + cones[:, -1:]
    return _rotated(up_start, middle), _rotated(up_start, end)[:, 0], end[:, 0]


def _mean_offset(samples: Samples, response: Array, plant: Plant) -> Array:
    """(K, 3) mean reading minus mean rate by the commands, rad/s: their response seen through the sensor kernel, minus the motion."""
    executed = samples.executed
    if samples.kernel_effect is None:
        return np.zeros((len(samples), 3))
    bin_s = executed.duration_s / executed.impulse_bins.shape[1]
    difference = windows(executed.impulse_bins / bin_s[:, None, None], bin_s, executed.skew_bins.sum(1)).rising - executed.rising
    up = samples.up_b[:-1]
    return times(response[:, :-6], plant.inputs(difference, np.zeros_like(up), up))


def unpropagated_rate(intra: IntraCycle, samples: Samples) -> Array:
    """(K, 3) mean rate that turns the body in addition to the rate that propagates its attitude, rad/s.

    Excess rotation of the reconstructed motion, less the coning that :func:`massprop_cli.prepare.attitude.rotation_vectors` computes from
    two mean rates.
    """
    duration_s = samples.executed.duration_s[:, None]
    propagated = cross(samples.rate_rad_s - samples.rate_step_rad_s, samples.rate_rad_s) * duration_s**2 / 12
    return (intra.excess_rotation - propagated) / duration_s


def _with_torque(wrench: Array, torque: Array | float) -> Array:
    """The wrench (..., 6) with ``torque`` added."""
    if isinstance(torque, float):
        return wrench
    return by_component(np.concatenate([wrench[..., :3] + torque, wrench[..., 3:]], -1))


def _cumulative(per_bin: Array) -> Array:
    """(K, B, 3) cumulative sums over the bins."""
    sums = per_bin.copy(order="K")
    for later in range(1, sums.shape[1]):
        sums[:, later] += sums[:, later - 1]
    return sums


def _rotated(up: Array, angle: Array) -> Array:
    """(K, B, 3) vertical (K, 3) in body axes after a rotation by ``angle`` (K, B, 3), rad (Rodrigues 1840)."""
    once = cross(up[:, None], angle)
    turn = np.sqrt((angle**2).sum(-1, keepdims=True)) / np.pi
    return up[:, None] + np.asarray(np.sinc(turn)) * once + np.asarray(np.sinc(turn / 2)) ** 2 / 2 * cross(once, angle)


def response_of(reference: Reference, phi_map: ResponseMap, theta: Array) -> Array:
    """(3, C) Φ of a reference."""
    if reference.response is not None:
        return reference.response
    return phi_map.plant.response(theta)


def _coupling_limit(coupled: Array, rate: Array, cycle_s: Array) -> Array:
    """(K, B, 1) factor on the gyroscopic coupling that keeps its change of the rate within a cycle below ``MAX_COUPLING`` of the rate."""
    bound, change = ((v**2).sum(-1, keepdims=True) for v in (MAX_COUPLING * rate, coupled * cycle_s))
    steep = change > bound
    if not steep.any():
        return np.ones(())
    factor: Array = np.sqrt(bound / np.maximum(np.maximum(bound, change), np.finfo(float).tiny))
    return np.where(steep, factor, 1.0)


def integrals(samples: Samples, phi_map: ResponseMap, theta: Array, intra: IntraCycle) -> tuple[Array, Array, Array]:
    """Integrals of the inputs z: (K − 1, C) under the triangular window, (K, C) cycle means; and (K − 1, 3) known growth of the rate."""
    plant, executed, motion = phi_map.plant, samples.executed, intra.motion
    duration = executed.duration_s
    bin_s = duration / motion.rate.shape[1]
    # mean of a product of linear functions over a bin: product of the middle values + product of the slopes · h² / 12
    rate_products = products(motion.rate) + products(motion.rate_dot) * (bin_s**2 / 12)[:, None, None]
    # commands are integrated exactly, all else by bins
    commanded = plant.command_input(np.stack([executed.rising, executed.falling, executed.whole]))
    moment_s, delay_s = (bin_s / 12)[:, None], 0.0
    if samples.kernel_effect is not None:
        moment_s, delay_s = moment_s - samples.kernel_effect.curvature_s2 / bin_s[:, None], samples.kernel_effect.later_s
    growth = products(intra.rates[1]) - products(intra.rates[0])
    parts = [(rate_products, growth * moment_s)]
    torque = made_by_motion(executed.stored, intra.damping, motion, bin_s[:, None, None])
    if torque is not None:
        by_motion = windows(torque[0], bin_s, torque[1].sum(1))
        commanded = np.concatenate([commanded[..., :3] + np.stack(by_motion), commanded[..., 3:]], -1)
    parts = [*plant.attitude_inputs(motion, intra.ups, executed.skew_bins, moment_s), *parts]
    each = [windows(channels, bin_s, first_moment) for channels, first_moment in parts]
    if plant.pivoted and plant.translates:
        each[1] = _exact_level_force(executed, motion, bin_s, each[1])
    each[-1] = each[-1]._replace(whole=each[-1].whole + delay_s * growth)
    acting = Windows(*(np.concatenate(columns, -1) for columns in zip(commanded, *each, strict=True)))
    known = windows(plant.nonlinear_acceleration(theta, motion), bin_s).step if plant.pivoted else np.zeros((len(duration) - 1, 3))
    return acting.step, acting.whole / duration[:, None], known


def _exact_level_force(executed: Aligned, motion: Motion, bin_s: Array, by_bins: Windows) -> Windows:
    """(K, 3) integrals of the force's level part: ``by_bins`` plus the difference of exact and binned integral of the force."""
    force, up = slice(3, 6), windows(motion.up, bin_s).whole / executed.duration_s[:, None]
    binned = windows(executed.impulse_bins[..., force] / bin_s[:, None, None], bin_s, executed.skew_bins[..., force].sum(1))
    exact = executed.rising, executed.falling, executed.whole
    return Windows(*(part + level(up, one[:, force] - other) for part, one, other in zip(by_bins, exact, binned, strict=True)))
