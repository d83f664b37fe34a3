"""A campaign as Markdown for the summary of a GitHub Actions step, and as workflow commands.

Both respect GitHub's limits (docs.github.com, Workflow commands for GitHub Actions).
"""

from collections.abc import Iterator
from pathlib import Path

from massprop_cli.base.escape import line
from massprop_cli.base.escape import markdown as shown
from massprop_cli.campaign import page
from massprop_cli.campaign.outcome import CampaignRow, contradicted, state
from massprop_cli.campaign.pooled import Pool
from massprop_cli.campaign.summary import Summary
from massprop_cli.report import markdown, vocabulary

_RESERVED = 400
"""Bytes for the sentence on omitted rows."""


def text(summary: Summary, largest: int) -> str:
    """Counts, failures, pooled values and all logs: as many whole rows as ``largest`` bytes of UTF-8 allow."""
    kept: list[str] = []
    free, dropped = largest - _RESERVED, 0
    for block in _blocks(summary):
        size = sum(len(line.encode()) + 1 for line in block)
        if size > free or dropped:
            dropped += 1
        else:
            kept += block
            free -= size
    if dropped and largest >= _RESERVED:
        kept += ["", f"{dropped} rows are left out here to keep the job's summary within its limit; campaign.html has them all.", ""]
    return "".join(f"{line}\n" for line in kept)


def _blocks(summary: Summary) -> Iterator[list[str]]:
    """Blocks of lines that are not divided, the most important first; each table row is a block."""
    sign = "✗" if summary.exit_code else vocabulary.SIGNS["contradicted"] if summary.contradicted else "⚠" if summary.warned else "✓"
    yield [f"## {sign} {shown(summary.name)}: {len(summary.logs)} logs", "", f"{page.counts(summary)}.", ""]
    failed = [row for row in summary.logs if row.outcome is None or row.outcome.exit_code or contradicted(row.outcome)]
    if failed:
        yield [*markdown.table(["log", "outcome", "why"], "lll")]
        yield from ([markdown.row([shown(row.name), state(row.outcome), shown(_message(row))])] for row in failed)
        yield [""]
    if summary.baseline is not None:
        beyond = summary.baseline.beyond
        yield [f"Baseline: {summary.baseline.compared} logs compared, {len(beyond) or 'nothing'} beyond.", ""]
        yield from ([f"- {shown(item.message)}"] for item in beyond)
        yield [""]
    for pool in summary.pooled:
        yield _pool(pool)
    yield ["All logs:", "", *markdown.table(["log", "vehicle", "outcome", "converged", "warnings"], "lllrl")]
    yield from ([_log_row(row)] for row in summary.logs)
    yield [""]


def _pool(pool: Pool) -> list[str]:
    """The table of one vehicle's pooled values."""
    columns = ["quantity", "weighted mean", "± sigma", "unit", "logs", "scatter / claimed", "p", "trend per log", "outliers"]
    keys = ("value", "sigma", "unit", "logs", "ratio", "p_value", "trend")
    doubts = [line for doubt in page.doubts(pool) for line in (f"⚠ {shown(doubt)}.", "")]
    rows = [markdown.row([shown(row["symbol"]), *(row[key] for key in keys), shown(row["outliers"])]) for row in page.pooled(pool)]
    return [f"### {shown(pool.vehicle)}, {shown(page.title(pool))}", "", *markdown.table(columns, "lrrlrrrrl"), *rows, "", *doubts]


def _log_row(row: CampaignRow) -> str:
    """The row of one log in the table of all logs."""
    outcome = row.outcome
    items = [item for body in outcome.bodies for item in body.items.values()] if outcome else []
    converged = f"{sum(item.verdict == 'converged' for item in items)} of {len(items)}" if items else "–"
    vehicle = shown(outcome.vehicle.name) if outcome and outcome.vehicle else "–"
    warnings = shown(", ".join(dict.fromkeys(outcome.warnings))) if outcome else ""
    return markdown.row([shown(row.name), vehicle, state(outcome), converged, warnings])


def _message(row: CampaignRow) -> str:
    """Why a log failed, or the number of its contradicted quantities."""
    if row.outcome is None:
        return ""
    codes = ", ".join(dict.fromkeys(row.outcome.warnings))
    return row.outcome.message or f"{contradicted(row.outcome)} quantities are contradicted{f' ({codes})' if codes else ''}"


MOST_BYTES = 1024 * 1024
"""GitHub's limit for the summary of a step, bytes of UTF-8."""
ANNOTATIONS = 10
"""GitHub's limit for the error annotations of a step."""


def append_summary(file: Path, summary: Summary) -> None:
    """Append the campaign to a step's summary, within the limit for the whole file."""
    used = file.stat().st_size if file.exists() else 0
    kept = text(summary, MOST_BYTES - used)
    with file.open("a", encoding="utf-8", newline="\n") as stream:
        stream.write(kept)


def commands(summary: Summary) -> list[str]:
    """Workflow commands, at most :data:`ANNOTATIONS`: one per failed log, then one per difference from the baseline."""
    errors = [(row.name, row.outcome.message) for row in summary.logs if row.outcome is not None and row.outcome.exit_code]
    errors += [("beyond the baseline", item.message) for item in (summary.baseline.beyond if summary.baseline else ())]
    if len(errors) > ANNOTATIONS:
        more = len(errors) - ANNOTATIONS + 1
        errors = [
            *errors[: ANNOTATIONS - 1],
            (f"{summary.name}: {more} more", f"{more} more are in the job's summary and in campaign.html"),
        ]
    titles = [_escaped(title).replace(":", "%3A").replace(",", "%2C") for title, _ in errors]
    return [f"::error title={title}::{_escaped(message)}" for title, (_, message) in zip(titles, errors, strict=True)]


def _escaped(text: str) -> str:
    """A message escaped as actions/toolkit does (command.ts)."""
    return line(text).replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
