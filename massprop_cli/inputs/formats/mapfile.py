"""The map file: which stream of a recording is which quantity. The models below are the schema (``massprop schema map``)."""

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, FiniteFloat, StringConstraints, model_validator

from massprop_cli.base import configfile
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats.recording import maps_beside
from massprop_cli.inputs.section import Positive, Real, Section
from massprop_cli.inputs.vehicle import ACTUATORS

Path_ = Annotated[str, StringConstraints(min_length=1)]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
_AS_RECORDED = "absent: as the file records it"


def _turn(axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
    order = ["xyz".index(axis[-1]) for axis in axes]
    if sorted(order) != [0, 1, 2]:
        raise ValueError("names an axis twice; name x, y and z once each")
    odd = [(0, 1, 2), (1, 2, 0), (2, 0, 1)].count((order[0], order[1], order[2])) == 0
    if (sum(axis.startswith("-") for axis in axes) + odd) % 2:
        raise ValueError("is a mirror, not a turn: no sensor is left-handed; change one sign, or swap two axes")
    return axes


Axes = Annotated[tuple[Axis, Axis, Axis], AfterValidator(_turn)]


class Clock(Section):
    """The times of a stream: ``value * scale * unit + offset_s``."""

    path: Path_ | None = Field(None, description="stream of the times; absent: the one that the file names")
    unit: Path_ | None = Field(None, description=f"s, ms, us or ns; {_AS_RECORDED}")
    scale: Positive = Field(1.0, description="a further factor: 0.1 with ms for ticks of 0.1 ms, 0.01 with s for a counter at 100 Hz")
    nanoseconds: Path_ | None = Field(None, description="stream of nanoseconds that are added, where path holds whole seconds")
    even: bool = Field(False, description="samples come at even intervals, and only their stamps scatter: the line through these is taken")
    offset_s: FiniteFloat = Field(0.0, description="added, to bring clocks together that began apart")


class Where(Section):
    """Rows of a table that are one sensor's."""

    column: Path_ = Field(description="the column that tells sensors apart, such as their numbers")
    is_: Path_ | FiniteFloat | tuple[Path_ | FiniteFloat, ...] = Field(
        alias="is", description="the value of the rows that are meant, a number or a text, or several of them"
    )

    @model_validator(mode="after")
    def _selects_some(self) -> Self:
        if not self.values:
            raise ValueError("is = [] selects no row; state a value, or several")
        return self

    @property
    def values(self) -> tuple[str | float, ...]:
        """Of the rows that are meant."""
        return self.is_ if isinstance(self.is_, tuple) else (self.is_,)


_WHERE = 'of a table with several sensors the rows of one: { column = "id", is = 1 }; absent: all rows'


class Mapped(Section):
    """Where a quantity is in the file."""

    unit: Path_ | None = Field(None, description=_AS_RECORDED)
    scale: Real = Field(1.0, description="a further factor, after the unit")
    clock: Clock | None = Field(None, description="absent: the file's, or the map's own [clock]")
    where: Where | None = Field(None, description=_WHERE)

    @model_validator(mode="after")
    def _scales(self) -> Self:
        if self.scale == 0:
            raise ValueError("scale is zero")
        return self


class MappedVector(Mapped):
    """Three streams."""

    paths: Path_ | tuple[Path_ | FiniteFloat, ...] = Field(
        description="three paths, a number (SI) for an axis that has none, or one pattern (* and ?) that fits three, in their order"
    )
    axes: Axes = Field(("x", "y", "z"), description='which of them, with its sign, is x, y, z: ["y", "-x", "z"]')


class MappedSensor(MappedVector):
    """Gyro or accelerometer, IMU axes."""

    values: Literal["sample", "mean", "increment"] = Field(
        description="what a number is: the rate at its time, the mean rate since the one before, or the increment since the one before"
    )


class MappedWrench(MappedVector):
    """Commanded torque about O, or force."""

    frame: Literal["body", "world"] = Field("body", description="world, that of [attitude]: turned into body axes with it")
    holds: Literal["until_next", "since_last"] = Field("until_next", description="over what time a number counts")


class MappedJet(Mapped):
    """One jet's on-time."""

    path: Path_ | Literal[0] = Field(description="0: it never fired in this log, which has no stream of it")
    unit: Path_ | None = Field(
        None, description="s, ms, us: on-time of this control cycle; open, %: the valve's state, summed over each control cycle"
    )
    offset: FiniteFloat = Field(0.0, description="added to the recorded number, before unit and scale: -1000 where 1000 us is shut")
    bit: int | None = Field(None, ge=0, le=52, description="of a whole number that holds a valve in each bit, 0 the lowest: this one")
    holds: Literal["until_next", "since_last"] = "until_next"

    @model_validator(mode="after")
    def _is_a_bit(self) -> Self:
        if self.bit is not None and (self.unit not in (None, "open") or self.offset != 0):
            raise ValueError("bit is a valve that is open or shut; drop unit and offset")
        return self


class MappedDevice(Mapped):
    """The command of one actuator, or its state."""

    path: Path_
    holds: Literal["until_next", "since_last"] = "until_next"


class MappedRotor(MappedDevice):
    """What one rotor is told, or how fast it turns."""

    unit: Path_ | None = Field(None, description='"1" or %: the command, as thrust_n takes it once scaled; rad/s, rpm: the speed')


class MappedWheel(MappedDevice):
    """How fast one wheel turns, or the torque on it."""

    unit: Path_ | None = Field(None, description="rad/s, rpm: its speed relative to the body; N m: the torque on it")


class MappedGyro(MappedDevice):
    """The gimbal angle of one control moment gyro."""

    unit: Path_ | None = Field(None, description="rad, deg: its gimbal angle")


class Supply(Mapped):
    """The voltage of rotors' supply, or the absolute pressure of jets'."""

    path: Path_


class Attitude(Section):
    """Logged quaternion, or on a planar table the heading alone."""

    paths: Path_ | tuple[Path_, ...] = Field(description="four paths, or one pattern that fits four; of a heading one path")
    order: Literal["wxyz", "xyzw", "heading"] = Field(
        description="of the paths; heading, on a planar table: one angle about the vertical, from the world's x to the body's, about the "
        "world's z"
    )
    unit: Path_ | None = Field(None, description=f"of a heading: rad, deg; {_AS_RECORDED}")
    scale: Real = Field(1.0, description="of a heading: a further factor, after the unit")
    turns: Literal["world_from_body", "body_from_world"] = "world_from_body"
    world: Literal["z_up", "z_down"] = Field("z_up", description="of the file's world; with z_down (NED) the log's is turned half about x")
    axes: Axes = Field(
        ("x", "y", "z"), description='which of the axes of its body are x, y, z of the vehicle\'s: ["x", "-y", "-z"] of forward-right-down'
    )
    clock: Clock | None = None
    where: Where | None = Field(None, description=_WHERE)

    @model_validator(mode="after")
    def _is_a_heading(self) -> Self:
        if self.order != "heading":
            if self.unit is not None or self.scale != 1:
                raise ValueError('unit and scale are of a heading alone; drop them, or state order = "heading"')
        elif self.axes[2] != ("-z" if self.world == "z_down" else "z"):
            up = '["x", "-y", "-z"] with world = "z_down"' if self.world == "z_down" else 'z as the last of them with world = "z_up"'
            raise ValueError(f"on a table the vehicle's z points up, and a heading is about the world's z: state axes = {up}")
        elif self.scale == 0:
            raise ValueError("scale is zero")
        return self


class Records(Section):
    """What a row of the log is made of. Without it the file's own rows are the log's, and all streams must share one clock."""

    samples: int | None = Field(None, ge=1, le=100_000, description="a record is so many gyro samples, ...")
    interval_s: Positive | None = Field(None, description="... or so long, on a regular grid")
    per_cycle: int = Field(1, ge=1, le=100_000, description="records of a control cycle")
    start_s: FiniteFloat | None = Field(None, description="first instant, by the gyro's clock; absent: where all streams are there")
    end_s: FiniteFloat | None = Field(None, description="last instant; absent: as long as all streams are there")
    zero: Literal["file", "start"] = Field("file", description="what time_s counts from: as the clock does, or from the log's start")

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if (self.samples is None) == (self.interval_s is None):
            raise ValueError("takes either samples or interval_s")
        if self.start_s is not None and self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"ends at {self.end_s} s, not after its start at {self.start_s} s")
        return self


