"""Rigid-body equations of motion and their regressors, which are linear in the mass properties.

All functions are vectorised: vectors have shape (..., 3). Inertia is about the CG in body axes, as a tensor (3, 3) or as its six elements
ixx ixy ixz iyy iyz izz.
"""

import numpy as np

from massprop_cli.base.arrays import Array

ROWS, COLUMNS = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])
"""Row and column of the six elements in the tensor."""
MOMENTS = [0, 3, 5]
"""Indices of the moments of inertia among the six elements."""


def tensor(elements: Array) -> Array:
    """Symmetric tensors (..., 3, 3) from elements (..., 6)."""
    full = np.empty((*elements.shape[:-1], 3, 3))
    full[..., ROWS, COLUMNS] = elements
    full[..., COLUMNS, ROWS] = elements
    return full


def elements(inertia: Array) -> Array:
    """Elements (..., 6) of symmetric tensors (..., 3, 3)."""
    return inertia[..., ROWS, COLUMNS]


def cross_matrix(v: Array) -> Array:
    """Cross-product matrices [v]× (..., 3, 3): ``[v]× u = v × u``."""
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return matrix


def cross(a: Array, b: Array) -> Array:
    """Cross products of vectors (..., 3); numpy's takes several times as long for few vectors."""
    found = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return found


def inverse(matrix: Array) -> Array:
    """Inverses of well-conditioned matrices (K, 3, 3), by cofactors; numpy's takes several times as long."""
    cofactors = cross(matrix[:, [1, 2, 0]], matrix[:, [2, 0, 1]])
    determinant = np.einsum("ki,ki->k", matrix[:, 0], cofactors[:, 0])
    return np.asarray(cofactors.transpose(0, 2, 1) / determinant[:, None, None])


def rotation(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad (Rodrigues' formula)."""
    angle = np.sqrt((vector**2).sum(-1))[..., None, None]
    turn = cross_matrix(vector)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * turn + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (turn @ turn))


def mean_rotation(vector: Array) -> Array:
    """Mean rotation matrices (..., 3, 3): the integral over s from 0 to 1 of :func:`rotation` of s times the vectors (..., 3), rad."""
    square = (vector**2).sum(-1)[..., None, None]
    turn = cross_matrix(vector)
    angle = np.sqrt(square)
    # (θ − sin θ) / θ³, by its series for small θ
    cubic = np.where(square > 0.01, (1 - np.sinc(angle / np.pi)) / np.maximum(square, 0.01), (1 - square / 20 * (1 - square / 42)) / 6)
    return np.asarray(np.eye(3) + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * turn + cubic * (turn @ turn))


def spread(arm: Array) -> Array:
    """S(d) = ``d·d 1 − d dᵀ``, (..., 3, 3) m², of arms d (..., 3)."""
    return np.asarray((arm**2).sum(-1)[..., None, None] * np.eye(3) - arm[..., :, None] * arm[..., None, :])


def spread_by_arm(arm: Array) -> Array:
    """(..., 6, 3) derivative of the elements of S."""
    outer = np.eye(3)[:, :, None] * arm[..., None, None, :]
    change = 2 * arm[..., :, None, None] * np.eye(3) - outer - np.swapaxes(outer, -1, -2)
    return np.swapaxes(elements(change), -1, -2)


def parallel_axis(mass: float, offset: Array) -> Array:
    """Parallel-axis term ``m S(d)``, (3, 3) kg m², of the inertia about a point d = ``offset`` (3,) m from the CG."""
    return mass * spread(offset)


def inertia_regressor(v: Array) -> Array:
    """Inertia regressors L(v) (..., 3, 6): ``L(v) @ elements(I) = I v``."""
    matrix = np.zeros((*v.shape, 6))
    for row, columns in enumerate(((0, 1, 2), (1, 3, 4), (2, 4, 5))):
        for axis, column in enumerate(columns):
            matrix[..., row, column] = v[..., axis]
    return matrix


def times(matrix: Array, v: Array) -> Array:
    """Products ``matrix @ v`` of stacks; the order of summation does not depend on the size of the stack."""
    return np.asarray(np.einsum("...ij,...j->...i", matrix, v))


def angular_acceleration(inertia: Array, cg: Array, rate: Array, torque: Array, force: Array) -> Array:
    """Angular acceleration ω̇ of a free body, rad/s²: ``I ω̇ = τ − c × F − ω × I ω`` (thesis eq. 2.3).

    ``torque`` [N m] about O and ``force`` [N] act at O; ``cg`` [m] from O; ``rate`` [rad/s]; all (..., 3), body axes.
    """
    moment = torque - cross(cg, force) - cross(rate, times(inertia, rate))
    return times(np.linalg.inv(inertia), moment)


def lever_arm(rate: Array, rate_dot: Array, arm: Array) -> Array:
    """Euler and centripetal acceleration ``ω̇ × ρ + ω × (ω × ρ)``, m/s², of a point at ``arm`` ρ [m]."""
    return cross(rate_dot, arm) + cross(rate, cross(rate, arm))


def torque_regressor(rate: Array, rate_dot: Array, force: Array) -> Array:
    """Torque regressor H1 (..., 3, 9): ``H1 @ (ixx … izz, cg_x, cg_y, cg_z) = I ω̇ + ω × I ω + c × F = τ`` (thesis eq. 4.5–4.7)."""
    inertia = inertia_regressor(rate_dot) + cross_matrix(rate) @ inertia_regressor(rate)
    return np.concatenate([inertia, -cross_matrix(force)], axis=-1)
