"""HTML page of a campaign: table of logs, which a script sorts and filters, and pooled values. Equal campaigns give equal bytes."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any
from urllib.parse import quote

from massprop_cli import ALL_UNITS
from massprop_cli.base.dataclass import dataclass
from massprop_cli.campaign import figures
from massprop_cli.campaign.outcome import CHECKED, STATES, CampaignRow, Outcome, PhaseQuantities, Value, contradicted, state
from massprop_cli.campaign.place import RESULTS
from massprop_cli.campaign.pooled import Key, Pool, Pooled, grouped
from massprop_cli.campaign.summary import Summary, quantities
from massprop_cli.report import digits, html, vocabulary
from massprop_cli.report.svg import script
from massprop_cli.result.judge import INFORMED

_SIGNS = {0: "✓", 1: "✕", 3: "✕", 4: "~", 5: "✕", 6: vocabulary.SIGNS["contradicted"], None: "–"}
_MARKS = {0: "converged", 4: "not_converged", 5: "not_excited", 6: "contradicted", None: "muted"}
_CONTRADICTED, _WARNED = (vocabulary.SIGNS["contradicted"], "contradicted"), ("⚠", "not_converged")
"""Sign and mark of a log with exit code 0 and contradictions, or warnings."""
_MINOR = ("long-interval", "records-lost", "outliers", "disturbance-torque", "gyro-misfit", "accelerometer-misfit", "noise-floor")
"""Warnings about reading the log and about noise levels; the table shows others first."""
MOST_NAMES = 3
"""Largest number of logs that a sentence names."""
_SIGNIFICANT, _SIGNIFICANT_SIGMAS = 1e-3, 3.3
"""False-alarm rate at which the page notes excess scatter, and the equivalent in sigmas (two-sided), for a trend."""


@dataclass(frozen=True)
class QuantityCell:
    """Table cell of one quantity in one part of a log."""

    verdict: str
    sign: str
    value: str
    sigma: str
    key: str
    """The value in full precision, the sort key; empty without a value."""
    missed: bool
    """Whether it misses its expectation."""
    rough: bool
    """Whether its verdict makes the value unusable."""


def page(summary: Summary) -> Iterator[str]:
    """Text of the whole page, in pieces; it loads no other files."""
    several = tagged = False
    names = [name for name in quantities(summary) if name != "mass"]
    states: dict[str, None] = {}
    vehicles: dict[str, None] = {}
    verdicts: dict[str, str] = {}
    for entry in _entries(summary, names):
        several |= len(entry["parts"]) > 1
        tagged |= bool(entry["tags"])
        states[entry["state"]] = None
        vehicles |= {entry["vehicle"]: None} if entry["vehicle"] else {}
        verdicts |= {cell.verdict: cell.sign for cells in (*entry["cells"], entry["mass"]) for cell in cells if cell.sign}
    yield from (
        html.environment()
        .get_template("campaign.html.j2")
        .generate(
            summary=summary,
            entries=_entries(summary, names),
            several=several,
            tagged=tagged,
            states=list(states),
            vehicles=list(vehicles),
            counts=counts(summary),
            quantities=[(vocabulary.SYMBOLS[name], vocabulary.unit(ALL_UNITS[name])) for name in names],
            pools=_pools(summary),
            combined=[
                (entry, outcome_text(row))
                for entry, row in zip(map(partial(_entry, names, 0), summary.combined), summary.combined, strict=True)
            ],
            verdicts=verdicts,
            view_title=title,
            doubts=doubts,
            script=script("campaign.js"),
        )
    )


def counts(summary: Summary) -> str:
    """Number of logs by outcome, in words, the worst first; then the numbers with contradictions, warnings and copies."""
    keys = ((code, "none" if code is None else str(code)) for code in STATES)
    phrases = [", ".join(f"{summary.exit_codes[key]} {STATES[code]}" for code, key in keys if key in summary.exit_codes)]
    phrases += [f"{summary.contradicted} contradicted by the vehicle file"] if summary.contradicted else []
    codes = ", ".join(f"{code} {count}" for code, count in summary.warnings.items())
    phrases += [f"{summary.warned} with warnings ({codes})"] if summary.warned else []
    return "; ".join([*phrases, *_copies(summary.copies)])


def _copies(copies: Mapping[str, str]) -> list[str]:
    """A sentence for each recording that several logs contain."""
    by_first: dict[str, list[str]] = {}
    for name, first in copies.items():
        by_first.setdefault(first, []).append(name)
    sentences = []
    for first, names in by_first.items():
        more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        named = f"{', '.join(names[:MOST_NAMES])}{more} {'has' if len(names) == 1 else 'have'}"
        sentences.append(f"{named} the recording of {first}: counted once in pooled values")
    return sentences


def outcome_text(row: CampaignRow) -> str:
    """The outcome of a combined result, in words."""
    codes = f" ({', '.join(dict.fromkeys(row.outcome.warnings))})" if row.outcome and row.outcome.warnings else ""
    return f"{state(row.outcome)}{codes}" + (f": {row.outcome.message}" if row.outcome and row.outcome.message else "")


def _entries(summary: Summary, names: Sequence[str]) -> Iterator[dict[str, Any]]:
    return (_entry(names, number, row) for number, row in enumerate(summary.logs, 1))


def _entry(names: Sequence[str], number: int, row: CampaignRow) -> dict[str, Any]:
    """Template data of one log: the quantities ``names`` and the mass, by part."""
    outcome = row.outcome
    code = outcome.exit_code if outcome else None
    sign, mark = _SIGNS[code], _MARKS.get(code, "unobservable")
    if outcome is not None and code == 0 and (outcome.warnings or contradicted(outcome)):
        sign, mark = _CONTRADICTED if contradicted(outcome) else _WARNED
    bodies = outcome.bodies if outcome else []
    items = [item for body in bodies for item in body.items.values()]
    return {
        "number": number,
        "name": row.name,
        "link": _link(row.name, outcome),
        "log": row.log,
        "tags": ", ".join(row.tags),
        "vehicle": outcome.vehicle.name if outcome and outcome.vehicle else "",
        "state": state(outcome),
        "sign": sign,
        "mark": mark,
        "message": outcome.message if outcome else "",
        "parts": tuple(title(body) for body in bodies),
        "cells": tuple(tuple(_cell(body.items.get(name)) for body in bodies) for name in names),
        "mass": tuple(_cell(body.estimates["mass"]) for body in bodies),
        "verdicts": " ".join(dict.fromkeys(item.verdict for item in items)),
        "converged": sum(item.verdict == "converged" for item in items),
        "contradicted": contradicted(outcome),
        "estimates": len(items),
        "worst": worst(outcome.warnings) if outcome else "",
        "codes": " ".join(dict.fromkeys(outcome.warnings)) if outcome else "",
        "warnings": ", ".join(dict.fromkeys(outcome.warnings)) if outcome else "",
    }


def worst(codes: Sequence[str]) -> str:
    """The first warning that is not minor, else the first; empty without warnings."""
    return next((code for code in codes if code not in _MINOR), codes[0] if codes else "")


def _link(name: str, outcome: Outcome | None) -> str:
    """Relative URL of a log's report, result or check; empty without a file."""
    file = next((file for file in ("report.html", "result.json", CHECKED) if outcome and file in outcome.files), None)
    return f"{RESULTS}/{quote(name)}/{file}" if file else ""


