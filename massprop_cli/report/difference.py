"""Terminal tables of ``massprop compare``."""

from rich.console import Console
from rich.table import Table

from massprop_cli.base import escape
from massprop_cli.report import digits, vocabulary
from massprop_cli.report.fit import fitted, titled
from massprop_cli.result.compare import ComparedPart, Comparison, Difference
from massprop_cli.result.judge import INFORMED

_COLUMNS = ("quantity", "result", "baseline", "difference", "± sigma", "sigmas", "unit", "allowed", "within")
_OPTIONAL = ("allowed", "± sigma", "baseline")
"""Columns omitted on a narrow terminal, in this order."""


def show(comparison: Comparison, console: Console) -> None:
    """Print a table per phase and docked object, and a legend."""
    console.print(escape.rich(f"{comparison.result.path} against the baseline {comparison.baseline.path}"))
    for part in comparison.parts:
        fitted(_table(part), console, _OPTIONAL)
    for line in (
        "Inertia about the CG in body axes; products are the tensor's own elements, ixy = -Σ m x y. CG from O in body axes.",
        "± is one standard deviation of the difference, sqrt(s1² + s2²); what both results share is not taken into account.",
        *(f"Note: {note}." for note in comparison.notes),
    ):
        console.print(escape.rich(line))


def _table(part: ComparedPart) -> Table:
    table = titled(escape.rich(part.title), _COLUMNS, ("quantity", "unit", "within"))
    table.columns[-1].no_wrap = False
    for name, d in part.differences.items():
        sign = "[red]✗[/]" if not d.within else "–" if d.difference is None else "[green]✓[/]"
        table.add_row(name, *_cells(d), vocabulary.unit(d.unit), vocabulary.unit(d.stated), f"{sign} {escape.rich(d.note)}".rstrip())
    return table


def _cells(d: Difference) -> list[str]:
    """Cells: value, baseline value, difference, its sigma, difference in sigmas."""
    sigmas = "–" if d.sigmas is None else f"{d.sigmas:+.2f}" if abs(d.sigmas) < 1e4 else f"{d.sigmas:+.1e}".replace("e+0", "e+")
    difference, sigma = digits.numbers(d.difference, d.difference_sigma)
    if d.difference == 0 or (d.difference is not None and d.difference_sigma is None):
        difference = digits.stated(d.difference, 6)
    return [_value(d.value, d.sigma, d.verdict), _value(d.baseline_value, d.baseline_sigma, d.baseline_verdict), difference, sigma, sigmas]


def _value(value: float | None, sigma: float | None, verdict: str) -> str:
    text = digits.numbers(value, sigma, verdict)[0]
    return text if verdict in INFORMED else f"[dim]{text}[/]"
