"""Detection of repeated readings (sample and hold by a logger) and of moving means applied before export."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray

MIN_REPEATED, MAX_IRREGULAR = 0.3, 0.01
"""Minimum fraction of repeated readings; maximum fraction that repeats on some axes only (quantisation) or irregularly (rest)."""
SAME = 1e-9
"""Relative difference below which two readings are equal; covers rounding of the division by the interval."""
SEGMENT, MIN_SEGMENTS, SEGMENTS_PER_USED, LONGEST = 64, 16, 4, 12
"""Readings per segment; minimum number of segments; one in so many segments, those with the least motion, is used; longest moving mean."""
MIN_CORRELATION, MAX_CORRELATION = 0.35, 0.15
"""Minimum negative correlation of differences at the lag of a moving mean, and maximum at other lags; sampling scatter is 0.03."""
MIN_POWER = 0.4
"""Fraction of the differences' power at one period above which commands cause it: noise gives 0.3 at most, commands 0.7."""
MIN_RUNS = 20
"""Minimum number of new readings to detect a period."""


def repeats(readings: Array) -> BoolArray:
    """(n, ...) whether each of the readings (n, ...) equals the previous one."""
    return np.asarray(np.abs(np.diff(readings, axis=0, prepend=np.nan)) <= SAME * np.abs(readings))


def periodic_repeats(readings: Array) -> BoolArray:
    """(n,) which of the readings (n, axes) repeat the previous one because a logger holds them periodically; all False if it does not.

    With a periodic hold, all axes repeat together and equally often. Motion without noise does not behave so.
    """
    same = repeats(readings)
    axes = ~same[1:].all(0)  # constant axes do not count
    whole, some = np.asarray(same[:, axes].all(1)), same[:, axes].any(1)
    none = np.zeros(len(readings), dtype=bool)
    if axes.sum() < 2 or whole.mean() < MIN_REPEATED or (some & ~whole).mean() > MAX_IRREGULAR:
        return none
    runs = np.diff(np.flatnonzero(~whole))
    on_beat = len(runs) >= MIN_RUNS and (np.abs(runs - runs.mean()) < 1.5).mean() > 1 - MAX_IRREGULAR
    return whole if on_beat else none


def moving_mean(readings: Array) -> int:
    """Length of a moving mean applied to the readings (n, axes); 0 without one.

    After a moving mean over m readings, first differences of white noise have the correlation −½ at lag m and 0 at other lags. The test
    uses the segments with the least motion, and most axes must agree. Commands that change every m readings give the same correlation,
    but at a fixed phase.
    """
    count = len(readings) // SEGMENT
    if count < MIN_SEGMENTS:
        return 0
    lengths = []
    for axis in np.diff(readings, axis=0, prepend=readings[:1])[: count * SEGMENT].T:
        parts = axis.reshape(count, SEGMENT)
        parts = parts - parts.mean(1, keepdims=True)
        moving = np.argsort((parts**2).mean(1))[count // SEGMENTS_PER_USED :]
        quiet = np.delete(parts, moving, 0)
        size = float((quiet**2).mean())
        if size > 0:
            correlation = np.array([(quiet[:, m:] * quiet[:, :-m]).mean() for m in range(1, LONGEST + 1)]) / size
            least = int(correlation.argmin())
            alone = np.delete(correlation, least).min() > -MAX_CORRELATION
            parts[moving] = 0.0
            mean = least > 0 and correlation[least] < -MIN_CORRELATION and alone and not _is_periodic(parts.ravel() ** 2, least + 1)
            lengths.append(least + 1 if mean else 0)
    usual = max(lengths, key=lengths.count, default=0)
    return usual if lengths.count(usual) > 1 else 0


def _is_periodic(squares: Array, over: int) -> bool:
    """Whether ``squares`` (n,) are periodic with about ``over`` readings, by their discrete Fourier transform near that period."""
    spectrum = np.fft.rfft(squares, 2 * len(squares))
    frequency = np.fft.rfftfreq(2 * len(squares))
    near = np.abs(1 - over * frequency) < 0.5 * frequency
    return bool(np.abs(spectrum[near]).max() > MIN_POWER * squares.sum())
