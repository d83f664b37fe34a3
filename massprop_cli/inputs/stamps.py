"""Stamps of a log's records, examined by themselves: whose fault it is where they are not even, the clock's or the records'.

The stamps are compared with an even clock, ``t_k = t_0 + k p + e_k``. Where their resolution explains all e_k, the clock is even. Else the
increments decide: an increment over a stamped interval d_k is rate times d_k, one over an even interval rate times p. With

    θ_k / p − θ_(k−1) / p = f(commands, rates) + β (ω_k δ_k − ω_(k−1) δ_(k−1)) / p,        δ_k = d_k − p,

β is 1 where the records are as long as stamped, and 0 where only the stamps scatter; f is linear in the commanded wrench of this cycle and
those before, whose coefficients are of no interest, and in products of the rates. Where a clock leaps, back or over more than a record, the
same regression tells whether the motion goes on as if no record were missing. A leap that it leaves open stays: such a log is refused.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY, Array, median
from massprop_cli.inputs.columns import DELTA_THETA, DELTA_V, GYRO, TIME, WRENCH, jet
from massprop_cli.inputs.formats.clocks import WRAPS, outlying
from massprop_cli.inputs.logtable import GAP, LONG, MISSING, WHOLE, LogTable
from massprop_cli.inputs.vehicle import Vehicle

EXACT = 1e-4
"""Part of the interval by which stamps may be off an even clock, and nothing is examined."""
FAR = 0.1
"""Part of the interval by which intervals may be off where the increments don't tell whose fault it is: the stamps hold."""
LEAP = 0.75
"""Records by which a clock's leap is more than scatter."""
ROBUST = 1.4826
"""Median absolute deviation to standard deviation, of a normal distribution."""
SPANS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 24, 48)
"""Records over which the usual interval is measured: packets of so many come evenly."""
MOSTLY = 0.85
"""Part of these intervals whose scatter is compared."""
LEAST = 24
"""Records below which nothing is examined."""
FEW = 1.4
"""Intervals over records, up to which records are missing: of packets these are many times as many."""
WINDOW = 12
"""Records at least on each side of a leap, whose earliest stamps are compared."""
WIDEST = 400
"""... and at most; of so many the scatter is taken, where one side has fewer than WINDOW."""
MOST = 50
"""Leaps of one log."""
ROWS = 4000
"""Records on each side of a place that are regressed."""
CYCLES = 5
"""Control cycles for which a command may act."""
SURE = 4.0
"""Sigmas between what the increments say and the mean of both hypotheses."""
SIGMAS, FURTHEST = 5.0, 5e-3
"""Within which an interval is an equal part of a control cycle, and the most of it."""
TOGETHER, MANY = 0.3, 0.3
"""Records that follow another within this part of the interval come in packets, if at least this part of them does."""
EARLY, ONE_SIDED = 0.02, 0.5
"""Part of the stamps that are no later than those of records on time; and earliness over lateness, both from the median, below which
stamps are late, never early."""
TWICE, STILL = 0.01, 1e-6
"""Part of the stamps that stand still, up to which they are records that stand twice; part of the interval that is none."""


class Stamps(NamedTuple):
    """What the records' times are."""

    time_s: Array
    """(n,) end of each record."""
    moved_s: Array | None = None
    """(n,) what is taken off the clock at each record where it leaps."""
    message: str = ""
    """What was found and done; empty where the stamps are as recorded."""
    remedy: str = ""
    """Where a leap is left: what to do."""


class _Leap(NamedTuple):
    row: int
    by_s: float
    wraps: bool


class _RateGrowth(NamedTuple):
    """What predicts the growth of the rates."""

    growth: Array
    """(n, axes) of the mean rate from the record before, in units of its scatter."""
    by: Array
    """(n, m)"""
    rate: Array | None
    """(n, axes) smoothed, in units of the growth's scatter; None where records hold rates, to which stamps do nothing."""


