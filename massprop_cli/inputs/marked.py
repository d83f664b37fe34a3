"""Records of a sensor in whose place a recorder wrote nothing, zeros, or the reading before."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, IntArray, runs

SAME, STANDS = 0.05, 10
"""Part of the records that may repeat the one before, and how many in a row: of more, a sensor resolves no more, or stands still."""
ENOUGH = 2
"""Axes that must repeat at once: one may well show the same twice."""
BY_CHANCE = 0.25
"""Records in which all axes but one repeat over those in which all do, from which on these do by chance."""
FILLS = (999.0, 9999.0, 99999.0, 32767.0, 32768.0, 1e20, 1e30, 9.969209968386869e36)
"""What recorders write where there is no reading, of either sign: the last is NetCDF's, and counts overflow into 2^15."""
ROUNDED = 1e-6
"""Part of one that its digits may leave out."""
APART = 10.0
"""Times the largest reading from which on one of these is none."""
BOTH = 1.5
"""Times a usual reading from which on the record after a lost one holds that of both."""


class Marked:
    """Of n records, axis by axis as they are read."""

    def __init__(self, count: int) -> None:
        self.empty = np.zeros(count, dtype=bool)
        self.filled = np.zeros(count, dtype=bool)
        """(n,) those with a fill value, empty, too."""
        self.axes = 0
        self.same: IntArray = np.zeros(count, dtype=np.int8)
        """(n,) axes that repeat the record before, ..."""
        self.zero: IntArray = np.zeros(count, dtype=np.int8)
        """... and that are 0."""

    def add(self, values: Array, lost: BoolArray | None, filled: BoolArray) -> None:
        """One axis's column (n,), NaN where a cell is empty or ``filled``."""
        none = np.isnan(values)
        self.filled |= filled
        self.empty |= none if lost is None else none & ~lost
        if np.nanmax(values, initial=-np.inf) > np.nanmin(values, initial=np.inf):
            self.same[1:] += values[1:] == values[:-1]
            self.zero += values == 0
            self.axes += 1


def fills(values: Array, scale: float) -> BoolArray:
    """(n,) readings that are a fill value of the log, there in a unit ``scale`` times theirs, and far beyond all others."""
    own = np.array(FILLS) * abs(scale)
    farthest = max(np.nanmax(values, initial=0.0), -np.nanmin(values, initial=0.0))
    if not np.isclose(farthest, own, rtol=ROUNDED, atol=0).any():
        return np.zeros(len(values), dtype=bool)
    sizes = np.abs(values)
    found = np.asarray(np.isclose(sizes[:, None], own, rtol=ROUNDED, atol=0).any(1))
    return np.asarray(found & (sizes > APART * np.nanmax(sizes[~found], initial=0.0)))


def repeated(sensors: Sequence[Marked]) -> BoolArray:
    """(n,) records in which all axes of these sensors repeat the one before, and are not 0."""
    axes = sum(one.axes for one in sensors)
    none = np.asarray(np.sum([one.zero for one in sensors], 0) == axes)
    return np.asarray(_at_once(np.sum([one.same for one in sensors], 0), axes) & ~none)


def zeros(sensor: Marked) -> BoolArray:
    """(n,) records in which all axes of a sensor are 0."""
    return _at_once(sensor.zero, sensor.axes)


def _at_once(axes: IntArray, every: int) -> BoolArray:
    """The rows in which so many ``axes`` (n,) are ``every`` one; none where these are many, or by chance, as of a coarse sensor."""
    rows = np.asarray(axes == every)
    by_chance = int((axes == every - 1).sum()) > BY_CHANCE * int(rows.sum())
    lengths = np.diff(runs(rows), axis=1)
    few = rows.mean() <= SAME and lengths.max(initial=0) <= STANDS
    return rows if few and every >= ENOUGH and not by_chance else np.zeros_like(rows)


def holds_both(sensors: Sequence[Array], rows: IntArray, before: int) -> bool:
    """Whether increments (n, 3) in ``rows`` also hold the motion of the record lost before; the one ``before`` them holds its own alone.

    Each sensor weighs by how little it changes from one record to the next: noise and pulses tell nothing.
    """
    held, usual = 0.0, 0.0
    for increments in sensors:
        own = rows[(rows >= before) & (rows < len(increments) - 1)]
        around, weight = increments[own - before] + increments[own + 1], 1 / max(float((np.diff(increments, axis=0) ** 2).mean()), TINY)
        held += weight * float((increments[own] * around).sum())
        usual += weight * float((around**2).sum()) / 2
    return held > BOTH * usual
