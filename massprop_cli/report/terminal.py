"""The table that ``massprop estimate`` prints."""

from rich.console import Console
from rich.table import Table

from massprop_cli.base import escape
from massprop_cli.report import assumptions, digits, timing, view, vocabulary
from massprop_cli.report.fit import fitted, titled
from massprop_cli.result.judge import INFORMED, contradiction
from massprop_cli.result.schema import DockedObject, EstimateItem, Mended, PhaseItem, Result

_STYLE = {"converged": "green", "not_converged": "yellow", "not_excited": "magenta", "contradicted": "bold red", "unobservable": "red"}
_MET = {"✓": "[green]✓[/]", "✗": "[red]✗[/]"}
_WORDS = ("quantity", "unit", "verdict", "met")
_SPARE = ("final at", "nominal", "tolerance")
"""What a narrow terminal goes without, first things first: result.json and the report have all of it."""


def show(found: Result, console: Console) -> None:
    """Print one table per phase and docked object, with frame, reference point and sign convention beside it."""
    for phase in found.phases:
        title = f"{found.log.path}, phase {phase.name}, {_time(phase.start_s)} to {_time(phase.end_s)} s"
        _part(title, phase, found, console)
    if found.docked_object is not None:
        docked = found.docked_object
        _part(f"docked object: phase {docked.after} less phase {docked.before}", docked, found, console)
    for told in _legend(found):
        console.print(escape.rich(told))
    shown = timing.automatic(found)
    if shown:
        console.print(escape.rich(f"Estimated from the log: {'; '.join(shown)}."))
    for one in found.mended:
        _mended(one, console)
    _assumptions(found, console)


def _part(title: str, body: PhaseItem | DockedObject, found: Result, console: Console) -> None:
    fitted(_table(title, body.estimates, assumptions.sigma_heading(found)), console, _SPARE)
    if isinstance(body, PhaseItem) and body.about_pivot:
        fitted(_table(vocabulary.ABOUT_PIVOT, body.about_pivot, assumptions.sigma_heading(found)), console, _SPARE)
    implied = assumptions.implied_thrust(body)
    if implied:
        console.print(escape.rich(f"{implied[0].upper()}{implied[1:]}."))
    cause = contradiction(body)
    if cause:
        console.print(escape.rich(f"contradicted: {cause}"), style=_STYLE["contradicted"])
    gaps: dict[tuple[str, str], list[str]] = {}
    for name, item in body.estimates.items():
        if item.verdict not in ("converged", "contradicted"):
            # a docked object has no motion of its own that would remedy it
            why = vocabulary.gap(name, item, cause) if isinstance(body, PhaseItem) else f"{item.verdict}: {item.reason}"
            gaps.setdefault((why, item.verdict), []).append(name)
    for (why, verdict), names in gaps.items():
        console.print(escape.rich(f"{', '.join(names)} {why}"), style=_STYLE[verdict])


def _mended(one: Mended, console: Console) -> None:
    console.print()
    console.print(escape.rich(f"{view.CORRECTED} (not the result): {one.message} [{one.code}]"), style="bold")
    for phase in one.phases:
        table = titled(escape.rich(f"corrected, phase {phase.name}"), ("quantity", "value", "± sigma", "unit", "verdict"), _WORDS, "dim")
        for name, value, sigma, unit, verdict in view.corrected(phase):
            table.add_row(escape.rich(name), *_dimmed(verdict, value, sigma), unit, f"[{_STYLE[verdict]}]{verdict}[/]")
        fitted(table, console)
        if phase.contradiction:
            console.print(escape.rich(view.still_contradicted(phase)), style=_STYLE["contradicted"])
    for option in view.corrections(one):
        console.print(f"  {escape.rich(option)}", soft_wrap=True)
    if not one.whole:
        console.print(view.beyond_options(one))


def _assumptions(found: Result, console: Console) -> None:
    if not found.assumptions:
        return
    console.print()
    console.print("Assumptions behind the values", style="bold")
    shown = assumptions.open_ones(found)
    for assumption in shown:
        console.print(escape.rich(f"- {assumptions.said(assumption)}"))
    if len(shown) < len(found.assumptions):
        console.print(f"- {len(found.assumptions) - len(shown)} more that the vehicle file states are in result.json and in the report")
    for one in assumptions.sensitivities(shown):
        steps = [f"{escape.rich(code)}\n{escape.rich(step)}" for code, step in one.steps]
        table = titled(escape.rich(f"change of the values for one step, phase {one.phase}"), ["quantity", *steps, "unit"], _WORDS, "dim")
        for name, unit, changes in one.rows:
            table.add_row(name, *changes, unit)
        table.add_row("noticed?", *one.noticed, "")
        fitted(table, console, steps[:0:-1])


def _dimmed(verdict: str, *texts: str) -> tuple[str, ...]:
    return texts if verdict in INFORMED else tuple(f"[dim]{text}[/]" for text in texts)


def _legend(found: Result) -> list[str]:
    vehicle = found.vehicle
    bearing = vehicle.environment == "air_bearing"
    method = found.provenance.method
    lines = [
        f"{vehicle.name}, --method {method}. Inertia of the {'rotating body' if bearing else 'body'} about its CG in body axes; "
        "products are the tensor's own elements,",
        "ixy = -Σ m x y (positive-integral convention: opposite sign). CG from O in body axes. ± is one standard deviation."
        + (" Mass includes the bearing's." if bearing else ""),
        *([vocabulary.ON_TABLE] if vehicle.environment == "planar" else []),
        *([vocabulary.ON_PEDESTAL] if vehicle.environment == "pedestal" else []),
    ]
    return [*lines, vocabulary.thrust_scale(found)]


def _table(title: str, estimates: dict[str, EstimateItem], heading: str) -> Table:
    columns = view.texts(estimates, heading)
    table = titled(escape.rich(title), [*columns], _WORDS)
    for name, value, sigma, unit, verdict, *more in zip(*columns.values(), strict=True):
        marked = [_MET.get(cell, cell) for cell in more]
        table.add_row(name, *_dimmed(verdict, value, sigma), unit, f"[{_STYLE[verdict]}]{verdict}[/]", *marked)
    return table


def _time(seconds: float) -> str:
    """A time to 0.1 ms; smaller parts of a clock's start are rounding."""
    return digits.stated(round(seconds, 4))
