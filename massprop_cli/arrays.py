"""The array type, freezing arrays that a stage hands on, and the factorisation that all square-root forms share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]


def frozen(array: Array) -> Array:
    """A read-only view: what one stage hands on, the next can't change."""
    view = array.view()
    view.flags.writeable = False
    return view


def triangle_of(rows: Array) -> Array:
    """The upper triangle of an orthogonal factorisation, as many rows as there are columns, or fewer."""
    upper = np.linalg.qr(rows, mode="r")
    return np.asarray(upper)
