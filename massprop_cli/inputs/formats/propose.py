"""Draft of a map file. Names, units and clocks fill it in, with the reason; the rest are questions, "?", which no reader accepts."""

import json
import re
from collections.abc import Mapping, Sequence

import numpy as np

from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import listing, selection, units
from massprop_cli.inputs.formats.clocks import covered_interval, covers_all, interval_stream
from massprop_cli.inputs.formats.recording import RecordedStream, Recording
from massprop_cli.inputs.formats.vectors import COMMANDS, SENSORS, Vector, VectorName, attitudes, fitting, vectors

_MANY, _ACTUATORS = 8, 64
"""Maximum number of candidates per quantity, and of streams per actuator table; the draft states how many more there are."""
_RECORDS = 10
"""Maximum number of records per control cycle."""
_LONG_AGO_S = 1e6
"""Start of a clock above which it does not start with the recording, s."""
_VALUES = {
    "sensor_combined": ("mean", "PX4 averages over the interval before"),
    "vehicle_angular_velocity": ("sample", "PX4's filtered rate at its time"),
    "vehicle_acceleration": ("sample", "PX4's filtered acceleration at its time"),
    "angular_velocity": ("sample", "a sensor_msgs/Imu is of its stamp"),
    "linear_acceleration": ("sample", "a sensor_msgs/Imu is of its stamp"),
}
"""Meaning of values in standard messages."""
_NO_VALVE = re.compile(r"temp|enable|press|count|status|fault|volt|current", re.IGNORECASE)
"""Names of jet data other than commands."""
_ACTUATOR_NAMES = {
    "jets": re.compile(r"jet|valve|thr(uster)?(?![a-z])|solenoid|actuator|pwm|duty|on_?time", re.IGNORECASE),
    "rotors": re.compile(r"motor|(?<![a-z])fan(?![a-z])", re.IGNORECASE),
    "wheels": re.compile(r"(?<![a-z])(rpm|rw|esc|wheel|rotor|prop)(?![a-z])", re.IGNORECASE),
    "control_moment_gyros": re.compile(r"gimbal|(?<![a-z])cmg(?![a-z])", re.IGNORECASE),
}
"""Names of commands, speeds or angles by actuator table (PX4: ``actuator_motors/control[0]``); the last match counts."""
_TABLES = {
    "jets": (
        "or, instead of [torque] and [force], for each jet",
        "",
        "s, ms, us: on-time of the control cycle; open (0 to 1) or %: the valve's state",
    ),
    "rotors": ("or, instead of [torque] and [force], for each rotor", "", "1 or %: its command; rad/s or rpm: its speed"),
    "wheels": (
        "for each wheel or rotor",
        "   # or [rotors.NAME]",
        "rad/s or rpm: its speed; N m: the torque on a wheel; 1 or %: a rotor's command",
    ),
    "control_moment_gyros": ("for each control moment gyro", "", "rad or deg: the gimbal's angle"),
}
"""Comment on each actuator table of a map: purpose, text after its name, and units."""
_HEADINGS = re.compile(r"(?:.*_)?(?:heading|yaw|psi|azimuth)(?:_?(?:angle|rad|deg))?", re.IGNORECASE)
"""Names of an angle about the vertical."""
_INCREMENTS, _RATES = (*columns.DELTA_THETA, *columns.DELTA_V), (*columns.GYRO, *columns.ACCEL)
_ASK_INCREMENTS = '"increment", by its unit, if each covers all the time since the one before and none was left out when they were logged'
_ASK_VALUES = '"sample": the rate at its time; "mean": since the one before; "increment": the change since the one before'


def draft(read: Recording) -> str:
    """Text of a map file with questions."""
    found, clocks = vectors(read), listing.Clocks(read)
    chosen: dict[str, Vector] = {}
    lines = ["schema = 1", f'# drafted from {read.path.name} ({read.kind}); answer every "?", and drop what is not wanted']
    lines += [*(f"# not read: {one!r} {why}" for one, why in read.unread.items()), ""]
    for quantity in SENSORS:
        lines += _section(clocks, quantity, found, chosen)
    jets = [path for path in read.streams if re.fullmatch(r"jet_.+_s", listing.leaf(path)) and not _NO_VALVE.search(path)]
    if jets:
        for path in jets:
            lines += _jet(clocks, path)
    else:
        for quantity in COMMANDS:
            lines += _section(clocks, quantity, found, chosen)
        lines += _actuators(clocks)
    lines += _attitude(clocks, found)
    lines = _one_clock(lines) + _records(clocks, chosen, jets)
    return "\n".join(lines) + "\n"


