"""Statistics of many logs of one vehicle: weighted mean, scatter relative to the claimed sigmas, outliers, trend.

Log i gives a value x_i with sigma s_i. A part c_i of s_i is an error common to all logs of the vehicle (thrust scale, weighed mass):
averaging does not reduce it, and the scatter does not show it. The unshared part is u_i, u_i² = s_i² − c_i². A part g_i of u_i, from errors
of the vehicle file such as jet positions, may be common to logs with similar motions. The sigma of the mean treats g_i as common, and the
scatter treats it as independent; both are conservative. With weights w_i = 1/u_i² and W = Σ w_i:

* mean x̄ = Σ w_i x_i / W, with sigma² = Σ w_i² (u_i² − g_i²) / W² + (Σ w_i c_i / W)² + (Σ w_i g_i / W)²: unshared errors are independent,
  shared ones fully correlated (P. R. Bevington and D. K. Robinson, Data Reduction and Error Analysis, 3rd ed., eq. 4.17 and 4.19;
  JCGM 100:2008, F.1.2.3, note 3);
* scatter χ² = Σ w_i (x_i − x̄)², with n − 1 degrees of freedom if the claimed sigmas are right (Bevington, chapter 11.1), and
  sqrt(χ²/(n − 1)), the ratio of R. T. Birge, Phys. Rev. 40 (1932) 207;
* outliers: logs farther than 4 sigma from the mean of all others, z_i = (x_i − x̄_without_i) / sqrt(u_i² + 1/(W − w_i)). The search removes
  the farthest and repeats, because one outlier can make others appear so. It removes at most half of the logs;
* trend: slope b of x = a + b k over the log's number k by weighted least squares: b = Σ w_i (k_i − k̄) x_i / S,
  sigma_b = 1/sqrt(S), S = Σ w_i (k_i − k̄)² (Bevington, eq. 6.12 and 6.23). Shared errors do not affect it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from massprop_cli import ALL_UNITS
from massprop_cli.base.arrays import Array
from massprop_cli.base.chance import chance
from massprop_cli.base.dataclass import dataclass
from massprop_cli.campaign.outcome import CampaignRow, OutcomePart, Value
from massprop_cli.combine import twice
from massprop_cli.inputs.equipment import EnvironmentKind
from massprop_cli.result.judge import INFORMED, apart, together

OUTLYING = 4.0
"""Distance from the mean of the others, sigmas, beyond which a log is an outlier."""
_LEAST_UNSHARED = 1e-3
"""Smallest ratio of unshared to total sigma; below it, rounding errors determine the difference of squares."""


class Outlier(OutcomePart):
    """A log further than 4 sigma from the mean of the others."""

    log: str
    value: float
    sigmas: float = Field(description="from the mean of the others without outliers found before")


class Pooled(OutcomePart):
    """One quantity over all logs that told it, SI."""

    unit: str
    logs: int
    value: float | None = Field(description="inverse-variance weighted mean of all logs, outliers included")
    sigma: float | None
    shared: float | None = Field(None, description="of sigma, what all logs have in common, or may have, and more logs don't make smaller")
    without_outliers: tuple[float, float] | None = Field(None, description="mean and sigma; null where there is no outlier")
    chi_square: float | None = Field(None, description="scatter against the logs' own sigmas")
    degrees_of_freedom: int | None = None
    p_value: float | None = Field(None, description="chance of as much scatter or more if the sigmas hold")
    scatter_ratio: float | None = Field(None, description="sqrt of chi-square per degree of freedom; 1 is expected")
    trend_per_log: float | None = None
    trend_sigma: float | None = None
    outliers: list[Outlier] = Field([])


class Pool(OutcomePart):
    """Ten quantities of one vehicle, in one phase or as docked object, on a pivot nine more; two logs at least tell one of them."""

    vehicle: str
    environment: EnvironmentKind
    bearing_mass_kg: float
    vehicle_files: int = Field(description="how many different vehicle files its logs have")
    part: Literal["phase", "docked"]
    name: str
    estimates: dict[str, Pooled]
    about_pivot: dict[str, Pooled] = Field({}, description="inertia and first moment about the pivot; empty where no log tells them")

    @property
    def items(self) -> dict[str, Pooled]:
        """All quantities; the names of those about the pivot have a prefix."""
        return together(self.estimates, self.about_pivot)


def pooled(rows: Iterable[CampaignRow]) -> list[Pool]:
    """Pools by vehicle and part, in the order of their first logs; each has at least two logs."""
    return pools_of(grouped(rows))


def pools_of(groups: Mapping[Key, Group]) -> list[Pool]:
    """The pool of each group in which at least two logs have a value of one quantity."""
    pools = [_pool(key, group) for key, group in groups.items() if len(group.numbers) > 1]
    return [pool for pool in pools if any(quantity.logs > 1 for quantity in pool.items.values())]


@dataclass(frozen=True)
class Group:
    """Logs that are pooled, with the data of one phase or docked object."""

    numbers: list[int] = field(default_factory=list)
    """Numbers of the logs in the campaign, from 1."""
    names: list[str] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    """(19, 4) per log, in the order of ALL_UNITS: value, sigma, shared sigma, possibly shared sigma, SI; NaN without an estimate."""
    files: set[str] = field(default_factory=set)
    """Digests of the vehicle files."""
    expected: tuple[set[float], ...] = field(default_factory=lambda: tuple(set() for _ in ALL_UNITS))
    """The different expected values of each quantity, SI."""

    copies: dict[str, str] = field(default_factory=dict)
    """Names of omitted logs, with the name of the earlier log that has the same recording."""

    def without_copies(self) -> Group:
        """The group without logs whose recording an earlier log has in another file."""
        copies = _copies(self.values)
        kept = [n for n in range(len(self.numbers)) if n not in copies]
        return replace(
            self,
            numbers=[self.numbers[n] for n in kept],
            names=[self.names[n] for n in kept],
            values=[self.values[n] for n in kept],
            copies=self.copies | {self.names[later]: self.names[first] for later, first in copies.items()},
        )


def grouped(rows: Iterable[CampaignRow]) -> dict[Key, Group]:
    """Groups of logs by vehicle and part.

    A recording counts once, whatever its file formats. Logs of the thesis's method do not count, since they have no sigmas.
    """
    groups: dict[Key, Group] = {}
    first_names: dict[str | None, str] = {}
    for number, row in enumerate(rows, 1):
        outcome = row.outcome
        if outcome is None or outcome.vehicle is None or outcome.method == "thesis":
            continue
        stated, first = outcome.vehicle, first_names.setdefault(outcome.input_sha256, row.name)
        for body in outcome.bodies:
            group = groups.setdefault(Key(stated.name, stated.environment, stated.bearing_mass_kg, body.part, body.name), Group())
            if first != row.name:
                group.copies[row.name] = first
                continue
            group.numbers.append(number)
            group.names.append(row.name)
            group.files.add(stated.sha256)
            items = [*map(body.items.get, ALL_UNITS)]
            group.values.append(np.array([_numbers(item) for item in items]))
            for expected, item in zip(group.expected, items, strict=True):
                expected |= {item.expected} if item and item.expected is not None else set()
    return {key: group.without_copies() for key, group in groups.items()}


def _copies(values: Sequence[Array]) -> dict[int, int]:
    """Indices of logs, (19, 4) each, whose recording an earlier log has in another file, with the index of the first one."""
    if not values:
        return {}
    stacked = np.array(values)
    # sort by the quantity with most values: only neighbours can be copies
    quantity = int(np.argmax(np.isfinite(stacked[:, :, 0]).sum(0)))
    order = [int(i) for i in np.argsort(stacked[:, quantity, 0]) if np.isfinite(stacked[i, quantity, 0])]
    copies: dict[int, int] = {}
    for n, one in enumerate(order):
        for other in order[n + 1 :]:
            if stacked[other, quantity, 0] - stacked[one, quantity, 0] > twice.ALIKE * stacked[one, quantity, 1]:
                break
            if twice.alike(stacked[one, :, :2], stacked[other, :, :2]):
                later, first = max(one, other), min(one, other)
                copies[later] = min(first, copies.get(later, first))
    return copies


class Key(NamedTuple):
    """The properties that pooled logs have in common."""

    vehicle: str
    environment: EnvironmentKind
    bearing_mass_kg: float
    part: Literal["phase", "docked"]
    name: str

    @staticmethod
    def of(pool: Pool) -> Key:
        """The key of a pool."""
        return Key(pool.vehicle, pool.environment, pool.bearing_mass_kg, pool.part, pool.name)


def _numbers(item: Value | None) -> tuple[float, float, float, float]:
    """Value, sigma, shared and possibly shared sigma; NaN if the data do not inform the value or the shared sigma is unknown."""
    if item and item.verdict in INFORMED and item.value is not None and item.sigma and item.shared is not None:
        return item.value, item.sigma, item.shared, item.alike
    return np.nan, np.nan, np.nan, np.nan


def _pool(key: Key, group: Group) -> Pool:
    ten, about = apart({quantity: _quantity(quantity, group, n) for n, quantity in enumerate(ALL_UNITS)})
    has_pivot = any(item.logs for item in about.values())
    return Pool(**key._asdict(), vehicle_files=len(group.files), estimates=ten, about_pivot=about if has_pivot else {})


def _quantity(quantity: str, group: Group, index: int) -> Pooled:
    """The pooled value of one quantity, which has this index in ALL_UNITS."""
    values = np.array([log[index] for log in group.values])
    estimated = np.flatnonzero(np.isfinite(values[:, 0]))
    if not len(estimated):
        return Pooled(unit=ALL_UNITS[quantity], logs=0, value=None, sigma=None)
    names = [group.names[n] for n in estimated]
    samples = LogValues(np.array(group.numbers, dtype=float)[estimated], *values[estimated].T)
    of_all, outlying = mean(samples), outliers(samples)
    inliers = mean(samples.only(np.delete(np.arange(len(names)), list(outlying)))) if outlying else None
    return Pooled(
        unit=ALL_UNITS[quantity],
        logs=len(names),
        value=of_all.value,
        sigma=of_all.sigma,
        shared=of_all.shared,
        without_outliers=None if inliers is None else (inliers.value, inliers.sigma),
        **scatter(samples),
        **trend(samples),
        outliers=[Outlier(log=names[i], value=samples.value[i], sigmas=z) for i, z in outlying.items()],
    )


@dataclass(frozen=True)
class LogValues:
    """One quantity in all logs of one vehicle, SI."""

    number: Array
    """(n,) number of the log in the campaign."""
    value: Array
    """(n,) estimate."""
    sigma: Array
    """(n,) total standard deviation s."""
    shared: Array
    """(n,) part c of it that is common to all logs."""
    possibly_shared: Array
    """(n,) part g of the unshared sigma that may be common to all logs."""

    @property
    def unshared(self) -> Array:
        """(n,) unshared standard deviation u."""
        return np.asarray(np.sqrt(np.maximum(self.sigma**2 - self.shared**2, (_LEAST_UNSHARED * self.sigma) ** 2)))

    def only(self, keep: NDArray[np.intp]) -> LogValues:
        """The logs at these indices."""
        return LogValues(self.number[keep], self.value[keep], self.sigma[keep], self.shared[keep], self.possibly_shared[keep])


@dataclass(frozen=True)
class Mean:
    """The weighted mean with its standard deviation; ``shared`` is the part of it that more logs do not reduce."""

    value: float
    sigma: float
    shared: float


def mean(samples: LogValues) -> Mean:
    """The inverse-variance weighted mean."""
    weight = samples.unshared**-2.0
    total = weight.sum()
    shared = float(np.hypot(weight @ samples.shared, weight @ samples.possibly_shared) / total)
    independent = float(weight**2 @ np.maximum(samples.unshared**2 - samples.possibly_shared**2, 0.0)) / total**2
    return Mean(float(weight @ samples.value / total), float(np.sqrt(independent + shared**2)), shared)


def scatter(samples: LogValues) -> dict[str, Any]:
    """χ² about the weighted mean, as fields of :class:`Pooled`; empty for fewer than two logs."""
    freedom = len(samples.value) - 1
    if freedom < 1:
        return {}
    chi_square = float((((samples.value - mean(samples).value) / samples.unshared) ** 2).sum())
    ratio = float(np.sqrt(chi_square / freedom))
    return {"chi_square": chi_square, "degrees_of_freedom": freedom, "p_value": chance(chi_square, freedom), "scatter_ratio": ratio}


def outliers(samples: LogValues) -> dict[int, float]:
    """Index and distance in sigmas of each outlier, the farthest first; empty for fewer than three logs."""
    found: dict[int, float] = {}
    remaining = np.arange(len(samples.value))
    while len(remaining) >= 3 and len(found) < len(samples.value) // 2:
        z = _distance_from_others(samples.only(remaining))
        worst = int(np.argmax(np.abs(z)))
        if not abs(z[worst]) > OUTLYING:
            break
        found[int(remaining[worst])] = float(z[worst])
        remaining = np.delete(remaining, worst)
    return found


def _distance_from_others(samples: LogValues) -> Array:
    """(n,) distance of each log from the mean of all others, in sigmas of that distance."""
    weight, value = samples.unshared**-2.0, samples.value - np.median(samples.value)
    # add the terms before and after each log: total minus its term loses all digits if that term dominates
    others, sums = _without_each(weight), _without_each(weight * value)
    return np.asarray((value - sums / others) / np.sqrt(1 / weight + 1 / others))


def _without_each(terms: Array) -> Array:
    """(n,) for each term the sum of all others."""
    before = np.concatenate([[0.0], np.cumsum(terms)[:-1]])
    after = np.concatenate([np.cumsum(terms[::-1])[::-1][1:], [0.0]])
    return np.asarray(before + after)


def trend(samples: LogValues) -> dict[str, Any]:
    """Slope over the logs' numbers, as fields of :class:`Pooled`; empty for fewer than three logs."""
    if len(samples.value) < 3:
        return {}
    weight = samples.unshared**-2.0
    offset = samples.number - weight @ samples.number / weight.sum()
    spread = float(weight @ offset**2)
    slope = float(weight @ (offset * (samples.value - mean(samples).value)) / spread)
    return {"trend_per_log": slope, "trend_sigma": float(spread**-0.5)}
