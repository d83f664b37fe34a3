"""Whether values of one result predict another log: the likelihood-ratio test of the log's motion under them.

Near its own estimate x̂₂ the log's likelihood is Gaussian in θ = (J, c, 1/m), on an air bearing in θ = (J, m s, 1/m)
(:mod:`massprop_cli.combine.joint`). The result predicts that motion with its own uncertainty in the values. The prediction with θ free
in the log against the prediction with the result's values as prior gives, with d = θ̂₁ − θ̂₂,

    T = dᵀ V⁺ d,   V = cov(d),   chi-square of rank V degrees of freedom where both logs are of one body

(likelihood-ratio test; as a test of two estimators Hausman, Econometrica 46 (1978) 1251). Errors that both share are in neither's favour:
with the thrust's common relative error κ and errors ε of values that both assume as known,

    θ̂ᵢ − θ = gᵢ κ + Kᵢ ε + eᵢ,   V = Σ (Cᵢ − σᵢ² gᵢ gᵢᵀ) + σ² (g₁ − g₂)(g₁ − g₂)ᵀ − K₁ R K₂ᵀ − K₂ R K₁ᵀ,   σ = max σᵢ.

Cᵢ is the reported covariance: with noise, stated uncertainties, and model discrepancy where there is any. A direction of which both know
no more than what they share has no variance left in V, and counts for nothing.
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
    """One of the two: a phase of a result."""

    values: Array
    """(n,) NaN where nothing can be said."""
    covariance: Array
    """(n, n)"""
    by_scale: Array
    """(n,) derivative by the thrust's common relative error."""
    scale_sigma: float
    """Of that error, as it is in ``covariance``."""
    shared: Array
    """(n, s) error by one sigma of each value that both assume as known."""
    piece: Piece | None
    """None about a pivot, where the motion is linear in the values nearly."""


class Compared(NamedTuple):
    """Two sides tested against one another."""

    names: tuple[str, ...]
    difference: Array
    """(n,) first less second, NaN where either says nothing."""
    sigma: Array
    """(n,) of it."""
    chi_square: float
    freedom: int

    @property
    def p(self) -> float:
        """Chance of as large a difference."""
        return chance(self.chi_square, self.freedom)


def compared(first: tuple[VehicleInfo, PhaseItem], second: tuple[VehicleInfo, PhaseItem]) -> Compared:
    """Two phases; :class:`InputError` where they have no quantity in common that is more than what they share."""
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
        chi_square, freedom = _distance((theta[0] - theta[1])[at], _covariance(sides, slopes, at), _apart(sides, slopes, at))
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
    """Inertia and first moment, which are proportional to the thrust, but for what a known inertia says of it."""
    given = [phase.about_pivot[name] for name in ABOUT_PIVOT]
    values = np.array([np.nan if one.value is None else one.value for one in given])
    covariance = np.nan_to_num(np.array(phase.about_pivot_covariance, dtype=float))
    at = np.isfinite(values)
    most = 1 / math.sqrt(max(float(values[at] @ np.linalg.lstsq(covariance[np.ix_(at, at)], values[at])[0]), TINY))
    return PredictionSide(values, covariance, np.nan_to_num(values), min(vehicle.thrust_scale_sigma, most), np.zeros((9, 0)), None)


def _linear(sides: list[PredictionSide]) -> tuple[list[Array], list[Array]]:
    """θ of what both give (10,), NaN elsewhere, and its derivative by the ten quantities (10, 10)."""
    both = np.isfinite(sides[0].values + sides[1].values)
    values = [np.where(both, side.values, np.nan) for side in sides]
    curved = all(is_body(one) for one in values)
    found = [
        linear(one, curved, side.piece.bearing if both.all() and side.piece else None) for one, side in zip(values, sides, strict=True)
    ]
    return [theta for theta, _ in found], [np.nan_to_num(slope) for _, slope in found]


def _apart(sides: list[PredictionSide], slopes: list[Array], at: IntArray) -> Array:
    """(m, m) covariance of the difference as if nothing was shared."""
    total = sum((slope @ side.covariance @ slope.T for side, slope in zip(sides, slopes, strict=True)), np.zeros_like(slopes[0]))
    return np.asarray(total[np.ix_(at, at)])


def _covariance(sides: list[PredictionSide], slopes: list[Array], at: IntArray) -> Array:
    """(m, m) V."""
    scaled = [slope @ side.by_scale for side, slope in zip(sides, slopes, strict=True)]
    own = sum((side.scale_sigma**2 * np.outer(one, one) for side, one in zip(sides, scaled, strict=True)), np.zeros_like(slopes[0]))
    left = max(side.scale_sigma for side in sides) * (scaled[0] - scaled[1])
    across = slopes[0] @ sides[0].shared @ (slopes[1] @ sides[1].shared).T
    return np.asarray(_apart(sides, slopes, at) + (np.outer(left, left) - own - across - across.T)[np.ix_(at, at)])


def _distance(d: Array, covariance: Array, apart: Array) -> tuple[float, int]:
    """T and its degrees of freedom, in the directions in which the sides differ by more than what they share."""
    if not len(d):
        return 0.0, 0
    size = np.sqrt(np.diag(apart))
    root = np.linalg.cholesky(apart / np.outer(size, size))
    whitened = np.linalg.solve(root, (d / size)[:, None])[:, 0]
    inner = np.linalg.solve(root, np.linalg.solve(root, covariance / np.outer(size, size)).T)
    share, along = np.linalg.eigh((inner + inner.T) / 2)
    told = share > ROUNDING
    return float((((along.T @ whitened)[told]) ** 2 / share[told]).sum()), int(told.sum())
