"""Corrections: log and vehicle file with a hypothesis applied, and the keys that state it."""

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
"""Largest rounding error of a turn or a scale; largest departure of a rotation's columns from orthonormal ones."""
_NUMBER = re.compile(r"\.\d+\.")
SECTIONS = ("jets", "imu", "environment", "thrust", "cycle")
"""Sections of the vehicle file in the order in which a correction lists them."""
UNOBSERVED = 0.9
"""Sigma of an unknown, in prior sigmas, beyond which the log does not determine it."""
ANEW = 4.0
"""Prior sigma of an unknown that a corrected estimate estimates anew, over its sigma from the log. Using the log twice lowers it by 3 %."""
SKEWED = 0.02
"""Largest turn of a gyro's axes, rad, that may be a skew instead. Calibrated gyros have 1e-3 to 1e-2."""
ESTIMATED = frozenset(one.sigma_key for one in TABLE if one.states)
"""Keys of a correction that state an uncertainty, or that something is to be estimated."""


class RotorColumns(NamedTuple):
    """Columns of rotors in another order, or in another unit."""

    names: tuple[str, ...]
    """Contract names of all of them."""
    order: tuple[int, ...]
    """For each rotor, the column that it is read from."""
    factor: float = 1.0
    """Factor on all columns."""

    @property
    def rows(self) -> Matrix:
        """Factors on columns, one row per rotor."""
        return tuple(tuple(self.factor * (i == at) for i in range(len(self.order))) for at in self.order)


class GimbalColumns(NamedTuple):
    """Columns of gimbal angles in another unit."""

    names: tuple[str, ...]
    """Contract names, one for each of :attr:`massprop_cli.inputs.vehicle.Vehicle.spinning`."""
    factors: tuple[float, ...]
    """Factor on each; 1 for devices without a gimbal."""

    def turned(self, log: Log) -> Log:
        """Log with these angles."""
        pairs = zip(log.spinning, self.factors, strict=True)
        return replace(log, spinning=tuple(one.turned(by) if isinstance(one, GyroLog) else one for one, by in pairs))


@dataclass(frozen=True)
class Correction:
    """Correction of a fault: keys of the vehicle file, and factors on the log's data."""

    settings: tuple[str, ...] = ()
    gyro: Matrix = ()
    """(3, 3) factors on the gyro's columns; empty: none."""
    accelerometer: Matrix = ()
    command: tuple[float, ...] = ()
    """Factor on each component of a commanded wrench; empty: none."""
    rotors: RotorColumns | None = None
    """Rotor columns to read instead; None: as logged."""
    gimbals: GimbalColumns | None = None

    @property
    def by_keys(self) -> bool:
        """Whether keys alone state it. A column key holds one source and one scale."""
        return all(sum(value != 0 for value in row) == 1 for row in (*self.gyro, *self.accelerometer))

    @property
    def keys(self) -> tuple[dict[str, object], dict[str, object]]:
        """Values by dotted key: of quantities, and of their uncertainties (:data:`ESTIMATED`)."""
        pairs = [setting.partition("=") for setting in self.settings]
        groups = (
            [(key, text) for key, _, text in pairs if (_NUMBER.sub(".", key) in ESTIMATED) == is_spread] for is_spread in (False, True)
        )
        values, spreads = ({key: configfile.literal(text) for key, text in side} for side in groups)
        return values, spreads

    def factors_after(self, other: Correction) -> dict[str, object]:
        """Factors on the log's data in addition to those of another correction."""
        factors: dict[str, object] = {}
        for name in ("gyro", "accelerometer"):
            after, before = (np.array(getattr(one, name) or np.eye(3)) for one in (self, other))
            if (after != before).any():
                factors["gyro_factors" if name == "gyro" else "accel_factors"] = (after @ np.linalg.inv(before)).tolist()
        if self.command != other.command:
            factors["command_factors"] = (np.array(self.command or np.ones(6)) / np.array(other.command or np.ones(6))).tolist()
        return factors

    def log(self, log: Log) -> Log:
        """Log with the factors applied."""
        log = log if self.rotors is None else replace(log, command=self.rotors.factor * log.command[:, list(self.rotors.order)])
        log = log if self.gimbals is None else self.gimbals.turned(log)
        return with_factors(log, self.gyro, self.accelerometer, self.command)

    def column_settings(self, log: Log, columns: Mapping[str, Column]) -> tuple[str, ...]:
        """Keys that correct source, sign and scale of the log's columns; none for a sensor that needs more."""
        settings: list[str] = []
        turns = [(log.rate_columns, self.gyro), (log.force_columns, self.accelerometer), (WRENCH, _diagonal(self.command))]
        turns += [] if self.rotors is None else [(self.rotors.names, self.rotors.rows)]
        turns += [] if self.gimbals is None else [(self.gimbals.names, _diagonal(self.gimbals.factors))]
        for names, factors in turns:
            if all(sum(value != 0 for value in row) == 1 for row in factors):
                settings += [_column(columns, name, names, row) for name, row in zip(names, factors, strict=False)]
        return tuple(setting for setting in settings if setting)


