"""Unit quaternions wxyz, which turn body axes into world axes."""

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.base.rigidbody import cross


def rotation_vector(unit_wxyz: Array) -> Array:
    """(..., 3) rotation vectors, rad, of at most π, from unit quaternions (..., 4)."""
    sine = np.linalg.norm(unit_wxyz[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(sine, np.abs(unit_wxyz[..., :1]))
    scale = np.where(sine > 0, 2 * half / np.maximum(sine, TINY), 2.0)
    return unit_wxyz[..., 1:] * scale * np.where(unit_wxyz[..., :1] < 0, -1.0, 1.0)


def quaternion_of(rotation_vector: Array) -> Array:
    """(..., 4) unit quaternions from rotation vectors (..., 3), rad."""
    angle = np.linalg.norm(rotation_vector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * rotation_vector], -1)


def quaternion_product(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions (..., 4)."""
    scalar, vector = a[..., :1], a[..., 1:]
    real = scalar * b[..., :1] - (vector * b[..., 1:]).sum(-1, keepdims=True)
    return np.concatenate([real, scalar * b[..., 1:] + b[..., :1] * vector + cross(vector, b[..., 1:])], -1)


def matrices(attitude_wxyz: Array) -> Array:
    """(K, 3, 3) rotation matrices, world from body, from unit quaternions (K, 4)."""
    w, x, y, z = attitude_wxyz.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def inverse(unit_wxyz: Array) -> Array:
    """(..., 4) inverse unit quaternions."""
    return np.asarray(unit_wxyz * np.array([1.0, -1.0, -1.0, -1.0]))


def turns_between(attitude_wxyz: Array) -> Array:
    """(n − 1, 4) rotations from each attitude (n, 4) to the next, body axes."""
    return quaternion_product(inverse(attitude_wxyz[:-1]), attitude_wxyz[1:])
