"""A rigid body with jets under an IMU of any kernel and clock, written apart from massprop: many at once, exact between events.

Thrust is constant between events (pulses begin or end, a reading is taken), so the motion is smooth there. It is integrated by the classic
Runge-Kutta method; what a low-pass makes of it follows in closed form from a parabola through the step. On a bearing the pivot slides on a
level plane without friction.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.80665
LONGEST_S = 0.004
JETS = 10
FIRST = 2
"""Readings before the record begins."""


@dataclass(frozen=True)
class Imu:
    """What it records."""

    rate_hz: float = 100.0
    measures: str = "sample"
    order: int = 0
    cutoff_hz: float = 40.0
    latency_s: float = 0.0
    offset_s: float = 0.0
    """Of its first reading."""
    ppm: float = 0.0
    """By which its clock is fast; the two agree at 0."""
    gyro_noise: float = 1e-3
    """rad/s of a reading, after the low-pass."""
    accel_noise: float = 0.02


@dataclass(frozen=True)
class Bodies:
    """V of them, each with its jets; O is where positions are counted from, on a bearing its centre."""

    inertia: Array
    cg: Array
    mass: Array
    jet_position: Array
    jet_force: Array
    imu_position: Array
    bearing_mass: Array
    """0: free."""
    bearing: bool = False


def bodies(rng: np.random.Generator, count: int, bearing: bool = False) -> Bodies:
    """Random ones of 2 to 200 kg."""
    mass = np.exp(rng.uniform(np.log(2.0), np.log(200.0), count))
    radius = 0.15 * mass ** (1 / 3) * rng.uniform(0.6, 1.4, count)
    gyration = rng.uniform(0.7, 1.3, (count, 3))
    principal = mass[:, None] * radius[:, None] ** 2 * (gyration[:, [1, 2, 0]] + gyration[:, [2, 0, 1]]) / 4
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    inertia = np.einsum("vij,vj,vkj->vik", axes, principal, axes)
    cg = radius[:, None] * rng.normal(0, 0.002 if bearing else 0.05, (count, 3))
    position = radius[:, None, None] * rng.uniform(-1, 1, (count, JETS, 3))
    force = rng.normal(size=(count, JETS, 3))
    force /= np.linalg.norm(force, axis=2, keepdims=True)
    force *= (0.15 * mass if not bearing else 0.05 * mass)[:, None, None]
    bearing_mass = mass * rng.uniform(0.05, 0.3, count) if bearing else np.zeros(count)
    return Bodies(inertia, cg, mass, position, force, radius[:, None] * rng.uniform(-0.5, 0.5, (count, 3)), bearing_mass, bearing)


@dataclass(frozen=True)
class Flown:
    """What was recorded of V bodies."""

    time_s: Array
    """(n,) by the IMU's clock."""
    gyro: Array
    """(V, n, 3) rates, or angles."""
    accel: Array
    command_s: Array
    """(M,) by the commands' clock."""
    on_s: Array
    """(V, M, JETS)"""
    attitude: Array = field(default_factory=lambda: np.zeros(0))
    """(V, 4) at the IMU's first record's beginning."""


def _cross(a: Array, b: Array) -> Array:
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        -1,
    )


def _turn(q: Array) -> Array:
    w, x, y, z = q.T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        -2,
    )


