"""Limits of input (docs/limits.md), checked before anything of that size is allocated, and the one door for files from outside."""

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
    """The most of something that is taken, unless the environment says otherwise."""

    variable: str
    default: int
    of: str
    """What is counted, for messages."""

    @property
    def most(self) -> int:
        """The limit in force; :class:`MachineError` where the environment holds none that can be read."""
        said = os.environ.get(self.variable)
        if said is None:
            return self.default
        if not (said.isascii() and said.isdecimal() and 0 < len(said) <= 18 and int(said) > 0):
            raise MachineError(f"{self.variable}={said}: not a limit; give a whole number above 0, or unset it (then {self.default})")
        return int(said)

    def check(self, place: str, found: int) -> None:
        """:class:`MachineError` where there is more than that."""
        if found > self.most:
            raise MachineError(
                f"{place}: {found} {self.of}, at most {self.most} are taken; is it the right file? {self.variable} sets the limit"
            )


LOG = Limit("MASSPROP_MAX_LOG_BYTES", 2**30, "bytes of a log")
RESULT = Limit("MASSPROP_MAX_RESULT_BYTES", 2**28, "bytes of a result")
CONFIG = Limit("MASSPROP_MAX_CONFIG_BYTES", 2**20, "bytes of a configuration")
NUMBERS = Limit("MASSPROP_MAX_NUMBERS", 2**26, "cells")
"""Of a table, columns nobody needs included: 64 M are 45 minutes at 1 kHz with 18 jets and take 0.5 GB."""
COLUMNS = Limit("MASSPROP_MAX_COLUMNS", 4096, "columns")
STREAMS = Limit("MASSPROP_MAX_STREAMS", 2**16, "streams")
"""Of a recording of another program; PX4's have thousands."""
FOOTER = Limit("MASSPROP_MAX_FOOTER_BYTES", 2**21, "bytes of Parquet metadata")
DEPTH = Limit("MASSPROP_MAX_DEPTH", 32, "levels of tables")
"""Of a configuration or a result; the formats have six. Python's own limit on recursion is at some hundreds."""
NAME = Limit("MASSPROP_MAX_NAME", 200, "characters of a key or a name")
TEXT = Limit("MASSPROP_MAX_TEXT", 10_000, "characters of a text in a configuration")
PAGES = Limit("MASSPROP_MAX_PAGES", 2**17, "Parquet pages")
READER_SECONDS = Limit("MASSPROP_MAX_READER_SECONDS", 8, "seconds of a reader")
READER_MEMORY = Limit("MASSPROP_MAX_READER_BYTES", 3 * 2**28, "bytes of a reader's memory")
"""Of processor time and of memory for a recording of another program, beside what its own size needs."""


_OF_KIND = {"log": LOG, "campaign.json": LOG, "campaign.parquet": LOG, "history.parquet": LOG, "result.json": RESULT}
"""Limits of files; all others are configuration."""


def of(what: str) -> Limit:
    """The limit of the size of a kind of file."""
    return _OF_KIND.get(what, CONFIG)


def is_folder(path: Path) -> bool:
    """Whether there is such a folder; a name that no file may have is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def content(path: Path, what: str) -> bytes:
    """The bytes of a regular file, whose kind ``what`` sets the limit; FileNotFoundError, or :class:`InputError` where it can't be read."""
    limit = of(what)
    with _opened(path, what) as (file, _):
        # a file may grow while it is read
        data = file.read(limit.most + 1)
    limit.check(str(path), len(data))
    return data


def copied(path: Path) -> Content:
    """A log as it was when it was opened, a large one without holding it in memory."""
    with _opened(path, "log") as (file, size):
        return spill.copied(file, size)


@contextmanager
def _opened(path: Path, what: str) -> Iterator[tuple[BinaryIO, int]]:
    """A file that is no larger than it may be, and how large it is."""
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder; name the {what} itself")
        # without O_NONBLOCK opening a pipe waits for someone to write to it
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
