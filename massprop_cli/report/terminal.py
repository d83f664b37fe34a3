"""Terminal output of ``massprop estimate``."""

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
_OPTIONAL = ("final at", "nominal", "tolerance")
"""Columns omitted on a narrow terminal, in this order."""


def show(found: Result, console: Console) -> None:
    """Print a table per phase and docked object, the conventions, corrected estimates and assumptions."""
    for phase in found.phases:
        title = f"{found.log.path}, phase {phase.name}, {_time(phase.start_s)} to {_time(phase.end_s)} s"
        _part(title, phase, found, console)
    if found.docked_object is not None:
        docked = found.docked_object
        _part(f"docked object: phase {docked.after} less phase {docked.before}", docked, found, console)
    for line in _legend(found):
        console.print(escape.rich(line))
    estimated = timing.automatic(found)
    if estimated:
        console.print(escape.rich(f"Estimated from the log: {'; '.join(estimated)}."))
    for one in found.mended:
        _corrected(one, console)
    _assumptions(found, console)


def _part(title: str, body: PhaseItem | DockedObject, found: Result, console: Console) -> None:
    """Print the tables of a phase or docked object, with remedies for quantities that are not converged."""
    fitted(_table(title, body.estimates, assumptions.sigma_heading(found)), console, _OPTIONAL)
    if isinstance(body, PhaseItem) and body.about_pivot:
        fitted(_table(vocabulary.ABOUT_PIVOT, body.about_pivot, assumptions.sigma_heading(found)), console, _OPTIONAL)
    implied = assumptions.implied_thrust(body)
    if implied:
        console.print(escape.rich(f"{implied[0].upper()}{implied[1:]}."))
    cause = contradiction(body)
    if cause:
        console.print(escape.rich(f"contradicted: {cause}"), style=_STYLE["contradicted"])
    gaps: dict[tuple[str, str], list[str]] = {}
    for name, item in body.estimates.items():
        if item.verdict not in ("converged", "contradicted"):
            # no motion of the docked object alone can be commanded, so the text has no remedy
            why = vocabulary.gap(name, item, cause) if isinstance(body, PhaseItem) else f"{item.verdict}: {item.reason}"
            gaps.setdefault((why, item.verdict), []).append(name)
    for (why, verdict), names in gaps.items():
        console.print(escape.rich(f"{', '.join(names)} {why}"), style=_STYLE[verdict])


def _corrected(one: Mended, console: Console) -> None:
    """Print a corrected estimate with the options that give it."""
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
    """Print the unverified assumptions, with the sensitivity of the values to each."""
    if not found.assumptions:
        return
    console.print()
    console.print("Assumptions behind the values", style="bold")
    shown = assumptions.unverified(found)
    for assumption in shown:
        console.print(escape.rich(f"- {assumptions.sentence(assumption)}"))
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
    """The texts, dimmed without a usable verdict."""
    return texts if verdict in INFORMED else tuple(f"[dim]{text}[/]" for text in texts)


def _legend(found: Result) -> list[str]:
    """Lines that define the numbers."""
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
    """A time to 0.1 ms; smaller digits of a time in epoch seconds are rounding errors."""
    return digits.stated(round(seconds, 4))
