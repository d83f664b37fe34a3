"""The page of a campaign: logs to sort and filter (a plain table without scripts), and pooled values. Same campaign, same bytes."""

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
"""Sign and mark of a log that is done and yet in doubt."""
_MINOR = ("long-interval", "records-lost", "outliers", "disturbance-torque", "gyro-misfit", "accelerometer-misfit", "noise-floor")
"""Warnings of how a log was read and its noise sized: others matter more."""
FEW = 3
"""Names that a sentence has."""
_UNLIKELY = 1e-3
"""A scatter or a trend with a smaller chance than this is pointed out; 3.3 sigma."""


@dataclass(frozen=True)
class QuantityCell:
    """One quantity of one part of a log."""

    verdict: str
    sign: str
    value: str
    sigma: str
    key: str
    """The value in full, to sort by; empty where there is none."""
    missed: bool
    rough: bool
    """Whether its verdict makes the value no use."""


def page(found: Summary) -> Iterator[str]:
    """The whole page, piece by piece; it loads nothing from anywhere."""
    several = tagged = False
    names = [name for name in quantities(found) if name != "mass"]
    states: dict[str, None] = {}
    vehicles: dict[str, None] = {}
    verdicts: dict[str, str] = {}
    for entry in _entries(found, names):
        several |= len(entry["parts"]) > 1
        tagged |= bool(entry["tags"])
        states[entry["state"]] = None
        vehicles |= {entry["vehicle"]: None} if entry["vehicle"] else {}
        verdicts |= {cell.verdict: cell.sign for cells in (*entry["cells"], entry["mass"]) for cell in cells if cell.sign}
    yield from (
        html.environment()
        .get_template("campaign.html.j2")
        .generate(
            summary=found,
            entries=_entries(found, names),
            several=several,
            tagged=tagged,
            states=list(states),
            vehicles=list(vehicles),
            counts=counts(found),
            quantities=[(vocabulary.SYMBOLS[name], vocabulary.unit(ALL_UNITS[name])) for name in names],
            pools=_pools(found),
            combined=[
                (entry, told_of(row)) for entry, row in zip(map(partial(_entry, names, 0), found.combined), found.combined, strict=True)
            ],
            verdicts=verdicts,
            view_title=title,
            doubts=doubts,
            script=script("campaign.js"),
        )
    )


def counts(found: Summary) -> str:
    """The number of logs by outcome, in words, the worst first; then the number in doubt."""
    keys = ((code, "none" if code is None else str(code)) for code in STATES)
    said = [", ".join(f"{found.exit_codes[key]} {STATES[code]}" for code, key in keys if key in found.exit_codes)]
    said += [f"{found.contradicted} contradicted by the vehicle file"] if found.contradicted else []
    codes = ", ".join(f"{code} {count}" for code, count in found.warnings.items())
    said += [f"{found.warned} with warnings ({codes})"] if found.warned else []
    return "; ".join([*said, *_copies(found.copies)])


def _copies(copies: Mapping[str, str]) -> list[str]:
    """A sentence for each recording that several logs have: it counts once."""
    found: dict[str, list[str]] = {}
    for name, first in copies.items():
        found.setdefault(first, []).append(name)
    said = []
    for first, names in found.items():
        more = f" and {len(names) - FEW} more" if len(names) > FEW else ""
        one = len(names) == 1
        said.append(f"{', '.join(names[:FEW])}{more} {'has' if one else 'have'} the recording of {first}: counted once in pooled values")
    return said


def told_of(row: CampaignRow) -> str:
    """The outcome of a result of several logs, in words."""
    doubts = f" ({', '.join(dict.fromkeys(row.outcome.warnings))})" if row.outcome and row.outcome.warnings else ""
    return f"{state(row.outcome)}{doubts}" + (f": {row.outcome.message}" if row.outcome and row.outcome.message else "")


def _entries(found: Summary, names: Sequence[str]) -> Iterator[dict[str, Any]]:
    return (_entry(names, number, row) for number, row in enumerate(found.logs, 1))


