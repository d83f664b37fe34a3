"""A panel is one pair of axes with what it says in words; a picture is the panels that belong together under one name."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from massprop_cli.base.dataclass import dataclass

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
else:
    Axes = Any  # matplotlib is imported once something is drawn

LENGTH, HEIGHT = 4.0, 2.1
"""Inches of an ordinary panel; its text is readable at the width of a phone."""
LEFT, RIGHT, BOTTOM, TOP = 0.64, 0.12, 0.42, 0.28
"""Inches around a panel's axes."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    key: str
    """Names the axes within the picture: ``axes-KEY`` is its id in the SVG."""
    says: str
    """What is seen, in words."""
    paint: Callable[[Axes], None]
    size: tuple[float, float] = (LENGTH, HEIGHT)
    """Width and height, inches."""
    bottom: float = BOTTOM
    """Inches below the axes."""
    logarithmic: bool = False
    """Whether what stands upward is the logarithm to base ten of what is meant."""


@dataclass(frozen=True)
class Picture:
    """Panels that belong together."""

    caption: str
    panels: tuple[Panel, ...]
    columns: int = 3
    """Of panels side by side where there is room."""


def nothing(why: str) -> Panel:
    """A panel that says why it shows nothing."""

    def paint(axes: Axes) -> None:
        axes.axis("off")
        axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center")

    return Panel("nothing", why, paint, (2 * LENGTH, HEIGHT / 2), 0.0)
