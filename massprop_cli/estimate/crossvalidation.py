"""Cross-validation within a phase: each segment of time predicted by the estimate from all others.

The likelihood of a phase is the product of those of its segments, each given the segments before. In whitened rows segment k says
``z_k = R_k x + e_k``, of the mass properties and of all nuisance parameters x. The estimate x̂₍₋ₖ₎ from all other segments, with its
covariance P₍₋ₖ₎, predicts it:

    T_k = dᵀ (1 + R_k P₍₋ₖ₎ R_kᵀ)⁻¹ d,   d = z_k − R_k x̂₍₋ₖ₎,

chi-square of rank R_k degrees of freedom where one body made all segments (Geisser, J. Am. Statist. Assoc. 70 (1975) 320). The scatter of
these estimates gives sigmas that rest on no stated noise, by the delete-a-group jackknife (Shao and Tu, The Jackknife and Bootstrap, 1995):

    σ² = (S − 1)/S Σ_k (x̂₍₋ₖ₎ − mean)².
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.estimate.discrepancy import posed_segments
from massprop_cli.estimate.pivot import about_pivot
from massprop_cli.estimate.quantities import MOMENTS, quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.model.layout import MU
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

SEGMENTS = 8


class SegmentPrediction(NamedTuple):
    """One segment against the estimate from all others."""

    cycles: slice
    chi_square: float
    freedom: int

    @property
    def p(self) -> float:
        """Chance of as large a difference."""
        from scipy.special import gammaincc

        return float(gammaincc(self.freedom / 2, self.chi_square / 2)) if self.freedom else 1.0


class CrossValidation(NamedTuple):
    """Of one phase in S segments."""

    segments: tuple[SegmentPrediction, ...]
    values: Array
    """(S, 10) the ten quantities from all segments but one; NaN where these do not give them."""
    pivot: Array | None
    """(S, 9) the same of what is about a pivot (:func:`massprop_cli.estimate.pivot.about_pivot`); None without one."""

    @property
    def p(self) -> float:
        """Chance of a segment that is predicted as badly as the worst one (Bonferroni)."""
        return min(1.0, len(self.segments) * min(one.p for one in self.segments))

    @property
    def sigmas(self) -> Array:
        """(10,) jackknife sigmas."""
        return _jackknife(self.values)

    @property
    def pivot_sigmas(self) -> Array | None:
        """(9,) of what is about a pivot."""
        return None if self.pivot is None else _jackknife(self.pivot)


def cross_validation(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider) -> CrossValidation:
    """Of the phase ``cycles``, linear about ``reference``; what ``consider`` states to be uncertain is a nuisance parameter.

    :class:`numpy.linalg.LinAlgError` where the numbers are too far apart.
    """
    found = posed_segments(samples, cycles, reference, vehicle, consider, SEGMENTS)
    size = len(consider.covariance)
    first = found.rows[0].shape[1] - 1 - size
    spread = np.linalg.cholesky(consider.covariance) if size else np.zeros((0, 0))
    rows = [np.hstack([one[:, :first], -one[:, first:-1] @ spread, one[:, -1:]]) for one in found.rows]
    known = np.vstack([rows[0], np.eye(size, rows[0].shape[1], first)])
    own, predicted, means, covariances = slice(first - 10, first), list[SegmentPrediction](), list[Array](), list[Array]()
    for k in range(1, len(rows)):
        others = triangle_of(np.vstack([known, *(one for j, one in enumerate(rows) if j not in (0, k))]))
        mean, root = np.linalg.solve(others[:-1, :-1], others[:-1, -1]), np.linalg.inv(others[:-1, :-1])
        predicted.append(_predicted(triangle_of(rows[k]), mean, root, found.cycles[k - 1]))
        means.append(found.mean + found.slopes @ mean[own])
        covariances.append(found.slopes @ root[own] @ (found.slopes @ root[own]).T)
    mean, covariance = np.array(means), np.array(covariances)
    relative = np.sqrt(np.einsum("kii->ki", covariance)[:, MOMENTS]) / mean[:, MOMENTS]
    values, full = quantities(Parameters(mean, covariance, relative), vehicle)
    pivot = about_pivot(values, full, np.array(vehicle.environment.bearing_position_m), 1 / mean[:, MU])[0] if vehicle.pivoted else None
    return CrossValidation(tuple(predicted), values, pivot)


def _jackknife(values: Array) -> Array:
    """(n,) sigmas of estimates (S, n) from all segments but one."""
    count = len(values)
    found: Array = np.sqrt((count - 1) / count * ((values - values.mean(0)) ** 2).sum(0))
    return found


def _predicted(segment: Array, mean: Array, root: Array, cycles: slice) -> SegmentPrediction:
    """A segment's triangle (n + 1, n + 1) by an estimate (n,) with the covariance ``root @ root.T``."""
    left, sizes, right = np.linalg.svd(segment[:-1, :-1])
    told = sizes > np.finfo(float).eps * len(sizes) * sizes.max(initial=0.0)
    difference = (left.T @ (segment[:-1, -1] - segment[:-1, :-1] @ mean))[told]
    spread = (sizes[:, None] * (right @ root))[told]
    white = np.linalg.solve(np.linalg.cholesky(np.eye(len(spread)) + spread @ spread.T), difference)
    return SegmentPrediction(cycles, float(white @ white), len(white))
