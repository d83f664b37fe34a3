"""CSV and Parquet files as columns of numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from csv import Error as CsvError
from csv import reader as csv_lines
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli.base import arrow, limits, spill
from massprop_cli.base.arrays import Array, IntArray
from massprop_cli.base.configfile import repeated
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.lazy import pa, pacsv, pc
from massprop_cli.base.spill import Content
from massprop_cli.inputs import instants, parquetheader
from massprop_cli.inputs.formats import csvdialect, recording, units

VEHICLE_KEY = b"massprop.vehicle"
"""Parquet metadata key of an embedded vehicle file."""
MAP_KEY = b"massprop.map"
"""Parquet metadata key of an embedded map file."""
_LINE_END = re.compile(r"\r\n?")
_BLANK_LINE = re.compile(r"\n[ \t]*\n")
_BLANK_BEGINNING = re.compile(r"[ \t]*\n")
_ANYTHING = re.compile(r"\S")
_NUMBER = re.compile(r"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?\s*$")
_PREAMBLE_LINES = 60
"""Number of lines in which a preamble may end."""
_EXACT_INTEGER = 2**53
"""Largest integer up to which float64 represents every integer."""


Place = Callable[[int], str]
"""Text that locates a row for the user: its line in a CSV file, else its number from 0."""
BY_ROW: Place = "row {}".format


def by_line(lines: Sequence[int]) -> Place:
    """Locate rows by line number, as ``line 17``."""
    return lambda row: f"line {lines[row]}"


@dataclass(frozen=True)
class Table:
    """Columns of a file: numbers, with NaN for null."""

    path: Path
    sha256: str
    columns: Mapping[str, Cells]
    rows: int
    place: Place
    embedded_vehicle: str | None = None
    made: MapConversion | None = None
    embedded_map: str | None = None


@dataclass(frozen=True)
class MapConversion:
    """Conversion of a recording to a log's columns by a map."""

    map: str
    """Path of the map file."""
    sha256: str
    """Digest of the map file."""
    conversions: tuple[str, ...]
    """Descriptions of resampling, integration and rotation."""
    sampled: tuple[bool, bool] = (False, False)
    """Whether gyro rates and specific forces are samples at their times."""
    heading: bool = False
    """Whether the attitude is a heading on a planar table."""


def columns_of(path: Path, data: Content) -> Table:
    """Read the columns of a CSV or Parquet file."""
    if not data:
        raise InputError(f"{path}: the file is empty; record the log again")
    found = _read_parquet(path, data) if recording.suffix(path) == ".parquet" else _read_csv(path, data)
    if found.rows == 0:
        raise InputError(f"{path}: has a header but no rows; record the log again")
    return replace(found, sha256=spill.digest(data))


def at_hand(path: Path, columns: Mapping[str, Array], place: Place = BY_ROW) -> Table:
    """Table of columns without a file, all of one length; NaN for null."""
    cells = {name: Cells(path, name, partial(arrow.numbers, values), place) for name, values in columns.items()}
    return Table(path, "", cells, len(next(iter(columns.values()))), place)


def _check_names(where: str, names: Sequence[str]) -> None:
    """Raise :class:`InputError` for a repeated column name."""
    twice = repeated(names)
    if twice is not None:
        times = names.count(twice)
        grouped = "; if this line names groups of columns, delete it, and put them into the names below" if times > 2 else ""
        problem = f"column {twice!r} occurs {'twice' if times == 2 else f'{times} times'}"
        raise InputError(f"{where}: {problem}; rename one or drop it{grouped}")


