"""Multicopters that turn by 0.02 to 0.5 rad a cycle, written apart from massprop: lagging rotors, the classic Runge-Kutta method.

Each rotor's command is lagged in closed form; rate, and the integrals of rate and specific force, are stepped eight times a cycle. The
record begins in mid-flight.
"""

from dataclasses import dataclass

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from tests.anyimu import cross
from tests.anypedestal import Flown

ROTORS, STEPS, BEFORE = 6, 8, 100
"""Of each; steps of a cycle; cycles before the record begins."""
LAG_S, HOVER, LINEAR, TILT = 0.04, 0.6, 0.3, 0.1
"""Of a rotor, s; its command in the mean; part of the thrust that goes with the command and not its square; slant of axes."""


@dataclass(frozen=True)
class Multicopters:
    """V of them; all positions from O."""

    inertia: Array
    cg: Array
    mass: Array
    imu: Array
    position: Array
    """(V, ROTORS, 3)"""
    axis: Array
    full: Array
    """(V,) thrust at full command, N."""
    ratio: Array
    """(V,) drag torque over thrust, m."""
    noise: Array
    """(V, 2) of a cycle's mean rate and specific force."""

    @property
    def ten(self) -> Array:
        """(V, 10) the true ten quantities."""
        return np.concatenate([self.inertia[:, *np.triu_indices(3)], self.cg, self.mass[:, None]], 1)

    @property
    def wrench(self) -> Array:
        """(V, ROTORS, 6) torque about O and force of a newton of thrust."""
        drag = self.ratio[:, None, None] * spins()[:, None] * self.axis
        return np.concatenate([np.cross(self.position, self.axis) - drag, self.axis], -1)


def spins() -> Array:
    """(ROTORS,) 1 or −1."""
    return np.where(np.arange(ROTORS) % 2, 1.0, -1.0)


def multicopters(rng: np.random.Generator, count: int) -> Multicopters:
    """Random ones of 0.5 to 20 kg."""
    mass = np.exp(rng.uniform(np.log(0.5), np.log(20.0), count))
    radius = 0.12 * mass ** (1 / 3) * rng.uniform(0.8, 1.2, count)
    square = rng.uniform(0.8, 1.2, (count, 3)) * np.array([1.0, 1.0, 0.5])
    principal = mass[:, None] * radius[:, None] ** 2 * (square[:, [1, 2, 0]] + square[:, [2, 0, 1]]) / 4
    axes = np.linalg.qr(np.eye(3) + rng.normal(0, 0.1, (count, 3, 3)))[0]
    angle = 2 * np.pi * np.arange(ROTORS) / ROTORS
    ring = np.stack([1.3 * np.cos(angle), 1.3 * np.sin(angle), np.full(ROTORS, 0.1)], 1)
    axis = np.concatenate([rng.normal(0, TILT, (count, ROTORS, 2)), np.ones((count, ROTORS, 1))], 2)
    return Multicopters(
        np.einsum("vij,vj,vkj->vik", axes, principal, axes),
        radius[:, None] * rng.normal(0, 0.05, (count, 3)),
        mass,
        radius[:, None] * rng.uniform(-0.4, 0.4, (count, 3)),
        radius[:, None, None] * ring,
        axis / np.linalg.norm(axis, axis=2, keepdims=True),
        2 * 9.81 * mass / ROTORS,
        0.02 * radius,
        np.stack([10 ** rng.uniform(-3.7, -2.7, count), 10 ** rng.uniform(-2.3, -1.5, count)], 1),
    )


