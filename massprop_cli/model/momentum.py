"""Torque that depends on the motion: −ω × h of stored momentum, −d ω of damping (drag, a bearing's film, a cable), d of each axis.

And what an error of what is stated does, of a device or of all thrust.
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


def held(stored: Stored, bin_s: Array) -> Windows:
    """(K, 3) integrals of the momentum under a cycle's windows, N m s²."""
    return windows(stored.mean @ stored.axis, bin_s, (stored.skew @ stored.axis).sum(1))


def scale_sigmas(vehicle: Vehicle) -> Array:
    """(n,) one sigma of what a log may tell beside momentum devices: the scale of all thrust, and each device's unknowns."""
    if not vehicle.spinning:
        return np.zeros(0)
    found = np.array([vehicle.thrust.scale_sigma, *(unknown.sigma for device in vehicle.spinning for unknown in device.unknowns)])
    return found[found > 0]


def relative_scales(vehicle: Vehicle) -> Array:
    """(n,) one relative sigma of each scale that inertia and mass may follow: of all thrust, of each device's torque."""
    devices = (unknown.sigma for device in vehicle.spinning for unknown in device.unknowns if unknown.scales)
    return np.array([vehicle.thrust.scale_sigma, *devices])


def moments_by_scale(executed: Aligned, vehicle: Vehicle, plant: Plant, reference: Reference, motion: Motion) -> Windows:
    """(K, 3, n) impulse of the moment, under a cycle's windows, by one unit of each of :func:`scale_sigmas`' scales, N m s."""
    assert executed.stored is not None
    channels, found, first = executed.channels, [], 0
    if vehicle.thrust.scale_sigma > 0:
        own, _ = plant.pushed(reference, channels.wrench[: channels.thrusting], motion.up.mean(1), plant.pivot)
        found.append(Windows(*(times(own, part[:, : channels.thrusting]) for part in channels.windows)))
    for device in vehicle.spinning:
        axes = slice(first, first + len(device.axes))
        first = axes.stop
        found += [_moment(executed, motion, axes, unknown) for unknown in device.unknowns]
    return Windows(*(np.stack(parts, -1) for parts in zip(*found, strict=True)))


def _moment(executed: Aligned, motion: Motion, own: slice, unknown: Unknown) -> Windows:
    """(K, 3) impulse of −(δḣ + ω × δh) by one unit of an unknown of the device whose axes are ``own``."""
    stored, channels = executed.stored, executed.channels
    assert stored is not None
    axis = stored.axis[own] if unknown.across is None else unknown.across
    turning = slice(channels.thrusting + own.start, channels.thrusting + own.stop)
    held = stored.mean[..., own] - stored.begun[own] * unknown.since_start
    mean, skew = held @ unknown.by.T + unknown.constant, stored.skew[..., own] @ unknown.by.T
    bin_s = executed.duration_s / mean.shape[1]
    pulled, late = _precession(motion, mean @ axis, skew @ axis, bin_s[:, None, None])
    exchanged = (-part[:, turning] @ unknown.by.T @ axis for part in channels.windows)
    return Windows(*(a + b for a, b in zip(windows(pulled, bin_s, late.sum(1)), exchanged, strict=True)))


def _precession(motion: Motion, momentum: Array, skew: Array, bin_s: Array) -> tuple[Array, Array]:
    """(K, B, 3) torque −ω × h on the body, mean of each bin, N m; and its first moment about the bin's middle over its length, N m s."""
    # within a bin the rate is linear: products of slopes count too
    mean = -cross(motion.rate, momentum) - cross(motion.rate_dot, skew)
    late = -cross(motion.rate, skew) - cross(motion.rate_dot, momentum) * bin_s**2 / 12
    return mean, late


def made_by_motion(stored: Stored | None, damping: Array, motion: Motion, bin_s: Array) -> tuple[Array, Array] | None:
    """(K, B, 3) torque −ω × h − d ω, mean of each bin, N m; its first moment about the bin's middle over its length, N m s.

    And J a aᵀ (ω̇ − ω̇'), ω̇' the mean of the cycle: what wheels of spin inertia J that are read at its end take less of ω̇ than in that
    mean. ``damping`` is d (3,), N m s; ``bin_s`` (K, 1, 1). None where there is neither.
    """
    precessing = None
    if stored is not None:
        mean, late = _precession(motion, stored.mean @ stored.axis, stored.skew @ stored.axis, bin_s)
        beyond = motion.rate_dot - motion.rate_dot.mean(1, keepdims=True)
        precessing = mean + beyond @ stored.free_tensor, late + motion.late @ stored.free_tensor
    if not damping.any():
        return precessing
    torque, late = -damping * motion.rate, -damping * motion.rate_dot * bin_s**2 / 12
    return (torque, late) if precessing is None else (precessing[0] + torque, precessing[1] + late)


def impulse_by_damping(motion: Motion, rates: tuple[Array, Array], bin_s: Array) -> Windows:
    """(K, 3, 3) impulse of the torque under a cycle's windows by each axis' d, rad; ``rates`` (K, 3) begin and end the cycles."""
    turned = windows(motion.rate, bin_s, (rates[1] - rates[0]) * bin_s[:, None] / 12)
    return Windows(*(-part[..., None] * np.eye(3) for part in turned))
