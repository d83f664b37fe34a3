"""A rigid body with jets under an IMU of any kernel and clock, written apart from massprop: many at once, exact between events.

Thrust is constant between events (pulses begin or end, a reading is taken), so the motion is smooth there. It is integrated by the classic
Runge-Kutta method; what a low-pass makes of it follows in closed form from a parabola through the step. On a bearing the pivot slides on a
level plane without friction.
"""

import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, ComplexArray
from massprop_cli.inputs import columns
from massprop_cli.inputs.equipment import Imu as Imu_
from massprop_cli.inputs.tablefile import at_hand
from massprop_cli.inputs.telemetry import Log, read
from massprop_cli.inputs.vehicle import Vehicle

GRAVITY = 9.80665
LONGEST_S = 0.0105
JETS, WHEELS = 10, 3
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
    planar: bool = False
    """Whether they turn about Z alone as they are released."""
    axis: Array = field(default_factory=lambda: np.zeros((1, 0, 3)))
    """(V, W, 3) of wheels, ..."""
    spin_inertia: Array = field(default_factory=lambda: np.zeros((1, 0)))
    """... (V, W) their inertia about it, which the body's own is without, ..."""
    spin_begun: Array = field(default_factory=lambda: np.zeros((1, 0)))
    """... and speed at first, relative to the body."""


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


def wheeled(rng: np.random.Generator, own: Bodies, jets: bool) -> Bodies:
    """Bodies with three wheels each, askew; without jets, unless they have both."""
    axes = np.linalg.qr(rng.normal(size=(len(own.mass), 3, 3)))[0] + rng.normal(0, 0.1, (len(own.mass), 3, 3))
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    size = 2e-3 * np.linalg.det(own.inertia) ** (1 / 3)
    inertia, begun = size[:, None] * rng.uniform(0.7, 1.4, (len(own.mass), WHEELS)), rng.uniform(-100, 100, (len(own.mass), WHEELS))
    count = JETS if jets else 0
    pushing = own.jet_position[:, :count], own.jet_force[:, :count]
    return replace(own, axis=axes, spin_inertia=inertia, spin_begun=begun, jet_position=pushing[0], jet_force=pushing[1])


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
    torque: Array = field(default_factory=lambda: np.zeros((1, 0, 0)))
    """(V, M, W) on wheels, commanded."""
    speed: Array = field(default_factory=lambda: np.zeros((1, 0, 0)))
    """(V, n, W) of wheels relative to the body, at each record's time."""


def cross(a: Array, b: Array) -> Array:
    """A × b of stacks of vectors; numpy's own takes five times as long for the few vectors of a step."""
    products = a.take(_FIRST, -1) * b.take(_SECOND, -1)
    found: Array = products[..., :3] - products[..., 3:]
    return found


_EYE = np.eye(3)
_FIRST, _SECOND = np.array([1, 2, 0, 2, 0, 1]), np.array([2, 0, 1, 1, 2, 0])


def up(q: Array) -> Array:
    """(V, 3) the world's vertical in body axes, of unit quaternions."""
    w, x, y, z = q.T
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]).T


class _Plant:
    def __init__(self, own: Bodies) -> None:
        self.own = own
        skew = np.zeros((len(own.mass), 3, 3))
        c = own.cg
        skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -c[:, 2], c[:, 1], -c[:, 0]
        self.skew = skew - skew.transpose(0, 2, 1)
        self.inverse = np.linalg.inv(own.inertia)

    def moved(self, rate: Array, q: Array, acting: Array, since_s: float = 0.0) -> tuple[Array, Array]:
        """Angular acceleration; specific force at the IMU.

        ``acting`` (V, 12): torque about O and force, body axes, momentum of wheels and the torque on them; ``since_s`` they are so.
        """
        own, (torque, force, stored, driven) = self.own, np.split(acting, 4, 1)
        inner = np.einsum("vij,vj->vi", own.inertia, rate) + stored + since_s * driven
        torque = torque - driven
        about = torque - cross(own.cg, force) - cross(rate, inner)
        if not own.bearing:
            turned: Array = np.einsum("vij,vj->vi", self.inverse, about)
            centre = force / own.mass[:, None]
            lever = own.imu_position - own.cg
            return turned, centre + cross(turned, lever) + cross(rate, cross(rate, lever))
        vertical = up(q)
        level = _EYE - vertical[:, :, None] * vertical[:, None, :]
        m, total = own.mass[:, None], (own.mass + own.bearing_mass)[:, None]
        swung = cross(rate, cross(rate, own.cg))
        # pivot: (m + b) a = P (F − m (ω̇ × c + swung)); the pivot's force on the body f = m (a + ω̇ × c + swung + g up) − F
        kernel = m[..., None] * (_EYE - (m / total)[..., None] * level)  # of ω̇ × c in f
        known = m * (np.einsum("vij,vj->vi", level, force - m * swung) / total + swung + GRAVITY * vertical) - force
        matrix = own.inertia - self.skew @ kernel @ self.skew
        turned = np.linalg.solve(matrix, (about - cross(own.cg, known))[..., None])[..., 0]
        pushed: Array = np.einsum("vij,vj->vi", level, force - m * (cross(turned, own.cg) + swung)) / total
        arm = own.imu_position
        return turned, pushed + GRAVITY * vertical + cross(turned, arm) + cross(rate, cross(rate, arm))