def _entry(names: Sequence[str], number: int, row: CampaignRow) -> dict[str, Any]:
    """The entry of one log: the quantities ``names`` and the mass, by part."""
    found = row.outcome
    code = found.exit_code if found else None
    sign, mark = _SIGNS[code], _MARKS.get(code, "unobservable")
    if found is not None and code == 0 and (found.warnings or contradicted(found)):
        sign, mark = _CONTRADICTED if contradicted(found) else _WARNED
    bodies = found.bodies if found else []
    items = [item for body in bodies for item in body.items.values()]
    return {
        "number": number,
        "name": row.name,
        "link": _link(row.name, found),
        "log": row.log,
        "tags": ", ".join(row.tags),
        "vehicle": found.vehicle.name if found and found.vehicle else "",
        "state": state(found),
        "sign": sign,
        "mark": mark,
        "message": found.message if found else "",
        "parts": tuple(title(body) for body in bodies),
        "cells": tuple(tuple(_cell(body.items.get(name)) for body in bodies) for name in names),
        "mass": tuple(_cell(body.estimates["mass"]) for body in bodies),
        "verdicts": " ".join(dict.fromkeys(item.verdict for item in items)),
        "converged": sum(item.verdict == "converged" for item in items),
        "contradicted": contradicted(found),
        "estimates": len(items),
        "worst": worst(found.warnings) if found else "",
        "codes": " ".join(dict.fromkeys(found.warnings)) if found else "",
        "warnings": ", ".join(dict.fromkeys(found.warnings)) if found else "",
    }


def worst(codes: Sequence[str]) -> str:
    """The first warning about more than reading or noise levels; else the first; empty without any."""
    return next((code for code in codes if code not in _MINOR), codes[0] if codes else "")


def _link(name: str, found: Outcome | None) -> str:
    file = next((file for file in ("report.html", "result.json", CHECKED) if found and file in found.files), None)
    return f"{RESULTS}/{quote(name)}/{file}" if file else ""


def title(body: PhaseQuantities | Pool) -> str:
    """The name of a part of a log."""
    return body.name if body.part == "phase" else f"docked: {body.name}"


def _cell(item: Value | None) -> QuantityCell:
    if item is None:
        return QuantityCell("absent", "", digits.ABSENT, digits.ABSENT, "", missed=False, rough=False)
    value, sigma = _numbers(item.value, item.sigma, item.verdict)
    if item.value is None and item.sigma is not None:  # of a check
        sigma = digits.figures(item.sigma)
    key = "" if item.value is None else repr(item.value)
    return QuantityCell(item.verdict, vocabulary.SIGNS[item.verdict], value, sigma, key, item.met is False, item.verdict not in INFORMED)


@dataclass(frozen=True)
class PooledVehicle:
    """The pooled values of one vehicle's logs."""

    pool: Pool
    rows: list[dict[str, str]]
    figure: html.Figure


def _pools(found: Summary) -> list[PooledVehicle]:
    groups = grouped(found.logs) if found.pooled else {}
    told = []
    for number, pool in enumerate(found.pooled, 1):
        spread = figures.spreads(groups[Key.of(pool)])
        picture = html.drawn("pool", "Log by log", figures.picture(spread, pool), f"pool{number}")
        within = {name: f"{one.within} of {len(one.samples.value)}" for name, one in spread.items()}
        rows = [row | {"within": within.get(name, "–")} for name, row in zip(pool.items, pooled(pool), strict=True)]
        told.append(PooledVehicle(pool, rows, picture))
    return told


def _pooled(name: str, item: Pooled) -> dict[str, str]:
    value, sigma = _numbers(item.value, item.sigma)
    unlikely = item.p_value is not None and item.p_value < _UNLIKELY
    tilted = item.trend_per_log is not None and item.trend_sigma is not None and abs(item.trend_per_log) > 3.3 * item.trend_sigma
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
        "outliers": ", ".join(f"{stray.log} ({digits.minus(f'{stray.sigmas:+.1f}')} σ)" for stray in item.outliers) or "none",
        "without": digits.minus(digits.with_sigma(*item.without_outliers)) if item.without_outliers else "",
        "note": ", ".join(said for said, so in (("more scatter than claimed", unlikely), ("a trend", tilted)) if so),
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


def doubts(found: Pool) -> list[str]:
    """A sentence for each reason against pooling: where logs contradict each other, the sigma of their mean is not valid."""
    names = [name for name, item in found.items.items() if item.p_value is not None and item.p_value < _UNLIKELY]
    if not names:
        return []
    worst = max(found.items[name].scatter_ratio or 0.0 for name in names)
    files = f"; they have {found.vehicle_files} different vehicle files" if found.vehicle_files > 1 else ""
    return [
        f"{', '.join(names)}: the logs contradict each other, scattering up to {_short(worst)} times as far as they claim{files}. Do not "
        "use these means: either the vehicle changed, or a vehicle file is wrong"
    ]


def pooled(found: Pool) -> Sequence[dict[str, str]]:
    """Rows of a vehicle's table as text, for other pages than this."""
    return [_pooled(name, item) for name, item in found.items.items()]
