"""Recordings in other units, axes and frames than their vehicle file says, of sensors that change, and of commands that were others."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from case_kind import Columns, Flown, Kind, Made, Random, stacked, step_s

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.rigidbody import rotation
from massprop_cli.inputs.columns import ACCEL, DELTA_THETA, DELTA_V, GYRO, QUATERNION, TIME, WRENCH
from massprop_cli.inputs.equipment import EnvironmentKind
from massprop_cli.inputs.vehicle import Vehicle

DEGREE, GRAVITY = np.pi / 180, 9.80665


def _times(columns: Columns, names: Sequence[str], factor: float | Array) -> Columns:
    return {name: values * factor if name in names else values for name, values in columns.items()}


def _scaled(columns: Columns, vehicle: Vehicle, _: Random, names: Sequence[str], factor: float) -> Made:
    return Made(_times(columns, names, factor), vehicle, f"{factor:.4g}")


def _degrees_and_g(columns: Columns, vehicle: Vehicle, _: Random) -> Made:
    return Made(_times(_times(columns, DELTA_THETA, 1 / DEGREE), DELTA_V, 1 / GRAVITY), vehicle, "")


def _one_axis(columns: Columns, vehicle: Vehicle, rng: Random, names: Sequence[str], factor: float) -> Made:
    some = rng.choice(names, int(rng.integers(1, 3)), replace=False).tolist()
    return Made(_times(columns, some, factor), vehicle, ", ".join(some))


def _rates_as_increments(columns: Columns, vehicle: Vehicle, _: Random, names: Sequence[str]) -> Made:
    return Made(_times(columns, names, 1 / step_s(columns)), vehicle, f"{step_s(columns):g} s")


def _increments_as_rates(columns: Columns, vehicle: Vehicle, _: Random) -> Made:
    names = dict(zip((*DELTA_THETA, *DELTA_V), (*GYRO, *ACCEL), strict=True))
    return Made({names.get(name, name): values for name, values in columns.items()}, vehicle, f"{step_s(columns):g} s")


def _from(columns: Columns, rng: Random) -> tuple[BoolArray, str]:
    """(n,) the rows from a random moment on."""
    count = len(columns[TIME])
    at = int(rng.uniform(0.3, 0.7) * count)
    return np.arange(count) >= at, f"from row {at} of {count}"


def _unit_changes(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    late, what = _from(columns, rng)
    names, factor = (DELTA_THETA, 1 / DEGREE) if rng.random() < 0.5 else (DELTA_V, 1 / GRAVITY)
    return Made(_times(columns, names, np.where(late, factor, 1.0)), vehicle, f"{names[0]} {what}")


def _by_records(columns: Columns, vehicle: Vehicle, _: Random) -> Made:
    """Velocity increments in the axes at the start of each record."""
    turned, velocity = (np.stack([columns[name] for name in names], 1) for names in (DELTA_THETA, DELTA_V))
    seen = (rotation(turned / 2) @ velocity[..., None])[..., 0]
    return Made(columns | dict(zip(DELTA_V, seen.T, strict=True)), vehicle, f"{np.abs(turned).max():.2g} rad")


def _other_imu(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    """An IMU at another place from a random moment on."""
    late, what = _from(columns, rng)
    mounting, lasting = np.array(vehicle.imu.body_from_imu), step_s(columns)
    rate = np.stack([columns[name] for name in DELTA_THETA], 1) @ mounting.T / lasting
    size = max(float(np.linalg.norm(vehicle.imu.position_m)), 0.03)
    arm = rng.normal(size=3) * 0.3 * size
    more = np.cross(np.gradient(rate, lasting, axis=0), arm) + np.cross(rate, np.cross(rate, arm))
    seen = np.stack([columns[name] for name in DELTA_V], 1) + (more * lasting * late[:, None]) @ mounting
    return Made(columns | dict(zip(DELTA_V, seen.T, strict=True)), vehicle, f"{1e3 * np.linalg.norm(arm):.3g} mm {what}")


def _frozen(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    """One sensor repeats a reading while it starts."""
    count = len(columns[TIME])
    names = DELTA_THETA if rng.random() < 0.5 else DELTA_V
    until = int(rng.uniform(0.02, 0.1) * count)
    changed = {name: values.copy() for name, values in columns.items()}
    for name in names:
        changed[name][:until] = changed[name][until]
    return Made(changed, vehicle, f"{names[0]} until row {until} of {count}")


def _held(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    """A logger that writes the latest reading of a slower sensor."""
    names, times = DELTA_THETA if rng.random() < 0.5 else DELTA_V, int(rng.integers(2, 5))
    changed = {name: values[np.arange(len(values)) // times * times] if name in names else values for name, values in columns.items()}
    return Made(changed, vehicle, f"{names[0]}, each reading {times} times")


def _elsewhere(columns: Columns, vehicle: Vehicle, _: Random, stated: EnvironmentKind) -> Made | None:
    """Recorded on the ground and stated to be free, or the reverse."""
    if (vehicle.environment.kind == "free") == (stated == "free"):
        return None
    environment = vehicle.environment.model_copy(update={"kind": stated})
    what = vehicle.environment.kind if stated == "free" else ""
    return Made(columns, vehicle.model_copy(update={"environment": environment}), what)


def _commanded(columns: Columns, vehicle: Vehicle, rng: Random, change: Callable[..., tuple[Array, str]], **more: Any) -> Made | None:
    """A log with other commands, of a vehicle that is commanded by a wrench."""
    command = stacked(columns, WRENCH)
    if command is None:
        return None
    changed, what = change(command, rng, **more)
    return Made(columns | dict(zip(WRENCH, changed.T, strict=True)), vehicle, what)


def _about(command: Array, rng: Random, flown: Flown, exactly: bool) -> tuple[Array, str]:
    """Torques about the CG, or about the controller's point."""
    point = flown.truth[0][6:9] * (1.0 if exactly else rng.uniform(0.3, 0.7, 3))
    torque = command[:, :3] - np.cross(point, command[:, 3:])
    return np.hstack([torque, command[:, 3:]]), f"{1e3 * np.linalg.norm(point):.3g} mm"


