"""How what is supposed to be wrong is mended: a log and a vehicle file with it in place, and the keys that say so."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, IntArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import rotation
from massprop_cli.diagnosis.contest import Fitted
from massprop_cli.diagnosis.design import Designs, level_of
from massprop_cli.inputs.columns import WRENCH, Column
from massprop_cli.inputs.equipment import MOST_DROOP, Jet
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.attitude import quaternion_of, quaternion_product, world_up_b
from massprop_cli.prepare.timing import Timing

Matrix = tuple[tuple[float, ...], ...]
BY_HAND = ("torque", "drag", "mass_rate", "inertia_rate")
"""Entries of x whose values no log and no vehicle file can be given."""
ROUNDING = 1e-12
"""Of a turn or a scale, what is none."""
STATED = ("delay", "lag", "gyro_lag", "accel_lag", "gyro_bias", "accel_bias", "torque", "drag", "mass_rate", "inertia_rate")
"""Entries whose uncertainty is a key of the vehicle file."""
SIGMAS = {
    "gyro_bias": "imu.gyro_bias_sigma_rad_s",
    "accel_bias": "imu.accel_bias_sigma_m_s2",
    "drag": "environment.damping_sigma_n_m_s",
}
"""Keys by which an entry is estimated; of its size, each."""
NEAR = 0.05
"""Parts of its stated thrust within which a jet is dead, or pushes the other way."""
PART = 1e-3
"""Of a steady torque, what it may change per cycle where it is to be estimated."""

SKEWED = 0.02
"""rad; a turn of a gyro's axes below which they may as well be out of square by as much: calibrated ones are by 1e-3 to 1e-2."""


class Case(NamedTuple):
    """A log as it is read."""

    log: Log
    vehicle: Resolved
    timing: Timing
    designs: Designs | None = None
    """Made of it so far, and of what is supposed of it; None: they are made anew."""


@dataclass(frozen=True)
class Cure:
    """How a named fault is mended: keys of the vehicle file, and factors on what the log holds."""

    settings: tuple[str, ...] = ()
    gyro: Matrix = ()
    """(3, 3) on the gyro's columns; empty: none."""
    accelerometer: Matrix = ()
    command: tuple[float, ...] = ()
    """On each component of a commanded wrench; empty: none."""

    def followed_by(self, other: Cure) -> Cure:
        """Both."""
        return Cure(
            (*self.settings, *other.settings),
            _product(other.gyro, self.gyro),
            _product(other.accelerometer, self.accelerometer),
            tuple(a * b for a, b in zip(self.command, other.command, strict=True))
            if self.command and other.command
            else self.command or other.command,
        )

    def log(self, log: Log) -> Log:
        """The log as it is after the cure's factors."""
        return replace(
            log,
            delta_theta_imu_rad=log.delta_theta_imu_rad @ np.array(self.gyro).T if self.gyro else log.delta_theta_imu_rad,
            delta_v_imu_m_s=log.delta_v_imu_m_s @ np.array(self.accelerometer).T if self.accelerometer else log.delta_v_imu_m_s,
            command=log.command * np.array(self.command) if self.command else log.command,
        )

    def column_settings(self, log: Log, columns: Mapping[str, Column]) -> tuple[str, ...]:
        """The keys that mend units, signs, order and scale of the log's own columns; nothing for a sensor that takes more than that."""
        settings: list[str] = []
        turns = ((log.rate_columns, self.gyro), (log.force_columns, self.accelerometer), (WRENCH, _diagonal(self.command)))
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
    return f"columns.{name}={{ from = {json.dumps(now.from_)}, scale = {now.scale * row[at]:.9g} }}"


def _product(after: Matrix, before: Matrix) -> Matrix:
    if not after or not before:
        return after or before
    return _rows(np.array(after) @ np.array(before))


def _rows(matrix: Array) -> Matrix:
    return tuple(tuple(float(value) + 0.0 for value in row) for row in matrix)


