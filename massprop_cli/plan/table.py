"""The tables that ``massprop plan`` prints."""

from rich.console import Console
from rich.table import Table

from massprop_cli.base import escape
from massprop_cli.plan import limits as limited
from massprop_cli.plan.document import LimitItem, PlanFile, QuantityItem
from massprop_cli.report import digits, vocabulary
from massprop_cli.report.fit import fitted, titled

FEW = 4
"""Quantities that a stretch is said to teach."""


def show(found: PlanFile, console: Console) -> None:
    """What is predicted, the timeline, the limits, and what the numbers mean."""
    fitted(_quantities(found), console, [*reversed(longer(found)), "guess"])
    fitted(_timeline(found), console)
    fitted(_limits(found), console)
    for line in legend(found):
        console.print(escape.rich(line))


def _quantities(found: PlanFile) -> Table:
    columns = ("quantity", "guess", "± predicted", "± at worst", "± wanted", "unit", "reached at", *longer(found))
    table = titled(escape.rich(f"{found.vehicle}: a plan of {found.duration_s:g} s"), columns, ("quantity", "unit"))
    for name, item in found.quantities.items():
        table.add_row(name, *cells(item), *further(item))
    return table


def further(item: QuantityItem) -> list[str]:
    """Sigmas that more time would bring."""
    return [digits.figures(sigma) if item.told == "well" else "–" for sigma in item.longer.values()]


def longer(found: PlanFile) -> list[str]:
    """Headings of what more time would bring."""
    return [f"± in {float(factor) * found.duration_s:g} s" for factor in next(iter(found.quantities.values())).longer]


def cells(item: QuantityItem) -> list[str]:
    """Guess, predicted, worst, wanted, unit, reached."""
    wanted = "" if item.wanted_sigma is None else digits.figures(item.wanted_sigma)
    reached = "" if item.wanted is None else "not" if item.reached_at_s is None else f"{item.reached_at_s:.2f} s"
    sigmas = [digits.figures(item.sigma), digits.figures(item.worst_sigma)] if item.told == "well" else [item.told, "–"]
    return [digits.stated(item.guess), *sigmas, wanted, vocabulary.unit(item.unit), reached]


def _timeline(found: PlanFile) -> Table:
    table = titled("timeline", ("from", "to"), ())
    table.add_column("motion")
    table.add_column("informs (factor on sigma without it)")
    for item in found.timeline:
        table.add_row(f"{item.start_s:g} s", f"{item.end_s:g} s", item.motion, taught(item.teaches))
    return table


def taught(teaches: dict[str, float]) -> str:
    """The few that lose most without it."""
    most = sorted(teaches.items(), key=lambda pair: -pair[1])[:FEW]
    return ", ".join(f"{name} {'> 100 ×' if factor > 100 else f'{factor:.2g} ×'}" for name, factor in most) or "little"


def _limits(found: PlanFile) -> Table:
    table = titled("limits", ("limit", "used", "allowed", "unit"), ("limit", "unit"))
    for name, item in found.limits.items():
        table.add_row(limited.LIMITS[name][0], *limit(item))
    return table


def limit(item: LimitItem) -> tuple[str, str, str]:
    """Used, allowed, unit."""
    allowed = "–" if item.allowed is None else digits.stated(item.allowed)
    return digits.figures(item.used, 3), allowed, vocabulary.unit(item.unit)


def legend(found: PlanFile) -> list[str]:
    """What the numbers mean."""
    untold = [name for name, item in found.quantities.items() if item.told == "by no motion of this vehicle"]
    return [
        "Inertia about the CG in body axes; products are the tensor's own elements, ixy = -Σ m x y. CG from O in body axes. "
        f"± is one standard deviation: the Cramér–Rao bound of the plan flown in software. At worst: over {found.bodies} bodies that the "
        f"vehicle may be (guess: {found.guess}).",
        *([f"No motion of this vehicle makes {', '.join(untold)} observable."] if untold else []),
        *(f"Note: {note}." for note in found.notes),
    ]
