"""What of a long series is drawn, and over which range."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass

BUCKETS = 150
"""Parts of a series, each drawn by its least and its largest value; about what a panel's width can show."""
LEAST = 30
"""Parts of a phase among many."""
SETTLED = (0.5, 0.6, 0.7, 0.8)
"""Parts of a phase after which an estimate may be called settled, for the range of its panel."""
COARSE = 6.0
"""A range this many times that of the last part would hide the end; a later part is taken."""


@dataclass(frozen=True)
class AxisRange:
    """Range of a value axis."""

    low: float
    high: float

    def hold(self, value: float) -> bool:
        """Whether a value lies inside."""
        return self.low <= value <= self.high


def thin(values: Array, keep: Iterable[int] = (), buckets: int = BUCKETS) -> NDArray[np.intp]:
    """Rows to draw, ascending: of each bucket the least and the largest, the first, the last and ``keep``. Rows of NaN are left out."""
    finite = np.flatnonzero(np.isfinite(values))
    kept = [row for row in keep if np.isfinite(values[row])]
    if len(finite) <= 2 * buckets:
        return finite
    parts = np.array_split(finite, buckets)
    extremes = [part[pick(values[part])] for part in parts for pick in (np.argmin, np.argmax)]
    return np.unique(np.array([finite[0], *extremes, *kept, finite[-1]], dtype=np.intp))


def gathered(time_s: Array, values: Array, buckets: int) -> tuple[Array, Array, Array, Array]:
    """(buckets,) each: the middle of a part, and its mean, least and largest value. Every cycle is a part where they are few."""
    finite = np.flatnonzero(np.isfinite(values))
    parts = np.array_split(finite, buckets) if len(finite) > 2 * buckets else finite[:, None]
    times, mean, low, high = (
        np.array([pick(column[part]) for part in parts])
        for column, pick in ((time_s, np.mean), (values, np.mean), (values, np.min), (values, np.max))
    )
    return times, mean, low, high


def broken(rows: NDArray[np.intp], blank: BoolArray) -> NDArray[np.intp]:
    """Rows to draw, with a −1 between two that something blank lies between."""
    behind = np.cumsum(blank)[rows]
    return np.insert(rows, np.flatnonzero(np.diff(behind) > 0) + 1, -1)


def said(lengths: Iterable[int], buckets: int) -> str:
    """The caption's sentence on thinning of series of these lengths; empty where every cycle is drawn."""
    each = max((-(-length // buckets) for length in lengths if length > 2 * buckets), default=1)
    return f" Drawn: minimum and maximum of {each} cycles." if each > 1 else ""


def parts_of(phases: int) -> int:
    """Parts into which each of so many phases is thinned, that a page of many stays small."""
    return max(LEAST, 2 * BUCKETS // (1 + phases))


def settled(values: Array, sigmas: Array) -> AxisRange | None:
    """The range in which the settled part can be read: values ± 3 sigmas; ``None`` if nothing is finite."""
    told = np.flatnonzero(np.isfinite(values) & np.isfinite(sigmas))
    if not told.size:
        return None
    tails = [told[told >= min(int(part * len(values)), told[-1])] for part in SETTLED]
    low = [float((values[tail] - 3.0 * sigmas[tail]).min()) for tail in tails]
    high = [float((values[tail] + 3.0 * sigmas[tail]).max()) for tail in tails]
    finest = high[-1] - low[-1]
    first = next(n for n in range(len(tails)) if high[n] - low[n] <= COARSE * finest)
    return padded(low[first], high[first])


def span(values: Array, least: float = 0.0) -> AxisRange:
    """The range of the finite values, zero included, and ± ``least``."""
    finite = values[np.isfinite(values)]
    return padded(min(finite.min(initial=0.0), -least), max(finite.max(initial=0.0), least))


def padded(low: float, high: float, part: float = 0.06) -> AxisRange:
    """A range a little wider; never empty."""
    margin = part * (high - low) or 0.05 * max(abs(low), abs(high)) or 1.0
    return AxisRange(float(low - margin), float(high + margin))
