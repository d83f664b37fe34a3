"""Axes of panels: headings with units, plain numbers at the ticks, and shaded phases with names."""

import math
from collections.abc import Iterable, Sequence

from massprop_cli.base.arrays import Array
from massprop_cli.base.escape import line
from massprop_cli.base.lazy import ticker
from massprop_cli.report.figures import palette
from massprop_cli.report.figures.panel import LEFT, Axes
from massprop_cli.report.figures.series import AxisRange
from massprop_cli.result.schema import PhaseItem

FITTING = 60.0
"""Font size at which a tick label of one character fills the width left of the axes, points."""
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def title(axes: Axes, text: str) -> None:
    """Write a title above the axes, from the left edge of the figure."""
    inches = axes.bbox.width / axes.figure.dpi
    axes.set_title(text, x=(0.1 - LEFT) / inches)


def heading(axes: Axes, text: str, unit: str, exponent: int = 0) -> None:
    """Write quantity and unit above the axes; ``exponent``: power of ten of the unit."""
    power = f"{power_of_ten(exponent)} " if exponent else ""
    title(axes, f"{line(text, 60)} [{power}{unit}]")


def power_of_ten(exponent: int) -> str:
    """A power of ten as text: 10⁻³."""
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def power(limits: Iterable[AxisRange]) -> int:
    """Common exponent of ten for the headings of neighbouring panels, a multiple of 3; 0 from −3 to 3."""
    largest = max((max(abs(one.low), abs(one.high)) for one in limits), default=0.0)
    exponent = 3 * math.floor(math.log10(largest) / 3) if largest > 0 else 0
    return exponent if exponent < -3 or exponent > 3 else 0


def values(axes: Axes, limits: AxisRange, text: str, unit: str, exponent: int | None = None) -> None:
    """Set the value axis and its heading; ``exponent``: common exponent of neighbouring panels, None for :func:`power`."""
    exponent = power([limits]) if exponent is None else exponent
    ticks = [float(tick) for tick in ticker.MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]).tick_values(limits.low, limits.high)]
    step = (ticks[1] - ticks[0]) / 10.0**exponent
    decimals = next((d for d in range(12) if abs(round(step, d) - step) < 1e-3 * step), 12)  # the least that write the ticks exactly
    shown = [tick for tick in ticks if limits.hold(tick)]
    longest = max((len(_plain(tick / 10.0**exponent, decimals)) for tick in shown), default=1)
    axes.set_ylim(limits.low, limits.high)
    axes.yaxis.set_major_locator(ticker.FixedLocator(shown))
    axes.yaxis.set_major_formatter(ticker.FuncFormatter(lambda tick, _: _plain(tick / 10.0**exponent, decimals)))
    axes.tick_params(axis="y", labelsize=min(7.5, FITTING / longest))
    heading(axes, text, unit, exponent)


def note(axes: Axes, text: str) -> None:
    """Write in the middle of the axes why they are empty."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=palette.MUTED)


def empty(axes: Axes, text: str) -> None:
    """Write why the axes are empty, and remove the ticks."""
    axes.set_xticks([])
    axes.set_yticks([])
    note(axes, text)


def beginning(phase: PhaseItem, time_s: Array) -> float:
    """Start of a phase's time axis, s: that of the phase, unless more than a tenth of its duration has no estimate at the start."""
    first, last = float(time_s[0]), float(time_s[-1])
    return phase.start_s if 0 <= first - phase.start_s <= 0.1 * (last - first) else first


def time(axes: Axes, start_s: float, end_s: float) -> None:
    """Set the time axis."""
    axes.set_xlim(start_s, end_s if end_s > start_s else start_s + 1.0)
    axes.xaxis.set_major_locator(ticker.MaxNLocator(nbins=7, steps=[1, 2, 2.5, 5, 10]))
    axes.set_xlabel("time [s]", labelpad=2)


def phases(axes: Axes, found: Sequence[PhaseItem]) -> None:
    """Shade the phases and write their names above the data, if there are several."""
    if len(found) < 2:
        return
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + 0.12 * (top - bottom))
    low, high = axes.get_xlim()
    for number, phase in enumerate(found):
        start, end = max(phase.start_s, low), min(phase.end_s, high)
        if end <= start:
            continue
        axes.axvspan(start, end, color=palette.SHADE, alpha=1.0 - 0.5 * (number % 2), zorder=0, linewidth=0)
        axes.axvline(start, color=palette.MUTED, linewidth=0.6, linestyle=":")
        longest = max(3, int(40 * (end - start) / (high - low)))
        place = axes.get_xaxis_transform()
        name = line(phase.name, longest)
        axes.text(start + 0.01 * (high - low), 0.985, name, transform=place, va="top", ha="left", fontsize=7, color=palette.MUTED)


def _plain(value: float, decimals: int) -> str:
    """A number with a typographic minus sign; zero has no sign."""
    text = f"{value:.{decimals}f}".replace("-", "−")
    return text.replace("−", "") if float(text.replace("−", "-")) == 0 else text