def _one_clock(lines: list[str]) -> list[str]:
    """Lines with a clock that all tables share at the top."""
    tables = sum(line.startswith("[") for line in lines)
    clock_lines = [line for line in lines if line.startswith("clock = ")]
    if len(clock_lines) < 2 or len(clock_lines) < tables or len({line.partition("#")[0] for line in clock_lines}) > 1:
        return lines
    return [*lines[:2], clock_lines[0], *(line for line in lines[2:] if line.removeprefix("# ") not in clock_lines)]


def questions(text: str) -> int:
    """Number of lines with a question."""
    return sum(line.partition("#")[0].count('"?"') > 0 for line in text.splitlines())


def _section(clocks: listing.Clocks, quantity: VectorName, found: Sequence[Vector], chosen: dict[str, Vector]) -> list[str]:
    candidates, settled = fitting(quantity, found)
    partial = {tuple(v.paths): covered[1] for v in candidates if (covered := _covering(clocks, quantity, v)) and covered[1]}
    if partial:
        candidates = [v for v in candidates if tuple(v.paths) not in partial]
        settled = len(candidates) == 1
    lines = [f"[{quantity.key}]", *(f"# not {json.dumps(paths, ensure_ascii=False)}: {reason}" for paths, reason in partial.items())]
    if not settled:
        some = [f"#   {json.dumps(v.paths, ensure_ascii=False)}{_remark(clocks, v)}" for v in candidates[:_MANY]]
        many = "this could be it; take it if it is" if len(candidates) == 1 else f"{len(candidates)} could be it; take one of"
        none = f"nothing {'else ' * bool(partial)}is called so; three paths of massprop columns, or numbers"
        why = many if candidates else none
        asked = f'values = "?"   # {_ASK_VALUES}' if quantity in SENSORS else 'frame = "?"   # "body" or "world"'
        return [*lines, f"# {why}", *some, 'paths = ["?", "?", "?"]', 'unit = "?"', asked, ""]
    vector = candidates[0]
    chosen[quantity.key] = vector
    lines.append(f"paths = {json.dumps(vector.paths, ensure_ascii=False)}{_remark(clocks, vector)}")
    lines += _clock(clocks, vector.paths[0])
    if quantity in SENSORS:
        return [*lines, *_where(clocks, vector), *_sensor(clocks, quantity, vector), ""]
    if listing.leaf(vector.paths[0]) in columns.WRENCH:
        return [*lines, f'unit = "{next(iter(quantity.rates))}"   # by its name', 'frame = "body"   # by its name', ""]
    return [*lines, *_unit(quantity, vector), 'frame = "?"   # "body", or "world", which needs [attitude]', ""]


def _where(clocks: listing.Clocks, vector: Vector) -> list[str]:
    """Question for the sensor, if a table seems to have several; else empty."""
    one = vector.streams[0]
    found = selection.sensors(clocks.streams, one.rows, np.flatnonzero(np.isfinite(np.asarray(one.values, np.float64))), None)
    if found is None:
        return []
    column, values = json.dumps(found.column, ensure_ascii=False), selection.stated(found.values, " or ")
    return [f'where = {{ column = {column}, is = "?" }}   # {values}: rows alternate between them, as of several sensors in one table']


def _covering(clocks: listing.Clocks, quantity: VectorName, vector: Vector) -> tuple[RecordedStream, str] | None:
    """Stream with the interval of each increment, and why increments do not cover the whole motion, if so; None without such a stream."""
    length = interval_stream(clocks.streams, vector.paths)
    found = clocks.of(vector.streams[0])
    if length is None or len(found) != 1 or units.factor(vector.unit, quantity.increments) is None:
        return None
    step, factor = clocks.step(found[0], vector.streams[0]), units.factor(clocks.unit(found[0])[0], units.TIME)
    whole = covers_all(length, [step * each for each in ([factor] if factor is not None else units.TIME.values())])
    lost = f"by {length.path!r} each covers {covered_interval(length):.6g}, and they come every {step:.6g} by their clock"
    return length, "" if whole else lost


