"""Constancy test: estimates from the first part of a log against those of all of it.

The difference between the estimate θ_k of the first k cycles and the last estimate θ_N has the variance P_k − P_N (Hausman, Econometrica
46, 1978). Over k, (θ_k − θ_N)² / (P_k − P_N) is the square of a standardised Brownian bridge. Its maximum exceeds c² by chance with the
probability

    p(c) = c φ(c) [(1 − 1/c²) ln(τ₂ (1 − τ₁) / τ₁ (1 − τ₂)) + 4/c²],   τ = P_N / P_k from τ₁ to τ₂

(James, James and Siegmund, Biometrika 74, 1987). A change of the body or of the IMU during the log hardly shows in the residuals: the fit
absorbs most of it by a mean of the two bodies. A difference within the final sigma, which includes any model discrepancy, is no reason
against a value.
"""

import math
from statistics import NormalDist

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.reason import Reason
from massprop_cli.estimate.history import History
from massprop_cli.model.layout import MU

RATE = 5e-3
"""False-alarm rate: one error-free log in 200 loses the verdict "converged" of a group of values."""
FIRST, LAST = 0.05, 0.8
"""Bounds of τ for the comparison. Below the first, the part of the log holds too little information."""
GROUPS = (list(range(6)), [6, 7, 8], [MU])
"""Inertia, CG, mass: a change of one quantity of a group is a change of the whole group."""


def constancy_test(settled: History, end_s: Array, values: Array, sigmas: Array) -> dict[str, Reason]:
    """Reasons, by quantity, against the verdict "converged": estimates before and after some time differ.

    ``values`` and ``sigmas`` (10,) are final; ``end_s`` (K,) holds the ends of the log's cycles, s.
    """
    if settled.stages is None:
        return {}
    ends, mean, variance = settled.stages()
    parameters, allowed, limit = np.append(values[:MU], 1 / values[MU]), sigmas.copy(), threshold()
    allowed[MU] /= values[MU] ** 2
    with np.errstate(all="ignore"):
        tau = variance[-1] / variance
        # estimate from the rest of the log alone
        rest = (mean[-1] / variance[-1] - mean / variance) / (1 / variance[-1] - 1 / variance)
        tested = (tau > FIRST) & (tau < LAST) & ~(np.abs(rest - mean) <= allowed)
        deviates = np.nan_to_num(np.where(tested, np.abs(mean - mean[-1]) / np.sqrt(variance - variance[-1]), 0.0))
    reasons = dict[str, Reason]()
    for group in GROUPS:
        k, at = divmod(int(deviates[:, group].argmax()), len(group))
        i = group[at]
        if deviates[k, i] > limit:
            before, after = (float(1 / x if i == MU else x) for x in (parameters[i] + mean[k, i], parameters[i] + rest[k, i]))
            data = {"at_s": float(end_s[ends[k] - 1]), "before": before, "after": after, "sigmas": float(deviates[k, i])}
            reasons |= dict.fromkeys((QUANTITIES[j] for j in group), Reason.of("changed", quantity=QUANTITIES[i], **data))
    return reasons


def false_alarm_probability(c: float) -> float:
    """Probability that the largest deviate of one quantity exceeds ``c`` by chance."""
    span = math.log(LAST * (1 - FIRST) / (FIRST * (1 - LAST)))
    return c * NormalDist().pdf(c) * ((1 - c**-2) * span + 4 * c**-2)


def threshold() -> float:
    """Deviate that one of the ten quantities exceeds by chance with its share of :data:`RATE`."""
    low, high = 2.0, 20.0
    for _ in range(60):
        c = (low + high) / 2
        low, high = (c, high) if false_alarm_probability(c) > RATE / len(QUANTITIES) else (low, c)
    return high
