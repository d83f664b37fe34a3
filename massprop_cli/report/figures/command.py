"""What the prediction leaves, against the command: a slope says that torque, force, inertia or mass is not what it is said to be."""

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
"""Cycles that are drawn of each panel."""
BINS = 9
"""Means along the command."""
LEAST = 5
"""Cycles of a mean."""
KINDS = {
    "rate": ("torque", "Angular acceleration {} residual", "rad/s²", "torque", "N m"),
    "specific_force": ("force", "Specific force {} residual", "m/s²", "force", "N"),
}
"""What is left: the command that it is tested against, heading and unit; the command's name and unit."""


class Against(NamedTuple):
    """Command and residual of one axis, cycle by cycle."""

    command: Array
    """Executed torque [N m] or force [N]."""
    left: Array
    """What the prediction leaves of the angular acceleration [rad/s²] or specific force [m/s²]."""


class CommandMean(NamedTuple):
    """The mean residual of the cycles within a range of the command."""

    command: float
    left: float
    sigma: float
    """Of the mean."""


def picture(recorded: Recorded) -> Picture:
    """Three axes of angular acceleration against torque, three of specific force against force, over all phases."""
    parts = covered(
        recorded, [*columns("rate"), *columns("specific_force"), *(f"{k}_{a}_{SIGNALS[k]}" for k in ("torque", "force") for a in AXES)]
    )
    found = {(kind, letter): against(parts, kind, letter) for kind in KINDS for letter in sensed(parts, kind)}
    panels = tuple(_panel(kind, letter, each) for (kind, letter), each in found.items())
    count = max(len(each.left) for each in found.values())
    thinned = f" The figure shows one in {-(-count // POINTS)} of {count} cycles; the means use all." if count > POINTS else ""
    caption = (
        "Grey points: residual of each cycle against the command along the same axis; for the angular acceleration, the change of the rate "
        "residual over the cycle. Blue: means over equal parts of the command, ± 2 sigma. Zero if thrust, delay and values are right; a "
        f"slope shows a wrong torque, force, inertia or mass.{thinned}"
    )
    return Picture(caption, panels)


def against(parts: list[Covered], kind: str, letter: str) -> Against:
    """Command and what is left, where both are known. The step into a cycle is by the torque of both cycles."""
    command, left = list[Array](), list[Array]()
    for number, _, found in parts:
        one, signal = channel(number, found, kind, letter), KINDS[kind][0]
        executed = found[f"{signal}_{letter}_{SIGNALS[signal]}"]
        if kind == "rate":
            command.append((executed[1:] + executed[:-1]) / 2)
            left.append(np.diff(one.residual) / np.diff(one.time_s))
        else:
            command.append(executed)
            left.append(one.residual)
    told = Against(np.concatenate(command), np.concatenate(left))
    known = np.isfinite(told.command) & np.isfinite(told.left)
    return Against(told.command[known], told.left[known])


def means(each: Against) -> list[CommandMean]:
    """Over equal parts of the command's range."""
    low, high = float(each.command.min(initial=0.0)), float(each.command.max(initial=0.0))
    part = np.clip(((each.command - low) / ((high - low) or 1.0) * BINS).astype(int), 0, BINS - 1)
    found = []
    for own in (part == number for number in np.unique(part)):
        if own.sum() >= LEAST:
            sigma = float(each.left[own].std(ddof=1) / np.sqrt(own.sum()))
            found.append(CommandMean(float(each.command[own].mean()), float(each.left[own].mean()), sigma))
    return found


def _panel(kind: str, letter: str, each: Against) -> Panel:
    _, heading, unit, command, command_unit = KINDS[kind]
    title, found = heading.format(letter.upper()), means(each)

    def paint(axes: Axes) -> None:
        if not each.left.size or not np.ptp(each.command) > 0:
            axis.heading(axes, title, unit)
            axis.empty(axes, "not predicted" if not each.left.size else f"no {command} was commanded on this axis")
            return
        reach = max(float(np.quantile(np.abs(each.left), 0.995)), max((abs(m.left) + 2 * m.sigma for m in found), default=0.0))
        axis.values(axes, padded(-reach, reach, 0.05), title, unit)
        drawn = slice(None, None, -(-len(each.left) // POINTS))
        axes.plot(each.command[drawn], each.left[drawn], ".", color=palette.MUTED, markersize=2.0, gid=f"{kind}_{letter}-points")
        axes.axhline(0.0, color=palette.MUTED, linewidth=0.8)
        at, values, sigmas = np.array(found).reshape(-1, 3).T
        bars = axes.errorbar(at, values, 2 * sigmas, fmt="o-", markersize=3.5, linewidth=0.9, capsize=2, color=palette.BLUE)
        bars.lines[0].set_gid(f"{kind}_{letter}-mean")
        axes.set_xlabel(f"{command} {letter.upper()} [{command_unit}]", labelpad=2)

    says = f"{title} of the prediction against {command} {letter.upper()}: {_slope(found, unit, command_unit)}"
    return Panel(f"{kind}_{letter}", says, paint)


def _slope(found: list[CommandMean], unit: str, command_unit: str) -> str:
    if len(found) < 2:
        return "not estimated"
    at, values, sigmas = (np.array(column) for column in zip(*found, strict=True))
    weight = 1 / np.maximum(sigmas, TINY) ** 2
    offset = at - weight @ at / weight.sum()
    spread = weight @ offset**2
    if not spread > 0:
        return "not estimated"
    return f"slope {weight @ (offset * values) / spread:.2g} ± {spread**-0.5:.1g} {unit} per {command_unit}"
