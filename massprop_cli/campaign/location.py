"""Where logs and their companions are read from: paths, and URLs. Every byte that a job reads comes through here."""

import os
import posixpath
from pathlib import Path, PurePosixPath

from massprop_cli.base import configfile, foldername, limits
from massprop_cli.base.errors import InputError
from massprop_cli.campaign import remote


def is_url(location: str) -> bool:
    """Whether this is a URL, such as s3://bucket/campaign/log.parquet; a path otherwise."""
    scheme, mark, _ = location.partition("://")
    return bool(mark) and len(scheme) > 1 and "/" not in scheme and not scheme.startswith((".", "~"))


def shared(location: str) -> bool:
    """Whether another machine finds the same file there."""
    return is_url(location) and not location.startswith(("file://", "local://", "memory://"))


def read(location: str, what: str) -> bytes:
    """The bytes of a file (``what`` it is, for messages); :class:`InputError` names it and a remedy."""
    if is_url(location):
        return remote.read(location, what)
    path = Path(location)
    try:
        return limits.content(path, what)
    except FileNotFoundError:
        raise InputError(f"{path}: no such {what}; check the path") from None


def read_text(location: str, what: str) -> str:
    """A file's text; :class:`InputError` names it and a remedy."""
    return configfile.decoded(read(location, what), location, what)


def path(location: str) -> Path:
    """For names and messages; a URL goes by its file's name, since a path can't spell it."""
    return Path(name(location)) if is_url(location) else Path(location)


def beside(location: str, name: str) -> str:
    """The location of another file in the same folder."""
    return join(folder(location), name)


def folder(location: str) -> str:
    """The location of the folder that a file is in."""
    if not is_url(location):
        return str(Path(location).parent)
    place, *outer = location.split("::", 1)
    return "::".join([place.rstrip("/").rpartition("/")[0], *outer])


def join(base: str, named: str) -> str:
    """The location of what is named from a folder on; a URL, or an absolute path, stands for itself."""
    if is_url(named) or not is_url(base):
        return named if is_url(named) else str(Path(base) / named)
    if posixpath.isabs(named):
        return named
    # of a chain such as zip://folder::s3://bucket/all.zip, the path is in the first
    place, *outer = base.split("::", 1)
    scheme, _, path = place.partition("://")
    below = posixpath.normpath(posixpath.join("/", path, named)).lstrip("/")
    return "::".join([f"{scheme}://{'/' * path.startswith('/')}{below}", *outer])


def below(location: str, base: str) -> str:
    """The path from a folder on, with "/" between its parts; the location itself where no path leads there."""
    if is_url(location) != is_url(base):
        return location
    if not is_url(base):
        return Path(os.path.relpath(location, base)).as_posix()
    root = base.split("::", 1)[0].rstrip("/") + "/"
    place = location.split("::", 1)[0]
    return place.removeprefix(root) if place.startswith(root) else location


def exists(location: str) -> bool:
    """Whether there is such a file."""
    if is_url(location):
        return remote.exists(location)
    return Path(location).exists()


def name(location: str) -> str:
    """The file's own name."""
    return PurePosixPath(location.split("::", 1)[0]).name if is_url(location) else Path(location).name


def stem(location: str) -> str:
    """The file's name without its last suffix, and without a .gz after that."""
    return foldername.stem(name(location))
