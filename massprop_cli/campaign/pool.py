"""What many logs of one vehicle say together: weighted mean, scatter against the claimed sigmas, outliers, trend.

Every log i gives a value x_i with sigma s_i. Of it, c_i is an error that all logs of the vehicle share (the thrust scale, a weighed
mass): it moves all x_i alike, so that averaging doesn't make it smaller, and scatter doesn't show it. The rest,
u_i² = s_i² − c_i², is the log's own. A part g_i of that may be the same in other logs, too, as far as these move alike (where jets and IMU
sit): the mean's sigma takes it for shared, scatter for the log's own, and so neither promises too much.
With weights w_i = 1/u_i² and W = Σ w_i:

* mean x̄ = Σ w_i x_i / W, with sigma² = Σ w_i² (u_i² − g_i²) / W² + (Σ w_i c_i / W)² + (Σ w_i g_i / W)²: own errors independent, shared
  ones fully correlated (P. R. Bevington and D. K. Robinson, Data Reduction and Error Analysis, 3rd ed., eq. 4.17 and 4.19;
  JCGM 100:2008, F.1.2.3, note 3);
* scatter χ² = Σ w_i (x_i − x̄)², n − 1 degrees of freedom where the claimed sigmas hold (Bevington, chapter 11.1), and
  sqrt(χ²/(n − 1)), the ratio of R. T. Birge, Phys. Rev. 40 (1932) 207;
* outlier: further than 4 sigma from the mean of all others, z_i = (x_i − x̄_without_i) / sqrt(u_i² + 1/(W − w_i)), the farthest first
  and then again without it, so that one stray log doesn't make outliers of good ones; never more than half of the logs;
* trend: slope b of x = a + b k over the log's number k, weighted least squares: b = Σ w_i (k_i − k̄) x_i / S,
  sigma_b = 1/sqrt(S), S = Σ w_i (k_i − k̄)² (Bevington, eq. 6.12 and 6.23). Shared errors don't tilt it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.arrays import Array
from massprop_cli.base.chance import chance
from massprop_cli.base.dataclass import dataclass

OUTLYING = 4.0
"""Sigmas beyond which a log is an outlier."""
_LEAST_OWN = 1e-3
"""Of its sigma, a log's own error is at least this: what is left of a difference of nearly equal numbers bears no more."""


@dataclass(frozen=True)
class LogValues:
    """One quantity of one vehicle, log by log; SI."""

    number: Array
    """(n,) each log's number in the campaign."""
    value: Array
    """(n,)"""
    sigma: Array
    """(n,) one standard deviation, everything included."""
    shared: Array
    """(n,) of it, what all logs have in common."""
    alike: Array
    """(n,) of the rest, what they may have in common."""

    @property
    def own(self) -> Array:
        """(n,) the sigma that belongs to the log alone."""
        return np.asarray(np.sqrt(np.maximum(self.sigma**2 - self.shared**2, (_LEAST_OWN * self.sigma) ** 2)))

    def only(self, keep: NDArray[np.intp]) -> LogValues:
        """The logs at these indices."""
        return LogValues(self.number[keep], self.value[keep], self.sigma[keep], self.shared[keep], self.alike[keep])


@dataclass(frozen=True)
class Mean:
    """The weighted mean with one standard deviation; ``shared`` is the part of it that more logs don't make smaller."""

    value: float
    sigma: float
    shared: float


@dataclass(frozen=True)
class Scatter:
    """How far logs lie apart, against what they claim."""

    chi_square: float
    degrees_of_freedom: int
    p_value: float
    """The chance of as much scatter or more if the claimed sigmas hold."""
    ratio: float
    """sqrt(χ² per degree of freedom): 1 is expected; above it sigmas are too small, or the vehicle changed."""


@dataclass(frozen=True)
class Trend:
    """Change from one log to the next, with one standard deviation."""

    per_log: float
    sigma: float


def mean(samples: LogValues) -> Mean:
    """The inverse-variance weighted mean."""
    weight = samples.own**-2.0
    total = weight.sum()
    shared = float(np.hypot(weight @ samples.shared, weight @ samples.alike) / total)
    apart = float(weight**2 @ np.maximum(samples.own**2 - samples.alike**2, 0.0)) / total**2
    return Mean(float(weight @ samples.value / total), float(np.sqrt(apart + shared**2)), shared)


def scatter(samples: LogValues) -> Scatter | None:
    """χ² about the weighted mean; None for fewer than two logs."""
    free = len(samples.value) - 1
    if free < 1:
        return None
    chi_square = float((((samples.value - mean(samples).value) / samples.own) ** 2).sum())
    return Scatter(chi_square, free, chance(chi_square, free), float(np.sqrt(chi_square / free)))


def outliers(samples: LogValues) -> dict[int, float]:
    """Index and distance in sigmas of each outlier, the farthest first; needs three logs."""
    found: dict[int, float] = {}
    left = np.arange(len(samples.value))
    while len(left) >= 3 and len(found) < len(samples.value) // 2:
        z = _from_the_others(samples.only(left))
        worst = int(np.argmax(np.abs(z)))
        if not abs(z[worst]) > OUTLYING:
            break
        found[int(left[worst])] = float(z[worst])
        left = np.delete(left, worst)
    return found


def _from_the_others(samples: LogValues) -> Array:
    """(n,) distance of each log from the mean of all others, in sigmas of that distance."""
    weight, value = samples.own**-2.0, samples.value - np.median(samples.value)
    # sums without one log, from both sides: a difference of the whole and its largest part would leave nothing of the rest
    others, sums = _without_each(weight), _without_each(weight * value)
    return np.asarray((value - sums / others) / np.sqrt(1 / weight + 1 / others))


def _without_each(terms: Array) -> Array:
    """(n,) the sum of all terms but each."""
    before = np.concatenate([[0.0], np.cumsum(terms)[:-1]])
    after = np.concatenate([np.cumsum(terms[::-1])[::-1][1:], [0.0]])
    return np.asarray(before + after)


def trend(samples: LogValues) -> Trend | None:
    """Slope over the logs' numbers; None for fewer than three logs."""
    if len(samples.value) < 3:
        return None
    weight = samples.own**-2.0
    offset = samples.number - weight @ samples.number / weight.sum()
    spread = float(weight @ offset**2)
    return Trend(float(weight @ (offset * (samples.value - mean(samples).value)) / spread), float(spread**-0.5))
