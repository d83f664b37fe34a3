"""Interface of formats: a module with ``read(path, data) -> Read``, whose exceptions mean a damaged file, and a line in :data:`KINDS`."""

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
"""Numbers of any type; integer nanoseconds keep their precision."""


@dataclass(frozen=True)
class RecordedStream:
    """Signal of a recording."""

    path: str
    """Name in the file, unique."""
    rows: int
    load: Callable[[], Numbers] = field(repr=False)
    clock: str = ""
    """Path of the stream with its times; empty if the file does not state it."""
    unit: str = ""
    """Unit as recorded; empty if none."""
    place: Callable[[int], str] = field(default="sample {}".format, repr=False)
    """Text that locates a sample for the user."""
    texts: Callable[[], list[str | None]] | None = field(default=None, repr=False)
    """Function that gives the cells as text, None for empty ones; None if the file has only numbers."""

    @cached_property
    def values(self) -> Numbers:
        """(rows,) values. Raises :class:`InputError` for a cell that is not a number."""
        return self.load()


def stream(path: str, values: Numbers, clock: str = "", unit: str = "") -> RecordedStream:
    """Stream with the given values."""
    return RecordedStream(path, len(values), lambda: values, clock, unit)


@dataclass(frozen=True)
class Recording:
    """Content of a recording."""

    path: Path
    sha256: str
    kind: str
    """Name of the format, for messages."""
    streams: Mapping[str, RecordedStream]
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Parameters of the vehicle in the file, such as PX4's."""
    vehicle: str | None = None
    """Embedded vehicle file."""
    map: str | None = None
    """Embedded map file."""
    unread: Mapping[str, str] = field(default_factory=dict)
    """Unreadable parts of the file by path, with their kind and a remedy."""

    def why_unread(self, path: str) -> str:
        """Reason why a path has no streams; empty if the file has nothing unreadable there."""
        above = next((part for part in self.unread if path == part or path.startswith(tuple(part + mark for mark in "/.({["))), None)
        return "" if above is None else f"{above!r} {self.unread[above]}"


@dataclass(frozen=True)
class Read:
    """Result of a reader."""

    streams: Iterable[RecordedStream]
    parameters: Mapping[str, float] = field(default_factory=dict)
    vehicle: str | None = None
    map: str | None = None
    unread: Mapping[str, str] = field(default_factory=dict)


_TEMPORARY = re.compile(r"['\"]?(<_io\.BytesIO[^>]*>|\S*\brecording\.\w+)['\"]?")


@dataclass(frozen=True)
class Kind:
    """Format of recordings."""

    name: str
    module: str
    """Module in this package."""
    endings: tuple[str, ...]
    """Suffixes of file names; .csv and .tsv may also end in .gz."""
    extra: str = ""
    """Extra of the distribution that the reader needs."""


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
    """Names of map files for a log, in order of priority."""
    return f"{foldername.stem(log)}.map.toml", "map.toml"


def suffix(path: Path) -> str:
    """Suffix of a file name, lower case, without .gz."""
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    return plain.suffix.lower()


def kind(path: Path) -> Kind:
    """Format of a file, by its name. Raises :class:`InputError` for an unknown suffix."""
    found = KINDS.get(suffix(path))
    if found is None or (path.suffix.lower() == ".gz" and suffix(path) not in (".csv", ".tsv")):
        of_text = path.suffix.lower() in (".txt", ".lvm", ".dat", ".asc")
        named = "; to read a text table, rename it to .csv or .tsv" if of_text else ""
        *others, last = (name for name in SUFFIXES if name not in (".parquet", ".csv"))
        also = f"{', '.join(others)} or {last}"
        raise InputError(f"{path}: unknown kind of file {path.suffix!r}; a log is .parquet or .csv, a recording also {also}{named}")
    return found


def is_plain(path: Path) -> bool:
    """Whether a file is a table, which can be a log without a map."""
    return KINDS.get(suffix(path)) is TABLE


def counted(path: Path, streams: Iterable[RecordedStream]) -> Iterator[RecordedStream]:
    """Yield the streams. Raises :class:`InputError` for more streams or values than the limits."""
    cells = 0
    for number, one in enumerate(streams, 1):
        cells += one.rows
        limits.NUMBERS.check(str(path), cells)
        limits.STREAMS.check(str(path), number)
        yield one


@contextmanager
def damaged(path: Path, found: Kind) -> Iterator[None]:
    """Convert exceptions of a library in the block to :class:`InputError`; libraries raise exceptions of many types."""
    try:
        with unremarked():
            yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        raise InputError(f"{path}: not a readable {found.name} ({reason(error)}); copy it again from the recorder") from None


def reason(error: Exception) -> str:
    """Text of an exception, without temporary paths and object addresses."""
    return _TEMPORARY.sub("the file", " ".join((str(error) or type(error).__name__).split()))[:300]


@contextmanager
def unremarked() -> Iterator[None]:
    """Suppress warnings of libraries in the block."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def whole(values: Numbers) -> Numbers:
    """Values; booleans as 0 and 1."""
    return values.astype(np.uint8) if values.dtype == bool else values


_IN_BRACKETS, _SLASH = re.compile(r"\[[^\[\]]*\]|\([^()]*\)"), "\0"
"""A slash within a unit, as in ``gyro_x [deg/s]``, does not separate levels."""


def fitting(pattern: str, paths: Sequence[str]) -> list[str]:
    """Paths that match a pattern, in natural order: ``*`` any text within a level, ``**`` any text, ``?`` one character."""
    if pattern in paths:
        return [pattern]
    parts = [part for part in re.split(r"(\*\*|\*|\?)", pattern) if part]
    return sorted((path for path in paths if _fits(parts, path)), key=natural)


def _fits(parts: Sequence[str], path: str) -> bool:
    """Whether a pattern matches a path. Time is proportional to the product of lengths; regular expressions can be exponential."""
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
    """Possible ends of a text without slash that starts at one of ``starts``."""
    found, reached = set(), False
    for at in range(len(path) + 1):
        reached = at in starts or (reached and path[at - 1] != "/")
        if reached:
            found.add(at)
    return found


def natural(path: str) -> list[tuple[int, str]]:
    """Sort key of natural order: x2 before x10."""
    return [(int(part), "") if part.isdecimal() and part.isascii() else (-1, part) for part in re.split(r"(\d+)", path)]