def _read_parquet(path: Path, data: Content) -> Table:
    with _readable(path):
        columns = parquetheader.ParquetColumns(str(path), data)

    def column(name: str) -> Any:
        with _readable(path):
            return columns.column(name).combine_chunks()

    embedded = {key: columns.metadata[key].decode("utf-8", "replace") for key in (VEHICLE_KEY, MAP_KEY) if key in columns.metadata}
    for key, what in ((VEHICLE_KEY, "vehicle"), (MAP_KEY, "map")):
        limits.CONFIG.check(f"{path} (embedded {what})", len(embedded.get(key, "")))
    _check_names(str(path), columns.names)
    cells = {name: Cells(path, name, partial(column, name), BY_ROW, columns.instants.get(name, "")) for name in columns.names}
    return Table(path, "", cells, columns.rows, BY_ROW, embedded.get(VEHICLE_KEY), embedded_map=embedded.get(MAP_KEY))


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Convert exceptions in the block to :class:`InputError` about a damaged Parquet file."""
    try:
        yield
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: not a readable Parquet file ({reason}); copy it again from the recorder") from None


def _read_csv(path: Path, data: Content) -> Table:
    data, before = csvdialect.body(csvdialect.utf8(path, data))
    header, lines = _plain_lines(data) or _any_lines(path, data)
    if before:
        lines = [number + before for number in lines]
    cut, top = csvdialect.delimiter(header), f"{path}, line {before + 1}"
    limits.COLUMNS.check(top, header.count(cut) + 1)
    limits.NUMBERS.check(str(path), (header.count(cut) + 1) * len(lines))
    names = _names(top, header, cut)
    if not any(names):
        raise InputError(f"{top}: no header; the first line names the columns")
    if len(names) == 1:
        spaced = len(names[0].split()) > 1 and len(lines) > 1
        remedy = "write a comma for each space, or delete the lines above it" if spaced else "delete the lines above it"
        raise InputError(
            f"{top}: one column only, {names[0][:40]!r}; the first line names the columns, separated by commas, semicolons, tabs or bars "
            f"(|); {remedy}"
        )
    if all(map(_NUMBER.match, names)):
        raise InputError(f"{top}: numbers instead of names; write a line above them that names the columns")
    _check_names(top, names)
    if not lines:
        raise InputError(f"{path}: has a header but no rows; record the log again")
    try:
        # if all cells are numbers, they need less memory than their texts
        place, columns = by_line(lines), _numbers(data, names, cut, len(lines))
        return Table(path, "", {name: Cells(path, name, partial(columns.get, name), place) for name in names}, len(lines), place)
    except pa.ArrowException:
        table = csvdialect.with_points(path, _texts(path, data, names, cut), cut, by_line(lines))
    if table.num_rows != len(lines):
        lines = range(2, table.num_rows + 2)  # a quoted cell spans several lines
    stated = _units(table)
    if stated:
        table, lines = table.slice(1), lines[1:]
    dated = {name: "ns" for name in names if instants.is_instant(str(table.column(name)[0].as_py() or ""))} if table.num_rows else {}
    place = by_line(lines)
    cells = {name: Cells(path, name, table.column(name).combine_chunks, place, dated.get(name, ""), stated.get(name, "")) for name in names}
    return Table(path, "", cells, table.num_rows, place)


def _units(table: Any) -> Mapping[str, str]:
    """Units by column, if most cells of the first row are units and none is a number; else empty."""
    first = {name: str(table.column(name)[0].as_py() or "").strip() for name in table.column_names if table.num_rows}
    named = {name: cell for name, cell in first.items() if cell.strip("[]()-")}
    known = sum(map(units.is_any, named.values()))
    return named if 2 * known > len(named) and not any(map(_NUMBER.match, named.values())) else {}


def _plain_lines(data: Content) -> tuple[str, Sequence[int]] | None:
    """Header and line numbers, read in pieces; None for blank lines or unusual line ends."""
    header, first, count, ended = "", True, 0, True
    try:
        for piece in spill.pieces(data):
            text = str(piece, "utf-8-sig" if first else "utf-8").replace("\r\n", "\n")
            if first:
                header, _, text = text.partition("\n")
            if "\r" in text or "\r" in header or _BLANK_BEGINNING.match(text) or _BLANK_LINE.search(text):
                return None
            first, count, ended = False, count + text.count("\n"), text.endswith("\n")
    except UnicodeDecodeError:
        return None
    return (header, range(2, count + (not ended) + 2)) if count else None


def _any_lines(path: Path, data: Content) -> tuple[str, Sequence[int]]:
    """Header and line numbers, read at once."""
    try:
        text = str(data, "utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a readable CSV file ({error.reason} at byte {error.start}); save the log as UTF-8 text") from None
    if "\r" in text:
        text = _LINE_END.sub("\n", text)
    end = text.find("\n") if "\n" in text else len(text)
    header = text[:end]
    if _BLANK_LINE.search(text, end) or not _ANYTHING.search(text, end):
        return header, [number for number, line in enumerate(text[end + 1 :].split("\n"), 2) if line.strip()]
    return header, range(2, text.count("\n", end) + (not text.endswith("\n")) + 1)


def _numbers(data: Content, names: Sequence[str], cut: str, rows: int) -> dict[str, Any]:
    """Columns of a CSV file with only numbers, NaN for null. Raises Arrow's exception for other cells, or another number of rows."""
    found, first = [spill.empty(rows) for _ in names], 0
    with pacsv.open_csv(pa.BufferReader(pa.py_buffer(data)), *_options(names, cut, pa.float64())) as batches:
        for batch in batches:
            if first + len(batch) > rows:
                raise pa.ArrowInvalid("more rows than lines")
            for values, column in zip(found, batch.columns, strict=True):
                values[first : first + len(batch)] = arrow.floats(column)
            first += len(batch)
            spill.give_back()
    if first < rows:
        raise pa.ArrowInvalid("fewer rows than lines")
    return {name: arrow.held(values) for name, values in zip(names, found, strict=True)}


