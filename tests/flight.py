"""A flight computed another way than the program does: RK4 on the equations of motion with pointwise thrust."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.align import Aligned, align
from massprop_cli.prepare.compensate import Samples, compensate

CYCLE, STEP = 0.05, 0.00625
"""Seconds. Jets open and close on multiples of STEP; at 3 rad/s a tenth of it changes the mean rate by 1.3e-8 rad/s."""
TRUTH = np.array([0.62, 0.04, -0.07, 2.8, 0.11, 2.5, -0.018, 0.027, 0.012, 22.0])
ON_BEARING = np.array([0.37, -0.01, -0.05, 2.45, 0.06, 2.15, -0.0005, 0.0002, -0.0006, 25.0])
POSITION = (0.1, -0.06, 0.12)


def jets(scale: float = 1.0, rise_s: float = 0.0) -> list[dict[str, object]]:
    """Couples about each axis and diverts along each, sizes in proportion to ``scale``."""
    found = []
    for axis, arm, lever in (
        ("x", (0, 0.1475, 0), (0, 0, 1.112)),
        ("y", (0, 0, 0.2575), (1.112, 0, 0)),
        ("z", (0.2575, 0, 0), (0, 1.112, 0)),
    ):
        signs = [(sign, end) for sign in (1, -1) for end in (1, -1)]
        found += [(f"couple_{axis}{'pn'[sign < 0]}{end % 3}", np.array(arm) * end, np.array(lever) * end * sign) for sign, end in signs]
    for axis, direction in zip("xyz", np.eye(3), strict=True):
        found += [(f"divert_{axis}{'pn'[sign < 0]}", np.zeros(3), 2.224 * sign * direction) for sign in (1, -1)]
    return [
        {"name": name, "position_m": position.tolist(), "force_n": (scale * force).tolist(), "rise_s": rise_s, "fall_s": rise_s}
        for name, position, force in found
    ]


def vehicle(kind: str = "free", delay: float = 2.0, **sections: Any) -> Vehicle:
    """A testbed vehicle; ``sections`` override tables of its file."""
    data: dict[str, object] = {
        "schema": 1,
        "cycle": {"period_s": CYCLE, "command_delay_cycles": delay},
        "imu": {"position_m": POSITION, "gyro_noise_rad_s": 1e-4, "accel_noise_m_s2": 0.02} | sections.get("imu", {}),
        "environment": {"kind": kind, "bearing_mass_kg": 5.0 if kind == "air_bearing" else 0.0} | sections.get("environment", {}),
        "jets": sections.get("jets", jets()),
    }
    data |= {key: value for key, value in sections.items() if key not in data}
    return Vehicle.model_validate(data)


def resolved(used: Vehicle) -> Resolved:
    """Whose noise is stated."""
    found = Resolved.stated(used)
    assert found is not None
    return found


def pulses(cycles: int, seed: int = 1, quiet: int = 0, last: int | None = None) -> Array:
    """(cycles, 18) on-times: a random couple or divert every few cycles, nothing in the first ``quiet`` and after ``last``."""
    rng = np.random.default_rng(seed)
    on = np.zeros((cycles, 18))
    k = quiet
    while k < (cycles if last is None else last):
        length = int(rng.integers(1, 5))
        pick = int(rng.integers(0, 9))
        columns = [2 * pick, 2 * pick + 1] if pick < 6 else [12 + 2 * (pick - 6) + int(rng.integers(0, 2))]
        on[k : k + length, columns] = rng.choice([0.0125, 0.025, 0.05])
        k += length + int(rng.integers(0, 4))
    return on


def thrust_fraction(on: Array, delay: float, rise_s: float, time: float | Array) -> Array:
    """(..., jets) thrust over full at moments (...), from each cycle's own pulse; contiguous pulses overlap their ramps to one."""
    moment = np.asarray(time)[..., None]
    now = np.floor(moment / CYCLE - delay + 1e-9).astype(int)
    value = np.zeros((*moment.shape[:-1], on.shape[1]))
    for k in (now - 1, now):
        length = np.where((k >= 0) & (k < len(on)), on[np.clip(k[..., 0], 0, len(on) - 1)], 0.0)
        since = moment - (k + delay) * CYCLE
        if rise_s == 0:
            value += (since >= -1e-12) & (since < length - 1e-12)
        else:
            up = np.clip(since / rise_s, 0, 1)
            value += np.where(length > 0, np.minimum(up, np.clip(1 - (since - length) / rise_s, 0, 1)), 0)
    return np.minimum(value, 1.0)


@dataclass(frozen=True)
class Flight:
    """Noise-free cycle increments and the commands behind them."""

    used: Vehicle
    on: Array
    delta_theta: Array
    delta_v: Array

    @property
    def resolved(self) -> Resolved:
        return resolved(self.used)

    def log(self, rng: np.random.Generator | None = None, gyro: float = 1e-4, accel: float = 0.02) -> Log:
        theta, velocity = self.delta_theta.copy(), self.delta_v.copy()
        if rng is not None:
            theta += gyro * CYCLE * rng.standard_normal(theta.shape)
            velocity += accel * CYCLE * rng.standard_normal(velocity.shape)
        time = CYCLE * np.arange(1, len(theta) + 1)
        return Log(Path("flight.parquet"), "", len(time), 1, time, np.full(len(time), CYCLE), theta, velocity, "jets", self.on, None, ())

    def aligned(self, rng: np.random.Generator | None = None) -> Aligned:
        return align(self.log(rng), self.used, float(self.used.cycle.command_delay_cycles), self.used.thrust.stated_lag_s)

    def samples(self, rng: np.random.Generator | None = None) -> Samples:
        return compensate(self.aligned(rng), self.used)