def _spun(q: Array, rate: Array) -> Array:
    w, v = q[:, :1], q[:, 1:]
    return 0.5 * np.concatenate([-(v * rate).sum(1, keepdims=True), w * rate + cross(v, rate)], 1)


def _poles(order: int, cutoff_hz: float) -> tuple[ComplexArray, ComplexArray]:
    tau = 1 / (2 * np.pi * cutoff_hz)
    lags = np.array({0: [], 1: [tau], 2: [tau * np.exp(0.25j * np.pi), tau * np.exp(-0.25j * np.pi)]}[order], dtype=complex)
    weights = np.array([np.prod([a / (a - b) for b in lags if b != a]) for a in lags], dtype=complex)
    return lags, weights


class _Lowpass:
    """Lags in parallel on what grows as a parabola in each step."""

    def __init__(self, imu: Imu, begun: Array) -> None:
        self.lags, self.weights = _poles(imu.order, imu.cutoff_hz)
        self.states = [begun.astype(complex) for _ in self.lags]

    def step(self, at: tuple[Array, Array, Array], h: float) -> Array:
        """Over a step from values at its begin, middle and end; the integral of what comes out."""
        y0, ym, y1 = at
        slope, bend = (4 * ym - 3 * y0 - y1) / h, 2 * (y0 - 2 * ym + y1) / h**2
        area = h / 6 * (y0 + 4 * ym + y1)
        for i, (tau, weight) in enumerate(zip(self.lags, self.weights, strict=True)):
            steady = y0 - tau * slope + 2 * tau**2 * bend
            after = np.exp(-h / tau) * (self.states[i] - steady) + steady + (slope - 2 * tau * bend) * h + bend * h**2
            area = area - (weight * tau * (after - self.states[i])).real
            self.states[i] = after
        return area

    def out(self, otherwise: Array) -> Array:
        """What comes out now."""
        if not self.states:
            return otherwise
        found: Array = np.sum([w * one for w, one in zip(self.weights, self.states, strict=True)], 0).real
        return found


