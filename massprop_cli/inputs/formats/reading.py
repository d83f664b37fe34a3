"""Reading of recordings: tables in this process, other formats in an isolated one (:mod:`massprop_cli.inputs.formats.isolated`)."""

import hashlib
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from massprop_cli.base import limits, spill
from massprop_cli.base.errors import InputError
from massprop_cli.base.spill import Content
from massprop_cli.inputs import tablefile
from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.recording import TABLE, Numbers, Read, RecordedStream, Recording, counted, kind


def load(path: Path) -> Recording:
    """Read a recording from a file, or from the folder of a ROS 2 bag."""
    if is_bag(path):
        return joined(path, [load(file) for file in files(path)])
    if limits.is_folder(path):
        check_no_bag(path)
    try:
        return read(path, limits.content(path, "log"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the path") from None


def read(path: Path, data: Content) -> Recording:
    """Read a recording from a file's bytes. Raises :class:`InputError` if it cannot be read."""
    if not data:
        raise InputError(f"{path}: the file is empty; record the log again")
    found = kind(path)
    if found is TABLE:
        contents = read_table(path, data)
    else:
        from massprop_cli.inputs.formats import isolated

        contents = isolated.read(path, bytes(data), found)
    streams: dict[str, RecordedStream] = {}
    for one in counted(path, contents.streams):
        streams.setdefault(one.path, one)
    if not any(one.rows for one in streams.values()):
        for unread, why in contents.unread.items():
            raise InputError(f"{path}, {unread!r}: {why}")
        raise InputError(f"{path}: holds no numbers; record the log again")
    return Recording(path, spill.digest(data), found.name, streams, contents.parameters, contents.vehicle, contents.map, contents.unread)


def read_table(path: Path, data: Content) -> Read:
    """Streams of a table, one per column; their values are converted on demand."""
    table = tablefile.columns_of(path, data)
    streams = []
    for name, cells in table.columns.items():
        load: Callable[[], Numbers] = cells.counts if cells.instants else cells.recorded
        unit = cells.instants or cells.unit or units.without_suffix_unit(name)[1]
        streams.append(RecordedStream(name, table.rows, load, unit=unit, place=cells.place, texts=cells.texts))
    return Read(streams, vehicle=table.embedded_vehicle, map=table.embedded_map)


METADATA = "metadata.yaml"
STORAGE = (".mcap", ".db3")
_LISTED = re.compile(r"^\s*-\s+['\"]?([^'\"\n]+\.(?:mcap|db3)(?:\.\w+)?)['\"]?\s*$", re.MULTILINE)
"""Entry of ``relative_file_paths``."""


def is_bag(path: Path) -> bool:
    """Whether a path is the folder of a ROS 2 bag, or has one bag file without metadata.yaml."""
    return limits.is_folder(path) and ((path / METADATA).is_file() or len(_stored(path)) == 1)


def check_no_bag(folder: Path) -> None:
    """Raise :class:`InputError` if a folder has several bag files without metadata.yaml."""
    stored = _stored(folder)
    if stored:
        raise InputError(
            f"{folder}: holds {len(stored)} files of ROS 2 bags and no {METADATA}; if they are one bag, make it with ros2 bag reindex "
            f"{folder}; else name one of them, as {stored[0]}"
        )


def _stored(folder: Path) -> list[Path]:
    """Bag files of a folder, by name."""
    try:
        return sorted(path for path in folder.iterdir() if path.suffix in STORAGE and path.is_file())
    except OSError:  # not to be listed
        return []


def joined(folder: Path, parts: Sequence[Recording]) -> Recording:
    """Recording with the streams of all bag files joined."""
    paths = dict.fromkeys(path for part in parts for path in part.streams)
    streams = {path: _joined([part.streams[path] for part in parts if path in part.streams]) for path in paths}
    limits.NUMBERS.check(str(folder), sum(one.rows for one in streams.values()))
    digest = parts[0].sha256 if len(parts) == 1 else hashlib.sha256("".join(part.sha256 for part in parts).encode()).hexdigest()
    unread = {path: why for part in parts for path, why in part.unread.items()}
    return Recording(folder, digest, parts[0].kind, streams, unread=unread)


def files(folder: Path) -> list[Path]:
    """Bag files in the order of metadata.yaml, which is the order of time. Raises :class:`InputError` for missing or compressed files."""
    if not (folder / METADATA).is_file():
        return _stored(folder)
    text = limits.content(folder / METADATA, "map file").decode(errors="replace")
    names = list(dict.fromkeys(Path(name).name for name in _LISTED.findall(text)))
    packed = next((name for name in names if not name.endswith(STORAGE)), None)
    if packed is not None:
        raise InputError(f"{folder / packed}: is compressed as a whole; unpack it, or convert the bag with ros2 bag convert")
    if not names:
        raise InputError(f"{folder / METADATA}: names no .mcap or .db3 file; make it anew with ros2 bag reindex {folder}")
    missing = next((name for name in names if not (folder / name).is_file()), None)
    if missing is not None:
        raise InputError(f"{folder / missing}: no such file, though {METADATA} names it; copy the whole folder")
    return [folder / name for name in names]


def _joined(parts: Sequence[RecordedStream]) -> RecordedStream:
    """Stream with the values of all parts in succession."""
    first = parts[0]
    if len(parts) == 1:
        return first
    return RecordedStream(
        first.path, sum(part.rows for part in parts), lambda: np.concatenate([part.values for part in parts]), first.clock, first.unit
    )
