"""Values with error bars: those of several results side by side, and those of one result relative to their expectations."""

from collections.abc import Mapping, Sequence

from massprop_cli import QUANTITIES
from massprop_cli.base.escape import line
from massprop_cli.base.lazy import ticker
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.report import vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import BOTTOM, HEIGHT, LENGTH, Axes, Panel, Picture
from massprop_cli.report.figures.series import AxisRange, padded
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import EstimateItem

MARKERS: dict[Verdict, tuple[str, bool]] = {
    "converged": ("o", True),
    "not_converged": ("D", False),
    "not_excited": ("o", False),
    "contradicted": ("X", True),
    "unobservable": ("x", True),
}
"""Marker of each verdict, and whether it is filled."""


NAMED = 12
"""Largest number of results with names on the axis; more results have their numbers, from 1."""


def picture(found: Sequence[dict[str, EstimateItem]], names: Sequence[str] = ()) -> Picture:
    """A panel for each quantity, of results of one vehicle with these names."""
    named = names if len(names) <= NAMED else ()
    caption = (
        "Value of each result with a bar of ± one sigma, above its name or its number in the table. Filled circle: converged; open "
        "diamond: not converged; open circle: not excited; filled cross: contradicted, its bar is not valid. Dashes: expected value. The "
        "range fits the converged values; an arrow at the edge marks a value outside."
    )
    return Picture(caption, tuple(_panel(name, [items[name] for items in found], named) for name in QUANTITIES))


def _panel(name: str, items: list[EstimateItem], names: Sequence[str]) -> Panel:
    limits = _limits(items)

    def paint(axes: Axes) -> None:
        if limits is not None:
            axis.values(axes, limits, vocabulary.SYMBOLS[name], vocabulary.unit(items[0].unit))
        else:
            axis.heading(axes, vocabulary.SYMBOLS[name], vocabulary.unit(items[0].unit))
            axes.set_yticks([])
            axis.note(axes, "no result has a value")
        axes.set_xlim(0.5, len(items) + 0.5)
        if names:
            axes.set_xticks(range(1, len(items) + 1), [line(each, 16) for each in names], rotation=20, ha="right", rotation_mode="anchor")
        else:
            axes.xaxis.set_major_locator(ticker.MaxNLocator(nbins=12, integer=True, min_n_ticks=1))
            axes.set_xlabel("result", labelpad=2)
        for verdict in MARKERS:
            _points(axes, name, verdict, items)
        _marks(axes, name, items, limits)

    return Panel(name, _alt_text(name, items), paint, (LENGTH, HEIGHT + 0.25 * bool(names)), bottom=BOTTOM + 0.25 * bool(names))


def _points(axes: Axes, name: str, verdict: Verdict, items: list[EstimateItem]) -> None:
    drawn = [(n, i.value, i.sigma or 0.0) for n, i in enumerate(items, 1) if i.verdict == verdict and i.value is not None]
    if not drawn:
        return
    (marker, filled), colour = MARKERS[verdict], palette.VERDICT[verdict]
    at, values, sigmas = (list(column) for column in zip(*drawn, strict=True))
    face = colour if filled else palette.PAPER
    # a filled cross of the circles' size looks like a square
    larger = 2.5 if marker == "X" else 0.0
    size, cap = (4.0, 2.0) if len(items) <= 40 else (2.5, 0.0)
    bars = axes.errorbar(at, values, sigmas, fmt=marker, markersize=size + larger, color=colour, markerfacecolor=face, capsize=cap)
    bars.lines[0].set_gid(f"{name}-{verdict}")


def _marks(axes: Axes, name: str, items: list[EstimateItem], limits: AxisRange | None) -> None:
    """An arrow for each value that lies outside, and dashes at what was expected."""
    for number, item in enumerate(items, 1):
        if limits is not None and item.value is not None and not limits.hold(item.value):
            above = item.value > limits.high
            edge, marker, colour = limits.high if above else limits.low, "^" if above else "v", palette.VERDICT[item.verdict]
            axes.plot([number], [edge], marker, color=colour, markersize=6, clip_on=False, gid=f"{name}-beyond-{number}")
        if item.expected is not None:
            ends = [number - 0.4, number + 0.4]
            axes.plot(ends, [item.expected.value] * 2, color=palette.GREEN, linewidth=1.1, linestyle=(0, (3, 1.5)))


def _limits(items: list[EstimateItem]) -> AxisRange | None:
    told = [item for item in items if item.value is not None]
    shown = [item for item in told if item.verdict == "converged"] or told
    ends = [item.value + sign * (item.sigma or 0.0) for item in shown if item.value is not None for sign in (-1, 1)]
    ends += [item.expected.value for item in shown if item.expected is not None]
    return padded(min(ends), max(ends), 0.1) if ends else None


def _alt_text(name: str, items: list[EstimateItem]) -> str:
    told = [item.value for item in items if item.value is not None]
    among = f", from {min(told):.5g} to {max(told):.5g} {items[0].unit}" if told else ""
    return f"{vocabulary.SYMBOLS[name]} of {len(items)} results with error bars: {len(told)} have a value{among}"


FAR = 3.0
"""Largest difference drawn, tolerances; a larger one is an arrow at the edge."""


def against_expected(recorded: Recorded) -> Picture:
    """A panel for each phase, and for the docked object."""
    found = {phase.name: phase.estimates for phase in recorded.result.phases}
    if recorded.result.docked_object is not None:
        found["docked object"] = recorded.result.docked_object.estimates
    caption = (
        "(Value − expected) / tolerance; bars are ± one sigma. Between the dashes the expectation is met. Green: met. Red: missed; an "
        f"arrow marks more than {FAR:g} tolerances. Open: the verdict is not converged."
    )
    return Picture(caption, tuple(_against(number, *each, len(found) > 1) for number, each in enumerate(found.items(), 1)), 2)


def ratio(item: EstimateItem) -> tuple[float, float] | None:
    """Value minus expected value, and sigma, both over the tolerance; None without expectation or value."""
    found = item.expected
    if found is None or not found.tolerance or found.difference is None:
        return None
    return found.difference / found.tolerance, (item.sigma or 0.0) / found.tolerance


def _against(number: int, part: str, estimates: Mapping[str, EstimateItem], several: bool) -> Panel:
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
    alt_text = f"Value less expected in tolerances, {line(part)}: {listed}"
    return Panel(f"expectations-{number}", alt_text, paint, (LENGTH * 1.4, 0.22 * max(len(found), 4) + 0.75))
