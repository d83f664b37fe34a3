"""Detection of saturation without a stated range, and of stuck sensors, from repeated readings.

A saturated sensor repeats its extreme far more often than the next values. Readings of coarse sensors and of logs without noise also repeat
elsewhere. A stuck sensor repeats all axes at once while the other sensor moves or commands act.
"""

from dataclasses import replace

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, median, runs
from massprop_cli.inputs.held import SAME, repeats
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import SATURATED, Log

MIN_COUNT = 4
"""Minimum number of readings at the extreme."""
RATIO = 4.0
"""Minimum ratio of their number to that of readings at any of the next ``NEXT`` values."""
NEXT = 3
REPEATED = 0.35
"""Maximum fraction of repeated readings elsewhere."""
CHANCE = 1e-5
"""Largest probability that so many readings at the extreme repeat at the rate of repetition elsewhere."""
MIN_DISTANCE = 0.5
"""Minimum distance of an extreme from the median reading, over the median absolute deviation; excludes rest and rounding."""
MIN_RUN = 8
"""Minimum number of successive records in which all axes repeat, or one of three."""
FINE = 0.01
"""Maximum fraction of repeated readings elsewhere on each axis of a stuck sensor."""
MOSTLY = 0.5
"""Maximum fraction of stuck records; a noiseless sensor repeats more often."""
RESPONSE_CYCLES = 5
"""Number of cycles after a command by which the vehicle must move."""
LISTED = 8
UNITS = ("rad/s", "m/s^2")


def with_unstated(log: Log) -> Log:
    """Log with notices of sensors that saturate at a range that the vehicle file does not state, or that are stuck."""
    both = (log.delta_theta_imu_rad, log.delta_v_imu_m_s)
    driven, late = _commanded(log), RESPONSE_CYCLES * log.records_per_cycle
    still = [stuck(one, other, log.interval_s, driven, late) for one, other in (both, both[::-1])]
    sensors = zip(("gyro", "accelerometer"), both, still, strict=True)
    found = [*log.notices, *(_stuck_notice(log, name, increments, rows) for name, increments, rows in sensors if rows.any())]
    if _constant(log):
        message = "one axis of the gyro reads one value in every record, and the other axes never repeat: it is dead. Correct its logging"
        found.append(Notice("sensor-frozen", message))
    for code, increments, unit, stuck_rows in zip(SATURATED, both, UNITS, still, strict=True):
        if any(notice.code == code for notice in found):
            continue
        clipped = at_extremes(increments, log.interval_s) & ~stuck_rows[:, None]
        rows = np.flatnonzero(clipped.any(1))
        # without noise, all axes repeat while no command acts
        coasts = np.logical_and.reduce([repeats(axis / log.interval_s)[rows] for sensor in both for axis in sensor.T])
        if len(rows) and coasts.mean() <= MOSTLY:
            limit = float(np.abs((increments[rows] / log.interval_s[rows, None])[clipped[rows]]).max())
            sensor = code.removesuffix("-saturated")
            listed = ", ".join(str(row) for row in rows[:LISTED]) + (", …" if len(rows) > LISTED else "")
            key = "imu.gyro_range_rad_s" if sensor == "gyro" else "imu.accel_range_m_s2"
            message = (
                f"{len(rows)} record(s), rows (from 0) {listed}, repeat the {sensor}'s extreme of {limit:.6g} {unit}: it saturates, and "
                f"the log lacks the motion beyond it. State {key}, or use a wider range"
            )
            found.append(Notice(code, message))
    return replace(log, notices=tuple(found)) if len(found) > len(log.notices) else log


def _stuck_notice(log: Log, sensor: str, increments: Array, rows: BoolArray) -> Notice:
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
    """Whether a logged gyro axis never changes; an accelerometer axis may be constant at rest, and one with only 0 counts as absent."""
    axes = log.delta_theta_imu_rad.T[list(log.axes[:3])]
    repeated = {float(repeats(axis / log.interval_s)[1:].mean()) for axis in axes}
    return 1.0 in repeated and len(repeated) > 1 and max(repeated - {1.0}) <= FINE


def _commanded(log: Log) -> BoolArray:
    """(n,) records in which a command changes; constant commands, as of rotors in hover, need not move the vehicle."""
    found: BoolArray = np.zeros(len(log.time_s), dtype=bool)
    changed = (np.diff(log.command, axis=0, prepend=log.command[:1]) != 0).any(1)
    found[np.minimum(np.searchsorted(log.time_s, log.command_start_s[changed]), len(found) - 1)] = True
    return found


def _runs(rows: BoolArray) -> list[tuple[int, int]]:
    """Start and end of runs of at least ``MIN_RUN`` records."""
    return [(start, stop) for start, stop in runs(rows).tolist() if stop - start >= MIN_RUN]


def stuck(increments: Array, others: Array, interval_s: Array, commanded: BoolArray, late: int) -> BoolArray:
    """(n,) records in which a sensor is stuck: its axes repeat for a run of records while the other sensor (n, 3) moves.

    Also if a change of commands (n,) at least ``late`` records before the end of the run moves neither sensor, and on one axis while the
    others move.
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
            rate = values / interval_s  # a saturated axis is not stuck
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
    """(n, 3) whether a reading, an increment over its interval (n,), is one of repeated extremes of a saturated axis."""
    found = []
    for axis in increments.T:  # one by one, to limit memory for long logs
        found.append(_at_maximum(axis / interval_s) | _at_maximum(axis / -interval_s))
        spill.give_back()
    if any(axis.any() for axis in found):
        repeated, others = np.sum([_elsewhere(axis / interval_s, at) for axis, at in zip(increments.T, found, strict=True)], 0)
        again = sum(int(axis.sum()) - 1 for axis in found if axis.any())
        if repeated <= REPEATED * max(others, 1) and ((repeated + 1) / (others + 2)) ** again < CHANCE:
            return np.stack(found, 1)
    return np.zeros(increments.shape, dtype=bool)


def _elsewhere(values: Array, extreme: BoolArray) -> tuple[int, int]:
    """Number of repeated readings outside the extremes, and number of all readings there."""
    others = ~extreme & (np.ptp(values) > 0)
    others[1:] &= ~extreme[:-1]
    return int((repeats(values) & others).sum()), int(others.sum())


def _at_maximum(values: Array) -> BoolArray:
    """(n,) whether a reading equals the maximum, if significantly more readings do than equal the next values."""
    top = float(values.max())
    at = values >= top * (1 - SAME)
    none = np.zeros(len(values), dtype=bool)
    if top <= 0 or at.sum() < MIN_COUNT:
        return none
    middle = median(values)
    spread = median(np.abs(values - middle))
    if top - middle <= max(MIN_DISTANCE * spread, SAME * top) or spread == 0:
        return none
    levels, counts = np.unique(np.round(values / (SAME * top)), return_counts=True)
    below = np.sort(counts[levels < 1 / SAME - 2][-NEXT:])
    return at if at.sum() >= RATIO * (below[-1] if len(below) else 1) else none
