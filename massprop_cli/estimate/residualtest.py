"""Residual test: one statistic, one false-alarm rate per log, and the thresholds that follow from it.

A template is the effect of an error on the whitened residuals r: a channel's commands, an oscillation after each command, the column of an
assumption. The sum of squares of r along the d directions T of a template,

    Q = rᵀ T (TᵀT)⁻¹ Tᵀ r ,   chi-square of d degrees of freedom if the model holds (score test, Rao 1948),

is reported as a normal deviate (:func:`deviate`) for any d. Templates form families (:data:`FAMILIES`). The false-alarm rate per log is
divided equally among the families, and in each family among the tested templates (Bonferroni). A template's threshold (:func:`threshold`)
follows from its share.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from massprop_cli.base.arrays import Array

FAMILIES = ("assumptions", "channels", "motion and commands", "oscillations", "whiteness", "lost commands")
"""Tested in conclude/score, conclude/channelresiduals, diagnosis/lackoffit, conclude/oscillation, whiteness and lostcommands."""
REFUTED = 1e-4
"""False-alarm rate of a contradiction: one in 10,000 error-free logs. benchmarks/faults.py --clean depends on it."""
DOUBTFUL = 1e-2
"""False-alarm rate of losing the verdict "converged": one in 100 error-free logs. benchmarks/any_vehicle.py depends on it."""


def share(rate: float, tested: int) -> float:
    """False-alarm probability of one template among ``tested`` of its family, for a ``rate`` per log."""
    return rate / len(FAMILIES) / max(tested, 1)


def threshold(rate: float, tested: int) -> float:
    """Normal deviate that a template exceeds by chance with the probability :func:`share`."""
    return NormalDist().inv_cdf(1 - share(rate, tested))


def deviate(mean: Array, count: Array | int) -> Array:
    """(...) normal deviate of a mean (...) of ``count`` squared standard normals (Wilson and Hilferty 1931)."""
    spread = 2 / (9 * count)
    return (np.cbrt(mean) - (1 - spread)) / np.sqrt(spread)
