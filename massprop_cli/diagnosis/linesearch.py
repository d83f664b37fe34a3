"""Search for the value of one unknown by its cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache


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
