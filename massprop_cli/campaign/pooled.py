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
"""Sigmas beyond which a log is an outlier."""
_LEAST_OWN = 1e-3
"""Of its sigma, a log's own error is at least this: what is left of a difference of nearly equal numbers bears no more."""


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
        """All of them, those about the pivot with a prefix before their names."""
        return together(self.estimates, self.about_pivot)


def pooled(rows: Iterable[CampaignRow]) -> list[Pool]:
    """Pools by vehicle, method and part, in the order of their first logs; each has two logs at least."""
    return pools_of(grouped(rows))


def pools_of(groups: Mapping[Key, Group]) -> list[Pool]:
    """The pool of each group in which two logs at least give a value."""
    pools = [_pool(key, group) for key, group in groups.items() if len(group.numbers) > 1]
    return [found for found in pools if any(quantity.logs > 1 for quantity in found.items.values())]


@dataclass(frozen=True)
class Group:
    """The logs that are pooled together."""

    numbers: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    """(19, 4) each, in the order of ALL_UNITS: value, sigma, shared, alike; NaN where the log doesn't tell."""
    files: set[str] = field(default_factory=set)
    """sha256 of their vehicle files."""
    expected: tuple[set[float], ...] = field(default_factory=lambda: tuple(set() for _ in ALL_UNITS))
    """Of each quantity, what any log expects."""

    copies: dict[str, str] = field(default_factory=dict)
    """Logs that are left out by name, and the log before each that is of the same recording."""

    def once(self) -> Group:
        """But for logs of a recording that stands there before in another file."""
        again = _again(self.values)
        left = [n for n in range(len(self.numbers)) if n not in again]
        return replace(
            self,
            numbers=[self.numbers[n] for n in left],
            names=[self.names[n] for n in left],
            values=[self.values[n] for n in left],
            copies=self.copies | {self.names[later]: self.names[first] for later, first in again.items()},
        )


def grouped(rows: Iterable[CampaignRow]) -> dict[Key, Group]:
    """Logs by vehicle and part; a log given twice, in whatever format, counts once, one of the thesis's method, without sigmas, never."""
    groups: dict[Key, Group] = {}
    seen: dict[str | None, str] = {}
    for number, one in enumerate(rows, 1):
        found = one.outcome
        if found is None or found.vehicle is None or found.method == "thesis":
            continue
        stated, first = found.vehicle, seen.setdefault(found.input_sha256, one.name)
        for body in found.bodies:
            group = groups.setdefault(Key(stated.name, stated.environment, stated.bearing_mass_kg, body.part, body.name), Group())
            if first != one.name:
                group.copies[one.name] = first
                continue
            group.numbers.append(number)
            group.names.append(one.name)
            group.files.add(stated.sha256)
            items = [*map(body.items.get, ALL_UNITS)]
            group.values.append(np.array([_told(item) for item in items]))
            for alike, item in zip(group.expected, items, strict=True):
                alike |= {item.expected} if item and item.expected is not None else set()
    return {key: group.once() for key, group in groups.items()}


def _again(values: Sequence[Array]) -> dict[int, int]:
    """Which of these (19, 4) are of a recording that stands there before in another file, and which is the first of it."""
    if not values:
        return {}
    whole = np.array(values)
    quantity = int(np.argmax(np.isfinite(whole[:, :, 0]).sum(0)))
    order = [int(i) for i in np.argsort(whole[:, quantity, 0]) if np.isfinite(whole[i, quantity, 0])]
    found: dict[int, int] = {}
    for n, one in enumerate(order):
        for other in order[n + 1 :]:
            if whole[other, quantity, 0] - whole[one, quantity, 0] > twice.ALIKE * whole[one, quantity, 1]:
                break
            if twice.alike(whole[one, :, :2], whole[other, :, :2]):
                later, first = max(one, other), min(one, other)
                found[later] = min(first, found.get(later, first))
    return found


class Key(NamedTuple):
    """The properties that pooled logs have in common."""

    vehicle: str
    environment: EnvironmentKind
    bearing_mass_kg: float
    part: Literal["phase", "docked"]
    name: str

    @staticmethod
    def of(found: Pool) -> Key:
        """The key of a pool."""
        return Key(found.vehicle, found.environment, found.bearing_mass_kg, found.part, found.name)


def _told(item: Value | None) -> tuple[float, float, float, float]:
    if item and item.verdict in INFORMED and item.value is not None and item.sigma and item.shared is not None:
        return item.value, item.sigma, item.shared, item.alike
    return np.nan, np.nan, np.nan, np.nan


def _pool(key: Key, group: Group) -> Pool:
    ten, about = apart({quantity: _quantity(quantity, group, n) for n, quantity in enumerate(ALL_UNITS)})
    told = any(item.logs for item in about.values())
    return Pool(**key._asdict(), vehicle_files=len(group.files), estimates=ten, about_pivot=about if told else {})


def _quantity(quantity: str, group: Group, index: int) -> Pooled:
    values = np.array([log[index] for log in group.values])
    told = np.flatnonzero(np.isfinite(values[:, 0]))
    if not len(told):
        return Pooled(unit=ALL_UNITS[quantity], logs=0, value=None, sigma=None)
    names = [group.names[n] for n in told]
    samples = LogValues(np.array(group.numbers, dtype=float)[told], *values[told].T)
    found, stray = mean(samples), outliers(samples)
    rest = mean(samples.only(np.delete(np.arange(len(names)), list(stray)))) if stray else None
    return Pooled(
        unit=ALL_UNITS[quantity],
        logs=len(names),
        value=found.value,
        sigma=found.sigma,
        shared=found.shared,
        without_outliers=None if rest is None else (rest.value, rest.sigma),
        **scatter(samples),
        **trend(samples),
        outliers=[Outlier(log=names[i], value=samples.value[i], sigmas=z) for i, z in stray.items()],
    )


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


def mean(samples: LogValues) -> Mean:
    """The inverse-variance weighted mean."""
    weight = samples.own**-2.0
    total = weight.sum()
    shared = float(np.hypot(weight @ samples.shared, weight @ samples.alike) / total)
    apart = float(weight**2 @ np.maximum(samples.own**2 - samples.alike**2, 0.0)) / total**2
    return Mean(float(weight @ samples.value / total), float(np.sqrt(apart + shared**2)), shared)


def scatter(samples: LogValues) -> dict[str, Any]:
    """χ² about the weighted mean, as in :class:`Pooled`; nothing of fewer than two logs."""
    free = len(samples.value) - 1
    if free < 1:
        return {}
    chi_square = float((((samples.value - mean(samples).value) / samples.own) ** 2).sum())
    ratio = float(np.sqrt(chi_square / free))
    return {"chi_square": chi_square, "degrees_of_freedom": free, "p_value": chance(chi_square, free), "scatter_ratio": ratio}


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


def trend(samples: LogValues) -> dict[str, Any]:
    """Slope over the logs' numbers, as in :class:`Pooled`; nothing of fewer than three logs."""
    if len(samples.value) < 3:
        return {}
    weight = samples.own**-2.0
    offset = samples.number - weight @ samples.number / weight.sum()
    spread = float(weight @ offset**2)
    slope = float(weight @ (offset * (samples.value - mean(samples).value)) / spread)
    return {"trend_per_log": slope, "trend_sigma": float(spread**-0.5)}