def fly(rng: np.random.Generator, own: Multicopters, period_s: float, cycles: int, measured: bool = False, late: int = 0) -> Flown:
    """Rates of up to 10 rad/s, asked for anew every few cycles, with commands that act after one cycle; or speeds that are ``measured``.

    Commands act ``late`` of a cycle's eight steps.
    """
    count, step = len(own.mass), period_s / STEPS
    inverse, wrench, lever = np.linalg.inv(own.inertia), own.wrench, own.imu - own.cg
    mixer = np.linalg.pinv(wrench[..., :3].transpose(0, 2, 1))
    halfway, whole = np.exp(-step / 2 / LAG_S), np.exp(-step / LAG_S)
    fastest = rng.uniform(1.0, 8.0, (count, 1))

    def acted(x: Array) -> Array:
        found: Array = np.einsum("vr,vrw->vw", own.full[:, None] * (LINEAR * x + (1 - LINEAR) * x**2), wrench)
        return found

    def slope(rate: Array, by: Array) -> tuple[Array, Array]:
        torque, force = by[:, :3], by[:, 3:]
        inner = np.einsum("vij,vj->vi", own.inertia, rate)
        turned: Array = np.einsum("vij,vj->vi", inverse, torque - cross(own.cg, force) - cross(rate, inner))
        return turned, force / own.mass[:, None] + cross(turned, lever) + cross(rate, cross(rate, lever))

    rate, x, asked = np.zeros((count, 3)), np.full((count, ROTORS), HOVER), np.zeros((count, 3))
    speeds, issued, made = [], np.full((BEFORE + cycles + 1, count, ROTORS), HOVER), np.zeros((BEFORE + cycles, 2, count, 3))
    gain = own.inertia / (4 * LAG_S)
    steeper = own.full * (LINEAR + 2 * (1 - LINEAR) * HOVER)
    for k in range(BEFORE + cycles):
        if k % 7 == 0:
            asked = fastest * rng.normal(0, 0.5, (count, 3))
        thrust = np.einsum("vri,vij,vj->vr", mixer, gain, asked - rate)
        issued[k + 1] = np.clip(HOVER + thrust / steeper[:, None] + 0.06 * rng.normal(size=(count, ROTORS)) * (k % 5 == 0), 0.05, 1.0)
        for n in range(STEPS):
            acts = issued[k if n >= late else max(k - 1, 0)]
            ends = x, acts + (x - acts) * halfway, acts + (x - acts) * whole
            begun, middle, ended = (acted(one) for one in ends)
            first, felt = slope(rate, begun)
            second, _ = slope(rate + step / 2 * first, middle)
            third, _ = slope(rate + step / 2 * second, middle)
            fourth, _ = slope(rate + step * third, ended)
            after = rate + step / 6 * (first + 2 * second + 2 * third + fourth)
            last, felt_last = slope(after, ended)
            between = (rate + after) / 2 + step / 8 * (first - last)
            _, felt_between = slope(between, middle)
            made[k] += step / 6 * np.stack([rate + 4 * between + after, felt + 4 * felt_between + felt_last])
            rate, x = after, ends[2]
        speeds.append(x)
    turned, pushed = made[BEFORE:].transpose(1, 2, 0, 3)
    told = np.array(speeds[BEFORE:]) if measured else issued[BEFORE + 1 :]
    return Flown(period_s, turned, pushed, told.transpose(1, 0, 2), np.zeros((count, 4)), "speeds" if measured else "rotors")


def vehicle_of(own: Multicopters, body: int, flown: Flown) -> Vehicle:
    """The vehicle file of one of them."""
    gyro, accel = own.noise[body].tolist()
    full, ratio = float(own.full[body]), float(own.ratio[body])
    follows = {"column": "speed"} if flown.kind == "speeds" else {"lag_up_s": LAG_S}
    alike = {"thrust_n": [0.0, LINEAR * full, (1 - LINEAR) * full], "torque_ratio_m": ratio, **follows}
    places = zip(own.position[body].tolist(), own.axis[body].tolist(), spins().astype(int).tolist(), strict=True)
    data = {
        "schema": 1,
        "cycle": {"period_s": flown.period_s, "command_delay_cycles": 1.0},
        "imu": {"position_m": own.imu[body].tolist(), "gyro_noise_rad_s": gyro, "accel_noise_m_s2": accel},
        "rotors": [{"name": f"r{n}", "position_m": at, "axis": axis, "spin": spin, **alike} for n, (at, axis, spin) in enumerate(places)],
    }
    return Vehicle.model_validate(data)
