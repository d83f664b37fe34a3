"""Records of a sensor in whose place a recorder wrote nothing, zeros, or the reading before."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray

SAME, STANDS = 0.05, 10
"""Part of the records that may repeat the one before, and how many in a row: of more, a sensor resolves no more, or stands still."""
ENOUGH = 2
"""Axes that must repeat at once: one may well show the same twice."""
DOUBLED = 1.5
"""Times a usual reading from which on the record after a zero holds that of both."""


class Marked:
    """Of n records, axis by axis as they are read."""

    def __init__(self, count: int) -> None:
        self.empty = np.zeros(count, dtype=bool)
        self._same, self._zero = np.ones(count, dtype=bool), np.ones(count, dtype=bool)
        self._axes = 0

    def add(self, values: Array, lost: BoolArray | None) -> None:
        """One axis's column (n,), NaN where a cell is empty."""
        none = np.isnan(values)
        self.empty |= none if lost is None else none & ~lost
        if np.nanmax(values, initial=-np.inf) > np.nanmin(values, initial=np.inf):
            self._same[1:] &= values[1:] == values[:-1]
            self._zero &= values == 0
            self._axes += 1

    def found(self, increments: Array) -> tuple[BoolArray, BoolArray, BoolArray]:
        """(n,) each: empty, repeating the record before, zeros; ``increments`` (n, 3) are what was made of them."""
        none, count = np.zeros_like(self.empty), len(increments)
        if self._axes < ENOUGH:
            return self.empty[:count], none[:count], none[:count]
        self._same[0] = False
        zero = _seldom(self._zero)
        zero = none if _doubled(increments, np.flatnonzero(zero[:count])) else zero
        return self.empty[:count], (_seldom(self._same & ~self._zero))[:count], zero[:count]


def _seldom(rows: BoolArray) -> BoolArray:
    """The rows (n,), if they are few."""
    lengths = np.diff(np.flatnonzero(np.diff(rows, prepend=False, append=False)))[::2]
    few = rows.mean() <= SAME and lengths.max(initial=0) <= STANDS
    return rows if few else np.zeros_like(rows)


def _doubled(increments: Array, rows: IntArray) -> bool:
    """Whether the records after those of zeros hold what both should have."""
    rows = rows[(rows > 0) & (rows < len(increments) - 2)]
    around = increments[rows - 1] + increments[rows + 2]
    return bool(len(rows)) and float((increments[rows + 1] * around).sum()) > DOUBLED * float((around * around).sum()) / 2
