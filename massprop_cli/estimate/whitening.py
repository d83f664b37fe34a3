"""Whitening of rates under a white or wandering disturbance torque, at the maximum likelihood levels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, triangle_of
from massprop_cli.kernel import call, kernel

LEVELS, FINER = (1e-6, 1e-4, 1e-2, 1.0), 10.0
"""Of a disturbance, each tried: the most likely is taken, and what is so much smaller and larger."""
SAME = 1e-8
"""Part of a column that others leave of it, below which it is one of them but for rounding."""
EXPLAINED = 1.3
"""Mean square over the stated noise up to which none is looked for."""


class Disturbance(NamedTuple):
    """What moves the rate beside all columns and beside what is stated: variances per cycle over that of the gyro's noise."""

    white: float
    """Of the rate's own steps."""
    walk: float
    """Of the change, from cycle to cycle, of what it grows by."""


NONE = Disturbance(0.0, 0.0)
TORQUES = [Disturbance(0.0, level) for level in LEVELS] + [Disturbance(level, 0.0) for level in LEVELS]
"""Of each level, wandering or white."""


class ReducedLeastSquares(NamedTuple):
    """Of one kind of measurement: ``‖triangle @ coefficients − measured‖² + left`` is the sum of squares, per axis."""

    triangle: Array
    """(r, p)"""
    measured: Array
    """(r, 3)"""
    left: Array
    """(3,) what no coefficients explain."""
    spare: int
    """Measurements of each axis less coefficients."""
    volume: float = 0.0
    """Log determinant of the covariance that was whitened, for noise of unit variance."""

    @property
    def cost(self) -> float:
        """−2 log likelihood of free noise levels and free coefficients."""
        return float((self.spare * np.log(self.left / self.spare + TINY)).sum()) + self.volume


class Driven(NamedTuple):
    """Rates, and the p columns that their growth is regressed on. K cycles."""

    growth: Array
    """(K − 1, p) what a unit acceleration by each column adds to the mean rate."""
    rate: Array
    """(K, 3) measured, rad/s."""
    used: BoolArray
    """(K,) whether it counts."""
    coupling: float
    """What noise in the rates brings into the rate's steps by their products: a variance, over that of the noise."""
    held: bool = False
    """Whether a white torque is held through each cycle, so that half of it and half of the next one's make a step of the mean rate."""
    steady: int | None = None
    """The column that is a steady torque, as which one that walks begins; None where there is none."""
    begun: float = 1.0
    """What a torque that walks adds to the rate in a cycle for each unit of what it begins as."""
    walking: float = 0.0
    """Variance of the step from cycle to cycle, over that of the noise, of what a torque that is stated to walk adds to the rate."""
    scattered: Array | None = None
    """(K,) what errors of each cycle's impulse bring into the rate's step up to it: a variance, over that of the noise. None: nothing."""

    def whole(self, beside: Disturbance) -> Disturbance:
        """A disturbance with what is stated, and what products of rates bring."""
        return Disturbance(self.coupling + beside.white, self.walking + beside.walk)


def whitened(rates: Driven, stated: float, likely: Sequence[Disturbance]) -> tuple[ReducedLeastSquares, tuple[Disturbance, ...]]:
    """What the rates say: beside the most likely disturbance, if the noise ``stated`` [(rad/s)²] doesn't explain them; and which that is.

    Where some are ``likely`` no others are tried.
    """
    if likely:
        best = min(each(rates, likely), key=attrgetter("cost"))
        return best.told, (best.beside,) if best.beside != NONE else ()
    (best,) = each(rates, [NONE])
    if best.told.left.mean() <= EXPLAINED * stated * best.told.spare:
        return best.told, ()
    distinct = _distinct(best.told.triangle)
    unit = orthogonal(rates, best.told.triangle, distinct)
    likeliest = _likeliest(unit, [NONE, *TORQUES])
    near = [Disturbance(white, walk) for white in _around(likeliest.white) for walk in _around(likeliest.walk)]
    (best,) = each(rates, [_likeliest(unit, near)], distinct)
    return best.told, (best.beside,)


def _around(level: float) -> tuple[float, ...]:
    """It, and what is so much smaller and larger; of nothing, any."""
    return (level / FINER, level, level * FINER) if level else (0.0, *LEVELS)


