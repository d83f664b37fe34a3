"""A body in free flight."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross, cross_matrix, elements, inertia_regressor, tensor, times
from massprop_cli.model.gyroscopic import gamma
from massprop_cli.model.plant.plant import MOMENT, MU, UNIT_TENSORS, J, MeanMotion, Motion, Plant, Reference, SpecificForce

UNIT_CROSS = cross_matrix(np.eye(3))
"""(3, 3, 3) derivatives of [v]× with respect to the elements of v."""


@dataclass(frozen=True)
class FreeBody(Plant):
    """A body in free flight: ``moment = τ − c × F`` about the CG, specific force of the CG ``F/m`` (thesis eq. 2.3, 4.13).

    θ = (I⁻¹, c, mu):

    w[k+1] − w[k] = J l − J [c]× p − J Γ(I) q
    f = mu F + ω̇ × ρ + ω × (ω × ρ),   ρ = r − c

    l, p and q are torque, force and rate products under the triangular window of :mod:`massprop_cli.prepare.align`.
    """

    channels = 12
    force = slice(3, 6)
    pivoted = False
    translates = True

    def jet_moment(self, reference: Reference) -> Array:
        """(3, 6) matrix that maps a wrench about O to the moment about the CG."""
        return np.hstack([np.eye(3), -cross_matrix(reference.cg)])

    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference."""
        return np.concatenate([elements(np.linalg.inv(reference.inertia)), reference.cg, [reference.mu]])

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(40,) φ = (Φ, mu, c) with Φ = [J | −J [c]× | −J Γ(I)], and (40, 10) its derivative."""
        phi, slopes = lever_coefficients(theta)
        slopes[-3:, MOMENT] = np.eye(3)
        return np.concatenate([phi, theta[MOMENT]]), slopes

    def specific_force(self, reference: Reference, motion: Motion, mean: MeanMotion, position: Array) -> SpecificForce:  # noqa: ARG002
        """Mean specific force; products of ω̇ and c are linearised about the reference."""
        by_rate_dot = np.broadcast_to(-cross_matrix(position - reference.cg), mean.rotation.shape)
        by_phi = np.empty((len(mean.whole), 3, 4))
        by_phi[..., 0], by_phi[..., 1:] = mean.whole[:, self.force], -mean.rotation
        offset = times(mean.centripetal, position) + cross(mean.rate_dot, reference.cg)
        return SpecificForce(by_rate_dot, by_phi, offset)

    def regressor(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:  # noqa: ARG002
        """(K, 6, 10) derivative of torque and specific force with respect to inertia, CG and mu."""
        rows = inertia_rows(rate, rate_dot)
        rows[:, :3, 6:9] = -cross_matrix(force)
        rows[:, 3:, 9] = force
        rows[:, 3:, 6:9] = -(cross_matrix(rate_dot) + cross_matrix(rate) @ cross_matrix(rate))
        return rows


def lever_coefficients(theta: Array, pull: float = 1.0) -> tuple[Array, Array]:
    """(37,) first coefficients, [J | −p J [κ]× | −J Γ(I)] by rows and mu, and (40, 10) their derivative, of θ = (J, κ, mu).

    κ is the lever of a force (the CG's position, ``pull`` p = 1) or of the weight (the first moment, p = gravity). The last three rows of
    the derivative are zero.
    """
    inverse, lever = tensor(theta[J]), pull * cross_matrix(theta[MOMENT])
    gyro, gyro_by_inverse = coupling(inverse)
    slopes = np.zeros((10, 40))
    rows = slopes[:, :36].reshape(10, 3, 12)
    rows[J, :, :3], rows[J, :, -6:] = UNIT_TENSORS, -gyro_by_inverse
    rows[J, :, 3:6], rows[MOMENT, :, 3:6] = -(UNIT_TENSORS @ lever), -pull * (inverse @ UNIT_CROSS)
    slopes[MU, 36] = 1.0
    return np.append(np.hstack([inverse, -(inverse @ lever), -gyro]).ravel(), theta[MU]), slopes.T


def coupling(inverse: Array) -> tuple[Array, Array]:
    """(3, 6) J Γ(I), and (6, 3, 6) its derivative with respect to the elements of J (3, 3)."""
    inertia = np.linalg.inv(inverse)
    gyroscopic = gamma(inertia)
    return inverse @ gyroscopic, UNIT_TENSORS @ gyroscopic + inverse @ gamma(-inertia @ UNIT_TENSORS @ inertia)


def inertia_rows(rate: Array, rate_dot: Array) -> Array:
    """(K, 6, 10) derivative of the torque of K motions with respect to the inertia; all other elements are zero."""
    rows = np.zeros((len(rate), 6, 10))
    rows[:, :3, :6] = inertia_regressor(rate_dot) + cross_matrix(rate) @ inertia_regressor(rate)
    return rows
