"""The array type, freezing arrays that a stage hands on, and the factorisation that all square-root forms share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.integer[Any]]


def frozen(array: Array) -> Array:
    """A read-only view: what one stage hands on, the next can't change."""
    view = array.view()
    view.flags.writeable = False
    return view


def triangle_of(rows: Array) -> Array:
    """The upper triangle of an orthogonal factorisation, as many rows as there are columns, or fewer."""
    upper = np.linalg.qr(rows, mode="r")
    return np.asarray(upper)


def median(values: Array) -> float:
    """The middle value, or the mean of both; numpy's own imports masked arrays for it, a good part of a short run's time."""
    ordered = np.sort(values, axis=None)
    half = len(ordered) // 2
    return float(ordered[half] if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2)