class MapFile(Section):
    """A whole map file, checked."""

    schema_: Literal[1] = Field(alias="schema")
    clock: Clock = Field(Clock(), description="of all streams that have none of their own")
    gyro: MappedSensor
    accelerometer: MappedSensor | None = Field(None, description="absent: nothing was recorded of it")
    torque: MappedWrench | None = None
    force: MappedWrench | None = None
    jets: dict[str, MappedJet] = Field({}, description="by their names in the vehicle file")
    rotors: dict[str, MappedRotor] = Field({}, description="by their names in the vehicle file")
    wheels: dict[str, MappedWheel] = Field({}, description="by their names in the vehicle file")
    control_moment_gyros: dict[str, MappedGyro] = Field({}, description="by their names in the vehicle file")
    supply: Supply | None = Field(None, description="a voltage for rotors that state nominal_v, a pressure for thrust.nominal_pa")
    attitude: Attitude | None = None
    records: Records | None = None

    @model_validator(mode="after")
    def _commands(self) -> Self:
        wrench = (self.torque is not None) + (self.force is not None)
        if wrench == 1:
            missing = "force" if self.force is None else "torque"
            raise ValueError(f"[{missing}] is missing beside the other; map it, or state paths = [0, 0, 0] under it")
        actuators = {kind: getattr(self, table) for table, kind in ACTUATORS.items()}
        if (wrench > 0) + bool(self.jets) + any(own for kind, own in actuators.items() if kind.THRUSTS) > 1:
            raise ValueError("maps more than one of jets, rotors and a commanded wrench; keep the one kind that was executed")
        if not (wrench or self.jets or any(actuators.values())):
            pulses = "columns pulse_jet, pulse_start_s and pulse_duration_s are read without a map, by [columns] of the vehicle file"
            raise ValueError(f"maps no command; add [torque] and [force], [jets.NAME], [rotors.NAME] or [wheels.NAME]; {pulses}")
        if self.attitude is None and any(one is not None and one.frame == "world" for one in (self.torque, self.force)):
            raise ValueError('frame = "world" needs [attitude], to turn commands into body axes')
        return self


