"""A draft of the map file. What names, recorded units and clocks settle is filled in, with the reason; all else is a question.

A question is written "?", which no reader of the map takes, so that nothing is guessed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import listing, units
from massprop_cli.inputs.formats.recording import Recording
from massprop_cli.inputs.formats.vectors import Vector, vectors

_NOT = re.compile(r"bias|offset|varian|covar|std|setpoint|desired|error|temperature|\bmag|filtered_out|limit|noise", re.IGNORECASE)
_MANY = 8
_RECORDS = 10
"""Records of a control cycle; more tell hardly more."""
_LONG_AGO_S = 1e6
"""A clock beyond this counts from no beginning of a recording."""


@dataclass(frozen=True)
class _Quantity:
    """How a vector is known."""

    key: str
    called: re.Pattern[str]
    rates: Mapping[str, float]
    increments: Mapping[str, float]


_SENSORS = (
    _Quantity(
        "gyro",
        re.compile(r"gyro?|ang(ular)?_?(vel|rate)|omega|delta_(theta|ang)|body_?rate|/xyz$|^w\*|/w\*|^\*$", re.IGNORECASE),
        units.RATE,
        units.ANGLE,
    ),
    _Quantity("accelerometer", re.compile(r"acc|specific_?force|delta_?v|^a\*|/a\*", re.IGNORECASE), units.ACCELERATION, units.SPEED),
)
_COMMANDS = (
    _Quantity("torque", re.compile(r"torque|moment|tau|^m\*|^t\*", re.IGNORECASE), units.TORQUE, {}),
    _Quantity("force", re.compile(r"force(?!.*specific)|thrust|^f\*|/f\*", re.IGNORECASE), units.FORCE, {}),
)
_VALUES = {
    "sensor_combined": ("mean", "PX4 averages over the interval before"),
    "vehicle_angular_velocity": ("sample", "PX4's filtered rate at its time"),
    "vehicle_acceleration": ("sample", "PX4's filtered acceleration at its time"),
    "angular_velocity": ("sample", "a sensor_msgs/Imu is of its stamp"),
    "linear_acceleration": ("sample", "a sensor_msgs/Imu is of its stamp"),
}
"""What a number is, where a standard says so."""
_ASK_VALUES = '"sample": the rate at its time; "mean": since the one before; "increment": the change since the one before'


def draft(read: Recording) -> str:
    """The text of a map file, with its questions."""
    found, clocks = vectors(read), listing.Clocks(read)
    chosen: dict[str, Vector] = {}
    lines = ["schema = 1", f'# drafted from {read.path.name} ({read.kind}); answer every "?", and drop what is not wanted', ""]
    for quantity in _SENSORS:
        lines += _section(clocks, quantity, found, chosen)
    jets = [path for path in read.streams if re.fullmatch(r"jet_.+_s", listing.leaf(path))]
    if jets:
        for path in jets:
            lines += _jet(clocks, path)
    else:
        for quantity in _COMMANDS:
            lines += _section(clocks, quantity, found, chosen)
        lines += _valves(read)
    lines += _attitude(clocks, found)
    lines = _one_clock(lines) + _records(clocks, chosen, jets)
    return "\n".join(lines) + "\n"


def _one_clock(lines: list[str]) -> list[str]:
    """A clock that every table would repeat stands once, at the top."""
    tables = sum(line.startswith("[") for line in lines)
    said = [line for line in lines if line.startswith("clock = ")]
    if len(said) < 2 or len(said) < tables or len(set(said)) > 1:
        return lines
    return [*lines[:2], said[0], *(line for line in lines[2:] if line != said[0])]


def questions(text: str) -> int:
    """How many a draft has."""
    return sum(line.partition("#")[0].count('"?"') > 0 for line in text.splitlines())


def _section(clocks: listing.Clocks, quantity: _Quantity, found: Sequence[Vector], chosen: dict[str, Vector]) -> list[str]:
    known = {**quantity.rates, **quantity.increments}
    candidates = [v for v in found if len(v.streams) == 3 and _may_be(quantity, v, known)]
    by_unit = [v for v in candidates if units.factor(v.streams[0].unit, known) is not None]
    candidates = by_unit or candidates
    lines = [f"[{quantity.key}]"]
    if len(candidates) != 1:
        some = [f"#   {json.dumps(v.paths, ensure_ascii=False)}{_said(clocks, v)}" for v in candidates[:_MANY]]
        why = (
            f"{len(candidates)} could be it; take one of"
            if candidates
            else "nothing is called so; three paths of massprop columns, or numbers"
        )
        return [*lines, f"# {why}", *some, 'paths = ["?", "?", "?"]', *_no_vector(quantity), ""]
    vector = candidates[0]
    chosen[quantity.key] = vector
    lines.append(f"paths = {json.dumps(vector.paths, ensure_ascii=False)}{_said(clocks, vector)}")
    lines += _clock(clocks, vector.paths[0])
    return [*lines, *(_sensor(quantity, vector) if quantity in _SENSORS else _wrench(quantity, vector)), ""]


def _may_be(quantity: _Quantity, vector: Vector, known: Mapping[str, float]) -> bool:
    unit = vector.streams[0].unit
    if units.is_any(unit):
        return units.factor(unit, known) is not None and not _NOT.search(vector.stem)
    others = [other for other in (*_SENSORS, *_COMMANDS) if other is not quantity and other.called.search(vector.stem)]
    by_axes = quantity.key == "gyro" and vector.axes == "pqr"
    return (by_axes or (bool(quantity.called.search(vector.stem)) and not others)) and not _NOT.search(vector.stem)


def _no_vector(quantity: _Quantity) -> list[str]:
    return (
        ['unit = "?"', f'values = "?"   # {_ASK_VALUES}'] if quantity in _SENSORS else ['unit = "?"', 'frame = "?"   # "body" or "world"']
    )


def _said(clocks: listing.Clocks, vector: Vector) -> str:
    rate = clocks.rate_hz(vector.streams[0])
    parts = [
        f"{vector.streams[0].rows} samples",
        *([f"{rate:.6g} Hz"] if rate else []),
        *([vector.streams[0].unit] * bool(vector.streams[0].unit)),
    ]
    return f"   # {', '.join(parts)}"


def _values_of(vector: Vector) -> list[Array]:
    values = [np.asarray(one.values, np.float64) for one in vector.streams]
    held = np.isfinite(values).all(0)
    return [each[held] for each in values]


def _sensor(quantity: _Quantity, vector: Vector) -> list[str]:
    lines = []
    unit = vector.streams[0].unit
    known = (*columns.DELTA_THETA, *columns.DELTA_V, *columns.GYRO, *columns.ACCEL)
    contract = [name for name in known if listing.leaf(vector.paths[0]) == name]
    increments = units.factor(unit, quantity.increments) is not None
    if contract:
        increments = contract[0].startswith("delta")
        unit = next(iter(quantity.increments if increments else quantity.rates))
        lines.append(f'unit = "{unit}"   # by its name')
    elif units.factor(unit, {**quantity.rates, **quantity.increments}) is None:
        lines.append(_unit(quantity, vector))
    named = next((said for name, said in _VALUES.items() if name in vector.stem), None)
    if increments:
        lines.append('values = "increment"   # by its unit')
    elif contract:
        lines.append('values = "mean"   # by its name')
    elif named:
        lines.append(f'values = "{named[0]}"   # {named[1]}')
    else:
        lines.append(f'values = "?"   # {_ASK_VALUES}')
    return lines


def _unit(quantity: _Quantity, vector: Vector) -> str:
    """What the numbers themselves settle: only gravity does."""
    values = _values_of(vector)
    size = listing.median_size(values)
    choices = " or ".join([*quantity.rates, *quantity.increments])
    if quantity.key == "accelerometer":
        for unit, gravity in (("m/s^2", units.G), ("g", 1.0), ("mg", 1e3)):
            if abs(size / gravity - 1) < 0.03:
                return f'unit = "{unit}"   # its median size is {size:.4g}: gravity'
    largest = float(np.max(np.abs(values)))
    return f'unit = "?"   # {choices}: not recorded; its median size is {size:.3g}, its largest number {largest:.3g}'


def _wrench(quantity: _Quantity, vector: Vector) -> list[str]:
    if listing.leaf(vector.paths[0]) in columns.WRENCH:
        return [f'unit = "{next(iter(quantity.rates))}"   # by its name', 'frame = "body"   # by its name']
    unit = (
        []
        if units.factor(vector.streams[0].unit, quantity.rates) is not None
        else [f'unit = "?"   # {" or ".join(quantity.rates)}: not recorded']
    )
    return [*unit, 'frame = "?"   # "body", or "world", which wants [attitude]']


def _jet(clocks: listing.Clocks, path: str) -> list[str]:
    name = listing.leaf(path).removeprefix("jet_").removesuffix("_s")
    return [
        f"[jets.{name if re.fullmatch(r'[A-Za-z0-9_-]+', name) else json.dumps(name)}]",
        f"path = {json.dumps(path, ensure_ascii=False)}",
        'unit = "s"   # by its name',
        *_clock(clocks, path),
        "",
    ]


def _valves(read: Recording) -> list[str]:
    """Streams that may command jets, for whoever has those instead of a wrench."""
    called = re.compile(r"jet|valve|thruster|solenoid|actuator|motor|pwm", re.IGNORECASE)
    some = [path for path in read.streams if called.search(path) and listing.leaf(path) not in ("timestamp", "timestamp_sample")]
    if not some:
        return []
    lines = ["# or, instead of [torque] and [force], for each jet of the vehicle file a table such as", "# [jets.NAME]"]
    lines += [f"# path = {json.dumps(path, ensure_ascii=False)}" for path in some[:_MANY]]
    return [*lines, '# unit = "?"   # s, ms, us: on-time of the control cycle; open (0 to 1) or %: the valve\'s state', ""]


def _clock(clocks: listing.Clocks, path: str) -> list[str]:
    """The clock of a stream, where the file doesn't say."""
    stream = clocks.streams[path]
    some = clocks.of(stream)
    if len(some) != 1:
        shown = f"one of {', '.join(json.dumps(one) for one in some[:_MANY])}" if some else "no stream of its length increases throughout"
        return [f'clock = {{ path = "?", unit = "?" }}   # {shown}']
    unit, why = clocks.unit(some[0])
    if unit and why == "as recorded":
        return [] if stream.clock == some[0] else [f"clock = {{ path = {json.dumps(some[0])} }}"]
    if unit:
        return [f'clock = {{ path = {json.dumps(some[0])}, unit = "{unit}" }}   # {why}']
    step = clocks.step(some[0])
    return [f'clock = {{ path = {json.dumps(some[0])}, unit = "?" }}   # s, ms, us or ns: not recorded; its median step is {step:.6g}']


