"""Whiteness of the innovations, which should be independent and standard normal."""

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.report import checks
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import Axes, Panel, Picture
from massprop_cli.report.figures.recording import Covered, covered, over_time, sensed, thinned
from massprop_cli.report.figures.series import AxisRange, padded, parts_of, thin
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import AXES

KINDS = {"rate": "Rate", "specific_force": "Specific force"}
COLUMNS = [f"whitened_{kind}_{letter}" for kind in KINDS for letter in AXES]
EDGES = np.linspace(-4.5, 4.5, 28)
"""Edges of the histogram, sigmas; its outermost bins include all values beyond."""
LAGS = 20
"""Largest lag of the autocorrelation, cycles."""
WINDOW = 50
"""Length of the running mean, cycles."""
Style = tuple[str, str | tuple[float, tuple[float, ...]]]
_STYLES: tuple[Style, ...] = ((palette.BLUE, "-"), (palette.ORANGE, (0, (4, 1.5))), (palette.GREEN, (0, (1, 1))))


def picture(recorded: Recorded) -> Picture:
    """Histogram, autocorrelation and running mean square, for rate and for specific force."""
    parts = covered(recorded, COLUMNS)
    kinds = [kind for kind in KINDS if sensed(parts, kind)]
    panels = [panel for kind in kinds for panel in (_histogram(kind, parts), _autocorrelation(kind, parts), _running(kind, parts))]
    caption = (
        "Whitened innovations: measured − predicted of each cycle before the filter used it, over its expected sigma; solid X, dashed Y, "
        "dotted Z. Left: their histogram with the normal curve (grey). Middle: autocorrelation, with the range of chance (dashes). Right: "
        f"normalised innovation squared, mean over {WINDOW} cycles, with its expected value and the range of chance. If model and noise "
        "are right, all three follow the grey."
    )
    return Picture(caption + thinned(parts), tuple(panels))


def whitened(parts: list[Covered], kind: str) -> list[Array]:
    """(K, a) finite whitened innovations of each phase, on the a axes in the log."""
    found = [np.column_stack([each[f"whitened_{kind}_{letter}"] for letter in sensed(parts, kind)]) for *_, each in parts]
    return [z[np.isfinite(z).all(1)] for z in found]


def _styles(parts: list[Covered], kind: str) -> list[tuple[str, Style]]:
    """Letter and line style of each axis in the log."""
    style = dict(zip(AXES, _STYLES, strict=True))
    return [(letter, style[letter]) for letter in sensed(parts, kind)]


def autocorrelation(pieces: list[Array]) -> Array:
    """(LAGS, a) autocorrelation Σ z[k + lag] z[k] / Σ z[k]², with no products across phase boundaries."""
    total = np.maximum(sum((z**2).sum(0) for z in pieces), TINY)
    sums = [sum((z[lag:] * z[:-lag]).sum(0) for z in pieces if len(z) > lag) for lag in range(1, LAGS + 1)]
    return np.asarray(np.array([np.zeros(total.shape) + one for one in sums]) / total)


def running(z: Array) -> Array:
    """(K − WINDOW + 1,) running mean of the sum of squares of z (K, a)."""
    sums = np.concatenate([[0.0], np.cumsum((z**2).sum(1))])
    return np.asarray((sums[WINDOW:] - sums[:-WINDOW]) / WINDOW)


