"""Correction of a hypothesis: log and vehicle file with it applied, and the keys that state it."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import rotation
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.design import Case
from massprop_cli.errorparameters import channels
from massprop_cli.errorparameters.actuatornames import NEAR
from massprop_cli.errorparameters.channels import spun, wired
from massprop_cli.errorparameters.setup import DELAY, LAG, Setup, own_lags, stating, with_factors
from massprop_cli.errorparameters.table import BY_NAME, ENTRIES, PRIORS, SIGMA_KEYS, TABLE
from massprop_cli.errorparameters.thrust import RPM, about_cg
from massprop_cli.inputs.actuators.control_moment_gyro import GyroLog
from massprop_cli.inputs.columns import WRENCH, Column
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import ACTUATORS, Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.timing import Timing

Matrix = tuple[tuple[float, ...], ...]
MOUNTING = BY_NAME["mounting"]
ROUNDING, ALMOST = 1e-12, 1e-2
"""Of a turn or a scale, what is none; of the columns of a rotation, how far they may be from orthonormal."""
_NUMBER = re.compile(r"\.\d+\.")
SECTIONS = ("jets", "imu", "environment", "thrust", "cycle")
"""In the order in which a correction lists what it changes."""
UNTOLD = 0.9
"""Of what is to be expected, beyond which the sigma of an unknown says that the log tells nothing of it."""
ANEW = 4.0
"""Times its own sigma, the prior sigma of an unknown that a corrected estimate estimates anew: the log counts twice by 3 % of that then."""
SKEWED = 0.02
"""rad; a turn of a gyro's axes below which they may as well be out of square by as much: calibrated ones are by 1e-3 to 1e-2."""
ESTIMATED = frozenset(one.sigma_key for one in TABLE if one.states)
"""Keys of a correction that say how uncertain something is, or that it is to be estimated, and not what it is."""


class RotorColumns(NamedTuple):
    """Columns of rotors that are one another's, or in another unit."""

    names: tuple[str, ...]
    """The contract's, of all of them."""
    order: tuple[int, ...]
    """Of which column each rotor is read."""
    factor: float = 1.0
    """On all of them."""

    @property
    def rows(self) -> Matrix:
        """Factors on columns, a row each."""
        return tuple(tuple(self.factor * (i == at) for i in range(len(self.order))) for at in self.order)


class GimbalColumns(NamedTuple):
    """Columns of gimbals' angles in another unit."""

    names: tuple[str, ...]
    """The contract's, of each of :attr:`massprop_cli.inputs.vehicle.Vehicle.spinning`."""
    factors: tuple[float, ...]
    """On each; 1 of what is no gimbal."""

    def turned(self, log: Log) -> Log:
        """The log with these angles."""
        pairs = zip(log.spinning, self.factors, strict=True)
        return replace(log, spinning=tuple(one.turned(by) if isinstance(one, GyroLog) else one for one, by in pairs))


