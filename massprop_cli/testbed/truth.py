"""True mass properties that change: an object docks, fuel burns."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.testbed.conditions import Body, Fuel
from massprop_cli.testbed.motion import Bodies, apply, cross, outer_square
from massprop_cli.testbed.timeline import Event

STANDARD_GRAVITY = 9.80665


def bodies(truth: Body, members: int) -> Bodies:
    """The same true body for every member."""
    values = truth.values
    return Bodies(
        np.repeat(truth.inertia[..., None], members, -1), np.repeat(values[6:9, None], members, -1), np.full(members, float(values[9]))
    )


def values(body: Bodies) -> Array:
    """(S, 10) in the order of the ten quantities."""
    rows, columns = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
    return np.concatenate([body.inertia[rows, columns], body.cg, body.mass[None]]).T


def joined(vehicle: Bodies, other: Bodies, fixed_mass: float) -> Bodies:
    """The combined body; ``fixed_mass`` [kg] of the vehicle's mass (a bearing's) has no part in CG and inertia."""
    first, second = vehicle.mass - fixed_mass, other.mass
    cg = (first * vehicle.cg + second * other.cg) / (first + second)
    inertia = vehicle.inertia + other.inertia + first * outer_square(vehicle.cg - cg) + second * outer_square(other.cg - cg)
    return Bodies(inertia, cg, vehicle.mass + other.mass)


def docked_motion(vehicle: Bodies, other: Bodies, combined: Bodies, rate: Array, imu_position: Array, event: Event) -> tuple[Array, Array]:
    """Rate (3, S) after docking, and the jump (3, S) of the IMU's velocity in body axes, m/s.

    Momentum and angular momentum of both bodies are those of the combined one:
    ``I₁₂ ω' = I₁ ω + I₂ ω₂ + (m₁ m₂ / m₁₂) (c₂ − c₁) × v₂₁``.
    """
    if event.motion == "rates_kept":
        return rate, np.zeros_like(rate)
    relative = np.array(event.docked_velocity_m_s)[:, None] + np.zeros_like(rate)
    spin = np.array(event.docked_rate_rad_s)[:, None] + np.zeros_like(rate)
    reduced = vehicle.mass * other.mass / combined.mass
    momentum = apply(vehicle.inertia, rate) + apply(other.inertia, spin) + reduced * cross(other.cg - vehicle.cg, relative)
    after = np.linalg.solve(np.moveaxis(combined.inertia, -1, 0), np.moveaxis(momentum, -1, 0)[..., None])[..., 0].T
    arm = imu_position[:, None]
    jump = other.mass / combined.mass * relative + cross(after, arm - combined.cg) - cross(rate, arm - vehicle.cg)
    return after, jump


def burnt(body: Bodies, fuel: Fuel, impulse_n_s: Array, fixed_mass: float) -> Bodies:
    """The body after giving (S,) ``impulse_n_s`` in all; fuel is a point mass taken away at the tank."""
    used = impulse_n_s / (fuel.specific_impulse_s * STANDARD_GRAVITY)
    mass = body.mass - used
    if fuel.tank_position_m is None:
        return Bodies(body.inertia, body.cg, mass)
    tank = np.array(fuel.tank_position_m)[:, None]
    rotating, left = body.mass - fixed_mass, mass - fixed_mass
    cg = (rotating * body.cg - used * tank) / left
    inertia = body.inertia - left * outer_square(cg - body.cg) - used * outer_square(tank - body.cg)
    return Bodies(inertia, cg, mass)
