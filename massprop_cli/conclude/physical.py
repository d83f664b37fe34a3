"""Whether an inertia is a body's."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.conclude.verdict import Conclusion

_PAIRS = 1 - np.eye(3)
"""Principal moments from second moments."""


def physical_note(conclusion: Conclusion) -> str:
    """What no real body could have in this inertia, or an empty text; nothing is said of an inertia that is not wholly informed."""
    low, middle, high = (float(moment) for moment in conclusion.principal_moments)
    if np.isnan(low):
        return ""
    if low <= 0:
        return f"the inertia is not positive definite (least principal moment {low:.4g} kg m^2)"
    if low + middle < high * (1 - 1e-9):
        return f"the inertia breaks the triangle inequality: {low:.4g} + {middle:.4g} < {high:.4g} kg m^2; check jets, units and thrust"
    return ""


def nearest_consistent(inertia: Array) -> Array:
    """The inertia (3, 3) nearest in the sum of squares that a body could have: positive, no principal moment above the others' sum.

    A body's second moments p are positive, and its principal moments are the sums of two of them: non-negative least squares in three
    unknowns, solved by trying which of them are zero (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, chapter 23).
    """
    moments, axes = np.linalg.eigh(inertia)
    candidates = [_PAIRS @ np.maximum(solver @ moments, 0.0) for solver in _solvers()]
    nearest = min(candidates, key=lambda sums: float(((sums - moments) ** 2).sum()))
    consistent: Array = (axes * nearest) @ axes.T
    return consistent


@cache
def _solvers() -> tuple[Array, ...]:
    """Second moments from principal ones, with some of them kept at zero."""
    return tuple(np.linalg.pinv(_PAIRS * keep) for keep in product((1.0, 0.0), repeat=3))
