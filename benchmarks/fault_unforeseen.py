"""Faults that no error parameter describes, or not alone: a log in which the model's own error is what is left.

What acts on the body is added to its motion to first order, so that these are for free flight. The truth is what the clean flight had.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from fault_commands import COMMANDS, Maker
from fault_imu import columns, noise, with_columns
from fault_imu import rotation as turned_by
from fault_thrust import Random, stated_forces, unit
from fault_vehicles import Case, Subject

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation, tensor

Made = Case | None


def _rates(case: Case) -> tuple[Array, Array]:
    """(n, 3) rate and specific force of each record, IMU axes."""
    return columns(case, "gyro") / case.log.interval_s[:, None], columns(case, "accel") / case.log.interval_s[:, None]


def _measured(case: Case, rate: Array, force: Array) -> Case:
    lasting = case.log.interval_s[:, None]
    return with_columns(with_columns(case, "gyro", rate * lasting), "accel", force * lasting)


def _sensed(change: Callable[[Subject, Random, Array, Array], tuple[Array, Array]]) -> Maker:
    """A fault that changes the readings."""
    return lambda s, rng: _measured(s.clean, *change(s, rng, *_rates(s.clean)))


def _free(s: Subject) -> bool:
    return not s.vehicle.on_air_bearing and len(s.clean.bodies) == 1


def _body(s: Subject) -> tuple[Array, Array, float]:
    values = s.clean.bodies[0].values
    return tensor(values[:6]), values[6:9], float(values[9])


def _in_body(s: Subject) -> Array:
    """(n, 3) rates in body axes."""
    found: Array = _rates(s.clean)[0] @ np.array(s.vehicle.imu.body_from_imu).T
    return found


def _pushed(change: Callable[[Subject, Random], tuple[Array, Array]]) -> Maker:
    """More torque and force (n, 3), body axes, than the log knows of; to first order."""

    def made(s: Subject, rng: Random) -> Made:
        if not _free(s):
            return None
        (torque, force), (inertia, cg, mass) = change(s, rng), _body(s)
        lasting, mounting = s.clean.log.interval_s[:, None], np.array(s.vehicle.imu.body_from_imu)
        growing = torque @ np.linalg.inv(inertia).T
        faster = np.cumsum(growing * lasting, 0) - growing * lasting / 2
        arm, rate = np.array(s.vehicle.imu.position_m) - cg, _in_body(s)
        felt = np.cross(growing, arm) + np.cross(faster, np.cross(rate, arm)) + np.cross(rate, np.cross(faster, arm)) + force / mass
        was = _rates(s.clean)
        return _measured(s.clean, was[0] + faster @ mounting, was[1] + felt @ mounting)

    return made


def _ringing(values: Array, step_s: float, period_s: float, damping: float) -> Array:
    """(n, 3) the output of a resonance driven by the values, one step apart."""
    natural, steps = 2 * np.pi / period_s, max(1, int(np.ceil(40 * step_s / period_s)))
    at, moving, found = np.zeros(3), np.zeros(3), np.empty_like(values)
    for k, drive in enumerate(values):
        for _ in range(steps):
            moving = moving + (natural**2 * (drive - at) - 2 * damping * natural * moving) * step_s / steps
            at = at + moving * step_s / steps
        found[k] = at
    return found


def _step_s(s: Subject) -> float:
    return float(s.clean.log.interval_s.mean())


def _later(values: Array, by: int) -> Array:
    return np.concatenate([values[:by], values[:-by]])


def _firing(s: Subject) -> Array:
    """(n, 1) whether any command is active."""
    return np.repeat((s.clean.log.command != 0).any(1)[:, None], s.clean.log.records_per_cycle, axis=0)


def _loud(s: Subject, rng: Random, rate: Array, force: Array, gyro: float, accel: float) -> tuple[Array, Array]:
    """Noise ``gyro`` and ``accel`` times as large while any command is active."""
    on = _firing(s) * np.sqrt(s.clean.log.records_per_cycle)
    more = on * gyro * noise(s, "gyro") * rng.standard_normal(rate.shape)
    return rate + more, force + on * accel * noise(s, "accel") * rng.standard_normal(force.shape)


def _leaking(s: Subject, rng: Random) -> tuple[Array, Array]:
    jet = s.vehicle.jets[int(rng.integers(len(s.vehicle.jets)))]
    force = 0.02 * np.array(jet.force_n)
    count = len(s.clean.log.time_s)
    return np.tile(np.cross(np.array(jet.position_m) - _body(s)[1], force), (count, 1)), np.tile(force, (count, 1))


def _tied(s: Subject, _: Random) -> tuple[Array, Array]:
    """An umbilical: a spring with a period of twice the log's duration."""
    rate, lasts = _in_body(s), 2 * len(s.clean.log.command) * s.period_s
    angle = np.cumsum(rate * s.clean.log.interval_s[:, None], 0)
    return -angle @ _body(s)[0].T * (2 * np.pi / lasts) ** 2, np.zeros_like(rate)


