"""CSV and Parquet files to columns of numbers. With the report's writer the only room that knows either format."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.errors import InputError

VEHICLE_KEY = b"massprop.vehicle"
"""Parquet metadata key under which a log may carry its own vehicle file."""


@dataclass(frozen=True)
class Table:
    """Columns as read from a file: numbers with NaN for null, and where they came from."""

    path: Path
    sha256: str
    columns: Mapping[str, Cells]
    rows: int
    first_line: int
    embedded_vehicle: str | None


def read_table(path: Path) -> Table:
    """Read a CSV or Parquet file whole. :class:`InputError` for anything that is not a readable, non-empty table."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name the log file itself")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the path") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if not data:
        raise InputError(f"{path}: the file is empty; record the log again")
    readers = {".parquet": _read_parquet, ".csv": _read_csv}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: unknown kind of file {path.suffix!r}; a log is .parquet or .csv")
    columns, rows, first_line, embedded = readers[path.suffix.lower()](path, data)
    if rows == 0:
        raise InputError(f"{path}: has a header but no rows; record the log again")
    return Table(path, hashlib.sha256(data).hexdigest(), columns, rows, first_line, embedded)


def _read_parquet(path: Path, data: bytes) -> tuple[dict[str, Cells], int, int, str | None]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # read_table() would import pyarrow.dataset and with it pandas; threads still at work at exit abort the process
        table = pq.ParquetFile(pa.BufferReader(data), pre_buffer=False).read(use_threads=False)
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: not a readable Parquet file ({reason}); copy it again from the recorder") from None
    metadata = table.schema.metadata or {}
    embedded = metadata[VEHICLE_KEY].decode("utf-8", "replace") if VEHICLE_KEY in metadata else None
    return _arrow_columns(path, table, 0), table.num_rows, 0, embedded


def _read_csv(path: Path, data: bytes) -> tuple[dict[str, Cells], int, int, str | None]:
    import pyarrow as pa
    from pyarrow import csv

    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a readable CSV file ({error.reason} at byte {error.start}); save the log as UTF-8 text") from None
    names = [name.strip().strip('"') for name in lines[0].split(",")] if lines else []
    if not any(names):
        raise InputError(f"{path}, line 1: no header; the first line names the columns")
    if not any(line.strip() for line in lines[1:]):
        raise InputError(f"{path}: has a header but no rows; record the log again")
    text = pa.string()
    convert = csv.ConvertOptions(column_types=dict.fromkeys(names, text), strings_can_be_null=True, null_values=[""])
    try:
        table = csv.read_csv(
            io.BytesIO(data), read_options=csv.ReadOptions(column_names=names, skip_rows=1, use_threads=False), convert_options=convert
        )
    except pa.ArrowException as error:
        for number, line in enumerate(lines, 1):
            if line.strip() and line.count(",") != len(names) - 1 and '"' not in line:
                found = line.count(",") + 1
                raise InputError(f"{path}, line {number}: {found} cells under {len(names)} columns; mend the line") from None
        raise InputError(f"{path}: not a readable CSV file ({str(error).splitlines()[0]})") from None
    return _arrow_columns(path, table, 2), table.num_rows, 2, None


def _arrow_columns(path: Path, table: Any, first_line: int) -> dict[str, Cells]:
    """Arrow columns, converted to float arrays on first use."""
    names = table.column_names
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        header = ", line 1" if first_line else ""
        raise InputError(f"{path}{header}: column {twice[0]!r} stands twice; rename one or drop it")
    return {name: Cells(path, name, table.column(index), first_line) for index, name in enumerate(names)}


@dataclass(frozen=True)
class Cells:
    """One column of a file; :meth:`numbers` converts it or says which cell can't be converted."""

    path: Path
    name: str
    data: Any
    first_line: int

    def numbers(self) -> Array:
        """(rows,) float64 with NaN for null. :class:`InputError` names the first cell that is no number."""
        import pyarrow as pa
        import pyarrow.compute as pc

        data = self.data.combine_chunks()
        if pa.types.is_string(data.type) or pa.types.is_large_string(data.type):
            data = pc.utf8_trim_whitespace(data)
        try:
            converted = data.cast(pa.float64())
        except (pa.ArrowException, NotImplementedError):
            raise self._no_number(data) from None
        # from buffers: to_numpy() and fill_null() would import pandas where it is installed
        values = np.frombuffer(converted.buffers()[1], np.float64)[converted.offset : converted.offset + len(converted)]
        return np.where(np.from_dlpack(pc.is_valid(converted).cast(pa.uint8())) == 1, values, np.nan)

    def _no_number(self, data: Any) -> InputError:
        for row, cell in enumerate(data.to_pylist()):
            try:
                float(cell) if cell is not None else None
            except (TypeError, ValueError):
                where = place(row, self.first_line)
                return InputError(f"{self.path}, {where}, column {self.name}: {cell!r} is not a number; mend the cell")
        return InputError(f"{self.path}, column {self.name}: {data.type} is not a number type; write it as float64")


def place(row: int, first_line: int) -> str:
    """How a person finds row ``row`` (from 0): a line of a CSV file, else the row."""
    return f"line {row + first_line}" if first_line else f"row {row}"
