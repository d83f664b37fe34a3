"""Lines of telemetry to records: CSV with a header line, or a JSON object on each line. The first line says which."""

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
"""Letters of a line."""


def lines_of(stream: IO[str]) -> Iterator[str]:
    """A stream's lines; of one longer than :data:`LONGEST` the beginning. :class:`InputError` where the stream can't be read."""
    while line := _beginning(stream):
        rest = line
        while len(rest) > LONGEST and not rest.endswith("\n"):
            rest = _beginning(stream)
        yield line


def _beginning(stream: IO[str]) -> str:
    try:
        return stream.readline(LONGEST + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"standard input: cannot be read ({getattr(error, 'strerror', None) or error}); pipe a log into it") from None


class RecordError(ValueError):
    """A line that is no record; the message says why."""


@dataclass(frozen=True)
class StreamColumns:
    """Which of a stream's own columns hold what, under the contract's names."""

    rates: bool
    """Whether the gyro's columns are rates, not increments."""
    accelerations: bool
    commands: tuple[str, ...]
    jets: bool
    speeds: tuple[str, ...] = ()
    """Of wheels, at each record's end."""

    @property
    def required(self) -> tuple[str, ...]:
        """Columns in which every record has a number."""
        theta, velocity = GYRO if self.rates else DELTA_THETA, ACCEL if self.accelerations else DELTA_V
        return (TIME, *theta, *velocity, *self.speeds)


@dataclass(frozen=True)
class Record:
    """One line, checked by itself."""

    numbers: dict[str, float]
    """Under the contract's names; NaN where a command's cell is empty."""
    row: str
    """As it is kept, a line of CSV."""

    @property
    def time_s(self) -> float:
        """The end of its interval."""
        return self.numbers[TIME]


