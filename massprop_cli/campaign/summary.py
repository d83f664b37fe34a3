"""campaign.json: all logs of a campaign and what they say together. The models below are the schema (``massprop schema summary``).

Rows are held packed and written one by one, so that a campaign takes hardly more memory for many logs than for few.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple, overload

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, ValidatorFunctionWrapHandler, WrapSerializer, WrapValidator

from massprop_cli import QUANTITIES, UNITS, __version__
from massprop_cli.base import escape, exits
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.campaign import location, pool
from massprop_cli.campaign.outcome import Item, Outcome, Value, contradicted, packed, unpacked
from massprop_cli.campaign.plan import Job
from massprop_cli.inputs.equipment import EnvironmentKind

INFORMED = ("converged", "not_converged")
"""Verdicts of values that the motion told."""


class Row(Item):
    """One log, in the campaign's order."""

    name: str = Field(description="of its result folder in results/")
    log: str = Field(description="path below what was named")
    tags: list[str]
    outcome: Outcome | None = Field(description="null: not tried, after --fail-fast")


class Rows(Sequence[Row]):
    """Rows, compressed: about 1 kB each, where a row in the open takes 15 kB. What is taken out is a copy."""

    def __init__(self, rows: Iterable[Row] = ()) -> None:
        self._packed = [packed(row) for row in rows]

    def __len__(self) -> int:
        return len(self._packed)

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Row]: ...
    def __getitem__(self, index: int | slice) -> Row | Sequence[Row]:
        """One row, or some."""
        if isinstance(index, slice):
            return [unpacked(Row, one) for one in self._packed[index]]
        return unpacked(Row, self._packed[index])

    def __setitem__(self, index: int, row: Row) -> None:
        self._packed[index] = packed(row)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rows) and self._packed == other._packed

    __hash__ = None  # type: ignore[assignment]


def _held(value: object, validated: ValidatorFunctionWrapHandler) -> object:
    return value if isinstance(value, Rows) else Rows(validated(value))


def _open(value: Sequence[Row], serialized: SerializerFunctionWrapHandler) -> Any:
    return serialized(list(value))


class Outlier(Item):
    """A log further than 4 sigma from the mean of the others."""

    log: str
    value: float
    sigmas: float = Field(description="from the mean of the others without outliers found before")


class Pooled(Item):
    """One quantity over all logs that told it, SI."""

    unit: str
    logs: int
    value: float | None = Field(description="inverse-variance weighted mean of all logs, outliers included")
    sigma: float | None
    shared: float | None = Field(None, description="of sigma, what all logs have in common and more logs don't make smaller")
    without_outliers: tuple[float, float] | None = Field(None, description="mean and sigma; null where there is no outlier")
    chi_square: float | None = Field(None, description="scatter against the logs' own sigmas")
    degrees_of_freedom: int | None = None
    p_value: float | None = Field(None, description="chance of as much scatter or more if the sigmas hold")
    scatter_ratio: float | None = Field(None, description="sqrt of chi-square per degree of freedom; 1 is expected")
    trend_per_log: float | None = None
    trend_sigma: float | None = None
    outliers: list[Outlier] = Field([])


class Pool(Item):
    """Ten quantities of one vehicle, in one phase or as docked object; two logs at least tell one of them."""

    vehicle: str
    environment: EnvironmentKind
    bearing_mass_kg: float
    vehicle_files: int = Field(description="how many different vehicle files its logs have")
    part: Literal["phase", "docked"]
    name: str
    estimates: dict[str, Pooled]


class Beyond(Item):
    """A difference from the baseline beyond what is allowed, or something that it has and this campaign lacks."""

    log: str | None = Field(description="null: of the vehicle's pooled value")
    vehicle: str | None
    part: str | None
    quantity: str | None
    value: float | None
    baseline_value: float | None
    sigmas: float | None
    message: str


class Baseline(Item):
    """The campaign held against an earlier one."""

    sha256: str
    compared: int = Field(description="logs that both have")
    new: list[str] = Field(description="logs that the baseline lacks")
    beyond: list[Beyond]


class Summary(Item):
    """The whole of campaign.json."""

    schema_: Literal["massprop/summary/1"] = Field("massprop/summary/1", alias="schema")
    massprop: str
    name: str
    exit_code: int = Field(description="the worst of the logs' codes: 1, then 3, then 4, then 5; 5 if beyond the baseline")
    exit_codes: dict[str, int] = Field(description="how many logs have which; none: not tried")
    contradicted: int = Field(0, description="how many logs and their vehicle files contradict each other")
    warned: int = Field(0, description="how many logs have warnings")
    warnings: dict[str, int] = Field({}, description="how many logs have a warning of which code, the most frequent first")
    logs: Annotated[Sequence[Row], WrapValidator(_held), WrapSerializer(_open)]
    pooled: list[Pool]
    combined: list[Row] = Field([], description="results of several logs, as the campaign file asks for")
    baseline: Baseline | None = None


