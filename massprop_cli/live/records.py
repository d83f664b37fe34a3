"""Parser of a telemetry stream: CSV with a header line, or one JSON object per line. The first line determines the format."""

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO

import numpy as np

from massprop_cli.base import limits
from massprop_cli.base.configfile import repeated
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import commands
from massprop_cli.inputs.actuators.wheel import SPEED
from massprop_cli.inputs.columns import ACCEL, COMMAND_TIME, DELTA_THETA, DELTA_V, EVENT, GYRO, PULSE_START, QUATERNION, TIME, WRENCH, jet
from massprop_cli.inputs.equipment import OFF_UNIT
from massprop_cli.inputs.imurecords import ABSURD
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.tablefile import at_hand, by_line
from massprop_cli.inputs.vehicle import Vehicle

LONGEST = 1 << 20
"""Largest length of a line, characters; the stream is external input."""


def lines_of(stream: IO[str]) -> Iterator[str]:
    """Lines of a stream, cut off after :data:`LONGEST` + 1 characters; raise :class:`InputError` if it cannot be read."""
    while line := _piece(stream):
        rest = line
        while len(rest) > LONGEST and not rest.endswith("\n"):
            rest = _piece(stream)
        yield line


def _piece(stream: IO[str]) -> str:
    """A line, or at most LONGEST + 1 characters of it."""
    try:
        return stream.readline(LONGEST + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"standard input: cannot be read ({getattr(error, 'strerror', None) or error}); pipe a log into it") from None


class RecordError(ValueError):
    """Invalid line of a stream, which the recording leaves out."""


@dataclass(frozen=True)
class StreamColumns:
    """Quantities that a stream contains, by massprop's column names."""

    rates: bool
    """Whether the gyro's columns are rates, not increments."""
    accelerations: bool
    """Whether the accelerometer's columns are specific forces, not increments."""
    commands: tuple[str, ...]
    """Columns of commands."""
    jets: bool
    """Whether commands are on-times of jets, not wrenches."""
    speeds: tuple[str, ...] = ()
    """Columns of wheel speeds, at the end of each record."""

    @property
    def required(self) -> tuple[str, ...]:
        """Columns that must have a number in every record."""
        theta, velocity = GYRO if self.rates else DELTA_THETA, ACCEL if self.accelerations else DELTA_V
        return (TIME, *theta, *velocity, *self.speeds)


@dataclass(frozen=True)
class Record:
    """Values of one line that are valid without regard to other lines."""

    numbers: dict[str, float]
    """Values by massprop's column names, SI; NaN for an empty command."""
    row: str
    """Line of CSV for the recording."""

    @property
    def time_s(self) -> float:
        """End of the record's interval, s."""
        return self.numbers[TIME]


