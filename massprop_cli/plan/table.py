"""Terminal tables of ``massprop plan``."""

from rich.console import Console
from rich.table import Table

from massprop_cli.base import escape
from massprop_cli.plan import limits as limited
from massprop_cli.plan.document import LimitItem, PlanFile, QuantityItem
from massprop_cli.report import digits, vocabulary
from massprop_cli.report.fit import fitted, titled

MOST_INFORMED = 4
"""Largest number of quantities listed for a motion."""


def show(plan: PlanFile, console: Console) -> None:
    """Print the quantities, the timeline, the limits, and the legend."""
    fitted(_quantities(plan), console, [*reversed(longer(plan)), "guess"])
    fitted(_timeline(plan), console)
    fitted(_limits(plan), console)
    for line in legend(plan):
        console.print(escape.rich(line))


def _quantities(plan: PlanFile) -> Table:
    columns = ("quantity", "guess", "± predicted", "± at worst", "± wanted", "unit", "reached at", *longer(plan))
    table = titled(escape.rich(f"{plan.vehicle}: a plan of {plan.duration_s:g} s"), columns, ("quantity", "unit"))
    for name, item in plan.quantities.items():
        table.add_row(name, *cells(item), *further(item))
    return table


def further(item: QuantityItem) -> list[str]:
    """Cells of the sigmas after longer durations."""
    return [digits.figures(sigma) if item.told == "well" else "–" for sigma in item.longer.values()]


def longer(plan: PlanFile) -> list[str]:
    """Headings of the columns for longer durations."""
    return [f"± in {float(factor) * plan.duration_s:g} s" for factor in next(iter(plan.quantities.values())).longer]


def cells(item: QuantityItem) -> list[str]:
    """Cells: guess, predicted, worst and wanted sigma, unit, time at which the goal is reached."""
    wanted = "" if item.wanted_sigma is None else digits.figures(item.wanted_sigma)
    reached = "" if item.wanted is None else "not" if item.reached_at_s is None else f"{item.reached_at_s:.2f} s"
    sigmas = [digits.figures(item.sigma), digits.figures(item.worst_sigma)] if item.told == "well" else [item.told, "–"]
    return [digits.stated(item.guess), *sigmas, wanted, vocabulary.unit(item.unit), reached]


def _timeline(plan: PlanFile) -> Table:
    table = titled("timeline", ("from", "to"), ())
    table.add_column("motion")
    table.add_column("informs (factor on sigma without it)")
    for item in plan.timeline:
        table.add_row(f"{item.start_s:g} s", f"{item.end_s:g} s", item.motion, informed(item.teaches))
    return table


def informed(teaches: dict[str, float]) -> str:
    """The quantities whose sigma would increase most without the motion, with the factor."""
    most = sorted(teaches.items(), key=lambda pair: -pair[1])[:MOST_INFORMED]
    return ", ".join(f"{name} {'> 100 ×' if factor > 100 else f'{factor:.2g} ×'}" for name, factor in most) or "little"


def _limits(plan: PlanFile) -> Table:
    table = titled("limits", ("limit", "used", "allowed", "unit"), ("limit", "unit"))
    for name, item in plan.limits.items():
        table.add_row(limited.LIMITS[name][0], *limit(item))
    return table


def limit(item: LimitItem) -> tuple[str, str, str]:
    """Cells: used, allowed, unit."""
    allowed = "–" if item.allowed is None else digits.stated(item.allowed)
    return digits.figures(item.used, 3), allowed, vocabulary.unit(item.unit)


def legend(plan: PlanFile) -> list[str]:
    """Lines that define the numbers, and the notes."""
    unobservable = [name for name, item in plan.quantities.items() if item.told == "by no motion of this vehicle"]
    return [
        "Inertia about the CG in body axes; products are the tensor's own elements, ixy = -Σ m x y. CG from O in body axes. "
        f"± is one standard deviation: the Cramér–Rao bound of the plan flown in software. At worst: over {plan.bodies} bodies that the "
        f"vehicle may be (guess: {plan.guess}).",
        *([f"No motion of this vehicle makes {', '.join(unobservable)} observable."] if unobservable else []),
        *(f"Note: {note}." for note in plan.notes),
    ]
