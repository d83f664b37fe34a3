"""Bodies that turn about a fixed pivot under their weight, written apart from massprop: by jets, by wheels, or swinging freely.

The classic Runge-Kutta method on attitude, rate and the integrals of rate and specific force, from one begin or end of a pulse to the next,
half a cycle at most: tables turn by 3 mrad in that at most, and increments are within 1e-6 of those of an eighth of it. Wheels turn
relative to the body with a constant acceleration within a cycle, so that their logged speeds are exact.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from massprop_cli.base import arrow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs import columns
from massprop_cli.inputs.actuators.wheel import WheelLog
from massprop_cli.inputs.tablefile import Cells, Places, Table
from massprop_cli.inputs.telemetry import Log, read
from massprop_cli.inputs.vehicle import Vehicle
from tests.anyimu import cross

GRAVITY, RPM = 9.80665, np.pi / 30
JETS, PARTS = 12, 8
CANDIDATES = 6
BIAS = 1e-3, 0.01
"""rad/s and m/s², one sigma."""
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5
Kind = Literal["jets", "wheels", "swing", "rotors"]
COMMANDS = {"jets": "jet_j{}_s", "wheels": "wheel_w{}_rad_s", "swing": "{}", "rotors": "rotor_r{}_command"}
"""Their columns."""


class Sensed(Protocol):
    """Bodies, of which the noise counts."""

    @property
    def noise(self) -> Array:
        """(V, 2) of a cycle's mean rate and specific force."""


@dataclass(frozen=True)
class Tables:
    """V of them; all positions from O."""

    inertia: Array
    """(V, 3, 3) about the CG, wheels locked."""
    mass: Array
    pivot: Array
    cg: Array
    imu: Array
    jet_position: Array
    """(V, JETS, 3)"""
    jet_force: Array
    spin: Array
    """(V,) inertia of each of four wheels."""
    noise: Array
    """(V, 2) of a cycle's mean rate and specific force."""

    @property
    def arm(self) -> Array:
        """(V, 3) from the pivot to the CG."""
        return self.cg - self.pivot

    @property
    def about_pivot(self) -> Array:
        """(V, 3, 3) inertia about the pivot."""
        arm = self.arm
        square = (arm**2).sum(1)[:, None, None] * np.eye(3) - arm[:, :, None] * arm[:, None, :]
        found: Array = self.inertia + self.mass[:, None, None] * square
        return found

    @property
    def nine(self) -> Array:
        """(V, 9) the true ``about_pivot``."""
        return np.concatenate([self.about_pivot[:, *np.triu_indices(3)], self.mass[:, None] * self.arm], 1)

    @property
    def ten(self) -> Array:
        """(V, 10) the true ten quantities."""
        return np.concatenate([self.inertia[:, *np.triu_indices(3)], self.cg, self.mass[:, None]], 1)


def tables(rng: np.random.Generator, count: int, offset_m: float = 3e-4) -> Tables:
    """Random ones of 5 to 50 kg, balanced to ``offset_m`` and hanging a little below the pivot."""
    mass = np.exp(rng.uniform(np.log(5.0), np.log(50.0), count))
    radius = 0.13 * mass ** (1 / 3) * rng.uniform(0.7, 1.3, count)
    square = rng.uniform(0.6, 1.4, (count, 3))
    principal = mass[:, None] * radius[:, None] ** 2 * (square[:, [1, 2, 0]] + square[:, [2, 0, 1]]) / 5
    axes = np.linalg.qr(np.eye(3) + rng.normal(0, 0.15, (count, 3, 3)))[0]
    inertia = np.einsum("vij,vj,vkj->vik", axes, principal, axes)
    pivot = radius[:, None] * rng.uniform(-0.1, 0.1, (count, 3))
    arm = rng.normal(0, offset_m, (count, 3))
    arm[:, 2] = -offset_m * rng.uniform(2, 5, count)
    position = radius[:, None, None] * rng.uniform(-1, 1, (count, JETS, 3))
    force = rng.normal(size=(count, JETS, 3))
    force *= (0.15 * principal.mean(1) / radius)[:, None, None] / np.linalg.norm(force, axis=2, keepdims=True)
    spin = 0.004 * principal.mean(1)
    noise = np.stack([10 ** rng.uniform(-4.5, -3.5, count), 10 ** rng.uniform(-2.7, -1.7, count)], 1)
    imu = pivot + radius[:, None] * rng.uniform(-0.5, 0.5, (count, 3))
    return Tables(inertia, mass, pivot, pivot + arm, imu, position, force, spin, noise)


