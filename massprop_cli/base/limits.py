"""Limits of input (docs/limits.md), checked before allocation, and the reading of files from outside."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from massprop_cli.base import spill
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError, MachineError
from massprop_cli.base.spill import Content

_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket"}


@dataclass(frozen=True)
class Limit:
    """Limit of one kind of input."""

    variable: str
    """Environment variable that overrides the default."""
    default: int
    of: str
    """Counted unit, for messages."""

    @property
    def most(self) -> int:
        """Limit in force; :class:`MachineError` if the environment variable is not a positive whole number."""
        value = os.environ.get(self.variable)
        if value is None:
            return self.default
        if not (value.isascii() and value.isdecimal() and 0 < len(value) <= 18 and int(value) > 0):
            raise MachineError(f"{self.variable}={value}: not a limit; give an integer above 0, or unset it (default {self.default})")
        return int(value)

    def check(self, place: str, found: int) -> None:
        """Raise :class:`MachineError` if ``found`` exceeds the limit; ``place`` begins the message."""
        if found > self.most:
            raise MachineError(f"{place}: {found} {self.of}; the limit is {self.most} ({self.variable}). Is it the right file?")


LOG = Limit("MASSPROP_MAX_LOG_BYTES", 2**30, "bytes of a log")
RESULT = Limit("MASSPROP_MAX_RESULT_BYTES", 2**28, "bytes of a result")
CONFIG = Limit("MASSPROP_MAX_CONFIG_BYTES", 2**20, "bytes of a configuration")
NUMBERS = Limit("MASSPROP_MAX_NUMBERS", 2**26, "cells")
"""Cells of a table, with unused columns: 64 M are 45 minutes at 1 kHz with 18 jets and take 0.5 GB."""
COLUMNS = Limit("MASSPROP_MAX_COLUMNS", 4096, "columns")
STREAMS = Limit("MASSPROP_MAX_STREAMS", 2**16, "streams")
"""Streams of a recording by another program; PX4's have thousands."""
FOOTER = Limit("MASSPROP_MAX_FOOTER_BYTES", 2**21, "bytes of Parquet metadata")
DEPTH = Limit("MASSPROP_MAX_DEPTH", 32, "levels of tables")
"""Nesting of a configuration or a result; the formats have six levels, and Python's recursion limit is some hundreds."""
NAME = Limit("MASSPROP_MAX_NAME", 200, "characters of a key or a name")
TEXT = Limit("MASSPROP_MAX_TEXT", 10_000, "characters of a text in a configuration")
PAGES = Limit("MASSPROP_MAX_PAGES", 2**17, "Parquet pages")
READER_SECONDS = Limit("MASSPROP_MAX_READER_SECONDS", 8, "seconds of a reader")
READER_MEMORY = Limit("MASSPROP_MAX_READER_BYTES", 3 * 2**28, "bytes of a reader's memory")
"""Processor time and memory for reading a recording by another program, in addition to those that its size needs."""


_OF_KIND = {"log": LOG, "campaign.json": LOG, "campaign.parquet": LOG, "history.parquet": LOG, "result.json": RESULT}
"""Limits by kind of file; all other files are configuration."""


def of(what: str) -> Limit:
    """Size limit of a kind of file."""
    return _OF_KIND.get(what, CONFIG)


def is_folder(path: Path) -> bool:
    """Whether a folder exists; False for an invalid name."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def content(path: Path, what: str) -> bytes:
    """Bytes of a regular file of the kind ``what``; FileNotFoundError, or :class:`InputError` if it is too large or cannot be read."""
    limit = of(what)
    with _opened(path, what) as (file, _):
        # the file may grow meanwhile
        data = file.read(limit.most + 1)
    limit.check(str(path), len(data))
    return data


def copied(path: Path) -> Content:
    """Copy of a log as it is now; a large one is not held in memory."""
    with _opened(path, "log") as (file, size):
        return spill.copied(file, size)


@contextmanager
def _opened(path: Path, what: str) -> Iterator[tuple[BinaryIO, int]]:
    """Open a regular file within its size limit; yields the file and its size, bytes."""
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder; name the {what} itself")
        # without O_NONBLOCK, opening a pipe blocks until another process writes to it
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(handle, "rb") as file:
            found = os.fstat(handle)
            if not stat.S_ISREG(found.st_mode):
                kind = _KINDS.get(stat.S_IFMT(found.st_mode), "no regular file")
                raise InputError(f"{path}: is {kind}, not a file; save the {what} as a file first")
            of(what).check(str(path), found.st_size)
            yield file, found.st_size
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}; check the path") from None
