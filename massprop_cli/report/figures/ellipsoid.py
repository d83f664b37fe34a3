"""Equivalent inertia ellipsoid: an oblique view, and views along the body axes."""

import numpy as np

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.base.escape import line
from massprop_cli.report import body
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import Axes, Panel, Picture
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import PhaseItem

SIDE = 2.5
"""Side of a panel, inches."""
MARGIN = 0.1
"""Margin relative to the largest extent; all views of a body have the same scale."""
_AZIMUTH, _ELEVATION = np.radians(-52.0), np.radians(24.0)
OBLIQUE = np.array(
    [
        [-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0],
        [-np.sin(_ELEVATION) * np.cos(_AZIMUTH), -np.sin(_ELEVATION) * np.sin(_AZIMUTH), np.cos(_ELEVATION)],
    ]
)
VIEWS = {
    "oblique": ("Oblique", "", OBLIQUE),
    "top": ("From +Z", "XY", np.eye(3)[[0, 1]]),
    "side": ("From −Y", "XZ", np.eye(3)[[0, 2]]),
    "front": ("From +X", "YZ", np.eye(3)[[1, 2]]),
}
"""For each view: heading, letters of the body axes to the right and up, and these directions (2, 3) in body axes."""
SHORTEST = 0.2
"""Shortest principal axis with a number, relative to the largest extent of the outline."""
_STYLES = ("-", (0, (5, 2)), (0, (1, 1.2)))


def picture(recorded: Recorded) -> Picture:
    """All views of each phase."""
    phases, bearing_mass = recorded.result.phases, recorded.result.vehicle.bearing_mass_kg
    found = [(number, phase, body.ellipsoid(phase, bearing_mass)) for number, phase in enumerate(phases, 1)]
    panels = tuple(_panel(number, phase, seen, view, len(phases) > 1) for number, phase, seen in found for view in VIEWS)
    said = _caption([seen for *_, seen in found])
    if any(phase.estimates[name].verdict == "contradicted" for phase in phases for name in (*INERTIA, "mass")):
        said += " It uses contradicted values."
    return Picture(said, panels, 4)


def outline(seen: body.Ellipsoid, directions: Array, points: int = 65) -> Array:
    """(points, 2) outline about the centre, in projection onto ``directions`` (2, 3)."""
    flat, turn = np.linalg.eigh(directions @ seen.shape @ directions.T)
    angle = np.linspace(0, 2 * np.pi, points)
    return np.asarray(np.column_stack([np.cos(angle), np.sin(angle)]) * np.sqrt(np.maximum(flat, 0.0)) @ turn.T)


def _caption(found: list[body.Ellipsoid | None]) -> str:
    said = (
        "The homogeneous ellipsoid with the estimated mass, CG and inertia: it shows how the mass is distributed, not the body's outline. "
        "Lines are the principal axes: 1 (solid) with the smallest moment, 2 dashed, 3 dotted. Dot: CG. Cross: origin O of the body axes."
    )
    if any(seen is not None and seen.corrected for seen in found):
        said += " No real body has the estimated inertia; the figure shows the nearest possible one."
    if any(seen is not None and not seen.to_scale for seen in found):
        said += " Without a mass its size is unknown; lengths are parts of the longest semi-axis, and O is not shown."
    return said


def _panel(number: int, phase: PhaseItem, seen: body.Ellipsoid | None, view: str, several: bool) -> Panel:
    label, letters, directions = VIEWS[view]
    name = f", {line(phase.name, 16)}" if several else ""

    def paint(axes: Axes) -> None:
        unit = "m" if seen is None or seen.to_scale else "parts"
        axis.heading(axes, f"{label}{name}{f': {letters[0]} right, {letters[1]} up' if letters else ''}", unit)
        axes.set_aspect("equal", adjustable="box")
        if seen is None:
            axis.empty(axes, "inertia is not known")
            return
        _draw(axes, seen, directions, f"{view}-{{}}-{number}")
        reach = max(float(np.ptp(_corners(seen, each), axis=0).max()) for _, _, each in VIEWS.values()) * (0.5 + MARGIN)
        right, up = _corners(seen, directions).mean(0)
        axes.set_xlim(right - reach, right + reach)
        axes.set_ylim(up - reach, up + reach)
        if view == "oblique":
            axes.set_xticks([])
            axes.set_yticks([])
            axes.spines[:].set_visible(False)
            _sections(axes, seen, directions)
        else:
            axes.locator_params(nbins=5)

    return Panel(f"{view}-{number}", _alt_text(phase, seen, label), paint, (SIDE, SIDE))


