"""Innovations of whitened rows: each cycle's residual against the prediction from all rows before it."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array, grown, root_beside_unit
from massprop_cli.kernel import call, kernel
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.align import Aligned


def sequential_innovations(triangle: Array, rows: Array) -> tuple[Array, Array]:
    """(K, m) innovations of each cycle's rows (K, m, n + 1), and (K, m, m) the lower root of their covariance.

    The prediction is from the triangle (n, n + 1) and the cycles before. A row holds n regressors and a measured value, with noise of unit
    variance. The compiled kernel runs if it is available and m = 6.
    """
    count, size = rows.shape[0], rows.shape[2]
    if (library := kernel().library) is None or rows.shape[1] != 6:
        return innovations_given(grown(triangle, rows)[:-1], rows)
    packed = np.append(triangle[np.triu_indices(size - 1, 0, size)], 0.0)
    innovations, root = np.empty((count, 6)), np.empty((count, 6, 6))
    call(library.mp_host_expected, count, size - 1, rows, packed, np.empty(6 * size), innovations, root)
    return innovations, root


def innovations_given(triangles: Array, rows: Array) -> tuple[Array, Array]:
    """:func:`sequential_innovations` with the triangles (K, n, n + 1) before each cycle."""
    size = triangles.shape[1]
    prediction = rows[..., :size] @ np.linalg.inv(triangles[..., :size])
    innovations: Array = rows[..., size] - np.einsum("kij,kj->ki", prediction, triangles[..., size])
    return innovations, root_beside_unit(prediction)


def in_units(
    executed: Aligned, reference: Reference, begins: bool, innovations: Array, spread: Array, root: Array
) -> tuple[Array, Array, Array]:
    """(K, 6) innovations as torque [N m] and force [N], their sigmas, and whitened; NaN where a channel is not used.

    ``innovations`` (K, m) have the lower root ``spread`` (K, m, m); ``root`` (K, m, m) is the root by which the rows were whitened. If the
    first cycle ``begins`` an estimate, it has no prediction. Innovations of a logged attitude, after the first six, are left out.
    """
    innovations, spread = innovations[:, :6], spread[:, :6, :6]
    normalised = np.linalg.solve(spread, innovations[..., None])[..., 0]
    unit = np.zeros((len(innovations), 6, 6))
    unit[:, :3, :3] = reference.inertia / executed.duration_s[:, None, None]
    unit[:, 3:, 3:] = np.eye(3) / reference.mu
    root = unit @ root[:, :6, :6]
    value, sigma = np.einsum("kij,kj->ki", root, innovations), np.sqrt(((root @ spread) ** 2).sum(2))
    for part in (value, sigma, normalised):
        part[:begins] = np.nan
        part[executed.ignored] = np.nan
    return value, sigma, normalised
