"""Model discrepancy: estimates and sigmas of a log that its model does not explain, with all error parameters as nuisance parameters.

A model without a term for its own error gives biased values with small sigmas (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001;
Brynjarsdóttir and O'Hagan, Inverse Problems 30, 2014). So each error parameter η is a column in addition to the mass properties θ, in units
of its usual sigma. Their common scale s is estimated by marginal likelihood (REML: Patterson and Thompson, Biometrika 58, 1971), from the
triangle on θ, η and the measured value

    [R_θθ R_θη z_θ; 0 R_ηη z_η; 0 0 ρ],   z_η ~ N(0, σ² 1 + s² R_ηη R_ηηᵀ),   ρ² ~ σ² χ².

The prior s and the log then determine η. An error outside the span of the error parameters shows in the scatter of segments of time: each
alone would move the estimate by ``H⁻¹ g`` with its score g, and the squares of these add up (White, Econometrica 48, 1980).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.estimate.regression import Regression
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import Tangent
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

AT_ONCE, TOGETHER = 128, 1024
"""Cycles per block, with about a hundred columns; and cycles whose system is computed at once."""
SEGMENTS = 20
"""Number of segments whose scatter is evaluated."""
LEAST, MOST = 0.3, 3.0
"""Bounds of the common scale, 1 being the errors of a careful lab: least value for a log that does not fit, and value above which the
stated errors are refuted."""
SCALES = np.concatenate([[0.0], np.geomspace(0.01, 30.0, 60)])
"""Grid of s."""
NOISES = 40
"""Size of the grid of σ."""
NATS = 8.0
"""Gain of log evidence above which an error parameter is freed: ln of a hundred parameters, and odds of 1 : 20."""
NAMED = 4
"""Most error parameters that are freed."""
WIDE = 30.0
"""Prior sigma of a freed error parameter, in usual sigmas."""
TWICE = 2.0
"""Factor on the normalised difference between the estimates with and without random-walk torques, in the widened sigma."""


@dataclass(frozen=True)
class ErrorFit:
    """State parameters ixx … izz, CG, 1/m with all error parameters as nuisance parameters, linear about a reference."""

    mean: Array
    """(10,) state parameters."""
    covariance: Array
    """(10, 10) their covariance."""
    scale: float
    """Estimate of s."""
    freed: tuple[int, ...]
    """Indices of the freed error parameters, in the order of their gain."""
    errors: Array
    """(e,) estimate of η, in usual sigmas."""
    effects: Array
    """(10, e) derivative of the mean with respect to each η, per usual sigma."""
    error_covariance: Array
    """(e, e) covariance of η."""
    by_noise: Array
    """(10,) variances by measurement noise."""
    scatter: Array
    """(10,) variances by the scatter of segments."""

    def widened(self, free: ErrorFit) -> ErrorFit:
        """The fit with sigmas that include its difference to ``free``, the fit without random-walk torques; these may absorb model errors.

        The difference d adds ``TWICE² d²/V`` of its own variances, with V the variances of ``free``, and at most d² itself.
        """
        own, other = np.diag(self.covariance), np.diag(free.covariance)
        squared = (self.mean - free.mean) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            more = np.nan_to_num(np.minimum(squared, TWICE**2 * own * squared / other))
            factor = np.sqrt(1 + np.nan_to_num(more / own))
        return replace(self, covariance=self.covariance * factor[:, None] * factor, scatter=self.scatter + more)


class PosedSegments(NamedTuple):
    """Information of a phase by segment: whitened rows about one reference."""

    rows: list[Array]
    """(r, n + 10 + e + 1) each: nuisance parameters, departures of θ, assumptions, measured value; the first is the prior."""
    cycles: list[slice]
    """Of each segment, one fewer than ``rows``."""
    mean: Array
    """(10,) state parameters ixx … izz, CG, 1/m of the reference."""
    slopes: Array
    """(10, 10) their derivatives with respect to the rows' departures of θ."""


def posed_segments(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider, count: int
) -> PosedSegments:
    """Information of a phase in ``count`` segments of equal length, or fewer if it is short."""
    plant = plant_of(vehicle)
    theta = plant.theta(reference)
    ends = np.unique(np.linspace(cycles.start, cycles.stop, count + 1).astype(int)[1:])
    edges = [cycles.start, *ends[ends > cycles.start + 1].tolist()]
    stops = [[*range(first + AT_ONCE, end, AT_ONCE), end] for first, end in pairwise(edges)]
    restarts = frozenset([cycles.start, *chain(*stops)])
    regression = Regression(samples, cycles, vehicle, replace(consider, restarts=restarts), Tangent(plant, theta))
    known, each = _segments(regression, reference, stops)
    rows, scale = regression.with_assumptions([known, *(triangle for _, triangle in each)], theta)
    return PosedSegments(
        rows, [part for part, _ in each], regression.phi_map.plant.parameters(theta), regression.phi_map.plant.slopes(theta) * scale
    )


def error_fit(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider, usual: Array, least: Array
) -> ErrorFit:
    """Fit of one phase about ``reference``; ``usual`` (e,) is the usual sigma of each assumption of ``consider``, in its unit.

    ``least`` (e,) is the least physical value of each error parameter, in usual sigmas. A parameter whose estimate is below it absorbs
    another error, and is fixed at zero.
    """
    segments = posed_segments(samples, cycles, reference, vehicle, consider, SEGMENTS)
    rows = [part * np.concatenate([np.ones(part.shape[1] - len(usual) - 1), -usual, [1.0]]) for part in segments.rows]
    count = int((~samples.unread).sum()) * (cycles.stop - cycles.start)
    while True:
        fit = _with_errors(segments, rows, len(usual), count)
        below = least - np.sqrt(np.diag(fit.error_covariance)) - fit.errors
        if not below.max(initial=0.0) > 0:
            return fit
        at = len(usual) + 1 - int(below.argmax())
        for part in rows:
            part[:, -at] = 0.0