@dataclass(frozen=True)
class Correction:
    """How a named fault is corrected: keys of the vehicle file, and factors on what the log holds."""

    settings: tuple[str, ...] = ()
    gyro: Matrix = ()
    """(3, 3) on the gyro's columns; empty: none."""
    accelerometer: Matrix = ()
    command: tuple[float, ...] = ()
    """On each component of a commanded wrench; empty: none."""
    rotors: RotorColumns | None = None
    """Which columns of rotors are read instead."""
    gimbals: GimbalColumns | None = None

    @property
    def by_keys(self) -> bool:
        """Whether keys of the vehicle file say all of it: a sensor's columns have a source and a scale each, and no more."""
        return all(sum(value != 0 for value in row) == 1 for row in (*self.gyro, *self.accelerometer))

    @property
    def keys(self) -> tuple[dict[str, object], dict[str, object]]:
        """Values by dotted key: of what something is, and of how uncertain it is (``ESTIMATED``)."""
        pairs = [setting.partition("=") for setting in self.settings]
        sides = ([(key, text) for key, _, text in pairs if (_NUMBER.sub(".", key) in ESTIMATED) == spread] for spread in (False, True))
        values, spreads = ({key: configfile.literal(text) for key, text in side} for side in sides)
        return values, spreads

    def factors_after(self, other: Correction) -> dict[str, object]:
        """What is to be done, after another correction's factors, to what the log holds."""
        found: dict[str, object] = {}
        for name in ("gyro", "accelerometer"):
            own, before = (np.array(getattr(one, name) or np.eye(3)) for one in (self, other))
            if (own != before).any():
                found["gyro_factors" if name == "gyro" else "accel_factors"] = (own @ np.linalg.inv(before)).tolist()
        if self.command != other.command:
            found["command_factors"] = (np.array(self.command or np.ones(6)) / np.array(other.command or np.ones(6))).tolist()
        return found

    def log(self, log: Log) -> Log:
        """The log as it is after the correction's factors."""
        log = log if self.rotors is None else replace(log, command=self.rotors.factor * log.command[:, list(self.rotors.order)])
        log = log if self.gimbals is None else self.gimbals.turned(log)
        return with_factors(log, self.gyro, self.accelerometer, self.command)

    def column_settings(self, log: Log, columns: Mapping[str, Column]) -> tuple[str, ...]:
        """The keys that correct units, signs, order and scale of the log's own columns; nothing for a sensor that takes more than that."""
        settings: list[str] = []
        turns = [(log.rate_columns, self.gyro), (log.force_columns, self.accelerometer), (WRENCH, _diagonal(self.command))]
        turns += [] if self.rotors is None else [(self.rotors.names, self.rotors.rows)]
        turns += [] if self.gimbals is None else [(self.gimbals.names, _diagonal(self.gimbals.factors))]
        for names, turn in turns:
            if all(sum(value != 0 for value in row) == 1 for row in turn):
                settings += [_column(columns, name, names, row) for name, row in zip(names, turn, strict=False)]
        return tuple(setting for setting in settings if setting)


def _diagonal(factors: Sequence[float]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(factor * (i == j) for j in range(len(factors))) for i, factor in enumerate(factors))


def _column(columns: Mapping[str, Column], name: str, names: Sequence[str], row: Sequence[float]) -> str:
    """Where a column is to be read from; empty if it stays as it is."""
    at = next(i for i, value in enumerate(row) if value != 0)
    if names[at] == name and row[at] == 1.0:
        return ""
    now = columns.get(names[at], Column.model_validate({"from": names[at]}))
    return f"columns.{name}={{ from = {json.dumps(now.from_)}, scale = {now.scale * row[at]:.15g} }}"


def _rows(matrix: Array) -> Matrix:
    return tuple(tuple(float(value) + 0.0 for value in row) for row in matrix)


def _printed(value: float) -> float:
    """To as many figures as a setting has, so that the setting is what was used."""
    return float(f"{value:.9g}")


def applied(case: Case, found: Fitted) -> Case | None:
    """The case with the hypothesis's values in place; None where that takes more than factors and the vehicle file's keys.

    Or where an axis of a sensor would show nothing.
    """
    moved = [one for one in TABLE if one.name in ENTRIES and found.error(one.name).any()]
    if any(one.by_hand for one in moved):
        return None
    try:
        columns = _on_columns(found)
    except np.linalg.LinAlgError:
        return None
    vehicle = stating(case.vehicle, found.hypothesis.states)
    setup = Setup(columns.log(case.log), vehicle, case.timing, found.model.fired, found.model.clock_s)
    setup = wired(setup, found.hypothesis.does) if found.hypothesis.does else setup
    setup = spun(setup, found.hypothesis.spun) if found.hypothesis.spun else setup
    for one in moved:
        further = setup if one.by_columns else one.apply(setup, found.error(one.name))
        if further is None:
            return None
        setup = further
    turned = _both_turned(found)
    if turned is not None:
        setup = setup.having("imu.body_from_imu", turned)
    timing = Timing(*(max(value, 0.0) for value in setup.timing))
    return case._replace(log=setup.log, vehicle=cast("Resolved", setup.vehicle), timing=timing)


def _on_columns(found: Fitted) -> Correction:
    """Factors on the IMU's columns: its own scale, a unit, a turn of one sensor alone, or of both where it mirrors."""
    mounting, both = found.model.mounting, _both_turned(found) is not None

    def back(sensor: str, base: Array) -> Matrix:
        """What undoes the sensor's parameters, each of which multiplies what it shows of what is."""
        shows = _unit(base) * np.eye(3) if both else mounting.T @ base @ mounting
        for one in reversed(TABLE):
            if one.shown is not None and one.sensor == sensor and not (both and one.name in MOUNTING.entries):
                shows = one.shown(found.error(one.name), mounting) @ shows
        matrix = np.linalg.inv(shows)
        small = np.abs(matrix) < ROUNDING
        return () if np.abs(matrix - np.eye(3)).max() < ROUNDING else _rows(np.vectorize(_printed)(np.where(small, 0.0, matrix)))

    return Correction(gyro=back("gyro", found.hypothesis.gyro), accelerometer=back("accel", found.hypothesis.accelerometer))