def _diagonal(factors: Sequence[float]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(factor * (i == j) for j in range(len(factors))) for i, factor in enumerate(factors))


def _column(columns: Mapping[str, Column], name: str, names: Sequence[str], row: Sequence[float]) -> str:
    """Key of one column; empty if it does not change."""
    source = next(i for i, value in enumerate(row) if value != 0)
    if names[source] == name and row[source] == 1.0:
        return ""
    current = columns.get(names[source], Column.model_validate({"from": names[source]}))
    return f"columns.{name}={{ from = {json.dumps(current.from_)}, scale = {current.scale * row[source]:.15g} }}"


def _rows(matrix: Array) -> Matrix:
    return tuple(tuple(float(value) + 0.0 for value in row) for row in matrix)


def _printed(value: float) -> float:
    """Value rounded to the digits of a setting, so that the setting states what was used."""
    return float(f"{value:.9g}")


def applied(case: Case, fit: Fitted) -> Case | None:
    """The case with a hypothesis applied; None if factors and keys cannot state it, or if a sensor axis would have no signal."""
    changed = [one for one in TABLE if one.name in ENTRIES and fit.error(one.name).any()]
    if any(one.by_hand for one in changed):
        return None
    try:
        columns = _column_factors(fit)
    except np.linalg.LinAlgError:
        return None
    vehicle = stating(case.vehicle, fit.hypothesis.key_values)
    setup = Setup(columns.log(case.log), vehicle, case.timing, fit.model.fired, fit.model.clock_s)
    setup = wired(setup, fit.hypothesis.wiring) if fit.hypothesis.wiring else setup
    setup = spun(setup, fit.hypothesis.reversed_rotors) if fit.hypothesis.reversed_rotors else setup
    for one in changed:
        next_setup = setup if one.by_columns else one.apply(setup, fit.error(one.name))
        if next_setup is None:
            return None
        setup = next_setup
    mounting = _common_mounting(fit)
    if mounting is not None:
        setup = setup.having("imu.body_from_imu", mounting)
    for sensor, base in (("gyro_noise_rad_s", fit.hypothesis.gyro), ("accel_noise_m_s2", fit.hypothesis.accelerometer)):
        if sensor in case.vehicle.imu.estimated:  # in the unit of the columns
            setup = setup.having(f"imu.{sensor}", setup.value(f"imu.{sensor}") / _unit(base))
    timing = Timing(*(max(value, 0.0) for value in setup.timing))
    return case._replace(log=setup.log, vehicle=cast("Resolved", setup.vehicle), timing=timing)


def _column_factors(fit: Fitted) -> Correction:
    """Factors on the IMU's columns: scale, unit, a turn of one sensor, or a mirror of both."""
    mounting, common_turn = fit.model.mounting, _common_mounting(fit) is not None

    def inverse_of(sensor: str, base: Array) -> Matrix:
        """What undoes the sensor's parameters, each of which multiplies what it shows of what is."""
        response = _unit(base) * np.eye(3) if common_turn else mounting.T @ base @ mounting
        for one in reversed(TABLE):
            if one.shown is not None and one.sensor == sensor and not (common_turn and one.name in MOUNTING.entries):
                response = one.shown(fit.error(one.name), mounting) @ response
        matrix = np.linalg.inv(response)
        small = np.abs(matrix) < ROUNDING
        return () if np.abs(matrix - np.eye(3)).max() < ROUNDING else _rows(np.vectorize(_printed)(np.where(small, 0.0, matrix)))

    return Correction(gyro=inverse_of("gyro", fit.hypothesis.gyro), accelerometer=inverse_of("accel", fit.hypothesis.accelerometer))


