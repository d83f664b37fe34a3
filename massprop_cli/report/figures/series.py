"""Reduction of long series for drawing, and ranges of value axes."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass

BUCKETS = 150
"""Number of intervals of a series, each drawn by its minimum and maximum; about the resolution of a panel."""
LEAST = 30
"""Smallest number of intervals of a phase."""
SETTLED = (0.5, 0.6, 0.7, 0.8)
"""Fractions of a phase after which an estimate may count as settled, for the range of its panel."""
COARSE = 6.0
"""Largest ratio of the range to that of the last fraction; a larger range would hide the end."""


@dataclass(frozen=True)
class AxisRange:
    """Range of a value axis."""

    low: float
    high: float

    def hold(self, value: float) -> bool:
        """Whether a value is in the range."""
        return self.low <= value <= self.high


def thin(values: Array, keep: Iterable[int] = (), buckets: int = BUCKETS) -> NDArray[np.intp]:
    """Ascending indices of the values to draw: minimum and maximum of each interval, first, last, and ``keep``; NaN excluded."""
    finite = np.flatnonzero(np.isfinite(values))
    kept = [row for row in keep if np.isfinite(values[row])]
    if len(finite) <= 2 * buckets:
        return finite
    parts = np.array_split(finite, buckets)
    extremes = [part[pick(values[part])] for part in parts for pick in (np.argmin, np.argmax)]
    return np.unique(np.array([finite[0], *extremes, *kept, finite[-1]], dtype=np.intp))


def gathered(time_s: Array, values: Array, buckets: int) -> tuple[Array, Array, Array, Array]:
    """(buckets,) mean time, mean, minimum and maximum of each interval; a short series has one interval per cycle."""
    finite = np.flatnonzero(np.isfinite(values))
    parts = np.array_split(finite, buckets) if len(finite) > 2 * buckets else finite[:, None]
    times, mean, low, high = (
        np.array([pick(column[part]) for part in parts])
        for column, pick in ((time_s, np.mean), (values, np.mean), (values, np.min), (values, np.max))
    )
    return times, mean, low, high


def broken(rows: NDArray[np.intp], blank: BoolArray) -> NDArray[np.intp]:
    """The indices ``rows`` with −1 inserted between two that have a blank value between them."""
    behind = np.cumsum(blank)[rows]
    return np.insert(rows, np.flatnonzero(np.diff(behind) > 0) + 1, -1)


def thinning_note(lengths: Iterable[int], buckets: int) -> str:
    """Sentence of a caption on the reduction of series of these lengths; empty if every cycle is drawn."""
    each = max((-(-length // buckets) for length in lengths if length > 2 * buckets), default=1)
    return f" Drawn: minimum and maximum of {each} cycles." if each > 1 else ""


def parts_of(phases: int) -> int:
    """Number of intervals for each of ``phases`` phases, which limits the size of a page."""
    return max(LEAST, 2 * BUCKETS // (1 + phases))


def settled(values: Array, sigmas: Array) -> AxisRange | None:
    """Range of values ± 3 sigmas after the estimate has settled; None without finite values.

    The range begins after the first fraction in :data:`SETTLED` for which it is at most :data:`COARSE` times that of the last.
    """
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(sigmas))
    if not known.size:
        return None
    tails = [known[known >= min(int(part * len(values)), known[-1])] for part in SETTLED]
    low = [float((values[tail] - 3.0 * sigmas[tail]).min()) for tail in tails]
    high = [float((values[tail] + 3.0 * sigmas[tail]).max()) for tail in tails]
    finest = high[-1] - low[-1]
    first = next(n for n in range(len(tails)) if high[n] - low[n] <= COARSE * finest)
    return padded(low[first], high[first])


def span(values: Array, least: float = 0.0) -> AxisRange:
    """Range that contains the finite values, zero, and ± ``least``, with a margin."""
    finite = values[np.isfinite(values)]
    return padded(min(finite.min(initial=0.0), -least), max(finite.max(initial=0.0), least))


def padded(low: float, high: float, part: float = 0.06) -> AxisRange:
    """The range with margins of ``part`` of its width; never empty."""
    margin = part * (high - low) or 0.05 * max(abs(low), abs(high)) or 1.0
    return AxisRange(float(low - margin), float(high + margin))