def examined(source: LogTable, vehicle: Vehicle, time_s: Array) -> Stamps:
    """Times of the records, rebuilt where the stamps (n,), s, and not the records are uneven; :class:`InputError` where one is no time."""
    far, why = outlying(time_s)
    source.refuse(far, TIME, lambda row: f"{time_s[row]:.9g} s {why}")
    stated = vehicle.imu.clock_even
    steps = np.diff(time_s)
    if stated is False or len(time_s) < LEAST:
        return Stamps(time_s)
    mean = float(steps.mean())
    if mean > 0 and np.abs(steps - mean).max() <= EXACT * mean:
        return Stamps(time_s)
    usual_s, span = _usual(time_s)
    if usual_s <= 0:
        return Stamps(time_s)
    if stated:
        return Stamps(_on_even_clock(time_s, np.arange(len(time_s), dtype=float), vehicle.cycle.period_s))
    standing = np.flatnonzero(np.abs(steps) < STILL * usual_s)
    beside = np.append(standing, standing + 1).clip(0, len(steps) - 1)
    others = np.abs(np.delete(steps, np.append(beside, (standing - 1).clip(0))) - usual_s)
    if 0 < len(standing) <= max(TWICE * len(steps), 2) and others.max(initial=0.0) <= FAR * usual_s:
        return Stamps(time_s)
    return _decided(source, vehicle, time_s, usual_s, span)


def _decided(source: LogTable, vehicle: Vehicle, time_s: Array, usual_s: float, span: int) -> Stamps:
    leaps = _leaps(time_s, usual_s, span)
    if leaps is None:
        return Stamps(time_s)
    moved, lost, said, remedy = np.zeros(len(time_s)), np.zeros(len(time_s)), [], ""
    for leap in leaps:
        records = leap.by_s / usual_s
        missing = round(records) if abs(records - round(records)) < WHOLE else 0
        whole = 1 <= missing <= MISSING * max(round(vehicle.cycle.period_s / usual_s), 1)
        # records that only seem to be missing cost little: nothing is said of the motion there
        goes_on = leap.wraps or (not whole and _goes_on(source, vehicle, leap, usual_s))
        if goes_on:
            moved[leap.row :] += leap.by_s
            verb = "wraps" if leap.wraps else "was set"
            said.append(f"the clock {verb} at {source.place(leap.row)}, by {leap.by_s:.9g} s")
        elif whole or 0 < records <= GAP - 1:
            lost[leap.row :] += missing if whole else records
        else:
            remedy = ", or if no record is missing there state imu.clock_even = true"
    if remedy:
        return Stamps(time_s, None, "", remedy)
    own = [leap.row for leap in leaps]
    even, why = _even(source, vehicle, time_s - moved, usual_s, lost, own)
    if not why and not said:
        return Stamps(time_s)
    found = even if why else time_s - moved
    every = f"records are assumed to come every {median(np.diff(even)):.6g} s" if why else "all records are put on one clock"
    message = (
        f"{'; '.join([*said, *([why] if why else [])])}. Now {every}; stamp records with the IMU's clock, or state imu.clock_even = true "
        "(false: use the stamps as they are)"
    )
    return Stamps(found, moved if said else None, message)


def _usual(time_s: Array) -> tuple[float, int]:
    """The usual interval, and over how many records it comes most evenly: leaps, packets and scatter are left out.

    Where all intervals are whole multiples of the median, and few are longer than it, records are missing: the median is the usual one.
    """
    steps = np.diff(time_s)
    times = steps / max(median(steps), TINY)
    whole = np.round(times)
    if whole.min() > 0 and np.abs(times - whole).max() <= FAR and len(steps) < whole.sum() < FEW * len(steps):
        return median(steps), 1
    best, found, span = np.inf, 0.0, 1
    for lag in SPANS:
        if 4 * lag > len(time_s):
            break
        mean = (time_s[lag:] - time_s[:-lag]) / lag
        middle = median(mean)
        scatter = float(np.quantile(np.abs(mean - middle), MOSTLY))  # most of rounded stamps' intervals are the same
        if scatter * lag**0.5 < best:
            near = np.abs(mean - middle) <= max(3 * scatter, 1e-9 * abs(middle))
            best, found, span = scatter * lag**0.5, float(mean[near].mean()), lag
    return found, span


