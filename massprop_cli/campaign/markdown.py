"""A campaign as Markdown, for the summary of a job."""

from __future__ import annotations

from collections.abc import Iterator

from massprop_cli.base.escape import markdown as shown
from massprop_cli.campaign import page
from massprop_cli.campaign.outcome import contradicted, state
from massprop_cli.campaign.pooled import Pool
from massprop_cli.campaign.rows import Row
from massprop_cli.campaign.summary import Summary
from massprop_cli.report import vocabulary

_ROOM = 400
"""Bytes kept for saying what was left out."""


def text(found: Summary, largest: int) -> str:
    """Counts, what went wrong, pooled values, all logs: as many whole rows as fit into ``largest`` bytes of UTF-8."""
    kept: list[str] = []
    left, dropped = largest - _ROOM, 0
    for block in _blocks(found):
        size = sum(len(line.encode()) + 1 for line in block)
        if size > left or dropped:
            dropped += 1
        else:
            kept += block
            left -= size
    if dropped and largest >= _ROOM:
        kept += ["", f"{dropped} rows are left out here to keep the job's summary within its limit; campaign.html has them all.", ""]
    return "".join(f"{line}\n" for line in kept)


def _blocks(found: Summary) -> Iterator[list[str]]:
    """Pieces that are kept whole, the most important first; a row of a table is one."""
    sign = "✗" if found.exit_code else vocabulary.SIGNS["contradicted"] if found.contradicted else "⚠" if found.warned else "✓"
    yield [f"## {sign} {shown(found.name)}: {len(found.logs)} logs", "", f"{page.counts(found)}.", ""]
    wrong = [row for row in found.logs if row.outcome is None or row.outcome.exit_code or contradicted(row.outcome)]
    if wrong:
        yield [*_head(["log", "outcome", "why"], "lll")]
        yield from ([_row([shown(row.name), state(row.outcome), shown(_message(row))])] for row in wrong)
        yield [""]
    if found.baseline is not None:
        beyond = found.baseline.beyond
        yield [f"Baseline: {found.baseline.compared} logs compared, {len(beyond) or 'nothing'} beyond.", ""]
        yield from ([f"- {shown(item.message)}"] for item in beyond)
        yield [""]
    for pool in found.pooled:
        yield _pool(pool)
    yield ["All logs:", "", *_head(["log", "vehicle", "outcome", "converged", "warnings"], "lllrl")]
    yield from ([_all(row)] for row in found.logs)
    yield [""]


def _pool(pool: Pool) -> list[str]:
    columns = ["quantity", "weighted mean", "± sigma", "unit", "logs", "scatter / claimed", "p", "trend per log", "outliers"]
    keys = ("value", "sigma", "unit", "logs", "ratio", "p_value", "trend")
    rows = [_row([shown(row["symbol"]), *(row[key] for key in keys), shown(row["outliers"])]) for row in page.pooled(pool)]
    return [f"### {shown(pool.vehicle)}, {shown(page.title(pool))}", "", *_head(columns, "lrrlrrrrl"), *rows, "", *_doubts(pool)]


def _doubts(pool: Pool) -> list[str]:
    return [line for doubt in page.doubts(pool) for line in (f"⚠ {shown(doubt)}.", "")]


def _all(row: Row) -> str:
    found = row.outcome
    items = [item for body in found.bodies for item in body.estimates.values()] if found else []
    converged = f"{sum(item.verdict == 'converged' for item in items)} of {len(items)}" if items else "–"
    vehicle = shown(found.vehicle.name) if found and found.vehicle else "–"
    return _row([shown(row.name), vehicle, state(row.outcome), converged, shown(", ".join(dict.fromkeys(found.warnings))) if found else ""])


def _message(row: Row) -> str:
    if row.outcome is None:
        return ""
    codes = ", ".join(dict.fromkeys(row.outcome.warnings))
    return row.outcome.message or f"{contradicted(row.outcome)} quantities are contradicted{f' ({codes})' if codes else ''}"


def _head(columns: list[str], sides: str) -> list[str]:
    return [_row(columns), _row(["--:" if side == "r" else "---" for side in sides])]


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"
