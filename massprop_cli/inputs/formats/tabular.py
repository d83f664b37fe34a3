"""CSV and Parquet tables as recordings: a column is a stream."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from massprop_cli.base.spill import Content
from massprop_cli.inputs import tablefile
from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.recording import Numbers, Read, Stream
from massprop_cli.inputs.tablefile import Cells, Table


def read(path: Path, data: Content) -> Read:
    """A stream for each column, whatever it holds; its numbers are read when they are asked for."""
    table = tablefile.columns_of(path, data)
    return Read([_stream(table, *column) for column in table.columns.items()], vehicle=table.embedded_vehicle, map=table.embedded_map)


def _stream(table: Table, name: str, cells: Cells) -> Stream:
    load: Callable[[], Numbers] = cells.counts if cells.instants else cells.numbers
    return Stream(name, table.rows, load, unit=cells.instants or cells.unit or units.behind(name)[1], place=cells.places.of)
