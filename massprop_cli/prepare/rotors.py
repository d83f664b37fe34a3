"""Thrust of rotors in time: a polynomial of what is asked for, which a rotor follows with a lag, up and down of its own.

A motor turns up and down towards the speed that it is told, so the lag is the speed's, and thrust is what that makes.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array


class Held(NamedTuple):
    """What is asked for from each time to the next, the lags behind it, and the thrust that it makes."""

    begin_s: Array
    asked: Array
    up_s: float
    down_s: float
    thrust_n: Sequence[float]
    """Coefficients of the polynomial, the constant first."""


def window_integrals(rotors: Sequence[Held], edges_s: Array) -> tuple[Array, Array]:
    """∫ T dt and ∫ (t − bin start) T dt over each bin of ``edges_s``, (bins, rotors) each; before its first command a rotor stood there."""
    found = [_bin_integrals(rotor, edges_s) for rotor in rotors]
    integral, moment = (np.stack(part, 1) for part in zip(*found, strict=True))
    return integral, moment


def _bin_integrals(rotor: Held, edges_s: Array) -> tuple[Array, Array]:
    """Between bins' edges and commands it is at ``x + d exp(−t / lag)``, so thrust is a sum of ``exp(−n t / lag)``."""
    at, lag = _departures(rotor)
    inner = rotor.begin_s[(rotor.begin_s > edges_s[0]) & (rotor.begin_s < edges_s[-1])]
    points = np.sort(np.concatenate([edges_s, inner]))
    first, length = points[:-1], np.diff(points)
    k = np.maximum(np.searchsorted(rotor.begin_s, first, "right") - 1, 0)
    left = at[k] * np.exp(-np.maximum(first - rotor.begin_s[k], 0.0) / lag[k])
    polynomial = np.polynomial.Polynomial(rotor.thrust_n)
    settled = polynomial(rotor.asked[k])
    integral, moment = settled * length, settled * length**2 / 2
    for n in range(1, len(rotor.thrust_n)):
        size, tau = polynomial.deriv(n)(rotor.asked[k]) / factorial(n) * left**n, lag[k] / n
        gone = -np.expm1(-length / tau)
        integral += size * tau * gone
        moment += size * tau * (tau * gone - length * (1 - gone))
    bins = np.minimum(np.searchsorted(edges_s, first, "right") - 1, len(edges_s) - 2)
    moment += (first - edges_s[bins]) * integral
    count = len(edges_s) - 1
    return np.bincount(bins, integral, count).astype(np.float64), np.bincount(bins, moment, count).astype(np.float64)


def _departures(rotor: Held) -> tuple[Array, Array]:
    """(K,) by how much it is over what is asked for as each command begins, and the lag (s) with which that goes; nothing without a lag."""
    length = np.diff(rotor.begin_s, append=rotor.begin_s[-1]).tolist()
    now = float(rotor.asked[0])
    left, lags = [], []
    for asked, lasting in zip(rotor.asked.tolist(), length, strict=True):
        lag = rotor.up_s if asked > now else rotor.down_s
        left.append(now - asked if lag > 0 else 0.0)
        lags.append(lag or 1.0)
        now = asked + left[-1] * float(np.exp(-lasting / lags[-1]))
    return np.array(left), np.array(lags)
