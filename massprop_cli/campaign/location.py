"""Locations of logs and their companion files: paths and URLs. All functions that read a job's files."""

import os
import posixpath
from pathlib import Path, PurePosixPath

from massprop_cli.base import configfile, foldername, limits
from massprop_cli.base.errors import InputError
from massprop_cli.campaign import remote


def is_url(location: str) -> bool:
    """Whether the location is a URL, such as s3://bucket/campaign/log.parquet, and not a path."""
    scheme, mark, _ = location.partition("://")
    return bool(mark) and len(scheme) > 1 and "/" not in scheme and not scheme.startswith((".", "~"))


def shared(location: str) -> bool:
    """Whether another machine can read the same file at this location."""
    return is_url(location) and not location.startswith(("file://", "local://", "memory://"))


def read(location: str, what: str) -> bytes:
    """The bytes of a file; ``what`` names its kind in messages. Raise :class:`InputError` if it cannot be read."""
    if is_url(location):
        return remote.read(location, what)
    path = Path(location)
    try:
        return limits.content(path, what)
    except FileNotFoundError:
        raise InputError(f"{path}: no such {what}; check the path") from None


def read_text(location: str, what: str) -> str:
    """The text of a file; raise :class:`InputError` as :func:`read`, and if it is not UTF-8."""
    return configfile.decoded(read(location, what), location, what)


def path(location: str) -> Path:
    """A path for names and messages; of a URL, the file name."""
    return Path(name(location)) if is_url(location) else Path(location)


def sibling(location: str, name: str) -> str:
    """The location of another file in the same folder."""
    return join(folder(location), name)


def folder(location: str) -> str:
    """The location of the folder that a file is in."""
    if not is_url(location):
        return str(Path(location).parent)
    place, *outer = location.split("::", 1)
    return "::".join([place.rstrip("/").rpartition("/")[0], *outer])


def join(base: str, named: str) -> str:
    """The location ``named`` relative to the folder ``base``; a URL or an absolute path is not changed."""
    if is_url(named) or not is_url(base):
        return named if is_url(named) else str(Path(base) / named)
    if posixpath.isabs(named):
        return named
    # the path is in the first URL of a chain such as zip://folder::s3://bucket/all.zip
    place, *outer = base.split("::", 1)
    scheme, _, path = place.partition("://")
    below = posixpath.normpath(posixpath.join("/", path, named)).lstrip("/")
    return "::".join([f"{scheme}://{'/' * path.startswith('/')}{below}", *outer])


def below(location: str, base: str) -> str:
    """The path relative to the folder ``base``, with "/" separators; the location itself if there is no such path."""
    if is_url(location) != is_url(base):
        return location
    if not is_url(base):
        return Path(os.path.relpath(location, base)).as_posix()
    root = base.split("::", 1)[0].rstrip("/") + "/"
    place = location.split("::", 1)[0]
    return place.removeprefix(root) if place.startswith(root) else location


def exists(location: str) -> bool:
    """Whether the file exists."""
    if is_url(location):
        return remote.exists(location)
    return Path(location).exists()


def name(location: str) -> str:
    """The file's name."""
    return PurePosixPath(location.split("::", 1)[0]).name if is_url(location) else Path(location).name


def stem(location: str) -> str:
    """The file's name without .gz and without the suffix before it."""
    return foldername.stem(name(location))
