"""Innovations in torque and force, with their ± 2 sigma bounds."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import Axes, Panel, Picture
from massprop_cli.report.figures.recording import Covered, covered, over_time, sensed, thinned
from massprop_cli.report.figures.series import AxisRange, padded, parts_of, thin
from massprop_cli.result.read import Recorded

UNITS = {"torque": "N m", "force": "N"}
SENSORS = {"torque": "rate", "force": "acceleration"}
"""The sensor signal of each kind."""
BOUND = 2.0
"""Bound of an innovation, sigmas: 95.4 % of normally distributed ones are within."""


def picture(recorded: Recorded) -> Picture:
    """A panel for each torque and force channel, for all phases."""
    parts = covered(recorded)
    letters = {kind: sensed(parts, sensor) for kind, sensor in SENSORS.items()}
    ranges = {kind: [_limits(f"innovation_{kind}_{letter}", parts) for letter in letters[kind]] for kind in UNITS}
    panels = tuple(
        _panel(kind, letter, parts, limits, axis.power(found))
        for kind, found in ranges.items()
        for letter, limits in zip(letters[kind], found, strict=True)
    )
    caption = (
        "Line: measured − predicted of each cycle, before the filter used it; body axes. Dashed lines: ± 2 sigma expected by the filter. "
        "If model and noise levels are right, 95 % lie between the dashed lines, without trend or pattern."
    )
    return Picture(caption + thinned(parts), panels)


def share_inside(values: Array, sigmas: Array) -> float | None:
    """Share of innovations within the bounds; None without innovations."""
    known = np.isfinite(values) & np.isfinite(sigmas)
    return float((np.abs(values[known]) <= BOUND * sigmas[known]).mean()) if known.any() else None


def _panel(kind: str, letter: str, parts: list[Covered], limits: AxisRange, power: int) -> Panel:
    column = f"innovation_{kind}_{letter}"
    heading = f"{kind.capitalize()} {letter.upper()}, body"

    def paint(axes: Axes) -> None:
        over_time(axes, parts, limits, heading, UNITS[kind], power)
        buckets = parts_of(len(parts))
        for number, _, columns in parts:
            time_s, values = columns["time_s"], columns[column]
            rows = thin(values, buckets=buckets)
            axes.plot(time_s[rows], values[rows], color=palette.BLUE, linewidth=0.6, gid=f"{column}-value-{number}")
            bounds(axes, f"{column}-{{}}-{number}", time_s, columns[f"{column}_sigma"], buckets // 3)

    return Panel(column, _alt_text(kind, letter, column, parts), paint)


def bounds(axes: Axes, gid: str, time_s: Array, sigmas: Array, buckets: int) -> None:
    """Draw the upper and lower bound as dashed lines."""
    rows = thin(sigmas, buckets=buckets)
    for sign, side in ((1, "upper"), (-1, "lower")):
        at = sign * BOUND * sigmas[rows]
        axes.plot(time_s[rows], at, color=palette.ORANGE, linestyle=(0, (4, 2)), linewidth=0.9, gid=gid.format(side))


def _limits(column: str, parts: list[Covered]) -> AxisRange:
    """Symmetric range for the bounds and 98 % of the innovations after the first fifth of each phase."""
    reach = []
    for *_, columns in parts:
        values, sigmas = columns[column], columns[f"{column}_sigma"]
        known = np.flatnonzero(np.isfinite(values) & np.isfinite(sigmas))
        tail = known[len(known) // 5 :]
        if tail.size:
            reach.append(max(1.6 * BOUND * np.median(sigmas[tail]), 1.2 * np.quantile(np.abs(values[tail]), 0.98)))
    return padded(-max(reach), max(reach), 0.02) if reach else AxisRange(-1.0, 1.0)


def _alt_text(kind: str, letter: str, column: str, parts: list[Covered]) -> str:
    values = np.concatenate([columns[column] for *_, columns in parts])
    sigmas = np.concatenate([columns[f"{column}_sigma"] for *_, columns in parts])
    inside = share_inside(values, sigmas)
    told = "none" if inside is None else f"{inside:.1%} lie within ± 2 sigma; 95 % are expected"
    return f"Innovations in {kind} about axis {letter.upper()} against time: {told}"