def _options(names: Sequence[str], cut: str, kind: Any) -> tuple[Any, Any, Any]:
    """Arrow's options for a CSV file with cells of one type."""
    convert = pacsv.ConvertOptions(column_types=dict.fromkeys(names, kind), strings_can_be_null=True, null_values=[""])
    return pacsv.ReadOptions(column_names=names, skip_rows=1, use_threads=False), pacsv.ParseOptions(delimiter=cut), convert


def _texts(path: Path, data: Content, names: Sequence[str], cut: str) -> Any:
    """Columns of a CSV file as texts. Raises :class:`InputError` with the line that has too few or too many cells."""
    try:
        return pacsv.read_csv(pa.BufferReader(pa.py_buffer(data)), *_options(names, cut, pa.string()))
    except pa.ArrowException as error:
        for number, line in enumerate(_LINE_END.sub("\n", str(data, "utf-8-sig")).split("\n")[1:], 2):
            found = line.count(cut) + 1
            if line.strip() and found != len(names) and '"' not in line:
                above = "; or if the column names are further down, delete the lines above them" if number <= _PREAMBLE_LINES else ""
                raise InputError(f"{path}, line {number}: {found} cells under {len(names)} columns; correct the line{above}") from None
        raise InputError(f"{path}: not a readable CSV file ({str(error).splitlines()[0]})") from None


def _names(top: str, header: str, cut: str) -> list[str]:
    """Column names in the first line of a CSV file."""
    try:
        return [name.strip() for name in next(csv_lines([header], delimiter=cut), [])]
    except CsvError as error:
        raise InputError(f"{top}: not a readable header ({error}); the first line names the columns") from None


def give_back() -> None:
    """Return Arrow's unused memory to the system: for a long log up to a third of its size."""
    pa.default_memory_pool().release_unused()


