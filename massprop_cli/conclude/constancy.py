"""Constancy test: estimates from the first part of a log against those of all of it.

An estimate θ_k of the first k cycles differs from the last one θ_N by what came later, with the variance P_k − P_N (Hausman, Econometrica
46, 1978). So (θ_k − θ_N)² / (P_k − P_N) is that of a bridge over k, and its largest exceeds c² by chance with the probability

    p(c) = c φ(c) [(1 − 1/c²) ln(τ₂ (1 − τ₁) / τ₁ (1 − τ₂)) + 4/c²],   τ = P_N / P_k from τ₁ to τ₂

(James, James and Siegmund, Biometrika 74, 1987). Another IMU from some moment on, or ballast that was taken off, hardly shows in what is
left, since most of it is absorbed by a body between the two.
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
"""Clean logs in which a group of values loses its verdict "converged" by chance: one in 200."""
FIRST, LAST = 0.05, 0.8
"""τ between which a part is compared with the whole; before, it is hardly informed."""
GROUPS = (list(range(6)), [6, 7, 8], [MU])
"""Moments and products of inertia, CG, mass: what changes one of a group changes the others, seen or not."""


def changing(settled: History, end_s: Array, values: Array) -> dict[str, Reason]:
    """Why ``values`` (10,) are not to be called converged: what they are before some moment and after it contradict each other.

    ``end_s`` (K,) of the log's cycles.
    """
    if settled.stages is None:
        return {}
    ends, mean, variance = settled.stages()
    with np.errstate(all="ignore"):
        told = variance[-1] / variance
        inside = (told > FIRST) & (told < LAST)
        deviates = np.nan_to_num(np.where(inside, np.abs(mean - mean[-1]) / np.sqrt(variance - variance[-1]), 0.0))
        # what the log says by itself after each moment
        after = (mean[-1] / variance[-1] - mean / variance) / (1 / variance[-1] - 1 / variance)
    found, linear, limit = dict[str, Reason](), np.append(values[:MU], 1 / values[MU]), threshold()
    for group in GROUPS:
        k, most = divmod(int(deviates[:, group].argmax()), len(group))
        i = group[most]
        if deviates[k, i] > limit:
            before, then = (float(1 / one if i == MU else one) for one in (linear[i] + mean[k, i], linear[i] + after[k, i]))
            data = {"at_s": float(end_s[ends[k] - 1]), "before": before, "after": then, "sigmas": float(deviates[k, i])}
            found |= dict.fromkeys((QUANTITIES[j] for j in group), Reason.of("changed", quantity=QUANTITIES[i], **data))
    return found


def by_chance(c: float) -> float:
    """The probability with which the largest deviate of one quantity exceeds c."""
    span = math.log(LAST * (1 - FIRST) / (FIRST * (1 - LAST)))
    return c * NormalDist().pdf(c) * ((1 - c**-2) * span + 4 * c**-2)


def threshold() -> float:
    """The deviate that one of the ten quantities exceeds by chance with its share of :data:`RATE`."""
    low, high = 2.0, 20.0
    for _ in range(60):
        c = (low + high) / 2
        low, high = (c, high) if by_chance(c) > RATE / len(QUANTITIES) else (low, c)
    return high
