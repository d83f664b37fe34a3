"""Array types, interpolation, and the orthogonal factorisations of the square-root estimators."""

from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.integer[Any]]
ComplexArray = NDArray[np.complexfloating[Any]]
TINY = 1e-300
"""Lower bound of divisors and arguments of logarithms."""
ROUNDING = 1e-9
"""Relative size of a sum, compared with its terms, below which it is a rounding error."""
NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal deviate."""


def frozen(array: Array) -> Array:
    """Read-only view of an array."""
    view = array.view()
    view.flags.writeable = False
    return view


def runs(rows: BoolArray) -> IntArray:
    """(n, 2) first row, and row after the last, of each run of True."""
    return np.flatnonzero(np.diff(rows, prepend=False, append=False)).reshape(-1, 2)


def last_before(used: BoolArray) -> IntArray:
    """(K,) index of the last row up to each row that is ``used`` (K,); the first used one before that; the row itself if none is used."""
    rows, every = np.flatnonzero(used), np.arange(len(used))
    return rows[np.maximum(np.searchsorted(rows, every, "right") - 1, 0)] if len(rows) else every


def cubic(wanted: Array, at: Array, values: Array) -> Array:
    """Values (n,) interpolated by cubic Hermite splines (Catmull & Rom 1974); the nearest value outside."""
    from scipy.interpolate import CubicHermiteSpline

    if len(at) < 2:
        return np.full(np.shape(wanted), values[0])
    return np.asarray(CubicHermiteSpline(at, values, np.gradient(values, at))(np.clip(wanted, at[0], at[-1])))


def spline(wanted: Array, at: Array, values: Array) -> Array:
    """Values (n,) interpolated by a cubic spline with continuous slope and curvature."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(at, values)(wanted))


Numbers = TypeVar("Numbers", Array, ComplexArray)


def recursion(added: Numbers, kept: Numbers, least: float = 0.0) -> Numbers:
    """Linear recursion (…, n) ``y[k] = added[k] + kept[k] y[k − 1]``, ``y[0] = added[0]``, by doubling the number of steps in each pass.

    Stops when all products of ``kept`` are at most ``least``.
    """
    found, kept, reach = added.copy(), kept.copy(), 1
    kept[..., 0] = 0.0
    while reach < found.shape[-1] and np.abs(kept).max() > least:
        found[..., reach:] += kept[..., reach:] * found[..., :-reach]
        kept[..., reach:] = kept[..., reach:] * kept[..., :-reach]
        kept[..., :reach] = 0.0
        reach *= 2
    return found


MUCH = 1e6
"""Largest relative growth of information that normal equations represent with ten digits."""


def triangle_of(rows: Array) -> Array:
    """Upper triangle R of the QR factorisation of ``rows`` (..., N, n): (..., min(N, n), n)."""
    if rows.ndim > 2:
        return np.asarray(np.linalg.qr(rows, mode="r"))
    # "raw" has Rᵀ in the lower left; the Householder vectors above it are not needed
    packed, _ = np.linalg.qr(rows, mode="raw")
    upper = packed[:, : min(rows.shape)].T
    return np.where(_upper(*upper.shape), upper, 0.0)


def singular(matrix: Array) -> tuple[Array, Array, Array]:
    """Thin SVD (N, r), (r,), (r, n) of a matrix (N, n); LAPACK fails on some rank-deficient ones, but not with the columns reversed."""
    try:
        left, values, right = np.linalg.svd(matrix, full_matrices=False)
    except np.linalg.LinAlgError:
        left, values, right = np.linalg.svd(matrix[:, ::-1], full_matrices=False)
        right = right[:, ::-1]
    return left, values, right


@cache
def _upper(rows: int, columns: int) -> BoolArray:
    return ~np.tri(rows, columns, -1, dtype=bool)


def root_beside_unit(ahead: Array) -> Array:
    """(K, n, n) lower-triangular root of ``1 + A Aᵀ``, A = ``ahead`` (K, n, m), by QR; A may be too large to be squared."""
    count, rows, _ = ahead.shape
    upper = triangle_of(np.concatenate([ahead.transpose(0, 2, 1), np.broadcast_to(np.eye(rows), (count, rows, rows))], 1))
    return np.asarray((upper * np.sign(np.einsum("kii->ki", upper))[..., None]).transpose(0, 2, 1))


def grown(triangle: Array, rows: Array) -> Array:
    """(K + 1, n, n + c) square-root information ``triangle`` (n, n + c) of n unknowns and c right-hand sides, before and after each row.

    ``rows`` (K, …, n + c) are added one by one. In units of the triangle, rows with little information are added by normal equations, and a
    row with much more by QR, because normal equations would lose the rest in rounding. The choice does not depend on later rows.
    """
    triangles = np.empty((len(rows) + 1, *triangle.shape))
    triangles[0] = triangle
    done, count = 0, len(triangle)
    while done < len(rows):
        current = triangles[done]
        scaled = rows[done:, ..., :count] @ np.linalg.inv(current[:, :count])
        growth = np.cumsum(np.einsum("kij,kij->k", scaled, scaled))
        few = len(growth) if growth[-1] < MUCH else int(np.argmin(growth < MUCH))
        if few:
            scaled = scaled[:few]
            transposed = scaled.transpose(0, 2, 1)
            residual = rows[done : done + few, ..., count:] - scaled @ current[:, count:]
            root = np.linalg.cholesky(np.eye(count) + np.cumsum(transposed @ scaled, 0))
            part = triangles[done + 1 : done + few + 1]
            np.matmul(root.transpose(0, 2, 1), current, out=part)
            part[:, :, count:] += np.linalg.solve(root, np.cumsum(transposed @ residual, 0))
            done += few
        if done < len(rows):
            triangles[done + 1] = triangle_of(np.vstack([triangles[done], rows[done]]))[:count]
            done += 1
    return triangles


def median(values: Array) -> float:
    """Median of all values; numpy's imports masked arrays, which takes a good part of a short run."""
    ordered = np.sort(values, axis=None)
    half = len(ordered) // 2
    return float(ordered[half] if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2)
