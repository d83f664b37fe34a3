"""Readings that are not the sensor's own: held by a logger that writes the latest of each at every row, or smoothed before export."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray

OFTEN, SELDOM = 0.3, 0.01
"""Part of the readings that repeats at least; part that may repeat on some axes alone, as counts do, or off the beat, as rest does."""
SAME = 1e-9
"""Part of a reading within which another is the same: what dividing by the interval leaves."""
STRETCH, FEWEST, QUIETEST, WIDEST = 64, 16, 4, 12
"""Readings of a stretch; stretches at least; of how many the quietest is taken; readings that a moving mean is over at most."""
HALF, OTHERS = 0.35, 0.15
"""Correlation of differences beyond which they go against one another, and up to which the others may. By chance it scatters by 0.03."""
IN_STEP = 0.4
"""Part of the squares of differences that is on one beat, beyond which they are the commands': by chance 0.3 at most, of commands 0.7."""
BEATS = 20
"""Readings from which on a beat is one."""


def repeats(readings: Array) -> BoolArray:
    """(n, ...) whether each of readings (n, ...) is the one before."""
    return np.asarray(np.abs(np.diff(readings, axis=0, prepend=np.nan)) <= SAME * np.abs(readings))


def on_a_beat(readings: Array) -> BoolArray:
    """(n,) which of readings (n, axes) repeat the one before, of a sensor that is held on a beat of its own; else none.

    All axes repeat at once or none does, and as often each time, which a motion without noise does not.
    """
    same = repeats(readings)
    axes = ~same[1:].all(0)  # the others stand still, or are stated by a number
    whole, some = np.asarray(same[:, axes].all(1)), same[:, axes].any(1)
    none = np.zeros(len(readings), dtype=bool)
    if axes.sum() < 2 or whole.mean() < OFTEN or (some & ~whole).mean() > SELDOM:
        return none
    runs = np.diff(np.flatnonzero(~whole))
    on_beat = len(runs) >= BEATS and (np.abs(runs - runs.mean()) < 1.5).mean() > 1 - SELDOM
    return whole if on_beat else none


def moving_mean(readings: Array) -> int:
    """Over how many readings each of (n, axes) is a moving mean; 0 where none is.

    White noise under a moving mean over m readings has first differences that correlate by −½ with those m before, and with no others. The
    quietest segments decide, and most axes must agree. Commands that change every m readings correlate alike, but on one beat.
    """
    count = len(readings) // STRETCH
    if count < FEWEST:
        return 0
    found = []
    for axis in np.diff(readings, axis=0, prepend=readings[:1])[: count * STRETCH].T:
        parts = axis.reshape(count, STRETCH)
        parts = parts - parts.mean(1, keepdims=True)
        moving = np.argsort((parts**2).mean(1))[count // QUIETEST :]
        quiet = np.delete(parts, moving, 0)
        size = float((quiet**2).mean())
        if size > 0:
            along = np.array([(quiet[:, m:] * quiet[:, :-m]).mean() for m in range(1, WIDEST + 1)]) / size
            least = int(along.argmin())
            alone = np.delete(along, least).min() > -OTHERS
            parts[moving] = 0.0
            mean = least > 0 and along[least] < -HALF and alone and not _in_step(parts.ravel() ** 2, least + 1)
            found.append(least + 1 if mean else 0)
    usual = max(found, key=found.count, default=0)
    return usual if found.count(usual) > 1 else 0


def _in_step(squares: Array, over: int) -> bool:
    """Whether these (n,) come on a beat of about so many readings: their discrete Fourier transform near one in so many."""
    beats = np.fft.rfft(squares, 2 * len(squares))
    often = np.fft.rfftfreq(2 * len(squares))
    near = np.abs(1 - over * often) < 0.5 * often
    return bool(np.abs(beats[near]).max() > IN_STEP * squares.sum())
