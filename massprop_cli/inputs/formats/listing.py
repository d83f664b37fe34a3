"""What is in a recording: each stream's rate, range, unit and clock. Reads, decides nothing."""

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
"""Times the scatter of stamps over their number, of the mean step's error."""


@dataclass(frozen=True)
class Listed:
    """A stream, as a person wants to see it."""

    path: str
    samples: int
    rate_hz: float | None
    """By the clock that the file names, where its unit is known."""
    least: float | None
    most: float | None
    unit: str
    clock: str
    note: str
    """no numbers (text, or damaged), constant, increasing; of what isn't read why, and what to do."""


def listed(read: Recording) -> list[Listed]:
    """All streams in the file's order, and after them what the file holds that isn't read."""
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
    """A stream's values; None where they are none."""
    try:
        values = one.values
    except InputError:
        return None
    return np.asarray(values, np.float64)


class Clocks:
    """Which streams of a recording may hold the times of others."""

    def __init__(self, read: Recording) -> None:
        self.streams = read.streams

    @cached_property
    def increasing(self) -> frozenset[str]:
        """Streams that increase throughout."""
        held = ((path, numbers(one)) for path, one in self.streams.items() if one.rows > 1)
        return frozenset(path for path, values in held if values is not None and _increases(values[np.isfinite(values)]))

    def _increases_in(self, path: str, held: BoolArray) -> bool:
        """Whether a stream increases over these rows; a clock of two that were merged may stand still from one's row to the other's."""
        values = numbers(self.streams[path]) if leaf(path) in CLOCK_NAMES and not held.all() else None
        return path in self.increasing or (values is not None and _increases(values[held]))

    def of(self, one: RecordedStream) -> list[str]:
        """The one that the file names, where it holds it; else increasing ones as long, those called so before others."""
        if one.clock and one.clock in self.streams:
            return [one.clock]
        held = self._held(one)
        like = [path for path, other in self.streams.items() if other.rows == one.rows and path != one.path]
        like = [path for path in like if self._increases_in(path, held) and self._held(self.streams[path])[held].all()]
        # of columns of one table with clocks of their own the one that ends where the stream does
        like = [path for path in like if (self._held(self.streams[path]) == held).all()] or like
        return [path for path in like if leaf(path) in CLOCK_NAMES] or like

    def samples(self, one: RecordedStream) -> int:
        """How many rows have a number of it."""
        return int(self._held(one).sum())

    def _held(self, one: RecordedStream) -> BoolArray:
        """(rows,) where it has a number."""
        values = numbers(one)
        return np.zeros(one.rows, dtype=bool) if values is None else np.isfinite(values)

    def unit(self, path: str) -> tuple[str, str]:
        """A clock's unit, and what it is known by: the file, or its name's ending; empty where neither says."""
        recorded = self.streams[path].unit
        if units.factor(recorded, units.TIME) is not None:
            return units.plain(recorded), "as recorded"
        _, mark, ending = leaf(path).rpartition("_")
        return (ending, "by its name") if mark and ending in units.TIME else ("", "")

    def step(self, path: str, of: RecordedStream | None = None) -> float:
        """The usual step of a clock, in its own unit; between samples ``of`` a stream. The roundest that stamps which scatter allow."""
        times = self.streams[path].values
        held = times[self._held(of or self.streams[path]) & self._held(self.streams[path])]
        steps = np.diff(held).astype(np.float64)  # of whole nanoseconds since 1970, which no float holds
        regular = steps[steps <= GAP * median(steps)] if len(steps) else steps
        if not len(regular):
            return 0.0
        gaps = len(steps) - len(regular)
        return _roundest(float(regular.mean()), _SURE * float(regular.std()) * (1 + gaps) ** 0.5 / len(regular))

    def rate_hz(self, one: RecordedStream) -> float | None:
        """Samples a second; None where the clock or its unit is not known."""
        found = self.of(one)
        factor = units.factor(self.unit(found[0])[0], units.TIME) if len(found) == 1 and found[0] in self.streams else None
        if factor is None or self.streams[found[0]].rows < 2:
            return None
        step = self.step(found[0], one) * factor
        return 1 / step if step > 0 else None


def _roundest(value: float, within: float) -> float:
    """The number of the fewest digits that is as near to a value as this."""
    for digits in range(1, 16):
        rounded = float(f"{value:.{digits}g}")
        if abs(rounded - value) <= within:
            return rounded
    return value


def _increases(values: Array) -> bool:
    return len(values) > 1 and bool((np.diff(values) > 0).all())


def leaf(path: str) -> str:
    """The last part of a path, in lower case and without its unit behind it."""
    plain = units.behind(path)[0].partition("[")[0].partition(" (")[0].strip().lower()
    return plain.replace(".", "/").rpartition("/")[2]
