"""The interface of formats: a module with ``read(path, data) -> Read`` and a line in :data:`KINDS`. What ``read`` raises means damage."""

import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base import foldername, limits
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError

Numbers = NDArray[Any]
"""Numbers of any type: clocks of nanoseconds stay whole."""


@dataclass(frozen=True)
class RecordedStream:
    """One signal of a recording."""

    path: str
    """Its name in the file, unique there."""
    rows: int
    load: Callable[[], Numbers] = field(repr=False)
    clock: str = ""
    """Path of the stream that holds its times; empty where the file doesn't say."""
    unit: str = ""
    """As recorded; empty where none is."""
    place: Callable[[int], str] = field(default="sample {}".format, repr=False)
    """How a person finds one of them."""
    texts: Callable[[], list[str | None]] | None = field(default=None, repr=False)
    """The cells as text, None for an empty one; None where the file has numbers alone."""

    @cached_property
    def values(self) -> Numbers:
        """(rows,) numbers. :class:`InputError` where a cell is none."""
        return self.load()


def stream(path: str, values: Numbers, clock: str = "", unit: str = "") -> RecordedStream:
    """A stream of values at hand."""
    return RecordedStream(path, len(values), lambda: values, clock, unit)


@dataclass(frozen=True)
class Recording:
    """A file as its reader gives it."""

    path: Path
    sha256: str
    kind: str
    """What the file is, for messages."""
    streams: Mapping[str, RecordedStream]
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Settings of the vehicle that the file carries, such as PX4's."""
    vehicle: str | None = None
    """A vehicle file within."""
    map: str | None = None
    """A map file within."""
    unread: Mapping[str, str] = field(default_factory=dict)
    """What the file holds and no reader can read, by its path: what it is, and what to do."""

    def why_unread(self, path: str) -> str:
        """Why there are no streams below a path; empty where the file holds nothing unreadable there."""
        above = next((part for part in self.unread if path == part or path.startswith(tuple(part + mark for mark in "/.({["))), None)
        return "" if above is None else f"{above!r} {self.unread[above]}"


@dataclass(frozen=True)
class Read:
    """What a reader gives."""

    streams: Iterable[RecordedStream]
    parameters: Mapping[str, float] = field(default_factory=dict)
    vehicle: str | None = None
    map: str | None = None
    unread: Mapping[str, str] = field(default_factory=dict)


_ASIDE = re.compile(r"['\"]?(<_io\.BytesIO[^>]*>|\S*\brecording\.\w+)['\"]?")


@dataclass(frozen=True)
class Kind:
    """A format."""

    name: str
    module: str
    """In this package."""
    endings: tuple[str, ...]
    """Of its files' names; .csv and .tsv may end in .gz besides."""
    extra: str = ""
    """Of the distribution, where it needs one."""


TABLE = Kind("table", "reading", (".parquet", ".csv", ".tsv"))
_ALL = (
    TABLE,
    Kind("MATLAB file", "matlab", (".mat",), "matlab"),
    Kind("HDF5 file", "hdf5", (".h5", ".hdf5"), "hdf5"),
    Kind("PX4 ULog", "ulog", (".ulg",), "ulog"),
    Kind("ROS bag", "rosbag", (".bag", ".db3"), "ros"),
    Kind("MCAP file", "mcapfile", (".mcap",), "mcap"),
    Kind("MDF4 file", "mdf", (".mf4",), "mdf"),
)
KINDS = {ending: kind for kind in _ALL for ending in kind.endings}
SUFFIXES = (*KINDS, ".csv.gz", ".tsv.gz")


def maps_beside(log: str) -> tuple[str, str]:
    """The names of map files that belong to a log of this name, the first before the second."""
    return f"{foldername.stem(log)}.map.toml", "map.toml"


def suffix(path: Path) -> str:
    """How the file's name ends, in lower case, without a .gz."""
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    return plain.suffix.lower()