class _Plant:
    def __init__(self, own: Bodies) -> None:
        self.own = own
        skew = np.zeros((len(own.mass), 3, 3))
        c = own.cg
        skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -c[:, 2], c[:, 1], -c[:, 0]
        self.skew = skew - skew.transpose(0, 2, 1)
        self.inverse = np.linalg.inv(own.inertia)

    def moved(self, rate: Array, q: Array, torque: Array, force: Array) -> tuple[Array, Array]:
        """Angular acceleration; specific force at the IMU. Torque about O and force in body axes."""
        own = self.own
        inner = np.einsum("vij,vj->vi", own.inertia, rate)
        about = torque - _cross(own.cg, force) - _cross(rate, inner)
        if not own.bearing:
            turned = np.einsum("vij,vj->vi", self.inverse, about)
            centre = force / own.mass[:, None]
            arm = own.imu_position - own.cg
            return turned, centre + _cross(turned, arm) + _cross(rate, _cross(rate, arm))
        up = _turn(q)[:, 2]  # the world's vertical in body axes
        level = np.eye(3) - up[:, :, None] * up[:, None, :]
        m, total = own.mass[:, None], (own.mass + own.bearing_mass)[:, None]
        swung = _cross(rate, _cross(rate, own.cg))
        # pivot: (m + b) a = P (F − m (ω̇ × c + swung)); the pivot's force on the body f = m (a + ω̇ × c + swung + g up) − F
        kernel = m[..., None] * (np.eye(3) - (m / total)[..., None] * level)  # of ω̇ × c in f
        known = m * (np.einsum("vij,vj->vi", level, force - m * swung) / total + swung + GRAVITY * up) - force
        matrix = own.inertia - self.skew @ kernel @ self.skew
        turned = np.linalg.solve(matrix, (about - _cross(own.cg, known))[..., None])[..., 0]
        pushed = np.einsum("vij,vj->vi", level, force - m * (_cross(turned, own.cg) + swung)) / total
        arm = own.imu_position
        return turned, pushed + GRAVITY * up + _cross(turned, arm) + _cross(rate, _cross(rate, arm))


def _spun(q: Array, rate: Array) -> Array:
    w, v = q[:, :1], q[:, 1:]
    return 0.5 * np.concatenate([-(v * rate).sum(1, keepdims=True), w * rate + _cross(v, rate)], 1)


def _poles(order: int, cutoff_hz: float) -> tuple[Array, Array]:
    tau = 1 / (2 * np.pi * cutoff_hz)
    lags = np.array({0: [], 1: [tau], 2: [tau * np.exp(0.25j * np.pi), tau * np.exp(-0.25j * np.pi)]}[order], dtype=complex)
    weights = np.array([np.prod([a / (a - b) for b in lags if b != a]) for a in lags], dtype=complex)
    return lags, weights


