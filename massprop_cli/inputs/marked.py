"""Records of a sensor for which a recorder wrote nothing, zeros, a fill value, or the previous reading."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, IntArray, runs

SAME, STANDS = 0.05, 10
"""Maximum fraction of repeated records, and of successive ones; more are from a coarse or stuck sensor."""
ENOUGH = 2
"""Minimum number of axes that repeat together, because a single axis may repeat by chance."""
BY_CHANCE = 0.25
"""Number of records in which all axes but one repeat, over that in which all do, above which repetition is by chance."""
FILLS = (999.0, 9999.0, 99999.0, 32767.0, 32768.0, 1e20, 1e30, 9.969209968386869e36)
"""Fill values of recorders, of either sign: 9.97e36 is NetCDF's, 2^15 an integer overflow."""
ROUNDING = 1e-6
"""Relative rounding of fill values."""
FILL_RATIO = 10.0
"""Minimum ratio of a fill value to the largest reading."""
BOTH_RATIO = 1.5
"""Record after a lost one over a usual record, above which it contains the motion of both."""


class MissingReadings:
    """Missing readings of a sensor with n records, collected axis by axis."""

    def __init__(self, count: int) -> None:
        self.empty = np.zeros(count, dtype=bool)
        self.filled = np.zeros(count, dtype=bool)
        """(n,) records with a fill value; these are also empty."""
        self.axes = 0
        self.same: IntArray = np.zeros(count, dtype=np.int8)
        """(n,) number of axes that equal the previous record, ..."""
        self.zero: IntArray = np.zeros(count, dtype=np.int8)
        """... and that are 0."""

    def add(self, values: Array, lost: BoolArray | None, filled: BoolArray) -> None:
        """Add a column (n,) of one axis, with NaN for empty or ``filled`` cells."""
        none = np.isnan(values)
        self.filled |= filled
        self.empty |= none if lost is None else none & ~lost
        if np.nanmax(values, initial=-np.inf) > np.nanmin(values, initial=np.inf):
            self.same[1:] += values[1:] == values[:-1]
            self.zero += values == 0
            self.axes += 1


def fill_values(values: Array, scale: float) -> BoolArray:
    """(n,) readings that are a fill value times ``scale``, the scale of the column, and far above all others."""
    own = np.array(FILLS) * abs(scale)
    farthest = max(np.nanmax(values, initial=0.0), -np.nanmin(values, initial=0.0))
    if not np.isclose(farthest, own, rtol=ROUNDING, atol=0).any():
        return np.zeros(len(values), dtype=bool)
    sizes = np.abs(values)
    found = np.asarray(np.isclose(sizes[:, None], own, rtol=ROUNDING, atol=0).any(1))
    return np.asarray(found & (sizes > FILL_RATIO * np.nanmax(sizes[~found], initial=0.0)))


def repeated(sensors: Sequence[MissingReadings]) -> BoolArray:
    """(n,) records in which all axes of the sensors repeat the previous one and are not 0."""
    axes = sum(one.axes for one in sensors)
    none = np.asarray(np.sum([one.zero for one in sensors], 0) == axes)
    return np.asarray(_simultaneous(np.sum([one.same for one in sensors], 0), axes) & ~none)


def zeros(sensor: MissingReadings) -> BoolArray:
    """(n,) records in which all axes of a sensor are 0."""
    return _simultaneous(sensor.zero, sensor.axes)


def _simultaneous(axes: IntArray, every: int) -> BoolArray:
    """(n,) rows in which ``axes`` (n,) equals ``every``; none if these are too many or by chance."""
    rows = np.asarray(axes == every)
    by_chance = int((axes == every - 1).sum()) > BY_CHANCE * int(rows.sum())
    lengths = np.diff(runs(rows), axis=1)
    few = rows.mean() <= SAME and lengths.max(initial=0) <= STANDS
    return rows if few and every >= ENOUGH and not by_chance else np.zeros_like(rows)


def contain_both(sensors: Sequence[Array], rows: IntArray, before: int) -> bool:
    """Whether increments (n, 3) in ``rows`` also contain the motion of the lost record.

    Those ``before`` rows earlier contain only their own motion. Sensors are weighted by the inverse mean square of their changes, because
    noise and pulses give no information.
    """
    held, usual = 0.0, 0.0
    for increments in sensors:
        own = rows[(rows >= before) & (rows < len(increments) - 1)]
        around, weight = increments[own - before] + increments[own + 1], 1 / max(float((np.diff(increments, axis=0) ** 2).mean()), TINY)
        held += weight * float((increments[own] * around).sum())
        usual += weight * float((around**2).sum()) / 2
    return held > BOTH_RATIO * usual
