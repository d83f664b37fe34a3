"""Raster of jet firings: a row for each jet; jets named in a warning are marked."""

import re
from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.base.escape import line
from massprop_cli.report import vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import LENGTH, Axes, Panel, Picture
from massprop_cli.report.figures.recording import Covered, covered, extent
from massprop_cli.result.historyfile import EXECUTED
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import Result, VehicleInfo

BINS = 240
"""Number of intervals of the time axis."""
ROW = 0.17
"""Height of a row, inches."""


def picture(recorded: Recorded) -> Picture:
    """One panel for all phases; without jets, it names the other commands."""
    jets = recorded.result.vehicle.jets
    parts = covered(recorded, ["time_s", *(f"{EXECUTED}{jet}_s" for jet in jets)])
    found = named(recorded.result)
    caption = (
        "Each row is a jet; a taller mark is a larger part of that time at full thrust. "
        + (f"Red with an arrow: {', '.join(line(jet, 40) for jet in found)}, which a warning names. " if found else "")
        + f"Each mark is the mean over 1/{BINS} of the time."
    )
    return Picture(caption, (_panel(recorded.result.vehicle, parts, found),), 1)


def named(result: Result) -> list[str]:
    """Jets whose names occur in a warning or a contradiction, as whole words."""
    said = " ".join([*(warning.message for warning in result.warnings), *(phase.contradiction for phase in result.phases)])
    return [jet for jet in result.vehicle.jets if re.search(rf"(?<![\w-]){re.escape(jet)}(?![\w-])", said)]


def shares(parts: Sequence[Covered], jet: str, edges_s: Array) -> Array:
    """(BINS,) duty cycle of a jet in each interval: 1 is full thrust all the time."""
    pushed, lasted = np.zeros(len(edges_s) - 1), np.zeros(len(edges_s) - 1)
    for *_, columns in parts:
        time_s = columns["time_s"]
        length = np.diff(time_s, prepend=2 * time_s[0] - time_s[1] if len(time_s) > 1 else time_s[0])
        part = np.clip(np.searchsorted(edges_s, time_s - length / 2, side="right") - 1, 0, len(pushed) - 1)
        pushed += np.bincount(part, np.nan_to_num(columns[f"{EXECUTED}{jet}_s"]), len(pushed))
        lasted += np.bincount(part, length, len(pushed))
    return np.asarray(pushed / np.maximum(lasted, TINY) * (lasted > 0))


def _panel(vehicle: VehicleInfo, parts: list[Covered], found: list[str]) -> Panel:
    jets, told = vehicle.jets, vocabulary.commands(vehicle)
    edges = np.linspace(*extent(parts), BINS + 1)
    rows = [np.clip(shares(parts, jet, edges), 0.0, 1.0) for jet in jets]

    def paint(axes: Axes) -> None:
        axis.time(axes, edges[0], edges[-1])
        axis.title(axes, "Thrust of each jet [part of full]")
        if not jets:
            axes.set_yticks([])
            axis.note(axes, told)
            return
        for row, (jet, share) in enumerate(zip(jets, rows, strict=True)):
            colour = palette.RED if jet in found else palette.BLUE
            on = np.flatnonzero(share > 1e-3)
            bars = [(edges[i], edges[i + 1] - edges[i]) for i in on]
            heights = 0.85 * share[on]
            if len(bars):
                x = np.array([[a, a, a + w, a + w] for a, w in bars]).ravel()
                y = np.array([[-row, -row + h, -row + h, -row] for h in heights]).ravel()
                axes.fill(x, y, color=colour, linewidth=0, gid=f"jet{row + 1}-firing")
        labels = [f"{'▸ ' if jet in found else ''}{line(jet, 11)}" for jet in jets]
        axes.set_yticks([-row + 0.3 for row in range(len(jets))], labels, fontsize=7)
        for label, jet in zip(axes.get_yticklabels(), jets, strict=True):
            label.set_color(palette.RED if jet in found else palette.INK)
        axes.set_ylim(-len(jets) + 0.8, 1.1)
        axes.grid(visible=False, axis="y")
        axis.phases(axes, [phase for _, phase, _ in parts])

    busiest = sorted(zip((float(share.mean()) for share in rows), jets, strict=True), reverse=True)[:3]
    if jets:
        told = f"Thrust of each of {len(jets)} jets against time; busiest: " + ", ".join(
            f"{line(jet, 40)} {share:.0%}" for share, jet in busiest
        )
    alt_text = f"{told}{f'; named by a warning: {chr(44).join(found)}' if found else ''}"
    return Panel("firing", alt_text, paint, (LENGTH * 1.5, ROW * max(len(jets), 6) + 0.85))
