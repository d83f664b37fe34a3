"""Whitening of rates under a white or a random-walk disturbance torque, at the maximum likelihood level."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, triangle_of
from massprop_cli.kernel import call, kernel

LEVELS, FINER = (1e-6, 1e-4, 1e-2, 1.0), 10.0
"""Levels of a disturbance in the first search; the second varies the most likely by this factor."""
SAME = 1e-8
"""Norm of a column's part that is independent of the others, relative, below which it is rounding."""
EXPLAINED = 1.3
"""Mean squared residual over the stated noise, up to which no disturbance is searched for."""


class Disturbance(NamedTuple):
    """Unmodelled disturbance of the rate: variances per cycle, over the gyro noise variance."""

    white: float
    """White acceleration: of the rate's own steps."""
    walk: float
    """Random walk: of the change from cycle to cycle in the rate's growth."""


NONE = Disturbance(0.0, 0.0)
TORQUES = [Disturbance(0.0, level) for level in LEVELS] + [Disturbance(level, 0.0) for level in LEVELS]
"""Each level, as random walk and as white disturbance."""


class ReducedLeastSquares(NamedTuple):
    """Least squares of one sensor's three axes: sum of squares ``‖triangle @ coefficients − measured‖² + left`` per axis."""

    triangle: Array
    """(r, p) square-root information of the coefficients."""
    measured: Array
    """(r, 3) right-hand side."""
    left: Array
    """(3,) residual sum of squares."""
    spare: int
    """Degrees of freedom per axis."""
    volume: float = 0.0
    """Log determinant of the whitened covariance, for noise of unit variance."""

    @property
    def cost(self) -> float:
        """−2 log likelihood, with noise level and coefficients at their maximum likelihood."""
        return float((self.spare * np.log(self.left / self.spare + TINY)).sum()) + self.volume


class Driven(NamedTuple):
    """Rates of K cycles, and the p columns on which their growth is regressed."""

    growth: Array
    """(K − 1, p) growth of the mean rate by unit acceleration of each column."""
    rate: Array
    """(K, 3) measured, rad/s."""
    used: BoolArray
    """(K,) cycles whose rate counts."""
    coupling: float
    """Variance that noise in the rate products adds to the rate's steps, over the gyro noise variance."""
    held: bool = False
    """Whether a white torque is constant within each cycle, so that half of two torques enter each step of the mean rate."""
    steady: int | None = None
    """Column of a steady torque, the initial value of a random walk; None without one."""
    begun: float = 1.0
    """Growth of the rate per cycle by a unit of the random walk's initial value."""
    walking: float = 0.0
    """Variance per cycle of a stated random walk, over the gyro noise variance."""
    scattered: Array | None = None
    """(K,) variance of the rate's step up to each cycle by impulse errors, over the gyro noise variance; None: zero."""

    def whole(self, disturbance: Disturbance) -> Disturbance:
        """The disturbance plus the stated one and that by rate products."""
        return Disturbance(self.coupling + disturbance.white, self.walking + disturbance.walk)


def whitened(rates: Driven, stated: float, likely: Sequence[Disturbance]) -> tuple[ReducedLeastSquares, tuple[Disturbance, ...]]:
    """Whitened fit of the rates, and its disturbance if the noise ``stated`` [(rad/s)²] does not explain the residuals.

    The disturbance is the maximum likelihood one; if ``likely`` is given, the most likely of these.
    """
    if likely:
        best = min(whitened_fits(rates, likely), key=attrgetter("cost"))
        return best.fit, (best.disturbance,) if best.disturbance != NONE else ()
    (best,) = whitened_fits(rates, [NONE])
    if best.fit.left.mean() <= EXPLAINED * stated * best.fit.spare:
        return best.fit, ()
    distinct = _distinct(best.fit.triangle)
    unit = orthogonal(rates, best.fit.triangle, distinct)
    likeliest = _likeliest(unit, [NONE, *TORQUES])
    near = [Disturbance(white, walk) for white in _around(likeliest.white) for walk in _around(likeliest.walk)]
    (best,) = whitened_fits(rates, [_likeliest(unit, near)], distinct)
    return best.fit, (best.disturbance,)


def _around(level: float) -> tuple[float, ...]:
    """The level, and one factor above and below; of zero, all levels."""
    return (level / FINER, level, level * FINER) if level else (0.0, *LEVELS)