def applied(case: Case, found: Fitted, fired: IntArray) -> Case | None:
    """The case with the supposition's values in place; None where that takes more than factors and the vehicle file's keys."""
    get, model = found.value, found.model
    if any(np.any(get(name)) for name in BY_HAND):
        return None
    log, vehicle, timing, _ = case
    cure = _on_columns(found)
    command = np.ones(log.command.shape[1])
    if log.command_kind == "wrench":
        command[list(fired)] = get("thrust")
        cure = replace(cure, command=tuple(float(f) for f in command) if (command != 1).any() else ())
    log = cure.log(log)
    for name, sensor in (("gyro_bias", "delta_theta_imu_rad"), ("accel_bias", "delta_v_imu_m_s")):
        if get(name).any():
            bias = model.mounting.T @ get(name)
            log = replace(log, **{sensor: getattr(log, sensor) - bias * log.interval_s[:, None]})
    if log.command_kind == "jets":
        vehicle = _with_jets(vehicle, _jets(vehicle, found, list(fired)))
    lost = {key: max(getattr(vehicle.thrust, key) + float(get(key)[0]), 0.0) for key in ("droop", "cycle_droop") if get(key).any()}
    if any(part > MOST_DROOP for part in lost.values()):
        return None
    if lost:
        vehicle = vehicle.model_copy(update={"thrust": vehicle.thrust.model_copy(update=lost)})
    imu: dict[str, Any] = {}
    fast = drift_ppm(case, found)
    if fast:
        imu["clock_drift_ppm"] = vehicle.imu.clock_drift_ppm + fast
    for sensor in ("gyro", "accel"):
        if get(f"{sensor}_lag").any():
            lag_s = getattr(vehicle.imu, f"{sensor}_lag_s") + float(get(f"{sensor}_lag")[0]) * vehicle.cycle.period_s
            imu[f"{sensor}_lag_s"] = max(lag_s, 0.0)
    if get("imu").any():
        imu["position_m"] = _vector(model.imu + get("imu"))
    turned = _both_turned(found)
    if turned is not None:
        imu["body_from_imu"] = _rows(turned)
    environment: dict[str, Any] = {}
    if get("bearing").any() and model.bearing is not None:
        environment["bearing_position_m"] = _vector(model.bearing + get("bearing"))
    if get("tilt").any():
        environment["initial_attitude_wxyz"] = _tilted(vehicle, get("tilt"))
    if imu or environment:
        parts = {"imu": vehicle.imu.model_copy(update=imu), "environment": vehicle.environment.model_copy(update=environment)}
        vehicle = vehicle.model_copy(update=parts)
    lag = timing.lag + float(get("lag")[0])
    began = 1e-6 * fast * model.clock_s[0] / vehicle.cycle.period_s
    timing = Timing(max(timing.delay + float(get("delay")[0]) - began, 0.0), max(lag, 0.0))
    return case._replace(log=log, vehicle=vehicle, timing=timing)


def _on_columns(found: Fitted) -> Cure:
    """Factors on the IMU's columns: its own scale, a unit, a turn of one sensor alone, or of both where it mirrors."""
    mounting, both = found.model.mounting, _both_turned(found) is not None

    def back(name: str, base: Array) -> Matrix:
        scale = np.diag(np.exp(found.value(f"{name}_scale")))
        turn = np.eye(3) if both else rotation(found.value(f"{name}_turn")) @ base
        matrix = np.linalg.inv(scale @ mounting.T @ turn @ mounting)
        small = np.abs(matrix) < ROUNDING
        return () if np.abs(matrix - np.eye(3)).max() < ROUNDING else _rows(np.where(small, 0.0, matrix))

    return Cure(gyro=back("gyro", found.supposed.gyro), accelerometer=back("accel", found.supposed.accelerometer))


