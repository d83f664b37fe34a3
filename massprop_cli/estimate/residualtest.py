"""The residual test: one statistic, one false-alarm rate for a log, and the thresholds that follow from it.

A template is what an error would leave in the whitened residuals r: a channel's commands, a swing after each push, the column of an
assumption. The sum of squares of r along the d directions T of a template,

    Q = rᵀ T (TᵀT)⁻¹ Tᵀ r ,   chi-square of d degrees of freedom where the model holds (score test, Rao 1948),

is given as a normal deviate (:func:`deviate`), whatever d. Templates come in families (:data:`FAMILIES`). A rate of false alarms per log is
shared out equally over the families, and in each over the templates that are tested (Bonferroni); the threshold of a template's deviate
follows from its share (:func:`threshold`).
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from massprop_cli.base.arrays import Array

FAMILIES = ("assumptions", "channels", "motion and commands", "oscillations", "whiteness", "lost commands")
"""conclude/score, follows, ..., diagnosis/lackoffit, conclude/swing, white, executed."""
REFUTED = 1e-4
"""Clean logs that are contradicted by chance: one in 10,000. benchmarks/faults.py --clean moves."""
DOUBTFUL = 1e-2
"""Clean logs in which a value loses its verdict "converged" by chance: one in 100. benchmarks/any_vehicle.py moves."""


def share(rate: float, tested: int) -> float:
    """The false-alarm probability of one template, of so many ``tested`` in its family, for a ``rate`` per log."""
    return rate / len(FAMILIES) / max(tested, 1)


def threshold(rate: float, tested: int) -> float:
    """The normal deviate that a template exceeds by chance with its :func:`share` of a ``rate`` per log."""
    return NormalDist().inv_cdf(1 - share(rate, tested))


def deviate(mean: Array, count: Array | int) -> Array:
    """(...) normal deviate of a mean (...) of ``count`` squares of standard normals (Wilson and Hilferty 1931)."""
    spread = 2 / (9 * count)
    return (np.cbrt(mean) - (1 - spread)) / np.sqrt(spread)
