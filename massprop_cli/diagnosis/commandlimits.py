"""Limits of a commanded wrench: those at which commands explain most of the motion, with nothing known of the body.

By what free coefficients leave (:mod:`massprop_cli.diagnosis.freeresponse`) of the rates themselves. Their growth from cycle to cycle has
the noise of two of them, in which a limit that few commands reach does not show.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import MeasuredMotion, cost, line_minimum, summed
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.supposed import States
from massprop_cli.errorparameters.setup import stating

KEY = "thrust.wrench_limits"
PARTS = (1.0, 0.98, 0.96, 0.93, 0.9, 0.86, 0.82, 0.77, 0.7, 0.6, 0.5, 0.4, 0.3, 0.22, 0.16, 0.12, 0.08, 0.05)
"""Of the largest command, at which a component may end: finer where few commands reach so far."""
NEAR, FINE, FINEST = 0.04, 2.5e-3, 1e-5
"""Steps at which the search about the best of these begins, and ends; and ends where a limit explains more than none."""
ROUNDS, STEP = 6, 1e-3
"""Gauss–Newton steps at most; the part of the largest command behind their derivatives."""
SHORTER, STILL = (1.0, 0.5, 0.25, 0.1), 0.1
"""Parts of a step that are tried; by how much −2 log likelihood must fall for another one."""
ALIKE_TO = 3
"""Digits of −2 log likelihood behind the point to which scales are alike."""


class FoundLimits(NamedTuple):
    """Those at which commands explain most."""

    states: States
    further: tuple[States, ...]
    """With each combination that was sought one sigma away."""
    later: float
    """Cycles by which commands act later beside them."""
    cost: float
    """−2 log likelihood, but for a constant."""


class _Explained:
    """The motion that is left under limits, each a part of the component's largest command, where commands act ``later`` by some cycles."""

    def __init__(self, case: Case, motion: MeasuredMotion, later: float) -> None:
        self._case, self._motion, self._later = case, motion, later
        self._first = int(case.timing.delay + max(later, 1.0)) + 2
        """The same cycles whatever the delay."""
        self.commanded = np.flatnonzero(np.abs(case.log.command).max(0)).tolist()
        self.largest = np.abs(case.log.command).max(0)
        # what is not limited in a part of the log is not either in the rest
        self._all = np.maximum(self.largest, np.abs((case.whole or (case.log,))[0].command).max(0))
        self._all[self._all == 0] = 1.0
        self.cost = cache(self._cost)

    def states(self, parts: Array) -> States:
        """As the vehicle file has them."""
        return {KEY: tuple(np.where(parts < 1, parts * self.largest, self._all).tolist())}

    def left(self, values: Array) -> Array:
        """(n, 6) of rates and specific force, of parts (6,) and the delay beyond that of the case."""
        vehicle = stating(self._case.vehicle, self.states(values[:-1]))
        timing = self._case.timing.moved(("delay",), (values[-1],))
        return summed(self._motion, self._case.log, vehicle, timing, self._first)

    def _cost(self, parts: tuple[float, ...]) -> float:
        if min(parts) <= 0 or max(parts) > 1:
            return np.inf
        return round(cost(self.left(np.array([*parts, self._later]))), ALIKE_TO)


def limits(case: Case, motion: MeasuredMotion, later: float | None = None) -> FoundLimits | None:
    """Those that explain most, beside the stated delay or one about so many cycles ``later``; None where it is more without any.

    One part of each one's largest command, as of an allocation that saturates; of a component by itself only where that explains more: of
    commands that are as large whenever there are any a limit is a scale. So of limits that explain as much it is the largest.
    """
    try:
        return _limits(_Explained(case, motion, later or 0.0), later)
    except (InputError, np.linalg.LinAlgError):
        return None  # a log that is too short to tell


