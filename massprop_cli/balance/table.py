"""What ``massprop balance`` prints."""

import math

from rich.console import Console
from rich.table import Table

from massprop_cli.balance.document import G_CM, Balance, BallastChange, Hang, Moment, MoveCheck
from massprop_cli.base import escape
from massprop_cli.report import digits
from massprop_cli.report.fit import fitted, titled

_UNITS = (("g cm", "g_cm"), ("N m", "n_m"), ("kg m", "kg_m"))
_WORDS = ("ballast", "", "unit")


def show(found: Balance, console: Console) -> None:
    """The check where there is one, the changes, the first moment before and after them, and how the table then swings."""
    if found.check is not None:
        _check(found.check, console)
    source = found.after or found.result
    console.print(escape.rich(f"{source.path}, phase {source.phase}: {found.vehicle}"))
    fitted(_changes(found.plan.changes), console, ("to",))
    fitted(_moments(found), console, ("wanted",))
    console.print(f"Small swings: now {_swings(found.now)}; then {_swings(found.plan.remainder)}.")
    if found.plan.wanted.note:
        console.print(f"Wanted by default: {found.plan.wanted.note}. Use --leave for another remainder.")
    if not found.plan.reached:
        console.print(escape.rich(f"Not reached: {found.plan.note}."))
    console.print("First moment about the pivot, mass × (CG − pivot), body axes; in N m the gravity torque when level. ± is one sigma.")


def _changes(changes: list[BallastChange]) -> Table:
    table = titled("what to do", ("ballast", "do", "to", "Δx (g cm)", "Δy (g cm)", "Δz (g cm)", "± g cm", "Δ (mN m)"), _WORDS)
    for one in changes:
        by = round(one.by_mm if one.by_mm is not None else 1000 * (one.add_kg or 0.0), 3)
        do = "leave" if by == 0 else f"move {by:+.3f} mm" if one.what == "move" else f"add {by:.3f} g"
        to = "" if one.to_mm is None else f"{one.to_mm:.3f} mm{' (limit)' if one.at_limit else ''}"
        size = sum(part**2 for part in one.moment.n_m) ** 0.5
        sigma = sum(part**2 for part in one.moment.sigma_g_cm) ** 0.5
        effect = [f"{part:+.2f}" if round(part, 2) else "0" for part in one.moment.g_cm]
        table.add_row(escape.rich(one.name), do, to, *effect, digits.figures(sigma), digits.figures(1000 * size, 4))
    return table


def _moments(found: Balance) -> Table:
    table = titled("first moment about the pivot", ("", "now", "± now", "wanted", "then", "± then", "unit"), _WORDS)
    now, then = found.now.moment, found.plan.remainder.moment
    for unit, key in _UNITS:
        factor = {"g_cm": G_CM, "n_m": found.gravity_m_s2, "kg_m": 1.0}[key]
        for n, axis in enumerate("xyz"):
            wanted = f"{factor * found.plan.wanted.kg_m[n]:.5g}"
            table.add_row(f"moment_{axis}", *_pair(now, key, n), wanted, *_pair(then, key, n), unit)
    return table


def _pair(of: Moment, key: str, n: int) -> tuple[str, str]:
    return digits.numbers(getattr(of, key)[n], getattr(of, f"sigma_{key}")[n])


def _swings(at: Hang) -> str:
    if at.period_s is None or at.tilt_rad is None:
        return f"none, the CG is above the pivot by {digits.figures(-G_CM * at.below_kg_m, 3)} g cm"
    tilt = f"{math.degrees(at.tilt_rad):.3f}".rstrip("0").rstrip(".")
    return f"{at.period_s[0]:.4g} s and {at.period_s[1]:.4g} s, at rest {tilt} degrees from upright"


def _check(check: MoveCheck, console: Console) -> None:
    table = titled(
        f"effect of the {check.source} changes", ("", "predicted", "measured", "difference", "± sigma", "unit", "sigmas"), _WORDS
    )
    for n, axis in enumerate("xyz"):
        difference, sigma = digits.numbers(check.difference.g_cm[n], check.difference.sigma_g_cm[n])
        values = (f"{of.g_cm[n]:.3f}" for of in (check.predicted, check.measured))
        table.add_row(f"moment_{axis}", *values, difference, sigma, "g cm", f"{check.sigmas[n]:+.2f}")
    fitted(table, console)
    done = ", ".join(
        f"{one.name} {one.by_mm:+.3f} mm" if one.by_mm is not None else f"{one.name} {1000 * (one.add_kg or 0):.3f} g"
        for one in check.moved
    )
    verdict = "As predicted" if check.as_predicted else "Not as predicted"
    console.print(escape.rich(f"Moved: {done or 'nothing'}. {verdict}: chi-square {check.chi_square:.3g} of 3, p = {check.p:.2g}."))
    for one in check.masses:
        stated = f"{one.stated_kg:.6g} ± {digits.figures(one.stated_sigma_kg)} kg stated"
        refined = f"{digits.with_sigma(one.refined_kg, one.refined_sigma_kg)} kg with both logs"
        refined = refined if one.stated_sigma_kg else "assumed exact (mass_sigma_kg is 0)"
        console.print(escape.rich(f"Mass of {one.name}: {stated}; {refined}."))
    if check.thrust_scale_sigma:
        console.print(f"Thrust: {digits.with_sigma(check.thrust_scale, check.thrust_scale_sigma)} times the value of the vehicle file.")