def _turned(command: Array, rng: Random) -> tuple[Array, str]:
    """Commands in another axis convention, such as forward-right-down for forward-left-up."""
    about = int(rng.integers(3))
    return command * np.tile(np.where(np.arange(3) == about, 1.0, -1.0), 2), f"about {'XYZ'[about]}"


def _milli(command: Array, _: Random) -> tuple[Array, str]:
    return command * np.repeat([1e3, 1.0], 3), ""


def _normalised(command: Array, rng: Random) -> tuple[Array, str]:
    which = slice(0, 3) if rng.random() < 0.7 else slice(0, 6)
    most = np.nanmax(np.abs(command), 0)  # a command stands in the first of its cycle's rows alone
    command[:, which] /= np.where(most > 0, most, 1.0)[which]
    return command, f"{which.stop} components"


def _saturated(command: Array, rng: Random) -> tuple[Array, str]:
    """More is commanded than acts: what is logged are peaks that the allocation cuts off."""
    part = float(rng.uniform(0.6, 0.9))
    largest = np.nanmax(np.abs(command), 0)
    peaks = (np.abs(command) > 0.999 * largest) & (rng.random(command.shape) < 0.4) & (largest > 0)
    return np.where(peaks, command / part, command), f"{part:.0%}"


def _wrench(what: str, *codes: str, knowing: bool = False, **change: Any) -> Kind:
    """A kind of recording with other commands."""
    return Kind(what, partial(_commanded, **change), codes, knowing=knowing)


def _jets_round(columns: Columns, vehicle: Vehicle, rng: Random) -> Made | None:
    names = [name for name in columns if name.startswith("jet_")]
    if len(names) < 3:
        return None
    which = rng.choice(names, 3, replace=False).tolist()
    return Made(columns | {a: columns[b] for a, b in zip(which, [*which[1:], which[0]], strict=True)}, vehicle, ", ".join(which))


