"""The table that ``massprop estimate`` prints."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from massprop_cli.analysis import Analysis
from massprop_cli.conclude import Estimate
from massprop_cli.report import words
from massprop_cli.vehicle import Nominal

_STYLE = {"converged": "green", "not_converged": "yellow", "not_excited": "magenta", "unobservable": "red"}


def show(analysis: Analysis, console: Console) -> None:
    """Print one table per phase and docked object, with frame, reference point and sign convention beside it."""
    for conclusion in analysis.conclusions:
        phase = conclusion.phase
        title = f"{analysis.log.path.name}, phase {phase.name}, {phase.start_s:.6g} to {phase.end_s:.6g} s"
        console.print(_table(title, conclusion.estimates, analysis.vehicle.nominal))
    if analysis.docked is not None:
        docked = analysis.docked
        console.print(_table(f"docked object: phase {docked.after} less phase {docked.before}", docked.estimates))
    for line in _legend(analysis):
        console.print(line)


def _legend(analysis: Analysis) -> list[str]:
    bearing = analysis.vehicle.on_air_bearing
    lines = [
        f"{analysis.vehicle.name}, --method {analysis.vehicle.estimator.method}. Inertia of the "
        f"{'rotating body' if bearing else 'body'} about its CG in body axes; products are the tensor's own elements,",
        "ixy = −Σ m x y (positive-integral convention: opposite sign). CG from O in body axes. ± is one standard deviation."
        + (" Mass includes the bearing's." if bearing else ""),
    ]
    if analysis.vehicle.estimator.method == "thesis":
        lines.append("Sigmas of the thesis's filters are its “precision”: they shrink with noise alone and are no errors.")
    elif analysis.vehicle.thrust.scale_sigma == 0 and not analysis.vehicle.known:
        lines.append("Mass and inertia are proportional to the thrust that the vehicle file states; no uncertainty of it is stated.")
    return lines


def _table(title: str, estimates: dict[str, Estimate], nominal: Nominal | None = None) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    for name in ("quantity", "value", "± sigma", "unit", "verdict", "final at"):
        table.add_column(name, justify="right" if name in ("value", "± sigma", "final at") else "left")
    stated = {name: nominal.value(name) if nominal else None for name in estimates}
    if any(value is not None for value in stated.values()):
        table.add_column("nominal", justify="right")
    for name, estimate in estimates.items():
        value, sigma = words.numbers(estimate.value, estimate.sigma)
        final = "" if estimate.final_at_s is None else f"{estimate.final_at_s:.2f} s"
        verdict = f"[{_STYLE[estimate.verdict]}]{estimate.verdict}[/]"
        cells = [] if len(table.columns) == 6 else ["" if stated[name] is None else f"{stated[name]:g}"]
        table.add_row(name, value, sigma, words.unit(estimate.unit), verdict, final, *cells)
    return table
