"""Innovations of whitened rows against all rows before them."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array, grown, root_beside_unit
from massprop_cli.kernel import call, kernel
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.align import Aligned


def unexpected(triangle: Array, rows: Array) -> tuple[Array, Array]:
    """(K, m) what of each cycle's rows (K, m, n + 1) a triangle (n, n + 1) and the cycles before don't tell, and (K, m, m) its lower root.

    Each row is on n unknowns and what was measured, with noise of unit variance. Where there is a compiled kernel it runs, on m = 6 rows.
    """
    count, size = rows.shape[0], rows.shape[2]
    if (library := kernel().library) is None or rows.shape[1] != 6:
        return beyond(grown(triangle, rows)[:-1], rows)
    packed = np.append(triangle[np.triu_indices(size - 1, 0, size)], 0.0)
    left, spread = np.empty((count, 6)), np.empty((count, 6, 6))
    call(library.mp_host_expected, count, size - 1, rows, packed, np.empty(6 * size), left, spread)
    return left, spread


def beyond(triangles: Array, rows: Array) -> tuple[Array, Array]:
    """The same of the triangles (K, n, n + 1) before each cycle."""
    size = triangles.shape[1]
    ahead = rows[..., :size] @ np.linalg.inv(triangles[..., :size])
    left: Array = rows[..., size] - np.einsum("kij,kj->ki", ahead, triangles[..., size])
    return left, root_beside_unit(ahead)


def in_units(
    executed: Aligned, reference: Reference, begins: bool, unexplained: Array, spread: Array, root: Array
) -> tuple[Array, Array, Array]:
    """(K, 6) innovations as torque [N m] and force [N], their sigmas, and whitened; NaN where a channel is not used.

    Of what isn't told (K, m), its lower root (K, m, m), and the root (K, m, m) by which rows were made white. Nothing is expected of the
    first cycle where it ``begins`` an estimate. Those of a logged attitude stand after the six, and are not judged here.
    """
    unexplained, spread = unexplained[:, :6], spread[:, :6, :6]
    normalised = np.linalg.solve(spread, unexplained[..., None])[..., 0]
    unit = np.zeros((len(unexplained), 6, 6))
    unit[:, :3, :3] = reference.inertia / executed.duration_s[:, None, None]
    unit[:, 3:, 3:] = np.eye(3) / reference.mu
    root = unit @ root[:, :6, :6]
    innovation, sigma = np.einsum("kij,kj->ki", root, unexplained), np.sqrt(((root @ spread) ** 2).sum(2))
    for found in (innovation, sigma, normalised):
        found[:begins] = np.nan
        found[executed.ignored] = np.nan
    return innovation, sigma, normalised
