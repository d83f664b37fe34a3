"""Whether the log tells of one body all along: early estimates against the last, of the same log.

An estimate θ_k of the first k cycles differs from the last one θ_N by what came later, with the variance P_k − P_N (Hausman, Econometrica
46, 1978). The largest of these deviates over k is that of a bridge, and exceeds c by chance with the probability

    p = c φ(c) [(1 − 1/c²) ln(τ₂ (1 − τ₁) / τ₁ (1 − τ₂)) + 4/c²],   τ = P_N / P_k from τ₁ to τ₂

(James, James and Siegmund, Biometrika 74, 1987). Another IMU from some moment on, or ballast that was taken off, hardly shows in what is
left, since most of it is absorbed by a body between the two.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.reason import Reason
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import DOUBTFUL, share
from massprop_cli.model.layout import MU

MOMENTS = 400
"""Times that are looked at, evenly over the log."""
FIRST, LAST = 0.05, 0.8
"""τ between which an estimate is compared with the last one; before, it is hardly informed."""

GROUPS = (list(range(6)), [6, 7, 8], [MU])
"""Moments and products of inertia, CG, mass."""


def changing(history: History) -> dict[str, Reason]:
    """Why values are not to be called converged: what they are before some moment and after it contradict each other."""
    at = np.unique(np.linspace(0, len(history.time_s) - 1, MOMENTS).astype(int))
    values, variances = _inverse_mass(np.asarray(history.values[at]), np.asarray(history.sigmas[at]) ** 2)
    with np.errstate(all="ignore"):
        told = variances[-1] / variances
        later = variances - variances[-1]
        deviates = np.where((told > FIRST) & (told < LAST), np.abs(values - values[-1]) / np.sqrt(later), 0.0)
        # what the log says by itself after that moment
        after = (values[-1] / variances[-1] - values / variances) / (1 / variances[-1] - 1 / variances)
    deviates, found = np.nan_to_num(deviates), dict[str, Reason]()
    for group in GROUPS:  # what changes one of them changes the others, seen or not
        k, most = divmod(int(deviates[:, group].argmax()), len(group))
        i = group[most]
        if deviates[k, i] < threshold():
            continue
        before, then = (float(1 / one if i == MU else one) for one in (values[k, i], after[k, i]))
        data = {"at_s": float(history.time_s[at[k]]), "before": before, "after": then, "sigmas": float(deviates[k, i])}
        found |= dict.fromkeys((QUANTITIES[j] for j in group), Reason.of("changed", quantity=QUANTITIES[i], **data))
    return found


def threshold() -> float:
    """The deviate that one of the ten quantities exceeds by chance with its share of :data:`DOUBTFUL`."""
    most, normal, low, high = share(DOUBTFUL, len(QUANTITIES)), NormalDist(), 2.0, 20.0
    span = float(np.log(LAST * (1 - FIRST) / (FIRST * (1 - LAST))))
    for _ in range(60):
        c = (low + high) / 2
        by_chance = c * normal.pdf(c) * ((1 - c**-2) * span + 4 * c**-2)
        low, high = (c, high) if by_chance > most else (low, c)
    return high


def _inverse_mass(values: Array, variances: Array) -> tuple[Array, Array]:
    """With 1/m for the mass, in which a log is linear."""
    with np.errstate(all="ignore"):
        mass, variance = values[:, MU], variances[:, MU]
        return np.column_stack([values[:, :MU], 1 / mass]), np.column_stack([variances[:, :MU], variance / mass**4])
