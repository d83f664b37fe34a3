"""Correlation matrix of the ten estimates."""

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.escape import line
from massprop_cli.report import vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import LENGTH, Axes, Panel, Picture
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import Matrix

CAPTION = (
    "Correlation of the errors of each pair of quantities, from the covariance: 1 is the same error, −1 the opposite error, 0 independent "
    "errors. Blue is positive, orange is negative with a minus sign; a deeper colour is stronger. With a strong correlation the motion "
    "gives a combination of the two better than each alone."
)


ONE = 1e-9
"""Largest distance from 1 of the correlation of a quantity with itself, by rounding."""


def picture(recorded: Recorded) -> Picture:
    """A panel for each phase and for the docked object."""
    phases, docked = recorded.result.phases, recorded.result.docked_object
    named = [(f"phase {line(phase.name, 24)}", phase.covariance) for phase in phases]
    named += [("docked object", docked.covariance)] if docked is not None else []
    panels = tuple(_panel(number, name, covariance, len(named) > 1) for number, (name, covariance) in enumerate(named, 1))
    return Picture(CAPTION, panels, 2)


def correlation(covariance: Matrix) -> Array:
    """(10, 10) correlations from a covariance, NaN without one."""
    matrix = np.array(covariance, dtype=float)
    sigma = np.sqrt(np.diag(matrix))
    with np.errstate(invalid="ignore", divide="ignore"):
        found: Array = matrix / np.outer(sigma, sigma)
    return np.where(np.isfinite(found), np.clip(found, -1.0, 1.0), np.nan)


def short(value: float) -> str:
    """A correlation in few characters: ".93", "−.07", "1"; "·" for NaN."""
    text = written(value)
    return "·" if text == "–" else {"0.00": "0", "1.00": "1"}.get(text, text.replace("0.", ".", 1))


def written(value: float) -> str:
    """A correlation to two decimals, near ±1 to three, and from 0.999 as ">0.999"; only an exact 1 is "1.00"."""
    size = abs(value)
    if np.isnan(value):
        return "–"
    sign = "−" if value < 0 and size >= 0.005 else ""
    if size > 1 - ONE:
        return f"{sign}1.00"
    if size > 0.999:
        return f"{sign}>0.999"
    return f"{sign}{size:.2f}" if size < 0.995 else f"{sign}{size:.3f}"


def _panel(number: int, name: str, covariance: Matrix, several: bool) -> Panel:
    found = correlation(covariance)

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
        axis.title(axes, f"Correlation{f', {name}' if several else ''} [1]")

    return Panel(f"correlation-{number}", _alt_text(name, found), paint, (LENGTH * 1.1, LENGTH * 1.02))


def _alt_text(name: str, found: Array) -> str:
    pairs = [(abs(found[i, j]), i, j) for i in range(10) for j in range(i) if abs(found[i, j]) >= 0.3]
    told = [
        f"{vocabulary.SYMBOLS[QUANTITIES[j]]} with {vocabulary.SYMBOLS[QUANTITIES[i]]} {found[i, j]:.2f}"
        for _, i, j in sorted(pairs, reverse=True)
    ]
    start = f"Correlations of the ten estimates, {name}"
    return f"{start}; strongest: {', '.join(told[:5])}" if told else f"{start}; none is above 0.3"
