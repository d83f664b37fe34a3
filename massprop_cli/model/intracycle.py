"""Motion within a control cycle, rebuilt from its mean rate and its commands, and what of it the coefficients of the response multiply.

The gyro gives each cycle's mean rate; how the rate changes within, the commands give (Φ of :mod:`massprop_cli.model.plant` times what
acts). In B equal bins, of each of which mean, first moment and variance count, so that the error is of the fourth order in a bin's length.
Where the vertical counts the body turns by the rotation vector ``∫ω dt + ½ ∫(∫ω dt) × ω dt`` (coning; Bortz 1971), which pulses make as
large as a bearing's weight tells. Integrals are under the triangular window for the rate and over the cycle for the specific force
(:mod:`massprop_cli.prepare.align`): commands' exactly, all else by its bins.
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

STEEP = 0.5
"""Largest part of a rate's error that the gyroscopic coupling may add to it or take off within half a step."""
ORDERS = 4
"""Of the turn within a cycle: by two of them the vertical of a body that turns by 0.13 rad in one is off by 0.4 mrad, θ³ / 6."""
_REFINEMENTS = 3
"""Passes that rebuild the motion within a cycle; each gains a factor of rate × cycle."""


def by_component(vectors: Array) -> Array:
    """The same (..., C), in memory one component after the other: numpy is several times as fast there as over short rows."""
    apart = np.ascontiguousarray(vectors.transpose(-1, *range(vectors.ndim - 1)))
    return apart.transpose(*range(1, vectors.ndim), 0)


class Within(NamedTuple):
    """The motion in each bin, and what of it is needed beyond."""

    theta: Array
    """(10,) θ of the reference by which it was rebuilt."""
    response: Array
    """(3, C) Φ of it."""
    motion: Motion
    """Means over each bin."""
    rates: tuple[Array, Array]
    """(K, 3) the rate at the start and at the end of each cycle."""
    ups: tuple[Array, Array]
    """(K, 3) the vertical there."""
    beyond: Array
    """(K, 3) rotation vector of each cycle less its mean reading times its duration, rad, where the vertical counts: coning, and the
    difference between mean rate and mean reading that commands make."""
    damping: Array
    """(3,) of the reference, N m s."""


def motion_within(samples: Samples, reference: Reference, phi_map: ResponseMap) -> Within:
    """Rate, angular acceleration and attitude in each bin: measured cycle means, with the shape that the commands give them."""
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
    beyond: Array = np.zeros_like(mean)
    stored = executed.stored
    driven: Array = np.zeros(3)
    late: Array = np.zeros_like(rate)
    shown, grown = _mean_offset(samples, response, plant), np.zeros_like(mean)
    for again in range(_REFINEMENTS):
        coupled = times(response[:, -6:], products(motion.rate))
        coupled *= _bounded_share(coupled, motion.rate, bin_s * coupled.shape[1])
        if plant.pivoted or stored is not None or reference.damping.any() or not again:
            torque, torque_late = made_by_motion(stored, reference.damping, motion, bin_s) or (0.0, 0.0)
            driven = times(response[:, :-6], plant.inputs(_beside(motion.wrench, torque), motion.up, motion.up))
            # thrust that comes late in a bin leaves the bin's mean rate behind its middle's
            late = times(response[:, :-6], plant.inputs(_beside(skew, torque_late), np.zeros_like(rate), motion.up))
        rate_dot = driven + coupled
        if plant.pivoted:
            rate_dot = rate_dot + plant.nonlinear_acceleration(theta, motion)
        own = rate_dot * bin_s
        change = _summed(own)
        within = change - own / 2 - late
        start = mean - shown - grown - within.sum(1) / within.shape[1]
        rate = start[:, None] + within
        up = motion.up
        if plant.pivoted:
            angle = rate * bin_s
            turned, cone = _summed(angle), cross(rate, rate_dot) * bin_s**3 / 12
            cone += cross(turned, angle) / 2
            coned = _summed(cone)
            middle = turned - angle / 2 - rate_dot * bin_s**2 / 12 + coned - cone / 2
            up, end = (_turned(up_start, vector) for vector in (middle, turned[:, -1:] + coned[:, -1:]))
            ups, beyond = (up_start, end[:, 0]), turned[:, -1] + coned[:, -1] - mean * executed.duration_s[:, None]
        motion = Motion(motion.wrench, rate, rate_dot, up, late)
        if samples.kernel_effect is not None:
            turning = times(response[:, -6:], products(start + change[:, -1]) - products(start))
            grown = samples.kernel_effect.curvature_s2 * turning / executed.duration_s[:, None]
    return Within(theta, response, motion, (start, start + change[:, -1]), ups, beyond, reference.damping)


def _mean_offset(samples: Samples, response: Array, plant: Plant) -> Array:
    """(K, 3) mean reading less mean rate, rad/s, as far as commands make it: their response behind the sensor's kernel, less the motion."""
    executed = samples.executed
    if samples.kernel_effect is None:
        return np.zeros((len(samples), 3))
    bin_s = executed.duration_s / executed.impulse_bins.shape[1]
    moved = windows(executed.impulse_bins / bin_s[:, None, None], bin_s, executed.skew_bins.sum(1)).rising - executed.rising
    up = samples.up_b[:-1]
    return times(response[:, :-6], plant.inputs(moved, np.zeros_like(up), up))


