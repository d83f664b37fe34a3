"""Saturation without a stated range, and sensors that stand still, by readings that repeat.

A saturated sensor repeats its extreme far more often than any of the next values, and readings do not repeat elsewhere, as coarse counts
and logs without noise do. A sensor that stands still repeats all its axes at once while the other sensor moves, or commands push in vain.
"""

from dataclasses import replace

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, median, runs
from massprop_cli.inputs.held import SAME, repeats
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import SATURATED, Log

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
STANDS = 8
"""Records in a row in which all axes repeat, or one of three does."""
FINE = 0.01
"""Part of the readings elsewhere that may repeat on any axis of a sensor that is seen to stand still."""
MOSTLY = 0.5
"""Part of the records in which a sensor that measures may stand still: one that has no noise does so most of the time."""
LATE = 5
"""Cycles after a command, by which it has moved something."""
LISTED = 8
UNITS = ("rad/s", "m/s^2")


def with_unstated(log: Log) -> Log:
    """The log with a notice of each sensor that saturates at a range that the vehicle file doesn't state, or stands still."""
    both = (log.delta_theta_imu_rad, log.delta_v_imu_m_s)
    driven, late = _commanded(log), LATE * log.records_per_cycle
    still = [standing(one, other, log.interval_s, driven, late) for one, other in (both, both[::-1])]
    told = zip(("gyro", "accelerometer"), both, still, strict=True)
    found = [*log.notices, *(_stands(log, name, increments, rows) for name, increments, rows in told if rows.any())]
    if _constant(log):
        said = "one axis of the gyro reads one value in every record, and the other axes never repeat: it is dead. Correct its logging"
        found.append(Notice("sensor-frozen", said))
    for code, increments, unit, stands in zip(SATURATED, both, UNITS, still, strict=True):
        if any(notice.code == code for notice in found):
            continue
        clipped = at_extremes(increments, log.interval_s) & ~stands[:, None]
        rows = np.flatnonzero(clipped.any(1))
        # of a log without noise the readings of all axes repeat while nothing acts
        coasts = np.logical_and.reduce([repeats(axis / log.interval_s)[rows] for sensor in both for axis in sensor.T])
        if len(rows) and coasts.mean() <= MOSTLY:
            limit = float(np.abs((increments[rows] / log.interval_s[rows, None])[clipped[rows]]).max())
            sensor = code.removesuffix("-saturated")
            listed = ", ".join(str(row) for row in rows[:LISTED]) + (", …" if len(rows) > LISTED else "")
            key = "imu.gyro_range_rad_s" if sensor == "gyro" else "imu.accel_range_m_s2"
            said = (
                f"{len(rows)} record(s), rows (from 0) {listed}, repeat the {sensor}'s extreme of {limit:.6g} {unit}: it saturates, and "
                "the "
                f"log lacks the motion beyond it. State {key}, or use a wider range"
            )
            found.append(Notice(code, said))
    return replace(log, notices=tuple(found)) if len(found) > len(log.notices) else log


def _stands(log: Log, sensor: str, increments: Array, rows: BoolArray) -> Notice:
    at = np.flatnonzero(rows)
    whole = all(repeats(axis / log.interval_s)[at[1:]].mean() > MOSTLY for axis in increments.T)
    who = f"the {sensor}" if whole else f"one axis of the {sensor}"
    first, last = int(at[0]), int(at[-1])
    where = f"{len(at)} record(s), rows (from 0) {first} to {last} ({log.time_s[first]:.6g} to {log.time_s[last]:.6g} s)"
    return Notice(
        "sensor-frozen",
        f"{who} repeats one reading in {where}, and nowhere else: it is stuck there. Cut these records, or exclude them with [[phases]]",
    )


def _constant(log: Log) -> bool:
    """Whether a gyro's axis that was logged never changes; an accelerometer may rest, and what is 0 on it counts as absent."""
    axes = log.delta_theta_imu_rad.T[list(log.axes[:3])]
    repeated = {float(repeats(axis / log.interval_s)[1:].mean()) for axis in axes}
    return 1.0 in repeated and len(repeated) > 1 and max(repeated - {1.0}) <= FINE


def _commanded(log: Log) -> BoolArray:
    """(n,) records in which what is commanded changes, which acts by ``LATE`` cycles later; rotors that hover move nothing."""
    found: BoolArray = np.zeros(len(log.time_s), dtype=bool)
    changed = (np.diff(log.command, axis=0, prepend=log.command[:1]) != 0).any(1)
    found[np.minimum(np.searchsorted(log.time_s, log.command_start_s[changed]), len(found) - 1)] = True
    return found


def _runs(rows: BoolArray) -> list[tuple[int, int]]:
    """Of ``STANDS`` and more in a row, where they begin and end."""
    return [(start, stop) for start, stop in runs(rows).tolist() if stop - start >= STANDS]


def standing(increments: Array, others: Array, interval_s: Array, commanded: BoolArray, late: int) -> BoolArray:
    """(n,) records in which a sensor repeats its reading on all axes, run by run, while the other one (n, 3) moves.

    Also where commands (n,) at least ``late`` records before the run's end moved neither sensor, and on one axis while its others move.
    """
    moving = [axis for axis in increments.T if np.ptp(axis) > 0]
    axes = [repeats(axis / interval_s) for axis in moving]
    none = np.zeros(len(interval_s), dtype=bool)
    if len(axes) < 2:
        return none
    repeating = np.sum(axes, 0)
    stood, found = _runs(repeating == len(axes)), none.copy()
    for axis, values in zip(axes, moving, strict=True):
        for start, stop in _runs(axis & (repeating == 1)) if len(axes) > 2 else ():
            rate = values / interval_s  # at its extreme it saturates
            same = SAME * abs(rate[start])
            found[start - 1 : stop] |= rate.min() < rate[start] - same and rate[start] + same < rate.max()
    if not stood and not found.any():
        return none
    moves = ~np.logical_and.reduce([repeats(axis / interval_s) for axis in others.T])
    for start, stop in stood:
        found[start - 1 : stop] = moves[start:stop].all() or commanded[start : max(stop - late, start)].any()
    if found.mean() > MOSTLY or any(float(axis[~found].mean()) > FINE for axis in axes):
        return none
    return found


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
    others = ~extreme & (np.ptp(values) > 0)
    others[1:] &= ~extreme[:-1]
    return int((repeats(values) & others).sum()), int(others.sum())


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