def _both_turned(found: Fitted) -> Array | None:
    """(3, 3) body from IMU, if both sensors are supposed to be turned alike and by a rotation, each in whatever unit."""
    turns = [
        rotation(found.value(f"{name}_turn")) @ base / _unit(base)
        for name, base in (("gyro", found.hypothesis.gyro), ("accel", found.hypothesis.accelerometer))
    ]
    same = np.abs(turns[0] - turns[1]).max() < ROUNDING
    rigid = np.abs(turns[0] @ turns[0].T - np.eye(3)).max() < ALMOST and np.linalg.det(turns[0]) > 0
    if not (same and rigid) or np.abs(turns[0] - np.eye(3)).max() < ROUNDING:
        return None
    left, _, right = np.linalg.svd(turns[0].T @ found.model.mounting)
    return np.asarray(left @ right)


def _unit(base: Array) -> float:
    """What a sensor shows of one along each axis, in the mean."""
    return float(np.cbrt(abs(np.linalg.det(base))))


_EACH = ("jets", *ACTUATORS)
"""Tables of which the vehicle file has one for each actuator."""


def correction_of(case: Case, mended: Case, found: Fitted) -> Correction | None:
    """The keys that correct it, and factors on columns; None where neither does."""
    settings = tuple(_settings(case.setup, mended.setup._replace(fired=found.model.fired), found))
    correction = replace(_on_columns(found), settings=settings, command=_command(case, found))
    return None if correction == Correction() else correction


def _settings(before: Setup, after: Setup, found: Fitted) -> Iterator[str]:
    """Values that differ, and the sigmas by which values are uncertain, or let be estimated."""
    supposed = [one for one in TABLE if one.prior > 0]
    keys = dict.fromkeys(one.key for one in supposed if one.key is not None)
    differing = [key for key in keys if not np.array_equal(before.value(key), after.value(key))]
    # a delay that is uncertain as stated is estimated anew
    anew = found.hypothesis.states and 0 < found.hypothesis.free[found.model.place("delay")].max(initial=0.0) < PRIORS["delay"]
    differing = [key for key in differing if not key.startswith("jets") and not (key == DELAY and anew)]
    yield from _of_actuators(before.vehicle, after.vehicle)
    yield from _anew(after, found)
    for key, value in found.hypothesis.states.items():
        if key.partition(".")[0] not in _EACH:
            yield f"{key}={_literal(value) if isinstance(value, float) else configfile.written(value)}"
    said = found.finding((), before, after)
    for one in sorted(supposed, key=lambda one: SECTIONS.index((one.key or "cycle").partition(".")[0])):
        if one.key in differing:
            differing.remove(one.key)
            value = after.value(one.key)
            if not (one.key == LAG and own_lags(before.vehicle)):
                yield f"{one.key}={_literal(value if value.size > 1 else value[0])}"
        elif one.key is not None or one.name not in said.errors or not said.errors[one.name].any():
            continue
        if one.states and (sigma := one.corrected_sigma(said)) > one.sigma(before.vehicle) * one.scale(before.vehicle):
            yield f"{one.sigma_key}={sigma:.3g}"


def _anew(after: Setup, found: Fitted) -> Iterator[str]:
    """Sigmas by which what is corrected of jets is estimated anew."""
    for one in (one for one in TABLE if one.per_channel and one.states):
        moves = [part for part in found.parts if part.hypothesis.free[found.model.place(one.name)].any()]
        if moves and not any(map(at_once, moves)):
            error, key = found.error(one.name).reshape(len(after.fired), -1), (one.sigma_key or "").removeprefix("jets.")
            yield from (f"{name}={sigma:.3g}" for name, sigma in channels.jet_sigmas(after, key, error, one.prior).items())


