"""Maximum likelihood time of a change of the mass properties.

The information of a segment is a triangle on the coefficients φ of :mod:`massprop_cli.model.plant`, independent of any reference. Triangles
of two segments are joined by one factorisation. So the log is processed once, and a candidate time costs two small fits.
"""

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.base.levels import ENOUGH, ITERATIONS, PARTS, STILL
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.triangle import Triangle
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source


def change_cycle(samples: Source, piece: slice, reference: Reference, vehicle: Resolved) -> int | None:
    """Cycle before which a change explains most; None if ``piece`` is too short.

    Recursively select the part without which two bodies leave the least chi-square, down to single cycles. Each body starts from that of
    its end of the piece, and from ``reference``.
    """
    if piece.stop - piece.start < 4 * ENOUGH:
        return None
    quarter = (piece.stop - piece.start) // 4
    parts = slice(piece.start, piece.start + quarter), slice(piece.stop - quarter, piece.stop)
    bodies = [first_reference(samples, part, vehicle) or reference for part in parts]
    triangle = Triangle(samples, piece, vehicle, Consider())
    starts = [(triangle.begin(body), triangle.phase_system(body)) for body in bodies]

    def information(side: int, first: int, end: int) -> Array:
        return triangle.segment_triangle(*starts[side], slice(first, end))

    def least_of(before: Sequence[Array], after: Sequence[Array]) -> int:
        """Which pair two bodies leave least of."""
        each = (
            np.min([least_chi_squares(np.stack(own), body, vehicle) for body in (near, reference)], 0)
            for own, near in zip((before, after), bodies, strict=True)
        )
        return int(np.argmin(sum(each)))

    left: Array = np.zeros((triangle.phi_map.size + 1, triangle.phi_map.size + 1))
    right = left
    first, end, low, high = piece.start, piece.stop, piece.start + ENOUGH, piece.stop - ENOUGH
    while high - low > PARTS:
        edges = np.unique(np.linspace(low, high, min(PARTS, (high - low) // 2) + 1).astype(int)).tolist()
        first_parts, last_parts = (
            [information(side, *edge) for edge in pairwise(along)] for side, along in enumerate(([first, *edges], [*edges, end]))
        )
        before = list(accumulate(first_parts, joined, initial=left))[1:]
        after = list(accumulate(reversed(last_parts), joined, initial=right))[:0:-1]
        at = least_of(before[:-1], after[1:])
        # a segment needs cycles for its initial states
        left, first = (before[at - 1], edges[at - 1]) if at else (left, first)
        right, end = (after[at + 2], edges[at + 2]) if at + 2 < len(edges) else (right, end)
        low, high = edges[at], edges[at + 1]
    every = range(low, high + 1)
    return every[least_of([joined(left, information(0, first, k)) for k in every], [joined(information(1, k, end), right) for k in every])]


def joined(one: Array, other: Array) -> Array:
    """Triangle of two segments together."""
    return triangle_of(np.vstack([one, other]))


def least_chi_squares(triangles: Array, reference: Reference, vehicle: Resolved) -> Array:
    """(M,) least chi-square of ``triangles`` (M, N + 1, N + 1), by Gauss–Newton from ``reference``.

    The prior sigma of each step is the body's own size.
    """
    phi_map = ResponseMap(plant_of(vehicle))
    theta = phi_map.plant.theta(reference)
    return np.array([_least_chi_square(triangle, phi_map, theta) for triangle in triangles])


def _least_chi_square(triangle: Array, phi_map: ResponseMap, theta: Array) -> float:
    by_phi, measured = triangle[:, : phi_map.size], triangle[:, phi_map.size]
    for _ in range(ITERATIONS):
        phi, slopes = phi_map.coefficients(theta)
        scale = phi_map.sizes(theta)
        rows = np.column_stack([by_phi @ (slopes * scale), measured - by_phi @ phi])
        upper_triangle = triangle_of(np.vstack([rows, np.eye(10, 11)]))
        theta = phi_map.stepped(theta, scale * np.linalg.solve(upper_triangle[:10, :10], upper_triangle[:10, 10]))
        if (upper_triangle[:10, 10] ** 2).sum() < STILL**2:
            break
    return float(((measured - by_phi @ phi_map.coefficients(theta)[0]) ** 2).sum())