class StreamReader:
    """Parser of the lines of one stream."""

    def __init__(self, vehicle: Vehicle, first: str) -> None:
        """``first`` is the first line of the stream; raise :class:`InputError` if it lacks a required column."""
        _check_length(first)
        self.vehicle, self.is_json = vehicle, first.lstrip().startswith("{")
        self.names = list(_object(first)) if self.is_json else [name.strip() for name in _fields(first)]
        self.mapped = {name: column.from_ for name, column in vehicle.columns.items()}
        """The stream's column for massprop's name, from the vehicle file."""
        if self.is_json and not self._has((EVENT,)):
            self.names.append(self._column(EVENT))  # a later object may contain an event
        self.columns = self._columns()

    @property
    def header(self) -> str:
        """The header line of the recording."""
        return _line(self.names)

    def read(self, line: str) -> Record:
        """Parse one line; raise :class:`RecordError` if it is not a valid record."""
        _check_length(line)
        cells = self._cells(line)
        numbers = {name: self._number(name, cells) for name in (*self.columns.required, *self.columns.commands)}
        for name in self.columns.required:
            if not math.isfinite(numbers[name]):
                raise RecordError(f"column {self._column(name)}: {cells.get(self._column(name)) or 'an empty cell'} is not a finite number")
        for name in (*DELTA_THETA, *DELTA_V, *GYRO, *ACCEL):
            # the interval of an increment is at most one control cycle
            longest_s = self.vehicle.cycle.period_s if name in (*DELTA_THETA, *DELTA_V) else 1.0
            if abs(numbers.get(name, 0.0)) > ABSURD[name] * longest_s:
                raise RecordError(f"column {self._column(name)}: {numbers[name]:g} is too fast for a vehicle")
        for name in self.columns.commands if self.columns.jets else ():
            if numbers[name] < 0 or numbers[name] > self.vehicle.cycle.period_s * (1 + 1e-6):
                raise RecordError(
                    f"column {self._column(name)}: {numbers[name]:g} s is not an on-time of a cycle of {self.vehicle.cycle.period_s:g} s"
                )
        return Record(
            numbers, _line([cells[name] for name in self.names] if not self._has(QUATERNION) else self._with_valid_attitude(cells))
        )

    def _with_valid_attitude(self, cells: dict[str, str]) -> list[str]:
        """Cells for the recording; a quaternion that massprop estimate would refuse becomes four empty cells."""
        columns = [self._column(name) for name in QUATERNION]
        try:
            norm = math.hypot(
                *(self._number(name, cells) if column in cells else math.nan for name, column in zip(QUATERNION, columns, strict=True))
            )
        except RecordError:
            norm = math.nan
        usable = abs(norm - 1) <= OFF_UNIT
        return [cells[name] if usable or name not in columns else "" for name in self.names]

    def _column(self, name: str) -> str:
        """The stream's column for massprop's name."""
        return self.mapped.get(name, name)

    def _has(self, names: Sequence[str]) -> bool:
        """Whether the stream has a column for any of massprop's names."""
        return any(self._column(name) in self.names for name in names)

    def _columns(self) -> StreamColumns:
        """The quantities in the stream; raise :class:`InputError` if its columns are not usable."""
        limits.COLUMNS.check("standard input, line 1", len(self.names))
        twice = repeated(self.names)
        if twice is not None:
            raise InputError(f"standard input, line 1: column {twice!r} occurs twice; rename one or drop it")
        timed = next((name for name in (COMMAND_TIME, PULSE_START) if self._has((name,))), None)
        if timed is not None:
            raise InputError(
                f"standard input, line 1: column {self._column(timed)!r}: live estimation does not support commands with their own times; "
                "write each command in the first record of its control cycle, or record a log for massprop estimate"
            )
        jets, wrench = [jet(each.name) for each in self.vehicle.jets], self._has(WRENCH)
        if wrench and self._has(jets):
            raise InputError("standard input: has both jet_* and cmd_* columns; keep the kind that was executed")
        columns = StreamColumns(
            rates=not self._has(DELTA_THETA) and self._has(GYRO),
            accelerations=not self._has(DELTA_V) and self._has(ACCEL),
            commands=WRENCH if wrench else tuple(jets),
            jets=not wrench,
            speeds=tuple(SPEED.of(wheel.name) for wheel in self.vehicle.wheels),
        )
        missing = [self._column(name) for name in (*columns.required, *columns.commands) if self._column(name) not in self.names]
        if missing or not (columns.commands or columns.speeds):
            raise InputError(
                f"standard input: the first line lacks {', '.join(missing) or 'commands'}; begin with the names of all columns (CSV), or "
                "with a JSON object that has them all, or map them under [columns] of the vehicle file"
            )
        self._check_as_log()
        return columns

    def _check_as_log(self) -> None:
        """Raise :class:`InputError` if massprop would refuse a log with these columns: a jet, a wheel or a mapping is not the vehicle's."""
        zeros = dict.fromkeys(self.names, np.zeros(1))
        log = LogTable(at_hand(Path("standard input"), zeros, by_line([1])), self.vehicle.columns)
        commands.commands(log, self.vehicle, 1, 1)
        commands.momentum(log, self.vehicle, 1, 1)

    def _cells(self, line: str) -> dict[str, str]:
        """Texts of a line by column."""
        if self.is_json:
            values = _object(line)
            unknown = [name for name in values if name not in self.names]
            if unknown and len(values) - len(unknown) < len(self.names) - 1:  # a known column is missing, so it may have a new name
                raise RecordError(f"has {unknown[0]!r}, which the first record lacks")
            return {name: _text(values.get(name)) for name in self.names}
        fields = _fields(line)
        if len(fields) != len(self.names):
            raise RecordError(f"has {len(fields)} fields, but the header has {len(self.names)}")
        return dict(zip(self.names, fields, strict=True))

    def _number(self, name: str, cells: dict[str, str]) -> float:
        """Value of massprop's column ``name``, SI; NaN for an empty cell."""
        text = cells[self._column(name)].strip()
        try:
            value = float(text if text.isascii() and "_" not in text else "no number") if text else math.nan
        except ValueError:
            raise RecordError(f"column {self._column(name)}: {text!r} is not a number") from None
        if math.isinf(value):
            raise RecordError(f"column {self._column(name)}: {text} is not a finite number")
        scale = self.vehicle.columns[name].scale if name in self.vehicle.columns else 1.0
        return value * scale


def _object(line: str) -> dict[str, object]:
    """A line as a JSON object."""
    try:
        value = json.loads(line, object_pairs_hook=_without_repeats)
    except RecordError:
        raise
    except (ValueError, RecursionError):
        raise RecordError("is not JSON") from None
    if not isinstance(value, dict):
        raise RecordError("is no JSON object")
    return value


def _without_repeats(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """An object from its members; raise :class:`RecordError` if a name occurs twice."""
    twice = repeated(name for name, _ in pairs)
    if twice is not None:
        raise RecordError(f"names {twice!r} twice")
    return dict(pairs)


def _check_length(line: str) -> None:
    if len(line) > LONGEST:
        raise RecordError(f"has more than {LONGEST} characters")


def _fields(line: str) -> list[str]:
    """Fields of a line of CSV."""
    try:
        return next(csv.reader([line]))
    except (csv.Error, StopIteration):
        raise RecordError("is not a line of CSV") from None


def _text(value: object) -> str:
    """A value of a JSON object as a cell of CSV."""
    if value is None:
        return ""
    if isinstance(value, bool | list | dict):
        raise RecordError(f"{json.dumps(value)[:40]} is neither number nor text")
    return repr(value) if isinstance(value, float) else str(value)


def _line(cells: Iterable[str]) -> str:
    """A line of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()