class StreamReader:
    """Reads the lines of one stream."""

    def __init__(self, vehicle: Vehicle, first: str) -> None:
        """``first`` is the stream's first line. :class:`InputError` where it lacks a column that is needed."""
        _check_length(first)
        self.vehicle, self.is_json = vehicle, first.lstrip().startswith("{")
        self.names = list(_object(first)) if self.is_json else [name.strip() for name in _fields(first)]
        self.own = {name: column.from_ for name, column in vehicle.columns.items()}
        if self.is_json and not self._has((EVENT,)):
            self.names.append(self._own(EVENT))  # an object names what happened where it did
        self.columns = self._columns()

    @property
    def header(self) -> str:
        """The header line of the recording."""
        return _line(self.names)

    def read(self, line: str) -> Record:
        """Read one line; :class:`RecordError` where it is no record."""
        _check_length(line)
        cells = self._cells(line)
        numbers = {name: self._number(name, cells) for name in (*self.columns.required, *self.columns.commands)}
        for name in self.columns.required:
            if not math.isfinite(numbers[name]):
                raise RecordError(f"column {self._own(name)}: {cells.get(self._own(name)) or 'an empty cell'} is not a finite number")
        for name in (*DELTA_THETA, *DELTA_V, *GYRO, *ACCEL):
            # an increment is over a cycle at most
            longest_s = self.vehicle.cycle.period_s if name in (*DELTA_THETA, *DELTA_V) else 1.0
            if abs(numbers.get(name, 0.0)) > ABSURD[name] * longest_s:
                raise RecordError(f"column {self._own(name)}: {numbers[name]:g} is too fast for a vehicle")
        for name in self.columns.commands if self.columns.jets else ():
            if numbers[name] < 0 or numbers[name] > self.vehicle.cycle.period_s * (1 + 1e-6):
                raise RecordError(
                    f"column {self._own(name)}: {numbers[name]:g} s is not an on-time of a cycle of {self.vehicle.cycle.period_s:g} s"
                )
        return Record(numbers, _line([cells[name] for name in self.names] if not self._has(QUATERNION) else self._kept(cells)))

    def _kept(self, cells: dict[str, str]) -> list[str]:
        """A row for the recording; massprop estimate takes a unit quaternion or four empty cells, so any other becomes empty."""
        own = [self._own(name) for name in QUATERNION]
        try:
            norm = math.hypot(
                *(self._number(name, cells) if column in cells else math.nan for name, column in zip(QUATERNION, own, strict=True))
            )
        except RecordError:
            norm = math.nan
        usable = abs(norm - 1) <= OFF_UNIT
        return [cells[name] if usable or name not in own else "" for name in self.names]

    def _own(self, name: str) -> str:
        return self.own.get(name, name)

    def _has(self, names: Sequence[str]) -> bool:
        return any(self._own(name) in self.names for name in names)

    def _columns(self) -> StreamColumns:
        limits.COLUMNS.check("standard input, line 1", len(self.names))
        twice = repeated(self.names)
        if twice is not None:
            raise InputError(f"standard input, line 1: column {twice!r} occurs twice; rename one or drop it")
        timed = next((name for name in (COMMAND_TIME, PULSE_START) if self._has((name,))), None)
        if timed is not None:
            raise InputError(
                f"standard input, line 1: column {self._own(timed)!r}: live estimation does not support commands with their own times; "
                "write each command in the first record of its control cycle, or record a log for massprop estimate"
            )
        jets, wrench = [jet(each.name) for each in self.vehicle.jets], self._has(WRENCH)
        if wrench and self._has(jets):
            raise InputError("standard input: has both jet_* and cmd_* columns; keep the kind that was executed")
        found = StreamColumns(
            rates=not self._has(DELTA_THETA) and self._has(GYRO),
            accelerations=not self._has(DELTA_V) and self._has(ACCEL),
            commands=WRENCH if wrench else tuple(jets),
            jets=not wrench,
            speeds=tuple(SPEED.of(wheel.name) for wheel in self.vehicle.wheels),
        )
        missing = [self._own(name) for name in (*found.required, *found.commands) if self._own(name) not in self.names]
        if missing or not (found.commands or found.speeds):
            raise InputError(
                f"standard input: the first line lacks {', '.join(missing) or 'commands'}; begin with the names of all columns (CSV), or "
                "with a JSON object that has them all, or map them under [columns] of the vehicle file"
            )
        self._check_as_log()
        return found

    def _check_as_log(self) -> None:
        """:class:`InputError` where a log of these columns would be refused: of a jet, a wheel or a map that are not of this vehicle."""
        zeros = dict.fromkeys(self.names, np.zeros(1))
        log = LogTable(at_hand(Path("standard input"), zeros, by_line([1])), self.vehicle.columns)
        commands.commands(log, self.vehicle, 1, 1)
        commands.momentum(log, self.vehicle, 1, 1)

    def _cells(self, line: str) -> dict[str, str]:
        if self.is_json:
            found = _object(line)
            strange = [name for name in found if name not in self.names]
            if strange and len(found) - len(strange) < len(self.names) - 1:  # another name for what it had
                raise RecordError(f"has {strange[0]!r}, which the first record lacks")
            return {name: _text(found.get(name)) for name in self.names}
        fields = _fields(line)
        if len(fields) != len(self.names):
            raise RecordError(f"has {len(fields)} fields, but the header has {len(self.names)}")
        return dict(zip(self.names, fields, strict=True))

    def _number(self, name: str, cells: dict[str, str]) -> float:
        text = cells[self._own(name)].strip()
        try:
            value = float(text if text.isascii() and "_" not in text else "no number") if text else math.nan
        except ValueError:
            raise RecordError(f"column {self._own(name)}: {text!r} is not a number") from None
        if math.isinf(value):
            raise RecordError(f"column {self._own(name)}: {text} is not a finite number")
        scale = self.vehicle.columns[name].scale if name in self.vehicle.columns else 1.0
        return value * scale


def _object(line: str) -> dict[str, object]:
    try:
        found = json.loads(line, object_pairs_hook=_once)
    except RecordError:
        raise
    except (ValueError, RecursionError):
        raise RecordError("is not JSON") from None
    if not isinstance(found, dict):
        raise RecordError("is no JSON object")
    return found


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    twice = repeated(name for name, _ in pairs)
    if twice is not None:
        raise RecordError(f"names {twice!r} twice")
    return dict(pairs)


def _check_length(line: str) -> None:
    if len(line) > LONGEST:
        raise RecordError(f"has more than {LONGEST} characters")


def _fields(line: str) -> list[str]:
    try:
        return next(csv.reader([line]))
    except (csv.Error, StopIteration):
        raise RecordError("is not a line of CSV") from None


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool | list | dict):
        raise RecordError(f"{json.dumps(value)[:40]} is neither number nor text")
    return repr(value) if isinstance(value, float) else str(value)


def _line(cells: Iterable[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()
