"""List of a recording's streams with rate, range, unit and clock."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.clocks import GAP
from massprop_cli.inputs.formats.recording import RecordedStream, Recording

CLOCK_NAMES = ("time", "timestamp", "stamp", "t", "clock", "time_s", "t_s", "t_ms", "t_us", "t_ns", "time_ms", "time_us", "time_ns")
_SURE = 3.0
"""Error limit of the mean interval over the scatter of intervals divided by their number."""


@dataclass(frozen=True)
class Listed:
    """Stream in the list."""

    path: str
    samples: int
    rate_hz: float | None
    """Rate by the stream's clock, Hz; None if the clock or its unit is unknown."""
    least: float | None
    most: float | None
    unit: str
    clock: str
    note: str
    """Remark: no numbers (text, or damaged), constant, increasing; or why the stream cannot be read, and the remedy."""


def listed(read: Recording) -> list[Listed]:
    """List of all streams in the file's order, then unreadable parts of the file."""
    clocks = Clocks(read)
    unread = [Listed(path, 0, None, None, None, "", "", f"not read: it {why}") for path, why in read.unread.items()]
    return [*(_listed(clocks, one) for one in read.streams.values()), *unread]


def _listed(clocks: Clocks, one: RecordedStream) -> Listed:
    values = numbers(one)
    if values is None:
        return Listed(one.path, one.rows, None, None, None, one.unit, one.clock, "no numbers")
    finite, empty = values[np.isfinite(values)], int(np.isnan(values).sum())
    least, most = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
    note = f"{empty} rows empty" * (empty > 0) if finite.size + empty == one.rows else f"{one.rows - finite.size} not finite"
    if finite.size and least == most:
        note = note or "constant"
    elif one.path in clocks.increasing:
        note = note or "increasing"
    return Listed(one.path, one.rows - empty, clocks.rate_hz(one), least, most, one.unit, one.clock, note)


def numbers(one: RecordedStream) -> Array | None:
    """(rows,) values of a stream; None if it has no numbers."""
    try:
        values = one.values
    except InputError:
        return None
    return np.asarray(values, np.float64)


class Clocks:
    """Assignment of clocks to the streams of a recording."""

    def __init__(self, read: Recording) -> None:
        self.streams = read.streams

    @cached_property
    def increasing(self) -> frozenset[str]:
        """Paths of strictly increasing streams."""
        held = ((path, numbers(one)) for path, one in self.streams.items() if one.rows > 1)
        return frozenset(path for path, values in held if values is not None and _increases(values[np.isfinite(values)]))

    def _increases_in(self, path: str, held: BoolArray) -> bool:
        """Whether a stream increases over the rows ``held``. In merged tables a clock may repeat in the other table's rows."""
        values = numbers(self.streams[path]) if leaf(path) in CLOCK_NAMES and not held.all() else None
        return path in self.increasing or (values is not None and _increases(values[held]))

    def of(self, one: RecordedStream) -> list[str]:
        """Candidate clocks of a stream: that of the file, else increasing streams of equal length, if possible with a clock's name."""
        if one.clock and one.clock in self.streams:
            return [one.clock]
        held = self._has_value(one)
        like = [path for path, other in self.streams.items() if other.rows == one.rows and path != one.path]
        like = [path for path in like if self._increases_in(path, held) and self._has_value(self.streams[path])[held].all()]
        # in a merged table, the clock with values in the same rows
        like = [path for path in like if (self._has_value(self.streams[path]) == held).all()] or like
        return [path for path in like if leaf(path) in CLOCK_NAMES] or like

    def samples(self, one: RecordedStream) -> int:
        """Number of rows with a value."""
        return int(self._has_value(one).sum())

    def _has_value(self, one: RecordedStream) -> BoolArray:
        """(rows,) whether the stream has a value."""
        values = numbers(one)
        return np.zeros(one.rows, dtype=bool) if values is None else np.isfinite(values)

    def unit(self, path: str) -> tuple[str, str]:
        """Unit of a clock, and its source: the file, or the suffix of its name; empty if unknown."""
        recorded = self.streams[path].unit
        if units.factor(recorded, units.TIME) is not None:
            return units.plain(recorded), "as recorded"
        _, mark, ending = leaf(path).rpartition("_")
        return (ending, "by its name") if mark and ending in units.TIME else ("", "")

    def step(self, path: str, of: RecordedStream | None = None) -> float:
        """Usual interval of a clock between samples of a stream, in the clock's unit; the roundest value within its uncertainty."""
        times = self.streams[path].values
        held = times[self._has_value(of or self.streams[path]) & self._has_value(self.streams[path])]
        steps = np.diff(held).astype(np.float64)  # integer nanoseconds since 1970 exceed float64
        regular = steps[steps <= GAP * median(steps)] if len(steps) else steps
        if not len(regular):
            return 0.0
        gaps = len(steps) - len(regular)
        return _roundest(float(regular.mean()), _SURE * float(regular.std()) * (1 + gaps) ** 0.5 / len(regular))

    def rate_hz(self, one: RecordedStream) -> float | None:
        """Samples per second; None if the clock or its unit is unknown."""
        found = self.of(one)
        factor = units.factor(self.unit(found[0])[0], units.TIME) if len(found) == 1 and found[0] in self.streams else None
        if factor is None or self.streams[found[0]].rows < 2:
            return None
        step = self.step(found[0], one) * factor
        return 1 / step if step > 0 else None


def _roundest(value: float, within: float) -> float:
    """Number with the fewest digits within ``within`` of ``value``."""
    for digits in range(1, 16):
        rounded = float(f"{value:.{digits}g}")
        if abs(rounded - value) <= within:
            return rounded
    return value


def _increases(values: Array) -> bool:
    return len(values) > 1 and bool((np.diff(values) > 0).all())


def leaf(path: str) -> str:
    """Last part of a path, lower case, without a unit at its end."""
    plain = units.without_suffix_unit(path)[0].partition("[")[0].partition(" (")[0].strip().lower()
    return plain.replace(".", "/").rpartition("/")[2]