def _histogram(kind: str, parts: list[Covered]) -> Panel:
    z = np.concatenate(whitened(parts, kind))
    width = EDGES[1] - EDGES[0]
    density = [np.histogram(np.clip(z[:, i], EDGES[0], EDGES[-1]), EDGES)[0] / max(len(z), 1) / width for i in range(z.shape[1])]
    beyond = float((np.abs(z) > -EDGES[0]).mean()) if z.size else 0.0

    def paint(axes: Axes) -> None:
        curve = np.linspace(EDGES[0], EDGES[-1], 91)
        axes.fill_between(
            curve, np.exp(-(curve**2) / 2) / np.sqrt(2 * np.pi), color=palette.MUTED, alpha=0.28, linewidth=0, gid=f"{kind}-normal"
        )
        for (letter, (colour, style)), values in zip(_styles(parts, kind), density, strict=True):
            edges, tops = np.repeat(EDGES, 2), np.concatenate([[0.0], np.repeat(values, 2), [0.0]])
            axes.plot(edges, tops, color=colour, linestyle=style, linewidth=1.0, gid=f"{kind}_{letter}-histogram")
        axis.heading(axes, f"{KINDS[kind]}: histogram", "share per σ")
        axes.set_xlim(EDGES[0], EDGES[-1])
        axes.set_ylim(0.0, max(0.45, 1.05 * max(float(values.max()) for values in density)))
        axes.set_xlabel(f"innovation [σ]{f'; {beyond:.1%} lie beyond' if beyond > 1e-3 else ''}", labelpad=2)

    alt_text = f"Histogram of whitened innovations in {KINDS[kind].lower()} with the normal curve: {beyond:.2%} lie beyond 4.5 sigma"
    return Panel(f"histogram_{kind}", alt_text, paint)


def _autocorrelation(kind: str, parts: list[Covered]) -> Panel:
    pieces = whitened(parts, kind)
    found, bound = autocorrelation(pieces), checks.COUNT / np.sqrt(max(sum(len(z) for z in pieces), 1))
    reach = max(1.5 * bound, 1.1 * float(np.abs(found).max()))
    lags = np.arange(1, LAGS + 1)

    def paint(axes: Axes) -> None:
        axis.values(axes, AxisRange(-reach, reach), f"{KINDS[kind]}: autocorrelation", "1")
        axes.set_xlim(0, LAGS + 0.5)
        axes.set_xticks(range(0, LAGS + 1, 5))
        axes.axhspan(-bound, bound, color=palette.MUTED, alpha=0.18, linewidth=0)
        for (letter, (colour, style)), values in zip(_styles(parts, kind), found.T, strict=True):
            axes.plot(
                lags, values, color=colour, linestyle=style, marker=".", markersize=3, linewidth=0.9, gid=f"{kind}_{letter}-correlation"
            )
        for sign in (1, -1):
            axes.axhline(sign * bound, color=palette.MUTED, linestyle=(0, (4, 2)), linewidth=0.9)
        axes.set_xlabel("cycles later", labelpad=2)

    largest = float(np.abs(found).max())
    alt_text = f"Autocorrelation of whitened innovations in {KINDS[kind].lower()}: at most {largest:.2f}, chance leaves {bound:.2f}"
    return Panel(f"autocorrelation_{kind}", alt_text, paint)


def _running(kind: str, parts: list[Covered]) -> Panel:
    lines, letters = [], sensed(parts, kind)
    for number, _, each in parts:
        z = np.column_stack([each[f"whitened_{kind}_{letter}"] for letter in letters])
        known = np.isfinite(z).all(1)
        if known.sum() > WINDOW:
            lines.append((number, each["time_s"][known][WINDOW - 1 :], running(z[known])))
    expected = len(letters)
    spread = checks.COUNT * np.sqrt(2 * expected / WINDOW)
    highest = max((float(values.max()) for *_, values in lines), default=float(expected))
    limits = padded(0.0, max(expected + 1.3 * spread, highest), 0.03)

    def paint(axes: Axes) -> None:
        over_time(axes, parts, limits, f"{KINDS[kind]}: normalised innovation squared", "1")
        axes.axhspan(max(expected - spread, 0.0), expected + spread, color=palette.MUTED, alpha=0.18, linewidth=0)
        axes.axhline(expected, color=palette.MUTED, linestyle=(0, (4, 2)), linewidth=0.9)
        for number, time_s, values in lines:
            rows = thin(values, buckets=parts_of(len(parts)) // 2)
            axes.plot(time_s[rows], values[rows], color=palette.BLUE, linewidth=0.9, gid=f"{kind}-running-{number}")

    alt_text = f"Running normalised innovation squared in {KINDS[kind].lower()} against time: at most {highest:.3g}, {expected} is expected"
    return Panel(f"running_{kind}", alt_text, paint)
