"""Detection of repeated readings (sample and hold by a logger) and of moving means applied before export."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray

OFTEN, SELDOM = 0.3, 0.01
"""Minimum fraction of repeated readings; maximum fraction that repeats on some axes only (quantisation) or irregularly (rest)."""
SAME = 1e-9
"""Relative difference below which two readings are equal; covers rounding of the division by the interval."""
STRETCH, FEWEST, QUIETEST, WIDEST = 64, 16, 4, 12
"""Readings per segment; minimum number of segments; one in so many segments, those with the least motion, is used; longest moving mean."""
HALF, OTHERS = 0.35, 0.15
"""Minimum negative correlation of differences at the lag of a moving mean, and maximum at other lags; sampling scatter is 0.03."""
IN_STEP = 0.4
"""Fraction of the differences' power at one period above which commands cause it: noise gives 0.3 at most, commands 0.7."""
BEATS = 20
"""Minimum number of new readings to detect a period."""


def repeats(readings: Array) -> BoolArray:
    """(n, ...) whether each of the readings (n, ...) equals the previous one."""
    return np.asarray(np.abs(np.diff(readings, axis=0, prepend=np.nan)) <= SAME * np.abs(readings))


def on_a_beat(readings: Array) -> BoolArray:
    """(n,) which of the readings (n, axes) repeat the previous one because a logger holds them periodically; all False if it does not.

    With a periodic hold, all axes repeat together and equally often. Motion without noise does not behave so.
    """
    same = repeats(readings)
    axes = ~same[1:].all(0)  # constant axes do not count
    whole, some = np.asarray(same[:, axes].all(1)), same[:, axes].any(1)
    none = np.zeros(len(readings), dtype=bool)
    if axes.sum() < 2 or whole.mean() < OFTEN or (some & ~whole).mean() > SELDOM:
        return none
    runs = np.diff(np.flatnonzero(~whole))
    on_beat = len(runs) >= BEATS and (np.abs(runs - runs.mean()) < 1.5).mean() > 1 - SELDOM
    return whole if on_beat else none


def moving_mean(readings: Array) -> int:
    """Length of a moving mean applied to the readings (n, axes); 0 without one.

    After a moving mean over m readings, first differences of white noise have the correlation −½ at lag m and 0 at other lags. The test
    uses the segments with the least motion, and most axes must agree. Commands that change every m readings give the same correlation,
    but at a fixed phase.
    """
    count = len(readings) // STRETCH
    if count < FEWEST:
        return 0
    lengths = []
    for axis in np.diff(readings, axis=0, prepend=readings[:1])[: count * STRETCH].T:
        parts = axis.reshape(count, STRETCH)
        parts = parts - parts.mean(1, keepdims=True)
        moving = np.argsort((parts**2).mean(1))[count // QUIETEST :]
        quiet = np.delete(parts, moving, 0)
        size = float((quiet**2).mean())
        if size > 0:
            correlation = np.array([(quiet[:, m:] * quiet[:, :-m]).mean() for m in range(1, WIDEST + 1)]) / size
            least = int(correlation.argmin())
            alone = np.delete(correlation, least).min() > -OTHERS
            parts[moving] = 0.0
            mean = least > 0 and correlation[least] < -HALF and alone and not _in_step(parts.ravel() ** 2, least + 1)
            lengths.append(least + 1 if mean else 0)
    usual = max(lengths, key=lengths.count, default=0)
    return usual if lengths.count(usual) > 1 else 0


def _in_step(squares: Array, over: int) -> bool:
    """Whether ``squares`` (n,) are periodic with about ``over`` readings, by their discrete Fourier transform near that period."""
    spectrum = np.fft.rfft(squares, 2 * len(squares))
    frequency = np.fft.rfftfreq(2 * len(squares))
    near = np.abs(1 - over * frequency) < 0.5 * frequency
    return bool(np.abs(spectrum[near]).max() > IN_STEP * squares.sum())
