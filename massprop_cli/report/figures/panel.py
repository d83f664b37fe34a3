"""Panels, one pair of axes each with an alternative text, and pictures, the panels of one figure."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from massprop_cli.base.dataclass import dataclass

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
else:
    Axes = Any  # drawing imports matplotlib later

LENGTH, HEIGHT = 4.0, 2.1
"""Default width and height of a panel, inches; text is readable at the width of a phone."""
LEFT, RIGHT, BOTTOM, TOP = 0.64, 0.12, 0.42, 0.28
"""Margins around the axes, inches."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes with its drawing function."""

    key: str
    """Key in the picture; the id of the axes in the SVG is ``axes-KEY``."""
    alt_text: str
    """Alternative text."""
    paint: Callable[[Axes], None]
    size: tuple[float, float] = (LENGTH, HEIGHT)
    """Width and height, inches."""
    bottom: float = BOTTOM
    """Margin below the axes, inches."""
    logarithmic: bool = False
    """Whether the vertical coordinate is the logarithm to base ten of the value."""


@dataclass(frozen=True)
class Picture:
    """Panels of one figure, with a caption."""

    caption: str
    panels: tuple[Panel, ...]
    columns: int = 3
    """Largest number of panels side by side."""


def nothing(why: str) -> Panel:
    """A panel with a message in place of axes."""

    def paint(axes: Axes) -> None:
        axes.axis("off")
        axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center")

    return Panel("nothing", why, paint, (2 * LENGTH, HEIGHT / 2), 0.0)
