"""A recording read: a table here, any other in a process of its own (:mod:`massprop_cli.inputs.formats.apart`)."""

from __future__ import annotations

from pathlib import Path

from massprop_cli.base import limits, spill
from massprop_cli.base.errors import InputError
from massprop_cli.base.spill import Content
from massprop_cli.inputs.formats import bagfolder
from massprop_cli.inputs.formats.recording import TABLE, Recording, Stream, counted, kind


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
        from massprop_cli.inputs.formats import tabular

        said = tabular.read(path, data)
    else:
        from massprop_cli.inputs.formats import apart

        said = apart.read(path, bytes(data), found)
    streams: dict[str, Stream] = {}
    for one in counted(path, said.streams):
        streams.setdefault(one.path, one)
    if not any(one.rows for one in streams.values()):
        raise InputError(f"{path}: holds no numbers; record the log again")
    return Recording(path, spill.digest(data), found.name, streams, said.parameters, said.vehicle, said.map)
