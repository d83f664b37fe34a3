"""The covariance as a picture of correlations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.report import vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import LENGTH, Panel, Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from massprop_cli.result.read import Recorded
    from massprop_cli.result.schema import Matrix, PhaseItem
from massprop_cli.base.escape import line

CAPTION = (
    "Correlation of the errors of each two quantities, from the covariance: 1 means that they are off together, −1 oppositely, 0 "
    "independently. Blue is positive, orange is negative and carries a minus; the deeper the colour, the stronger. A strong correlation "
    "says that the motion told a combination of the two better than each alone."
)


def picture(recorded: Recorded) -> Picture:
    """A panel for each phase."""
    phases = recorded.result.phases
    panels = tuple(_panel(number, phase, len(phases) > 1) for number, phase in enumerate(phases, 1))
    return Picture(CAPTION, panels, 2)


def correlation(covariance: Matrix) -> Array:
    """(10, 10), NaN where nothing can be said."""
    matrix = np.array(covariance, dtype=float)
    sigma = np.sqrt(np.diag(matrix))
    with np.errstate(invalid="ignore", divide="ignore"):
        found: Array = matrix / np.outer(sigma, sigma)
    return np.where(np.isfinite(found), np.clip(found, -1.0, 1.0), np.nan)


def short(value: float) -> str:
    """A correlation in few characters: ".93", "−.07", "1", "·" where nothing can be said."""
    if np.isnan(value):
        return "·"
    text = f"{abs(value):.2f}"
    text = "1" if text == "1.00" else "0" if text == "0.00" else text[1:]
    return f"−{text}" if value < 0 and text != "0" else text


def _panel(number: int, phase: PhaseItem, several: bool) -> Panel:
    found = correlation(phase.covariance)

    def paint(axes: Axes) -> None:
        from matplotlib.patches import Rectangle

        for row in range(10):
            for column in range(10):
                value = found[row, column]
                strength = 0.0 if np.isnan(value) else abs(float(value))
                if strength >= 0.005:
                    colour = palette.BLUE if value > 0 else palette.ORANGE
                    axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, facecolor=colour, alpha=0.62 * strength, linewidth=0))
                axes.text(column, row, short(value), ha="center", va="center", fontsize=7)
        labels = [vocabulary.SYMBOLS[name] for name in QUANTITIES]
        axes.set_xticks(range(10), labels, rotation=45)
        axes.set_yticks(range(10), labels)
        axes.set_xticks(np.arange(-0.5, 10), minor=True)
        axes.set_yticks(np.arange(-0.5, 10), minor=True)
        axes.grid(visible=False, which="major")
        axes.grid(which="minor")
        axes.tick_params(which="both", length=0)
        axes.set_xlim(-0.5, 9.5)
        axes.set_ylim(9.5, -0.5)
        axis.title(axes, f"Correlation{f', phase {line(phase.name, 24)}' if several else ''} [1]")

    return Panel(f"correlation-{number}", _says(phase, found), paint, (LENGTH * 1.1, LENGTH * 1.02))


def _says(phase: PhaseItem, found: Array) -> str:
    pairs = [(abs(found[i, j]), i, j) for i in range(10) for j in range(i) if abs(found[i, j]) >= 0.3]
    told = [
        f"{vocabulary.SYMBOLS[QUANTITIES[j]]} with {vocabulary.SYMBOLS[QUANTITIES[i]]} {found[i, j]:.2f}"
        for _, i, j in sorted(pairs, reverse=True)
    ]
    start = f"Correlations of the ten estimates, phase {line(phase.name)}"
    return f"{start}; strongest: {', '.join(told[:5])}" if told else f"{start}; none is above 0.3"