def turned_beyond(within: Within, samples: Samples) -> Array:
    """(K, 3) the mean rate that turns the body in a cycle beyond that by which its attitude is carried, rad/s.

    Of the motion as it was rebuilt, less what :func:`massprop_cli.prepare.attitude.rotation_vectors` took for it, by two mean rates.
    """
    duration_s = samples.executed.duration_s[:, None]
    taken = cross(samples.rate_rad_s - samples.rate_step_rad_s, samples.rate_rad_s) * duration_s**2 / 12
    return (within.beyond - taken) / duration_s


def _beside(wrench: Array, torque: Array | float) -> Array:
    """The wrench with a torque beside it."""
    if isinstance(torque, float):
        return wrench
    return by_component(np.concatenate([wrench[..., :3] + torque, wrench[..., 3:]], -1))


def _summed(per_bin: Array) -> Array:
    """(K, B, 3) sums over the bins up to each."""
    found = per_bin.copy(order="K")
    for later in range(1, found.shape[1]):
        found[:, later] += found[:, later - 1]
    return found


def _turned(up: Array, angle: Array) -> Array:
    """(K, B, 3) the vertical (K, 3) after the body has turned by the rotation vector ``angle`` (K, B, 3), rad: the exponential's series."""
    term: Array = up[:, None]
    found = term
    for order in range(1, ORDERS + 1):
        term = cross(term, angle) / order
        found = found + term
    return found


def response_of(reference: Reference, phi_map: ResponseMap, theta: Array) -> Array:
    """(3, C) Φ of a reference."""
    if reference.response is not None:
        return reference.response
    return phi_map.plant.response(theta)


def _bounded_share(coupled: Array, rate: Array, cycle_s: Array) -> Array:
    """(K, B, 1) part of the gyroscopic coupling that changes the rate by no more than ``STEEP`` of itself within a cycle."""
    most, change = ((v**2).sum(-1, keepdims=True) for v in (STEEP * rate, coupled * cycle_s))
    steep = change > most
    if not steep.any():
        return np.ones(())
    found: Array = np.sqrt(most / np.maximum(np.maximum(most, change), np.finfo(float).tiny))
    return np.where(steep, found, 1.0)


def integrals(samples: Samples, phi_map: ResponseMap, theta: Array, within: Within) -> tuple[Array, Array, Array]:
    """What Φ multiplies: (K − 1, C) under the triangular window, (K, C) mean over each cycle; (K − 1, 3) known growth of the rate."""
    plant, executed, motion = phi_map.plant, samples.executed, within.motion
    duration = executed.duration_s
    bin_s = duration / motion.rate.shape[1]
    # the mean of a product over a bin in which ω̇ is constant exceeds its middle value by that of the accelerations times h² / 12
    second = products(motion.rate) + products(motion.rate_dot) * (bin_s**2 / 12)[:, None, None]
    # the commands' own exactly, the rest by its bins
    jets = plant.command_input(np.stack([executed.rising, executed.falling, executed.whole]))
    late_s, later_s = (bin_s / 12)[:, None], 0.0
    if samples.kernel_effect is not None:
        late_s, later_s = late_s - samples.kernel_effect.curvature_s2 / bin_s[:, None], samples.kernel_effect.later_s
    turning = products(within.rates[1]) - products(within.rates[0])
    parts = [(second, turning * late_s)]
    made = made_by_motion(executed.stored, within.damping, motion, bin_s[:, None, None])
    if made is not None:
        own = windows(made[0], bin_s, made[1].sum(1))
        jets = np.concatenate([jets[..., :3] + np.stack(own), jets[..., 3:]], -1)
    parts = [*plant.attitude_inputs(motion, within.ups, executed.skew_bins, late_s), *parts]
    each = [windows(channels, bin_s, lateness) for channels, lateness in parts]
    if plant.pivoted and plant.translates:
        each[1] = _sensed(executed, motion, bin_s, each[1])
    each[-1] = each[-1]._replace(whole=each[-1].whole + later_s * turning)
    acting = Windows(*(np.concatenate(columns, -1) for columns in zip(jets, *each, strict=True)))
    known = windows(plant.nonlinear_acceleration(theta, motion), bin_s).step if plant.pivoted else np.zeros((len(duration) - 1, 3))
    return acting.step, acting.whole / duration[:, None], known


def _sensed(executed: Aligned, motion: Motion, bin_s: Array, flat: Windows) -> Windows:
    """(K, 3) the level part of the force ``flat``, which is by bins, with what the sensors' windows hold of the force beyond its bins."""
    force, up = slice(3, 6), windows(motion.up, bin_s).whole / executed.duration_s[:, None]
    by_bins = windows(executed.impulse_bins[..., force] / bin_s[:, None, None], bin_s, executed.skew_bins[..., force].sum(1))
    exact = executed.rising, executed.falling, executed.whole
    return Windows(*(part + level(up, one[:, force] - binned) for part, one, binned in zip(flat, exact, by_bins, strict=True)))