def _dragged(s: Subject, _: Random) -> tuple[Array, Array]:
    rate, lasts = _in_body(s), 2 * len(s.clean.log.command) * s.period_s
    return -(np.abs(rate) * rate / np.abs(rate).max()) @ _body(s)[0].T / lasts, np.zeros_like(rate)


def _rubbing(s: Subject, _: Random) -> tuple[Array, Array]:
    rate = _in_body(s)
    return -0.01 * s.full_torque.min() * np.sign(rate), np.zeros_like(rate)


def _in_room(s: Subject, rng: Random) -> tuple[Array, Array]:
    """A torque with a constant direction in the room, as by a magnet."""
    rate, turn, torque = _in_body(s), np.eye(3), 0.02 * s.full_torque.min() * unit(rng)
    found = np.empty_like(rate)
    for k, (of_one, lasting) in enumerate(zip(rate, s.clean.log.interval_s, strict=True)):
        found[k], turn = turn.T @ torque, turn @ rotation(of_one * lasting)
    return found, np.zeros_like(rate)


def _draught(s: Subject, rng: Random) -> tuple[Array, Array]:
    count, most = len(s.clean.log.time_s), float(np.abs(_rates(s.clean)[1]).max())
    force = 0.03 * unit(rng) * _body(s)[2] * most * np.sin(6 * np.pi * np.linspace(0, 1, count))[:, None]
    return np.zeros_like(force), force


def _resonant(s: Subject, _: Random, rate: Array, force: Array, gyro: float, accel: float, cycles: float) -> tuple[Array, Array]:
    """Parts of what a resonance of so many cycles makes of what is measured, beside the rest of it."""
    damping = 0.02 if gyro else 0.05
    if gyro:
        rate = rate + gyro * (_ringing(rate, _step_s(s), cycles * s.period_s, damping) - rate)
    if accel:
        force = force + accel * (_ringing(force, _step_s(s), cycles * s.period_s, damping) - force)
    return rate, force


def _second_order(s: Subject, _: Random, rate: Array, force: Array) -> tuple[Array, Array]:
    period_s = 2 * np.pi * 0.4 * s.period_s
    return _ringing(rate, _step_s(s), period_s, 0.707), _ringing(force, _step_s(s), period_s, 0.707)


def _coloured(s: Subject, rng: Random, rate: Array, force: Array) -> tuple[Array, Array]:
    drawn, kept = rng.standard_normal(rate.shape), 0.95
    for k in range(1, len(drawn)):
        drawn[k] = kept * drawn[k - 1] + np.sqrt(1 - kept**2) * drawn[k]
    return rate + 6 * noise(s, "gyro") * drawn, force


def _counts(s: Subject, _: Random, rate: Array, force: Array) -> tuple[Array, Array]:
    gyro, accel = 8 * noise(s, "gyro"), 8 * noise(s, "accel")
    return np.round(rate / gyro) * gyro, np.round(force / accel) * accel


