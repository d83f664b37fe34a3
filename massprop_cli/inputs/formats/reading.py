"""A recording read: a table here, any other in a process of its own (:mod:`massprop_cli.inputs.formats.apart`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from massprop_cli.base import limits, spill
from massprop_cli.base.errors import InputError
from massprop_cli.base.spill import Content
from massprop_cli.inputs import tablefile
from massprop_cli.inputs.formats import bagfolder, units
from massprop_cli.inputs.formats.recording import TABLE, Numbers, Read, Recording, Stream, counted, kind
from massprop_cli.inputs.tablefile import Cells, Table


def load(path: Path) -> Recording:
    """A recording from its file, or from the folder of a ROS 2 bag."""
    if bagfolder.is_bag(path):
        return bagfolder.joined(path, [load(file) for file in bagfolder.files(path)])
    try:
        return read(path, limits.content(path, "log"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the path") from None


def read(path: Path, data: Content) -> Recording:
    """A recording from a file's bytes; :class:`InputError` where it can't be read."""
    if not data:
        raise InputError(f"{path}: the file is empty; record the log again")
    found = kind(path)
    if found is TABLE:
        said = read_table(path, data)
    else:
        from massprop_cli.inputs.formats import apart

        said = apart.read(path, bytes(data), found)
    streams: dict[str, Stream] = {}
    for one in counted(path, said.streams):
        streams.setdefault(one.path, one)
    if not any(one.rows for one in streams.values()):
        raise InputError(f"{path}: holds no numbers; record the log again")
    return Recording(path, spill.digest(data), found.name, streams, said.parameters, said.vehicle, said.map)


def read_table(path: Path, data: Content) -> Read:
    """A stream for each column, whatever it holds; its numbers are read_table when they are asked for."""
    table = tablefile.columns_of(path, data)
    return Read([_stream(table, *column) for column in table.columns.items()], vehicle=table.embedded_vehicle, map=table.embedded_map)


def _stream(table: Table, name: str, cells: Cells) -> Stream:
    load: Callable[[], Numbers] = cells.counts if cells.instants else cells.numbers
    return Stream(name, table.rows, load, unit=cells.instants or cells.unit or units.behind(name)[1], place=cells.places.of)
