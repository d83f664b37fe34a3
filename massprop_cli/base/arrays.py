"""The array type, freezing arrays that a stage hands on, and the factorisations that all square-root forms share."""

from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.integer[Any]]
ComplexArray = NDArray[np.complexfloating[Any]]
TINY = 1e-300
"""Beside which no number is small: keeps zeros out of divisors and logarithms."""
ROUNDING = 1e-9
"""Part of what adds up to a number, below which this is none but for rounding."""


def frozen(array: Array) -> Array:
    """A read-only view: what one stage hands on, the next can't change."""
    view = array.view()
    view.flags.writeable = False
    return view


def runs(rows: BoolArray) -> IntArray:
    """(n, 2) where rows that are True in a row begin, and the row after their last."""
    return np.flatnonzero(np.diff(rows, prepend=False, append=False)).reshape(-1, 2)


def last_before(used: BoolArray) -> IntArray:
    """(K,) of each row the last one up to it that is ``used`` (K,), or the first that is; each itself where none is."""
    rows, every = np.flatnonzero(used), np.arange(len(used))
    return rows[np.maximum(np.searchsorted(rows, every, "right") - 1, 0)] if len(rows) else every


def cubic(wanted: Array, at: Array, values: Array) -> Array:
    """Values (n,) at other times: cubics with the mean slopes there (Hermite; Catmull & Rom 1974); outside, the nearest."""
    from scipy.interpolate import CubicHermiteSpline

    if len(at) < 2:
        return np.full(np.shape(wanted), values[0])
    return np.asarray(CubicHermiteSpline(at, values, np.gradient(values, at))(np.clip(wanted, at[0], at[-1])))


def spline(wanted: Array, at: Array, values: Array) -> Array:
    """Values (n,) at other times by cubics whose slope and curvature go on from one to the next."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(at, values)(wanted))


Numbers = TypeVar("Numbers", Array, ComplexArray)


def recursion(added: Numbers, kept: Numbers, least: float = 0.0) -> Numbers:
    """(…, n) y, ``y[k] = added[k] + kept[k] y[k − 1]`` after y[0] = added[0], with twice the reach in each pass.

    Until no more than ``least`` of anything is kept.
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
"""Growth of information, as part of what was there, up to which products hold it to ten digits."""


def triangle_of(rows: Array) -> Array:
    """The upper triangle of an orthogonal factorisation, as many rows as there are columns, or fewer."""
    if rows.ndim > 2:
        return np.asarray(np.linalg.qr(rows, mode="r"))
    # "raw" has the triangle's transpose in its lower left, and Householder vectors, which are not wanted, beside it
    packed, _ = np.linalg.qr(rows, mode="raw")
    upper = packed[:, : min(rows.shape)].T
    return np.where(_upper(*upper.shape), upper, 0.0)


def singular(matrix: Array) -> tuple[Array, Array, Array]:
    """(N, r), (r,), (r, n) of the thin SVD of (N, n). LAPACK's fails on some low ranks in one order of columns, and hardly in any other."""
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
    """(K, n, n) lower-triangular root of ``1 + ahead aheadᵀ``, never squared: a prediction from hardly anything is huge."""
    count, rows, _ = ahead.shape
    upper = triangle_of(np.concatenate([ahead.transpose(0, 2, 1), np.broadcast_to(np.eye(rows), (count, rows, rows))], 1))
    return np.asarray((upper * np.sign(np.einsum("kii->ki", upper))[..., None]).transpose(0, 2, 1))


def grown(triangle: Array, rows: Array) -> Array:
    """(K + 1, n, n + c) a triangle (n, n + c) on n unknowns and c columns beside, and the same with rows (K, …, n + c) added one by one.

    In units of the triangle, rows that add little information are added by products, one that adds far more by an orthogonal factorisation,
    since products would lose the rest in rounding. Which it is depends on no later row.
    """
    found = np.empty((len(rows) + 1, *triangle.shape))
    found[0] = triangle
    known, count = 0, len(triangle)
    while known < len(rows):
        own = found[known]
        by_unit = rows[known:, ..., :count] @ np.linalg.inv(own[:, :count])
        told = np.cumsum(np.einsum("kij,kij->k", by_unit, by_unit))
        few = len(told) if told[-1] < MUCH else int(np.argmin(told < MUCH))
        if few:
            by_unit = by_unit[:few]
            transposed = by_unit.transpose(0, 2, 1)
            left = rows[known : known + few, ..., count:] - by_unit @ own[:, count:]
            root = np.linalg.cholesky(np.eye(count) + np.cumsum(transposed @ by_unit, 0))
            part = found[known + 1 : known + few + 1]
            np.matmul(root.transpose(0, 2, 1), own, out=part)
            part[:, :, count:] += np.linalg.solve(root, np.cumsum(transposed @ left, 0))
            known += few
        if known < len(rows):
            found[known + 1] = triangle_of(np.vstack([found[known], rows[known]]))[:count]
            known += 1
    return found


def median(values: Array) -> float:
    """The middle value, or the mean of both; numpy's own imports masked arrays for it, a good part of a short run's time."""
    ordered = np.sort(values, axis=None)
    half = len(ordered) // 2
    return float(ordered[half] if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2)
