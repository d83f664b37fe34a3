"""What the momentum of wheels does to the body, −ω × h; and what an error of a scale does, of a wheel's inertia or of all thrust."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross, times
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.wheel import Wheel
from massprop_cli.model.plant import Motion, Plant, Reference
from massprop_cli.model.windows import Windows, windows
from massprop_cli.prepare.align import Aligned
from massprop_cli.prepare.wheels import Stored


def precession(stored: Stored, motion: Motion, bin_s: Array) -> tuple[Array, Array]:
    """(K, B, 3) torque −ω × h on the body, mean of each bin, N m; and its first moment about the bin's middle over its length, N m s."""
    return _precession(motion, stored.mean @ stored.axis, stored.skew @ stored.axis, bin_s)


def held(stored: Stored, bin_s: Array) -> Windows:
    """(K, 3) integrals of the momentum under a cycle's windows, N m s²."""
    return windows(stored.mean @ stored.axis, bin_s, (stored.skew @ stored.axis).sum(1))


def scale_sigmas(vehicle: Vehicle) -> Array:
    """(n,) one sigma of what a log may tell beside wheels: scales of all thrust, of each wheel's inertia and torque; its start."""
    if not vehicle.spinning:
        return np.zeros(0)
    found = np.array([vehicle.thrust.scale_sigma, *(sigma for wheel in vehicle.spinning for sigma in _sigmas(wheel))])
    return found[found > 0]


def relative_scales(vehicle: Vehicle) -> Array:
    """(n,) one relative sigma of each scale that inertia and mass may follow: of all thrust, of each wheel's column."""
    wheels = (_sigmas(wheel)[wheel.column == "torque"] for wheel in vehicle.spinning)
    return np.array([vehicle.thrust.scale_sigma, *wheels])


def moments_by_scale(executed: Aligned, vehicle: Vehicle, plant: Plant, reference: Reference, motion: Motion) -> Windows:
    """(K, 3, n) impulse of the moment, under a cycle's windows, by one unit of each of :func:`scale_sigmas`' scales, N m s."""
    assert executed.stored is not None
    channels, found = executed.channels, []
    if vehicle.thrust.scale_sigma > 0:
        own, _ = plant.pushed(reference, channels.wrench[: channels.thrusting], motion.up.mean(1), plant.pivot)
        found.append(_impulse(*(times(own, part[:, : channels.thrusting]) for part in (channels.rising, channels.whole))))
    for i, wheel in enumerate(vehicle.spinning):
        first, torque = _sigmas(wheel)
        # speed and inertia make all its momentum and torque; a torque column makes both, but for the momentum that it began with
        begun = np.full_like(executed.stored.mean[..., i], executed.stored.begun[i])
        grown = executed.stored.mean[..., i] - (begun if wheel.column == "torque" else 0.0), executed.stored.skew[..., i]
        exchanged = _impulse(
            *(part[:, channels.thrusting + i, None] * -executed.stored.axis[i] for part in (channels.rising, channels.whole))
        )
        if first > 0 and wheel.column == "torque":
            found.append(_precessed(executed, motion, i, np.full_like(begun, wheel.spin_inertia_kg_m2), np.zeros_like(begun)))
        elif first > 0:
            found.append(_sum(_precessed(executed, motion, i, *grown), exchanged))
        if torque > 0:
            found.append(_sum(_precessed(executed, motion, i, *grown), exchanged))
    return Windows(*(np.stack(parts, -1) for parts in zip(*found, strict=True)))


def _sigmas(wheel: Wheel) -> tuple[float, float]:
    """Of its inertia, relative; where torque is logged, of its momentum at first over its inertia, rad/s, and of that torque, relative."""
    relative = wheel.spin_inertia_sigma_kg_m2 / wheel.spin_inertia_kg_m2
    if wheel.column == "speed":
        return relative, 0.0
    return float(np.hypot(wheel.start_sigma_rad_s, relative * (wheel.start_rad_s or 0.0))), wheel.torque_scale_sigma


def _impulse(rising: Array, whole: Array) -> Windows:
    return Windows(rising, whole - rising, whole)


def _sum(one: Windows, other: Windows) -> Windows:
    return Windows(*(a + b for a, b in zip(one, other, strict=True)))


def _precessed(executed: Aligned, motion: Motion, number: int, mean: Array, skew: Array) -> Windows:
    """(K, 3) impulse of −ω × h of a momentum along one wheel's axis."""
    assert executed.stored is not None
    axis, bin_s = executed.stored.axis[number], executed.duration_s / mean.shape[1]
    pulled, late = _precession(motion, mean[..., None] * axis, skew[..., None] * axis, bin_s[:, None, None])
    return windows(pulled, bin_s, late.sum(1))


def _precession(motion: Motion, momentum: Array, skew: Array, bin_s: Array) -> tuple[Array, Array]:
    # within a bin the rate is linear: products of slopes count too
    mean = -cross(motion.rate, momentum) - cross(motion.rate_dot, skew)
    late = -cross(motion.rate, skew) - cross(motion.rate_dot, momentum) * bin_s**2 / 12
    return mean, late
