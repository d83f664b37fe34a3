"""Torque that depends on the motion: −ω × h of stored momentum h, −d ω of damping d (drag, bearing film, cable).

Also its derivatives with respect to the thrust scale and to the unknowns of the momentum devices.
"""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross, times
from massprop_cli.inputs.actuators.actuator import Unknown
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.plant import Motion, Plant, Reference
from massprop_cli.model.windows import Windows, windows
from massprop_cli.prepare.align import Aligned
from massprop_cli.prepare.stored import Stored


def momentum_integrals(stored: Stored, bin_s: Array) -> Windows:
    """(K, 3) integrals of the stored momentum over each cycle, N m s²."""
    return windows(stored.mean @ stored.axis, bin_s, (stored.skew @ stored.axis).sum(1))


def scale_sigmas(vehicle: Vehicle) -> Array:
    """(n,) prior sigmas of the thrust scale and of each device's unknowns that are above zero; empty without momentum devices."""
    if not vehicle.spinning:
        return np.zeros(0)
    sigmas = np.array([vehicle.thrust.scale_sigma, *(unknown.sigma for device in vehicle.spinning for unknown in device.unknowns)])
    return sigmas[sigmas > 0]


def relative_scales(vehicle: Vehicle) -> Array:
    """(n,) relative prior sigma of each scale that scales inertia and mass: of all thrust, of each device's torque."""
    devices = (unknown.sigma for device in vehicle.spinning for unknown in device.unknowns if unknown.scales)
    return np.array([vehicle.thrust.scale_sigma, *devices])


def moments_by_scale(executed: Aligned, vehicle: Vehicle, plant: Plant, reference: Reference, motion: Motion) -> Windows:
    """(K, 3, n) derivative of the moment's impulse [N m s] with respect to each unknown of :func:`scale_sigmas`, in its unit."""
    assert executed.stored is not None
    channels, impulses, first = executed.channels, [], 0
    if vehicle.thrust.scale_sigma > 0:
        moment, _ = plant.wrench_response(reference, channels.wrench[: channels.thrusting], motion.up.mean(1), plant.pivot)
        impulses.append(Windows(*(times(moment, part[:, : channels.thrusting]) for part in channels.windows)))
    for device in vehicle.spinning:
        axes = slice(first, first + len(device.axes))
        first = axes.stop
        impulses += [_moment(executed, motion, axes, unknown) for unknown in device.unknowns]
    return Windows(*(np.stack(parts, -1) for parts in zip(*impulses, strict=True)))


def _moment(executed: Aligned, motion: Motion, axes: slice, unknown: Unknown) -> Windows:
    """(K, 3) derivative of the impulse of −(ḣ + ω × h), N m s, with respect to ``unknown`` of the device with axes ``axes``."""
    stored, channels = executed.stored, executed.channels
    assert stored is not None
    axis = stored.axis[axes] if unknown.across is None else unknown.across
    columns = slice(channels.thrusting + axes.start, channels.thrusting + axes.stop)
    momentum = stored.mean[..., axes] - stored.begun[axes] * unknown.since_start
    mean, skew = momentum @ unknown.by.T + unknown.constant, stored.skew[..., axes] @ unknown.by.T
    bin_s = executed.duration_s / mean.shape[1]
    torque, first_moment = _precession(motion, mean @ axis, skew @ axis, bin_s[:, None, None])
    reaction = (-part[:, columns] @ unknown.by.T @ axis for part in channels.windows)
    return Windows(*(a + b for a, b in zip(windows(torque, bin_s, first_moment.sum(1)), reaction, strict=True)))


def _precession(motion: Motion, momentum: Array, skew: Array, bin_s: Array) -> tuple[Array, Array]:
    """(K, B, 3) torque −ω × h on the body, mean of each bin, N m; and its first moment about the bin's middle over its length, N m s."""
    # within a bin rate and momentum are linear: the product of their slopes counts too
    mean = -cross(motion.rate, momentum) - cross(motion.rate_dot, skew)
    first_moment = -cross(motion.rate, skew) - cross(motion.rate_dot, momentum) * bin_s**2 / 12
    return mean, first_moment


def made_by_motion(stored: Stored | None, damping: Array, motion: Motion, bin_s: Array) -> tuple[Array, Array] | None:
    """(K, B, 3) torque −ω × h − d ω, mean of each bin, N m, and its first moment over the bin's length, N m s.

    ``damping`` is d (3,), N m s; ``bin_s`` (K, 1, 1). None if there is neither momentum nor damping. A wheel of spin inertia J along a,
    whose speed is read at the cycle's end, adds J a aᵀ (ω̇ − mean ω̇): its momentum follows the body's rate within the cycle.
    """
    gyroscopic = None
    if stored is not None:
        mean, late = _precession(motion, stored.mean @ stored.axis, stored.skew @ stored.axis, bin_s)
        deviation = motion.rate_dot - motion.rate_dot.mean(1, keepdims=True)
        gyroscopic = mean + deviation @ stored.free_tensor, late + motion.rate_dot_moment @ stored.free_tensor
    if not damping.any():
        return gyroscopic
    torque, late = -damping * motion.rate, -damping * motion.rate_dot * bin_s**2 / 12
    return (torque, late) if gyroscopic is None else (gyroscopic[0] + torque, gyroscopic[1] + late)


def impulse_by_damping(motion: Motion, rates: tuple[Array, Array], bin_s: Array) -> Windows:
    """(K, 3, 3) derivative of the damping's impulse with respect to each axis' d, rad; ``rates`` (K, 3): at the cycles' start and end."""
    angle = windows(motion.rate, bin_s, (rates[1] - rates[0]) * bin_s[:, None] / 12)
    return Windows(*(-part[..., None] * np.eye(3) for part in angle))