def title(body: PhaseQuantities | Pool) -> str:
    """Title of a phase or a docked object."""
    return body.name if body.part == "phase" else f"docked: {body.name}"


def _cell(item: Value | None) -> QuantityCell:
    if item is None:
        return QuantityCell("absent", "", digits.ABSENT, digits.ABSENT, "", missed=False, rough=False)
    value, sigma = _numbers(item.value, item.sigma, item.verdict)
    if item.value is None and item.sigma is not None:  # predicted by a check
        sigma = digits.figures(item.sigma)
    key = "" if item.value is None else repr(item.value)
    return QuantityCell(item.verdict, vocabulary.SIGNS[item.verdict], value, sigma, key, item.met is False, item.verdict not in INFORMED)


@dataclass(frozen=True)
class PooledVehicle:
    """Pooled values of one vehicle's logs, as table rows and a figure."""

    pool: Pool
    rows: list[dict[str, str]]
    figure: html.Figure


def _pools(summary: Summary) -> list[PooledVehicle]:
    groups = grouped(summary.logs) if summary.pooled else {}
    vehicles = []
    for number, pool in enumerate(summary.pooled, 1):
        spread = figures.spreads(groups[Key.of(pool)])
        picture = html.drawn("pool", "Log by log", figures.picture(spread, pool), f"pool{number}")
        within = {name: f"{one.within} of {len(one.samples.value)}" for name, one in spread.items()}
        rows = [row | {"within": within.get(name, "–")} for name, row in zip(pool.items, pooled(pool), strict=True)]
        vehicles.append(PooledVehicle(pool, rows, picture))
    return vehicles


