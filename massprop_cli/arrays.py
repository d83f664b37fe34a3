"""The array type, freezing arrays that a stage hands on, and the factorisations that all square-root forms share."""

from __future__ import annotations

from functools import cache
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


MUCH = 1e6
"""Growth of information within a block, as part of what was there, up to which products hold it to ten digits."""


def triangle_of(rows: Array) -> Array:
    """The upper triangle of an orthogonal factorisation, as many rows as there are columns, or fewer."""
    if rows.ndim > 2:
        return np.asarray(np.linalg.qr(rows, mode="r"))
    # "raw" has the triangle's transpose in its lower left, and Householder vectors, which are not wanted, beside it
    packed, _ = np.linalg.qr(rows, mode="raw")
    upper = packed[:, : min(rows.shape)].T
    return np.where(_upper(*upper.shape), upper, 0.0)


@cache
def _upper(rows: int, columns: int) -> BoolArray:
    return ~np.tri(rows, columns, -1, dtype=bool)


def root_beside_unit(ahead: Array) -> Array:
    """(K, n, n) lower-triangular root of ``1 + ahead aheadᵀ``, never squared: a prediction from hardly anything is huge."""
    count, rows, _ = ahead.shape
    upper = triangle_of(np.concatenate([ahead.transpose(0, 2, 1), np.broadcast_to(np.eye(rows), (count, rows, rows))], 1))
    found: Array = (upper * np.sign(np.einsum("kii->ki", upper))[..., None]).transpose(0, 2, 1)
    return found


def grown(triangle: Array, rows: Array) -> Array:
    """(K + 1, n, n + c) a triangle (n, n + c) on n unknowns and c columns beside, and the same with rows (K, …, n + c) added one by one.

    In unknowns of which the triangle makes a unit matrix, a block that tells little beside what is known already is added by products;
    one that tells far more, by an orthogonal factorisation for each, since products would lose the rest in their rounding.
    """
    count = len(triangle)
    found = np.empty((len(rows) + 1, *triangle.shape))
    found[0] = triangle
    by_unit = rows[..., :count] @ np.linalg.inv(triangle[:, :count])
    if not np.vdot(by_unit, by_unit) < MUCH:
        for k, row in enumerate(rows):
            found[k + 1] = triangle_of(np.vstack([found[k], row]))[:count]
        return found
    left = rows[..., count:] - by_unit @ triangle[:, count:]
    transposed = by_unit.transpose(0, 2, 1)
    root = np.linalg.cholesky(np.eye(count) + np.cumsum(transposed @ by_unit, 0))
    found[1:] = root.transpose(0, 2, 1) @ triangle
    found[1:, :, count:] += np.linalg.solve(root, np.cumsum(transposed @ left, 0))
    return found


def median(values: Array) -> float:
    """The middle value, or the mean of both; numpy's own imports masked arrays for it, a good part of a short run's time."""
    ordered = np.sort(values, axis=None)
    half = len(ordered) // 2
    return float(ordered[half] if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2)