def independent(rates: Driven) -> Driven:
    """The rates with independent columns, orthogonal under the noise alone, that span the same space."""
    (alone,) = whitened_fits(rates, [NONE])
    return orthogonal(rates, alone.fit.triangle, _distinct(alone.fit.triangle))


def orthogonal(rates: Driven, triangle: Array, distinct: BoolArray) -> Driven:
    """The rates with the ``distinct`` columns, scaled so that ``triangle`` becomes the unit matrix; a steady torque comes last."""
    which = np.flatnonzero(distinct)
    steady = rates.steady is not None and bool(distinct[rates.steady])
    if steady:
        which = np.append(which[which != rates.steady], rates.steady or 0)
    root = triangle_of(triangle[:, which])
    growth = rates.growth[:, which] @ np.linalg.inv(root)
    last = abs(float(root[-1, -1])) if steady else 1.0
    return rates._replace(growth=growth, steady=len(which) - 1 if steady else None, begun=rates.begun / last)


def _likeliest(rates: Driven, disturbances: Sequence[Disturbance]) -> Disturbance:
    """The disturbance of least cost."""
    return disturbances[int(np.argmin(by_products(rates, disturbances)))]


def by_products(rates: Driven, disturbances: Sequence[Disturbance]) -> list[float]:
    """Costs of :func:`whitened_fits` from normal equations, for nearly orthogonal columns; infinite where rounding makes them singular."""
    costs = []
    for disturbance, rows, volume in white_rows(rates, disturbances):
        walks = rates.whole(disturbance).walk > 0 and rates.steady is not None
        if walks:  # the steady torque, the last column before the rates, is the walk's initial value
            rows = np.delete(rows, -4, 1)
        try:
            root = np.linalg.cholesky(rows.T @ rows)
        except np.linalg.LinAlgError:
            costs.append(np.inf)
            continue
        size = len(root) - 3
        fit = ReducedLeastSquares(root, root[:0], (root[size:, size:] ** 2).sum(1), int(rates.used.sum()) - size, volume)
        diagonal = np.diag(root)[size - rates.growth.shape[1] + walks : size]
        costs.append(_restricted(fit, np.append(diagonal, _initial_torque_root(rows)) if walks else diagonal, disturbance, rates)[1])
    return costs


def _initial_torque_root(rows: Array) -> float:
    """Root of the information on a walk's initial torque, with the initial rate unknown; their columns are the first two."""
    torque, rate = rows[:, 0], rows[:, 1]
    return float(np.linalg.norm(torque - rate * (rate @ torque) / (rate @ rate)))


def white_rows(rates: Driven, disturbances: Sequence[Disturbance]) -> Iterator[tuple[Disturbance, Array, float]]:
    """For each disturbance, white rows (K, i + p + 3) of i initial states, columns and rates, and their log determinant."""
    rows, variance = _innovations(rates, disturbances)
    volumes = 3 * np.log(variance).sum(1)
    for disturbance, white, volume in zip(disturbances, rows, volumes, strict=True):
        yield disturbance, white if rates.whole(disturbance).walk > 0 else white[:, 1:], float(volume)


def _restricted(fit: ReducedLeastSquares, diagonal: Array, disturbance: Disturbance, rates: Driven) -> tuple[float, float]:
    """Log determinant of the information, from the diagonal of its root, and cost: −2 log restricted likelihood with BIC penalty."""
    log_information = 2 * float(np.log(np.abs(diagonal)).sum())
    added = int(disturbance.white > 0) + int(disturbance.walk > 0)
    return log_information, fit.cost + 3 * log_information + 3 * np.log(len(rates.rate)) * added


class WhitenedFit(NamedTuple):
    """Least squares of the rates under one disturbance."""

    disturbance: Disturbance
    fit: ReducedLeastSquares
    log_information: float
    """Log determinant of the information on the coefficients, per axis, for noise of unit variance. The coefficients absorb a part of a
    slow disturbance (Patterson & Thompson 1971)."""
    cost: float
    """−2 log restricted likelihood at the maximum likelihood noise level, with BIC penalty for the disturbance."""


