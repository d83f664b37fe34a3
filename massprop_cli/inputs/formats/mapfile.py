"""Map file (``massprop schema map``): which stream of a recording is which quantity."""

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
_AS_RECORDED = "absent: as recorded in the file"


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
    """Times of a stream: ``value * scale * unit + offset_s``."""

    path: Path_ | None = Field(None, description="stream of the times; absent: the stream's clock in the file")
    unit: Path_ | None = Field(None, description=f"s, ms, us or ns; {_AS_RECORDED}")
    scale: Positive = Field(1.0, description="additional factor: 0.1 with ms for ticks of 0.1 ms, 0.01 with s for a counter at 100 Hz")
    nanoseconds: Path_ | None = Field(None, description="stream of nanoseconds to add, if path holds whole seconds")
    even: bool = Field(False, description="samples are evenly spaced and only their time stamps scatter; massprop fits a line to these")
    offset_s: FiniteFloat = Field(0.0, description="offset to add, for clocks with different epochs")


class Where(Section):
    """Rows of a table that belong to one sensor."""

    column: Path_ = Field(description="column that identifies the sensor, for example by number")
    is_: Path_ | FiniteFloat | tuple[Path_ | FiniteFloat, ...] = Field(
        alias="is", description="value of that column in the selected rows, a number or a text, or several of them"
    )

    @model_validator(mode="after")
    def _has_values(self) -> Self:
        if not self.values:
            raise ValueError("is = [] selects no row; state a value, or several")
        return self

    @property
    def values(self) -> tuple[str | float, ...]:
        """Values of the selected rows."""
        return self.is_ if isinstance(self.is_, tuple) else (self.is_,)


_WHERE = 'rows of one sensor in a table with several sensors: { column = "id", is = 1 }; absent: all rows'


class Mapped(Section):
    """Stream of a quantity."""

    unit: Path_ | None = Field(None, description=_AS_RECORDED)
    scale: Real = Field(1.0, description="additional factor, after the unit")
    clock: Clock | None = Field(None, description="clock of the stream; absent: that of the file, or [clock] of the map")
    where: Where | None = Field(None, description=_WHERE)

    @model_validator(mode="after")
    def _is_not_zero(self) -> Self:
        if self.scale == 0:
            raise ValueError("scale is zero")
        return self


class MappedVector(Mapped):
    """Three streams of a vector."""

    paths: Path_ | tuple[Path_ | FiniteFloat, ...] = Field(
        description="three paths, or numbers (SI) for axes without a stream, or one pattern (* and ?) that matches three, in their order"
    )
    axes: Axes = Field(("x", "y", "z"), description='stream axes, with sign, that are x, y, z: ["y", "-x", "z"]')


class MappedSensor(MappedVector):
    """Gyro or accelerometer, IMU axes."""

    values: Literal["sample", "mean", "increment"] = Field(
        description="meaning of a value: rate at its time, mean rate since the previous value, or increment since the previous value"
    )


class MappedWrench(MappedVector):
    """Commanded torque about O, or commanded force."""

    frame: Literal["body", "world"] = Field(
        "body", description="axes of the values; world, the frame of [attitude]: massprop rotates them into body axes"
    )
    holds: Literal["until_next", "since_last"] = Field("until_next", description="interval in which a value holds")


class MappedJet(Mapped):
    """On-time of one jet."""

    path: Path_ | Literal[0] = Field(description="stream; 0: the log has no stream of this jet because it never fired")
    unit: Path_ | None = Field(
        None, description="s, ms, us: on-time in this control cycle; open, %: state of the valve, integrated over each control cycle"
    )
    offset: FiniteFloat = Field(0.0, description="offset to add to the recorded value, before unit and scale: -1000 if 1000 us is closed")
    bit: int | None = Field(None, ge=0, le=52, description="bit of this valve in an integer of valve states; 0: lowest bit")
    holds: Literal["until_next", "since_last"] = "until_next"

    @model_validator(mode="after")
    def _is_a_bit(self) -> Self:
        if self.bit is not None and (self.unit not in (None, "open") or self.offset != 0):
            raise ValueError("bit is a valve that is open or shut; drop unit and offset")
        return self


class MappedDevice(Mapped):
    """Command or state of one actuator."""

    path: Path_
    holds: Literal["until_next", "since_last"] = "until_next"


class MappedRotor(MappedDevice):
    """Command or speed of one rotor."""

    unit: Path_ | None = Field(None, description='"1" or %: command, after scaling the argument of thrust_n; rad/s, rpm: speed')


class MappedWheel(MappedDevice):
    """Speed of one wheel, or torque on it."""

    unit: Path_ | None = Field(None, description="rad/s, rpm: speed relative to the body; N m: torque on the wheel")


class MappedGyro(MappedDevice):
    """Gimbal angle of one control moment gyro."""

    unit: Path_ | None = Field(None, description="rad, deg: gimbal angle")


class Supply(Mapped):
    """Supply voltage of rotors, or absolute supply pressure of jets."""

    path: Path_


