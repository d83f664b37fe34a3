"""Residuals of the prediction against the command: a slope shows a wrong torque, force, inertia or mass."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import Axes, Panel, Picture
from massprop_cli.report.figures.prediction import channel, columns
from massprop_cli.report.figures.recording import Covered, covered, sensed
from massprop_cli.report.figures.series import padded
from massprop_cli.result.historyfile import SIGNALS
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import AXES

POINTS = 240
"""Approximate number of cycles drawn in a panel."""
BINS = 9
"""Number of intervals of the command, with a mean each."""
LEAST = 5
"""Smallest number of cycles of a mean."""
KINDS = {
    "rate": ("torque", "Angular acceleration {} residual", "rad/s²", "torque", "N m"),
    "specific_force": ("force", "Specific force {} residual", "m/s²", "force", "N"),
}
"""For each kind of residual: the history's command, heading and unit of the residual, name and unit of the command."""


class CommandResidual(NamedTuple):
    """Command and residual of each cycle on one axis."""

    command: Array
    """(K,) executed torque [N m] or force [N]."""
    residual: Array
    """(K,) measured minus predicted angular acceleration [rad/s²] or specific force [m/s²]."""


class CommandMean(NamedTuple):
    """Mean residual of the cycles within an interval of the command."""

    command: float
    residual: float
    sigma: float
    """Sigma of the mean residual."""


def picture(recorded: Recorded) -> Picture:
    """Residuals of all phases: angular acceleration against torque, and specific force against force, on each axis."""
    parts = covered(
        recorded, [*columns("rate"), *columns("specific_force"), *(f"{k}_{a}_{SIGNALS[k]}" for k in ("torque", "force") for a in AXES)]
    )
    residuals = {(kind, letter): against(parts, kind, letter) for kind in KINDS for letter in sensed(parts, kind)}
    panels = tuple(_panel(kind, letter, each) for (kind, letter), each in residuals.items())
    count = max(len(each.residual) for each in residuals.values())
    thinned = f" The figure shows one in {-(-count // POINTS)} of {count} cycles; the means use all." if count > POINTS else ""
    caption = (
        "Grey points: residual of each cycle against the command along the same axis; for the angular acceleration, the change of the rate "
        "residual over the cycle. Blue: means over equal parts of the command, ± 2 sigma. Zero if thrust, delay and values are right; a "
        f"slope shows a wrong torque, force, inertia or mass.{thinned}"
    )
    return Picture(caption, panels)


def against(parts: list[Covered], kind: str, letter: str) -> CommandResidual:
    """Command and residual of the cycles that have both.

    The change of the rate residual from one cycle to the next depends on the mean torque of both.
    """
    command, residual = list[Array](), list[Array]()
    for number, _, history in parts:
        one, signal = channel(number, history, kind, letter), KINDS[kind][0]
        executed = history[f"{signal}_{letter}_{SIGNALS[signal]}"]
        if kind == "rate":
            command.append((executed[1:] + executed[:-1]) / 2)
            residual.append(np.diff(one.residual) / np.diff(one.time_s))
        else:
            command.append(executed)
            residual.append(one.residual)
    every = CommandResidual(np.concatenate(command), np.concatenate(residual))
    known = np.isfinite(every.command) & np.isfinite(every.residual)
    return CommandResidual(every.command[known], every.residual[known])


def means(each: CommandResidual) -> list[CommandMean]:
    """Mean residuals in equal intervals of the command's range."""
    low, high = float(each.command.min(initial=0.0)), float(each.command.max(initial=0.0))
    part = np.clip(((each.command - low) / ((high - low) or 1.0) * BINS).astype(int), 0, BINS - 1)
    intervals = []
    for inside in (part == number for number in np.unique(part)):
        if inside.sum() >= LEAST:
            sigma = float(each.residual[inside].std(ddof=1) / np.sqrt(inside.sum()))
            intervals.append(CommandMean(float(each.command[inside].mean()), float(each.residual[inside].mean()), sigma))
    return intervals


def _panel(kind: str, letter: str, each: CommandResidual) -> Panel:
    _, heading, unit, command, command_unit = KINDS[kind]
    title, found = heading.format(letter.upper()), means(each)

    def paint(axes: Axes) -> None:
        if not each.residual.size or not np.ptp(each.command) > 0:
            axis.heading(axes, title, unit)
            axis.empty(axes, "not predicted" if not each.residual.size else f"no {command} was commanded on this axis")
            return
        reach = max(float(np.quantile(np.abs(each.residual), 0.995)), max((abs(m.residual) + 2 * m.sigma for m in found), default=0.0))
        axis.values(axes, padded(-reach, reach, 0.05), title, unit)
        drawn = slice(None, None, -(-len(each.residual) // POINTS))
        axes.plot(each.command[drawn], each.residual[drawn], ".", color=palette.MUTED, markersize=2.0, gid=f"{kind}_{letter}-points")
        axes.axhline(0.0, color=palette.MUTED, linewidth=0.8)
        at, values, sigmas = np.array(found).reshape(-1, 3).T
        bars = axes.errorbar(at, values, 2 * sigmas, fmt="o-", markersize=3.5, linewidth=0.9, capsize=2, color=palette.BLUE)
        bars.lines[0].set_gid(f"{kind}_{letter}-mean")
        axes.set_xlabel(f"{command} {letter.upper()} [{command_unit}]", labelpad=2)

    alt_text = f"{title} of the prediction against {command} {letter.upper()}: {_slope(found, unit, command_unit)}"
    return Panel(f"{kind}_{letter}", alt_text, paint)


def _slope(found: list[CommandMean], unit: str, command_unit: str) -> str:
    """Slope of the means over the command by weighted least squares, as text."""
    if len(found) < 2:
        return "not estimated"
    at, values, sigmas = (np.array(column) for column in zip(*found, strict=True))
    weight = 1 / np.maximum(sigmas, TINY) ** 2
    offset = at - weight @ at / weight.sum()
    spread = weight @ offset**2
    if not spread > 0:
        return "not estimated"
    return f"slope {weight @ (offset * values) / spread:.2g} ± {spread**-0.5:.1g} {unit} per {command_unit}"
