"""Test of a log's time stamps: if they are uneven, whether the clock or the records are.

The stamps are compared with an even clock, ``t_k = t_0 + k p + e_k``. If their resolution explains all e_k, the clock is even. Otherwise
the increments decide: an increment over a stamped interval d_k is rate times d_k, one over an even interval is rate times p. In the
regression

    θ_k / p − θ_(k−1) / p = f(commands, rates) + β (ω_k δ_k − ω_(k−1) δ_(k−1)) / p,        δ_k = d_k − p,

β is 1 for records as long as stamped, and 0 if only the stamps scatter. f is linear in the commanded wrench of this cycle and earlier ones,
whose coefficients are nuisance parameters, and in products of the rates. If a clock steps back, or forward by more than a record, the same
regression tests whether the motion continues as without missing records. An undecided step stays, and the log is refused.
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
"""Largest deviation from an even clock, in intervals, for which stamps are not tested."""
FAR = 0.1
"""Largest deviation of intervals, in usual intervals, for which stamps are kept if the increments do not decide."""
MIN_STEP = 0.75
"""Minimum step of a clock, in records."""
ROBUST = 1.4826
"""Ratio of standard deviation to median absolute deviation of a normal distribution."""
SPANS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 24, 48)
"""Numbers of records over which the usual interval is estimated; packets of such sizes are evenly spaced."""
MOSTLY = 0.85
"""Fraction of these intervals that determine their scatter."""
LEAST = 24
"""Minimum number of records."""
FEW = 1.4
"""Maximum ratio of intervals to records for missing records; packets give larger ratios."""
WINDOW = 12
"""Minimum number of records on each side of a step whose earliest stamps are compared."""
WIDEST = 400
"""Maximum number of such records; also used for the scatter if one side has fewer than ``WINDOW``."""
MOST = 50
"""Maximum number of steps in a log."""
ROWS = 4000
"""Number of records on each side of a place in the regression."""
CYCLES = 5
"""Number of control cycles for which a command may act."""
SURE = 4.0
"""Minimum distance of β from the mean of both hypotheses, in sigmas."""
SIGMAS, FURTHEST = 5.0, 5e-3
"""Largest deviation of an interval from an equal part of a control cycle: in sigmas, and as a fraction."""
TOGETHER, MANY = 0.3, 0.3
"""Interval over the usual interval below which records come in packets, and minimum fraction of such records."""
EARLY, ONE_SIDED = 0.02, 0.5
"""Fraction of the stamps that are on time; and ratio of earliness to lateness, both from the median, below which stamps are only late."""
TWICE, STILL = 0.01, 1e-6
"""Maximum fraction of repeated stamps for repeated records; largest interval of repeated stamps, in usual intervals."""


class Stamps(NamedTuple):
    """Result of the test."""

    time_s: Array
    """(n,) end of each record, s."""
    moved_s: Array | None = None
    """(n,) correction subtracted from the clock at each record, s; None without steps."""
    message: str = ""
    """Finding and correction; empty if the stamps are as recorded."""
    remedy: str = ""
    """Remedy for an undecided step."""


class _ClockStep(NamedTuple):
    row: int
    by_s: float
    wraps: bool


class _RateGrowth(NamedTuple):
    """Regression of the growth of the rates."""

    growth: Array
    """(n, axes) change of the mean rate from the previous record, rad/s."""
    by: Array
    """(n, m) regressors."""
    rate: Array | None
    """(n, axes) smoothed rate, rad/s; None if records hold rates, which do not depend on stamps."""


def examined(source: LogTable, vehicle: Vehicle, time_s: Array) -> Stamps:
    """Times of the records, corrected if only the stamps (n,), s, are uneven. Raises :class:`InputError` for an invalid time."""
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
    clock_steps = _clock_steps(time_s, usual_s, span)
    if clock_steps is None:
        return Stamps(time_s)
    moved, lost, parts, remedy = np.zeros(len(time_s)), np.zeros(len(time_s)), [], ""
    for clock_step in clock_steps:
        records = clock_step.by_s / usual_s
        missing = round(records) if abs(records - round(records)) < WHOLE else 0
        whole = 1 <= missing <= MISSING * max(round(vehicle.cycle.period_s / usual_s), 1)
        # a wrong number of lost records changes little here, and the motion is not tested
        continues = clock_step.wraps or (not whole and _continues(source, vehicle, clock_step, usual_s))
        if continues:
            moved[clock_step.row :] += clock_step.by_s
            verb = "wraps" if clock_step.wraps else "was set"
            parts.append(f"the clock {verb} at {source.place(clock_step.row)}, by {clock_step.by_s:.9g} s")
        elif whole or 0 < records <= GAP - 1:
            lost[clock_step.row :] += missing if whole else records
        else:
            remedy = ", or if no record is missing there state imu.clock_even = true"
    if remedy:
        return Stamps(time_s, None, "", remedy)
    own = [clock_step.row for clock_step in clock_steps]
    even, why = _even(source, vehicle, time_s - moved, usual_s, lost, own)
    if not why and not parts:
        return Stamps(time_s)
    found = even if why else time_s - moved
    every = f"records are assumed to come every {median(np.diff(even)):.6g} s" if why else "all records are put on one clock"
    message = (
        f"{'; '.join([*parts, *([why] if why else [])])}. Now {every}; stamp records with the IMU's clock, or state imu.clock_even = true "
        "(false: use the stamps as they are)"
    )
    return Stamps(found, moved if parts else None, message)


def _usual(time_s: Array) -> tuple[float, int]:
    """Usual interval, s, and number of records over which it is most even, without steps, packets and scatter.

    If all intervals are whole multiples of the median and few are longer, records are missing, and the median is the usual interval.
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
        scatter = float(np.quantile(np.abs(mean - middle), MOSTLY))  # rounded stamps give mostly equal intervals
        if scatter * lag**0.5 < best:
            near = np.abs(mean - middle) <= max(3 * scatter, 1e-9 * abs(middle))
            best, found, span = scatter * lag**0.5, float(mean[near].mean()), lag
    return found, span


