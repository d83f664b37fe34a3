"""Saturation that no stated range tells of: readings that repeat at the end of what a sensor shows.

A sensor that goes no further gives its last value again and again, where noise makes any two other readings differ. So readings are held
against their own extreme, axis by axis and side by side: those that repeat it must be several, far more than any of the next few values
(of which counts have one each) has, and readings must not repeat elsewhere, as they do in coarse counts, of a log without noise, of a
sensor that is read more often than it measures.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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
"""Part of the readings elsewhere that may be the same as the one before."""
FAR = 0.5
"""Times the middle distance of readings from the middle one that an extreme must be from it at least: rest is no extreme."""
LISTED = 8
UNITS = ("rad/s", "m/s^2")


def with_unstated(log: Log) -> Log:
    """The log with a notice of each sensor that saturates at a range that the vehicle file doesn't state."""
    found = list(log.notices)
    for code, increments, unit in zip(SATURATED, (log.delta_theta_imu_rad, log.delta_v_imu_m_s), UNITS, strict=True):
        if any(notice.code == code for notice in found):
            continue
        readings = increments / log.interval_s[:, None]
        clipped = at_extremes(readings)
        rows = np.flatnonzero(clipped.any(1))
        if len(rows):
            limit = float(np.abs(readings[clipped]).max())
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


def at_extremes(readings: Array) -> BoolArray:
    """(n, 3) whether a reading repeats its axis' extreme as a saturated sensor does."""
    found = np.zeros(readings.shape, dtype=bool)
    same = np.zeros(readings.shape, dtype=bool)
    same[1:] = np.abs(np.diff(readings, axis=0)) <= SAME * np.abs(readings[1:])
    for axis in range(readings.shape[1]):
        for sign in (1.0, -1.0):
            found[:, axis] |= _side(sign * readings[:, axis])
    elsewhere = ~found & (np.ptp(readings, axis=0) > 0)
    elsewhere[1:] &= ~found[:-1]
    if not found.any() or (same & elsewhere).sum() > REPEATED * max(int(elsewhere.sum()), 1):
        return np.zeros(readings.shape, dtype=bool)
    return found


def _side(values: Array) -> BoolArray:
    """(n,) whether each repeats the largest, if more do than noise and counts make likely."""
    top = float(values.max())
    middle = median(values)
    spread = median(np.abs(values - middle))
    none = np.zeros(len(values), dtype=bool)
    if top <= 0 or top - middle <= FAR * spread or spread == 0:
        return none
    levels, counts = np.unique(np.round(values / (SAME * top)), return_counts=True)
    at = values >= top * (1 - SAME)
    below = np.sort(counts[levels < 1 / SAME - 2][-NEXT:])
    return at if at.sum() >= max(LEAST, PILE * (below[-1] if len(below) else 1)) else none