class Attitude(Section):
    """Logged quaternion, or heading on a planar table."""

    paths: Path_ | tuple[Path_, ...] = Field(description="four paths, or one pattern that matches four; one path for a heading")
    order: Literal["wxyz", "xyzw", "heading"] = Field(
        description=("order of the paths; heading, on a planar table: one angle about the world's z axis, from its x axis to the body's")
    )
    unit: Path_ | None = Field(None, description=f"unit of a heading: rad, deg; {_AS_RECORDED}")
    scale: Real = Field(1.0, description="additional factor of a heading, after the unit")
    turns: Literal["world_from_body", "body_from_world"] = "world_from_body"
    world: Literal["z_up", "z_down"] = Field(
        "z_up", description="direction of z in the file's world frame; z_down (NED): massprop rotates it by half a turn about x"
    )
    axes: Axes = Field(
        ("x", "y", "z"),
        description='axes of the file\'s body frame that are the vehicle\'s x, y, z: ["x", "-y", "-z"] for forward-right-down',
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
    """Records of the log. Without this table the rows of the file are the records, and all streams must share one clock."""

    samples: int | None = Field(None, ge=1, le=100_000, description="number of gyro samples per record, ...")
    interval_s: Positive | None = Field(None, description="... or length of a record, on a regular grid")
    per_cycle: int = Field(1, ge=1, le=100_000, description="number of records per control cycle")
    start_s: FiniteFloat | None = Field(
        None, description="start on the gyro's clock; absent: the first time at which all streams have data"
    )
    end_s: FiniteFloat | None = Field(None, description="end on the gyro's clock; absent: the last time at which all streams have data")
    zero: Literal["file", "start"] = Field("file", description="zero of time_s: that of the clock, or the start of the log")

    @model_validator(mode="after")
    def _has_one_length(self) -> Self:
        if (self.samples is None) == (self.interval_s is None):
            raise ValueError("takes either samples or interval_s")
        if self.start_s is not None and self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"ends at {self.end_s} s, not after its start at {self.start_s} s")
        return self


class MapFile(Section):
    """Map file."""

    schema_: Literal[1] = Field(alias="schema")
    clock: Clock = Field(Clock(), description="clock of all streams without one of their own")
    gyro: MappedSensor
    accelerometer: MappedSensor | None = Field(None, description="absent: not recorded")
    torque: MappedWrench | None = None
    force: MappedWrench | None = None
    jets: dict[str, MappedJet] = Field({}, description="entries by name in the vehicle file")
    rotors: dict[str, MappedRotor] = Field({}, description="entries by name in the vehicle file")
    wheels: dict[str, MappedWheel] = Field({}, description="entries by name in the vehicle file")
    control_moment_gyros: dict[str, MappedGyro] = Field({}, description="entries by name in the vehicle file")
    supply: Supply | None = Field(None, description="voltage for rotors with nominal_v, or pressure for thrust.nominal_pa")
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
    """Map file with its source."""

    map: MapFile
    source: str
    sha256: str
    named: bool = True
    """Whether the user named the file; False: found next to the log."""


def parse(text: str, source: str, named: bool = True) -> MapSource:
    """Parse and check a map file's text. Raises :class:`massprop_cli.base.errors.InputError` with file, line and key."""
    stated = configfile.parse_toml(text, source)
    configfile.bounded(stated, source)
    _refuse_open(stated, source, text)
    found = configfile.validate(MapFile, stated, source, text)
    return MapSource(found, source, hashlib.sha256(text.encode()).hexdigest(), named)


def _refuse_open(stated: dict[str, Any], source: str, text: str) -> None:
    """Raise :class:`InputError` with all keys that are still "?", the open questions of a draft."""
    first, *more = _open(stated, []) or [[]]
    if not first:
        return
    at, *others = (configfile.line_of(text, path) for path in (first, *more))
    lines = sorted({line for line in others if line} - {at})
    others_text = f"; so {'are lines' if len(lines) > 1 else 'is line'} {', '.join(map(str, lines))}" if lines else ""
    remedy = "answer each: its comment in the draft says what it may be"
    raise InputError(f'{source}, line {at}: {".".join(first)} is still "?"{others_text}; {remedy}')


def _open(item: object, path: list[str]) -> list[list[str]]:
    """Key paths whose value is "?"; ``paths = "?"`` is not an open question but a pattern for columns of one letter."""
    if isinstance(item, dict):
        return [found for key, part in item.items() for found in _open(part, [*path, key])]
    if isinstance(item, list):
        return [path] if "?" in item else []
    return [path] if item == "?" and path[-1] != "paths" else []


def load(path: Path, named: bool = True) -> MapSource:
    """Read a map file."""
    return parse(configfile.read_text(path, "map file"), str(path), named)


def find(log: Path, explicit: Path | None) -> MapSource | None:
    """Map file of a log: ``explicit``, LOGSTEM.map.toml or map.toml next to the log; None without one."""
    if explicit is not None:
        return load(explicit)
    others_text = next((path for path in map(log.with_name, maps_beside(log.name)) if path.exists()), None)
    return None if others_text is None else load(others_text, named=False)
