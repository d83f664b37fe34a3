"""Faults of jets, commands and their timing."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial, wraps

import numpy as np
from fault_named import Drawn, Due, Fault, Number, due
from fault_vehicles import INCREMENTS, Case, Subject

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.prepare.actuators import together

FINE = 20
"""Records per cycle that a drifting clock is sampled from."""
LEAST = 4
"""Pulses of a jet that fails for a time, before, in and after it."""
Random = np.random.Generator


def unit(rng: Random) -> Array:
    """(3,) a random direction."""
    drawn = rng.standard_normal(3)
    direction: Array = drawn / np.linalg.norm(drawn)
    return direction


def across(rng: Random, force: Array) -> Array:
    """(3,) a random direction normal to ``force``."""
    drawn = np.cross(force, unit(rng))
    direction: Array = drawn / np.linalg.norm(drawn)
    return direction


def turned(vector: Array, axis: Array, degrees: float) -> Array:
    """(3,) ``vector`` turned about ``axis``, which is across it or not (Rodrigues)."""
    angle = np.radians(degrees)
    rotated: Array = vector * np.cos(angle) + np.cross(axis, vector) * np.sin(angle) + axis * (axis @ vector) * (1 - np.cos(angle))
    return rotated


def stated_forces(subject: Subject, case: Case, factors: dict[str, float]) -> Case:
    """The vehicle file states ``factors`` times the true thrust of these jets."""
    jets = subject.vehicle.jets
    keys = [f"jets.{i}.force_n={[factors[j.name] * x for x in j.force_n]}" for i, j in enumerate(jets) if j.name in factors]
    return case.stating(*keys)


def failing(jets: list[str]) -> str:
    """The scenario's key for dead jets."""
    return "actuators.failures=[" + ", ".join(f'{{jet="{jet}", thrust=0.0}}' for jet in jets) + "]"


def on_a_jet(draw: Callable[..., Drawn]) -> Callable[..., Drawn | None]:
    """A fault of a random jet among those that fire, by name; None where none fires."""

    @wraps(draw)
    def drawn(s: Subject, rng: Random, **sized: float) -> Drawn | None:
        return draw(s, rng, str(rng.choice(s.fired)), **sized) if s.fired else None

    return drawn


@on_a_jet
def _reversed(s: Subject, _: Random, jet: str) -> Drawn:
    return Drawn(stated_forces(s, s.clean, {jet: -1.0}), due("jet-sign", channels=[jet]), f"{jet} pushes the other way")


def _dead(s: Subject, rng: Random, count: int) -> Drawn | None:
    if not s.fired:
        return None
    jets = [str(jet) for jet in rng.choice(s.fired, count, replace=False)]
    dues = tuple(Due(("jet-dead",), (jet,), frozenset(jets)) for jet in jets)
    return Drawn(s.flown(failing(jets)), dues, f"{' and '.join(jets)} dead")


def _for_a_time(s: Subject, rng: Random, code: str, factors: tuple[float, float], lasting: tuple[float, float] | None) -> Drawn | None:
    """A jet fails from one of its pulses on, or for a part of them."""
    names, log = [one.name for one in s.vehicle.jets], s.clean.log
    often = [jet for jet in s.fired if (log.command[:, names.index(jet)] > 0).sum() >= 4 * LEAST]
    if not often:
        return None
    jet, factor = str(rng.choice(often)), float(rng.uniform(*factors))
    begun = log.cycle_end_s + (float(s.vehicle.cycle.command_delay_cycles) - 1) * s.period_s
    pulses = begun[log.command[:, names.index(jet)] > 0]
    first = int(rng.integers(LEAST, len(pulses) - 2 * LEAST))
    last = len(pulses) if lasting is None else first + max(int(len(pulses) * rng.uniform(*lasting)), LEAST)
    start, end = (pulses[i] - s.period_s / 2 if i < len(pulses) else None for i in (first, last))
    fails = f'jet="{jet}", thrust={factor}, start_s={start}' + ("" if end is None else f", end_s={end}")
    when = Number(float(pulses[first]), 2 * s.period_s)
    # where the failure goes on through a phase, it is all along in that
    words = () if len(s.vehicle.phases) > 1 else (when,)
    what = f"{jet} gives {factor:.0%} from {when.value:.4g} s on" + ("" if end is None else f" to {end:.4g} s")
    return Drawn(s.flown(f"actuators.failures=[{{{fails}}}]"), due(code, *words, channels=[jet]), what)