def _attitude(clocks: listing.Clocks, found: Sequence[Vector]) -> list[str]:
    """Optional, so a comment."""
    called = re.compile(r"quat|orient|attitude|\bq\b|q\*|/q\[", re.IGNORECASE)
    some = [v for v in found if len(v.streams) == 4 and called.search(v.stem) and not _NOT.search(v.stem)]
    lines = []
    for vector in some[:_MANY]:
        px4 = vector.stem.startswith("vehicle_attitude")
        order = '"wxyz"' if vector.axes == "wxyz" or px4 else '"?"   # "wxyz" or "xyzw"'
        world = '"z_down"   # PX4: NED' if px4 else '"?"   # "z_up" or "z_down"'
        lines += ["# [attitude]   # optional", f"# paths = {json.dumps(vector.paths, ensure_ascii=False)}{_said(clocks, vector)}"]
        lines += [f"# {line}" for line in _clock(clocks, vector.paths[0])]
        lines += [f"# order = {order}", '# turns = "world_from_body"   # or "body_from_world"', f"# world = {world}", ""]
    return lines


def _records(clocks: listing.Clocks, chosen: Mapping[str, Vector], jets: Sequence[str]) -> list[str]:
    """How rows of the log are to be made, where the streams' clocks differ."""
    sensors = [chosen[key].streams[0] for key in ("gyro", "accelerometer") if key in chosen]
    commands = [chosen[key].streams[0] for key in ("torque", "force") if key in chosen] + [clocks.streams[path] for path in jets[:1]]
    streams = [*sensors, *commands]
    complete = len(sensors) == 2 and bool(commands)
    if complete and len({tuple(clocks.of(one)) for one in streams}) == 1:
        return ["# all on one clock: the file's rows are the log's, and commands change with the first row of a control cycle only"]
    rates = [rate for one in streams if (rate := clocks.rate_hz(one)) is not None]
    if not complete or len(rates) < len(streams):
        return [
            "# where the streams have clocks of their own, they are put on records of one length and on control cycles:",
            "# [records]",
            '# interval_s = "?"   # a record: at least the interval of the slower of gyro and accelerometer',
            '# per_cycle = "?"    # records of a control cycle',
        ]
    lines = ["[records]   # the streams have clocks of their own, and are put on records of one length and on control cycles"]
    slower, commanded = min(rates[:2]), rates[2]
    count = max(1, min(_RECORDS, int(slower / commanded * 1.001)))
    lines.append(f"interval_s = {1 / commanded / count:.9g}   # commands come at {commanded:.6g} Hz, the slower sensor at {slower:.6g} Hz")
    lines.append(f"per_cycle = {count}")
    first = clocks.of(streams[0])[0]
    if float(clocks.streams[first].values[0]) * (units.factor(clocks.unit(first)[0], units.TIME) or 1.0) > _LONG_AGO_S:
        lines.append('zero = "start"   # the clock counts from long ago')
    return lines
