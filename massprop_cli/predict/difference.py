"""Likelihood-ratio test of another log's motion under the values of a result.

The log's likelihood is Gaussian near its estimate in θ = (J, c, 1/m), on an air bearing in θ = (J, m s, 1/m)
(:mod:`massprop_cli.combine.joint`). The ratio of the likelihoods with θ free, and with the result's values as prior, gives

    T = dᵀ V⁺ d,   d = θ̂₁ − θ̂₂,   V = cov(d),   chi-square of rank V degrees of freedom if both logs are of one body

(as a test of two estimators: Hausman, Econometrica 46 (1978) 1251). V excludes the errors that both share. With the common relative thrust
error κ and errors ε of common known values,

    θ̂ᵢ − θ = gᵢ κ + Kᵢ ε + eᵢ,   V = Σ (Cᵢ − σᵢ² gᵢ gᵢᵀ) + σ² (g₁ − g₂)(g₁ − g₂)ᵀ − K₁ R K₂ᵀ − K₂ R K₁ᵀ,   σ = max σᵢ.

Cᵢ is the reported covariance with noise, stated uncertainties and model discrepancy. A direction with shared errors only has no variance in
V and is omitted.
"""

import math
from typing import NamedTuple

import numpy as np

from massprop_cli import ABOUT_PIVOT, QUANTITIES
from massprop_cli.base.arrays import ROUNDING, TINY, Array, IntArray
from massprop_cli.base.chance import chance
from massprop_cli.base.errors import InputError
from massprop_cli.combine.joint import Piece, is_body, linear
from massprop_cli.combine.phase import piece
from massprop_cli.estimate.quantities import left_by_known
from massprop_cli.result.schema import PhaseItem, VehicleInfo


class PredictionSide(NamedTuple):
    """One phase of a result or of the log."""

    values: Array
    """(n,) values; NaN without an estimate."""
    covariance: Array
    """(n, n) their covariance."""
    by_scale: Array
    """(n,) derivative with respect to the common relative thrust error."""
    scale_sigma: float
    """Sigma of that error in ``covariance``."""
    shared: Array
    """(n, s) change of the values by one sigma of each common known value."""
    piece: Piece | None
    """The phase for θ; None about a pivot, where the motion is nearly linear in the values."""


class Compared(NamedTuple):
    """Test of two sides."""

    names: tuple[str, ...]
    difference: Array
    """(n,) first minus second; NaN if either has no value."""
    sigma: Array
    """(n,) its sigma without shared errors."""
    chi_square: float
    freedom: int

    @property
    def p(self) -> float:
        """Probability of a larger difference by chance."""
        return chance(self.chi_square, self.freedom)


def compared(first: tuple[VehicleInfo, PhaseItem], second: tuple[VehicleInfo, PhaseItem]) -> Compared:
    """Test two phases against each other; :class:`InputError` if a covariance is singular."""
    pivoted = first[0].environment == "pedestal"
    names = ABOUT_PIVOT if pivoted else QUANTITIES
    known = first[1].known.items() & second[1].known.items()
    sides = [_about_pivot(vehicle, phase) if pivoted else _side(vehicle, phase, dict(known)) for vehicle, phase in (first, second)]
    at = np.flatnonzero(np.isfinite(sides[0].values + sides[1].values))
    plain: list[Array] = [np.eye(len(names))] * 2
    variance = np.diag(_covariance(sides, plain, at))
    difference, sigma = np.full((2, len(names)), np.nan)
    difference[at] = (sides[0].values - sides[1].values)[at]
    sigma[at] = np.sqrt(np.maximum(variance, 0.0))
    theta, slopes = _linear(sides) if not pivoted else ([side.values for side in sides], plain)
    try:
        chi_square, freedom = _distance((theta[0] - theta[1])[at], _covariance(sides, slopes, at), _independent(sides, slopes, at))
    except np.linalg.LinAlgError:
        raise InputError("the covariance of result or log is singular: check [known] and its sigmas") from None
    return Compared(tuple(names), difference, sigma, chi_square, freedom)