def _remark(clocks: listing.Clocks, vector: Vector) -> str:
    rate = clocks.rate_hz(vector.streams[0])
    parts = [
        f"{clocks.samples(vector.streams[0])} samples",
        *([f"{rate:.6g} Hz"] if rate else []),
        *([vector.streams[0].unit] * bool(vector.streams[0].unit)),
    ]
    return f"   # {', '.join(parts)}"


def _sensor(clocks: listing.Clocks, quantity: VectorName, vector: Vector) -> list[str]:
    """Lines for unit and meaning of a sensor's values."""
    name = listing.leaf(vector.paths[0])
    for names, known, meaning in ((_INCREMENTS, quantity.increments, "increment"), (_RATES, quantity.rates, "mean")):
        if name in names:
            return [f'unit = "{next(iter(known))}"   # by its name', f'values = "{meaning}"   # by its name']
    meaning, why = next((known for name, known in _VALUES.items() if name in vector.stem), ("?", _ASK_VALUES))
    if units.factor(vector.unit, quantity.increments) is not None:
        whole = _covering(clocks, quantity, vector)
        meaning, why = "?", _ASK_INCREMENTS
        if whole is not None:
            meaning, why = "increment", f"by its unit; {whole[0].path!r} says that each covers the time since the one before"
    return [*_unit(quantity, vector), f'values = "{meaning}"   # {why}']


def _unit(quantity: VectorName, vector: Vector) -> list[str]:
    """Line for the unit; empty if the file gives it. Its source is the name, or the values: only gravity is recognised."""
    unit = next((unit for unit in quantity.known if units.plain(unit) == units.plain(vector.unit)), None)
    if unit is not None:
        return [] if vector.streams[0].unit else [f'unit = "{unit}"   # by its name']
    values = np.array([one.values for one in vector.streams], np.float64)
    values = values[:, np.isfinite(values).all(0)]
    size = float(np.median(np.sqrt(np.sum(np.square(values), 0))))
    choices = " or ".join([*quantity.rates, *quantity.increments])
    if quantity.key == "accelerometer":
        for unit, gravity in (("m/s^2", units.G), ("g", 1.0), ("mg", 1e3)):
            if abs(size / gravity - 1) < 0.03:
                return [f'unit = "{unit}"   # its median size is {size:.4g}: gravity']
    largest = float(np.max(np.abs(values)))
    unit = vector.streams[0].unit
    recorded = (
        f"recorded as {json.dumps(unit, ensure_ascii=False)}, which is none of these: state scale beside it" if unit else "not recorded"
    )
    return [f'unit = "?"   # {choices}: {recorded}; its median size is {size:.3g}, its largest number {largest:.3g}']


def _jet(clocks: listing.Clocks, path: str) -> list[str]:
    name = listing.leaf(path).removeprefix("jet_").removesuffix("_s")
    return [
        f"[jets.{name if re.fullmatch(r'[A-Za-z0-9_-]+', name) else json.dumps(name)}]",
        f"path = {json.dumps(path, ensure_ascii=False)}",
        'unit = "s"   # by its name',
        *_clock(clocks, path),
        "",
    ]


def _actuators(clocks: listing.Clocks) -> list[str]:
    """Tables of jets, rotors, wheels and gimbals as comments, with candidate streams."""
    paths: dict[str, list[str]] = {table: [] for table in _ACTUATOR_NAMES}
    for path, stream in clocks.streams.items():
        tables = [
            table
            for table, called in _ACTUATOR_NAMES.items()
            if called.search(path) or (table == "wheels" and stream.unit.lower() == "rpm")
        ]
        clock = listing.leaf(path) in (*listing.CLOCK_NAMES, "timestamp_sample")
        if tables and not clock and not _NO_VALVE.search(path) and clocks.samples(stream):
            paths[tables[-1]].append(path)
    return [line for table, own in paths.items() if own for line in _table(clocks, table, own)]


def _table(clocks: listing.Clocks, table: str, paths: Sequence[str]) -> list[str]:
    """Table of an actuator as a comment, with candidate paths."""
    whose, behind, unit = _TABLES[table]
    more = len(paths) - _ACTUATORS
    return [
        f"# {whose} of the vehicle file a table such as",
        f"# [{table}.NAME]{behind}",
        *(f"# path = {json.dumps(path, ensure_ascii=False)}" for path in paths[:_ACTUATORS]),
        *([f"# ... and {more} more, which massprop columns lists"] if more > 0 else []),
        *(f"# {line}" for line in _clock(clocks, paths[0])),
        f'# unit = "?"   # {unit}',
        "",
    ]