def _stepped(plant: _Plant, rate: Array, q: Array, acting: Array, h: float) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Rate and attitude a step on, and rate beside specific force at its begin, middle and end."""
    a1, f0 = plant.moved(rate, q, acting)
    k1 = _spun(q, rate)
    a2, _ = plant.moved(rate + h / 2 * a1, q + h / 2 * k1, acting, h / 2)
    k2 = _spun(q + h / 2 * k1, rate + h / 2 * a1)
    r3, q3 = rate + h / 2 * a2, q + h / 2 * k2
    a3, fm = plant.moved(r3, q3, acting, h / 2)
    k3 = _spun(q3, r3)
    a4, _ = plant.moved(rate + h * a3, q + h * k3, acting, h)
    k4 = _spun(q + h * k3, rate + h * a3)
    new = rate + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    ended, f1 = plant.moved(new, q, acting, h)
    mid = (rate + new) / 2 + h / 8 * (a1 - ended)
    return new, q, (np.concatenate([rate, f0], 1), np.concatenate([mid, fm], 1), np.concatenate([new, f1], 1))


def _begun(rng: np.random.Generator, own: Bodies) -> tuple[Array, Array]:
    count = len(own.mass)
    q: Array = np.tile([1.0, 0, 0, 0], (count, 1))
    if own.bearing:
        q[:, 1:] = rng.normal(0, 0.01, (count, 3))
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
    return rng.normal(0, 0.02, (count, 3)) * ([0, 0, 1] if own.planar else 1), q


def fly(
    rng: np.random.Generator,
    own: Bodies,
    imu: Imu,
    period_s: float,
    duration_s: float,
    delay_s: float,
    parts: int = 8,
    noise: float = 1.0,
    held: bool = False,
) -> Flown:
    """Pulses of whole ``parts`` of a control cycle, each of which some jets fire in; ``noise`` is a factor on the IMU's.

    Drives give the wheels torques; or, ``held``, as much growth of their speed relative to the body, whatever that does.
    """
    if held:  # locked to the body but for that growth
        own = replace(own, inertia=own.inertia + np.einsum("vw,vwi,vwj->vij", own.spin_inertia, own.axis, own.axis))
    count, cycles, tick, jets = len(own.mass), int(duration_s / period_s), period_s / parts, own.jet_force.shape[1]
    on = np.where(rng.random((count, cycles, jets)) < 0.15, rng.integers(1, parts + 1, (count, cycles, jets)), 0)
    on[:, : int(1.0 / period_s)] = 0
    told = np.zeros((count, cycles, own.axis.shape[1]))
    if told.size:  # as much as turns the body by 0.1 rad/s in a second, or wheels on
        told += np.where(rng.random(told.shape) < 0.4, rng.uniform(-1, 1, told.shape), 0.0)
        told *= 0.1 * np.linalg.det(own.inertia)[:, None, None] ** (1 / 3) / max(1.0, (0.5 / period_s) ** 0.5)
        told[:, : int(1.0 / period_s)] = 0
    command_s, record_s = period_s * np.arange(cycles), 1 / imu.rate_hz
    lasting_s = record_s / (1 + 1e-6 * imu.ppm)  # by the commands' clock
    labels = imu.offset_s + record_s * np.arange(1, int((duration_s - abs(imu.offset_s) - 0.1) / record_s))
    taken = labels / (1 + 1e-6 * imu.ppm) - imu.latency_s
    changes = np.array([(on == part).any((0, 2)) | (part == 0) for part in range(parts)]).T
    edges = (command_s[:, None] + tick * np.arange(parts))[changes] + delay_s
    times = np.unique(np.round(np.concatenate([[0.0], edges, taken[taken > 0]]), 12))
    times = times[(times <= taken[-1] + 1e-12) & np.append(True, np.diff(times) > 1e-10)]
    plant, wrench = _Plant(own), np.concatenate([cross(own.jet_position, own.jet_force), own.jet_force], -1)
    rate, q = _begun(rng, own)
    turned = np.einsum("vwk,vk->vw", own.axis, rate) * (not held)
    along = own.spin_inertia * (own.spin_begun + turned)
    nothing = np.zeros((count, 6))
    acting = np.concatenate([nothing, np.einsum("vw,vwk->vk", along, own.axis), np.zeros((count, 3))], 1)
    low_pass = _Lowpass(imu, np.concatenate([rate, plant.moved(rate, q, acting)[1]], 1))
    speed = np.zeros((len(taken), *along.shape))
    found, at, summed, previous, first_q = np.zeros((len(taken), count, 6)), int(np.searchsorted(taken, 0.0)), nothing, nothing, q
    for start, end in itertools.pairwise(times):
        middle = (start + end) / 2 - delay_s
        cycle = int(np.floor(middle / period_s))
        within = 0 <= cycle < cycles
        open_ = middle - cycle * period_s < on[:, cycle] * tick if within else np.zeros((count, jets), dtype=bool)
        steps, driven = max(1, int(np.ceil((end - start) / LONGEST_S))), told[:, cycle] if within else 0 * along
        pushed, h = np.einsum("vj,vjk->vk", open_, wrench), (end - start) / steps
        for _ in range(steps):
            acting = np.concatenate([pushed, *(np.einsum("vw,vwk->vk", one, own.axis) for one in (along, driven))], 1)
            rate, q, seen = _stepped(plant, rate, q, acting, h)
            along = along + h * driven
            summed = summed + low_pass.step(seen, h)
        while at < len(taken) and taken[at] <= end + 1e-10:
            speed[at] = along / own.spin_inertia - np.einsum("vwk,vk->vw", own.axis, rate) * (not held)
            found[at] = low_pass.out(seen[2]) if imu.measures == "sample" else (summed - previous) / lasting_s
            previous, first_q = summed, q if at == FIRST - 1 else first_q
            at += 1
    found = found + noise * rng.normal(size=found.shape) * np.repeat([imu.gyro_noise, imu.accel_noise], 3)
    made = found[FIRST:].transpose(1, 0, 2) * (lasting_s if imu.measures == "increment" else 1.0)
    return Flown(labels[FIRST:], made[..., :3], made[..., 3:], command_s, on * tick, first_q, told, speed[FIRST:].transpose(1, 0, 2))


def vehicle_of(
    own: Bodies,
    body: int,
    flown: Flown,
    imu: Imu,
    period_s: float,
    delay_s: float,
    auto: bool = False,
    stated: bool = False,
    wheels: str = "torque",
) -> Vehicle:
    """The vehicle file of one of them; ``auto``: cutoffs are to be found; ``stated``: noise is; ``wheels`` by that column."""
    records = max(round(period_s * imu.rate_hz), 1)
    noise = {"gyro_noise_rad_s": imu.gyro_noise / records**0.5, "accel_noise_m_s2": imu.accel_noise / records**0.5} if stated else {}
    low_pass = {"order": imu.order, "cutoff_hz": "auto" if auto else imu.cutoff_hz, "latency_s": imu.latency_s}
    filters = {f"{sensor}_filter": low_pass for sensor in ("gyro", "accel") if imu.order}
    if own.bearing:
        mass, attitude = float(own.bearing_mass[body]), flown.attitude[body].tolist()
        environment = {"kind": "air_bearing", "bearing_mass_kg": mass, "initial_attitude_wxyz": attitude, "gravity_m_s2": GRAVITY}
    else:
        environment = {"kind": "free"}
    places = zip(own.jet_position[body].tolist(), own.jet_force[body].tolist(), strict=True)
    first_s = flown.command_s[_logged(flown, imu)][0] + delay_s
    begun = [float(np.interp(first_s, flown.time_s, speed)) for speed in flown.speed[body].T] if own.axis.size else []
    spun = [
        {"name": f"w{n}", "column": wheels, "axis": axis, "spin_inertia_kg_m2": inertia, "locked_in_inertia": False}
        | ({"start_rad_s": begun[n]} if wheels == "torque" else {})
        for n, (axis, inertia) in enumerate(zip(own.axis[body].tolist(), own.spin_inertia[body].tolist(), strict=True) if begun else ())
    ]
    data = {
        "schema": 1,
        "wheels": spun,
        "cycle": {"period_s": period_s, "command_delay_cycles": delay_s / period_s},
        "imu": {"position_m": own.imu_position[body].tolist(), "measures": imu.measures, "clock_drift_ppm": imu.ppm, **noise, **filters},
        "environment": environment,
        "jets": [{"name": f"j{n}", "position_m": place, "force_n": force} for n, (place, force) in enumerate(places)],
    }
    return Vehicle.model_validate(data)


def unstated(used: Vehicle) -> Vehicle:
    """The vehicle file of somebody who doesn't know what the IMU records."""
    left = used.imu.model_dump(exclude_unset=True, exclude={"measures", "gyro_filter", "accel_filter"})
    return used.model_copy(update={"imu": Imu_.model_validate(left)})


