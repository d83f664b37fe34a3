"""A body in free flight."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross, cross_matrix, elements, inertia_regressor, tensor, times
from massprop_cli.model.gyroscopic import gamma
from massprop_cli.model.plant.plant import MOMENT, MU, UNIT, Felt, J, Motion, Plant, Reference, Turning

TURN = cross_matrix(np.eye(3))
"""Derivatives of [v]× by the elements of v."""


@dataclass(frozen=True)
class FreeBody(Plant):
    """``moment = τ − c × F``; the specific force of the CG is ``F/m`` (thesis eq. 2.3, 4.13).

    θ = (I⁻¹, c, mu):

    w[k+1] − w[k] = J l − J [c]× p − J Γ(I) q
    f = mu F + ω̇ × ρ + ω × (ω × ρ),   ρ = r − c

    (l, p, q: torque, force and products under the triangular window of :mod:`massprop_cli.prepare.align`.)
    """

    channels = 12
    force = slice(3, 6)
    pivoted = False
    translates = True

    def jet_moment(self, reference: Reference) -> Array:
        """(3, 6) wrench to moment about the CG."""
        return np.hstack([np.eye(3), -cross_matrix(reference.cg)])

    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference."""
        return np.concatenate([elements(np.linalg.inv(reference.inertia)), reference.cg, [reference.mu]])

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(40,) φ = (Φ, mu, c), Φ = [J | −J [c]× | −J Γ(I)], and (40, 10) its derivative."""
        phi, slopes = by_lever(theta)
        slopes[-3:, MOMENT] = np.eye(3)
        return np.concatenate([phi, theta[MOMENT]]), slopes

    def felt(self, reference: Reference, motion: Motion, turning: Turning, position: Array) -> Felt:  # noqa: ARG002
        """Products of ω̇ with c are split about the reference."""
        euler = np.broadcast_to(-cross_matrix(position - reference.cg), turning.rotation.shape)
        own = np.empty((len(turning.whole), 3, 4))
        own[..., 0], own[..., 1:] = turning.whole[:, self.force], -turning.rotation
        offset = times(turning.centripetal, position) + cross(turning.rate_dot, reference.cg)
        return Felt(euler, own, offset)

    def shown(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:  # noqa: ARG002
        """(K, 6, 10) what torque and specific force tell of the parameters."""
        rows = turned_rows(rate, rate_dot)
        rows[:, :3, 6:9] = -cross_matrix(force)
        rows[:, 3:, 9] = force
        rows[:, 3:, 6:9] = -(cross_matrix(rate_dot) + cross_matrix(rate) @ cross_matrix(rate))
        return rows


def by_lever(theta: Array, pull: float = 1.0) -> tuple[Array, Array]:
    """(37,) [J | −p J [κ]× | −J Γ(I)] by rows, and mu, of θ = (J, κ, mu); (40, 10) their derivative, zeros in its last three rows.

    κ is what something pulls by ``pull`` p: the CG's place where a force does, the first moment where gravity does.
    """
    inverse, turn = tensor(theta[J]), pull * cross_matrix(theta[MOMENT])
    gyro, gyro_by_inverse = coupling(inverse)
    slopes = np.zeros((10, 40))
    rows = slopes[:, :36].reshape(10, 3, 12)
    rows[J, :, :3], rows[J, :, -6:] = UNIT, -gyro_by_inverse
    rows[J, :, 3:6], rows[MOMENT, :, 3:6] = -(UNIT @ turn), -pull * (inverse @ TURN)
    slopes[MU, 36] = 1.0
    return np.append(np.hstack([inverse, -(inverse @ turn), -gyro]).ravel(), theta[MU]), slopes.T


def coupling(inverse: Array) -> tuple[Array, Array]:
    """(3, 6) J Γ(I) of J, and (6, 3, 6) its derivative by J's elements."""
    inertia = np.linalg.inv(inverse)
    about = gamma(inertia)
    return inverse @ about, UNIT @ about + inverse @ gamma(-inertia @ UNIT @ inertia)


def turned_rows(rate: Array, rate_dot: Array) -> Array:
    """(K, 6, 10) rows that say what the torque of K motions tells of the inertia, and nothing else yet."""
    rows = np.zeros((len(rate), 6, 10))
    rows[:, :3, :6] = inertia_regressor(rate_dot) + cross_matrix(rate) @ inertia_regressor(rate)
    return rows
