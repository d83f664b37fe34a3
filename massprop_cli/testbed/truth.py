"""Changes of the true mass properties by docking and by burning fuel."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.testbed.conditions import Body, Fuel
from massprop_cli.testbed.motion import Bodies, apply, cross, outer_square
from massprop_cli.testbed.timeline import Event

STANDARD_GRAVITY = 9.80665


def bodies(truth: Body, members: int) -> Bodies:
    """One copy of the true body for each of the S members."""
    values = truth.values
    return Bodies(
        np.repeat(truth.inertia[..., None], members, -1), np.repeat(values[6:9, None], members, -1), np.full(members, float(values[9]))
    )


def values(body: Bodies) -> Array:
    """(S, 10) mass properties in the order of :data:`massprop_cli.QUANTITIES`."""
    rows, columns = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
    return np.concatenate([body.inertia[rows, columns], body.cg, body.mass[None]]).T


def joined(vehicle: Bodies, other: Bodies, fixed_mass: float) -> Bodies:
    """Combined body of vehicle and docked object; ``fixed_mass`` (the bearing's, kg) does not count in CG and inertia."""
    first, second = vehicle.mass - fixed_mass, other.mass
    cg = (first * vehicle.cg + second * other.cg) / (first + second)
    inertia = vehicle.inertia + other.inertia + first * outer_square(vehicle.cg - cg) + second * outer_square(other.cg - cg)
    return Bodies(inertia, cg, vehicle.mass + other.mass)


def docked_motion(vehicle: Bodies, other: Bodies, combined: Bodies, rate: Array, imu_position: Array, event: Event) -> tuple[Array, Array]:
    """Rate (3, S) after docking, rad/s, and velocity jump (3, S) of the IMU, body axes, m/s.

    Docking conserves momentum and angular momentum: ``I₁₂ ω' = I₁ ω + I₂ ω₂ + (m₁ m₂ / m₁₂) (c₂ − c₁) × v₂₁``. With "rates_kept", rate and
    velocity stay.
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
    """Body after a total impulse (S,) of ``impulse_n_s``; burnt fuel is a point mass removed at the tank."""
    used = impulse_n_s / (fuel.specific_impulse_s * STANDARD_GRAVITY)
    mass = body.mass - used
    if fuel.tank_position_m is None:
        return Bodies(body.inertia, body.cg, mass)
    tank = np.array(fuel.tank_position_m)[:, None]
    rotating, remaining = body.mass - fixed_mass, mass - fixed_mass
    cg = (rotating * body.cg - used * tank) / remaining
    inertia = body.inertia - remaining * outer_square(cg - body.cg) - used * outer_square(tank - body.cg)
    return Bodies(inertia, cg, mass)