def _pooled(name: str, item: Pooled) -> dict[str, str]:
    """Table row of one pooled quantity, as text."""
    value, sigma = _numbers(item.value, item.sigma)
    excess_scatter = item.p_value is not None and item.p_value < _SIGNIFICANT
    trend, trend_sigma = item.trend_per_log, item.trend_sigma
    has_trend = trend is not None and trend_sigma is not None and abs(trend) > _SIGNIFICANT_SIGMAS * trend_sigma
    return {
        "symbol": vocabulary.SYMBOLS[name],
        "value": value,
        "sigma": sigma,
        "unit": vocabulary.unit(item.unit),
        "logs": str(item.logs),
        "ratio": _short(item.scatter_ratio),
        "chi_square": "–" if item.chi_square is None else f"{_short(item.chi_square)} of {item.degrees_of_freedom}",
        "p_value": "–" if item.p_value is None else f"{item.p_value:.2g}" if item.p_value >= 1e-6 else "< 1e−6",
        "trend": _slope(item),
        "outliers": ", ".join(f"{outlier.log} ({digits.minus(f'{outlier.sigmas:+.1f}')} σ)" for outlier in item.outliers) or "none",
        "without": digits.minus(digits.with_sigma(*item.without_outliers)) if item.without_outliers else "",
        "note": ", ".join(note for note, applies in (("more scatter than claimed", excess_scatter), ("a trend", has_trend)) if applies),
    }


def _numbers(value: float | None, sigma: float | None, verdict: str = "converged") -> Iterator[str]:
    return map(digits.minus, digits.numbers(value, sigma, verdict))


def _slope(item: Pooled) -> str:
    if item.trend_per_log is None or item.trend_sigma is None:
        return "–"
    slope = digits.minus(digits.with_sigma(item.trend_per_log, item.trend_sigma))
    return f"{'' if slope.startswith('−') else '+'}{slope}"


def _short(ratio: float | None) -> str:
    return "–" if ratio is None else f"{ratio:.2f}" if ratio < 100 else f"{ratio:.0f}"


def doubts(pool: Pool) -> list[str]:
    """A sentence if the scatter exceeds the claimed sigmas; the sigma of the mean is then not valid."""
    names = [name for name, item in pool.items.items() if item.p_value is not None and item.p_value < _SIGNIFICANT]
    if not names:
        return []
    worst = max(pool.items[name].scatter_ratio or 0.0 for name in names)
    files = f"; they have {pool.vehicle_files} different vehicle files" if pool.vehicle_files > 1 else ""
    return [
        f"{', '.join(names)}: the logs contradict each other, scattering up to {_short(worst)} times as far as they claim{files}. Do not "
        "use these means: either the vehicle changed, or a vehicle file is wrong"
    ]


def pooled(pool: Pool) -> Sequence[dict[str, str]]:
    """Table rows of a vehicle's pooled values, as text; Markdown and terminal use them too."""
    return [_pooled(name, item) for name, item in pool.items.items()]