def _common_mounting(fit: Fitted) -> Array | None:
    """(3, 3) body from IMU, if the hypothesis turns both sensors by one rotation, in whatever units; otherwise None."""
    turns = [
        rotation(fit.value(f"{name}_turn")) @ base / _unit(base)
        for name, base in (("gyro", fit.hypothesis.gyro), ("accel", fit.hypothesis.accelerometer))
    ]
    same = np.abs(turns[0] - turns[1]).max() < ROUNDING
    rigid = np.abs(turns[0] @ turns[0].T - np.eye(3)).max() < ALMOST and np.linalg.det(turns[0]) > 0
    if not (same and rigid) or np.abs(turns[0] - np.eye(3)).max() < ROUNDING:
        return None
    left, _, right = np.linalg.svd(turns[0].T @ fit.model.mounting)
    return np.asarray(left @ right)


def _unit(base: Array) -> float:
    """Mean of measured over true value along the axes."""
    return float(np.cbrt(abs(np.linalg.det(base))))


_EACH = ("jets", *ACTUATORS)
"""Tables with an entry for each actuator."""


def correction_of(case: Case, corrected: Case, fit: Fitted) -> Correction | None:
    """Keys and factors that turn ``case`` into the corrected one; None if there are none."""
    settings = tuple(_settings(case.setup, corrected.setup._replace(fired=fit.model.fired), fit))
    correction = replace(_column_factors(fit), settings=settings, command=_command(case, fit))
    return None if correction == Correction() else correction


def _settings(before: Setup, after: Setup, fit: Fitted) -> Iterator[str]:
    """Changed values, and sigmas that state or estimate what remains uncertain."""
    parameters = [one for one in TABLE if one.prior > 0]
    keys = dict.fromkeys(one.key for one in parameters if one.key is not None)
    differing = [key for key in keys if not np.array_equal(before.value(key), after.value(key))]
    # a delay that is stated with a sigma is estimated again
    delay_again = fit.hypothesis.key_values and 0 < fit.hypothesis.directions[fit.model.place("delay")].max(initial=0.0) < PRIORS["delay"]
    differing = [key for key in differing if not key.startswith("jets") and not (key == DELAY and delay_again)]
    yield from _actuator_settings(before.vehicle, after.vehicle)
    yield from _jet_sigmas(after, fit)
    for key, value in fit.hypothesis.key_values.items():
        if key.partition(".")[0] not in _EACH:
            yield f"{key}={_literal(value) if isinstance(value, float) else configfile.written(value)}"
    finding = fit.finding((), before, after)
    for one in sorted(parameters, key=lambda one: SECTIONS.index((one.key or "cycle").partition(".")[0])):
        if one.key in differing:
            differing.remove(one.key)
            value = after.value(one.key)
            if not (one.key == LAG and own_lags(before.vehicle)):
                yield f"{one.key}={_literal(value if value.size > 1 else value[0])}"
        elif one.key is not None or one.name not in finding.errors or not finding.errors[one.name].any():
            continue
        if one.states and (sigma := one.corrected_sigma(finding)) > one.sigma(before.vehicle) * one.scale(before.vehicle):
            yield f"{one.sigma_key}={sigma:.3g}"


def _jet_sigmas(after: Setup, fit: Fitted) -> Iterator[str]:
    """Sigmas with which corrected parameters of jets are estimated."""
    for one in (one for one in TABLE if one.per_channel and one.states):
        parts = [part for part in fit.parts if part.hypothesis.directions[fit.model.place(one.name)].any()]
        if parts and not any(map(is_discrete, parts)):
            error, key = fit.error(one.name).reshape(len(after.fired), -1), (one.sigma_key or "").removeprefix("jets.")
            yield from (f"{name}={sigma:.3g}" for name, sigma in channels.jet_sigmas(after, key, error, one.prior).items())


def _actuator_settings(before: Vehicle, after: Vehicle) -> Iterator[str]:
    """Changed keys of each actuator."""
    for table in _EACH:
        for i, (one, other) in enumerate(zip(getattr(before, table), getattr(after, table), strict=True)):
            keys = [key for key in type(one).model_fields if getattr(one, key) != getattr(other, key)]
            yield from (f"{table}.{i}.{key}={_literal(getattr(other, key))}" for key in keys)