def _side(vehicle: VehicleInfo, phase: PhaseItem, both: dict[str, tuple[float, float]]) -> PredictionSide:
    own = piece(vehicle, phase)
    values, covariance = own.values, np.nan_to_num(own.covariance)
    slope = left_by_known(own.by_scale(values), covariance, {name: sigma for name, (_, sigma) in own.known.items()})
    shared = [covariance[:, QUANTITIES.index(name)] / sigma for name, (_, sigma) in both.items()]
    return PredictionSide(values, covariance, slope, own.scale_sigma, np.array(shared).reshape(-1, 10).T, own)


def _about_pivot(vehicle: VehicleInfo, phase: PhaseItem) -> PredictionSide:
    """Side about a pivot: inertia and first moment are proportional to the thrust, whose sigma a known inertia reduces."""
    given = [phase.about_pivot[name] for name in ABOUT_PIVOT]
    values = np.array([np.nan if one.value is None else one.value for one in given])
    covariance = np.nan_to_num(np.array(phase.about_pivot_covariance, dtype=float))
    at = np.isfinite(values)
    most = 1 / math.sqrt(max(float(values[at] @ np.linalg.lstsq(covariance[np.ix_(at, at)], values[at])[0]), TINY))
    return PredictionSide(values, covariance, np.nan_to_num(values), min(vehicle.thrust_scale_sigma, most), np.zeros((9, 0)), None)


def _linear(sides: list[PredictionSide]) -> tuple[list[Array], list[Array]]:
    """θ (10,) of the quantities that both sides have, NaN elsewhere, and its (10, 10) derivative with respect to the ten quantities."""
    both = np.isfinite(sides[0].values + sides[1].values)
    values = [np.where(both, side.values, np.nan) for side in sides]
    curved = all(is_body(one) for one in values)
    found = [
        linear(one, curved, side.piece.bearing if both.all() and side.piece else None) for one, side in zip(values, sides, strict=True)
    ]
    return [theta for theta, _ in found], [np.nan_to_num(slope) for _, slope in found]


def _independent(sides: list[PredictionSide], slopes: list[Array], at: IntArray) -> Array:
    """(m, m) covariance of the difference for independent sides."""
    total = sum((slope @ side.covariance @ slope.T for side, slope in zip(sides, slopes, strict=True)), np.zeros_like(slopes[0]))
    return np.asarray(total[np.ix_(at, at)])


def _covariance(sides: list[PredictionSide], slopes: list[Array], at: IntArray) -> Array:
    """(m, m) covariance V of the difference."""
    by_thrust = [slope @ side.by_scale for side, slope in zip(sides, slopes, strict=True)]
    thrust = sum((side.scale_sigma**2 * np.outer(g, g) for side, g in zip(sides, by_thrust, strict=True)), np.zeros_like(slopes[0]))
    remaining = max(side.scale_sigma for side in sides) * (by_thrust[0] - by_thrust[1])
    known = slopes[0] @ sides[0].shared @ (slopes[1] @ sides[1].shared).T
    return np.asarray(_independent(sides, slopes, at) + (np.outer(remaining, remaining) - thrust - known - known.T)[np.ix_(at, at)])


def _distance(d: Array, covariance: Array, independent: Array) -> tuple[float, int]:
    """T and its degrees of freedom, in the directions in which V is not zero compared with the ``independent`` covariance (m, m)."""
    if not len(d):
        return 0.0, 0
    size = np.sqrt(np.diag(independent))
    root = np.linalg.cholesky(independent / np.outer(size, size))
    whitened = np.linalg.solve(root, (d / size)[:, None])[:, 0]
    inner = np.linalg.solve(root, np.linalg.solve(root, covariance / np.outer(size, size)).T)
    share, directions = np.linalg.eigh((inner + inner.T) / 2)
    used = share > ROUNDING
    return float((((directions.T @ whitened)[used]) ** 2 / share[used]).sum()), int(used.sum())
