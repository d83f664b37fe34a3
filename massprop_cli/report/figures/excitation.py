"""Excitation against time: commands, and the information on each quantity."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.escape import line
from massprop_cli.report import vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import LENGTH, Axes, Panel, Picture
from massprop_cli.report.figures.recording import Columns, covered
from massprop_cli.result.historyfile import SIGNALS
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import AXES, PhaseItem

BINS = 60
"""Number of intervals of a phase."""
COMMANDS = [f"{kind}_{letter}" for kind in ("torque", "force") for letter in AXES]
ROUNDING = 1e-12
"""Commands below this are rounding errors, N m or N."""
ROW = 0.21
"""Height of a row, inches."""


class Strips(NamedTuple):
    """Commands and information in intervals of a phase."""

    edges_s: Array
    """(BINS + 1,) edges of the intervals, s."""
    commands: Array
    """(6, BINS) rms executed torque and force, each relative to its largest."""
    information: Array
    """(10, BINS) share of a quantity's total information (increase of 1/σ²) in each interval; NaN without any."""


def picture(recorded: Recorded) -> Picture:
    """A panel for each phase."""
    parts = covered(recorded)
    several = len(parts) > 1
    panels = tuple(_panel(number, phase, strips(columns), several) for number, phase, columns in parts)
    caption = (
        "Above: executed torque and force (rms, each relative to its largest). Below: when the log gave information on each quantity, as a "
        "share of 1/σ²; each row is scaled to its own peak. A peak below a burst of torque or force shows which motion informed it."
    )
    return Picture(caption, panels, 2)


def strips(columns: Columns) -> Strips:
    """Commands and information in equal intervals of a phase."""
    time_s = columns["time_s"]
    edges = np.linspace(time_s[0] - (time_s[1] - time_s[0] if len(time_s) > 1 else 1.0), time_s[-1], BINS + 1)
    part: NDArray[np.intp] = np.clip(np.searchsorted(edges, time_s, side="left") - 1, 0, BINS - 1)
    count = np.maximum(np.bincount(part, minlength=BINS), 1)
    executed = np.nan_to_num([columns[f"{name}_{SIGNALS[name.split('_')[0]]}"] for name in COMMANDS])
    for kind in (slice(0, 3), slice(3, 6)):
        executed[kind] /= max(np.abs(executed[kind]).max(), ROUNDING)
    commands = np.sqrt([np.bincount(part, values**2, BINS) / count for values in executed])
    for kind in (slice(0, 3), slice(3, 6)):
        commands[kind] /= commands[kind].max() or 1.0
    return Strips(edges, commands, np.array([_information(columns[f"{name}_sigma"], part) for name in QUANTITIES]))


def _information(sigma: Array, part: NDArray[np.intp]) -> Array:
    """(BINS,) shares of the increases of 1/σ²; decreases, by process noise, count as zero."""
    known = np.isfinite(sigma) & (sigma > 0)
    if not known.any():
        return np.full(BINS, np.nan)
    information = np.where(known, (sigma[known].min() / np.where(known, sigma, 1.0)) ** 2, 0.0)
    gained = np.maximum(np.diff(information, prepend=0.0), 0.0)
    return np.asarray(np.bincount(part, gained / gained.sum(), BINS), dtype=float)


def half_information_s(found: Strips, row: int) -> float | None:
    """Time at which half of the information on a quantity is reached, s; None without any."""
    shares = found.information[row]
    if not np.isfinite(shares).all():
        return None
    return float(found.edges_s[1 + np.searchsorted(np.cumsum(shares), 0.5 - 1e-9)])


def _panel(number: int, phase: PhaseItem, found: Strips, several: bool) -> Panel:
    labels = [
        *(f"{name.split('_')[0].capitalize()} {name[-1].upper()}" for name in COMMANDS),
        *(vocabulary.SYMBOLS[name] for name in QUANTITIES),
    ]
    heights = [*found.commands, *found.information / found.information.max(1, keepdims=True)]

    def paint(axes: Axes) -> None:
        axis.time(axes, axis.beginning(phase, found.edges_s), found.edges_s[-1])
        axis.title(axes, f"Commands, and when each quantity was learnt{f': {line(phase.name, 24)}' if several else ''}")
        base = [-row - (0.7 if row >= len(COMMANDS) else 0.0) for row in range(len(labels))]
        for row, (height, bottom) in enumerate(zip(heights, base, strict=True)):
            told, colour = row >= len(COMMANDS), palette.BLUE if row >= len(COMMANDS) else palette.MUTED
            name = QUANTITIES[row - len(COMMANDS)] if told else COMMANDS[row]
            top = bottom + 0.85 * np.nan_to_num(height)
            gid = f"{name}-{'information' if told else 'command'}-{number}"
            axes.fill(*_steps(found.edges_s, top, bottom), color=colour, alpha=0.75, linewidth=0, gid=gid)
            if np.isnan(height).any():
                axes.text(found.edges_s[1], bottom + 0.1, "never", fontsize=7, color=palette.MUTED)
        axes.set_yticks([bottom + 0.3 for bottom in base], labels)
        axes.set_ylim(base[-1] - 0.25, 1.1)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)

    return Panel(f"excitation-{number}", _alt_text(phase, found), paint, (LENGTH * 1.5, ROW * len(labels) + 0.9))


def _steps(edges: Array, tops: Array, bottom: float) -> tuple[Array, Array]:
    """Outline of a histogram, from ``bottom`` to ``bottom``."""
    x, y = np.repeat(edges, 2), np.concatenate([[bottom], np.repeat(tops, 2), [bottom]])
    turns = np.ones(len(y), dtype=bool)
    turns[1:-1] = (y[1:-1] != y[:-2]) | (y[1:-1] != y[2:])
    return x[turns], y[turns]


def _alt_text(phase: PhaseItem, found: Strips) -> str:
    told = []
    for row, name in enumerate(QUANTITIES):
        moment = half_information_s(found, row)
        told.append(f"{vocabulary.SYMBOLS[name]} {'never' if moment is None else f'half by {moment:.3g} s'}")
    return f"When each quantity was learnt in phase {line(phase.name)}, beside the executing torque and force: {', '.join(told)}"