def _swapped(s: Subject, rng: Random) -> Drawn | None:
    """The vehicle file exchanges the names of two jets."""
    if not s.fired:
        return None
    pair = [str(jet) for jet in rng.choice(s.fired, 2, replace=False)]
    index = {jet.name: i for i, jet in enumerate(s.vehicle.jets)}
    keys = []
    for one, other in (pair, pair[::-1]):
        jet = s.vehicle.jets[index[other]]
        keys += [f"jets.{index[one]}.{key}={list(getattr(jet, key))}" for key in ("position_m", "force_n")]
    return Drawn(s.clean.stating(*keys), due("jets-swapped", channels=pair), f"{' and '.join(pair)} swapped")


@on_a_jet
def _weak(s: Subject, _: Random, jet: str, factor: float) -> Drawn:
    return Drawn(stated_forces(s, s.clean, {jet: 1 / factor}), due("thrust-scale", channels=[jet]), f"{jet} gives {factor:.0%}")


def _group(s: Subject, rng: Random, prefixes: tuple[str, ...]) -> Drawn | None:
    groups = [[jet for jet in s.fired if jet.startswith(prefix)] for prefix in prefixes]
    groups = [group for group in groups if len(group) > 1]
    if not groups:
        return None
    group = groups[int(rng.integers(len(groups)))]
    factor = float(rng.choice([0.8, 1.2]))
    wrong = stated_forces(s, s.clean, dict.fromkeys(group, 1 / factor))
    return Drawn(wrong, due("thrust-scale", channels=group), f"{', '.join(group)} give {factor:.0%}")


def _all_thrust(s: Subject, rng: Random) -> Drawn | None:
    factor = float(rng.choice([0.8, 1.2]))
    if not (s.vehicle.jets or s.driven):
        return None
    if s.vehicle.jets:
        wrong = stated_forces(s, s.clean, {jet.name: 1 / factor for jet in s.vehicle.jets})
    else:
        wrong = s.clean.logging(command=s.clean.log.command / factor)
    return Drawn(wrong, (), f"all thrust at {factor:.0%}, which no log can tell")


@on_a_jet
def _misplaced(s: Subject, rng: Random, jet: str, metres: float) -> Drawn:
    i = [j.name for j in s.vehicle.jets].index(jet)
    placed = np.array(s.vehicle.jets[i].position_m) + metres * across(rng, np.array(s.vehicle.jets[i].force_n))
    wrong = s.clean.stating(f"jets.{i}.position_m={placed.tolist()}")
    return Drawn(wrong, due("jet-position", channels=[jet]), f"{jet} {metres * 1000:g} mm out of place")


@on_a_jet
def _canted(s: Subject, rng: Random, jet: str, degrees: float) -> Drawn:
    i = [j.name for j in s.vehicle.jets].index(jet)
    force = np.array(s.vehicle.jets[i].force_n)
    wrong = s.clean.stating(f"jets.{i}.force_n={turned(force, across(rng, force), degrees).tolist()}")
    return Drawn(wrong, due("jet-direction", channels=[jet]), f"{jet} canted by {degrees:g} degrees")


def _command(s: Subject, rng: Random, factor: float, code: str) -> Drawn | None:
    if not s.driven:
        return None
    i = int(rng.choice(s.driven))
    command = s.clean.log.command.copy()
    command[:, i] /= factor
    return Drawn(s.clean.logging(command=command), due(code, channels=[WRENCH[i]]), f"{WRENCH[i]} gives {factor:.0%}")