@dataclass(frozen=True)
class MapSource:
    """A map with where it came from."""

    map: MapFile
    source: str
    sha256: str
    named: bool = True
    """Whether the user named it; else it lies beside the log."""


def parse(text: str, source: str, named: bool = True) -> MapSource:
    """Check a map file's text; :class:`massprop_cli.base.errors.InputError` names file, line and key."""
    stated = configfile.parse_toml(text, source)
    configfile.bounded(stated, source)
    _refuse_open(stated, source, text)
    found = configfile.validate(MapFile, stated, source, text)
    return MapSource(found, source, hashlib.sha256(text.encode()).hexdigest(), named)


def _refuse_open(stated: dict[str, Any], source: str, text: str) -> None:
    """Refuse what a draft asks and nobody answered, all of it at once."""
    first, *more = _open(stated, []) or [[]]
    if not first:
        return
    at, *others = (configfile.line_of(text, path) for path in (first, *more))
    lines = sorted({line for line in others if line} - {at})
    beside = f"; so {'are lines' if len(lines) > 1 else 'is line'} {', '.join(map(str, lines))}" if lines else ""
    said = "answer each: its comment in the draft says what it may be"
    raise InputError(f'{source}, line {at}: {".".join(first)} is still "?"{beside}; {said}')


def _open(item: object, path: list[str]) -> list[list[str]]:
    """Where a question is left; ``paths = "?"`` is none, but a pattern that fits columns of one letter."""
    if isinstance(item, dict):
        return [found for key, part in item.items() for found in _open(part, [*path, key])]
    if isinstance(item, list):
        return [path] if "?" in item else []
    return [path] if item == "?" and path[-1] != "paths" else []


def load(path: Path, named: bool = True) -> MapSource:
    """Read a map file."""
    return parse(configfile.read_text(path, "map file"), str(path), named)


def find(log: Path, explicit: Path | None) -> MapSource | None:
    """The map that is named, LOGSTEM.map.toml, or map.toml beside the log; None where there is none."""
    if explicit is not None:
        return load(explicit)
    beside = next((path for path in map(log.with_name, maps_beside(log.name)) if path.exists()), None)
    return None if beside is None else load(beside, named=False)
