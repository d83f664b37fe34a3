"""The moment at which the mass properties changed: each side of it has a body of its own.

What a stretch of the log says is a triangle on the coefficients φ of :mod:`massprop_cli.model.plant`, which are free of any reference;
those of two stretches are joined by one factorisation. So the log is gone through once, and a moment costs two small searches.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.diagnosis.segment import edges_of
from massprop_cli.estimate.regression import STEPS, STILL
from massprop_cli.estimate.triangle import Triangle
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

SHORTEST = 40
"""Least cycles on each side."""
FINER = 8
"""Parts of two stretches that are tried next, and so on down to single cycles."""


def likeliest(samples: Source, piece: slice, reference: Reference, vehicle: Resolved) -> int | None:
    """The cycle before which a change explains most; None where ``piece`` is too short."""
    if piece.stop - piece.start < 4 * SHORTEST:
        return None

    triangle = Triangle(samples, piece, vehicle, Consider())
    begun, whole = triangle.begin(reference), triangle.whole(reference)

    def told(first: int, end: int) -> Array:
        return triangle.stretch(begun, whole, slice(first, end))

    def best_of(moments: Sequence[int], before: Sequence[Array], after: Sequence[Array]) -> int:
        left = least(np.stack([*before, *after]), reference, vehicle).reshape(2, -1).sum(0)
        return moments[int(np.argmin(left))]

    edges = edges_of(piece.start, piece.stop).tolist()
    parts = [told(first, end) for first, end in pairwise(edges)]
    before, after = list(accumulate(parts, joined)), list(accumulate(reversed(parts), joined))[::-1]
    roomy = [i for i, k in enumerate(edges[1:-1]) if _has_room(k, piece)]
    best = best_of([edges[i + 1] for i in roomy], [before[i] for i in roomy], [after[i + 1] for i in roomy])
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
        best = best_of(moments, [joined(left, told(first, k)) for k in moments], [joined(told(k, end), right) for k in moments])
        low, high = max(best - step, first), min(best + step, end)
        if step == 1:
            break
    return best


def _has_room(k: int, piece: slice) -> bool:
    return k in range(piece.start + SHORTEST, piece.stop - SHORTEST + 1)


def joined(one: Array, other: Array) -> Array:
    """What two stretches say together."""
    return triangle_of(np.vstack([one, other]))


def least(triangles: Array, reference: Reference, vehicle: Resolved) -> Array:
    """(M,) chi-square of the body near a reference that fits each of ``triangles`` (M, N + 1, N + 1) best.

    Gauss–Newton steps, each held back by the body's own size.
    """
    phi_map = ResponseMap(plant_of(vehicle))
    theta = phi_map.plant.theta(reference)
    return np.array([_least(triangle, phi_map, theta) for triangle in triangles])


def _least(triangle: Array, phi_map: ResponseMap, theta: Array) -> float:
    by_phi, measured = triangle[:, : phi_map.size], triangle[:, phi_map.size]
    for _ in range(STEPS):
        phi, slopes = phi_map.coefficients(theta)
        scale = phi_map.sizes(theta)
        rows = np.column_stack([by_phi @ (slopes * scale), measured - by_phi @ phi])
        upper = triangle_of(np.vstack([rows, np.eye(10, 11)]))
        theta = phi_map.stepped(theta, scale * np.linalg.solve(upper[:10, :10], upper[:10, 10]))
        if (upper[:10, 10] ** 2).sum() < STILL**2:
            break
    return float(((measured - by_phi @ phi_map.coefficients(theta)[0]) ** 2).sum())