def _forces(s: Subject, _: Random, factor: float) -> Drawn | None:
    diverts = [jet for jet in s.fired if jet.startswith("divert_")]
    if 1 < len(diverts) < len(s.fired):
        wrong, who = stated_forces(s, s.clean, dict.fromkeys(diverts, 1 / factor)), diverts
    elif {3, 4, 5} <= set(s.driven):
        command = s.clean.log.command * np.repeat([1.0, 1 / factor], 3)
        wrong, who = s.clean.logging(command=command), list(WRENCH[3:])
    else:
        return None
    return Drawn(wrong, due("thrust-scale", channels=who), f"{', '.join(who)} give {factor:g} times what is stated, all others what is")


def _rise(s: Subject, _: Random, cycles: float, ramps: tuple[str, ...] = ("rise_s", "fall_s")) -> Drawn | None:
    if not s.vehicle.jets:
        return None
    more, what = cycles * s.period_s, " and ".join(ramp.removesuffix("_s") for ramp in ramps)
    keys = [f"vehicle.jets.{i}.{ramp}={getattr(jet, ramp) + more}" for i, jet in enumerate(s.vehicle.jets) for ramp in ramps]
    return Drawn(s.flown(*keys), due("thrust-rise"), f"{what} of thrust take {1000 * more:g} ms more than stated")


def _droop(s: Subject, rng: Random, key: str) -> Drawn | None:
    if together(s.clean.log) < 2:
        return None
    part = float(np.exp(rng.uniform(np.log(0.003), np.log(0.03))))
    what = f"each jet loses {100 * part:.2g} % beside each further one"
    return Drawn(s.flown(f"actuators.{key}={part}"), due("thrust-droop", Number(100 * part, 5 * part)), what)


def _lag(s: Subject, rng: Random) -> Drawn | None:
    stated = s.vehicle.thrust.stated_lag_s
    true = stated + rng.uniform(0.3, 0.8) * s.period_s
    return Drawn(s.flown(f"actuators.lag_s={true}"), due("thrust-lag"), f"thrust lags by {true:.4g} s, stated {stated:g}")


def _delay(s: Subject, rng: Random, cycles: float) -> Drawn | None:
    true = float(s.vehicle.cycle.command_delay_cycles)
    stated = true + (cycles if true < cycles else float(rng.choice([-1, 1])) * cycles)
    wrong = s.clean.stating(f"cycle.command_delay_cycles={stated}")
    return Drawn(wrong, due("delay-mismatch", Number(true, 0.2)), f"delay {true:g} cycles, stated {stated:g}")


def _drift(s: Subject, rng: Random) -> Drawn | None:
    """The IMU's clock drifts; command k stays in the IMU's row k."""
    if s.vehicle.spinning:
        return None  # tachometers would have a clock, too
    total = rng.uniform(1.0, 1.5)
    faster = total / s.cycles
    if float(s.vehicle.cycle.command_delay_cycles) > total and rng.random() < 0.5:
        faster = -faster
    fine = s.flown(f"sensors.records_per_cycle={FINE}", "sensors.gyro_noise_rad_s=0.0", "sensors.accel_noise_m_s2=0.0")
    shorter = s.clean.cut(s.cycles - 3)  # a slow IMU sees beyond what was flown
    log, imu = shorter.log, s.vehicle.imu
    ends = np.concatenate([[0.0], fine.log.time_s])
    sampled = np.concatenate([[0.0], log.time_s]) * (1 - faster)
    white = np.sqrt(log.records_per_cycle) * log.interval_s[:, None]
    # where commands answer what the gyro measures, those of the flight that was sampled
    found = {"command": fine.log.command[: log.cycles]}
    for name, sigma in zip(INCREMENTS.values(), (imu.gyro_noise_rad_s, imu.accel_noise_m_s2), strict=True):
        total_so_far = np.vstack([np.zeros(3), np.cumsum(getattr(fine.log, name), 0)])
        seen = np.stack([np.interp(sampled, ends, column) for column in total_so_far.T], 1)
        found[name] = np.diff(seen, axis=0) + (sigma or 0.0) * white * rng.standard_normal((len(log.time_s), 3))
    wrong = replace(shorter.logging(**found), bodies=fine.bodies)
    return Drawn(wrong, due("clock-drift"), f"IMU clock {faster * 1e6:+.0f} ppm, {abs(faster) * s.cycles:.2f} cycles in all")