def whitened_fits(rates: Driven, disturbances: Sequence[Disturbance], distinct: BoolArray | None = None) -> list[WhitenedFit]:
    """Least squares of the rates under each of several disturbances.

    A Kalman filter on rate and torque runs for all columns and unknown initial states at once; its innovations are white. A disturbance
    without a walk has no initial torque: a steady torque is a column of its own. ``distinct`` (p,) are the independent columns, the same
    for all; by default those under the first disturbance.
    """
    fits = []
    for disturbance, rows, volume in white_rows(rates, disturbances):
        initial = rows.shape[1] - 3 - rates.growth.shape[1]
        fit = reduced(-rows[:, :-3], rows[:, -3:], initial, int(rates.used.sum()))._replace(volume=volume)
        distinct = _distinct(fit.triangle) if distinct is None else distinct
        used, diagonal = distinct, np.diag(fit.triangle)
        if rates.whole(disturbance).walk > 0 and rates.steady is not None:  # the walk's initial value replaces the steady torque
            used = distinct & (np.arange(len(distinct)) != rates.steady)
            diagonal, used = np.append(diagonal, _initial_torque_root(rows)), np.append(used, distinct[rates.steady])
        fits.append(WhitenedFit(disturbance, fit, *_restricted(fit, diagonal[used], disturbance, rates)))
    return fits


def _distinct(triangle: Array) -> BoolArray:
    """(p,) columns that are not linear combinations of those before them."""
    return np.asarray(np.abs(np.diag(triangle)) > SAME * np.linalg.norm(triangle, axis=0))


def _innovations(rates: Driven, disturbances: Sequence[Disturbance]) -> tuple[Array, Array]:
    """(n, K, 2 + p + 3) white rows for n disturbances: initial torque, initial rate, columns, rates; and (n, K) innovation variances.

    Cycles that do not count have rows of zeros and a variance of one.
    """
    count, size = len(rates.rate), rates.growth.shape[1]
    states, step, white = _torque(rates.held)
    mean = np.zeros((len(disturbances), 3, 2 + size + 3))
    mean[:, 1, 0], mean[:, 0, 1] = rates.begun, 1.0
    driven, measured = np.zeros((2, count, mean.shape[2]))
    driven[1:, 2:-3], measured[:, -3:] = rates.growth, rates.rate
    rows, variance = np.empty((len(mean), count, mean.shape[2])), np.empty((len(mean), count))
    walk, scattered = np.eye(states)[1], np.zeros(count) if rates.scattered is None else np.ascontiguousarray(rates.scattered)
    added = np.stack([one.white * np.outer(white, white) + one.walk * np.outer(walk, walk) for one in map(rates.whole, disturbances)])
    if (library := kernel().library) is not None:
        sizes, used = (len(mean), count, mean.shape[2], states), rates.used.astype(np.uint8)
        call(library.mp_host_white, *sizes, step, added, scattered, used, driven, measured, mean, rows, variance)
        return rows, variance
    covariance, mean = np.zeros_like(added), mean[:, :states]
    for k in range(count):
        if k > 0:
            mean = step @ mean
            mean[:, 0] += driven[k]
            covariance = step @ covariance @ step.T + added
            covariance[:, 0, 0] += scattered[k]
        if not rates.used[k]:
            rows[:, k], variance[:, k] = 0.0, 1.0
            continue
        innovation, variance[:, k] = measured[k] - mean[:, 0], covariance[:, 0, 0] + 1.0
        gain = covariance[:, :, 0] / variance[:, k, None]
        mean += gain[:, :, None] * innovation[:, None]
        covariance = covariance - gain[:, :, None] * covariance[:, :1]
        rows[:, k] = innovation / np.sqrt(variance[:, k, None])
    return rows, variance


def _torque(held: bool) -> tuple[int, Array, Array]:
    """Number of states (rate, its growth and, if held, the last cycle's white torque), their transition, and the white noise's input."""
    if not held:
        return 2, np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([1.0, 0.0])
    return 3, np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), np.array([0.5, 0.0, 1.0])


def reduced(columns: Array, measured: Array, eliminated: int = 0, count: int | None = None) -> ReducedLeastSquares:
    """Least squares with the first ``eliminated`` columns as nuisance parameters; ``count`` rows are used, by default all."""
    size = columns.shape[1]
    upper = triangle_of(np.hstack([columns, measured]))
    squares = (upper[size:, size:] ** 2).sum(0)
    return ReducedLeastSquares(
        upper[eliminated:size, eliminated:size],
        upper[eliminated:size, size:],
        squares,
        (len(columns) if count is None else count) - size,
    )