def _with_attitude(columns: Columns, vehicle: Vehicle, rng: Random, what: str) -> Made | None:
    """In another convention: NED and forward-right-down, xyzw, body from world, late."""
    told = stacked(columns, QUATERNION)
    if told is None:
        return None
    w, x, y, z = told.T
    late = int(rng.integers(1, 4))
    changed = {
        "ned": np.stack([w, x, -y, -z], 1),
        "xyzw": told[:, [1, 2, 3, 0]],
        "inverse": np.stack([w, -x, -y, -z], 1),
        "late": np.concatenate([np.repeat(told[:1], late, 0), told[:-late]]),
    }[what]
    return Made(columns | dict(zip(QUATERNION, changed.T, strict=True)), vehicle, f"{late} records" if what == "late" else "")


UNITS, MISFIT = ("gyro-units", "accel-units"), ("attitude-misfit",)
KINDS = {
    "gyro-degrees": Kind("gyro in degrees", partial(_scaled, names=DELTA_THETA, factor=1 / DEGREE), UNITS),
    "gyro-axis-degrees": Kind("one or two axes of it", partial(_one_axis, names=DELTA_THETA, factor=1 / DEGREE), UNITS),
    "accel-g": Kind("accelerometer in g", partial(_scaled, names=DELTA_V, factor=1 / GRAVITY), UNITS, ("unit", "gravity")),
    "accel-axis-g": Kind("one or two axes of it", partial(_one_axis, names=DELTA_V, factor=1 / GRAVITY), UNITS, ("unit", "gravity")),
    "degrees-and-g": Kind("gyro in degrees and accelerometer in g", _degrees_and_g, UNITS, ("unit", "gravity")),
    "rates-in-increments": Kind(
        "rates in columns of increments", partial(_rates_as_increments, names=(*DELTA_THETA, *DELTA_V)), ("column-kind",), ("rates",)
    ),
    "gyro-rates": Kind("the gyro's alone", partial(_rates_as_increments, names=DELTA_THETA), ("column-kind",), ("rates",)),
    "accel-rates": Kind("the accelerometer's alone", partial(_rates_as_increments, names=DELTA_V), ("column-kind",), ("rates",)),
    "increments-in-rates": Kind("increments in columns of rates", _increments_as_rates, ("column-kind",), ("increments",)),
    "unit-changes": Kind("another unit from some moment on", _unit_changes, (*UNITS, "mass-change", "cause-unknown", "outliers")),
    "delta-v-start": Kind("velocity increments in the axes of each record's start", _by_records, ("accel-axes",)),
    "other-imu": Kind("another IMU, some way off, from some moment on", _other_imu, ("imu-position", "mass-change", "cause-unknown")),
    "held": Kind("a slower sensor's latest reading in every record", _held, ("readings-held",)),
    "frozen": Kind("a sensor repeats a reading while it starts", _frozen, ("sensor-frozen", "phase-border")),
    "grounded": Kind("on the ground, stated to be free", partial(_elsewhere, stated="free"), ("gravity-felt",)),
    "afloat": Kind("free, stated to be on a bearing", partial(_elsewhere, stated="air_bearing"), (), ("gravity",)),
    "wrench-about-cg": _wrench("torques about the CG", "wrench-point", change=_about, exactly=True, knowing=True),
    "wrench-about-point": _wrench(
        "torques about another point", "wrench-point", "imu-position", change=_about, exactly=False, knowing=True
    ),
    "commands-turned": _wrench("commands in axes turned by 180 degrees about X, Y or Z", "command-sign", change=_turned),
    "torques-milli": _wrench("torques in mN m, forces in N", "thrust-scale", "known-mismatch", "unphysical-inertia", change=_milli),
    "normalised": _wrench("commands over their largest value", "commands-normalised", change=_normalised),
    "saturated": _wrench("commands that the allocation cut off", "commands-limited", change=_saturated),
    "jets-round": Kind("three jets wired round", _jets_round, ("jets-swapped",)),
    "attitude-ned": Kind("attitude in NED and forward-right-down", partial(_with_attitude, what="ned"), MISFIT),
    "attitude-xyzw": Kind("attitude as xyzw", partial(_with_attitude, what="xyzw"), MISFIT, ("quat",)),
    "attitude-inverse": Kind("attitude body from world", partial(_with_attitude, what="inverse"), MISFIT),
    "attitude-late": Kind("attitude late by 1 to 3 records", partial(_with_attitude, what="late"), MISFIT),
}
