"""A body on an air bearing."""

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import (
    cross,
    cross_matrix,
    elements,
    lever_arm,
    mean_rotation,
    parallel_axis,
    rotation,
    spread,
    spread_by_arm,
    tensor,
    times,
)
from massprop_cli.model.plant.free import UNIT_CROSS, coupling, inertia_rows
from massprop_cli.model.plant.plant import MOMENT, MU, UNIT_TENSORS, J, MeanMotion, Motion, Plant, Reference, SpecificForce


@dataclass(frozen=True)
class BearingBody(Plant):
    """A body that rotates about a bearing b, whose base slides on a horizontal plane.

    The bearing's reaction keeps b level. All forces but gravity on the rotating mass m_r sum to m_r f, with f the specific force of the CG.
    So the moment about the CG is ``τ − b × F − m_r (c − b) × f``. The bearing point accelerates horizontally only, ``a = P (F − m_r (ω̇ × s
    + ω × (ω × s))) / m``, with s = c − b, P the projector on the plane, m = m_r + bearing mass.

    θ = (I_b⁻¹, κ, mu), with I_b the inertia about b, κ = m_r s the first moment, u the vertical:

    w[k+1] − w[k] = J l − g J [κ]× ∬u − mu J [κ]× ∬P F − J Γ(I_b) q + J (mu κ × ∬P (ω̇ × κ + …))
    f = g u + P (mu F − mu (ω̇ × κ + …)) + ω̇ × ρ + …,   ρ = r − b

    l and q are torque about b and rate products under the triangular window; ∬ is the integral under that window.
    """

    bearing: Array
    """(3,) b from O, m."""
    bearing_mass: float
    """kg"""
    gravity: float
    """m/s²"""
    channels = 15
    force = slice(6, 9)
    pivoted = True
    translates = True

    @property
    def pivot(self) -> Array:
        """(3,) position of the bearing from O, m."""
        return self.bearing

    def jet_moment(self, _: Reference) -> Array:
        """(3, 6) matrix that maps a wrench about O to the moment about the bearing."""
        return np.hstack([np.eye(3), -cross_matrix(self.bearing)])

    def rotating_mass(self, reference: Reference) -> float:
        """m_r, kg; at least a hundredth of the total mass, so that a poor reference stays a rigid body."""
        return max(1 / reference.mu - self.bearing_mass, 0.01 / reference.mu)

    @property
    def tilt_count(self) -> int:
        """Three: true attitude = propagated attitude turned by this rotation vector."""
        return 3

    def tilt_step(self, rate: Array, duration: Array) -> tuple[Array, Array]:
        """Transition of the attitude error φ: measured rates propagate the attitude, the vehicle rotates with the true rate.

        ``φ[k+1] = R(−θ) φ[k] + J(θ) T δω``, θ = ω T, with J the mean of the rotations R(−θ s), 0 < s < 1.
        """
        turn = rate[:-1] * duration[:-1, None]
        return rotation(-turn), mean_rotation(-turn) * duration[:-1, None, None]

    def tilt_in_cycle(self, rate: Array, duration: Array) -> tuple[Array, Array, Array]:
        """R(−θ s) to first order, with s = 2/3, 1/3 and 1/2: the vehicle rotates within the cycle."""
        turn = cross_matrix(rate * duration[:, None])
        rising, falling, whole = (np.eye(3) - part * turn for part in (2 / 3, 1 / 3, 1 / 2))
        return rising, falling, whole

    def force_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:
        """(K, 3, 3) derivative of the specific force at the bearing, g u + mu (F − (F · u) u), with respect to the attitude error φ.

        φ turns the vertical u into ``u + u × φ``.
        """
        size = np.sqrt((up**2).sum(-1))[:, None]
        unit = up / np.maximum(size, TINY)
        along = (force * unit).sum(-1)
        level: Array = unit[:, :, None] * cross(force, unit)[:, None, :] + along[:, None, None] * cross_matrix(unit)
        return self.gravity * cross_matrix(up) - reference.mu * level

    def moment_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:
        """(K, 3, 3) derivative of the moment about the bearing with respect to the attitude error."""
        offset = cross_matrix(reference.cg - self.bearing)
        return -self.rotating_mass(reference) * offset @ self.force_by_tilt(reference, up, force)

    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference."""
        rotating = self.rotating_mass(reference)
        offset = reference.cg - self.bearing
        inertia = reference.inertia + parallel_axis(rotating, offset)
        moment = rotating * offset
        return np.concatenate([elements(np.linalg.inv(inertia)), moment, [reference.mu]])

    def parameters(self, theta: Array) -> Array:
        """(..., 10) state parameters of θ (..., 10)."""
        inertia = np.linalg.inv(tensor(theta[..., J]))
        values = theta.copy()
        rotating = self._rotating(theta)[..., None]
        offset = theta[..., MOMENT] / rotating
        values[..., J] = elements(inertia - rotating[..., None] * spread(offset))
        values[..., MOMENT] = self.bearing + offset
        return values

    def slopes(self, theta: Array) -> Array:
        """(..., 10, 10) derivative of I = I_b − (κ² 1 − κ κᵀ) / m_r, c = b + κ / m_r and mu; dm_r = −dmu / mu²."""
        slopes = super().slopes(theta)
        kappa, rotating = theta[..., MOMENT], self._rotating(theta)[..., None]
        slopes[..., :6, MOMENT] = -spread_by_arm(kappa) / rotating[..., None]
        by_mass = -1 / theta[..., MU, None] ** 2 / rotating**2
        slopes[..., :6, MU] = elements(spread(kappa)) * by_mass
        slopes[..., 6:9, MOMENT] = np.eye(3) / rotating[..., None]
        slopes[..., 6:9, MU] = -kappa * by_mass
        return slopes

    def parallel_axis_trace(self, theta: Array) -> float:
        """Trace of I_b − I, kg m²."""
        return float(2 * theta[MOMENT] @ theta[MOMENT] / float(self._rotating(theta)))

    def moment_per_metre(self, theta: Array) -> Array:
        """(...,) m_r."""
        return self._rotating(theta)

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(49,) φ = (Φ, mu, mu κ), Φ = [J | −g J [κ]× | −mu J [κ]× | −J Γ(I_b)], and (49, 10) its derivative."""
        inverse, moment, mu, gravity = tensor(theta[J]), theta[MOMENT], theta[MU], self.gravity
        turn = cross_matrix(moment)
        gyro, gyro_by_inverse = coupling(inverse)
        lever, by_inverse, by_moment = inverse @ turn, UNIT_TENSORS @ turn, inverse @ UNIT_CROSS
        slopes = np.zeros((10, 3 * self.channels + 4))
        rows = slopes[:, : 3 * self.channels].reshape(10, 3, self.channels)
        rows[J, :, :3], rows[J, :, -6:] = UNIT_TENSORS, -gyro_by_inverse
        rows[J, :, 3:6], rows[J, :, 6:9] = -gravity * by_inverse, -mu * by_inverse
        rows[MOMENT, :, 3:6], rows[MOMENT, :, 6:9] = -gravity * by_moment, -mu * by_moment
        rows[MU, :, 6:9], slopes[MU, -3:] = -lever, moment
        slopes[MU, -4] = 1.0
        slopes[MOMENT, -3:] = float(mu) * np.eye(3)
        phi = np.hstack([inverse, -gravity * lever, -mu * lever, -gyro])
        return np.concatenate([phi.ravel(), [mu], float(mu) * moment]), slopes.T

    def command_input(self, wrench: Array) -> Array:
        """(..., 3) torque about the bearing."""
        return wrench[..., :3] - cross(self.bearing, wrench[..., 3:])

    def inputs(self, wrench: Array, up: Array, level_of: Array) -> Array:
        """(K, B, 9) torque about the bearing, vertical, level part of the force."""
        return np.concatenate([self.command_input(wrench), up, level(level_of, wrench[..., 3:])], -1)

    def attitude_inputs(self, motion: Motion, ups: tuple[Array, Array], skew: Array, late_s: Array) -> list[tuple[Array, Array]]:
        """The vertical and the level part of the force."""
        force = level(motion.up, motion.wrench[..., 3:]), level(motion.up, skew[..., 3:]).sum(1)
        return [(motion.up, (ups[1] - ups[0]) * late_s), force]

    def nonlinear_acceleration(self, theta: Array, motion: Motion) -> Array:
        """(K, B, 3) angular acceleration because the moving CG accelerates the base: second order in κ."""
        kappa = theta[MOMENT]
        moment = cross(kappa, level(motion.up, lever_arm(motion.rate, motion.rate_dot, kappa))) * theta[MU]
        return times(tensor(theta[J]), moment)

    def specific_force(self, reference: Reference, motion: Motion, mean: MeanMotion, position: Array) -> SpecificForce:
        """Mean specific force; products of ω̇ and mu κ are linearised about the reference."""
        theta = self.theta(reference)
        arm, moment_cross = position - self.bearing, cross_matrix(theta[MU] * theta[MOMENT])
        onto_level = np.eye(3) - np.einsum("kbi,kbj->kij", motion.up, motion.up) / motion.up.shape[1]
        by_rate_dot = onto_level @ moment_cross - cross_matrix(arm)
        by_phi = np.empty((len(mean.whole), 3, 4))
        by_phi[..., 0], by_phi[..., 1:] = mean.whole[:, self.force], -onto_level @ mean.rotation
        weight = self.gravity * mean.whole[:, 3:6]
        offset = weight + times(mean.centripetal, arm) - times(onto_level @ moment_cross, mean.rate_dot)
        return SpecificForce(by_rate_dot, by_phi, offset)

    def wrench_response(self, reference: Reference, wrench: Array, up: Array, position: Array) -> tuple[Array, Array]:
        """(K, 3, g) moment about the bearing and (K, 3, g) specific force; the level part of a force accelerates body and base."""
        theta = self.theta(reference)
        moment_cross = theta[MU] * cross_matrix(theta[MOMENT])
        onto_level = np.eye(3) - up[:, :, None] * up[:, None, :]
        level_force = onto_level @ wrench[:, 3:].T
        moment = self.command_input(wrench).T - moment_cross @ level_force
        rate_dot = self.inverse_inertia(theta) @ moment
        specific = theta[MU] * level_force + onto_level @ moment_cross @ rate_dot - cross_matrix(position - self.bearing) @ rate_dot
        return moment, specific

    def regressor(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:
        """(K, 6, 10) derivative of torque and specific force; the weight informs the CG, the lever arm ρ does not.

        A force accelerates the base, and so turns a body whose CG is off the bearing: that informs the mass weakly.
        """
        rows = inertia_rows(rate, rate_dot)
        rows[:, :3, 9] = cross(self.theta(reference)[MOMENT], level(up, force))
        rows[:, :3, 6:9] = -cross_matrix((self.gravity * up + force * reference.mu) / reference.mu)
        rows[:, 3:, 9] = force
        return rows

    def _rotating(self, theta: Array) -> Array:
        """(...,) m_r of θ (..., 10)."""
        mass = 1 / theta[..., MU]
        return np.maximum(mass - self.bearing_mass, 0.01 * mass)


def level(up: Array, v: Array) -> Array:
    """P v, the part of vectors ``v`` in the plane normal to the unit vectors ``up``."""
    return np.asarray(v - up * np.einsum("...i,...i->...", up, v)[..., None])