def _leaps(time_s: Array, usual_s: float, span: int) -> list[_Leap] | None:
    """Where the clock goes back or on by more than a record for good; None where stamps go back and return, or leap too often."""
    steps = np.diff(time_s)
    late = time_s - usual_s * np.arange(len(time_s))
    found = []
    for row in (np.flatnonzero((steps < 0) | (steps > LONG * usual_s)) + 1).tolist():
        step = float(steps[row - 1])
        width = min(max(WINDOW, int(3 * abs(step) / usual_s)), WIDEST)
        width = span * -(-width // span)
        # what comes late takes no part in the earliest
        before, after = late[max(row - width, 0) : row], late[row : row + width]
        by_s, scatter_s = float(after.min() - before.min()), 0.0
        if min(len(before), len(after)) < WINDOW:  # of a few records each may be as late as one ever is
            scatter_s = float(np.ptp(late[max(row - WIDEST, 0) : row] if len(after) < WINDOW else late[row : row + WIDEST]))
        if abs(by_s) < max(LEAP * usual_s, scatter_s):
            if step < 0:
                return None
            continue
        wrapped = next((length for length in WRAPS if abs(step + length - usual_s) < 0.5 * usual_s and length > 10 * usual_s), None)
        found.append(_Leap(row, -wrapped if wrapped else by_s, wrapped is not None))
        late[row:] -= found[-1].by_s
        if len(found) > MOST:
            return None
    return found


def _even(source: LogTable, vehicle: Vehicle, time_s: Array, usual_s: float, lost: Array, leaps: Sequence[int]) -> tuple[Array, str]:
    """Times on an even clock, and why; the reason is empty where the stamps hold."""
    number = np.arange(len(time_s)) + lost
    tick, line = _resolution(time_s), np.polyval(np.polyfit(number, time_s, 1), number)
    if EXACT * usual_s < np.abs(time_s - line).max() <= 0.75 * tick:
        return line, f"the stamps are rounded to {tick:.3g} s"
    even = _on_even_clock(time_s, number, vehicle.cycle.period_s)
    away, usual_s = time_s - even, median(np.diff(even))
    off = np.diff(time_s, prepend=time_s[0] - usual_s) - usual_s
    off[[0, *leaps]] = 0.0
    if np.abs(off).max() <= EXACT * usual_s:
        return time_s, ""
    follows = _follows(source, vehicle, off, usual_s, leaps)
    if follows is None and np.abs(off).max() <= FAR * usual_s:
        return time_s, ""  # too little for increments to tell, or to be told by
    scatter = float(np.std(off))
    if follows is None and float(np.std(away)) > 1.5 * scatter:
        return time_s, ""  # what each interval adds is not taken back: records of other lengths
    if follows is not None and follows[0] > 0.5:
        return time_s, ""
    steps, bursts = off + usual_s, float(np.mean(off < (TOGETHER - 1) * usual_s)) > MANY
    few = float(np.mean(np.abs(off) > FAR * usual_s)) < 0.1
    away = time_s - even
    early, middle, late = np.quantile(away, (EARLY, 0.5, 1 - EARLY))
    if bursts or middle - early < ONE_SIDED * (late - middle):
        even = even + early  # a record is late at most: those that are least so came at their time
    what = "come in bursts" if bursts else "step" if few else "scatter"
    why = f"the stamps {what} (intervals of {steps[1:].min():.3g} to {steps[1:].max():.3g} s)"
    if follows is not None:
        why += f" and the increments do not follow them (slope {follows[0]:.2g} ± {follows[1]:.2g}, expected 1)"
    return even, why


def _on_even_clock(time_s: Array, number: Array, period_s: float) -> Array:
    """(n,) times of records that are so many intervals from the first (n,), through the middle of their stamps.

    The interval is an equal part of the control cycle where the stamps allow it, else as they have it.
    """
    slope = float(np.polyfit(number, time_s, 1)[0])
    # of stamps that step, as of a random walk: those that scatter about their times tell it better
    error = float(np.std(np.diff(time_s) - slope * np.diff(number))) * len(time_s) ** -0.5
    nominal = period_s / max(round(period_s / slope), 1)
    every = number * (nominal if abs(nominal - slope) < min(SIGMAS * error + EXACT * nominal, FURTHEST * nominal) else slope)
    return np.asarray(median(time_s - every) + every)


def _resolution(time_s: Array) -> float:
    """The coarsest steps in which all stamps are, s: of float32, or of decimals."""
    top = np.abs(time_s[[0, -1]]).max()
    if (time_s.astype(np.float32) == time_s).all():
        return float(np.spacing(np.float32(top)))
    for power in range(7):
        counts = time_s * 10.0**power
        if np.abs(counts - np.round(counts)).max() < 1e-3:
            return float(10.0**-power)
    return 0.0


def _follows(source: LogTable, vehicle: Vehicle, off_s: Array, usual_s: float, leaps: Sequence[int]) -> tuple[float, float] | None:
    """β and its sigma: by how much increments follow the stamped intervals. None where the motion doesn't tell."""
    place = int(np.argmax(np.abs(off_s)))
    part = slice(max(place - ROWS, 0), min(place + ROWS, len(off_s)))
    motion = _motion(source, vehicle, usual_s, part)
    if motion is None or motion.rate is None:
        return None
    share = (off_s[part] / usual_s)[:, None] * motion.rate
    uneven = np.diff(share, axis=0, prepend=share[:1])
    used = np.ones(len(share), dtype=bool)
    used[[0, *(row - part.start for row in leaps if part.start <= row < part.stop)]] = False
    known = motion.by[used]
    left = (one - known @ np.linalg.lstsq(known, one, rcond=1e-9)[0] for one in (motion.growth[used], uneven[used]))
    growth, by = (one.ravel() for one in left)
    size = float(by @ by)
    if size == 0:
        return None
    beta = float(by @ growth) / size
    sigma = float(np.sqrt(((by * (growth - beta * by)) ** 2).sum())) / size
    return (beta, sigma) if abs(beta - 0.5) > SURE * sigma else None


def _goes_on(source: LogTable, vehicle: Vehicle, leap: _Leap, usual_s: float) -> bool:
    """Whether the motion goes on over a leap as over any other step, where it hardly would if records were missing."""
    rows = source.table.rows
    part = slice(max(leap.row - ROWS, 0), min(leap.row + ROWS, rows))
    motion, at = _motion(source, vehicle, usual_s, part), leap.row - part.start
    if motion is None:
        return False
    used = np.ones(len(motion.by), dtype=bool)
    used[[0, at]] = False
    solved = np.linalg.lstsq(motion.by[used], motion.growth[used], rcond=1e-9)[0]
    left = motion.growth - motion.by @ solved
    scale = ROBUST * np.array([median(np.abs(column)) for column in left[used].T])
    scale = np.maximum(scale, 1e-12)
    far = ((left / scale) ** 2).sum(1)
    usual = float(np.quantile(far[used], 0.99))
    if far[at] > usual:
        return False
    # from the record before to any other: how many would look as well
    level = np.cumsum(motion.growth, 0)
    level[at:] -= motion.growth[at]
    away = level - level[at - 1] - motion.by[at] @ solved
    apart = np.abs(np.arange(len(away)) - at) > WINDOW
    return bool(np.mean(((away[apart] / scale) ** 2).sum(1) <= usual) < 0.02)


def _motion(source: LogTable, vehicle: Vehicle, usual_s: float, part: slice) -> _RateGrowth | None:
    """Growth of the rates and what may predict it; None where there are no three rates, or too few records for the commands."""
    increments = all(source.has(name) for name in DELTA_THETA)
    names = DELTA_THETA if increments else GYRO
    if not all(source.has(name) for name in names):
        return None
    rate = np.stack([source.optional(name)[part] for name in names], 1) / (usual_s if increments else 1.0)
    pushed = _pushed(source, vehicle, part)
    if not np.isfinite(rate).all():
        return None
    lags = 1 + CYCLES * max(round(vehicle.cycle.period_s / usual_s), 1)
    products = np.stack([rate[:, i] * rate[:, j] for i in range(3) for j in range(i + 1)], 1)
    before = [np.vstack([np.zeros((lag, pushed.shape[1])), pushed[: len(pushed) - lag]]) for lag in range(lags)]
    by = np.hstack([*before, products, np.roll(products, 1, 0), np.ones((len(rate), 1))])
    if vehicle.environment.kind != "free" and all(source.has(name) for name in DELTA_V):
        # the vertical in IMU axes, about which its weight turns what stands on the ground
        felt = np.stack([source.optional(name)[part] for name in DELTA_V], 1) / usual_s
        by = np.hstack([by, felt]) if np.isfinite(felt).all() else by
    size = np.sqrt((by**2).mean(0))
    by = by[:, size > 0] / size[size > 0]
    if 3 * by.shape[1] > len(by):
        return None
    smooth = np.stack([np.convolve(column, np.ones(7) / 7, "same") for column in rate.T], 1) if increments else None
    growth = np.diff(rate, axis=0, prepend=rate[:1])
    return _RateGrowth(growth, by, smooth)


def _pushed(source: LogTable, vehicle: Vehicle, part: slice) -> Array:
    """(n, up to 6) the commanded wrench about O in the rows in which it stands, zeros in the others."""
    found: Array
    if all(not source.has(name) for name in WRENCH):
        each = [one for one in vehicle.jets if source.has(jet(one.name))]
        if not each:
            return np.zeros((part.stop - part.start, 0))
        on_s = np.stack([source.optional(jet(one.name))[part] for one in each], 1)
        force = np.array([one.force_n for one in each])
        arm = np.array([one.position_m for one in each])
        found = np.nan_to_num(on_s) @ np.hstack([np.cross(arm, force), force])
    else:
        found = np.nan_to_num(np.stack([source.optional(name)[part] for name in WRENCH if source.has(name)], 1))
    return found[:, np.abs(found).max(0) > 0]
