"""What of a long series is drawn, and over which range."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from massprop_cli.arrays import Array

BUCKETS = 150
"""Parts of a series, each drawn by its least and its largest value; about what a panel's width can show."""
SETTLED = (0.5, 0.8)
"""The range of an estimate's panel fits what comes after the value was final, but from no earlier and no later part of the phase on."""


@dataclass(frozen=True)
class Limits:
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


def row_at(time_s: Array, moment_s: float) -> int:
    """The row whose time is nearest."""
    return int(np.argmin(np.abs(time_s - moment_s)))


def settled(values: Array, sigmas: Array, final_row: int | None, sigma_count: float = 3.0) -> Limits | None:
    """The range in which the settled part can be read: values ± a few sigmas; ``None`` if nothing is finite."""
    finite = np.isfinite(values) & np.isfinite(sigmas)
    if not finite.any():
        return None
    rows = len(values)
    early, late = (int(part * rows) for part in SETTLED)
    start = early if final_row is None else min(max(final_row, early), late)
    tail = finite & (np.arange(rows) >= min(start, int(np.flatnonzero(finite)[-1])))
    return padded((values[tail] - sigma_count * sigmas[tail]).min(), (values[tail] + sigma_count * sigmas[tail]).max())


def span(values: Array) -> Limits:
    """The range of the finite values, zero included."""
    finite = values[np.isfinite(values)]
    return padded(min(finite.min(initial=0.0), 0.0), max(finite.max(initial=0.0), 0.0))


def padded(low: float, high: float, part: float = 0.06) -> Limits:
    """A range a little wider; never empty."""
    margin = part * (high - low) or 0.05 * max(abs(low), abs(high)) or 1.0
    return Limits(float(low - margin), float(high + margin))
