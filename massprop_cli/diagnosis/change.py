"""When the mass properties changed at once, if they did: each side of every moment tried has a body of its own.

What a stretch of the log says is a triangle on the coefficients φ of :mod:`massprop_cli.model.plant`, which are free of any reference;
those of two stretches are joined by one factorisation. So the log is gone through once, and a moment costs two small searches.
"""

from __future__ import annotations

from itertools import accumulate, pairwise

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.estimate.regression import STEPS, STILL, Regression
from massprop_cli.model.lift import Lift
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

SHORTEST = 40
"""Least cycles on each side."""
BLOCKS = 32
"""Stretches whose edges are tried first; then every ``FINER``-th part of two of them, and so on down to single cycles."""
FINER = 8


def likeliest(samples: Source, piece: slice, reference: Reference, vehicle: Resolved) -> int | None:
    """The cycle before which a change explains most; None where ``piece`` is too short."""
    if piece.stop - piece.start < 4 * SHORTEST:
        return None

    def told(first: int, end: int) -> Array:
        return stretch(samples, slice(first, end), reference, vehicle)

    def misfit(before: Array, after: Array) -> float:
        return sum(least(side, lift, lift.theta(reference)) for side in (before, after))

    lift = Lift(plant_of(vehicle))
    edges = [int(k) for k in np.unique(np.linspace(piece.start, piece.stop, BLOCKS + 1).astype(int))]
    parts = [told(first, end) for first, end in pairwise(edges)]
    before, after = list(accumulate(parts, joined)), list(accumulate(reversed(parts), joined))[::-1]
    tried = {k: misfit(before[i], after[i + 1]) for i, k in enumerate(edges[1:-1]) if _has_room(k, piece)}
    best = min(tried, key=lambda k: tried[k])
    at = edges.index(best)
    first, end = edges[at - 1], edges[at + 1]
    left = before[at - 2] if at > 1 else np.zeros_like(before[0])
    right = after[at + 1] if at + 1 < len(after) else np.zeros_like(before[0])
    low, high = first, end
    while high - low > 2:
        step = max((high - low) // FINER, 1)
        moments = [k for k in range(low + step, high, step) if _has_room(k, piece) and min(k - first, end - k) > 1]
        if not moments:
            break
        tried = {k: misfit(joined(left, told(first, k)), joined(told(k, end), right)) for k in moments}
        best = min(tried, key=lambda k: tried[k])
        low, high = max(best - step, first), min(best + step, end)
        if step == 1:
            break
    return best


def _has_room(k: int, piece: slice) -> bool:
    return k in range(piece.start + SHORTEST, piece.stop - SHORTEST + 1)


def stretch(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved) -> Array:
    """(N + 1, N + 1) triangle of what a stretch says of φ, the rate at its start and all other nuisances unknown; last, what is left."""
    regression = Regression(samples, cycles, vehicle, Consider())
    run, _ = regression.take(regression.begin(reference), cycles.stop)
    return run.triangle[regression.free :, regression.free :]


def joined(one: Array, other: Array) -> Array:
    """What two stretches say together."""
    return triangle_of(np.vstack([one, other]))


def least(triangle: Array, lift: Lift, theta: Array) -> float:
    """Chi-square of the body near ``theta`` (10,) that fits a triangle best: Gauss–Newton steps, each held back by the body's own size."""
    by_phi, measured = triangle[:, : lift.size], triangle[:, lift.size]
    for _ in range(STEPS):
        phi, slopes = lift.coefficients(theta)
        scale = lift.sizes(theta)
        rows = np.column_stack([by_phi @ (slopes * scale), measured - by_phi @ phi])
        upper = triangle_of(np.vstack([rows, np.eye(10, 11)]))
        theta = lift.stepped(theta, scale * np.linalg.solve(upper[:10, :10], upper[:10, 10]))
        if (upper[:10, 10] ** 2).sum() < STILL**2:
            break
    return float(((measured - by_phi @ lift.coefficients(theta)[0]) ** 2).sum())
