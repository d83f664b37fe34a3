"""Convergence of each estimate: distance from its final value, sigma and tolerance against time, on a logarithmic scale."""

import numpy as np

from massprop_cli import CG, INERTIA, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.escape import line
from massprop_cli.conclude.verdict import tolerance_of
from massprop_cli.report import vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import Axes, Panel, Picture
from massprop_cli.report.figures.recording import Columns, covered, thinned
from massprop_cli.report.figures.series import parts_of, thin
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import PhaseItem, Result

SIZE = 2.5, 2.0
"""Width and height of a panel, inches, for five panels side by side with the usual text size."""


def picture(recorded: Recorded) -> Picture:
    """A panel for each quantity and phase."""
    parts = covered(recorded)
    several = len(parts) > 1
    panels = tuple(
        _panel(name, number, phase, columns, several, recorded.result) for name in QUANTITIES for number, phase, columns in parts
    )
    caption = (
        "Blue: distance of the estimate after each cycle from the final one. Orange dashes: its sigma. Grey dots: the tolerance within "
        "which it must stay to be converged. If sigmas are right, blue stays below about two times orange."
    )
    return Picture(caption + thinned(parts, 2), panels, 5)


def tolerance(name: str, phase: PhaseItem, result: Result) -> float | None:
    """Tolerance of convergence in a quantity's unit; None if it is relative to an unknown size.

    A relative tolerance refers to trace (inertia), √(trace/mass) (CG), or mass.
    """
    settings = result.provenance.settings
    thesis = result.provenance.method == "thesis"
    kind = "inertia" if name in INERTIA else "cg" if name in CG else "mass"
    relative = settings.get("convergence.relative", not thesis)
    given = tolerance_of(kind, settings.get(f"convergence.{kind}_tolerance"), relative)
    if not relative:
        return float(given)
    items = phase.estimates
    moments, mass = [items[each].value for each in ("ixx", "iyy", "izz")], items["mass"].value
    trace = sum(one for one in moments if one is not None) if None not in moments else None
    size = trace if kind == "inertia" else mass
    if kind == "cg":
        size = np.sqrt(trace / mass) if trace is not None and mass and trace / mass > 0 else None
    return float(given * size) if size is not None and size > 0 else None


def _panel(name: str, number: int, phase: PhaseItem, columns: Columns, several: bool, result: Result) -> Panel:
    item, time_s = phase.estimates[name], columns["time_s"]
    value, sigma = columns[name], columns[f"{name}_sigma"]
    known = np.isfinite(value) & np.isfinite(sigma)
    distance = np.abs(value - value[known][-1]) if known.any() else np.full_like(value, np.nan)
    allowed = tolerance(name, phase, result)
    heading = f"{vocabulary.SYMBOLS[name]}{f', {line(phase.name, 14)}' if several else ': away from the end'}"

    def paint(axes: Axes) -> None:
        axis.time(axes, axis.beginning(phase, time_s), time_s[-1])
        axis.heading(axes, heading, vocabulary.unit(item.unit))
        if not known.any():
            axes.set_yticks([])
            axis.note(axes, "nothing can be said")
            return
        drawn = [_logarithm(distance), _logarithm(sigma)]
        for each, kind, colour, style, width in (
            (drawn[0], "away", palette.BLUE, "-", 0.7),
            (drawn[1], "sigma", palette.ORANGE, (0, (4, 2)), 1.1),
        ):
            rows = thin(each, buckets=parts_of(len(result.phases)) // 2)
            axes.plot(time_s[rows], each[rows], color=colour, linestyle=style, linewidth=width, gid=f"{name}-{kind}-{number}")
        if allowed is not None:
            axes.axhline(np.log10(allowed), color=palette.MUTED, linestyle=(0, (1, 1.5)), gid=f"{name}-tolerance-{number}")
        _decades(axes, drawn, allowed)

    size = "" if allowed is None else f", tolerance {allowed:.2g} {item.unit}"
    ends = f"sigma from {np.nanmax(sigma[known]):.2g} to {sigma[known][-1]:.2g} {item.unit}" if known.any() else "nothing can be said"
    alt_text = (
        f"{vocabulary.SYMBOLS[name]}, phase {line(phase.name)}, distance from its end and sigma against time, logarithmic: {ends}{size}"
    )
    return Panel(f"settling_{name}-{number}", alt_text, paint, SIZE, logarithmic=True)


def _logarithm(values: Array) -> Array:
    """The logarithm to base ten, NaN for zero."""
    return np.asarray(np.log10(np.where(values > 0, values, np.nan)))


def _decades(axes: Axes, drawn: list[Array], allowed: float | None) -> None:
    """Set the value axis from 1.5 decades below the smallest sigma to the largest value, with at most about five ticks."""
    low = float(np.nanmin(drawn[1])) - 1.5
    high = max(float(np.nanmax(each)) for each in drawn if np.isfinite(each).any())
    high = max(high, np.log10(allowed)) if allowed is not None else high
    step = max(1, int(np.ceil((high - low) / 5)))
    ticks = range(int(np.ceil(low)), int(np.floor(high)) + 1, step)
    axes.set_ylim(low, high + 0.04 * (high - low))
    axes.set_yticks(list(ticks), [axis.power_of_ten(tick) for tick in ticks])