def _logged(flown: Flown, imu: Imu) -> BoolArray:
    """(M,) commands within the record."""
    found: BoolArray = (flown.command_s > flown.time_s[0] - 0.5 / imu.rate_hz) & (flown.command_s <= flown.time_s[-1])
    return found


def log_of(flown: Flown, body: int, imu: Imu, used: Vehicle) -> Log:
    """The log of one of them, as it is read from a table."""
    rates, increments = (columns.GYRO, columns.ACCEL), (columns.DELTA_THETA, columns.DELTA_V)
    made = {columns.TIME: flown.time_s}
    for names, values in zip(increments if imu.measures == "increment" else rates, (flown.gyro, flown.accel), strict=True):
        made |= dict(zip(names, values[body].T, strict=True))
    own = _logged(flown, imu)
    rows = np.searchsorted(flown.time_s, flown.command_s[own])
    issued = {columns.COMMAND_TIME: flown.command_s[own]} | {columns.jet(f"j{n}"): on for n, on in enumerate(flown.on_s[body, own].T)}
    for n, wheel in enumerate(used.wheels):
        if wheel.column == "torque":
            issued[f"wheel_{wheel.name}_n_m"] = flown.torque[body, own, n]
        else:
            made[f"wheel_{wheel.name}_rad_s"] = flown.speed[body, :, n]
    for name, values in issued.items():
        made[name] = np.full(len(flown.time_s), np.nan)
        made[name][rows] = values
    return read(at_hand(Path("any-imu"), made), used)


def truth_of(own: Bodies, body: int) -> Array:
    """(10,) the ten quantities."""
    inertia = own.inertia[body][np.triu_indices(3)]
    return np.concatenate([inertia, own.cg[body], [own.mass[body] + own.bearing_mass[body]]])
