"""Model discrepancy: estimates and sigmas of a log that its model does not explain, with all error parameters as nuisance parameters.

A model that leaves no room for its own error gives biased values with small sigmas (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001;
Brynjarsdóttir and O'Hagan, Inverse Problems 30, 2014). So each error parameter η stands as a column beside the mass properties θ, in its
usual sigma. How large they are together, s, the log tells by marginal likelihood (REML: Patterson and Thompson, Biometrika 58, 1971): of
its triangle on θ, η and what was measured

    [R_θθ R_θη z_θ; 0 R_ηη z_η; 0 0 ρ],   z_η ~ N(0, σ² 1 + s² R_ηη R_ηηᵀ),   ρ² ~ σ² χ²,

and then η is as known as s and the log make it. What no error parameter spans shows in the scatter of segments of time: each alone would
move the estimate by ``H⁻¹ g`` with its score g, and their squares add up (White, Econometrica 48, 1980).
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
"""Cycles taken in at a time, each having a hundred columns; and most of which these are computed together."""
SEGMENTS = 20
"""Of time, by whose scatter what nothing spans is told."""
LEAST, MOST = 0.3, 3.0
"""Of the common scale, a careful lab's errors being 1: what it is taken for at least where a log does not fit, and beyond which what is
stated is refuted."""
SCALES = np.concatenate([[0.0], np.geomspace(0.01, 30.0, 60)])
"""s that are tried."""
NOISES = 40
"""How many σ are."""
NATS = 8.0
"""Gain of ln evidence by which an error parameter stands out: ln of a hundred of them, and the odds of 1 : 20."""
NAMED = 4
"""Most that may."""
WIDE = 30.0
"""Their sigma, of a unit."""
TWICE = 2.0
"""Times the sigmas by which the estimate beside wandering torques differs from that without, by which its sigma is widened."""


@dataclass(frozen=True)
class ErrorFit:
    """The state parameters ixx … izz, CG, 1/m beside all error parameters, linear about a reference."""

    mean: Array
    """(10,)"""
    covariance: Array
    """(10, 10)"""
    scale: float
    """s, as the log tells it."""
    freed: tuple[int, ...]
    """Which error parameters the log tells by themselves, the most telling first."""
    errors: Array
    """(e,) η, in its usual sigma."""
    effects: Array
    """(10, e) by what each η moves the mean, in its usual sigma."""
    left: Array
    """(e, e) covariance of η."""
    by_noise: Array
    """(10,) variances that noise makes, ..."""
    scatter: Array
    """... and what nothing spans."""

    def widened(self, free: ErrorFit) -> ErrorFit:
        """With what it differs by from the estimate without wandering torques: these may take a part of what is wrong, as noise.

        d²/V sigmas squared by the other's own covariance V, but not by more than the difference itself.
        """
        own, other = np.diag(self.covariance), np.diag(free.covariance)
        apart = (self.mean - free.mean) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            more = np.nan_to_num(np.minimum(apart, TWICE**2 * own * apart / other))
            factor = np.sqrt(1 + np.nan_to_num(more / own))
        return replace(self, covariance=self.covariance * factor[:, None] * factor, scatter=self.scatter + more)


class PosedSegments(NamedTuple):
    """What is known of a phase before its first cycle, and what each segment of it says, in whitened rows about one reference."""

    rows: list[Array]
    """Of each (r, n + 10 + e + 1): nuisance parameters, departures of θ, assumptions, and what was measured."""
    cycles: list[slice]
    """Of each segment; ``rows`` has one more, the first."""
    mean: Array
    """(10,) state parameters ixx … izz, CG, 1/m of the reference, ..."""
    slopes: Array
    """... and (10, 10) their derivatives by the departures of θ as they stand in the rows."""


def posed_segments(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider, count: int
) -> PosedSegments:
    """A phase in ``count`` equal segments of time, or fewer where it is short."""
    plant = plant_of(vehicle)
    theta = plant.theta(reference)
    ends = np.unique(np.linspace(cycles.start, cycles.stop, count + 1).astype(int)[1:])
    edges = [cycles.start, *ends[ends > cycles.start + 1].tolist()]
    stops = [[*range(first + AT_ONCE, end, AT_ONCE), end] for first, end in pairwise(edges)]
    begun = frozenset([cycles.start, *chain(*stops)])
    regression = Regression(samples, cycles, vehicle, replace(consider, restarts=begun), Tangent(plant, theta))
    known, each = _segments(regression, reference, stops)
    rows, scale = regression.beside_assumptions([known, *(triangle for _, triangle in each)], theta)
    return PosedSegments(
        rows, [part for part, _ in each], regression.phi_map.plant.parameters(theta), regression.phi_map.plant.slopes(theta) * scale
    )


def error_fit(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider, usual: Array, least: Array
) -> ErrorFit:
    """Of one phase about ``reference``; ``usual`` (e,) are one sigma of each assumption of ``consider``, in its unit.

    ``least`` (e,) are the least errors that are physical, in their usual sigma. One that would have to be less stands for something else,
    and is held at none.
    """
    segments = posed_segments(samples, cycles, reference, vehicle, consider, SEGMENTS)
    posed = [rows * np.concatenate([np.ones(rows.shape[1] - len(usual) - 1), -usual, [1.0]]) for rows in segments.rows]
    count = int((~samples.unread).sum()) * (cycles.stop - cycles.start)
    while True:
        found = _beside_errors(segments, posed, len(usual), count)
        below = least - np.sqrt(np.diag(found.left)) - found.errors
        if not below.max(initial=0.0) > 0:
            return found
        at = len(usual) + 1 - int(below.argmax())
        for rows in posed:
            rows[:, -at] = 0.0


def _beside_errors(segments: PosedSegments, posed: Sequence[Array], size: int, count: int) -> ErrorFit:
    """Of rows with so many error parameters, in their usual sigma, and of so many measurements."""
    first = posed[0].shape[1] - size - 1
    own = slice(first - 10, first)
    triangle = triangle_of(np.vstack(posed))
    s, noise, freed = _told(triangle[first:, first:], count - first)
    sigma = np.full(size, max(s, LEAST))
    sigma[freed] = WIDE
    prior = np.eye(size, triangle.shape[1], first) * (noise / sigma)[:, None]
    whole = triangle_of(np.vstack([triangle, prior]))[:-1]
    solved, inverse = np.linalg.solve(whole[:, :-1], whole[:, -1]), np.linalg.inv(whole[:, :-1])
    root = segments.slopes @ inverse[own]
    alone = segments.slopes @ np.linalg.inv(triangle[:first, :first])[own]
    moved = [root @ (inverse.T @ (rows[:, :-1].T @ (rows[:, -1] - rows[:, :-1] @ solved))) for rows in posed[1:]]
    scatter = np.array(moved).T @ np.array(moved) * len(moved) / max(len(moved) - 1, 1)
    return ErrorFit(
        segments.mean + segments.slopes @ solved[own],
        noise**2 * root @ root.T + scatter,
        s,
        tuple(freed),
        solved[first:],
        -alone @ triangle[:first, first:-1],
        noise**2 * inverse[first:] @ inverse[first:].T,
        noise**2 * (alone**2).sum(1),
        np.diag(scatter).copy(),
    )


def _segments(regression: Regression, reference: Reference, stops: Sequence[Sequence[int]]) -> tuple[Array, list[tuple[slice, Array]]]:
    """Whitened rows of what is known before the first cycle, and triangles of those of each segment; ``stops`` on the way to its end."""
    begun = run = replace(regression.begin(reference), bound=True)
    ends, every = {own[-1] for own in stops}, [*chain(*stops)]
    parts, found, first = list[Array](), list[tuple[slice, Array]](), run.at
    while every:
        count = max(sum(stop <= run.at + TOGETHER for stop in every), 1)
        for after, taken in regression.through(run, every[:count]):
            run = after
            parts.append(regression.ordered(taken))
            if run.at in ends:
                found.append((slice(first, run.at), triangle_of(np.vstack(parts))))
                parts, first = [], run.at
        every = every[count:]
    return begun.triangle, found


def _told(corner: Array, count: int) -> tuple[float, float, list[int]]:
    """s, σ, and the error parameters that the log tells to be of another size than all others: their evidence is taken one by one.

    Of a triangle (e + 1, e + 1) on η and what was measured. Freeing one gains ``q² / 2 κ − ln(1 + w² κ) / 2`` nats, with its score q and
    information κ beside all others (Tipping and Faul, Proc. 9th Workshop on AI and Statistics, 2003).
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
        told = WIDE**2 * information > 1  # what is told less is where it was
        gain = np.where(told, (score**2 / np.where(told, information, 1.0) - np.log1p(WIDE**2 * information)) / 2, 0.0)
        best = int(gain.argmax())
        if gain[best] < NATS:
            return s, noise, freed
        freed.append(int(others[best]))


def _likeliest(corner: Array, count: int) -> tuple[float, float]:
    """Scale s and noise σ ≥ 1 of a triangle (e + 1, e + 1) on η and what was measured, of so many measurements."""
    left, sizes, _ = np.linalg.svd(corner[:-1, :-1])
    power, told, rest = sizes**2, (left.T @ corner[:-1, -1]) ** 2, float(corner[-1, -1] ** 2)
    real = power > np.finfo(float).eps * power.max(initial=0.0)
    freedom = max(count - int(real.sum()), 1)
    variance = np.geomspace(1.0, max((rest + float(told.sum())) / freedom, 1.0) + np.finfo(float).eps, NOISES)[:, None]
    of_each = variance[..., None] + SCALES[:, None] ** 2 * power[real]
    likelihood = -(np.log(of_each) + told[real] / of_each).sum(-1) - freedom * np.log(variance) - rest / variance
    i, j = np.unravel_index(int(likelihood.argmax()), likelihood.shape)
    return float(SCALES[j]), float(np.sqrt(variance[i, 0]))