@dataclass(frozen=True)
class Cells:
    """Column of a file."""

    path: Path
    name: str
    read: Callable[[], Any]
    """Function that returns Arrow's array."""
    place: Place
    instants: str = ""
    """Unit of dates and times, if the column has such."""
    unit: str = ""
    """Unit in the row below the header."""

    def counts(self) -> IntArray | Array:
        """(rows,) dates and times as integers; float64 with empty cells. Raises :class:`InputError` for the first invalid cell."""
        data = self.read()
        if not pa.types.is_temporal(data.type):
            data = instants.instants(data)
        if data is None:
            raise self._no_instant()
        whole = data.cast(pa.int64())
        if whole.null_count:
            return arrow.floats(whole.cast(pa.float64(), safe=False))  # precise to a quarter of a microsecond
        return np.asarray(np.frombuffer(whole.buffers()[1], np.int64)[whole.offset : whole.offset + len(whole)])

    def _no_instant(self) -> InputError:
        for row, cell in enumerate(value.as_py() for value in self.read()):
            if cell is not None and not instants.is_instant(cell):
                problem = f"{cell!r} is not a date and time; correct the cell; {instants.FORMS}"
                return InputError(f"{self.path}, {self.place(row)}, column {self.name}: {problem}")
        return InputError(
            f"{self.path}, column {self.name}: dates in different formats, or not dates; write all in one format, or as numbers"
        )

    def texts(self) -> list[str | None]:
        """(rows,) text, None for null; numbers as written."""
        return [None if cell is None else str(cell) for cell in self.read().to_pylist()]

    def recorded(self) -> IntArray | Array:
        """(rows,) integers if all cells are, such as nanoseconds since 1970, which exceed float64; else as :meth:`numbers`."""
        data = self.read()
        if not pa.types.is_integer(data.type) or data.null_count:
            return self.numbers()
        return np.asarray(data.to_numpy(zero_copy_only=False))

    def numbers(self) -> Array:
        """(rows,) float64, NaN for null. Raises :class:`InputError` for the first cell that is not a number."""
        data = self.read()
        if pa.types.is_boolean(data.type) or pa.types.is_temporal(data.type):
            hint = ", or name it as a clock in a map file" if self.instants else ""
            raise InputError(f"{self.path}, column {self.name}: holds {data.type}; write plain numbers (times in seconds){hint}")
        if pa.types.is_dictionary(data.type):
            converted = self._converted(data.dictionary, data).take(data.indices)
        else:
            converted = data if pa.types.is_float64(data.type) else self._converted(data, data)
        return arrow.floats(converted)

    def _converted(self, data: Any, whole: Any) -> Any:
        if pa.types.is_string(data.type) or pa.types.is_large_string(data.type):
            data = pc.utf8_trim_whitespace(data)
        try:
            return data.cast(pa.float64())
        except pa.ArrowException:
            raise self._no_number(whole) from None

    def _no_number(self, data: Any) -> InputError:
        for row, cell in enumerate(value.as_py() for value in data):
            if isinstance(cell, int) and abs(cell) > _EXACT_INTEGER:
                return InputError(
                    f"{self.path}, {self.place(row)}, column {self.name}: {cell} is an integer with more digits than float64 holds; "
                    "subtract the first value of the log, or write it as float64"
                )
            try:
                is_number = cell is None or (str(cell).isascii() and "_" not in str(cell) and float(cell) is not None)
            except (TypeError, ValueError):
                is_number = False
            if isinstance(cell, list | dict):
                return InputError(f"{self.path}, column {self.name}: each cell has {len(cell)} values; write a column for each of them")
            if cell == self.name:
                return InputError(
                    f"{self.path}, {self.place(row)}, column {self.name}: the header repeats here, so another recording begins: split the "
                    "file there"
                )
            if not is_number:
                remedy = "correct the cell"
                if self.instants:  # already in the first row
                    remedy = "name the column as a clock in a map file (massprop columns with --as-map drafts it)"
                elif instants.is_like(str(cell)):
                    remedy += f"; {instants.FORMS}"
                return InputError(f"{self.path}, {self.place(row)}, column {self.name}: {cell!r} is not a number; {remedy}")
        return InputError(f"{self.path}, column {self.name}: {data.type} is not a number type; write it as float64")