def _clock(clocks: listing.Clocks, path: str) -> list[str]:
    """Line for the clock of a stream; empty if the file gives it."""
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
    step = clocks.step(some[0], stream)
    return [f'clock = {{ path = {json.dumps(some[0])}, unit = "?" }}   # s, ms, us or ns: not recorded; samples come every {step:.6g}']


def _attitude(clocks: listing.Clocks, found: Sequence[Vector]) -> list[str]:
    """Tables of attitude as comments, because it is optional: headings for planar tables, and quaternions."""
    lines: list[str] = []
    for one in [one for path, one in clocks.streams.items() if _HEADINGS.fullmatch(listing.leaf(path))][:_MANY]:
        lines += ["# [attitude]   # optional, on a planar table", f"# paths = [{json.dumps(one.path, ensure_ascii=False)}]"]
        lines += [f"# {line}" for line in _clock(clocks, one.path)]
        lines += ['# order = "heading"', *([] if one.unit else ['# unit = "?"   # rad or deg']), '# world = "?"   # "z_up" or "z_down"', ""]
    for vector in attitudes(found)[:_MANY]:
        px4 = vector.stem.startswith("vehicle_attitude")
        order = '"wxyz"' if vector.axes == "wxyz" or px4 else '"?"   # "wxyz" or "xyzw"'
        world = '"z_down"   # PX4: NED' if px4 else '"?"   # "z_up" or "z_down"'
        lines += ["# [attitude]   # optional", f"# paths = {json.dumps(vector.paths, ensure_ascii=False)}{_remark(clocks, vector)}"]
        lines += [f"# {line}" for line in _clock(clocks, vector.paths[0])]
        lines += [f"# order = {order}", '# turns = "world_from_body"   # or "body_from_world"', f"# world = {world}", ""]
    return lines


def _records(clocks: listing.Clocks, chosen: Mapping[str, Vector], jets: Sequence[str]) -> list[str]:
    """Table of records, if the streams have different clocks."""
    sensors = [chosen[key].streams[0] for key in ("gyro", "accelerometer") if key in chosen]
    commands = [chosen[key].streams[0] for key in ("torque", "force") if key in chosen] + [clocks.streams[path] for path in jets[:1]]
    streams = [*sensors, *commands]
    complete = len(sensors) == 2 and bool(commands)
    one_clock = len({tuple(clocks.of(one)) for one in streams}) == 1
    # the IMU in every row, and commands in some
    if complete and one_clock and all(clocks.samples(one) == one.rows for one in sensors):
        return ["# all on one clock: the file's rows are the log's, and commands change with the first row of a control cycle only"]
    steps = [clocks.step(found[0], one) for one in streams if len(found := clocks.of(one)) == 1]
    if not complete or len(steps) < len(streams) or not all(steps):
        return [
            "# where the streams have clocks of their own, they are put on records of one length and on control cycles:",
            "# [records]",
            '# interval_s = "?"   # a record: at least the interval of the slower of gyro and accelerometer',
            '# per_cycle = "?"    # records of a control cycle',
        ]
    lines = ["[records]   # the streams have clocks of their own, and are put on records of one length and on control cycles"]
    rates = [rate for one in streams if (rate := clocks.rate_hz(one)) is not None]
    known = len(rates) == len(streams)
    slower, commanded = (1 / min(rates[:2]), 1 / rates[2]) if known else (max(steps[:2]), steps[2])
    count = max(1, min(_RECORDS, int(commanded / slower * 1.001)))
    length = f"{commanded / count:.9g}"
    if known:
        lines.append(f"interval_s = {length}   # commands come at {1 / commanded:.6g} Hz, the slower sensor at {1 / slower:.6g} Hz")
    else:
        own = f"in s: {length} in the clock's own unit; " if one_clock else "in s; by their own clocks "
        lines.append(f'interval_s = "?"   # {own}commands come every {commanded:.6g}, the slower sensor every {slower:.6g}')
    lines.append(f"per_cycle = {count}" if known or one_clock else 'per_cycle = "?"   # records of a control cycle')
    first = clocks.of(streams[0])[0]
    if float(clocks.streams[first].values[0]) * (units.factor(clocks.unit(first)[0], units.TIME) or 1.0) > _LONG_AGO_S:
        lines.append('zero = "start"   # the clock counts from long ago')
    return lines
