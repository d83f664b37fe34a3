"""Cross-validation within a phase: each segment of time predicted by the estimate from all others.

The likelihood of a phase is the product of those of its segments, each given the segments before. The whitened rows of segment k are
``z_k = R_k x + e_k``, with mass properties and nuisance parameters x. The estimate x̂₍₋ₖ₎ from all other segments, with covariance P₍₋ₖ₎,
predicts it:

    T_k = dᵀ (1 + R_k P₍₋ₖ₎ R_kᵀ)⁻¹ d,   d = z_k − R_k x̂₍₋ₖ₎,

chi-square of rank R_k degrees of freedom if one body made all segments (Geisser, J. Am. Statist. Assoc. 70 (1975) 320). The changes m_k of
the estimate by each segment give a covariance that does not depend on the stated noise. It is unbiased if the model holds (bias-reduced
sandwich: Bell and McCaffrey, Survey Methodology 28 (2002) 169), with S_k = 1 + R_k P₍₋ₖ₎ R_kᵀ:

    cov(x̂) = Σ_k m_k m_kᵀ,   m_k = P₍₋ₖ₎ R_kᵀ S_k⁻¹ S_k^(-1/2) d_k.
"""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.base.chance import chance
from massprop_cli.base.rigidbody import MOMENTS
from massprop_cli.estimate.discrepancy import posed_segments
from massprop_cli.estimate.pivot import about_pivot
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.model.layout import MU
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

SEGMENTS = 8
"""Number of segments of a phase."""


class SegmentPrediction(NamedTuple):
    """Test of one segment against the estimate from all others."""

    cycles: slice
    chi_square: float
    """T_k."""
    freedom: int
    """Its degrees of freedom."""

    @property
    def p(self) -> float:
        """Probability of a larger T_k by chance."""
        return chance(self.chi_square, self.freedom)


class CrossValidation(NamedTuple):
    """Cross-validation of one phase."""

    segments: tuple[SegmentPrediction, ...]
    sigmas: Array
    """(10,) sigmas of the ten quantities from the scatter of the segments; NaN without a value."""
    pivot_sigmas: Array | None
    """(9,) sigmas about a pivot (:func:`massprop_cli.estimate.pivot.about_pivot`); None without one."""

    @property
    def p(self) -> float:
        """Probability by chance of a segment that is predicted as badly as the worst one (Bonferroni)."""
        return min(1.0, len(self.segments) * min(one.p for one in self.segments))


def cross_validation(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider) -> CrossValidation:
    """Cross-validate the phase ``cycles``, linear about ``reference``; the assumptions of ``consider`` are nuisance parameters.

    Raises :class:`numpy.linalg.LinAlgError` if the problem is too ill-conditioned.
    """
    posed = posed_segments(samples, cycles, reference, vehicle, consider, SEGMENTS)
    size = len(consider.covariance)
    first = posed.rows[0].shape[1] - 1 - size
    spread = np.linalg.cholesky(consider.covariance) if size else np.zeros((0, 0))
    rows = [np.hstack([one[:, :first], -one[:, first:-1] @ spread, one[:, -1:]]) for one in posed.rows]
    known, theta = np.vstack([rows[0], np.eye(size, rows[0].shape[1], first)]), slice(first - 10, first)
    predicted, moves = list[SegmentPrediction](), list[Array]()
    for k, part in enumerate(posed.cycles, 1):
        others = _solved([known, *(one for j, one in enumerate(rows) if j not in (0, k))])
        one, move = _predicted(triangle_of(rows[k]), *others, part)
        predicted.append(one)
        moves.append(posed.slopes @ move[theta])
    mean, root = _solved([known, *rows[1:]])
    estimate, theta_root = posed.mean + posed.slopes @ mean[theta], posed.slopes @ root[theta]
    means = np.vstack([estimate, estimate + np.array(moves)])
    covariance = np.broadcast_to(theta_root @ theta_root.T, (len(means), 10, 10)).copy()
    relative = np.sqrt(np.einsum("kii->ki", covariance)[:, MOMENTS]) / means[:, MOMENTS]
    values, full = quantities(Parameters(means, covariance, relative), vehicle)
    pivot = about_pivot(values, full, np.array(vehicle.environment.bearing_position_m), 1 / means[:, MU])[0] if vehicle.pivoted else None
    return CrossValidation(tuple(predicted), _scatter(values), None if pivot is None else _scatter(pivot))


def _scatter(values: Array) -> Array:
    """(n,) root sum of squares of the segments' changes; ``values`` (1 + S, n) are the estimate, then the estimate plus each change."""
    return np.asarray(np.sqrt(((values[1:] - values[0]) ** 2).sum(0)))


def _solved(rows: list[Array]) -> tuple[Array, Array]:
    """(n,) estimate from rows (…, n + 1), and (n, n) root of its covariance."""
    triangle = triangle_of(np.vstack(rows))[:-1]
    return np.linalg.solve(triangle[:, :-1], triangle[:, -1]), np.linalg.inv(triangle[:, :-1])


def _predicted(segment: Array, mean: Array, root: Array, cycles: slice) -> tuple[SegmentPrediction, Array]:
    """Test of a segment's triangle (n + 1, n + 1) against an estimate (n,) of covariance ``root @ root.T``; and (n,) the segment's m_k."""
    left, sizes, right = np.linalg.svd(segment[:-1, :-1])
    informed = sizes > np.finfo(float).eps * len(sizes) * sizes.max(initial=0.0)
    difference = (left.T @ (segment[:-1, -1] - segment[:-1, :-1] @ mean))[informed]
    spread = (sizes[:, None] * (right @ root))[informed]
    variances, axes = np.linalg.eigh(np.eye(len(spread)) + spread @ spread.T)
    white = axes.T @ difference / np.sqrt(variances)
    return SegmentPrediction(cycles, float(white @ white), len(white)), root @ (spread.T @ (axes @ (white / variances)))
