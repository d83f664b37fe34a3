"""The root mean square of errors over their sigmas, and how far it scatters by chance where errors of one log are correlated."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array


def deviate(error: Array, covariance: Array) -> tuple[Array, float]:
    """(n,) errors over their sigmas, and the variance of the mean of their squares: ``2 tr(R²) / n²`` with correlations R."""
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    return error / sigma, 2 * float((correlation**2).sum()) / len(error) ** 2


def rms(deviates: Sequence[tuple[Array, float]]) -> str:
    """Of all, with its standard error: half that of the mean square, which is 1."""
    of_all = np.sqrt(np.mean([(z**2).mean() for z, _ in deviates]))
    chance = np.sqrt(np.sum([variance for _, variance in deviates])) / len(deviates) / 2
    return f"{of_all:.3f} ± {chance:.3f}"
