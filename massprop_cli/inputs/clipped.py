"""Saturation that no stated range tells of: readings that repeat at the end of what a sensor shows.

A sensor that goes no further gives its last value again and again, where noise makes any two other readings differ. So readings are held
against their own extreme, axis by axis and side by side: those that repeat it must be several, far more than any of the next few values
(of which counts have one each) has, and readings must not repeat elsewhere, as they do in coarse counts, of a log without noise, of a
sensor that is read more often than it measures.
"""

from dataclasses import replace

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.inputs.telemetry import SATURATED, Log, Notice

SAME = 1e-9
"""Part of a reading within which another is the same: what dividing by the interval leaves."""
LEAST = 4
"""Readings at the extreme."""
PILE = 4.0
"""... and how many times as many as at any of the next ``NEXT`` values below."""
NEXT = 3
REPEATED = 0.35
"""Part of the readings elsewhere that may be the same as the one before, ..."""
CHANCE = 1e-5
"""... and how likely those at the extreme may be as many by such repeating."""
FAR = 0.5
"""Times the middle distance of readings from the middle one that an extreme must be from it at least: rest is no extreme, nor is what is
the same but for rounding."""
LISTED = 8
UNITS = ("rad/s", "m/s^2")


def with_unstated(log: Log) -> Log:
    """The log with a notice of each sensor that saturates at a range that the vehicle file doesn't state."""
    found = list(log.notices)
    for code, increments, unit in zip(SATURATED, (log.delta_theta_imu_rad, log.delta_v_imu_m_s), UNITS, strict=True):
        if any(notice.code == code for notice in found):
            continue
        clipped = at_extremes(increments, log.interval_s)
        rows = np.flatnonzero(clipped.any(1))
        if len(rows):
            limit = float(np.abs((increments[rows] / log.interval_s[rows, None])[clipped[rows]]).max())
            sensor = code.removesuffix("-saturated")
            listed = ", ".join(str(row) for row in rows[:LISTED]) + (", …" if len(rows) > LISTED else "")
            key = "imu.gyro_range_rad_s" if sensor == "gyro" else "imu.accel_range_m_s2"
            found.append(
                Notice(
                    code,
                    f"{len(rows)} record(s), rows (from 0) {listed}, repeat the {sensor}'s extreme of {limit:.6g} {unit}: it saturates. "
                    f"What they hid is not in the estimate; state {key}, or use a wider range",
                )
            )
    return replace(log, notices=tuple(found)) if len(found) > len(log.notices) else log


def at_extremes(increments: Array, interval_s: Array) -> BoolArray:
    """(n, 3) whether a reading, an increment over its interval (n,), repeats its axis' extreme as a saturated sensor does."""
    # one axis after the other, as a log may be long
    found = [_ends(axis, interval_s) for axis in increments.T]
    if any(axis.any() for axis in found):
        repeated, others = np.sum([_elsewhere(axis / interval_s, at) for axis, at in zip(increments.T, found, strict=True)], 0)
        again = sum(int(axis.sum()) - 1 for axis in found if axis.any())
        if repeated <= REPEATED * max(others, 1) and ((repeated + 1) / (others + 2)) ** again < CHANCE:
            return np.stack(found, 1)
    return np.zeros(increments.shape, dtype=bool)


def _ends(increments: Array, interval_s: Array) -> BoolArray:
    """(n,) the same of one axis, whatever is elsewhere."""
    found: BoolArray = _side(increments / interval_s) | _side(increments / -interval_s)
    spill.give_back()
    return found


def _elsewhere(values: Array, extreme: BoolArray) -> tuple[int, int]:
    """How many readings that are none of the extreme's are the same as the one before, and how many there are."""
    same = np.abs(np.diff(values)) <= SAME * np.abs(values[1:])
    others = ~extreme & (np.ptp(values) > 0)
    others[1:] &= ~extreme[:-1]
    return int((same & others[1:]).sum()), int(others.sum())


def _side(values: Array) -> BoolArray:
    """(n,) whether each repeats the largest, if more do than noise and counts make likely."""
    top = float(values.max())
    at = values >= top * (1 - SAME)
    none = np.zeros(len(values), dtype=bool)
    if top <= 0 or at.sum() < LEAST:
        return none
    middle = median(values)
    spread = median(np.abs(values - middle))
    if top - middle <= max(FAR * spread, SAME * top) or spread == 0:
        return none
    levels, counts = np.unique(np.round(values / (SAME * top)), return_counts=True)
    below = np.sort(counts[levels < 1 / SAME - 2][-NEXT:])
    return at if at.sum() >= PILE * (below[-1] if len(below) else 1) else none
