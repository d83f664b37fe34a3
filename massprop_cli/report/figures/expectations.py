"""All ten quantities against what was expected of them, in tolerances: one look says which are met."""

from collections.abc import Mapping

from massprop_cli.base.escape import line
from massprop_cli.report import vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.comparison import MARKERS
from massprop_cli.report.figures.panel import LENGTH, Axes, Panel, Picture
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import EstimateItem

FAR = 3.0
"""Tolerances beyond which a value stands at the edge, as an arrow."""


def picture(recorded: Recorded) -> Picture:
    """A panel for each phase, and one for the docked object."""
    found = {phase.name: phase.estimates for phase in recorded.result.phases}
    if recorded.result.docked_object is not None:
        found["docked object"] = recorded.result.docked_object.estimates
    caption = (
        "Value less expected, over the tolerance; bars are ± one sigma. Between the dashes an expectation is met. Green: met. Red: missed, "
        f"an arrow stands for more than {FAR:g} tolerances. A value that no verdict vouches for is open."
    )
    return Picture(caption, tuple(_panel(number, *each, len(found) > 1) for number, each in enumerate(found.items(), 1)), 2)


def ratio(item: EstimateItem) -> tuple[float, float] | None:
    """Value less expected, and sigma, in tolerances; None where nothing was expected or there is no value."""
    found = item.expected
    if found is None or not found.tolerance or found.difference is None:
        return None
    return found.difference / found.tolerance, (item.sigma or 0.0) / found.tolerance


def _panel(number: int, part: str, estimates: Mapping[str, EstimateItem], several: bool) -> Panel:
    found = [(name, item, told) for name, item in estimates.items() if (told := ratio(item)) is not None]

    def paint(axes: Axes) -> None:
        axis.heading(axes, f"Value less expected{f', {line(part, 24)}' if several else ''}", "tolerances")
        axes.set_xlim(-FAR - 0.2, FAR + 0.2)
        axes.set_ylim(len(found) - 0.4 if found else 0.6, -0.6)
        axes.set_yticks(range(len(found)), [vocabulary.SYMBOLS[name] for name, *_ in found])
        axes.grid(visible=False, axis="y")
        axes.axvspan(-1, 1, color=palette.GREEN, alpha=0.12, linewidth=0)
        for edge in (-1, 1):
            axes.axvline(edge, color=palette.GREEN, linestyle=(0, (4, 2)), linewidth=0.9)
        if not found:
            axis.note(axes, "nothing was expected")
        for row, (name, item, (off, spread)) in enumerate(found):
            met = item.expected is not None and item.expected.met
            colour = palette.GREEN if met else palette.RED
            if abs(off) > FAR:
                axes.plot([FAR * off / abs(off)], [row], ">" if off > 0 else "<", color=colour, markersize=7, gid=f"{name}-beyond-{number}")
                continue
            marker, filled = MARKERS[item.verdict]
            face = colour if filled else palette.PAPER
            bars = axes.errorbar([off], [row], xerr=[spread], fmt=marker, markersize=5, capsize=2.5, color=colour, markerfacecolor=face)
            bars.lines[0].set_gid(f"{name}-ratio-{number}")

    listed = ", ".join(f"{vocabulary.SYMBOLS[name]} {off:+.2g}" for name, _, (off, _) in found) or "nothing was expected"
    says = f"Value less expected in tolerances, {line(part)}: {listed}"
    return Panel(f"expectations-{number}", says, paint, (LENGTH * 1.4, 0.22 * max(len(found), 4) + 0.75))