def _of_actuators(before: Vehicle, after: Vehicle) -> Iterator[str]:
    """Each actuator's keys that differ."""
    for table in _EACH:
        for i, (one, other) in enumerate(zip(getattr(before, table), getattr(after, table), strict=True)):
            keys = [key for key in type(one).model_fields if getattr(one, key) != getattr(other, key)]
            yield from (f"{table}.{i}.{key}={_literal(getattr(other, key))}" for key in keys)


def around(case: Case, found: Fitted) -> tuple[Correction, ...]:
    """The correction with each unknown changed by the prior sigma with which it is estimated anew, unless it has a sigma key."""
    stated = np.zeros(len(found.x), dtype=bool)
    jets = channels.of_jets(case.setup._replace(fired=found.model.fired))
    for one in map(BY_NAME.__getitem__, ENTRIES):
        stated[found.model.place(one.name)] = np.repeat(jets, one.size) & bool(one.states) if one.per_channel else bool(one.states)
    if _both_turned(found) is not None:
        for name in MOUNTING.entries:
            stated[found.model.place(name)] = True
    further = [
        replace(found, hypothesis=replace(found.hypothesis, states=states))
        for states in found.hypothesis.further
        if not all(SIGMA_KEYS.get(key) in found.hypothesis.states for key in states)
    ]
    # what the log doesn't tell of may be as far off as what it tells of
    far = np.where(found.spread > UNTOLD, max(1.0, float(np.abs(found.moved).max(initial=0.0))), 1.0)
    moves = () if at_once(found) else zip(found.hypothesis.free.T, far * np.minimum(ANEW * found.spread, 1.0), strict=True)
    further += [replace(found, x=found.x + sigma * move) for move, sigma in moves if not move[stated].any()]
    cases = ((applied(case, one), one) for one in further)
    corrections = (None if then is None else correction_of(case, then, one) for then, one in cases)
    return tuple(one for one in corrections if one is not None)


def skewed(correction: Correction | None, found: Fitted) -> tuple[Correction, ...]:
    """The correction with each pair of the gyro's axes out of square by as much as all are found to be turned, where that is little.

    An axis that leans over turns and shears; the turn is what is found, and the shear is taken on by the inertia, unseen.
    """
    size = float(np.linalg.norm(found.value("gyro_turn")))
    if correction is None or not 0 < size < SKEWED:
        return ()
    shears = [np.eye(3) + size * (np.outer(a, b) + np.outer(b, a)) for a, b in itertools.combinations(np.eye(3), 2)]
    return tuple(replace(correction, gyro=_rows(shear @ np.array(correction.gyro or np.eye(3)))) for shear in shears)


def at_once(found: Fitted) -> bool:
    """Whether it says of channels that they are dead, push the other way round, or are logged in rpm, and nothing else."""
    if found.hypothesis.code != "thrust-scale":
        return False
    exact = exact_of(found)
    return bool((np.abs(found.factors - exact) < np.where(exact == RPM, NEAR * RPM, NEAR)).all())


def exact_of(found: Fitted) -> Array:
    """What factors are exactly, of those that it moves, in the nearest case that is no matter of degree."""
    cases = np.array([-1.0, 0.0, *([RPM] if found.model.devices.get("wheels") else [])])
    return np.asarray(cases[np.abs(found.factors[:, None] - cases).argmin(1)])


def certain(found: Fitted) -> bool:
    """Whether its unknowns are just what they are in a case that is no matter of degree: a dead jet, torques about the CG."""
    if found.hypothesis.code != "wrench-point":
        return at_once(found)
    at, sigma = found.model.position[0] + found.error("position")[:3], found.sigma("position")[:3]
    return about_cg(at, sigma, found.model.cg(found.x), found.model.force)


def _command(case: Case, found: Fitted) -> tuple[float, ...]:
    if case.log.command_kind != "wrench":
        return ()
    command, pushing = np.ones(6), slice(found.model.thrusting)
    wrench = np.concatenate([found.model.couple, found.model.force], 1)[pushing]
    command[np.abs(wrench).argmax(1)] = found.value("thrust")[pushing]
    return tuple(_printed(f) for f in command) if (command != 1).any() else ()


def shown(time_s: float) -> str:
    """A time of the log to a microsecond, however far from 0 it is."""
    return f"{time_s:.6f}".rstrip("0").rstrip(".")


def _literal(value: Any) -> str:
    """A number, or an array by rows, as a vehicle file has it."""
    return f"[{', '.join(map(_literal, value))}]" if np.ndim(value) else f"{round(float(value), 12) + 0.0:.9g}"
