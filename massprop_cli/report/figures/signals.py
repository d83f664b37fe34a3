"""Signals against time: executed torque and force, rate, compensated acceleration."""

import numpy as np

from massprop_cli.inputs.equipment import PIVOTED
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import Axes, Panel, Picture
from massprop_cli.report.figures.recording import Covered, covered, over_time, sensed, thinned
from massprop_cli.report.figures.series import AxisRange, gathered, parts_of, span, thin
from massprop_cli.result.historyfile import SIGNALS
from massprop_cli.result.read import Recorded

_EXECUTED = "executed in each cycle, in body axes: the commands after delay, rise and fall of the thrust."
KINDS = {
    "torque": ("Torque about O, body", f"Mean torque about O {_EXECUTED}", "N m"),
    "force": ("Force, body", f"Mean force {_EXECUTED}", "N"),
    "rate": ("Rate, body", "Mean rate over each cycle, in body axes.", "rad/s"),
    "acceleration": (
        "Acceleration of {point}, body",
        "Specific force of the accelerometer, transferred from the IMU to {point} without rotation and gravity; body axes.",
        "m/s²",
    ),
}
"""Heading, caption and unit of each kind of signal."""
COMMANDED = ("torque", "force")
"""Signals that may change in steps at each cycle."""
NOTHING = 1e-3
"""Smallest range of a panel relative to the largest value of the three axes, so that it does not magnify rounding errors."""


def picture(recorded: Recorded, kind: str) -> Picture:
    """A panel for each axis, for all phases."""
    parts, (heading, caption, _) = covered(recorded), KINDS[kind]
    point = "the bearing" if recorded.result.vehicle.environment in PIVOTED else "O"
    letters = sensed(parts, kind)
    columns = [columns[f"{kind}_{letter}_{SIGNALS[kind]}"] for letter in letters for *_, columns in parts]
    largest = max((float(np.abs(values[np.isfinite(values)]).max(initial=0.0)) for values in columns), default=0.0)
    ranges = [
        span(np.concatenate([each[f"{kind}_{letter}_{SIGNALS[kind]}"] for *_, each in parts]), NOTHING * largest) for letter in letters
    ]
    power, heading = axis.power(ranges), heading.format(point=point)
    panels = tuple(_panel(kind, letter, heading, parts, limits, power) for letter, limits in zip(letters, ranges, strict=True))
    drawn = thinned(parts)
    if drawn and kind in COMMANDED:
        drawn = f" Line: their mean.{drawn.replace('Drawn', 'Band')}"
    return Picture(caption.format(point=point) + drawn, panels)


def _panel(kind: str, letter: str, heading: str, parts: list[Covered], limits: AxisRange, power: int) -> Panel:
    column = f"{kind}_{letter}_{SIGNALS[kind]}"
    values = np.concatenate([columns[column] for *_, columns in parts])
    *_, unit = KINDS[kind]

    def paint(axes: Axes) -> None:
        over_time(axes, parts, limits, f"{heading} {letter.upper()}", unit, power)
        for number, _, columns in parts:
            gid = f"{kind}_{letter}-{{}}-{number}"
            if kind in COMMANDED:
                # jets switch at each cycle, so draw the mean of many cycles with a band from minimum to maximum
                time_s, mean, low, high = gathered(columns["time_s"], columns[column], parts_of(len(parts)))
                x, y = np.concatenate([time_s, time_s[::-1]]), np.concatenate([low, high[::-1]])
                axes.fill(x, y, color=palette.BLUE, alpha=0.2, linewidth=0, gid=gid.format("band"))
                axes.plot(time_s, mean, color=palette.BLUE, linewidth=0.9, gid=gid.format("value"))
            else:
                rows = thin(columns[column], buckets=parts_of(len(parts)))
                axes.plot(columns["time_s"][rows], columns[column][rows], color=palette.BLUE, linewidth=0.8, gid=gid.format("value"))

    finite = values[np.isfinite(values)]
    spread = f"from {finite.min():.3g} to {finite.max():.3g} {unit}, rms {np.sqrt((finite**2).mean()):.3g}" if finite.size else "not known"
    return Panel(f"{kind}_{letter}", f"{heading} axis {letter.upper()} against time: {spread}", paint)