def kind(path: Path) -> Kind:
    """The format of a file by its name; :class:`InputError` where it is none."""
    found = KINDS.get(suffix(path))
    if found is None or (path.suffix.lower() == ".gz" and suffix(path) not in (".csv", ".tsv")):
        of_text = path.suffix.lower() in (".txt", ".lvm", ".dat", ".asc")
        named = "; to read a text table, rename it to .csv or .tsv" if of_text else ""
        *others, last = (name for name in SUFFIXES if name not in (".parquet", ".csv"))
        also = f"{', '.join(others)} or {last}"
        raise InputError(f"{path}: unknown kind of file {path.suffix!r}; a log is .parquet or .csv, a recording also {also}{named}")
    return found


def is_plain(path: Path) -> bool:
    """Whether a file is a table, which may be a log without any map."""
    return KINDS.get(suffix(path)) is TABLE


def counted(path: Path, streams: Iterable[RecordedStream]) -> Iterator[RecordedStream]:
    """The streams, as long as there are no more of them, and no more numbers in them, than the limits allow."""
    cells = 0
    for number, one in enumerate(streams, 1):
        cells += one.rows
        limits.NUMBERS.check(str(path), cells)
        limits.STREAMS.check(str(path), number)
        yield one


@contextmanager
def damaged(path: Path, found: Kind) -> Iterator[None]:
    """What a library raises over a file becomes an :class:`InputError`: each raises errors of its own, and most any."""
    try:
        with unremarked():
            yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        raise InputError(f"{path}: not a readable {found.name} ({reason(error)}); copy it again from the recorder") from None


def reason(error: Exception) -> str:
    """What an error says; neither a file's copy aside nor an object's address is anything to a reader."""
    return _ASIDE.sub("the file", " ".join((str(error) or type(error).__name__).split()))[:300]


@contextmanager
def unremarked() -> Iterator[None]:
    """A library's remarks on itself are no concern of whoever reads the result."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def whole(values: Numbers) -> Numbers:
    """Numbers as they are, true and false as 1 and 0."""
    return values.astype(np.uint8) if values.dtype == bool else values


_IN_BRACKETS, _SLASH = re.compile(r"\[[^\[\]]*\]|\([^()]*\)"), "\0"
"""A slash of a unit, as in ``gyro_x [deg/s]``, parts no levels."""


def fitting(pattern: str, paths: Sequence[str]) -> list[str]:
    """The paths that a pattern fits, 2 before 10: ``*`` is any text within a level, ``**`` any text, ``?`` one character."""
    if pattern in paths:
        return [pattern]
    parts = [part for part in re.split(r"(\*\*|\*|\?)", pattern) if part]
    return sorted((path for path in paths if _fits(parts, path)), key=natural)


def _fits(parts: Sequence[str], path: str) -> bool:
    """Whether a pattern's parts fit a path, in a time that grows as the product of their lengths: a regular expression's may explode."""
    ends = {0}
    path = _IN_BRACKETS.sub(lambda unit: unit[0].replace("/", _SLASH), path)
    for part in parts:
        if part == "**":
            ends = set(range(min(ends), len(path) + 1))
        elif part == "*":
            ends = _within_level(ends, path)
        elif part == "?":
            ends = {end + 1 for end in ends if path[end : end + 1] not in ("", "/")}
        else:
            ends = {end + len(part) for end in ends if path[end : end + len(part)].replace(_SLASH, "/") == part}
        if not ends:
            return False
    return len(path) in ends


def _within_level(starts: set[int], path: str) -> set[int]:
    """Where any text without a slash may end that begins at one of these."""
    found, reached = set(), False
    for at in range(len(path) + 1):
        reached = at in starts or (reached and path[at - 1] != "/")
        if reached:
            found.add(at)
    return found


def natural(path: str) -> list[tuple[int, str]]:
    """Sorts x2 before x10."""
    return [(int(part), "") if part.isdecimal() and part.isascii() else (-1, part) for part in re.split(r"(\d+)", path)]
