"""Limits of a commanded wrench by maximum likelihood of the free response.

Residuals are those of the rates themselves. Their growth has the noise of two rates, which hides a limit that few commands reach.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import CLEAR, ITERATIONS
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import (
    BoundedFit,
    MeasuredMotion,
    bounded_fit,
    cost,
    line_minimum,
    one_sigma_further,
    summed_residuals,
)
from massprop_cli.diagnosis.keyhypothesis import KeyValues
from massprop_cli.errorparameters.setup import stating

KEY = "thrust.wrench_limits"
PARTS = (1.0, 0.98, 0.96, 0.93, 0.9, 0.86, 0.82, 0.77, 0.7, 0.6, 0.5, 0.4, 0.3, 0.22, 0.16, 0.12, 0.08, 0.05)
"""Limits that are searched, over the largest command."""
NEAR, FINE, FINEST = 0.04, 2.5e-3, 1e-5
"""Steps of the search about the best of these: first and last; last once a limit explains more than none."""
LOWER, UPPER = np.append(np.full(6, 1e-3), -np.inf), np.append(np.ones(6), np.inf)
"""(7,) bounds of the limits over the largest commands, and of the change of the delay, cycles."""
ALIKE_TO = 3
"""Decimals of −2 log likelihood at which equal scales agree."""


class FoundLimits(NamedTuple):
    """Limits of least cost."""

    key_values: KeyValues
    sigma_key_values: tuple[KeyValues, ...]
    """Key values with each estimated combination one sigma further."""
    delay_change: float
    """Change of the delay, cycles."""
    cost: float
    """−2 log likelihood up to a constant."""


class _LimitSearch:
    """Residuals of the motion under limits, each over the component's largest command, with a delay changed by ``later`` cycles."""

    def __init__(self, case: Case, motion: MeasuredMotion, later: float) -> None:
        self._case, self._motion, self._later = case, motion, later
        self._first = int(case.timing.delay + max(later, 1.0)) + 2
        """First cycle, the same for every delay."""
        self.commanded = np.flatnonzero(np.abs(case.log.command).max(0)).tolist()
        self.largest = np.abs(case.log.command).max(0)
        # a component that is not limited in a part of the log is not limited in the rest
        self._all = np.maximum(self.largest, np.abs((case.whole or (case.log,))[0].command).max(0))
        self._all[self._all == 0] = 1.0
        self.cost = cache(self._cost)

    def key_values(self, parts: Array) -> KeyValues:
        """Key values of the vehicle file."""
        return {KEY: tuple(np.where(parts < 1, parts * self.largest, self._all).tolist())}

    def residuals(self, values: Array) -> Array:
        """(n, 6) residuals of rates and specific force, for limits (6,) and the change of the delay."""
        vehicle = stating(self._case.vehicle, self.key_values(values[:-1]))
        timing = self._case.timing.moved(("delay",), (values[-1],))
        return summed_residuals(self._motion, self._case.log, vehicle, timing, self._first)

    def _cost(self, parts: tuple[float, ...]) -> float:
        if min(parts) <= 0 or max(parts) > 1:
            return np.inf
        return round(cost(self.residuals(np.array([*parts, self._later]))), ALIKE_TO)


def limits(case: Case, motion: MeasuredMotion, later: float | None = None) -> FoundLimits | None:
    """Limits of least cost with the stated delay, or with one near ``later``; None if no limits explain as much.

    They are one part of each component's largest command, as of a saturated allocation, or of single components if that explains more. If
    all commands have one size, a limit acts as a scale; so of equal costs the largest limit is used.
    """
    try:
        return _limits(_LimitSearch(case, motion, later or 0.0), later)
    except (InputError, np.linalg.LinAlgError):
        return None  # the log is too short


def _limits(explained: _LimitSearch, later: float | None) -> FoundLimits | None:
    components = explained.commanded
    common = parts = _best_part(explained, np.ones(6), components, PARTS)
    for starts in (PARTS, ()):  # each with the others, which may change then
        for i in components:
            parts = _best_part(explained, parts, [i], (*starts, 1.0, float(parts[i])), float(common[i]))
    single = [[i] for i in components if parts[i] < 1 and parts[i] != common[i]]
    shared = [i for i in components if parts[i] < 1 and parts[i] == common[i]]
    groups, delay = [which for which in (shared, *single) if which], [[len(parts)]] * (later is not None)
    values = np.append(parts, later or 0.0)
    while groups:
        values, found = _fitted(explained, values, [*groups, *delay])
        unlimited = [_with(values, group, 1.0) for group in groups]
        needed = [cost(explained.residuals(without)) > found.cost + CLEAR for without in unlimited]
        if all(needed):
            return FoundLimits(explained.key_values(values[:-1]), tuple(_further(explained, values, delay)), float(values[-1]), found.cost)
        values = _with(values, [i for group, kept in zip(groups, needed, strict=True) for i in group if not kept], 1.0)
        groups = [group for group, kept in zip(groups, needed, strict=True) if kept]
    return None


def _best_part(explained: _LimitSearch, parts: Array, which: Sequence[int], starts: Sequence[float], common: float = 1.0) -> Array:
    """Limits with a new part for components ``which``, if that explains clearly more than none, or than the ``common`` part."""

    def cost_of(part: float) -> float:
        return explained.cost(tuple(_with(parts, which, part).tolist()))

    now = float(parts[which[0]])
    kept = now if now == common and cost_of(now) < cost_of(1.0) else 1.0
    best = line_minimum(cost_of, starts, NEAR, FINE)
    return _with(parts, which, kept if cost_of(best) > cost_of(kept) - CLEAR else line_minimum(cost_of, [best], FINE, FINEST))


def _fitted(explained: _LimitSearch, values: Array, groups: Sequence[Sequence[int]], most: int = ITERATIONS) -> tuple[Array, BoundedFit]:
    """Values (7,) of least cost with one value for each of ``groups``, the others fixed, and the fit of these."""

    def every(at: Array) -> Array:
        changed = values
        for group, value in zip(groups, at, strict=True):
            changed = _with(changed, group, float(value))
        return changed

    first = [group[0] for group in groups]
    found = bounded_fit(lambda at: explained.residuals(every(at)), values[first], LOWER[first], UPPER[first], most)
    return every(found.values), found


def _further(explained: _LimitSearch, values: Array, delay: Sequence[Sequence[int]]) -> Iterator[KeyValues]:
    """Key values with each combination of separate limits one sigma further, since a common part is an assumption."""
    limited = np.flatnonzero(values[:-1] < 1)
    _, found = _fitted(explained, values, [*([i] for i in limited.tolist()), *delay], most=1)
    covariance = found.covariance[: len(limited), : len(limited)]
    for parts in one_sigma_further(values[limited], covariance, LOWER[limited], UPPER[limited]):
        further = values[:-1].copy()
        further[limited] = parts
        yield explained.key_values(further)


def _with(parts: Array, which: Sequence[int], part: float) -> Array:
    changed = parts.copy()
    changed[list(which)] = part
    return changed
