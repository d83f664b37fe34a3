"""A single unit quaternion wxyz as four numbers: of one, NumPy takes ten times as long as the numbers themselves.

:mod:`massprop_cli.base.quaternion` has the same of arrays.
"""

import math

import numpy as np

from massprop_cli.base.arrays import Array

Quaternion = tuple[float, float, float, float]


def floats(wxyz: Array) -> Quaternion:
    """Of an array (4,)."""
    w, x, y, z = wxyz.tolist()
    return w, x, y, z


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product."""
    w, x, y, z = a
    p, q, r, s = b
    return w * p - x * q - y * r - z * s, w * q + x * p + y * s - z * r, w * r - x * s + y * p + z * q, w * s + x * r - y * q + z * p


def unit(one: Quaternion) -> Quaternion:
    """Of length one."""
    w, x, y, z = one
    size = math.sqrt(w * w + x * x + y * y + z * z)
    return w / size, x / size, y / size, z / size


def of_vector(vector: Array) -> Quaternion:
    """Of a rotation vector, rad."""
    x, y, z = vector.tolist()
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    by = 0.5 * math.sin(half) / half if half > 0 else 0.5
    return math.cos(half), by * x, by * y, by * z


def vector_of(one: Quaternion) -> Array:
    """(3,) rotation vector of one of unit length, no longer than π."""
    w, x, y, z = one
    sine = math.sqrt(x * x + y * y + z * z)
    by = 2 * math.atan2(sine, abs(w)) / sine if sine > 0 else 2.0
    return np.array([x, y, z]) * (-by if w < 0 else by)