def independent(rates: Driven) -> Driven:
    """The rates with columns that are no sums of others and, beside the noise alone, orthogonal; the same coefficients are free."""
    (alone,) = each(rates, [NONE])
    return orthogonal(rates, alone.told.triangle, _distinct(alone.told.triangle))


def orthogonal(rates: Driven, triangle: Array, distinct: BoolArray) -> Driven:
    """The rates with the ``distinct`` columns as unknowns of which ``triangle`` makes a unit matrix; a steady torque is the last."""
    which = np.flatnonzero(distinct)
    steady = rates.steady is not None and bool(distinct[rates.steady])
    if steady:
        which = np.append(which[which != rates.steady], rates.steady or 0)
    root = triangle_of(triangle[:, which])
    growth = rates.growth[:, which] @ np.linalg.inv(root)
    last = abs(float(root[-1, -1])) if steady else 1.0
    return rates._replace(growth=growth, steady=len(which) - 1 if steady else None, begun=rates.begun / last)


def _likeliest(rates: Driven, disturbances: Sequence[Disturbance]) -> Disturbance:
    """The one beside which free coefficients leave least."""
    return disturbances[int(np.argmin(by_products(rates, disturbances)))]


def by_products(rates: Driven, disturbances: Sequence[Disturbance]) -> list[float]:
    """Costs as :func:`each` has them, by products: of columns that are nearly orthogonal beside the noise alone.

    Infinite where rounding leaves nothing.
    """
    costs = []
    for beside, white, volume in white_rows(rates, disturbances):
        walks = rates.whole(beside).walk > 0 and rates.steady is not None
        if walks:  # it stands last, but for the rates
            white = np.delete(white, -4, 1)
        try:
            root = np.linalg.cholesky(white.T @ white)
        except np.linalg.LinAlgError:
            costs.append(np.inf)
            continue
        size = len(root) - 3
        told = ReducedLeastSquares(root, root[:0], (root[size:, size:] ** 2).sum(1), int(rates.used.sum()) - size, volume)
        own = np.diag(root)[size - rates.growth.shape[1] + walks : size]
        costs.append(_restricted(told, np.append(own, _begun(white)) if walks else own, beside, rates)[1])
    return costs


def _begun(white: Array) -> float:
    """What rows tell of what a torque begins as, beside the rate: a root of information. These two are the first of their columns."""
    torque, rate = white[:, 0], white[:, 1]
    return float(np.linalg.norm(torque - rate * (rate @ torque) / (rate @ rate)))


def white_rows(rates: Driven, disturbances: Sequence[Disturbance]) -> Iterator[tuple[Disturbance, Array, float]]:
    """Beside each: white rows (K, began + p + 3) of its unknown beginnings, the columns and the rates, and their volume."""
    rows, spread = _innovations(rates, disturbances)
    volume = 3 * np.log(spread).sum(1)
    for beside, white, own in zip(disturbances, rows, volume, strict=True):
        yield beside, white if rates.whole(beside).walk > 0 else white[:, 1:], float(own)


def _restricted(told: ReducedLeastSquares, diagonal: Array, beside: Disturbance, rates: Driven) -> tuple[float, float]:
    """Log determinant of the information, by the diagonal of its root, and −2 log restricted likelihood with the price of a disturbance."""
    taken = 2 * float(np.log(np.abs(diagonal)).sum())
    added = int(beside.white > 0) + int(beside.walk > 0)
    return taken, told.cost + 3 * taken + 3 * np.log(len(rates.rate)) * added


class Beside(NamedTuple):
    """What the rates say beside a disturbance."""

    beside: Disturbance
    told: ReducedLeastSquares
    taken: float
    """Log determinant of the information on the coefficients, which take of a slow disturbance what is like them (Patterson & Thompson
    1971); for noise of unit variance, of each axis."""
    cost: float
    """−2 log likelihood of free noise levels, restricted to what no coefficients explain, with the price of the disturbance."""


