"""The gyroscopic torque ω × I ω as Γ(I) s: linear in I, and in the products s = (ωx ωx, ωx ωy, ωx ωz, ωy ωy, ωy ωz, ωz ωz)."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import COLUMNS, ROWS, cross_matrix


def _gyroscopic() -> Array:
    """(9, 18) the linear map from I to Γ(I)."""
    found = np.zeros((3, 6, 3, 3))
    turn = cross_matrix(np.eye(3))  # turn[i] = [e_i]×
    for k, (i, j) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        found[:, k, :, j] += turn[i]
        if i != j:
            found[:, k, :, i] += turn[j]
    return found.reshape(18, 9).T


_GAMMA = _gyroscopic()


def gamma(inertia: Array) -> Array:
    """Γ(I), (..., 3, 6): ``Γ(I) s = ω × I ω``."""
    return (inertia.reshape(*inertia.shape[:-2], 9) @ _GAMMA).reshape(*inertia.shape[:-2], 3, 6)


def products(rate: Array) -> Array:
    """(..., 6) s of rates (..., 3)."""
    own = rate.transpose(-1, *range(rate.ndim - 1))
    found = np.empty((6, *own.shape[1:]))
    np.multiply(own, own[0], out=found[:3])
    np.multiply(own[1:], own[1], out=found[3:5])
    np.multiply(own[2], own[2], out=found[5])
    return found.transpose(*range(1, rate.ndim), 0)


def products_by_rate(rate: Array) -> Array:
    """(..., 6, 3) derivative of the products of rates (..., 3)."""
    found = np.zeros((*rate.shape[:-1], 6, 3))
    for k, (i, j) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        found[..., k, i] += rate[..., j]
        found[..., k, j] += rate[..., i]
    return found


def products_turned(turn: Array) -> Array:
    """(..., 6, 6) matrix of the products of ``turn @ ω`` in those of ω."""
    (i, k), (j, m) = (np.meshgrid(own, own, indexing="ij") for own in (ROWS, COLUMNS))
    return np.asarray(turn[..., i, k] * turn[..., j, m] + (k != m) * turn[..., i, m] * turn[..., j, k])


def centripetal(arm: Array) -> Array:
    """(..., 3, 6) matrix that takes the products of rates to ``ω × (ω × arm)``, of arms (..., 3)."""
    found = np.zeros((*arm.shape, 6))
    for k, (i, j) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        found[..., i, k] += arm[..., j]
        if i != j:
            found[..., j, k] += arm[..., i]
        else:
            found[..., :, k] -= arm
    return found
