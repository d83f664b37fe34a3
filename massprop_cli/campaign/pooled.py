"""What all logs of one vehicle say together of each quantity; :mod:`massprop_cli.campaign.pool` has the statistics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from massprop_cli import ALL_UNITS
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.campaign import pool
from massprop_cli.campaign.outcome import CampaignRow, OutcomePart, Value
from massprop_cli.combine import twice
from massprop_cli.inputs.equipment import EnvironmentKind
from massprop_cli.result.judge import INFORMED, apart, together


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
    """By vehicle, method and part, in the order in which they first appear; of what two logs at least tell."""
    pools = [_pool(key, group) for key, group in grouped(rows).items() if len(group.numbers) > 1]
    return [found for found in pools if any(quantity.logs > 1 for quantity in found.items.values())]


@dataclass(frozen=True)
class Group:
    """What is pooled together, log by log."""

    numbers: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    """(19, 4) each, in the order of ALL_UNITS: value, sigma, shared, alike; NaN where the log doesn't tell."""
    files: set[str] = field(default_factory=set)
    """sha256 of their vehicle files."""
    expected: tuple[set[float], ...] = field(default_factory=lambda: tuple(set() for _ in ALL_UNITS))
    """Of each quantity, what any log expects."""

    def without(self, which: set[int]) -> Group:
        """But for these of its logs."""
        left = [n for n in range(len(self.numbers)) if n not in which]
        values = [self.values[n] for n in left]
        return replace(self, numbers=[self.numbers[n] for n in left], names=[self.names[n] for n in left], values=values)


def grouped(rows: Iterable[CampaignRow]) -> dict[Key, Group]:
    """Logs by vehicle and part; a log given twice, in whatever format, counts once, one of the thesis's method, without sigmas, never."""
    groups: dict[Key, Group] = {}
    seen = set()
    for number, one in enumerate(rows, 1):
        found = one.outcome
        if found is None or found.vehicle is None or found.method == "thesis" or found.input_sha256 in seen:
            continue
        seen.add(found.input_sha256)
        stated = found.vehicle
        for body in found.bodies:
            group = groups.setdefault(Key(stated.name, stated.environment, stated.bearing_mass_kg, body.part, body.name), Group())
            group.numbers.append(number)
            group.names.append(one.name)
            group.files.add(stated.sha256)
            items = [*map(body.items.get, ALL_UNITS)]
            group.values.append(np.array([_told(item) for item in items]))
            for alike, item in zip(group.expected, items, strict=True):
                alike |= {item.expected} if item and item.expected is not None else set()
    return {key: group.without(_again(group.values)) for key, group in groups.items()}


def _again(values: Sequence[Array]) -> set[int]:
    """Which of these (19, 4) are of a recording that stands there before in another file."""
    whole = np.array(values)
    quantity = int(np.argmax(np.isfinite(whole[:, :, 0]).sum(0)))
    order = [int(i) for i in np.argsort(whole[:, quantity, 0]) if np.isfinite(whole[i, quantity, 0])]
    found = set()
    for n, one in enumerate(order):
        for other in order[n + 1 :]:
            if whole[other, quantity, 0] - whole[one, quantity, 0] > twice.ALIKE * whole[one, quantity, 1]:
                break
            if twice.alike(whole[one, :, :2], whole[other, :, :2]):
                found.add(max(one, other))
    return found


class Key(NamedTuple):
    """What logs have in common that are pooled together."""

    vehicle: str
    environment: EnvironmentKind
    bearing_mass_kg: float
    part: Literal["phase", "docked"]
    name: str

    @staticmethod
    def of(found: Pool) -> Key:
        """Of a pool."""
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
    samples = pool.LogValues(np.array(group.numbers, dtype=float)[told], *values[told].T)
    mean, scatter, trend, stray = pool.mean(samples), pool.scatter(samples), pool.trend(samples), pool.outliers(samples)
    rest = pool.mean(samples.only(np.delete(np.arange(len(names)), list(stray)))) if stray else None
    return Pooled(
        unit=ALL_UNITS[quantity],
        logs=len(names),
        value=mean.value,
        sigma=mean.sigma,
        shared=mean.shared,
        without_outliers=None if rest is None else (rest.value, rest.sigma),
        chi_square=scatter.chi_square if scatter else None,
        degrees_of_freedom=scatter.degrees_of_freedom if scatter else None,
        p_value=scatter.p_value if scatter else None,
        scatter_ratio=scatter.ratio if scatter else None,
        trend_per_log=trend.per_log if trend else None,
        trend_sigma=trend.sigma if trend else None,
        outliers=[Outlier(log=names[i], value=samples.value[i], sigmas=z) for i, z in stray.items()],
    )
