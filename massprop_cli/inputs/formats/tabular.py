"""CSV and Parquet tables as recordings: a column is a stream."""

from __future__ import annotations

import re
from pathlib import Path

from massprop_cli.base.spill import Content
from massprop_cli.inputs import tablefile
from massprop_cli.inputs.formats.recording import Read, Stream

_UNIT = re.compile(r"[\[(]\s*([^\])]{1,20})\s*[\])]\s*$")


def read(path: Path, data: Content) -> Read:
    """A stream for each column, whatever it holds; its numbers are read when they are asked for."""
    table = tablefile.columns_of(path, data)
    streams = [Stream(name, table.rows, cells.numbers, unit=_unit(name)) for name, cells in table.columns.items()]
    return Read(streams, vehicle=table.embedded_vehicle, map=table.embedded_map)


def _unit(name: str) -> str:
    """As headers have it, in brackets: ``gyro_x [deg/s]``."""
    found = _UNIT.search(name)
    return found[1] if found else ""
