"""The tables that ``massprop check`` prints."""

from rich.console import Console
from rich.table import Table

from massprop_cli.base import escape
from massprop_cli.check.finding import SUBJECTS, Check
from massprop_cli.report import digits, vocabulary
from massprop_cli.report.fit import fitted, titled

_STYLE = {"unusable": "bold red", "fault": "yellow", "note": "dim"}
_SIGNS = {"unusable": "✕", "fault": "‼", "note": "○"}


def show(found: Check, console: Console) -> None:
    """Print the findings, and the sigmas that an estimate of this log gives."""
    for one in found.findings:
        console.print(
            escape.rich(f"{_SIGNS[one.grade]} {one.grade}, {SUBJECTS[one.subject]}: {one.what} [{one.code}]"), style=_STYLE[one.grade]
        )
        more = [("where", one.where), ("how sure", one.sure), ("remedy", one.remedy)]
        for name, said in more:
            if said:
                console.print(f"    {name}: {escape.rich(said)}")
    if not found.findings:
        console.print(escape.rich(f"✓ {found.log}: no findings"))
    for phase in dict.fromkeys(one.phase for one in found.expected):
        fitted(_expected(found, phase), console)
    if found.delay:
        console.print(escape.rich(f"Delay that the log shows: {found.delay}."))
    if found.low_passes:
        console.print(escape.rich(f"Low-passes that the log shows: {'; '.join(found.low_passes)}."))
    if found.expected:
        console.print(
            "Inertia about the CG in body axes, products as tensor elements. ± is one standard deviation, as massprop estimate gives."
        )


def _expected(found: Check, phase: str) -> Table:
    columns, words = ("quantity", "± sigma", "± wanted", "unit", "verdict", "reached"), ("quantity", "unit", "verdict", "reached")
    table = titled(escape.rich(f"{found.log}, phase {phase}: expected sigmas"), columns, words)
    for one in found.expected:
        if one.phase != phase:
            continue
        reached = "" if one.reached is None else "[green]✓[/]" if one.reached else "[red]✗[/]"
        sigma = "–" if one.sigma is None else digits.figures(one.sigma)
        wanted = "" if one.wanted_sigma is None else digits.figures(one.wanted_sigma)
        table.add_row(one.quantity, sigma, wanted, vocabulary.unit(one.unit), one.verdict, reached)
    return table
