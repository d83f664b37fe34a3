"""Estimates against time with sigma bands."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.arrays import Array
from massprop_cli.base.escape import line
from massprop_cli.report import digits, vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import Axes, Panel, Picture
from massprop_cli.report.figures.recording import Columns, Covered, covered
from massprop_cli.report.figures.series import AxisRange, broken, padded, parts_of, settled, thin, thinning_note
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import EstimateItem, PhaseItem

FAR = 3.0
"""Largest distance of a drawn reference value from the range, relative to the range; a farther one is named at the edge."""


def picture(recorded: Recorded, names: Sequence[str], columns: int) -> Picture:
    """A panel for each quantity and phase."""
    parts = covered(recorded)
    several = len(parts) > 1
    ranges = [_range(name, phase, columns) for name in names for _, phase, columns in parts]
    power = axis.power(limits for limits in ranges if limits is not None)
    found = [_panel(name, *part, several, recorded, power) for name in names for part in parts]
    return Picture(_caption(recorded, names, parts), tuple(found), len(parts) if several else columns)


def _caption(recorded: Recorded, names: Sequence[str], parts: list[Covered]) -> str:
    sigma = "the thesis's “precision”, which is not an error" if recorded.result.provenance.method == "thesis" else "one standard deviation"
    text = (
        f"Line: the estimate after each cycle; band: ± sigma, {sigma}; point with bars: the reported value; vertical dashes: final from "
        "there on. The range fits the settled part; where sigma exceeds it, nothing is shown."
    )
    if any(phase.estimates[name].expected is not None for name in names for _, phase, _ in parts):
        text += " Green on the right: the expected value, with its tolerance."
    if any(phase.estimates[name].verdict == "contradicted" for name in names for _, phase, _ in parts):
        text += " Red with a cross: contradicted, the band is not valid."
    cuts = [(vocabulary.SYMBOLS[name], phase.name, cut_off_s(name, phase, columns)) for name in names for _, phase, columns in parts]
    told = [f"{symbol}{f' ({name})' if len(parts) > 1 else ''} before {cut:.1f} s" for symbol, name, cut in cuts if cut is not None]
    text += thinning_note([len(columns["time_s"]) for *_, columns in parts], parts_of(len(recorded.history)))
    return f"{text} The start is outside the figure: {', '.join(told)}." if told else text


def cut_off_s(name: str, phase: PhaseItem, columns: Columns) -> float | None:
    """The last time at which the estimate is outside the range of its panel, s; None if it never is."""
    limits = _range(name, phase, columns)
    if limits is None:
        return None
    with np.errstate(invalid="ignore"):
        outside = np.flatnonzero((columns[name] < limits.low) | (columns[name] > limits.high))
    return float(columns["time_s"][outside[-1]]) if outside.size else None


def _range(name: str, phase: PhaseItem, columns: Columns) -> AxisRange | None:
    """Range of a panel; None without an estimate."""
    return _limits(settled(columns[name], columns[f"{name}_sigma"]), phase.estimates[name])


def _panel(name: str, number: int, phase: PhaseItem, columns: Columns, several: bool, recorded: Recorded, power: int) -> Panel:
    item = phase.estimates[name]
    value, sigma, time_s = columns[name], columns[f"{name}_sigma"], columns["time_s"]
    final = [] if item.final_at_s is None else [int(np.argmin(np.abs(time_s - item.final_at_s)))]
    limits = _range(name, phase, columns)
    heading = f"{vocabulary.SYMBOLS[name]}{f', phase {line(phase.name, 20)}' if several else ''}, {_frame(name, recorded)}"

    def paint(axes: Axes) -> None:
        axis.time(axes, axis.beginning(phase, time_s), time_s[-1])
        if limits is None:
            axis.heading(axes, heading, vocabulary.unit(item.unit))
            axes.set_yticks([])
            axis.note(axes, f"nothing can be said:\n{item.verdict.replace('_', ' ')}")
            return
        axis.values(axes, limits, heading, vocabulary.unit(item.unit), power)
        blank = ~(sigma <= limits.high - limits.low)
        rows = thin(np.where(blank, np.nan, value), final, parts_of(len(recorded.history)))
        rows = broken(rows, blank)
        colour = palette.RED if item.verdict == "contradicted" else palette.BLUE
        _series(axes, f"{name}-{{}}-{number}", colour, time_s, value, sigma, rows)
        _outcome(axes, f"{name}-{{}}-{number}", time_s[-1], item)
        _references(axes, f"{name}-{{}}-{number}", item, limits)
        if any(axes.get_legend_handles_labels()[1]):
            axes.legend(loc="best", borderaxespad=0.2, handlelength=1.8)

    return Panel(f"{name}-{number}", _alt_text(name, phase, columns, limits), paint)


def _frame(name: str, recorded: Recorded) -> str:
    """Reference point and frame of a quantity, in words."""
    bearing = recorded.result.vehicle.environment == "air_bearing"
    if name == "mass":
        return "with the bearing's" if bearing else "of the vehicle"
    return "from O, body axes" if name.startswith("cg") else "about the CG, body axes"


def _limits(found: AxisRange | None, item: EstimateItem) -> AxisRange | None:
    """The settled range, extended to the reported value and to references that are not farther than :data:`FAR`."""
    if found is None:
        return None
    height = found.high - found.low
    wanted = [found.low, found.high]
    if item.value is not None and item.sigma is not None:
        wanted += [item.value - item.sigma, item.value + item.sigma]
    references = [item.nominal, item.expected.value if item.expected else None]
    wanted += [r for r in references if r is not None and found.low - FAR * height <= r <= found.high + FAR * height]
    return found if min(wanted) >= found.low and max(wanted) <= found.high else padded(min(wanted), max(wanted), 0.04)


def _series(axes: Axes, gid: str, colour: str, time_s: Array, value: Array, sigma: Array, rows: NDArray[np.intp]) -> None:
    """Draw value and sigma band at the indices ``rows``, with gaps at −1; the last piece of the band has the id."""
    pieces = np.split(rows, np.flatnonzero(rows < 0))
    for number, piece in enumerate(pieces, 1):
        at = piece[piece >= 0]
        name = gid.format("band") if number == len(pieces) else None
        low, high = value[at] - sigma[at], value[at] + sigma[at]
        x, y = np.concatenate([time_s[at], time_s[at][::-1]]), np.concatenate([low, high[::-1]])
        axes.fill(x, y, color=colour, alpha=0.25, linewidth=0, gid=name)
    x, y = (np.where(rows < 0, np.nan, column[rows]) for column in (time_s, value))
    axes.plot(x, y, color=colour, gid=gid.format("value"))


def _outcome(axes: Axes, gid: str, end_s: float, item: EstimateItem) -> None:
    """Draw the reported value with its error bar, and the time from which it is final."""
    if item.final_at_s is not None:
        axes.axvline(item.final_at_s, color=palette.MUTED, linestyle=(0, (4, 3)), linewidth=0.9, gid=gid.format("final"))
    if item.value is not None:
        spread = [item.sigma or 0.0]
        marker, size, colour = ("X", 6.0, palette.RED) if item.verdict == "contradicted" else ("o", 3.5, palette.INK)
        drawn = axes.errorbar([end_s], [item.value], spread, fmt=marker, markersize=size, capsize=2.5, color=colour, zorder=5)
        drawn.lines[0].set_gid(gid.format("reported"))
        drawn.lines[0].set_clip_on(False)


def _references(axes: Axes, gid: str, item: EstimateItem, limits: AxisRange) -> None:
    expected = item.expected
    if expected is not None:
        label = f"expected {f'{expected.value:.6g}'.replace('-', '−')} {'✓' if expected.met else '✕'}"
        _reference(axes, gid.format("expected"), expected.value, label, limits, palette.GREEN, (0, (6, 2)))
        allowed = expected.tolerance or 0.0
        for end in (expected.value - allowed, expected.value + allowed) if allowed else ():
            if limits.hold(end):
                axes.axhline(end, color=palette.GREEN, linestyle=":", linewidth=0.9)
        low, high = max(expected.value - allowed, limits.low), min(expected.value + allowed, limits.high)
        if low < high:
            edge = axes.get_yaxis_transform()
            axes.fill_betweenx([low, high], 0.985, 1.0, transform=edge, color=palette.GREEN, alpha=0.55, linewidth=0)
    if item.nominal is not None:
        label = f"nominal {item.nominal:.6g}".replace("-", "−")
        _reference(axes, gid.format("nominal"), item.nominal, label, limits, palette.MUTED, (0, (1, 1.5)))


def _reference(axes: Axes, gid: str, at: float, label: str, limits: AxisRange, colour: str, style: tuple[int, tuple[float, ...]]) -> None:
    if limits.hold(at):
        axes.axhline(at, color=colour, linestyle=style, linewidth=1.1, label=label, gid=gid)
    else:
        axes.plot([], [], color=colour, linestyle=style, label=f"{label}, {'above' if at > limits.high else 'below'} this picture")


def _alt_text(name: str, phase: PhaseItem, columns: Columns, limits: AxisRange | None) -> str:
    item, cut = phase.estimates[name], cut_off_s(name, phase, columns)
    start = f"{vocabulary.SYMBOLS[name]} against time, phase {line(phase.name)}: "
    if limits is None:
        return f"{start}no estimate at any time, {item.verdict.replace('_', ' ')}"
    value = digits.with_sigma(item.value, item.sigma, item.verdict)
    told = "no value is reported" if item.value is None else f"ends at {value} {item.unit}"
    final = "" if item.final_at_s is None else f", final from {item.final_at_s:.2f} s on"
    early = "" if cut is None else f"; before {cut:.2f} s it runs out of the picture"
    return f"{start}{told}{final}, {item.verdict.replace('_', ' ')}{early}"