def _centre(seen: body.Ellipsoid, directions: Array) -> Array:
    """(2,) centre from O in projection; zero if the position of O is unknown."""
    return directions @ seen.center_m if seen.located else np.zeros(2)


def _corners(seen: body.Ellipsoid, directions: Array) -> Array:
    """(2, 2) smallest and largest coordinates of the outline, and of O if its position is known."""
    edge = outline(seen, directions) + _centre(seen, directions)
    shown = np.vstack([edge, np.zeros(2)]) if seen.located else edge
    return np.array([shown.min(0), shown.max(0)])


def _draw(axes: Axes, seen: body.Ellipsoid, directions: Array, gid: str) -> None:
    """Draw outline, principal axes, CG and origin."""
    centre = _centre(seen, directions)
    edge = centre + outline(seen, directions)
    placed = _body_axes(axes, directions, 0.45 * float(np.abs(edge - centre).max())) if seen.located else []
    axes.fill(edge[:, 0], edge[:, 1], facecolor=palette.BLUE, alpha=0.16, linewidth=0)
    axes.plot(edge[:, 0], edge[:, 1], color=palette.BLUE, gid=gid.format("outline"))
    for i in range(3):
        reach = directions @ (seen.axes[:, i] * seen.semi_axes[i])
        ends = np.array([centre - reach, centre + reach])
        axes.plot(ends[:, 0], ends[:, 1], color=palette.ORANGE, linestyle=_STYLES[i], linewidth=1.0)
        if np.linalg.norm(reach) > SHORTEST * np.abs(edge - centre).max():
            placed.append(max(ends[::-1], key=lambda end: min([float(np.linalg.norm(end - one)) for one in placed], default=0.0)))
            _label(axes, placed[-1], f"{i + 1}", palette.ORANGE)
    axes.plot(*centre, marker="o", markersize=4, color=palette.INK, linestyle="")
    if seen.located:
        axes.plot(0, 0, marker="+", markersize=8, markeredgewidth=1.4, color=palette.GREEN, linestyle="")


def _body_axes(axes: Axes, directions: Array, length: float) -> list[Array]:
    """Draw the body axes from O; return the positions of their letters, which other labels must avoid."""
    placed = []
    for i, letter in enumerate("XYZ"):
        tip = directions[:, i] * length
        if np.linalg.norm(tip) > 0.05 * length:
            axes.plot([0, tip[0]], [0, tip[1]], color=palette.GREEN, linewidth=1.2)
            placed.append(1.18 * tip)
            _label(axes, placed[-1], letter, palette.GREEN)
    return placed


def _sections(axes: Axes, seen: body.Ellipsoid, directions: Array) -> None:
    """Draw the sections through two principal axes each."""
    centre = _centre(seen, directions)
    angle = np.linspace(0, 2 * np.pi, 49)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        edges = seen.axes[:, [i, j]] * seen.semi_axes[[i, j]] @ np.array([np.cos(angle), np.sin(angle)])
        drawn = centre[:, None] + directions @ edges
        axes.plot(drawn[0], drawn[1], color=palette.BLUE, linewidth=0.6, alpha=0.8)


def _label(axes: Axes, place: Array, text: str, colour: str) -> None:
    ground = {"boxstyle": "circle,pad=0.12", "facecolor": palette.PAPER, "linewidth": 0, "alpha": 0.85}
    axes.text(place[0], place[1], text, color=colour, fontsize=7.5, fontweight="bold", ha="center", va="center", bbox=ground)


def _alt_text(phase: PhaseItem, seen: body.Ellipsoid | None, label: str) -> str:
    start = f"Equivalent inertia ellipsoid, phase {line(phase.name)}, {label.lower()}"
    if seen is None:
        return f"{start}: the inertia is not known"
    unit = "m" if seen.to_scale else "of the longest"
    return f"{start}: semi-axes {', '.join(f'{a:.3g}' for a in seen.semi_axes)} {unit}"
