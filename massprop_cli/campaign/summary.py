"""Content of campaign.json (``massprop schema summary``): all logs and their pooled values, written row by row to save memory."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, WrapSerializer, WrapValidator

from massprop_cli import ALL_UNITS, QUANTITIES, __version__
from massprop_cli.base import configfile, escape, exits
from massprop_cli.base.errors import InputError
from massprop_cli.campaign.outcome import CampaignRow, CompressedRows, OutcomePart, contradicted
from massprop_cli.campaign.pooled import Pool, grouped, pools_of


def _compressed(value: object, validated: ValidatorFunctionWrapHandler) -> object:
    """Rows as :class:`CompressedRows`; validate other sequences first."""
    return value if isinstance(value, CompressedRows) else CompressedRows(validated(value))


class Beyond(OutcomePart):
    """A difference from the baseline beyond what is allowed, or something that it has and this campaign lacks."""

    log: str | None = Field(description="null: of the vehicle's pooled value")
    vehicle: str | None
    part: str | None
    quantity: str | None
    value: float | None
    baseline_value: float | None
    sigmas: float | None
    message: str


class Baseline(OutcomePart):
    """The campaign tested against an earlier one."""

    sha256: str
    compared: int = Field(description="logs that both have")
    new: list[str] = Field(description="logs that the baseline lacks")
    beyond: list[Beyond]


class Summary(OutcomePart):
    """The whole of campaign.json."""

    schema_: Literal["massprop/summary/1"] = Field("massprop/summary/1", alias="schema")
    massprop: str
    name: str
    exit_code: int = Field(description="the worst of the logs' codes: 1, then 3, then 6, then 4, then 5; 5 if beyond the baseline")
    exit_codes: dict[str, int] = Field(description="how many logs have which; none: not tried")
    contradicted: int = Field(0, description="how many logs and their vehicle files contradict each other")
    warned: int = Field(0, description="how many logs have warnings")
    warnings: dict[str, int] = Field({}, description="how many logs have a warning of which code, the most frequent first")
    logs: Annotated[Sequence[CampaignRow], WrapValidator(_compressed), WrapSerializer(lambda rows, serialized: serialized(list(rows)))]
    pooled: list[Pool]
    copies: dict[str, str] = Field(
        {}, description="logs of a recording that another log has too, by name, and the first log of it: pooled values count it once"
    )
    combined: list[CampaignRow] = Field([], description="results of several logs, as the campaign file asks for")
    baseline: Baseline | None = None


def summary(name: str, rows: Sequence[CampaignRow], baseline: Baseline | None = None, combined: Sequence[CampaignRow] = ()) -> Summary:
    """Count outcomes, pool values, and determine the campaign's exit code."""
    logs = rows if isinstance(rows, CompressedRows) else CompressedRows(rows)
    codes: list[int | None] = []
    contradictions, warned, warnings = 0, 0, Counter[str]()
    for outcome in (row.outcome for row in logs):
        codes.append(None if outcome is None else outcome.exit_code)
        contradictions += contradicted(outcome) > 0
        warning_codes = set(outcome.warnings) if outcome is not None else set()
        warned += bool(warning_codes)
        warnings.update(warning_codes)
    groups = grouped(logs)
    every = {*codes, *(row.outcome.exit_code for row in combined if row.outcome is not None)}
    worst = next((code for code in exits.GRAVITY if code in every), 0)
    counted = {"none" if code is None else str(code): codes.count(code) for code in (0, *exits.GRAVITY, None) if code in codes}
    return Summary(
        schema="massprop/summary/1",
        massprop=__version__,
        name=name,
        exit_code=worst or (5 if baseline is not None and baseline.beyond else 0),
        exit_codes=counted,
        contradicted=contradictions,
        warned=warned,
        warnings=dict(sorted(warnings.items(), key=lambda one: (-one[1], one[0]))),
        logs=logs,
        pooled=pools_of(groups),
        copies={name: first for group in groups.values() for name, first in group.copies.items()},
        combined=[*combined],
        baseline=baseline,
    )


def quantities(summary: Summary) -> list[str]:
    """Names of the quantities that the tables contain; those about the pivot only if a log has a pivot."""
    pivoted = any(body.about_pivot for row in summary.logs if row.outcome for body in row.outcome.bodies)
    return [*(ALL_UNITS if pivoted else QUANTITIES)]


def to_json(summary: Summary) -> Iterator[str]:
    """Canonical JSON text, in pieces: equal campaigns give equal bytes."""
    without_logs = {name: getattr(summary, name) for name in Summary.model_fields} | {"logs": []}
    before, after = escape.document(Summary.model_construct(**without_logs), "").split('\n "logs": [],\n')
    yield before + '\n "logs": ['
    for number, row in enumerate(summary.logs):
        yield "," * bool(number) + ("\n" + escape.document(row, "")).replace("\n", "\n  ")
    yield "\n ]" * bool(summary.logs) + "]" * (not summary.logs) + ",\n" + after + "\n"


def parse(content: bytes, place: str) -> Summary:
    """Parse campaign.json; raise :class:`InputError` if it is not valid."""
    text = configfile.decoded(content, place, "campaign.json")
    try:
        return Summary.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise InputError(f"{place}: {where}: {first['msg']}; name a campaign.json that massprop batch of this version wrote") from None
