"""Pictures of what a vehicle's logs say together: each value by log with the mean, and how far logs scatter in their own sigmas."""

import numpy as np
from numpy.typing import NDArray

from massprop_cli import ALL_UNITS
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.lazy import ticker
from massprop_cli.campaign import pooled
from massprop_cli.campaign.pooled import Group, Pool, Pooled
from massprop_cli.report import vocabulary
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.panel import LENGTH, Axes, Panel, Picture
from massprop_cli.report.figures.series import padded, said, thin

BUCKETS = 100
"""Parts of the campaign, each drawn by its least and its largest value."""
MARKED = 60
"""Logs up to which each has a point of its own; beyond, bars alone."""
WITHIN = 2.0
"""Sigmas; 95.4 % of logs lie within where sigmas hold."""
FAR = 6.0
"""Sigmas at which a log that is farther off is drawn."""


@dataclass(frozen=True)
class Spread:
    """One quantity, log by log."""

    samples: pooled.LogValues
    mean: pooled.Mean
    expected: float | None
    """What all logs expect alike."""

    @property
    def z(self) -> Array:
        """(n,) distance from the mean over its own sigma: x − x̄ has the variance u² − 1/W, since x is part of x̄."""
        own = self.samples.own
        variance = own**2 - 1 / (own**-2.0).sum()
        return np.asarray((self.samples.value - self.mean.value) / np.sqrt(np.maximum(variance, (1e-6 * own) ** 2)))

    @property
    def within(self) -> int:
        """The number of logs within two sigmas of the mean."""
        return int((np.abs(self.z) <= WITHIN).sum()) if len(self.samples.value) > 1 else len(self.samples.value)


def spreads(group: Group) -> dict[str, Spread]:
    """The values of each quantity that any log gives."""
    values = np.array(group.values)
    found = {}
    for i, name in enumerate(ALL_UNITS):
        told = np.isfinite(values[:, i, 0])
        if told.any():
            samples = pooled.LogValues(np.array(group.numbers, dtype=float)[told], *values[told, i].T)
            alike = group.expected[i]
            found[name] = Spread(samples, pooled.mean(samples), next(iter(alike)) if len(alike) == 1 else None)
    return found


def picture(found: dict[str, Spread], of: Pool) -> Picture:
    """A panel for each quantity, and one of all in sigmas."""
    panels = [_values(name, spread, of.items[name]) for name, spread in found.items()]
    lengths = [len(spread.samples.value) for spread in found.values()]
    thinned = said(lengths, BUCKETS).replace("cycles", "logs")
    caption = (
        "Value of each log ± its sigma, above its number in the table. Blue line and band: weighted mean ± sigma. Grey dashes: trend. "
        "Green: what all logs expect alike. Last: each log's distance from the mean in its own sigmas; 95 % lie within the band where "
        f"sigmas hold and the vehicle did not change; beyond {FAR:g} it stands at the edge.{thinned}"
    )
    return Picture(caption, (*panels, _scatter(found)), 3)


def _rows(spread: Spread) -> NDArray[np.intp]:
    return thin(spread.samples.value, buckets=BUCKETS)


def _values(name: str, spread: Spread, told: Pooled) -> Panel:
    samples, mean = spread.samples, spread.mean
    rows = _rows(spread)
    at, value, sigma = samples.number[rows], samples.value[rows], samples.sigma[rows]
    ends = [*(value - sigma), *(value + sigma), mean.value, *([] if spread.expected is None else [spread.expected])]
    limits = padded(float(min(ends)), float(max(ends)), 0.06)
    first, last = float(samples.number[0]), float(samples.number[-1])

    def paint(axes: Axes) -> None:
        axis.values(axes, limits, vocabulary.SYMBOLS[name], vocabulary.unit(told.unit))
        axes.set_xlim(first - 0.6, last + 0.6)
        axes.xaxis.set_major_locator(ticker.MaxNLocator(nbins=8, integer=True, min_n_ticks=1))
        axes.axhspan(mean.value - mean.sigma, mean.value + mean.sigma, color=palette.BLUE, alpha=0.2, linewidth=0)
        axes.axhline(mean.value, color=palette.BLUE, linewidth=1.0, gid=f"{name}-mean")
        if spread.expected is not None:
            axes.axhline(spread.expected, color=palette.GREEN, linestyle=(0, (6, 2)), linewidth=1.0, gid=f"{name}-expected")
        if told.trend_per_log is not None:
            weight = samples.own**-2.0
            middle = float(weight @ samples.number / weight.sum())
            ends = np.array([first, last])
            line = mean.value + told.trend_per_log * (ends - middle)
            axes.plot(ends, line, color=palette.MUTED, linestyle=(0, (3, 2)), linewidth=0.9, gid=f"{name}-trend")
        bars = np.column_stack([value - sigma, value + sigma, np.full(len(at), np.nan)]).ravel()
        axes.plot(np.repeat(at, 3), bars, color=palette.INK, linewidth=0.8, gid=f"{name}-bars")
        if len(at) <= MARKED:
            axes.plot(at, value, "o", color=palette.INK, markersize=3.2, gid=f"{name}-values")
        axes.set_xlabel("log", labelpad=2)

    says = f"{vocabulary.SYMBOLS[name]} of {len(samples.value)} logs with error bars: mean {mean.value:.6g} ± {mean.sigma:.2g} {told.unit}"
    return Panel(name, says, paint)


def _scatter(found: dict[str, Spread]) -> Panel:
    def paint(axes: Axes) -> None:
        axis.heading(axes, "Distance from the mean, all quantities", "σ")
        axes.set_xlim(-FAR - 0.3, FAR + 0.3)
        axes.set_ylim(len(found) - 0.4, -0.6)
        axes.set_yticks(range(len(found)), [vocabulary.SYMBOLS[name] for name in found])
        axes.grid(visible=False, axis="y")
        axes.axvspan(-WITHIN, WITHIN, color=palette.MUTED, alpha=0.18, linewidth=0)
        for row, (name, spread) in enumerate(found.items()):
            z = np.clip(spread.z[_rows(spread)], -FAR, FAR)
            across, up = np.repeat(z, 3), np.tile([row - 0.3, row + 0.3, np.nan], len(z))
            axes.plot(across, up, color=palette.BLUE, linewidth=1.0, gid=f"{name}-scatter")

    told = ", ".join(f"{vocabulary.SYMBOLS[name]} {one.within} of {len(one.samples.value)}" for name, one in found.items())
    return Panel("scatter", f"Distance of each log from the mean in its own sigmas; within 2: {told}", paint, (LENGTH, 2.6))