def summary(name: str, rows: Sequence[Row], baseline: Baseline | None = None, combined: Sequence[Row] = ()) -> Summary:
    """Count, pool, and decide the campaign's exit code."""
    logs = rows if isinstance(rows, Rows) else Rows(rows)
    codes: list[int | None] = []
    against, warned, warnings = 0, 0, Counter[str]()
    for found in (row.outcome for row in logs):
        codes.append(None if found is None else found.exit_code)
        against += contradicted(found) > 0
        said = set(found.warnings) if found is not None else set()
        warned += bool(said)
        warnings.update(said)
    every = {*codes, *(row.outcome.exit_code for row in combined if row.outcome is not None)}
    worst = next((code for code in exits.GRAVITY if code in every), 0)
    counted = {"none" if code is None else str(code): codes.count(code) for code in (0, *exits.GRAVITY, None) if code in codes}
    return Summary(
        schema="massprop/summary/1",
        massprop=__version__,
        name=name,
        exit_code=worst or (5 if baseline is not None and baseline.beyond else 0),
        exit_codes=counted,
        contradicted=against,
        warned=warned,
        warnings=dict(sorted(warnings.items(), key=lambda one: (-one[1], one[0]))),
        logs=logs,
        pooled=pooled(logs),
        combined=[*combined],
        baseline=baseline,
    )


def row(job: Job, outcome: Outcome | None) -> Row:
    """A job with what became of it."""
    return Row(name=job.name, log=job.shown, tags=list(job.tags), outcome=outcome)


def pooled(rows: Iterable[Row]) -> list[Pool]:
    """By vehicle, method and part, in the order in which they first appear; of what two logs at least tell."""
    pools = [_pool(key, group) for key, group in grouped(rows).items() if len(group.numbers) > 1]
    return [found for found in pools if any(quantity.logs > 1 for quantity in found.estimates.values())]


@dataclass(frozen=True)
class Group:
    """What is pooled together, log by log."""

    numbers: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    """(10, 3) each: value, sigma, shared; NaN where the log doesn't tell."""
    files: set[str] = field(default_factory=set)
    """sha256 of their vehicle files."""
    expected: tuple[set[float], ...] = field(default_factory=lambda: tuple(set() for _ in QUANTITIES))
    """Of each quantity, what any log expects."""


def grouped(rows: Iterable[Row]) -> dict[Key, Group]:
    """Logs by vehicle and part.

    A log that stands in the campaign twice, by its bytes, counts once. The thesis's method claims no sigmas, so nothing is pooled of it.
    """
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
            items = [body.estimates[quantity] for quantity in QUANTITIES]
            group.values.append(np.array([_told(item) for item in items]))
            for alike, item in zip(group.expected, items, strict=True):
                alike |= {item.expected} if item.expected is not None else set()
    return groups


class Key(NamedTuple):
    """What logs have in common that are pooled together."""

    vehicle: str
    environment: Literal["free", "air_bearing", "planar"]
    bearing_mass_kg: float
    part: Literal["phase", "docked"]
    name: str

    @staticmethod
    def of(found: Pool) -> Key:
        """Of a pool."""
        return Key(found.vehicle, found.environment, found.bearing_mass_kg, found.part, found.name)


def _told(item: Value) -> tuple[float, float, float]:
    if item.verdict in INFORMED and item.value is not None and item.sigma and item.shared is not None:
        return item.value, item.sigma, item.shared
    return np.nan, np.nan, np.nan


def _pool(key: Key, group: Group) -> Pool:
    return Pool(
        **key._asdict(),
        vehicle_files=len(group.files),
        estimates={quantity: _quantity(quantity, group, n) for n, quantity in enumerate(QUANTITIES)},
    )


def _quantity(quantity: str, group: Group, index: int) -> Pooled:
    values = np.array([log[index] for log in group.values])
    told = np.flatnonzero(np.isfinite(values[:, 0]))
    if not len(told):
        return Pooled(unit=UNITS[quantity], logs=0, value=None, sigma=None)
    names = [group.names[n] for n in told]
    samples = pool.Samples(np.array(group.numbers, dtype=float)[told], *values[told].T)
    mean, scatter, trend, stray = pool.mean(samples), pool.scatter(samples), pool.trend(samples), pool.outliers(samples)
    rest = pool.mean(samples.only(np.delete(np.arange(len(names)), list(stray)))) if stray else None
    return Pooled(
        unit=UNITS[quantity],
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


def to_json(found: Summary) -> Iterator[str]:
    """Canonical text, piece by piece: same campaign, same bytes."""
    around = {name: getattr(found, name) for name in Summary.model_fields} | {"logs": []}
    before, after = _text(Summary.model_construct(**around)).split('\n "logs": [],\n')
    yield before + '\n "logs": ['
    for number, one in enumerate(found.logs):
        yield "," * bool(number) + ("\n" + _text(one)).replace("\n", "\n  ")
    yield "\n ]" * bool(found.logs) + "]" * (not found.logs) + ",\n" + after + "\n"


def _text(item: Item) -> str:
    return escape.json(json.dumps(item.model_dump(by_alias=True, mode="json"), indent=1, allow_nan=False, ensure_ascii=False))


def parse(content: bytes, place: str) -> Summary:
    """A campaign.json's content; :class:`InputError` names what is wrong with it."""
    text = location.text(content, place, "campaign.json")
    try:
        return Summary.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise InputError(f"{place}: {where}: {first['msg']}; name a campaign.json that massprop batch of this version wrote") from None


def lines(found: Summary) -> Iterator[str]:
    """What is wrong with each log that isn't done, a line each."""
    for one in (*found.logs, *found.combined):
        if one.outcome is not None and one.outcome.exit_code:
            yield f"{one.name}: {one.outcome.message}"


def schema() -> dict[str, Any]:
    """JSON Schema of campaign.json."""
    return Summary.model_json_schema(by_alias=True)
