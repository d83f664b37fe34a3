"""Search for the value of one unknown by its cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

NEAR, FLAT = 0.01, 1e3
"""Step behind the curvature of what is left by a value; the least curvature that tells a sigma: of 0.04."""


def line_minimum(cost: Callable[[float], float], begun: Sequence[float], step: float, finest: float) -> float:
    """The value with the least cost, from the best of those ``begun`` on by halved steps; of values that cost the same the largest."""

    @cache
    def order(value: float) -> tuple[float, float]:
        return cost(value), -value

    at = min(begun, key=order)
    while step > finest:
        step /= 2
        at = min((at, at - step, at + step), key=order)
    return at


def sigma_at(cost: Callable[[float], float], at: float) -> float:
    """One sigma of a value by the curvature of −2 log likelihood."""
    bent = (cost(at - NEAR) - 2 * cost(at) + cost(at + NEAR)) / NEAR**2
    return float((2 / max(bent, FLAT)) ** 0.5) if np.isfinite(bent) else NEAR
