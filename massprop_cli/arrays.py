"""The array type, and freezing arrays that a stage hands on."""

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