def uncertain_corrections(case: Case, fit: Fitted) -> tuple[Correction, ...]:
    """The correction with each unknown changed by its prior sigma, except unknowns whose sigma the vehicle file can state."""
    can_be_stated = np.zeros(len(fit.x), dtype=bool)
    jets = channels.of_jets(case.setup._replace(fired=fit.model.fired))
    for one in map(BY_NAME.__getitem__, ENTRIES):
        can_be_stated[fit.model.place(one.name)] = np.repeat(jets, one.size) & bool(one.states) if one.per_channel else bool(one.states)
    if _common_mounting(fit) is not None:
        for name in MOUNTING.entries:
            can_be_stated[fit.model.place(name)] = True
    variants = [
        replace(fit, hypothesis=replace(fit.hypothesis, key_values=states))
        for states in fit.hypothesis.sigma_key_values
        if not all(SIGMA_KEYS.get(key) in fit.hypothesis.key_values for key in states)
    ]
    # an unobservable unknown may be as far off as an observable one
    size = np.where(fit.spread > UNOBSERVED, max(1.0, float(np.abs(fit.scaled).max(initial=0.0))), 1.0)
    directions = () if is_discrete(fit) else zip(fit.hypothesis.directions.T, size * np.minimum(ANEW * fit.spread, 1.0), strict=True)
    variants += [replace(fit, x=fit.x + sigma * move) for move, sigma in directions if not move[can_be_stated].any()]
    cases = ((applied(case, one), one) for one in variants)
    corrections = (None if then is None else correction_of(case, then, one) for then, one in cases)
    return tuple(one for one in corrections if one is not None)


def skew_corrections(correction: Correction | None, fit: Fitted) -> tuple[Correction, ...]:
    """The correction with each pair of the gyro's axes skewed by the size of a small turn.

    A single tilted axis is a turn plus a skew. The fit finds the turn, and the inertia absorbs the skew.
    """
    size = float(np.linalg.norm(fit.value("gyro_turn")))
    if correction is None or not 0 < size < SKEWED:
        return ()
    shears = [np.eye(3) + size * (np.outer(a, b) + np.outer(b, a)) for a, b in itertools.combinations(np.eye(3), 2)]
    return tuple(replace(correction, gyro=_rows(shear @ np.array(correction.gyro or np.eye(3)))) for shear in shears)


def is_discrete(fit: Fitted) -> bool:
    """Whether a hypothesis states only that channels are dead, reversed or logged in rpm."""
    if fit.hypothesis.code != "thrust-scale":
        return False
    exact = discrete_factors(fit)
    return bool((np.abs(fit.factors - exact) < np.where(exact == RPM, NEAR * RPM, NEAR)).all())


def discrete_factors(fit: Fitted) -> Array:
    """Nearest exact thrust factors: dead, reversed or in rpm."""
    cases = np.array([-1.0, 0.0, *([RPM] if fit.model.devices.get("wheels") else [])])
    return np.asarray(cases[np.abs(fit.factors[:, None] - cases).argmin(1)])


def is_certain(fit: Fitted) -> bool:
    """Whether its unknowns have the exact values of a discrete case: a dead jet, torques about the CG."""
    if fit.hypothesis.code != "wrench-point":
        return is_discrete(fit)
    at, sigma = fit.model.position[0] + fit.error("position")[:3], fit.sigma("position")[:3]
    return about_cg(at, sigma, fit.model.cg(fit.x), fit.model.force)


def _command(case: Case, fit: Fitted) -> tuple[float, ...]:
    if case.log.command_kind != "wrench":
        return ()
    command, pushing = np.ones(6), slice(fit.model.thrusting)
    wrench = np.concatenate([fit.model.couple, fit.model.force], 1)[pushing]
    command[np.abs(wrench).argmax(1)] = fit.value("thrust")[pushing]
    return tuple(_printed(f) for f in command) if (command != 1).any() else ()


def time_text(time_s: float) -> str:
    """A time of the log to a microsecond."""
    return f"{time_s:.6f}".rstrip("0").rstrip(".")


def _literal(value: Any) -> str:
    """A number, or an array by rows, in the format of a vehicle file."""
    return f"[{', '.join(map(_literal, value))}]" if np.ndim(value) else f"{round(float(value), 12) + 0.0:.9g}"
