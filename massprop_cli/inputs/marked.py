"""Records of a sensor in whose place a recorder wrote nothing, zeros, or the reading before."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray

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

    def found(self, count: int) -> tuple[BoolArray, BoolArray, BoolArray]:
        """(count,) each: empty, repeating the record before, zeros."""
        if self._axes < ENOUGH:
            none = np.zeros(count, dtype=bool)
            return self.empty[:count], none, none
        self._same[0] = False
        return self.empty[:count], _seldom(self._same & ~self._zero)[:count], _seldom(self._zero)[:count]


def _seldom(rows: BoolArray) -> BoolArray:
    """The rows (n,), if they are few."""
    lengths = np.diff(np.flatnonzero(np.diff(rows, prepend=False, append=False)))[::2]
    few = rows.mean() <= SAME and lengths.max(initial=0) <= STANDS
    return rows if few else np.zeros_like(rows)


def came_late(sensors: Sequence[Array], zero: BoolArray) -> bool:
    """Whether the records after those of zeros (n,) hold what both should have, by the increments (n, 3) of all that show these.

    Each weighs by how little it changes from one record to the next: noise and pulses tell nothing.
    """
    rows = np.flatnonzero(zero)
    rows = rows[(rows > 0) & (rows < len(zero) - 2)]
    held, usual = 0.0, 0.0
    for increments in sensors:
        around, weight = increments[rows - 1] + increments[rows + 2], 1 / max(float((np.diff(increments, axis=0) ** 2).mean()), TINY)
        held += weight * float((increments[rows + 1] * around).sum())
        usual += weight * float((around**2).sum()) / 2
    return held > DOUBLED * usual