THRUST = (
    Fault("jet-reversed", "one jet reversed", _reversed),
    Fault("jet-dead", "one jet dead", partial(_dead, count=1)),
    Fault("jets-dead", "two jets dead", partial(_dead, count=2)),
    Fault("jets-swapped", "two jets swapped", _swapped),
    Fault("jet-dies", "one jet dead from some moment on", partial(_for_a_time, code="jet-dead", factors=(0.0, 0.0), lasting=None)),
    Fault(
        "jet-fades",
        "one jet at 50 to 90 % from some moment on",
        partial(_for_a_time, code="thrust-scale", factors=(0.5, 0.9), lasting=None),
    ),
    Fault(
        "jet-sticks",
        "one jet shut for 5 to 25 % of the log",
        partial(_for_a_time, code="jet-dead", factors=(0.0, 0.0), lasting=(0.05, 0.25)),
    ),
    Fault("jet-weak", "one jet at 80 %", partial(_weak, factor=0.8)),
    Fault("jet-strong", "one jet at 120 %", partial(_weak, factor=1.2)),
    Fault("jet-10mm", "one jet 10 mm out of place", partial(_misplaced, metres=0.01)),
    Fault("jet-50mm", "one jet 50 mm out of place", partial(_misplaced, metres=0.05)),
    Fault("jet-5deg", "one jet canted by 5°", partial(_canted, degrees=5.0)),
    Fault("jet-20deg", "one jet canted by 20°", partial(_canted, degrees=20.0)),
    Fault("axis-scale", "all jets of one axis at 80 or 120 %", partial(_group, prefixes=("roll_", "pitch_", "yaw_"))),
    Fault("line-scale", "diverts of one line at 80 or 120 %", partial(_group, prefixes=("divert_x", "divert_y", "divert_z"))),
    Fault("all-scale", "all thrust at 80 or 120 %: no log can tell", _all_thrust),
    Fault("command-sign", "one component of the wrench reversed", partial(_command, factor=-1.0, code="command-sign")),
    Fault("command-scale", "one component of the wrench at 80 %", partial(_command, factor=0.8, code="thrust-scale")),
    Fault("forces-scale", "all that pushes at 50 % beside what only turns", partial(_forces, factor=0.5)),
    Fault("forces-unit", "the same at eight times what is stated", partial(_forces, factor=8.0)),
    Fault("rise-short", "rise and fall of a fifth of a cycle unstated", partial(_rise, cycles=0.2)),
    Fault("rise-long", "rise and fall of two fifths unstated", partial(_rise, cycles=0.4)),
    Fault("opens-late", "valves that open late: a rise of a tenth unstated", partial(_rise, cycles=0.1, ramps=("rise_s",))),
    Fault("droop", "0.3 to 3 % of thrust lost for each further jet while it is open", partial(_droop, key="droop")),
    Fault("cycle-droop", "0.3 to 3 % of thrust lost for each further jet of the cycle", partial(_droop, key="cycle_droop")),
    Fault("closes-late", "valves that close late: a fall of a tenth unstated", partial(_rise, cycles=0.1, ramps=("fall_s",))),
    Fault("lag", "lag of 0.3 to 0.8 cycles unstated", _lag),
    Fault("delay-half", "delay off by half a cycle", partial(_delay, cycles=0.5)),
    Fault("delay-one", "delay off by a cycle", partial(_delay, cycles=1.0)),
    Fault("delay-two", "delay off by two cycles", partial(_delay, cycles=2.0)),
    Fault("clock-drift", "IMU clock drifts by 1 to 1.5 cycles in all", _drift),
)