def each(rates: Driven, disturbances: Sequence[Disturbance], distinct: BoolArray | None = None) -> list[Beside]:
    """What the rates say beside each of several, all gone through together.

    A small Kalman filter on rate and torque runs for all columns at once, their unknown beginnings among them; its innovations are white.
    A torque that does not walk begins as nothing: a steady one is a column of its own. ``distinct`` (p,): which columns are no sum of
    others, the same for all that are compared; by default as the first disturbance has them.
    """
    found = []
    for beside, white, volume in white_rows(rates, disturbances):
        began = white.shape[1] - 3 - rates.growth.shape[1]
        told = reduced(-white[:, :-3], white[:, -3:], began, int(rates.used.sum()))._replace(volume=volume)
        distinct = _distinct(told.triangle) if distinct is None else distinct
        own, diagonal = distinct, np.diag(told.triangle)
        if rates.whole(beside).walk > 0 and rates.steady is not None:  # what it begins as stands for a steady one
            own = distinct & (np.arange(len(distinct)) != rates.steady)
            diagonal, own = np.append(diagonal, _begun(white)), np.append(own, distinct[rates.steady])
        found.append(Beside(beside, told, *_restricted(told, diagonal[own], beside, rates)))
    return found


def _distinct(triangle: Array) -> BoolArray:
    """(p,) which columns are no sum of those before them."""
    return np.asarray(np.abs(np.diag(triangle)) > SAME * np.linalg.norm(triangle, axis=0))


def _innovations(rates: Driven, disturbances: Sequence[Disturbance]) -> tuple[Array, Array]:
    """(n, K, 2 + p + 3) of the unknown beginnings of torque and rate, the columns and the rates, white, and their variances (n, K).

    0 and 1 of cycles that don't count.
    """
    count, size = len(rates.rate), rates.growth.shape[1]
    states, step, white = _torque(rates.held)
    now = np.zeros((len(disturbances), 3, 2 + size + 3))
    now[:, 1, 0], now[:, 0, 1] = rates.begun, 1.0
    driven, measured = np.zeros((2, count, now.shape[2]))
    driven[1:, 2:-3], measured[:, -3:] = rates.growth, rates.rate
    rows, spread = np.empty((len(now), count, now.shape[2])), np.empty((len(now), count))
    walk, scattered = np.eye(states)[1], np.zeros(count) if rates.scattered is None else np.ascontiguousarray(rates.scattered)
    added = np.stack([one.white * np.outer(white, white) + one.walk * np.outer(walk, walk) for one in map(rates.whole, disturbances)])
    if (library := kernel().library) is not None:
        sizes, used = (len(now), count, now.shape[2], states), rates.used.astype(np.uint8)
        call(library.mp_host_white, *sizes, step, added, scattered, used, driven, measured, now, rows, spread)
        return rows, spread
    kept, now = np.zeros_like(added), now[:, :states]
    for k in range(count):
        if k > 0:
            now = step @ now
            now[:, 0] += driven[k]
            kept = step @ kept @ step.T + added
            kept[:, 0, 0] += scattered[k]
        if not rates.used[k]:
            rows[:, k], spread[:, k] = 0.0, 1.0
            continue
        innovation, spread[:, k] = measured[k] - now[:, 0], kept[:, 0, 0] + 1.0
        gain = kept[:, :, 0] / spread[:, k, None]
        now += gain[:, :, None] * innovation[:, None]
        kept = kept - gain[:, :, None] * kept[:, :1]
        rows[:, k] = innovation / np.sqrt(spread[:, k, None])
    return rows, spread


def _torque(held: bool) -> tuple[int, Array, Array]:
    """States (rate, what it grows by, the last cycle's white torque if that is held), their transition, and where white noise enters."""
    if not held:
        return 2, np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([1.0, 0.0])
    return 3, np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), np.array([0.5, 0.0, 1.0])


def reduced(columns: Array, measured: Array, free: int = 0, count: int | None = None) -> ReducedLeastSquares:
    """The triangle of columns of which the first ``free`` are of no interest; ``count`` rows are something, by default all."""
    size = columns.shape[1]
    upper = triangle_of(np.hstack([columns, measured]))
    left = (upper[size:, size:] ** 2).sum(0)
    return ReducedLeastSquares(
        upper[free:size, free:size], upper[free:size, size:], left, (len(columns) if count is None else count) - size
    )
