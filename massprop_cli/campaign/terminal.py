"""Terminal output of ``massprop batch``: the pooled values of each vehicle, and the number of logs by outcome."""

from rich.console import Console
from rich.table import Table

from massprop_cli.base import escape
from massprop_cli.campaign import page
from massprop_cli.campaign.pooled import Pool
from massprop_cli.campaign.summary import Summary
from massprop_cli.report.fit import fitted, titled

_COLUMNS = {
    "symbol": "quantity", "value": "weighted mean", "sigma": "± sigma", "unit": "unit", "logs": "logs",
    "ratio": "scatter/claimed", "p_value": "p", "trend": "trend per log", "outliers": "outliers",
}  # fmt: skip
_WORDS = ("quantity", "unit", "outliers")
_OPTIONAL = ("p", "trend per log", "logs")
"""Columns omitted on a narrow terminal."""
NAMED = 3
"""Largest number of outliers in a cell."""


def show(summary: Summary, console: Console) -> None:
    """Print a table per vehicle and part, and the counts."""
    for pool in summary.pooled:
        fitted(_table(pool), console, _OPTIONAL)
        for doubt in page.doubts(pool):
            console.print(escape.rich(f"⚠ {doubt}."), style="yellow")
    if summary.pooled:
        console.print(
            "Means are weighted by the variance of each log; errors that all logs share (thrust scale, known quantities, vehicle file) do "
            "not average out."
        )
        console.print(
            "Scatter over claimed sigma is 1 if sigmas are right and the vehicle did not change; p is the chance of at least this scatter."
        )
    for row in summary.combined:
        console.print(escape.rich(f"combined into {row.name} ({row.log}): {page.outcome_text(row)}"))
    style = "bold red" if summary.contradicted else ""
    count = len(summary.logs)
    console.print(escape.rich(f"{count} log{'s' if count != 1 else ''}: {page.counts(summary)}"), style=style)


def _table(pool: Pool) -> Table:
    table = titled(escape.rich(f"{pool.vehicle}, {page.title(pool)}"), list(_COLUMNS.values()), _WORDS)
    table.columns[-1].no_wrap = False
    for (name, item), row in zip(pool.items.items(), page.pooled(pool), strict=True):
        more = f" and {len(item.outliers) - NAMED} more" if len(item.outliers) > NAMED else ""
        outliers = f"{', '.join(row['outliers'].split(', ')[:NAMED])}{more}" if item.outliers else "none"
        numbers = (escape.rich(_plain(row[key])) for key in _COLUMNS if key not in ("symbol", "outliers"))
        table.add_row(name, *numbers, escape.rich(_plain(outliers)))
    return table


def _plain(text: str) -> str:
    """The text with hyphens as minus signs, which other programs can read."""
    return text.replace("−", "-")