def fly(
    used: Vehicle, on: Array, truth: Array, rate: Array | None = None, torque: Callable[[float], Array] | None = None, step_s: float = STEP
) -> Flight:
    """Integrate the motion; on a bearing the reaction is solved for, not eliminated as the program does it.

    Unknowns on the bearing: ω̇ (3), the bearing point's acceleration (3, vertical zero), the reaction at the bearing (3).
    """
    inertia = np.array([[truth[0], truth[1], truth[2]], [truth[1], truth[3], truth[4]], [truth[2], truth[4], truth[5]]])
    cg, mass = truth[6:9], truth[9]
    wrench, position = used.jet_wrench, np.array(used.imu.position_m)
    bearing, bearing_mass = np.array(used.environment.bearing_position_m), used.environment.bearing_mass_kg
    rotating, gravity = mass - bearing_mass, np.array([0, 0, -used.environment.gravity_m_s2])
    rise = used.jets[0].rise_s
    delay = float(used.cycle.command_delay_cycles)

    def skew(v: Array) -> Array:
        x, y, z = v.tolist()
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

    # on the bearing, what does not change of its nine equations: rotation about the CG, I ω̇ + s × N = …; translation of the rotating mass,
    # m (a_b + ω̇ × s) − N = …; the base moves level, one equation, and its own horizontal momentum balance is −N = m_b a_b, two
    inverse, offset, s = np.linalg.inv(inertia), skew(cg), cg - bearing
    arm = position - (bearing if used.on_air_bearing else cg)
    fixed = np.zeros((9, 9))
    fixed[:3, :3], fixed[:3, 6:] = inertia, skew(s)
    fixed[3:6, :3], fixed[3:6, 3:6], fixed[3:6, 6:] = -rotating * skew(s), rotating * np.eye(3), -np.eye(3)

    def derivative(w: Array, world: Array, pushed: Array) -> tuple[Array, Array, Array]:
        """ω̇, the growth of the attitude, and the specific force at the IMU."""
        turning, force = skew(w), pushed[3:]
        moment = pushed[:3] - offset @ force - turning @ (inertia @ w)  # τ − c × F − ω × I ω
        if not used.on_air_bearing:
            w_dot = inverse @ moment
            return w_dot, world @ turning, force / mass + skew(w_dot) @ arm + turning @ (turning @ arm)
        a, down = fixed.copy(), world.T @ gravity
        a[6, 3:6] = world[2]
        a[7:9, 3:6], a[7:9, 6:] = bearing_mass * world[:2], world[:2]
        pull = force + rotating * (down - turning @ (turning @ s))  # F + m (g − ω × (ω × s))
        x = np.linalg.solve(a, np.concatenate([moment, pull, np.zeros(3)]))
        return x[:3], world @ turning, x[3:6] - down + skew(x[:3]) @ arm + turning @ (turning @ arm)

    w = np.zeros(3) if rate is None else rate.astype(float)
    world = np.eye(3)
    per_cycle = round(CYCLE / step_s)
    theta, velocity = np.zeros((len(on), 3)), np.zeros((len(on), 3))
    begins = step_s * np.arange(len(on) * per_cycle)
    wrenches = thrust_fraction(on, delay, rise, begins[:, None] + np.array([0.0, step_s / 2, step_s - 1e-9]) + 1e-10) @ wrench
    for step, (t, pushed) in enumerate(zip(begins, wrenches, strict=True)):
        if torque is not None:
            pushed[:, :3] += torque(t)
        k1 = derivative(w, world, pushed[0])
        k2 = derivative(w + step_s / 2 * k1[0], world + step_s / 2 * k1[1], pushed[1])
        k3 = derivative(w + step_s / 2 * k2[0], world + step_s / 2 * k2[1], pushed[1])
        k4 = derivative(w + step_s * k3[0], world + step_s * k3[1], pushed[2])
        cycle = step // per_cycle
        theta[cycle] += step_s * (w + step_s / 6 * (k1[0] + k2[0] + k3[0]))
        velocity[cycle] += step_s / 6 * (k1[2] + 2 * k2[2] + 2 * k3[2] + k4[2])
        w = w + step_s / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        world = world + step_s / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
    return Flight(used, on, theta, velocity)


@cache
def standard(kind: str = "free", cycles: int = 320) -> Flight:
    """The one flight that tests share: random pulses over ``cycles``, truth :data:`TRUTH` or :data:`ON_BEARING`."""
    return fly(vehicle(kind), pulses(cycles), TRUTH if kind == "free" else ON_BEARING)
