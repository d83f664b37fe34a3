"""A campaign as Markdown for a job's summary, within GitHub's limits for a step (docs.github.com, Workflow commands for GitHub Actions)."""

from collections.abc import Iterator
from pathlib import Path

from massprop_cli.base.escape import line
from massprop_cli.base.escape import markdown as shown
from massprop_cli.campaign import page
from massprop_cli.campaign.outcome import CampaignRow, contradicted, state
from massprop_cli.campaign.pooled import Pool
from massprop_cli.campaign.summary import Summary
from massprop_cli.report import markdown, vocabulary

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
        yield [*markdown.table(["log", "outcome", "why"], "lll")]
        yield from ([markdown.row([shown(row.name), state(row.outcome), shown(_message(row))])] for row in wrong)
        yield [""]
    if found.baseline is not None:
        beyond = found.baseline.beyond
        yield [f"Baseline: {found.baseline.compared} logs compared, {len(beyond) or 'nothing'} beyond.", ""]
        yield from ([f"- {shown(item.message)}"] for item in beyond)
        yield [""]
    for pool in found.pooled:
        yield _pool(pool)
    yield ["All logs:", "", *markdown.table(["log", "vehicle", "outcome", "converged", "warnings"], "lllrl")]
    yield from ([_all(row)] for row in found.logs)
    yield [""]


def _pool(pool: Pool) -> list[str]:
    columns = ["quantity", "weighted mean", "± sigma", "unit", "logs", "scatter / claimed", "p", "trend per log", "outliers"]
    keys = ("value", "sigma", "unit", "logs", "ratio", "p_value", "trend")
    doubts = [line for doubt in page.doubts(pool) for line in (f"⚠ {shown(doubt)}.", "")]
    rows = [markdown.row([shown(row["symbol"]), *(row[key] for key in keys), shown(row["outliers"])]) for row in page.pooled(pool)]
    return [f"### {shown(pool.vehicle)}, {shown(page.title(pool))}", "", *markdown.table(columns, "lrrlrrrrl"), *rows, "", *doubts]


def _all(row: CampaignRow) -> str:
    found = row.outcome
    items = [item for body in found.bodies for item in body.items.values()] if found else []
    converged = f"{sum(item.verdict == 'converged' for item in items)} of {len(items)}" if items else "–"
    vehicle = shown(found.vehicle.name) if found and found.vehicle else "–"
    return markdown.row(
        [shown(row.name), vehicle, state(row.outcome), converged, shown(", ".join(dict.fromkeys(found.warnings))) if found else ""]
    )


def _message(row: CampaignRow) -> str:
    if row.outcome is None:
        return ""
    codes = ", ".join(dict.fromkeys(row.outcome.warnings))
    return row.outcome.message or f"{contradicted(row.outcome)} quantities are contradicted{f' ({codes})' if codes else ''}"


MOST_BYTES = 1024 * 1024
"""Bytes of UTF-8 of a step's summary."""
ANNOTATIONS = 10


def append_summary(file: Path, found: Summary) -> None:
    """Add the campaign to a step's summary, in the room that is left there."""
    used = file.stat().st_size if file.exists() else 0
    kept = text(found, MOST_BYTES - used)
    with file.open("a", encoding="utf-8", newline="\n") as stream:
        stream.write(kept)


def commands(found: Summary) -> list[str]:
    """Workflow commands, ten at most: one for each log that isn't done, then for what is beyond the baseline."""
    said = [(row.name, row.outcome.message) for row in found.logs if row.outcome is not None and row.outcome.exit_code]
    said += [("beyond the baseline", item.message) for item in (found.baseline.beyond if found.baseline else ())]
    if len(said) > ANNOTATIONS:
        more = len(said) - ANNOTATIONS + 1
        said = [*said[: ANNOTATIONS - 1], (f"{found.name}: {more} more", f"{more} more are in the job's summary and in campaign.html")]
    titles = [_data(title).replace(":", "%3A").replace(",", "%2C") for title, _ in said]
    return [f"::error title={title}::{_data(message)}" for title, (_, message) in zip(titles, said, strict=True)]


def _data(text: str) -> str:
    """A message as the runner reads it back (actions/toolkit, command.ts)."""
    return line(text).replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
