"""Gyroscopic torque ω × I ω = Γ(I) s, linear in I and in the rate products s = (ωx ωx, ωx ωy, ωx ωz, ωy ωy, ωy ωz, ωz ωz)."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import COLUMNS, ROWS, cross_matrix


def _gyroscopic() -> Array:
    """(9, 18) the linear map from I to Γ(I)."""
    gamma_of_unit = np.zeros((3, 6, 3, 3))
    cross_unit = cross_matrix(np.eye(3))  # cross_unit[i] = [e_i]×
    for k, (i, j) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        gamma_of_unit[:, k, :, j] += cross_unit[i]
        if i != j:
            gamma_of_unit[:, k, :, i] += cross_unit[j]
    return gamma_of_unit.reshape(18, 9).T


_GAMMA = _gyroscopic()


def gamma(inertia: Array) -> Array:
    """Γ(I), (..., 3, 6), of inertia tensors (..., 3, 3): ``Γ(I) s = ω × I ω``."""
    return (inertia.reshape(*inertia.shape[:-2], 9) @ _GAMMA).reshape(*inertia.shape[:-2], 3, 6)


def products(rate: Array) -> Array:
    """(..., 6) rate products s of rates (..., 3)."""
    components = rate.transpose(-1, *range(rate.ndim - 1))
    result = np.empty((6, *components.shape[1:]))
    np.multiply(components, components[0], out=result[:3])
    np.multiply(components[1:], components[1], out=result[3:5])
    np.multiply(components[2], components[2], out=result[5])
    return result.transpose(*range(1, rate.ndim), 0)


def products_by_rate(rate: Array) -> Array:
    """(..., 6, 3) derivative of the rate products with respect to the rates (..., 3)."""
    slope = np.zeros((*rate.shape[:-1], 6, 3))
    for k, (i, j) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        slope[..., k, i] += rate[..., j]
        slope[..., k, j] += rate[..., i]
    return slope


def products_turned(turn: Array) -> Array:
    """(..., 6, 6) matrix that maps the rate products of ω to those of ``turn @ ω``."""
    (i, k), (j, m) = (np.meshgrid(index, index, indexing="ij") for index in (ROWS, COLUMNS))
    return np.asarray(turn[..., i, k] * turn[..., j, m] + (k != m) * turn[..., i, m] * turn[..., j, k])


def centripetal(arm: Array) -> Array:
    """(..., 3, 6) matrix C with ``C s = ω × (ω × arm)``, of arms (..., 3)."""
    matrix = np.zeros((*arm.shape, 6))
    for k, (i, j) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        matrix[..., i, k] += arm[..., j]
        if i != j:
            matrix[..., j, k] += arm[..., i]
        else:
            matrix[..., :, k] -= arm
    return matrix
