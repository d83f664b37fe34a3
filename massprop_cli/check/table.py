"""Terminal tables of ``massprop check``."""

from rich.console import Console
from rich.table import Table

from massprop_cli.base import escape
from massprop_cli.check.finding import SUBJECTS, Check
from massprop_cli.report import digits, vocabulary
from massprop_cli.report.fit import fitted, titled

_STYLE = {"unusable": "bold red", "fault": "yellow", "note": "dim"}
_SIGNS = {"unusable": "✕", "fault": "‼", "note": "○"}


def show(check: Check, console: Console) -> None:
    """Print the findings and the expected sigmas."""
    for one in check.findings:
        console.print(
            escape.rich(f"{_SIGNS[one.grade]} {one.grade}, {SUBJECTS[one.subject]}: {one.what} [{one.code}]"), style=_STYLE[one.grade]
        )
        more = [("where", one.where), ("how sure", one.sure), ("remedy", one.remedy)]
        for name, text in more:
            if text:
                console.print(f"    {name}: {escape.rich(text)}")
    if not check.findings:
        console.print(escape.rich(f"✓ {check.log}: no findings"))
    for phase in dict.fromkeys(one.phase for one in check.expected):
        fitted(_expected(check, phase), console)
    if check.delay:
        console.print(escape.rich(f"Delay that the log shows: {check.delay}."))
    if check.low_passes:
        console.print(escape.rich(f"Low-passes that the log shows: {'; '.join(check.low_passes)}."))
    if check.expected:
        console.print(
            "Inertia about the CG in body axes, products as tensor elements. ± is one standard deviation, as massprop estimate gives."
        )


def _expected(check: Check, phase: str) -> Table:
    columns, words = ("quantity", "± sigma", "± wanted", "unit", "verdict", "reached"), ("quantity", "unit", "verdict", "reached")
    table = titled(escape.rich(f"{check.log}, phase {phase}: expected sigmas"), columns, words)
    for one in check.expected:
        if one.phase != phase:
            continue
        reached = "" if one.reached is None else "[green]✓[/]" if one.reached else "[red]✗[/]"
        sigma = "–" if one.sigma is None else digits.figures(one.sigma)
        wanted = "" if one.wanted_sigma is None else digits.figures(one.wanted_sigma)
        table.add_row(one.quantity, sigma, wanted, vocabulary.unit(one.unit), one.verdict, reached)
    return table
