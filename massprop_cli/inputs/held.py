"""Sensors that are read more often than they measure: a logger that writes the latest value of each at every row."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray

OFTEN, SELDOM = 0.3, 0.01
"""Part of the readings that repeats at least; part that may repeat on some axes alone, as counts do, or off the beat, as rest does."""
SAME = 1e-9
"""Part of a reading within which another is the same: what dividing by the interval leaves."""
BEATS = 20
"""Readings from which on a beat is one."""


def repeated(readings: Array) -> BoolArray:
    """(n,) which of readings (n, axes) repeat the one before, of a sensor that is held on a beat of its own; else none.

    All axes repeat at once or none does, and as often each time, which a motion without noise does not.
    """
    same = np.abs(np.diff(readings, axis=0, prepend=np.nan)) <= SAME * np.abs(readings)
    axes = ~same[1:].all(0)  # the others stand still, or are stated by a number
    whole, some = np.asarray(same[:, axes].all(1)), same[:, axes].any(1)
    none = np.zeros(len(readings), dtype=bool)
    if axes.sum() < 2 or whole.mean() < OFTEN or (some & ~whole).mean() > SELDOM:
        return none
    runs = np.diff(np.flatnonzero(~whole))
    on_beat = len(runs) >= BEATS and (np.abs(runs - runs.mean()) < 1.5).mean() > 1 - SELDOM
    return whole if on_beat else none
