"""The table that ``massprop estimate`` prints."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

from massprop_cli.judge import INFORMED, contradiction
from massprop_cli.report import digits, words
from massprop_cli.report.foreign import line
from massprop_cli.report.result import DockedObject, EstimateItem, PhaseItem, Result

_STYLE = {"converged": "green", "not_converged": "yellow", "not_excited": "magenta", "contradicted": "bold red", "unobservable": "red"}
_NUMBERS = ("value", "± sigma", "final at", "nominal", "expected", "tolerance")


def show(found: Result, console: Console) -> None:
    """Print one table per phase and docked object, with frame, reference point and sign convention beside it."""
    for phase in found.phases:
        title = f"{found.log.path}, phase {phase.name}, {phase.start_s:.6g} to {phase.end_s:.6g} s"
        _part(title, phase, console)
    if found.docked_object is not None:
        docked = found.docked_object
        _part(f"docked object: phase {docked.after} less phase {docked.before}", docked, console)
    for told in _legend(found):
        console.print(escape(told))


def _part(title: str, body: PhaseItem | DockedObject, console: Console) -> None:
    fitted(_table(title, body.estimates), console)
    cause = contradiction(body)
    if cause:
        console.print(escape(f"contradicted: {line(cause)}"), style=_STYLE["contradicted"])


def fitted(table: Table, console: Console) -> None:
    """Print a table; without its lines where the terminal is too narrow for them, and beyond its edge before a number is cut short."""
    wide = console.options.update(width=10_000)
    terminal = console.width
    if Measurement.get(console, wide, table).maximum > terminal:
        table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
    console.width = max(terminal, Measurement.get(console, wide, table).minimum)
    console.print(table)
    console.width = terminal


def _legend(found: Result) -> list[str]:
    vehicle = found.vehicle
    bearing = vehicle.environment == "air_bearing"
    method = found.provenance.settings.get("estimator.method")
    lines = [
        f"{vehicle.name}, --method {method}. Inertia of the {'rotating body' if bearing else 'body'} about its CG in body axes; "
        "products are the tensor's own elements,",
        "ixy = −Σ m x y (positive-integral convention: opposite sign). CG from O in body axes. ± is one standard deviation."
        + (" Mass includes the bearing's." if bearing else ""),
    ]
    return [*lines, words.thrust_scale(found)]


def _table(title: str, estimates: dict[str, EstimateItem]) -> Table:
    table = Table(title=escape(title), title_justify="left", title_style="bold")
    nominal = any(item.nominal is not None for item in estimates.values())
    expected = any(item.expected is not None for item in estimates.values())
    names = ["quantity", "value", "± sigma", "unit", "verdict", "final at"]
    for name in [*names, *(["nominal"] if nominal else []), *(["expected", "tolerance", "met"] if expected else [])]:
        table.add_column(name, justify="right" if name in _NUMBERS else "left", no_wrap=True)
    for name, item in estimates.items():
        value, sigma = digits.numbers(item.value, item.sigma, item.verdict)
        final = "" if item.final_at_s is None else f"{item.final_at_s:.2f} s"
        verdict = f"[{_STYLE[item.verdict]}]{item.verdict}[/]"
        cells = [*([_nominal(item)] if nominal else []), *(_expected(item) if expected else [])]
        if item.verdict not in INFORMED:
            value, sigma = (f"[dim]{text}[/]" for text in (value, sigma))
        table.add_row(name, value, sigma, words.unit(item.unit), verdict, final, *cells)
    return table


def _nominal(item: EstimateItem) -> str:
    return "" if item.nominal is None else f"{item.nominal:g}"


def _expected(item: EstimateItem) -> tuple[str, str, str]:
    if item.expected is None:
        return "", "", ""
    return f"{item.expected.value:.9g}", words.unit(item.expected.stated), "[green]✓[/]" if item.expected.met else "[red]✗[/]"