def _both_turned(found: Fitted) -> Array | None:
    """(3, 3) body from IMU, if both sensors are supposed to be turned alike and by a rotation."""
    turns = [
        rotation(found.value(f"{name}_turn")) @ base
        for name, base in (("gyro", found.supposed.gyro), ("accel", found.supposed.accelerometer))
    ]
    same = np.abs(turns[0] - turns[1]).max() < ROUNDING
    if not same or np.abs(turns[0] - np.eye(3)).max() < ROUNDING or np.linalg.det(turns[0]) < 0:
        return None
    left, _, right = np.linalg.svd(turns[0].T @ found.model.mounting)
    nearest: Array = left @ right
    return nearest


def _jets(vehicle: Vehicle, found: Fitted, fired: list[int]) -> dict[int, Jet]:
    """Those that are not as stated."""
    model = found.model
    force = model.wrench(found.x)[1]
    position = model.position + found.value("position").reshape(-1, 3)
    rise, fall = (2 * float(found.value(ramp)[0]) * vehicle.cycle.period_s for ramp in ("rise", "fall"))
    mended = {}
    for i, jet in enumerate(vehicle.jets):
        changed: dict[str, Any] = {}
        if i in fired:
            at = fired.index(i)
            if np.any(force[at] != model.force[at]):
                changed["force_n"] = _vector(force[at])
            if np.any(position[at] != model.position[at]):
                changed["position_m"] = _vector(position[at])
        if rise != 0:
            changed["rise_s"] = max(jet.rise_s + rise, 0.0)
        if fall != 0:
            changed["fall_s"] = max(jet.fall_s + fall, 0.0)
        if changed:
            mended[i] = jet.model_copy(update=changed)
    return mended


def _with_jets(vehicle: Resolved, changed: dict[int, Jet]) -> Resolved:
    jets = tuple(changed.get(i, jet) for i, jet in enumerate(vehicle.jets))
    return Resolved.model_construct(**{**dict(vehicle), "jets": jets}) if changed else vehicle


def _tilted(vehicle: Vehicle, tilt: Array) -> tuple[float, ...]:
    """The attitude at the start with its vertical moved by so much of what was level then (:mod:`massprop_cli.diagnosis.channelwise`)."""
    first = np.array(vehicle.environment.initial_attitude_wxyz)
    up = world_up_b(first)
    # u + δ = u turned by u × δ, so the body turns by the opposite
    turn = quaternion_of(-np.cross(up, tilt @ level_of(up)))
    return tuple(float(value) for value in quaternion_product(first, turn))


