"""The table that ``massprop estimate`` prints."""

from __future__ import annotations

import math

from rich.console import Console
from rich.table import Table

from massprop_cli.analysis import Analysis
from massprop_cli.conclude import Conclusion, Estimate

_STYLE = {"converged": "green", "not_converged": "yellow", "not_excited": "magenta", "unobservable": "red"}


def show(analysis: Analysis, console: Console) -> None:
    """Print one table per phase, with frame, reference point and sign convention beside it."""
    for conclusion in analysis.conclusions:
        console.print(_table(analysis, conclusion))
    body = "rotating body" if analysis.vehicle.on_air_bearing else "vehicle"
    console.print(
        f"Inertia of the {body} about its CG, body axes; products are the tensor's own elements, ixy = −Σ m x y (positive-integral"
    )
    console.print("convention: opposite sign). CG from O in body axes. ± is one standard deviation.", end="")
    console.print(" Mass includes the bearing's." if analysis.vehicle.on_air_bearing else "")
    if analysis.vehicle.thrust.scale_sigma == 0 and not analysis.vehicle.known:
        console.print("Mass and inertia are proportional to the thrust that the vehicle file states (no uncertainty of it is stated).")


def _table(analysis: Analysis, conclusion: Conclusion) -> Table:
    phase = conclusion.phase
    title = f"{analysis.vehicle.name}: {analysis.log.path.name}, phase {phase.name}, {phase.start_s:g} to {phase.end_s:g} s"
    table = Table(title=title, title_justify="left", title_style="bold")
    for name, justify in (
        ("quantity", "left"),
        ("value", "right"),
        ("± sigma", "right"),
        ("unit", "left"),
        ("verdict", "left"),
        ("final at", "right"),
    ):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for name, estimate in conclusion.estimates.items():
        value, sigma = numbers(estimate)
        final = "" if estimate.final_at_s is None else f"{estimate.final_at_s:.2f} s"
        style = _STYLE[estimate.verdict]
        table.add_row(name, value, sigma, estimate.unit.replace("^2", "²"), f"[{style}]{estimate.verdict}[/]", final)
    return table


def numbers(estimate: Estimate) -> tuple[str, str]:
    """Value and sigma with as many decimals as two figures of the sigma have."""
    if estimate.value is None or estimate.sigma is None:
        return "–", "–"
    if not estimate.sigma > 0:
        return f"{estimate.value:.6g}", f"{estimate.sigma:.2g}"
    decimals = 1 - math.floor(math.log10(estimate.sigma))
    if decimals > 7:
        return f"{estimate.value:.{max(decimals + math.floor(math.log10(abs(estimate.value) or 1)), 1)}e}", f"{estimate.sigma:.1e}"
    return f"{estimate.value:.{max(decimals, 0)}f}", f"{estimate.sigma:.{max(decimals, 0)}f}"