def _limits(explained: _Explained, later: float | None) -> FoundLimits | None:
    none, every = np.ones(len(explained.largest)), explained.commanded
    common = parts = _likeliest(explained, none, every, PARTS)
    for begun in (PARTS, ()):  # each beside the others, which may move then
        for i in every:
            parts = _likeliest(explained, parts, [i], (*begun, 1.0, float(parts[i])), float(common[i]))
    own = [[i] for i in every if parts[i] < 1 and parts[i] != common[i]]
    group = [i for i in every if parts[i] < 1 and parts[i] == common[i]]
    units = np.array([np.isin(np.arange(len(parts) + 1), which) for which in (group, *own) if which], float)
    values = np.append(parts, later or 0.0)
    delay = np.eye(len(values))[-1:][: int(later is not None)]
    while len(units):
        values = _sharpened(explained, values, np.vstack([units, delay]))
        left = cost(explained.left(values))
        needed = np.array([cost(explained.left(np.where(unit > 0, 1.0, values))) > left + CLEAR for unit in units])
        if needed.all():
            return FoundLimits(explained.states(values[:-1]), tuple(_further(explained, values, delay)), float(values[-1]), left)
        values = np.where(units[~needed].any(0), 1.0, values)
        units = units[needed]
    return None


def _likeliest(explained: _Explained, parts: Array, which: Sequence[int], begun: Sequence[float], common: float = 1.0) -> Array:
    """With the part of these that explains clearly more than none, or than the ``common`` one that they have."""

    def by(part: float) -> float:
        return explained.cost(tuple(_with(parts, which, part).tolist()))

    now = float(parts[which[0]])
    kept = now if now == common and by(now) < by(1.0) else 1.0
    best = line_minimum(by, begun, NEAR, FINE)
    return _with(parts, which, kept if by(best) > by(kept) - CLEAR else line_minimum(by, [best], FINE, FINEST))


def _sharpened(explained: _Explained, values: Array, units: Array) -> Array:
    """The values with combinations of ``units`` (d, 7) moved to the greatest likelihood."""
    for _ in range(ROUNDS):
        now, slopes = _slopes(explained, values, units)
        step = -np.linalg.solve(slopes.T @ slopes + np.eye(len(units)), slopes.T @ now) @ units
        tried = [_bounded(values + shorter * step) for shorter in SHORTER]
        best = min(tried, key=lambda at: cost(explained.left(at)))
        if cost(explained.left(best)) > cost(explained.left(values)) - STILL:
            break
        values = best
    return values


def _further(explained: _Explained, values: Array, delay: Array) -> Iterator[States]:
    """With each combination of limits, each by itself, one sigma away: that they are one part is but supposed."""
    units = np.eye(len(values))[np.flatnonzero(values[:-1] < 1)]
    _, slopes = _slopes(explained, values, np.vstack([units, delay]))
    covariance = np.linalg.inv(slopes.T @ slopes + np.eye(slopes.shape[1]))[: len(units), : len(units)]
    variance, directions = np.linalg.eigh(covariance)
    for step in np.sqrt(variance)[:, None] * directions.T @ units:
        yield explained.states(_room(values, step)[:-1])


def _slopes(explained: _Explained, values: Array, units: Array) -> tuple[Array, Array]:
    """(n,) what is left, over its noise, and (n, d) its derivatives along ``units`` (d, 7).

    Towards larger limits: below what most commands are a limit is a scale, which explains as much.
    """
    now = explained.left(values)
    white = 1 / np.sqrt((now**2).mean(0) + TINY)
    steps = [STEP if (values + STEP * unit)[:-1].max() <= 1 else -STEP for unit in units]
    moved = [(explained.left(values + step * unit) - now) * white / step for step, unit in zip(steps, units, strict=True)]
    return (now * white).ravel(), np.stack([one.ravel() for one in moved], 1)


def _bounded(values: Array) -> Array:
    """With no limit beyond the largest command."""
    return np.append(np.clip(values[:-1], STEP, 1.0), values[-1])


def _room(values: Array, step: Array) -> Array:
    """A step further on, the way on which limits stay below the largest command."""
    ways = (values + step, values - step)
    return _bounded(min(ways, key=lambda one: float(one[:-1].max())))


def _with(parts: Array, which: Sequence[int], part: float) -> Array:
    found = parts.copy()
    found[list(which)] = part
    return found
