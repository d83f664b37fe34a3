"""What whitened rows bring that those before them did not tell."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array, grown, root_beside_unit

TOGETHER = 3
"""Cycles of which one triangle is made: of few, many triangles; of many, large roots."""


def unexpected(triangle: Array, rows: Array) -> tuple[Array, Array]:
    """(K, 6) what of each cycle's rows (K, 6, n + 1) a triangle (n, n + 1) and the cycles before don't tell, and (K, 6, 6) its lower root.

    Each row is on n unknowns and what was measured, with noise of unit variance. Rows of some cycles are predicted at once; in the lower
    root of their covariance, that of what each cycle brings beside those before it stands on the diagonal.
    """
    count, size = len(rows), rows.shape[2]
    lots = -(-count // TOGETHER)
    each = np.zeros((lots * TOGETHER, 6, size))
    each[:count] = rows
    each = each.reshape(lots, 6 * TOGETHER, size)
    left, root = beyond(grown(triangle, each)[:-1], each)
    white = np.linalg.solve(root, left[..., None]).reshape(-1, 6, 1)[:count]
    among = np.arange(TOGETHER)
    own = root.reshape(lots, TOGETHER, 6, TOGETHER, 6)[:, among, :, among].swapaxes(0, 1).reshape(-1, 6, 6)[:count]
    return (own @ white)[..., 0], own


def beyond(triangles: Array, rows: Array) -> tuple[Array, Array]:
    """What of rows (K, r, n + 1) triangles (K, n, n + 1) before them don't tell, (K, r), and its lower root (K, r, r)."""
    size = triangles.shape[1]
    ahead = rows[..., :size] @ np.linalg.inv(triangles[..., :size])
    left: Array = rows[..., size] - np.einsum("kij,kj->ki", ahead, triangles[..., size])
    return left, root_beside_unit(ahead)
