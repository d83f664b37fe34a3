"""Reading of log files: tables directly, recordings and files with a map through ``formats``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError
from massprop_cli.base.spill import Content
from massprop_cli.inputs.formats import reading, recording
from massprop_cli.inputs.tablefile import Table, columns_of

if TYPE_CHECKING:
    from massprop_cli.inputs.formats.mapfile import MapSource

_URL = re.compile(r"\w\w+:/")


def read_table(path: Path, map_file: Path | None = None) -> Table:
    """Read a log file, with its map if it has one. Raises :class:`InputError` for anything but a readable, non-empty recording."""
    if reading.is_bag(path):
        from massprop_cli.inputs.formats import mapfile, mapped

        return mapped.of(reading.load(path), mapfile.find(path, map_file))
    if limits.is_folder(path):
        reading.check_no_bag(path)
        raise InputError(f"{path}: is a folder; name the log file itself, or all logs in it with massprop batch {path}")
    try:
        data = limits.copied(path)
    except FileNotFoundError:
        # Path removes the second slash of a URL
        url = "; massprop batch reads URLs, this takes a file" if _URL.match(str(path)) else ""
        raise InputError(f"{path}: no such file; check the path{url}") from None
    if (
        recording.is_plain(path)
        and map_file is None
        and not any(path.with_name(name).exists() for name in recording.maps_beside(path.name))
    ):
        return parse(path, data)
    from massprop_cli.inputs.formats import mapfile

    return parse(path, data, mapfile.find(path, map_file))


def parse(path: Path, data: Content, by: MapSource | None = None) -> Table:
    """Read a log from the file's bytes; ``path`` gives its kind and is for messages. An embedded map overrides a map found next to it."""
    kind = recording.kind(path)
    if kind is recording.TABLE:
        table = columns_of(path, data)
        if by is None and table.embedded_map is None:
            stated = next((cells for cells in table.columns.values() if cells.unit), None)
            if stated is not None:
                raise InputError(
                    f"{path}: the row below the header names units, {stated.unit!r} of column {stated.name}, and a log's are in the names "
                    f"of its columns; take the row out, or say what is what in a map file, which massprop columns {path} drafts"
                )
            return table
    from massprop_cli.inputs.formats import mapfile, mapped

    read = reading.read(path, data)
    if read.map is not None and (by is None or not by.named):
        by = mapfile.parse(read.map, f"{path} (embedded map)")
    return mapped.of(read, by)
