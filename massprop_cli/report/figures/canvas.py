"""Rendering of panels as SVG or PNG; equal panels give equal bytes.

In an SVG, ``data-x="a b"`` of axes means x = a + b · (SVG's x), and likewise ``data-y``; with ``data-log``, y is a logarithm to base ten.
Lines have ids such as ``ixx-value-1`` with the number of the phase.
"""

import io
import re
import warnings
from collections.abc import Sequence
from html import escape
from typing import Any, Literal

from massprop_cli.base.escape import line
from massprop_cli.base.lazy import mpl, mplfigure
from massprop_cli.report.figures import palette
from massprop_cli.report.figures.panel import LEFT, RIGHT, TOP, Axes, Panel

Kind = Literal["svg", "png"]
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "massprop", "text.parse_math": False, "path.simplify": False, "agg.path.chunksize": 20000,
    "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "font.size": 8, "axes.titlesize": 8.5, "axes.labelsize": 8,
    "xtick.labelsize": 7.5, "ytick.labelsize": 7.5, "legend.fontsize": 7.5, "axes.titlelocation": "left", "axes.titlepad": 5,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.linewidth": 0.6, "axes.linewidth": 0.7,
    "lines.linewidth": 1.2, "axes.axisbelow": True, "legend.frameon": False, "axes.unicode_minus": True, "axes.formatter.useoffset": False,
    "text.color": palette.INK, "axes.labelcolor": palette.INK, "axes.edgecolor": palette.MUTED, "xtick.color": palette.MUTED,
    "ytick.color": palette.MUTED, "xtick.labelcolor": palette.INK, "ytick.labelcolor": palette.INK, "grid.color": palette.GRID,
    "figure.facecolor": palette.PAPER, "axes.facecolor": palette.PAPER, "savefig.facecolor": palette.PAPER,
    "xtick.bottom": False, "ytick.left": False, "axes.titley": 1.0,
}  # fmt: skip
HEADING = 0.3
"""Height of a figure's title above the panels, inches."""


def render(panels: Sequence[Panel], kind: Kind, columns: int = 1, title: str = "") -> bytes:
    """The panels in rows of ``columns``, under a title if there is one."""
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        # a PNG shows characters that the font lacks as boxes; an SVG uses the reader's fonts
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        figure = _figure(panels, min(columns, len(panels)), title)
        stream = io.BytesIO()
        if kind == "svg":
            figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
            logarithmic = [panel.logarithmic for panel in panels]
            return _readable(
                stream.getvalue().decode(), figure, logarithmic, title or "; ".join(panel.alt_text for panel in panels)
            ).encode()
        figure.savefig(stream, format="png", dpi=160, metadata={"Software": None})
        return stream.getvalue()


def _figure(panels: Sequence[Panel], columns: int, title: str) -> Any:
    """A Matplotlib figure of the panels in rows of ``columns``."""
    rows = [panels[start : start + columns] for start in range(0, len(panels), columns)]
    width = max(sum(panel.size[0] for panel in row) for row in rows)
    heights = [max(panel.size[1] for panel in row) for row in rows]
    height = sum(heights) + (HEADING if title else 0)
    figure = mplfigure.Figure(figsize=(width, height))
    if title:
        figure.text(0.12 / width, 1 - 0.1 / height, line(title, 110), va="top", fontsize=10, fontweight="bold")
    top = height - (HEADING if title else 0)
    for row, row_height in zip(rows, heights, strict=True):
        left = 0.0
        for panel in row:
            wide, high = panel.size
            box = (left + LEFT, top - high + panel.bottom, wide - LEFT - RIGHT, high - panel.bottom - TOP)
            axes = figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height), gid=f"axes-{panel.key}")
            panel.paint(axes)
            left += wide
        top -= row_height
    return figure


def _readable(svg: str, figure: Any, logarithmic: Sequence[bool], alt_text: str) -> str:
    """The SVG shortened, without external references, with a title and the scales of each pair of axes."""
    svg = re.sub(r"<!DOCTYPE.*?>\s*", "", svg, count=1, flags=re.DOTALL)
    svg = re.sub(r"\s*<metadata>.*?</metadata>", "", svg, count=1, flags=re.DOTALL)
    svg = re.sub(r'(?<= d=")[^"]*', lambda path: _rounded(path[0]), svg)
    for axes, is_log in zip(figure.axes, logarithmic, strict=True):
        scales = _scales(axes, figure) + ' data-log=""' * is_log
        svg = svg.replace(f'<g id="{axes.get_gid()}">', f'<g id="{axes.get_gid()}" {scales}>', 1)
    return re.sub(r"(<svg[^>]*>)", lambda opening: f"{opening[1]}\n <title>{escape(line(alt_text), quote=False)}</title>", svg, count=1)


def _rounded(path: str) -> str:
    """A path with coordinates to 0.01 point, without the letter of repeated line commands."""
    text = re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), path)
    return re.sub(r"(?<=\d) L (?=-?\d)", " ", " ".join(text.split()))


def _scales(axes: Axes, figure: Any) -> str:
    """Attributes for the map from SVG coordinates to data: x = a + b · (SVG's x), and likewise y, which points down in an SVG."""
    points = 72 / figure.dpi
    height = figure.get_figheight() * 72
    (x0, y0), (x1, y1) = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)]) * points
    bx, by = 1 / (x1 - x0), -1 / (y1 - y0)
    return f'data-x="{-x0 * bx:.17g} {bx:.17g}" data-y="{-(height - y0) * by:.17g} {by:.17g}"'
