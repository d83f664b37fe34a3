"""Tests of the model against the log: statistics of the whitened innovations, and cross-validation."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.chance import limit
from massprop_cli.base.dataclass import dataclass
from massprop_cli.result.schema import CrossValidationItem, Innovations

CHANNELS = ("rate X", "rate Y", "rate Z", "specific force X", "specific force Y", "specific force Z")
COUNT = 3.3
"""Allowed deviation of a statistic in sigmas of its sampling distribution; the false-alarm rate is 0.001."""


@dataclass(frozen=True)
class StatisticCheck:
    """A statistic with its expected value and allowed deviation."""

    what: str
    value: float
    expected: float
    allowance: float

    @property
    def inside(self) -> bool:
        """Whether the statistic is within its allowance."""
        return abs(self.value - self.expected) <= self.allowance

    @property
    def cells(self) -> tuple[str, str, str]:
        """Name, value and expected value as text."""
        return (
            self.what,
            f"{self.value:.3g}".replace("-", "−"),
            f"{self.expected:g}" + (f" ± {self.allowance:.2g}" if self.allowance else ""),
        )


def cross_validation(found: CrossValidationItem) -> list[StatisticCheck]:
    """Chi-square of each segment, predicted from all others; the false-alarm rate of all segments together is 1 − level."""
    share, checks = (1 - found.level) / len(found.segments), list[StatisticCheck]()
    for one in found.segments:
        what = f"chi-square of {one.start_s:.4g} to {one.end_s:.4g} s, predicted from the rest of the phase"
        checks.append(StatisticCheck(what, one.chi_square, float(one.freedom), max(limit(share, one.freedom) - one.freedom, 0.0)))
    return checks


def innovations(found: Innovations) -> list[StatisticCheck]:
    """Statistics of the whitened innovations over N cycles, with their expected values.

    Mean sum of squares 6 ± √(12/N), variances 1 ± √(2/N), correlation at lag one 0 ± 1/√N, lack-of-fit factor 1.
    """
    n, columns = found.cycles, zip(CHANNELS, found.channel_variance, found.lack_of_fit, found.lag_one_correlation, strict=True)
    read = [(name, variance, factor, along) for name, variance, factor, along in columns if variance is not None and along is not None]
    count = "six" if len(read) == len(CHANNELS) else str(len(read))
    checks = [
        StatisticCheck(
            f"normalised innovation squared, all {count} channels", found.nis, float(len(read)), COUNT * np.sqrt(2 * len(read) / n)
        )
    ]
    checks += [StatisticCheck(f"variance, {name}", variance, 1.0, COUNT * np.sqrt(2 / n)) for name, variance, _, _ in read]
    checks += [
        StatisticCheck(f"ratio of innovations that commands and motion explain, {name}", factor, 1.0, 0.0) for name, _, factor, _ in read
    ]
    return checks + [
        StatisticCheck(f"correlation from cycle to cycle, {name}", along, 0.0, COUNT / np.sqrt(n)) for name, _, _, along in read
    ]


@dataclass(frozen=True)
class FitVerdict:
    """Whether the model fits the log, with a sentence."""

    holds: bool
    sentence: str


def verdict(held: Sequence[bool]) -> FitVerdict | None:
    """The verdict of all checks; None without checks."""
    if not held:
        return None
    if all(held):
        return FitVerdict(True, f"the model fits the log: {len(held)} of {len(held)} checks hold")
    return FitVerdict(False, f"the model does not fit the log: {sum(held)} of {len(held)} checks hold")
