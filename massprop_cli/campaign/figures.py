"""Figures of one vehicle's logs: each quantity by log with the weighted mean, and the normalised distances from the mean."""

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
from massprop_cli.report.figures.series import padded, thin, thinning_note

BUCKETS = 100
"""Largest number of intervals along the campaign; of more logs, only the smallest and largest value in each are drawn."""
MARKED = 60
"""Largest number of logs drawn as points; of more logs, only the error bars are drawn."""
WITHIN = 2.0
"""Half width of the marked band, sigmas: 95.4 % of normally distributed values."""
FAR = 6.0
"""Largest distance drawn, sigmas; farther logs appear at the edge."""


@dataclass(frozen=True)
class Spread:
    """One quantity of all logs, with its mean."""

    samples: pooled.LogValues
    mean: pooled.Mean
    expected: float | None
    """The expected value, if all logs expect the same."""

    @property
    def z(self) -> Array:
        """(n,) distance from the mean over its sigma: x − x̄ has the variance u² − 1/W, because x̄ includes x."""
        sigma = self.samples.unshared
        variance = sigma**2 - 1 / (sigma**-2.0).sum()
        return np.asarray((self.samples.value - self.mean.value) / np.sqrt(np.maximum(variance, (1e-6 * sigma) ** 2)))

    @property
    def within(self) -> int:
        """Number of logs within two sigmas of the mean."""
        return int((np.abs(self.z) <= WITHIN).sum()) if len(self.samples.value) > 1 else len(self.samples.value)


def spreads(group: Group) -> dict[str, Spread]:
    """The spread of each quantity that at least one log estimates, by name."""
    values = np.array(group.values)
    by_name = {}
    for i, name in enumerate(ALL_UNITS):
        estimated = np.isfinite(values[:, i, 0])
        if estimated.any():
            samples = pooled.LogValues(np.array(group.numbers, dtype=float)[estimated], *values[estimated, i].T)
            expected = group.expected[i]
            by_name[name] = Spread(samples, pooled.mean(samples), next(iter(expected)) if len(expected) == 1 else None)
    return by_name


def picture(spread_by_name: dict[str, Spread], pool: Pool) -> Picture:
    """A panel for each quantity, and one panel of all normalised distances."""
    panels = [_values(name, spread, pool.items[name]) for name, spread in spread_by_name.items()]
    lengths = [len(spread.samples.value) for spread in spread_by_name.values()]
    thinned = thinning_note(lengths, BUCKETS).replace("cycles", "logs")
    caption = (
        "Value of each log ± its sigma, above its number in the table. Blue line and band: weighted mean ± sigma. Grey dashes: trend. "
        "Green: what all logs expect alike. Last: each log's distance from the mean in its own sigmas; 95 % lie within the band where "
        f"sigmas hold and the vehicle did not change; beyond {FAR:g} it stands at the edge.{thinned}"
    )
    return Picture(caption, (*panels, _scatter(spread_by_name)), 3)


def _rows(spread: Spread) -> NDArray[np.intp]:
    """Indices of the logs to draw."""
    return thin(spread.samples.value, buckets=BUCKETS)


def _values(name: str, spread: Spread, item: Pooled) -> Panel:
    """One quantity by log: values with error bars, mean, expected value and trend."""
    samples, mean = spread.samples, spread.mean
    rows = _rows(spread)
    at, value, sigma = samples.number[rows], samples.value[rows], samples.sigma[rows]
    ends = [*(value - sigma), *(value + sigma), mean.value, *([] if spread.expected is None else [spread.expected])]
    limits = padded(float(min(ends)), float(max(ends)), 0.06)
    first, last = float(samples.number[0]), float(samples.number[-1])

    def paint(axes: Axes) -> None:
        axis.values(axes, limits, vocabulary.SYMBOLS[name], vocabulary.unit(item.unit))
        axes.set_xlim(first - 0.6, last + 0.6)
        axes.xaxis.set_major_locator(ticker.MaxNLocator(nbins=8, integer=True, min_n_ticks=1))
        axes.axhspan(mean.value - mean.sigma, mean.value + mean.sigma, color=palette.BLUE, alpha=0.2, linewidth=0)
        axes.axhline(mean.value, color=palette.BLUE, linewidth=1.0, gid=f"{name}-mean")
        if spread.expected is not None:
            axes.axhline(spread.expected, color=palette.GREEN, linestyle=(0, (6, 2)), linewidth=1.0, gid=f"{name}-expected")
        if item.trend_per_log is not None:
            weight = samples.unshared**-2.0
            middle = float(weight @ samples.number / weight.sum())
            ends = np.array([first, last])
            line = mean.value + item.trend_per_log * (ends - middle)
            axes.plot(ends, line, color=palette.MUTED, linestyle=(0, (3, 2)), linewidth=0.9, gid=f"{name}-trend")
        bars = np.column_stack([value - sigma, value + sigma, np.full(len(at), np.nan)]).ravel()
        axes.plot(np.repeat(at, 3), bars, color=palette.INK, linewidth=0.8, gid=f"{name}-bars")
        if len(at) <= MARKED:
            axes.plot(at, value, "o", color=palette.INK, markersize=3.2, gid=f"{name}-values")
        axes.set_xlabel("log", labelpad=2)

    count = len(samples.value)
    description = f"{vocabulary.SYMBOLS[name]} of {count} logs with error bars: mean {mean.value:.6g} ± {mean.sigma:.2g} {item.unit}"
    return Panel(name, description, paint)


def _scatter(spread_by_name: dict[str, Spread]) -> Panel:
    """Normalised distance of each log from the mean, a row per quantity."""

    def paint(axes: Axes) -> None:
        axis.heading(axes, "Distance from the mean, all quantities", "σ")
        axes.set_xlim(-FAR - 0.3, FAR + 0.3)
        axes.set_ylim(len(spread_by_name) - 0.4, -0.6)
        axes.set_yticks(range(len(spread_by_name)), [vocabulary.SYMBOLS[name] for name in spread_by_name])
        axes.grid(visible=False, axis="y")
        axes.axvspan(-WITHIN, WITHIN, color=palette.MUTED, alpha=0.18, linewidth=0)
        for row, (name, spread) in enumerate(spread_by_name.items()):
            z = np.clip(spread.z[_rows(spread)], -FAR, FAR)
            across, up = np.repeat(z, 3), np.tile([row - 0.3, row + 0.3, np.nan], len(z))
            axes.plot(across, up, color=palette.BLUE, linewidth=1.0, gid=f"{name}-scatter")

    within = ", ".join(f"{vocabulary.SYMBOLS[name]} {one.within} of {len(one.samples.value)}" for name, one in spread_by_name.items())
    return Panel("scatter", f"Distance of each log from the mean in its own sigmas; within 2: {within}", paint, (LENGTH, 2.6))
