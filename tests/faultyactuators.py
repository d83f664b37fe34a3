"""Wheels, control moment gyros and rotors that are not as stated, on random vehicles.

The simulators that fly them share no code with massprop.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from massprop_cli import ABOUT_PIVOT, QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anypedestal, anyrotors

PERIOD_S = 0.05
Data = dict[str, Any]
"""A vehicle file."""
TABLES = {"rotors": "rotors", "wheels": "wheels", "pedestal, wheels": "wheels", "gyros": "control_moment_gyros"}
"""Of the vehicle file, by platform."""


class Subject(NamedTuple):
    """A flight, and its vehicle file without the fault."""

    own: Any
    flown: anypedestal.Flown
    stated: Data
    table: str
    truth: dict[str, float]


class Fault(NamedTuple):
    """One of them."""

    what: str
    codes: tuple[str, ...]
    """That name it."""
    state: Callable[[Subject, np.random.Generator], Subject] | None = None
    """What is stated or logged of it; None: nothing else."""
    acting: Callable[[np.random.Generator, int], Array] | None = None
    """(n,) part that each of n actuators really does of what is logged of it."""
    platforms: tuple[str, ...] = tuple(TABLES)


def flights(platform: str, seed: int, count: int, fault: Fault, cycles: int = 600) -> list[Subject]:
    """So many vehicles, flown."""
    rng, draw = np.random.default_rng([seed, list(TABLES).index(platform)]), np.random.default_rng(seed)
    n = anyrotors.ROTORS if platform == "rotors" else 4
    acting = np.array([np.ones(n) if fault.acting is None else fault.acting(draw, n) for _ in range(count)])
    if platform == "rotors":
        own = anyrotors.multicopters(rng, count)
        flown = anyrotors.fly(rng, replace(own, axis=acting[..., None] * own.axis), PERIOD_S / 4, cycles)
        return [_subject(own, i, flown, anyrotors.vehicle_of(own, i, flown), "rotors", own.ten[i], QUANTITIES) for i in range(count)]
    free, kind = platform != "pedestal, wheels", anypedestal.GYROS if platform == "gyros" else anypedestal.WHEELS
    tables = anypedestal.tables(rng, count)
    tables = replace(tables, pivot=tables.cg) if free else tables
    flown = anypedestal.fly(rng, tables, kind, PERIOD_S, cycles * PERIOD_S, 0.0 if free else anypedestal.GRAVITY, acting)
    found = []
    for i in range(count):
        names, values = (QUANTITIES, tables.ten[i]) if free else (ABOUT_PIVOT, tables.nine[i])
        one = _subject(tables, i, flown, anypedestal.vehicle_of(tables, i, flown), TABLES[platform], values, names)
        found.append(one._replace(stated=one.stated | ({"environment": {"kind": "free"}} if free else {})))
    return found


def _subject(own: Any, i: int, flown: anypedestal.Flown, used: Vehicle, table: str, values: Array, names: Sequence[str]) -> Subject:
    parts = {key: getattr(flown, key)[i : i + 1] for key in ("turned", "pushed", "issued", "attitude")}
    alone = replace(own, **{one.name: getattr(own, one.name)[i : i + 1] for one in fields(own)})
    return Subject(alone, replace(flown, **parts), _data(used), table, dict(zip(names, values.tolist(), strict=True)))


def _data(vehicle: Vehicle) -> Data:
    found: Data = vehicle.model_dump(by_alias=True, exclude_unset=True, mode="json")
    return found


def _logged(of: Subject, change: Callable[[Array], Array]) -> Subject:
    """With other columns of its actuators, (K, n)."""
    return of._replace(flown=replace(of.flown, issued=change(of.flown.issued[0])[None]))


def _stated(of: Subject, change: Callable[[list[Data]], list[Data]]) -> Subject:
    data = {**of.stated, of.table: change([dict(one) for one in of.stated[of.table]])}
    return of._replace(stated=data)


def _permuted(of: Subject, draw: np.random.Generator, count: int) -> Subject:
    chosen = draw.permutation(of.flown.issued.shape[2])[:count]

    def change(columns: Array) -> Array:
        found = columns.copy()
        found[:, chosen] = columns[:, np.roll(chosen, 1)]
        return found

    return _logged(of, change)


def _one(draw: np.random.Generator, count: int, part: float) -> Array:
    found = np.ones(count)
    found[draw.integers(count)] = part
    return found


def _in_rpm(of: Subject, draw: np.random.Generator) -> Subject:
    one = int(draw.integers(of.flown.issued.shape[2]))
    return _logged(of, lambda columns: columns * np.where(np.arange(columns.shape[1]) == one, 30 / np.pi, 1.0))


def _in_degrees(of: Subject, draw: np.random.Generator, every: bool = True) -> Subject:
    one = int(draw.integers(of.flown.issued.shape[2]))
    return _logged(of, lambda columns: columns * np.where(every | (np.arange(columns.shape[1]) == one), 180 / np.pi, 1.0))


def _in_percent(of: Subject, _: np.random.Generator) -> Subject:
    return _logged(of, lambda columns: 100 * columns)


def _spin(of: Subject, draw: np.random.Generator, every: bool = False) -> Subject:
    def change(own: list[Data]) -> list[Data]:
        one = own[draw.integers(len(own))]
        return [each | {"spin": -each["spin"]} if every or each is one else each for each in own]

    return _stated(of, change)


def _reversed(of: Subject, draw: np.random.Generator) -> Subject:
    """Its axis, or that of its gimbal, points the other way."""
    key = "gimbal_axis" if of.table == "control_moment_gyros" else "axis"

    def change(own: list[Data]) -> list[Data]:
        one = own[draw.integers(len(own))]
        return [each | {key: [-part for part in each[key]]} if each is one else each for each in own]

    return _stated(of, change)


def _leaning(of: Subject, draw: np.random.Generator, every: bool = False) -> Subject:
    """Axes, one or all, stated 0.3 to 1.5 degrees away from what they are; of a gyro both, turned alike."""

    def turned(each: Data) -> Data:
        keys = [key for key in ("axis", "gimbal_axis", "spin_axis") if key in each]
        across = np.cross(each[keys[0]], draw.normal(size=3))
        turn = rotation(np.radians(draw.uniform(0.3, 1.5)) * across / np.linalg.norm(across))
        return each | {key: (turn @ each[key]).tolist() for key in keys}

    def change(own: list[Data]) -> list[Data]:
        one = own[draw.integers(len(own))]
        return [turned(each) if every or each is one else each for each in own]

    return _stated(of, change)


def _late(of: Subject, draw: np.random.Generator) -> Subject:
    """By 0.2 to 1 cycle, later than said."""
    by = draw.uniform(0.2, 1.0)

    def change(columns: Array) -> Array:
        at = np.arange(len(columns))
        return np.stack([np.interp(at - by, at, column) for column in columns.T], 1)

    return _logged(of, change)


def _delayed(of: Subject, _: np.random.Generator) -> Subject:
    """Commands that act a cycle later than stated."""
    return of._replace(stated=of.stated | {"cycle": of.stated["cycle"] | {"command_delay_cycles": 0.0}})


def _lagging(of: Subject, draw: np.random.Generator) -> Subject:
    by = float(draw.uniform(0.3, 0.7))
    return _stated(of, lambda own: [each | {"lag_up_s": by * each["lag_up_s"]} for each in own])


def _sagging(of: Subject, draw: np.random.Generator) -> Subject:
    """Commands count less and less, by 10 to 25 % in the end; no voltage is logged."""
    by = draw.uniform(0.1, 0.25)
    return _logged(of, lambda columns: columns / (1 - by * np.linspace(0, 1, len(columns)))[:, None])


SIGN, SCALE, SWAPPED = ("command-sign",), ("thrust-scale",), ("actuators-swapped",)
FAULTS = {
    "none": Fault("nothing", ()),
    "sign": Fault("one stated the other way round", SIGN, _reversed),
    "spin": Fault("one propeller that is stated to turn the other way", ("rotor-spin",), _spin, platforms=("rotors",)),
    "spins": Fault("all propellers turn the other way", ("rotor-spin",), partial(_spin, every=True), platforms=("rotors",)),
    "percent": Fault("commands in percent", ("command-units",), _in_percent, platforms=("rotors",)),
    "swapped": Fault("two swapped", SWAPPED, lambda of, draw: _permuted(of, draw, 2)),
    "round": Fault("three wired round", SWAPPED, lambda of, draw: _permuted(of, draw, 3)),
    "rpm": Fault("one speed in rpm", ("speed-units",), _in_rpm, platforms=("wheels", "pedestal, wheels")),
    "axis": Fault("one axis 0.3 to 1.5 degrees off", ("wheel-axis",), _leaning, platforms=tuple(TABLES)[1:]),
    "axes": Fault("all axes so", ("wheel-axis",), partial(_leaning, every=True), platforms=tuple(TABLES)[1:]),
    "degrees": Fault("all gimbal angles in degrees", ("gimbal-units",), _in_degrees, platforms=("gyros",)),
    "one in degrees": Fault("one gimbal's angles in degrees", ("gimbal-units",), partial(_in_degrees, every=False), platforms=("gyros",)),
    "strong": Fault("one gives 10 % more", SCALE, acting=lambda draw, n: _one(draw, n, 1.1)),
    "weak": Fault("one gives 10 % less", SCALE, acting=lambda draw, n: _one(draw, n, 0.9)),
    "dead": Fault("one dead", ("actuator-dead",), acting=lambda draw, n: _one(draw, n, 0.0)),
    "late": Fault("speeds or angles logged 0.2 to 1 cycle late", ("speed-late",), _late, platforms=tuple(TABLES)[1:]),
    "delayed": Fault("commands act a cycle later than stated", ("delay-mismatch",), _delayed, platforms=("rotors",)),
    "lag": Fault("lag stated at 0.3 to 0.7 of what it is", ("lag-mismatch", "thrust-lag"), _lagging, platforms=("rotors",)),
    "sag": Fault("thrust that sags with the supply", ("fuel-use", "supply-sag"), _sagging, platforms=("rotors",)),
}


def flown(platform: str, name: str, seed: int = 0, cycles: int = 600) -> Subject:
    """One vehicle with a fault."""
    (begun,), fault = flights(platform, seed, 1, FAULTS[name], cycles), FAULTS[name]
    return begun if fault.state is None else fault.state(begun, np.random.default_rng([seed, 0, 7]))


def examined(platform: str, name: str, seed: int = 0) -> flow.Analysis:
    """What massprop says of it."""
    return examination(flown(platform, name, seed), np.random.default_rng([seed, 0, 3]))


def examination(of: Subject, draw: np.random.Generator) -> flow.Analysis:
    """What massprop says of a log, whose noise is drawn."""
    vehicle = Vehicle.model_validate(of.stated)
    with np.errstate(all="ignore"):
        return flow.examine(anypedestal.log_of(draw, of.own, 0, of.flown, vehicle), VehicleSource(vehicle, "", ""))
