"""What tests of unusable input share: logs with one thing wrong, and what a refusal must be."""

import contextlib
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv
from typer.testing import CliRunner

from massprop_cli.cli import app

SAMPLES = Path(__file__).parents[1] / "sample_logs"
NAN, INF = float("nan"), float("inf")
Edit = Callable[[Any], Any]


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def refused(folder: Path, *arguments: str | Path, names: Iterable[str | Path], out: Path | None = None) -> str:
    """Check that ``massprop estimate`` refuses as it should and that its message names all of ``names``; the message.

    In this process, which takes a fifth of the time: what a process of its own makes of a refusal, tests/cli shows.
    """
    before = contents(folder)
    with contextlib.chdir(folder), np.errstate(all="ignore"):
        done = CliRunner().invoke(app, ["estimate", *map(str, arguments), "--out", str(out or folder / "out")])
    assert done.exit_code == 3, f"exit {done.exit_code}, stderr: {done.stderr}"
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1, f"{len(lines)} lines: {done.stderr}"
    assert lines[0].startswith("massprop: ")
    for name in names:
        assert re.search(rf"(?<!\w){re.escape(str(name))}(?!\w)", lines[0]), f"{str(name)!r} is not in: {lines[0]}"
    assert contents(folder) == before, "something was written"
    return lines[0]


def flight(sample: str = "free-flyer", rows: int = 100) -> Any:
    return pq.read_table(SAMPLES / sample / "log.parquet").slice(0, rows).replace_schema_metadata()


def save(table: Any, path: Path) -> Path:
    if path.suffix == ".csv":
        csv.write_csv(table, path, csv.WriteOptions(quoting_style="none"))
    else:
        pq.write_table(table, path)
    return path


def vehicle_text(sample: str = "free-flyer") -> str:
    return (SAMPLES / sample / "vehicle.toml").read_text(encoding="utf-8")


def save_vehicle(folder: Path, text: str | None = None) -> Path:
    path = folder / "vehicle.toml"
    path.write_text(vehicle_text() if text is None else text, encoding="utf-8")
    return path


def replaced(table: Any, column: str, values: list[Any], kind: Any) -> Any:
    return table.set_column(table.column_names.index(column), column, pa.array(values, kind))


def cell(column: str, row: int, value: float | None) -> Edit:
    def edit(table: Any) -> Any:
        values = table.column(column).to_pylist()
        values[row] = value
        return replaced(table, column, values, pa.float64())

    return edit


def cells(column: str, row: int, value: float | None) -> Edit:
    """In this row and every fifth one from it on."""

    def edit(table: Any) -> Any:
        values = table.column(column).to_pylist()
        return replaced(table, column, [value if at >= row and (at - row) % 5 == 0 else old for at, old in enumerate(values)], pa.float64())

    return edit


def text_cell(column: str, row: int, text: str) -> Edit:
    def edit(table: Any) -> Any:
        values = [str(value) for value in table.column(column).to_pylist()]
        values[row] = text
        return replaced(table, column, values, pa.string())

    return edit


def times(change: Callable[[int, float], float]) -> Edit:
    def edit(table: Any) -> Any:
        values = [change(row, value) for row, value in enumerate(table.column("time_s").to_pylist())]
        return replaced(table, "time_s", values, pa.float64())

    return edit


def renamed(old: str, new: str) -> Edit:
    return lambda table: table.rename_columns([new if name == old else name for name in table.column_names])


def without(*columns: str) -> Edit:
    return lambda table: table.drop_columns(list(columns))


def added(**columns: float) -> Edit:
    def edit(table: Any) -> Any:
        for name, value in columns.items():
            table = table.append_column(name, pa.array([value] * table.num_rows, pa.float64()))
        return table

    return edit


def both(first: Edit, second: Edit) -> Edit:
    return lambda table: second(first(table))