def _vector(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def cure_of(case: Case, mended: Case, found: Fitted) -> Cure | None:
    """The keys that mend it, and factors on columns; None where neither does."""
    settings = [f"jets.{i}.{key}={_literal(value)}" for i, key, value in _jet_keys(case.vehicle, mended.vehicle)]
    for section, keys in (
        ("imu", ("clock_drift_ppm", "gyro_lag_s", "accel_lag_s", "position_m", "body_from_imu")),
        ("environment", ("bearing_position_m", "initial_attitude_wxyz")),
        ("thrust", ("droop", "cycle_droop")),
    ):
        for key in keys:
            before, after = (getattr(getattr(one.vehicle, section), key) for one in (case, mended))
            if before != after:
                settings.append(f"{section}.{key}={_literal(after)}")
    period = case.vehicle.cycle.period_s
    for name, at, key in (("delay", 0, "cycle.command_delay"), ("lag", 1, "thrust.lag")):
        if mended.timing[at] != case.timing[at]:
            unit, suffix = (1.0, "cycles") if name == "delay" else (period, "s")
            sigma = float(found.sigma(name)[0]) * unit
            settings += [f"{key}_{suffix}={mended.timing[at] * unit:.9g}", f"{key}_sigma_{suffix}={sigma:.3g}"]
    get = found.value
    for sensor in ("gyro", "accel"):
        if get(f"{sensor}_lag").any():
            settings.append(f"imu.{sensor}_lag_sigma_s={float(found.sigma(f'{sensor}_lag')[0]) * period:.3g}")
    for name, key in SIGMAS.items():
        if get(name).any():
            settings.append(f"{key}={float(np.abs(get(name)).max()):.3g}")
    if get("torque").any():
        settings.append(f"environment.disturbance_walk_n_m={PART * float(np.abs(get('torque')).max()):.3g}")
    if get("mass_rate").any() or get("inertia_rate").any():
        settings += _drifts(case, found)
    cure = replace(_on_columns(found), settings=tuple(settings), command=_command(case, found))
    return None if cure == Cure() else cure


def around(case: Case, found: Fitted, fired: IntArray) -> tuple[Cure, ...]:
    """The cure with each unknown one sigma further on, but for those whose sigma the vehicle file itself can state."""
    stated = np.zeros(len(found.x), dtype=bool)
    for name in STATED:
        stated[found.model.place(name)] = True
    cures = []
    for move, sigma in zip(found.supposed.free.T, found.spread, strict=True):
        further = replace(found, x=found.x + sigma * move)
        then = None if at_once(found) or move[stated].any() else applied(case, further, fired)
        cure = None if then is None else cure_of(case, then, further)
        cures += [] if cure is None else [cure]
    return tuple(cures)


def skewed(cure: Cure | None, found: Fitted) -> tuple[Cure, ...]:
    """The cure with each pair of the gyro's axes out of square by as much as all are found to be turned, where that is little.

    An axis that leans over turns and shears; the turn is what is found, and the shear is taken on by the inertia, unseen.
    """
    size = float(np.linalg.norm(found.value("gyro_turn")))
    if cure is None or not 0 < size < SKEWED:
        return ()
    shears = [np.eye(3) + size * (np.outer(a, b) + np.outer(b, a)) for a, b in itertools.combinations(np.eye(3), 2)]
    return tuple(cure.followed_by(Cure(gyro=_rows(shear))) for shear in shears)


def at_once(found: Fitted) -> bool:
    """Whether it says of channels that they are dead or push the other way round, and nothing else."""
    return found.supposed.code == "thrust-scale" and bool((np.abs(found.factors[:, None] - [-1.0, 0.0]).min(1) < NEAR).all())


def drift_ppm(case: Case, found: Fitted) -> float:
    """By how much more than stated the IMU's clock is supposed to run faster than that of the commands."""
    cycles = float(found.value("drift")[0])
    return 1e6 * cycles * case.vehicle.cycle.period_s / found.model.clock_s[1]


def _command(case: Case, found: Fitted) -> tuple[float, ...]:
    if case.log.command_kind != "wrench":
        return ()
    command = np.ones(6)
    wrench = np.concatenate([found.model.couple, found.model.force], 1)
    command[np.abs(wrench).argmax(1)] = found.value("thrust")
    return tuple(float(f) for f in command) if (command != 1).any() else ()


def _drifts(case: Case, found: Fitted) -> list[str]:
    """Random walks that let mass and inertia change as much as they are supposed to."""
    span = float(np.ptp(case.log.time_s)) or 1.0
    mass = abs(float(found.value("mass_rate")[0])) / found.x[9]
    return [f"drift.mass={mass / np.sqrt(span):.3g}"]


def _jet_keys(before: Vehicle, after: Vehicle) -> list[tuple[int, str, Any]]:
    keys = ("force_n", "position_m", "rise_s", "fall_s")
    pairs = enumerate(zip(before.jets, after.jets, strict=True))
    return [(i, key, getattr(other, key)) for i, (one, other) in pairs for key in keys if getattr(one, key) != getattr(other, key)]


def shown(time_s: float) -> str:
    """A time of the log to a microsecond, however far from 0 it is."""
    return f"{time_s:.6f}".rstrip("0").rstrip(".")


def _literal(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_literal(part) for part in value) + "]"
    return f"{round(value, 12) + 0.0:.9g}"