def _held(_s: Subject, rng: Random, rate: Array, force: Array) -> tuple[Array, Array]:
    rate, force = rate.copy(), force.copy()
    rows = np.sort(rng.choice(np.arange(1, len(rate)), max(3, len(rate) // 100), replace=False))
    rate[rows], force[rows] = rate[rows - 1], force[rows - 1]
    return rate, force


def _slipping(_s: Subject, rng: Random, rate: Array, force: Array) -> tuple[Array, Array]:
    after, turn = slice(int(len(rate) * rng.uniform(0.3, 0.7)), None), turned_by(unit(rng), 1.0)
    rate, force = rate.copy(), force.copy()
    rate[after], force[after] = rate[after] @ turn.T, force[after] @ turn.T
    return rate, force


def _moving(s: Subject, rate: Array, force: Array, by: Array) -> tuple[Array, Array]:
    """The IMU, or the CG, is displaced by (n, 3)."""
    growing = np.gradient(rate, axis=0) / s.clean.log.interval_s[:, None]
    return rate, force + np.cross(growing, by) + np.cross(rate, np.cross(rate, by))


def _moved_midway(s: Subject, rng: Random, rate: Array, force: Array) -> tuple[Array, Array]:
    return _moving(s, rate, force, 0.02 * unit(rng) * (np.arange(len(rate)) > len(rate) // 2)[:, None])


def _wandering(s: Subject, rng: Random, rate: Array, force: Array) -> tuple[Array, Array]:
    return _moving(s, rate, force, 0.01 * unit(rng) * np.sin(10 * np.pi * _along(rate)))


def _bursts(s: Subject, rng: Random, rate: Array, force: Array) -> tuple[Array, Array]:
    rate, force = rate.copy(), force.copy()
    for at in rng.choice(len(rate) - 20, 4, replace=False):
        rate[at : at + 8] += 30 * noise(s, "gyro") * rng.standard_normal((8, 3))
        force[at : at + 8] += 30 * noise(s, "accel") * rng.standard_normal((8, 3))
    return rate, force


def _along(values: Array) -> Array:
    """(n, 1) time from 0 to 1."""
    return np.linspace(0.0, 1.0, len(values))[:, None]


def _crosstalk() -> Array:
    found = np.eye(3)
    found[0, 1], found[2, 0] = 0.02, -0.02
    return found


def _two(s: Subject, rng: Random) -> Made:
    if not s.fired:
        return None
    case = stated_forces(s, s.clean, {str(rng.choice(s.fired)): 1 / 0.93})
    rate, force = _rates(case)
    return _measured(case, rate, force * (1 + 0.02 * rng.standard_normal(3)))


def _all_a_little(s: Subject, rng: Random) -> Case:
    case = s.clean
    if s.vehicle.jets:
        case = stated_forces(s, case, {jet.name: 1 + 0.03 * rng.standard_normal() for jet in s.vehicle.jets})
        placed = [(np.array(jet.position_m) + 0.003 * rng.standard_normal(3)).tolist() for jet in s.vehicle.jets]
        case = case.stating(*(f"jets.{i}.position_m={place}" for i, place in enumerate(placed)))
    rate, force = _rates(case)
    return _measured(case, rate * (1 + 0.005 * rng.standard_normal(3)), force * (1 + 0.005 * rng.standard_normal(3)))


UNFORESEEN: dict[str, tuple[str, Maker]] = {
    **COMMANDS,
    "leak": ("a jet that leaks 2 % of its thrust", lambda s, rng: _pushed(_leaking)(s, rng) if s.vehicle.jets else None),
    "gyro-bends": ("gyro scale that bends by 2 %", _sensed(lambda _s, _r, w, f: (w * (1 + 0.02 * w / np.abs(w).max()), f))),
    "gyro-feels-force": ("gyro that feels force", _sensed(lambda _s, r, w, f: (w + f @ r.normal(0, 2e-4, (3, 3)), f))),
    "gyro-bias-ramp": ("gyro bias that grows to 0.003 rad/s", _sensed(lambda _s, r, w, f: (w + 0.003 * unit(r) * _along(w), f))),
    "accel-bias-ramp": ("accelerometer bias that grows to 0.05 m/s²", _sensed(lambda _s, r, w, f: (w, f + 0.05 * unit(r) * _along(f)))),
    "accel-bias-wave": (
        "accelerometer bias that goes up and down by 0.03 m/s²",
        _sensed(lambda _s, r, w, f: (w, f + 0.03 * unit(r) * np.sin(12 * np.pi * _along(f)))),
    ),
    "accel-loud-firing": ("accelerometer ten times as noisy while firing", _sensed(partial(_loud, gyro=0.0, accel=10.0))),
    "gyro-loud-firing": ("gyro five times as noisy while firing", _sensed(partial(_loud, gyro=5.0, accel=0.0))),
    "coarse-counts": ("both sensors count in steps of eight times their noise", _sensed(_counts)),
    "accel-hum": (
        "hum of six times the accelerometer's noise",
        _sensed(
            lambda s, r, w, f: (
                w,
                f + 6 * noise(s, "accel") * unit(r) * np.sin(2 * np.pi * s.clean.log.time_s[:, None] / (3.7 * s.period_s)),
            )
        ),
    ),
    "gyro-coloured": ("coloured noise of six times the gyro's", _sensed(_coloured)),
    "gyro-late": ("gyro a cycle late", _sensed(lambda s, _r, w, f: (_later(w, s.clean.log.records_per_cycle), f))),
    "accel-late": ("accelerometer a cycle late", _sensed(lambda s, _r, w, f: (w, _later(f, s.clean.log.records_per_cycle)))),
    "records-held": ("1 % of the records repeat the one before", _sensed(_held)),
    "gyro-crosstalk": ("gyro axes 2 % out of square", _sensed(lambda _s, _r, w, f: (w @ _crosstalk().T, f))),
    "accel-crosstalk": ("accelerometer axes 2 % out of square", _sensed(lambda _s, _r, w, f: (w, f @ _crosstalk().T))),
    "imu-slips": ("IMU that turns by 1° in mid-log", _sensed(_slipping)),
    "imu-moves": ("IMU that moves by 20 mm in mid-log", _sensed(_moved_midway)),
    "gyro-scale-drifts": ("gyro scale that drifts by 4 %", _sensed(lambda _s, _r, w, f: (w * (1 + 0.04 * (_along(w) - 0.5)), f))),
    "accel-scale-drifts": ("accelerometer scale that drifts by 4 %", _sensed(lambda _s, _r, w, f: (w, f * (1 + 0.04 * (_along(f) - 0.5))))),
    "bursts": ("four bursts of thirty times the noise", _sensed(_bursts)),
    "bracket-rings": ("an IMU bracket that rings in eight cycles", _sensed(partial(_resonant, gyro=0.0, accel=0.1, cycles=8))),
    "low-pass-2": ("both sensors behind a low-pass of the second order", _sensed(_second_order)),
    "slosh": (
        "5 % of the mass swings in 40 cycles",
        lambda s, r: _sensed(partial(_resonant, gyro=0.0, accel=0.05, cycles=40))(s, r) if _free(s) else None,
    ),
    "flexible": (
        "5 % of the inertia swings in 20 cycles",
        lambda s, r: _sensed(partial(_resonant, gyro=0.05, accel=0.0, cycles=20))(s, r) if _free(s) else None,
    ),
    "umbilical": ("a cable's spring", _pushed(_tied)),
    "quadratic-drag": ("drag by the square of the rate", _pushed(_dragged)),
    "dry-friction": ("friction of 1 % of full torque", _pushed(_rubbing)),
    "torque-in-room": ("a torque of 2 % of full that keeps its direction in the room", _pushed(_in_room)),
    "draught": ("a force of 3 % that goes up and down", _pushed(_draught)),
    "mass-wanders": ("a CG that wanders by 10 mm", lambda s, r: _sensed(_wandering)(s, r) if _free(s) else None),
    "two-at-once": ("one jet at 93 % and accelerometer scales 2 % off", _two),
    "all-a-little": ("all jets 3 % and 3 mm, all scales 0.5 % off", _all_a_little),
}
"""By name: what it is, and a log with it; None where a vehicle can't have it."""