def _with_errors(segments: PosedSegments, rows: Sequence[Array], size: int, count: int) -> ErrorFit:
    """Fit of ``rows`` with ``size`` error parameters, in usual sigmas, from ``count`` measurements."""
    first = rows[0].shape[1] - size - 1
    theta = slice(first - 10, first)
    triangle = triangle_of(np.vstack(rows))
    s, noise, freed = _scales(triangle[first:, first:], count - first)
    sigma = np.full(size, max(s, LEAST))
    sigma[freed] = WIDE
    prior = np.eye(size, triangle.shape[1], first) * (noise / sigma)[:, None]
    posterior = triangle_of(np.vstack([triangle, prior]))[:-1]
    solved, inverse = np.linalg.solve(posterior[:, :-1], posterior[:, -1]), np.linalg.inv(posterior[:, :-1])
    root = segments.slopes @ inverse[theta]
    without_errors = segments.slopes @ np.linalg.inv(triangle[:first, :first])[theta]
    moves = [root @ (inverse.T @ (part[:, :-1].T @ (part[:, -1] - part[:, :-1] @ solved))) for part in rows[1:]]
    scatter = np.array(moves).T @ np.array(moves) * len(moves) / max(len(moves) - 1, 1)
    return ErrorFit(
        segments.mean + segments.slopes @ solved[theta],
        noise**2 * root @ root.T + scatter,
        s,
        tuple(freed),
        solved[first:],
        -without_errors @ triangle[:first, first:-1],
        noise**2 * inverse[first:] @ inverse[first:].T,
        noise**2 * (without_errors**2).sum(1),
        np.diag(scatter).copy(),
    )


def _segments(regression: Regression, reference: Reference, stops: Sequence[Sequence[int]]) -> tuple[Array, list[tuple[slice, Array]]]:
    """Information before the first cycle, and each segment with the triangle of its rows; ``stops`` are the ends of its blocks."""
    begun = run = replace(regression.begin(reference), tied=True)
    ends, every = {segment[-1] for segment in stops}, [*chain(*stops)]
    parts, segments, first = list[Array](), list[tuple[slice, Array]](), run.at
    while every:
        count = max(sum(stop <= run.at + TOGETHER for stop in every), 1)
        for after, whitened in regression.process_each(run, every[:count]):
            run = after
            parts.append(regression.ordered(whitened))
            if run.at in ends:
                segments.append((slice(first, run.at), triangle_of(np.vstack(parts))))
                parts, first = [], run.at
        every = every[count:]
    return begun.triangle, segments


def _scales(corner: Array, count: int) -> tuple[float, float, list[int]]:
    """s, σ, and the error parameters whose size the log distinguishes from that of all others, freed one by one by their evidence.

    ``corner`` is a triangle (e + 1, e + 1) on η and the measured value. Freeing a parameter gains ``q² / 2 κ − ln(1 + w² κ) / 2`` nats,
    with its score q and information κ given all others (Tipping and Faul, Proc. 9th Workshop on AI and Statistics, 2003).
    """
    freed, every = list[int](), np.arange(len(corner) - 1)
    while True:
        others = np.setdiff1d(every, freed)
        rest = triangle_of(corner[:, [*freed, *others, len(every)]])[len(freed) :, len(freed) :]
        s, noise = _likeliest(rest, count - len(freed))
        if len(freed) == NAMED or not others.size:
            return s, noise, freed
        left, sizes, right = np.linalg.svd(rest[:-1, :-1])
        weight = 1 / (noise**2 + (s * sizes) ** 2)
        score = right.T @ (weight * sizes * (left.T @ rest[:-1, -1]))
        information = right.T**2 @ (weight * sizes**2)
        informed = WIDE**2 * information > 1  # any other would keep its prior value
        gain = np.where(informed, (score**2 / np.where(informed, information, 1.0) - np.log1p(WIDE**2 * information)) / 2, 0.0)
        best = int(gain.argmax())
        if gain[best] < NATS:
            return s, noise, freed
        freed.append(int(others[best]))


def _likeliest(corner: Array, count: int) -> tuple[float, float]:
    """Maximum likelihood s and σ ≥ 1 on their grids, from a triangle (e + 1, e + 1) on η and the ``count`` measured values."""
    left, sizes, _ = np.linalg.svd(corner[:-1, :-1])
    power, squares, rest = sizes**2, (left.T @ corner[:-1, -1]) ** 2, float(corner[-1, -1] ** 2)
    real = power > np.finfo(float).eps * power.max(initial=0.0)
    freedom = max(count - int(real.sum()), 1)
    variance = np.geomspace(1.0, max((rest + float(squares.sum())) / freedom, 1.0) + np.finfo(float).eps, NOISES)[:, None]
    expected = variance[..., None] + SCALES[:, None] ** 2 * power[real]
    likelihood = -(np.log(expected) + squares[real] / expected).sum(-1) - freedom * np.log(variance) - rest / variance
    i, j = np.unravel_index(int(likelihood.argmax()), likelihood.shape)
    return float(SCALES[j]), float(np.sqrt(variance[i, 0]))
