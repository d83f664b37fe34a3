"""Bodies that turn about a fixed pivot under their weight, written apart from massprop: by jets, wheels, gimbal gyros, or swinging freely.

The classic Runge-Kutta method on attitude, rate and the integrals of rate and specific force, from one begin or end of a pulse to the next,
half a cycle at most: tables turn by 3 mrad in that at most, and increments are within 1e-6 of those of an eighth of it. Wheels turn
relative to the body with a constant acceleration within a cycle, and gimbals at a constant rate, so that what is logged of them is exact.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs import columns
from massprop_cli.inputs.actuators.wheel import WheelLog
from massprop_cli.inputs.tablefile import at_hand
from massprop_cli.inputs.telemetry import Log, read
from massprop_cli.inputs.vehicle import Vehicle
from tests.anyimu import cross

GRAVITY, RPM = 9.80665, np.pi / 30
JETS, PARTS = 12, 8
CANDIDATES = 6
BIAS = 1e-3, 0.01
"""rad/s and m/s², one sigma."""
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5
SPUN, GIMBALLED = 200.0, 0.3
"""rad/s: speed of a gimbal gyro's rotor, and fastest rate of its gimbal."""
ACROSS = np.array([[1, -1, 0], [1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / 2**0.5
"""(4, 3) spin axes of gyros whose gimbals turn about ``TETRAHEDRON``."""
Kind = Literal["jets", "wheels", "swing", "rotors", "gyros", "speeds"]
WHEELS: Kind = "wheels"
GYROS: Kind = "gyros"
COMMANDS = {
    "jets": "jet_j{}_s",
    "wheels": "wheel_w{}_rad_s",
    "swing": "{}",
    "rotors": "rotor_r{}_command",
    "speeds": "rotor_r{}_rad_s",
    "gyros": "cmg_g{}_gimbal_rad",
}
"""Their columns."""
Momentum = Callable[[float], tuple[Array, Array]]
"""At a time within a step, (V, 3) N m s, and how it grows."""


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
    """(V, K, JETS) on-times, (V, K, 4) speeds or gimbal angles, (V, K, 0), (V, K, ROTORS) commands."""
    attitude: Array
    """(V, 4) at the start."""
    kind: Kind


def _up(q: Array) -> Array:
    w, x, y, z = q.T
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z]).T


def _to_body(q: Array, world: Array) -> Array:
    """(V, 3) by attitudes that are not of unit length."""
    w, v = q[:, :1], q[:, 1:]
    twice = 2 * cross(v, world)
    found: Array = world + (cross(v, twice) - w * twice) / (q**2).sum(1, keepdims=True)
    return found


class _Motion:
    def __init__(self, own: Tables, gravity: float, room: Array) -> None:
        self.gravity, self.room = gravity, room
        self.inertia, self.inverse = own.about_pivot, np.linalg.inv(own.about_pivot)
        self.moment, self.arm = own.mass[:, None] * own.arm, own.imu - own.pivot

    def slope(self, y: Array, torque: Array, momentum: Momentum, at_s: float) -> Array:
        """Of (V, 13): attitude, rate, their integrals."""
        q, rate = y[:, :4], y[:, 4:7]
        h, grown = momentum(at_s)
        up = _up(q) / (q**2).sum(1, keepdims=True)
        torque = torque + _to_body(q, self.room) if self.room.any() else torque
        inner = np.einsum("vij,vj->vi", self.inertia, rate) + h
        turned = np.einsum("vij,vj->vi", self.inverse, torque - self.gravity * cross(self.moment, up) - grown - cross(rate, inner))
        felt = self.gravity * up + cross(turned, self.arm) + cross(rate, cross(rate, self.arm))
        w, v = q[:, :1], q[:, 1:]
        spun = 0.5 * np.concatenate([-(v * rate).sum(1, keepdims=True), w * rate + cross(v, rate)], 1)
        return np.concatenate([spun, turned, rate, felt], 1)

    def stepped(self, y: Array, torque: Array, momentum: Momentum, h: float) -> Array:
        k1 = self.slope(y, torque, momentum, 0.0)
        k2 = self.slope(y + h / 2 * k1, torque, momentum, h / 2)
        k3 = self.slope(y + h / 2 * k2, torque, momentum, h / 2)
        k4 = self.slope(y + h * k3, torque, momentum, h)
        return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def fly(
    rng: np.random.Generator,
    own: Tables,
    kind: Kind,
    period_s: float,
    duration_s: float,
    gravity: float = GRAVITY,
    acting: Array | None = None,
    room: Array | None = None,
    tilt_rad: float = 0.06,
) -> Flown:
    """From a small tilt on, a swing from one of sigma ``tilt_rad`` about each axis.

    What acts is drawn at random, of several draws the one that brings the table back best.

    With a steady torque (V, 3) along the ``room``'s axes beside it.
    Without ``gravity`` and with the pivot at its CG a body that wheels turn is free. Of each of four wheels or gyros a part ``acting`` of
    its momentum is there, all of it by default.
    """
    count, cycles = len(own.mass), round(duration_s / period_s)
    motion = _Motion(own, gravity, np.zeros((count, 3)) if room is None else room)
    y: Array = np.zeros((count, 13))
    y[:, 0], y[:, 1:4] = 1.0, rng.normal(0, tilt_rad / 2 if kind == "swing" else 0.005, (count, 3))
    y[:, :4] /= np.linalg.norm(y[:, :4], axis=1, keepdims=True)
    y[:, 4:7] = rng.normal(0, 0.05 if kind == "swing" else 0.01, (count, 3))
    attitude, sums = y[:, :4].copy(), np.zeros((cycles + 1, count, 6))
    jets = cross(own.jet_position - own.pivot[:, None], own.jet_force)
    issued = np.zeros((count, cycles, {"jets": JETS, "wheels": 4, "gyros": 4, "swing": 0}[kind]))
    at: Array = rng.uniform(-50, 50, (count, 4)) if kind == "wheels" else rng.uniform(-0.5, 0.5, (count, 4))
    held = own.spin[:, None] * (np.ones(4) if acting is None else acting)
    part_s, nothing = period_s / PARTS, np.zeros((count, 3))
    for k in range(cycles):
        on: Array = np.zeros((count, JETS))
        growth: Array = np.zeros((count, 4))
        if kind == "jets" and k * period_s > 0.5:
            drawn = np.where(rng.random((CANDIDATES, count, JETS)) < 0.2, rng.integers(1, PARTS + 1, (CANDIDATES, count, JETS)), 0)
            on = _best(drawn, np.einsum("cvj,vjk->cvk", drawn * part_s, jets), motion, y)
        if kind in ("wheels", "gyros") and k * period_s > 0.5:
            fastest, most = (40.0, 400) if kind == "wheels" else (GIMBALLED, 2)
            drawn = rng.uniform(-1, 1, (CANDIDATES, count, 4)) - at / most
            impulse = [-fastest * period_s * np.einsum("vj,vjk->vk", own.spin[:, None] * one, _turning(at, kind)) for one in drawn]
            growth = fastest * _best(drawn, np.array(impulse), motion, y)
        for begin, end in itertools.pairwise(np.unique([0, PARTS // 2, *on.ravel(), PARTS])):
            torque: Array = np.einsum("vj,vjk->vk", (begin < on).astype(float), jets) if kind == "jets" else nothing
            y = motion.stepped(y, torque, partial(_momentum, held, at, growth, kind, begin * part_s), (end - begin) * part_s)
        y = np.concatenate([y[:, :4] / np.linalg.norm(y[:, :4], axis=1, keepdims=True), y[:, 4:]], 1)
        sums[k + 1] = y[:, 7:]
        at = at + period_s * growth
        if kind != "swing":
            issued[:, k] = on * part_s if kind == "jets" else at
    made = np.diff(sums, axis=0).transpose(1, 0, 2)
    return Flown(period_s, made[..., :3], made[..., 3:], issued, attitude, kind)


def _momentum(held: Array, at: Array, growth: Array, kind: Kind, begin_s: float, later_s: float) -> tuple[Array, Array]:
    """Of wheels whose speeds, or gyros whose gimbal angles, were ``at`` (V, 4) as the cycle began and grow evenly."""
    now = at + (begin_s + later_s) * growth
    if kind not in ("wheels", "gyros"):
        return np.zeros((len(at), 3)), np.zeros((len(at), 3))
    along: Array = (
        now[..., None] * TETRAHEDRON if kind == "wheels" else SPUN * (np.cos(now)[..., None] * ACROSS + np.sin(now)[..., None] * _third())
    )
    return np.einsum("vj,vjk->vk", held, along), np.einsum("vj,vjk->vk", held * growth, _turning(now, kind))


def _third() -> Array:
    """(4, 3) spin axes of gyros at 90 degrees."""
    return np.cross(TETRAHEDRON, ACROSS)


def _turning(at: Array, kind: Kind) -> Array:
    """(V, 4, 3) by which the momentum of a unit of spin inertia grows with each speed or gimbal angle."""
    if kind == "wheels":
        return np.broadcast_to(TETRAHEDRON, (*at.shape, 3))
    found: Array = SPUN * (np.cos(at)[..., None] * _third() - np.sin(at)[..., None] * ACROSS)
    return found


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
    if flown.kind == "gyros":
        alike = {"h_n_m_s": SPUN * float(own.spin[body]), "locked_in_inertia": True}
        axes = zip(TETRAHEDRON.tolist(), ACROSS.tolist(), strict=True)
        data["control_moment_gyros"] = [{"name": f"g{n}", "gimbal_axis": g, "spin_axis": s, **alike} for n, (g, s) in enumerate(axes)]
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
    return read(at_hand(Path("any-pedestal"), made), used)