@dataclass(frozen=True)
class Flown:
    """What was recorded of V tables, without noise."""

    period_s: float
    turned: Array
    """(V, K, 3) angle increments, rad."""
    pushed: Array
    """(V, K, 3) velocity increments, m/s."""
    issued: Array
    """(V, K, JETS) on-times, (V, K, 4) speeds, (V, K, 0), (V, K, ROTORS) commands."""
    attitude: Array
    """(V, 4) at the start."""
    kind: Kind


def _up(q: Array) -> Array:
    w, x, y, z = q.T
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z]).T


class _Motion:
    def __init__(self, own: Tables, gravity: float) -> None:
        self.gravity = gravity
        self.inertia, self.inverse = own.about_pivot, np.linalg.inv(own.about_pivot)
        self.moment, self.arm = own.mass[:, None] * own.arm, own.imu - own.pivot

    def slope(self, y: Array, torque: Array, momentum: tuple[Array, Array], at_s: float) -> Array:
        """Of (V, 13): attitude, rate, their integrals."""
        q, rate = y[:, :4], y[:, 4:7]
        h, grown = momentum[0] + at_s * momentum[1], momentum[1]
        up = _up(q) / (q**2).sum(1, keepdims=True)
        inner = np.einsum("vij,vj->vi", self.inertia, rate) + h
        turned = np.einsum("vij,vj->vi", self.inverse, torque - self.gravity * cross(self.moment, up) - grown - cross(rate, inner))
        felt = self.gravity * up + cross(turned, self.arm) + cross(rate, cross(rate, self.arm))
        w, v = q[:, :1], q[:, 1:]
        spun = 0.5 * np.concatenate([-(v * rate).sum(1, keepdims=True), w * rate + cross(v, rate)], 1)
        return np.concatenate([spun, turned, rate, felt], 1)

    def stepped(self, y: Array, torque: Array, momentum: tuple[Array, Array], h: float) -> Array:
        k1 = self.slope(y, torque, momentum, 0.0)
        k2 = self.slope(y + h / 2 * k1, torque, momentum, h / 2)
        k3 = self.slope(y + h / 2 * k2, torque, momentum, h / 2)
        k4 = self.slope(y + h * k3, torque, momentum, h)
        return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def fly(rng: np.random.Generator, own: Tables, kind: Kind, period_s: float, duration_s: float, gravity: float = GRAVITY) -> Flown:
    """From a small tilt on; what acts is drawn at random, of several draws the one that brings the table back best.

    Without ``gravity`` and with the pivot at its CG a body that wheels turn is free.
    """
    count, cycles = len(own.mass), round(duration_s / period_s)
    motion = _Motion(own, gravity)
    y: Array = np.zeros((count, 13))
    y[:, 0], y[:, 1:4] = 1.0, rng.normal(0, 0.03 if kind == "swing" else 0.005, (count, 3))
    y[:, :4] /= np.linalg.norm(y[:, :4], axis=1, keepdims=True)
    y[:, 4:7] = rng.normal(0, 0.05 if kind == "swing" else 0.01, (count, 3))
    attitude, sums = y[:, :4].copy(), np.zeros((cycles + 1, count, 6))
    jets = cross(own.jet_position - own.pivot[:, None], own.jet_force)
    issued = np.zeros((count, cycles, {"jets": JETS, "wheels": 4, "swing": 0}[kind]))
    speed: Array = rng.uniform(-50, 50, (count, 4))
    part_s, nothing = period_s / PARTS, np.zeros((count, 3))
    for k in range(cycles):
        on: Array = np.zeros((count, JETS))
        growth: Array = np.zeros((count, 4))
        if kind == "jets" and k * period_s > 0.5:
            drawn = np.where(rng.random((CANDIDATES, count, JETS)) < 0.2, rng.integers(1, PARTS + 1, (CANDIDATES, count, JETS)), 0)
            on = _best(drawn, np.einsum("cvj,vjk->cvk", drawn * part_s, jets), motion, y)
        if kind == "wheels" and k * period_s > 0.5:
            drawn = rng.uniform(-1, 1, (CANDIDATES, count, 4)) - speed / 400
            growth = 40.0 * _best(drawn, -40.0 * period_s * own.spin[:, None] * (drawn @ TETRAHEDRON), motion, y)
        of_wheels = own.spin[:, None] * (kind == "wheels")
        for begin, end in itertools.pairwise(np.unique([0, PARTS // 2, *on.ravel(), PARTS])):
            torque: Array = np.einsum("vj,vjk->vk", (begin < on).astype(float), jets) if kind == "jets" else nothing
            momentum = of_wheels * ((speed + begin * part_s * growth) @ TETRAHEDRON), of_wheels * (growth @ TETRAHEDRON)
            y = motion.stepped(y, torque, momentum, (end - begin) * part_s)
        y = np.concatenate([y[:, :4] / np.linalg.norm(y[:, :4], axis=1, keepdims=True), y[:, 4:]], 1)
        sums[k + 1] = y[:, 7:]
        speed = speed + period_s * growth
        if kind != "swing":
            issued[:, k] = on * part_s if kind == "jets" else speed
    made = np.diff(sums, axis=0).transpose(1, 0, 2)
    return Flown(period_s, made[..., :3], made[..., 3:], issued, attitude, kind)


def _best(drawn: Array, impulse: Array, motion: _Motion, y: Array) -> Array:
    """(V, n) of (C, V, n) the one whose impulse (C, V, 3) slows the turn and levels the table most."""
    wanted = y[:, 4:7] + 0.3 * cross(_up(y[:, :4]), np.array([0.0, 0.0, 1.0]))
    left = np.einsum("vij,cvj->cvi", motion.inverse, impulse) + wanted
    found: Array = drawn[np.argmin((left**2).sum(-1), 0), np.arange(len(y))]
    return found


def vehicle_of(own: Tables, body: int, flown: Flown, biases: bool = False, **known: dict[str, float]) -> Vehicle:
    """The vehicle file of one of them."""
    gyro, accel = own.noise[body].tolist()
    imu = {"position_m": own.imu[body].tolist(), "gyro_noise_rad_s": gyro, "accel_noise_m_s2": accel}
    imu |= {"gyro_bias_sigma_rad_s": BIAS[0], "accel_bias_sigma_m_s2": BIAS[1]} if biases else {}
    pivot = {"bearing_position_m": own.pivot[body].tolist(), "initial_attitude_wxyz": flown.attitude[body].tolist()}
    data = {"schema": 1, "cycle": {"period_s": flown.period_s}, "imu": imu, "known": known}
    data["environment"] = {"kind": "pedestal", "gravity_m_s2": GRAVITY, **pivot}
    if flown.kind == "jets":
        places = zip(own.jet_position[body].tolist(), own.jet_force[body].tolist(), strict=True)
        data["jets"] = [{"name": f"j{n}", "position_m": place, "force_n": force} for n, (place, force) in enumerate(places)]
    if flown.kind == "wheels":
        spin = {"spin_inertia_kg_m2": float(own.spin[body]), "locked_in_inertia": True, "column": "speed"}
        data["wheels"] = [{"name": f"w{n}", "axis": axis.tolist(), **spin} for n, axis in enumerate(TETRAHEDRON)]
    return Vehicle.model_validate(data)


def in_whole_rpm(log: Log) -> Log:
    """With the speeds of its wheels as a tachometer counts."""
    logged = (np.asarray(one.speed_rad_s) for one in log.spinning if isinstance(one, WheelLog))
    return replace(log, spinning=tuple(WheelLog(np.round(speed / RPM) * RPM, None, None) for speed in logged))


def log_of(rng: np.random.Generator, own: Sensed, body: int, flown: Flown, used: Vehicle, noise: float = 1.0, biases: bool = False) -> Log:
    """The log of one of them; ``noise`` is a factor on the IMU's, ``biases`` are drawn."""
    increments, count = [flown.turned[body], flown.pushed[body]], flown.turned.shape[1]
    for i, (sigma, bias) in enumerate(zip(own.noise[body], BIAS, strict=True)):
        constant = rng.normal(0, bias, 3) * biases
        increments[i] = increments[i] + flown.period_s * (constant + noise * sigma * rng.normal(size=(count, 3)))
    made = {columns.TIME: flown.period_s * np.arange(1, count + 1)}
    for names, values in zip((columns.DELTA_THETA, columns.DELTA_V), increments, strict=True):
        made |= dict(zip(names, values.T, strict=True))
    made |= {COMMANDS[flown.kind].format(n): values for n, values in enumerate(flown.issued[body].T)}
    path, places = Path("any-pedestal"), Places(None)
    cells = {name: Cells(path, name, partial(arrow.numbers, values), places) for name, values in made.items()}
    return read(Table(path, "", cells, count, places, None), used)
