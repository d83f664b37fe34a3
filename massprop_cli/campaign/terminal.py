"""What ``massprop batch`` prints: what each vehicle's logs say together."""

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
_SPARE = ("p", "trend per log", "logs")
"""What a narrow terminal goes without: campaign.html has all of it."""
NAMED = 3
"""Outliers that a cell names."""


def show(found: Summary, console: Console) -> None:
    """Print a table per vehicle and part, and the counts."""
    for pool in found.pooled:
        fitted(_table(pool), console, _SPARE)
        for doubt in page.doubts(pool):
            console.print(escape.rich(f"⚠ {doubt}."), style="yellow")
    if found.pooled:
        console.print(
            "Means are weighted by the variance of each log; errors that all logs share (thrust scale, known quantities, vehicle file) do "
            "not average out."
        )
        console.print(
            "Scatter over claimed sigma is 1 if sigmas are right and the vehicle did not change; p is the chance of at least this scatter."
        )
    for row in found.combined:
        console.print(escape.rich(f"combined into {row.name} ({row.log}): {page.told_of(row)}"))
    style = "bold red" if found.contradicted else ""
    console.print(escape.rich(f"{len(found.logs)} log{'s' if len(found.logs) != 1 else ''}: {page.counts(found)}"), style=style)


def _table(pool: Pool) -> Table:
    table = titled(escape.rich(f"{pool.vehicle}, {page.title(pool)}"), list(_COLUMNS.values()), _WORDS)
    table.columns[-1].no_wrap = False
    for (name, item), row in zip(pool.items.items(), page.pooled(pool), strict=True):
        more = f" and {len(item.outliers) - NAMED} more" if len(item.outliers) > NAMED else ""
        stray = f"{', '.join(row['outliers'].split(', ')[:NAMED])}{more}" if item.outliers else "none"
        table.add_row(
            name, *(escape.rich(_plain(row[key])) for key in _COLUMNS if key not in ("symbol", "outliers")), escape.rich(_plain(stray))
        )
    return table


def _plain(text: str) -> str:
    """The text with the minus sign that other programs read."""
    return text.replace("−", "-")
