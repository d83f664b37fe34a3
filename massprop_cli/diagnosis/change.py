"""The moment at which the mass properties changed: each side of it has a body of its own.

What a stretch of the log says is a triangle on the coefficients φ of :mod:`massprop_cli.model.plant`, which are free of any reference;
those of two stretches are joined by one factorisation. So the log is gone through once, and a moment costs two small searches.
"""

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.regression import STILL
from massprop_cli.estimate.triangle import Triangle
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

SHORTEST = 40
"""Least cycles on each side."""
PARTS = 32
"""Parts that are left out in turn, and cycles that are tried one by one."""
STEPS = 12
"""Most Gauss–Newton steps to a body, which may be a hundred times as heavy as the one near which it is looked for."""


def likeliest(samples: Source, piece: slice, reference: Reference, vehicle: Resolved) -> int | None:
    """The cycle before which a change explains most; None where ``piece`` is too short.

    It lies in that part of the piece without which two bodies leave least, and so on down to single cycles. Each body is looked for near
    that of its end of the piece, and near ``reference``.
    """
    if piece.stop - piece.start < 4 * SHORTEST:
        return None
    quarter = (piece.stop - piece.start) // 4
    parts = slice(piece.start, piece.start + quarter), slice(piece.stop - quarter, piece.stop)
    bodies = [first_reference(samples, part, vehicle) or reference for part in parts]
    triangle = Triangle(samples, piece, vehicle, Consider())
    begun = [(triangle.begin(body), triangle.phase_system(body)) for body in bodies]

    def told(side: int, first: int, end: int) -> Array:
        return triangle.segment_triangle(*begun[side], slice(first, end))

    def least_of(before: Sequence[Array], after: Sequence[Array]) -> int:
        """Which pair two bodies leave least of."""
        each = (
            np.min([least(np.stack(own), body, vehicle) for body in (near, reference)], 0)
            for own, near in zip((before, after), bodies, strict=True)
        )
        return int(np.argmin(sum(each)))

    left: Array = np.zeros((triangle.phi_map.size + 1, triangle.phi_map.size + 1))
    right = left
    first, end, low, high = piece.start, piece.stop, piece.start + SHORTEST, piece.stop - SHORTEST
    while high - low > PARTS:
        edges = np.unique(np.linspace(low, high, min(PARTS, (high - low) // 2) + 1).astype(int)).tolist()
        begins, ends = ([told(side, *edge) for edge in pairwise(along)] for side, along in enumerate(([first, *edges], [*edges, end])))
        before = list(accumulate(begins, joined, initial=left))[1:]
        after = list(accumulate(reversed(ends), joined, initial=right))[:0:-1]
        at = least_of(before[:-1], after[1:])
        # a stretch of its own takes cycles to begin
        left, first = (before[at - 1], edges[at - 1]) if at else (left, first)
        right, end = (after[at + 2], edges[at + 2]) if at + 2 < len(edges) else (right, end)
        low, high = edges[at], edges[at + 1]
    every = range(low, high + 1)
    return every[least_of([joined(left, told(0, first, k)) for k in every], [joined(told(1, k, end), right) for k in every])]


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
