"""Cross-validation within a phase: each segment of time predicted by the estimate from all others.

The likelihood of a phase is the product of those of its segments, each given the segments before. In whitened rows segment k says
``z_k = R_k x + e_k``, of the mass properties and of all nuisance parameters x. The estimate x̂₍₋ₖ₎ from all other segments, with its
covariance P₍₋ₖ₎, predicts it:

    T_k = dᵀ (1 + R_k P₍₋ₖ₎ R_kᵀ)⁻¹ d,   d = z_k − R_k x̂₍₋ₖ₎,

chi-square of rank R_k degrees of freedom where one body made all segments (Geisser, J. Am. Statist. Assoc. 70 (1975) 320). Each segment
moves the estimate by m_k; these give a covariance that rests on no stated noise and is unbiased where the model holds (bias-reduced
sandwich: Bell and McCaffrey, Survey Methodology 28 (2002) 169), with S_k = 1 + R_k P₍₋ₖ₎ R_kᵀ:

    cov(x̂) = Σ_k m_k m_kᵀ,   m_k = P₍₋ₖ₎ R_kᵀ S_k⁻¹ S_k^(-1/2) d_k.
"""

from __future__ import annotations

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


class SegmentPrediction(NamedTuple):
    """One segment against the estimate from all others."""

    cycles: slice
    chi_square: float
    freedom: int

    @property
    def p(self) -> float:
        """Chance of as large a difference."""
        return chance(self.chi_square, self.freedom)


class CrossValidation(NamedTuple):
    """Of one phase."""

    segments: tuple[SegmentPrediction, ...]
    sigmas: Array
    """(10,) of the ten quantities by the scatter of the segments; NaN where they have no value."""
    pivot_sigmas: Array | None
    """(9,) the same of what is about a pivot (:func:`massprop_cli.estimate.pivot.about_pivot`); None without one."""

    @property
    def p(self) -> float:
        """Chance of a segment that is predicted as badly as the worst one (Bonferroni)."""
        return min(1.0, len(self.segments) * min(one.p for one in self.segments))


def cross_validation(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider) -> CrossValidation:
    """Of the phase ``cycles``, linear about ``reference``; what ``consider`` states to be uncertain is a nuisance parameter.

    :class:`numpy.linalg.LinAlgError` where the numbers are too far apart.
    """
    found = posed_segments(samples, cycles, reference, vehicle, consider, SEGMENTS)
    size = len(consider.covariance)
    first = found.rows[0].shape[1] - 1 - size
    spread = np.linalg.cholesky(consider.covariance) if size else np.zeros((0, 0))
    rows = [np.hstack([one[:, :first], -one[:, first:-1] @ spread, one[:, -1:]]) for one in found.rows]
    known, own = np.vstack([rows[0], np.eye(size, rows[0].shape[1], first)]), slice(first - 10, first)
    predicted, moves = list[SegmentPrediction](), list[Array]()
    for k, part in enumerate(found.cycles, 1):
        others = _solved([known, *(one for j, one in enumerate(rows) if j not in (0, k))])
        one, move = _predicted(triangle_of(rows[k]), *others, part)
        predicted.append(one)
        moves.append(found.slopes @ move[own])
    mean, root = _solved([known, *rows[1:]])
    about, own_root = found.mean + found.slopes @ mean[own], found.slopes @ root[own]
    means = np.vstack([about, about + np.array(moves)])
    covariance = np.broadcast_to(own_root @ own_root.T, (len(means), 10, 10)).copy()
    relative = np.sqrt(np.einsum("kii->ki", covariance)[:, MOMENTS]) / means[:, MOMENTS]
    values, full = quantities(Parameters(means, covariance, relative), vehicle)
    pivot = about_pivot(values, full, np.array(vehicle.environment.bearing_position_m), 1 / means[:, MU])[0] if vehicle.pivoted else None
    return CrossValidation(tuple(predicted), _scatter(values), None if pivot is None else _scatter(pivot))


def _scatter(values: Array) -> Array:
    """(n,) of values (1 + S, n): the estimate, and where each segment moves it."""
    return np.asarray(np.sqrt(((values[1:] - values[0]) ** 2).sum(0)))


def _solved(rows: list[Array]) -> tuple[Array, Array]:
    """The estimate (n,) from rows (…, n + 1), and a root (n, n) of its covariance."""
    triangle = triangle_of(np.vstack(rows))[:-1]
    return np.linalg.solve(triangle[:, :-1], triangle[:, -1]), np.linalg.inv(triangle[:, :-1])


def _predicted(segment: Array, mean: Array, root: Array, cycles: slice) -> tuple[SegmentPrediction, Array]:
    """A segment's triangle (n + 1, n + 1) by an estimate (n,) with the covariance ``root @ root.T``, and m (n,) of the segment."""
    left, sizes, right = np.linalg.svd(segment[:-1, :-1])
    informed = sizes > np.finfo(float).eps * len(sizes) * sizes.max(initial=0.0)
    difference = (left.T @ (segment[:-1, -1] - segment[:-1, :-1] @ mean))[informed]
    spread = (sizes[:, None] * (right @ root))[informed]
    variances, axes = np.linalg.eigh(np.eye(len(spread)) + spread @ spread.T)
    white = axes.T @ difference / np.sqrt(variances)
    return SegmentPrediction(cycles, float(white @ white), len(white)), root @ (spread.T @ (axes @ (white / variances)))