def fly(
    rng: np.random.Generator, own: Bodies, imu: Imu, period_s: float, duration_s: float, delay_s: float, parts: int = 8, noise: float = 1.0
) -> Flown:
    """Pulses of whole ``parts`` of a control cycle, each of which some jets fire in."""
    count, cycles = len(own.mass), int(duration_s / period_s)
    tick = period_s / parts
    on = np.where(rng.random((count, cycles, JETS)) < 0.15, rng.integers(1, parts + 1, (count, cycles, JETS)), 0)
    on[:, : int(1.0 / period_s)] = 0
    command_s = period_s * np.arange(cycles)
    record_s = 1 / imu.rate_hz
    lasting_s = record_s / (1 + 1e-6 * imu.ppm)  # by the commands' clock
    labels = imu.offset_s + record_s * np.arange(1, int((duration_s - abs(imu.offset_s) - 0.1) / record_s))
    taken = labels / (1 + 1e-6 * imu.ppm) - imu.latency_s  # on the commands' clock
    edges = np.concatenate([(command_s[:, None] + tick * np.arange(parts)).ravel() + delay_s])
    times = np.unique(np.round(np.concatenate([[0.0], edges, taken[taken > 0]]), 12))
    times = times[times <= taken[-1] + 1e-12]
    lengths = np.diff(times)
    keep = np.concatenate([[True], lengths > 1e-10])
    times = times[keep]
    plant = _Plant(own)
    rate = rng.normal(0, 0.02, (count, 3))
    q = np.tile([1.0, 0, 0, 0], (count, 1))
    if own.bearing:
        tilt = rng.normal(0, 0.02, (count, 3))
        q[:, 1:] = tilt / 2
        q /= np.linalg.norm(q, axis=1, keepdims=True)
    lags, weights = _poles(imu.order, imu.cutoff_hz)
    moment = _cross(own.jet_position, own.jet_force)
    wrench = np.concatenate([moment, own.jet_force], -1)  # (V, JETS, 6)
    still = plant.moved(rate, q, np.zeros((count, 3)), np.zeros((count, 3)))[1]
    state = np.concatenate([rate, still], 1).astype(complex)
    lagged = [state.copy() for _ in lags]
    summed = np.zeros((count, 6))
    found, at = np.zeros((len(taken), count, 6)), int(np.searchsorted(taken, 0.0))
    previous, begun_q = summed.copy(), q.copy()
    for start, end in itertools.pairwise(times):
        middle = (start + end) / 2 - delay_s
        cycle = int(np.floor(middle / period_s))
        if 0 <= cycle < cycles:
            open_ = middle - cycle * period_s < on[:, cycle] * tick
            acting = np.einsum("vj,vjk->vk", open_, wrench)
        else:
            acting = np.zeros((count, 6))
        torque, force = acting[:, :3], acting[:, 3:]
        steps = max(1, int(np.ceil((end - start) / LONGEST_S)))
        h = (end - start) / steps
        for _ in range(steps):
            a1, f0 = plant.moved(rate, q, torque, force)
            k1 = _spun(q, rate)
            r2, q2 = rate + h / 2 * a1, q + h / 2 * k1
            a2, _ = plant.moved(r2, q2, torque, force)
            k2 = _spun(q2, r2)
            r3, q3 = rate + h / 2 * a2, q + h / 2 * k2
            a3, fm = plant.moved(r3, q3, torque, force)
            k3 = _spun(q3, r3)
            r4, q4 = rate + h * a3, q + h * k3
            a4, _ = plant.moved(r4, q4, torque, force)
            k4 = _spun(q4, r4)
            new = rate + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            q /= np.linalg.norm(q, axis=1, keepdims=True)
            end_a, f1 = plant.moved(new, q, torque, force)
            mid = (rate + new) / 2 + h / 8 * (a1 - end_a)
            y0, ym, y1 = np.concatenate([rate, f0], 1), np.concatenate([mid, fm], 1), np.concatenate([new, f1], 1)
            p1, p2 = (4 * ym - 3 * y0 - y1) / h, 2 * (y0 - 2 * ym + y1) / h**2
            shown_area = h / 6 * (y0 + 4 * ym + y1)
            if len(lags):
                before = sum(w * one for w, one in zip(weights, lagged, strict=True)).real
                for i, tau in enumerate(lags):
                    steady = y0 - tau * p1 + 2 * tau**2 * p2
                    new_lag = np.exp(-h / tau) * (lagged[i] - steady) + steady + (p1 - 2 * tau * p2) * h + p2 * h**2
                    shown_area = shown_area - (weights[i] * tau * (new_lag - lagged[i])).real
                    lagged[i] = new_lag
                del before
            summed = summed + shown_area
            rate = new
        shown = (
            sum((w * one for w, one in zip(weights, lagged, strict=True)), np.zeros(1)).real if len(lags) else np.concatenate([rate, f1], 1)
        )
        while at < len(taken) and taken[at] <= end + 1e-10:
            found[at] = shown if imu.measures == "sample" else (summed - previous) / lasting_s
            previous = summed
            if at == FIRST - 1:
                begun_q = q.copy()
            at += 1
    found, labels = found[FIRST:], labels[FIRST:]
    made = found + noise * rng.normal(size=found.shape) * np.repeat([imu.gyro_noise, imu.accel_noise], 3)
    made = made.transpose(1, 0, 2)
    factor = lasting_s if imu.measures == "increment" else 1.0
    return Flown(labels, made[..., :3] * factor, made[..., 3:] * factor, command_s, on * tick, begun_q)
