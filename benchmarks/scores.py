"""What errors are over their sigmas and bounds, and how far that scatters by chance where errors of one log are correlated."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array


def covered(z: Array) -> str:
    """Share of errors over sigmas within the 95 % interval."""
    return f"{100 * (np.abs(z) <= 1.96).mean():.1f} %"


def rms_of(z: Array) -> str:
    """Root mean square of errors over sigmas; 1 is expected."""
    return f"{np.sqrt((z**2).mean()):.2f}"


def columns(error: Array, sigma: Array, bound: Array) -> list[str]:
    """Of one quantity over seeds (S,): bound, bias, rms error, rms over bound, sigma over bound, z rms and coverage."""
    limit, rms = np.sqrt((bound**2).mean()), np.sqrt((error**2).mean())
    z = error / np.where(sigma > 0, sigma, np.nan)
    ratios = [f"{rms / limit:.2f}", f"{np.median(sigma / bound):.2f}"]
    return [f"{limit:.2g}", f"{error.mean():.2g}", f"{rms:.2g}", *ratios, rms_of(z), covered(z)]


def deviate(error: Array, covariance: Array) -> tuple[Array, float]:
    """(n,) errors over their sigmas, and the variance of the mean of their squares: ``2 tr(R²) / n²`` with correlations R."""
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    return error / sigma, 2 * float((correlation**2).sum()) / len(error) ** 2


def rms(deviates: Sequence[tuple[Array, float]]) -> str:
    """Root mean square over all logs, with its standard error by chance."""
    of_all = np.sqrt(np.mean([(z**2).mean() for z, _ in deviates]))
    chance = np.sqrt(np.sum([variance for _, variance in deviates])) / len(deviates) / 2
    return f"{of_all:.3f} ± {chance:.3f}"