def _clock_steps(time_s: Array, usual_s: float, span: int) -> list[_ClockStep] | None:
    """Steps of the clock that persist; None if stamps go back and return, or step too often."""
    steps = np.diff(time_s)
    late = time_s - usual_s * np.arange(len(time_s))
    found = []
    for row in (np.flatnonzero((steps < 0) | (steps > LONG * usual_s)) + 1).tolist():
        step = float(steps[row - 1])
        width = min(max(WINDOW, int(3 * abs(step) / usual_s)), WIDEST)
        width = span * -(-width // span)
        # late stamps do not affect the earliest
        before, after = late[max(row - width, 0) : row], late[row : row + width]
        by_s, scatter_s = float(after.min() - before.min()), 0.0
        if min(len(before), len(after)) < WINDOW:  # few records may all be late
            scatter_s = float(np.ptp(late[max(row - WIDEST, 0) : row] if len(after) < WINDOW else late[row : row + WIDEST]))
        if abs(by_s) < max(MIN_STEP * usual_s, scatter_s):
            if step < 0:
                return None
            continue
        wrapped = next((length for length in WRAPS if abs(step + length - usual_s) < 0.5 * usual_s and length > 10 * usual_s), None)
        found.append(_ClockStep(row, -wrapped if wrapped else by_s, wrapped is not None))
        late[row:] -= found[-1].by_s
        if len(found) > MOST:
            return None
    return found


def _even(source: LogTable, vehicle: Vehicle, time_s: Array, usual_s: float, lost: Array, clock_steps: Sequence[int]) -> tuple[Array, str]:
    """Times on an even clock, and the reason; the reason is empty if the stamps are kept."""
    number = np.arange(len(time_s)) + lost
    tick, line = _resolution(time_s), np.polyval(np.polyfit(number, time_s, 1), number)
    if EXACT * usual_s < np.abs(time_s - line).max() <= 0.75 * tick:
        return line, f"the stamps are rounded to {tick:.3g} s"
    even = _on_even_clock(time_s, number, vehicle.cycle.period_s)
    away, usual_s = time_s - even, median(np.diff(even))
    off = np.diff(time_s, prepend=time_s[0] - usual_s) - usual_s
    off[[0, *clock_steps]] = 0.0
    if np.abs(off).max() <= EXACT * usual_s:
        return time_s, ""
    slope = _slope(source, vehicle, off, usual_s, clock_steps)
    # if the increments cannot decide: the effect is negligible; or the records have different lengths, because errors of stamps would
    # cancel in the next interval
    if (np.abs(off).max() <= FAR * usual_s or np.std(away) > 1.5 * np.std(off)) if slope is None else slope[0] > 0.5:
        return time_s, ""
    steps, bursts = off + usual_s, float(np.mean(off < (TOGETHER - 1) * usual_s)) > MANY
    few = float(np.mean(np.abs(off) > FAR * usual_s)) < 0.1
    away = time_s - even
    early, middle, late = np.quantile(away, (EARLY, 0.5, 1 - EARLY))
    if bursts or middle - early < ONE_SIDED * (late - middle):
        even = even + early  # a record is late at most, so the earliest ones are on time
    what = "come in bursts" if bursts else "step" if few else "scatter"
    why = f"the stamps {what} (intervals of {steps[1:].min():.3g} to {steps[1:].max():.3g} s)"
    if slope is not None:
        why += f" and the increments do not follow them (slope {slope[0]:.2g} ± {slope[1]:.2g}, expected 1)"
    return even, why


def _on_even_clock(time_s: Array, number: Array, period_s: float) -> Array:
    """(n,) times of records that are ``number`` (n,) intervals from the first, on a line through the median of their stamps.

    The interval is an equal part of the control cycle if the stamps allow it, else fitted.
    """
    slope = float(np.polyfit(number, time_s, 1)[0])
    # error of the slope if stamps are a random walk; it is smaller if they scatter about even times
    error = float(np.std(np.diff(time_s) - slope * np.diff(number))) * len(time_s) ** -0.5
    nominal = period_s / max(round(period_s / slope), 1)
    every = number * (nominal if abs(nominal - slope) < min(SIGMAS * error + EXACT * nominal, FURTHEST * nominal) else slope)
    return np.asarray(median(time_s - every) + every)


def _resolution(time_s: Array) -> float:
    """Resolution of the stamps, s: of float32 or of decimals; 0 if unknown."""
    top = np.abs(time_s[[0, -1]]).max()
    if (time_s.astype(np.float32) == time_s).all():
        return float(np.spacing(np.float32(top)))
    for power in range(7):
        counts = time_s * 10.0**power
        if np.abs(counts - np.round(counts)).max() < 1e-3:
            return float(10.0**-power)
    return 0.0


def _slope(source: LogTable, vehicle: Vehicle, off_s: Array, usual_s: float, clock_steps: Sequence[int]) -> tuple[float, float] | None:
    """β and its sigma; None if the motion does not decide."""
    place = int(np.argmax(np.abs(off_s)))
    part = slice(max(place - ROWS, 0), min(place + ROWS, len(off_s)))
    motion = _motion(source, vehicle, usual_s, part)
    if motion is None or motion.rate is None:
        return None
    share = (off_s[part] / usual_s)[:, None] * motion.rate
    uneven = np.diff(share, axis=0, prepend=share[:1])
    used = np.ones(len(share), dtype=bool)
    used[[0, *(row - part.start for row in clock_steps if part.start <= row < part.stop)]] = False
    known = motion.by[used]
    residual = (one - known @ np.linalg.lstsq(known, one, rcond=1e-9)[0] for one in (motion.growth[used], uneven[used]))
    growth, by = (one.ravel() for one in residual)
    size = float(by @ by)
    if size == 0:
        return None
    beta = float(by @ growth) / size
    sigma = float(np.sqrt(((by * (growth - beta * by)) ** 2).sum())) / size
    return (beta, sigma) if abs(beta - 0.5) > SURE * sigma else None


def _continues(source: LogTable, vehicle: Vehicle, clock_step: _ClockStep, usual_s: float) -> bool:
    """Whether the motion continues across a step as across any other record, where missing records would probably change it."""
    rows = source.table.rows
    part = slice(max(clock_step.row - ROWS, 0), min(clock_step.row + ROWS, rows))
    motion, at = _motion(source, vehicle, usual_s, part), clock_step.row - part.start
    if motion is None:
        return False
    used = np.ones(len(motion.by), dtype=bool)
    used[[0, at]] = False
    solved = np.linalg.lstsq(motion.by[used], motion.growth[used], rcond=1e-9)[0]
    residual = motion.growth - motion.by @ solved
    scale = ROBUST * np.array([median(np.abs(column)) for column in residual[used].T])
    scale = np.maximum(scale, 1e-12)
    far = ((residual / scale) ** 2).sum(1)
    usual = float(np.quantile(far[used], 0.99))
    if far[at] > usual:
        return False
    # fraction of other records that would continue the motion equally well
    level = np.cumsum(motion.growth, 0)
    level[at:] -= motion.growth[at]
    away = level - level[at - 1] - motion.by[at] @ solved
    apart = np.abs(np.arange(len(away)) - at) > WINDOW
    return bool(np.mean(((away[apart] / scale) ** 2).sum(1) <= usual) < 0.02)


def _motion(source: LogTable, vehicle: Vehicle, usual_s: float, part: slice) -> _RateGrowth | None:
    """Growth of the rates and its regressors; None without three rates, or with too few records."""
    increments = all(source.has(name) for name in DELTA_THETA)
    names = DELTA_THETA if increments else GYRO
    if not all(source.has(name) for name in names):
        return None
    rate = np.stack([source.optional(name)[part] for name in names], 1) / (usual_s if increments else 1.0)
    wrench = _wrench(source, vehicle, part)
    if not np.isfinite(rate).all():
        return None
    lags = 1 + CYCLES * max(round(vehicle.cycle.period_s / usual_s), 1)
    products = np.stack([rate[:, i] * rate[:, j] for i in range(3) for j in range(i + 1)], 1)
    before = [np.vstack([np.zeros((lag, wrench.shape[1])), wrench[: len(wrench) - lag]]) for lag in range(lags)]
    by = np.hstack([*before, products, np.roll(products, 1, 0), np.ones((len(rate), 1))])
    if vehicle.environment.kind != "free" and all(source.has(name) for name in DELTA_V):
        # specific force gives the vertical in IMU axes; gravity torque depends on it
        felt = np.stack([source.optional(name)[part] for name in DELTA_V], 1) / usual_s
        by = np.hstack([by, felt]) if np.isfinite(felt).all() else by
    size = np.sqrt((by**2).mean(0))
    by = by[:, size > 0] / size[size > 0]
    if 3 * by.shape[1] > len(by):
        return None
    smooth = np.stack([np.convolve(column, np.ones(7) / 7, "same") for column in rate.T], 1) if increments else None
    growth = np.diff(rate, axis=0, prepend=rate[:1])
    return _RateGrowth(growth, by, smooth)


def _wrench(source: LogTable, vehicle: Vehicle, part: slice) -> Array:
    """(n, up to 6) commanded wrench about O in rows with a command, 0 in others; only components that act."""
    found: Array
    if all(not source.has(name) for name in WRENCH):
        each = [number for number, one in enumerate(vehicle.jets) if source.has(jet(one.name))]
        if not each:
            return np.zeros((part.stop - part.start, 0))
        on_s = np.stack([source.optional(jet(vehicle.jets[number].name))[part] for number in each], 1)
        found = np.nan_to_num(on_s) @ vehicle.jet_wrench[each]
    else:
        found = np.nan_to_num(np.stack([source.optional(name)[part] for name in WRENCH if source.has(name)], 1))
    return found[:, np.abs(found).max(0) > 0]
