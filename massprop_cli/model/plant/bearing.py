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
from massprop_cli.model.plant.free import TURN, coupling, turned_rows
from massprop_cli.model.plant.plant import MOMENT, MU, UNIT, Felt, J, Motion, Plant, Reference, Turning


@dataclass(frozen=True)
class BearingBody(Plant):
    """A body turning about a bearing b whose base slides on a horizontal plane.

    The bearing's reaction is whatever keeps b level: all forces but gravity on the rotating mass m_r sum to m_r f, f the specific
    force of the CG, so the moment about the CG is ``τ − b × F − m_r (c − b) × f``. The bearing point accelerates horizontally only,
    ``a = P (F − m_r (ω̇ × s + ω × (ω × s))) / m``, s = c − b, P the projector on the plane; m = m_r + bearing mass. θ = (I_b⁻¹, κ, mu),
    I_b the inertia about b, κ = m_r s the first moment, u the vertical:

    w[k+1] − w[k] = J l − g J [κ]× ∬u − mu J [κ]× ∬P F − J Γ(I_b) q + J (mu κ × ∬P (ω̇ × κ + …))
    f = g u + P (mu F − mu (ω̇ × κ + …)) + ω̇ × ρ + …,   ρ = r − b

    (l, q: torque about b and products under the triangular window, ∬ of what else is under it.)
    """

    bearing: Array
    bearing_mass: float
    gravity: float
    channels = 15
    force = slice(6, 9)
    pivoted = True
    translates = True

    @property
    def pivot(self) -> Array:
        """The bearing."""
        return self.bearing

    def jet_moment(self, _: Reference) -> Array:
        """(3, 6) wrench to moment about the bearing."""
        return np.hstack([np.eye(3), -cross_matrix(self.bearing)])

    def rotating_mass(self, reference: Reference) -> float:
        """m_r, kg; not below a hundredth of the whole, so that a poor reference stays a body."""
        return max(1 / reference.mu - self.bearing_mass, 0.01 / reference.mu)

    @property
    def tilts(self) -> int:
        """Three: true attitude = carried attitude turned by their rotation vector."""
        return 3

    def tilt_step(self, rate: Array, duration: Array) -> tuple[Array, Array]:
        """The attitude is carried on with the measured rate, the vehicle turns with the true one.

        ``φ[k+1] = R(−θ) φ[k] + J(θ) T δω``, θ = ω T, with J the mean of the rotations R(−θ s), 0 < s < 1, of an error's frame.
        """
        turn = rate[:-1] * duration[:-1, None]
        return rotation(-turn), mean_rotation(-turn) * duration[:-1, None, None]

    def tilt_within(self, rate: Array, duration: Array) -> tuple[Array, Array, Array]:
        """The vehicle turns under the error: R(−θ s) to the first order, s = 2/3, 1/3 and 1/2."""
        turn = cross_matrix(rate * duration[:, None])
        rising, falling, whole = (np.eye(3) - part * turn for part in (2 / 3, 1 / 3, 1 / 2))
        return rising, falling, whole

    def force_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:
        """(K, 3, 3) of the specific force at the bearing by an error φ, which turns the vertical u into ``u + u × φ``.

        It is g u + μ (F − (F · u) u): the bearing is free to move on its table.
        """
        size = np.sqrt((up**2).sum(-1))[:, None]
        unit = up / np.maximum(size, TINY)
        along = (force * unit).sum(-1)
        level: Array = unit[:, :, None] * cross(force, unit)[:, None, :] + along[:, None, None] * cross_matrix(unit)
        return self.gravity * cross_matrix(up) - reference.mu * level

    def moment_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:
        """(K, 3, 3) of what that does to the body, which hangs on the bearing."""
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
        """(..., 10) the state's parameters of θ (..., 10)."""
        inertia = np.linalg.inv(tensor(theta[..., J]))
        found = theta.copy()
        rotating = self._rotating(theta)[..., None]
        offset = theta[..., MOMENT] / rotating
        found[..., J] = elements(inertia - rotating[..., None] * spread(offset))
        found[..., MOMENT] = self.bearing + offset
        return found

    def slopes(self, theta: Array) -> Array:
        """(..., 10, 10) their derivative: I = I_b − (κ² 1 − κ κᵀ) / m_r,  c = b + κ / m_r,  dm_r = −dmu / mu²."""
        found = super().slopes(theta)
        kappa, rotating = theta[..., MOMENT], self._rotating(theta)[..., None]
        found[..., :6, MOMENT] = -spread_by_arm(kappa) / rotating[..., None]
        by_mass = -1 / theta[..., MU, None] ** 2 / rotating**2
        found[..., :6, MU] = elements(spread(kappa)) * by_mass
        found[..., 6:9, MOMENT] = np.eye(3) / rotating[..., None]
        found[..., 6:9, MU] = -kappa * by_mass
        return found

    def trace_beyond(self, theta: Array) -> float:
        """That of κ about the bearing."""
        return float(2 * theta[MOMENT] @ theta[MOMENT] / float(self._rotating(theta)))

    def moment_over_cg(self, theta: Array) -> Array:
        """m_r."""
        return self._rotating(theta)

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(49,) φ = (Φ, mu, mu κ), Φ = [J | −g J [κ]× | −mu J [κ]× | −J Γ(I_b)], and (49, 10) its derivative."""
        inverse, moment, mu, gravity = tensor(theta[J]), theta[MOMENT], theta[MU], self.gravity
        turn = cross_matrix(moment)
        gyro, gyro_by_inverse = coupling(inverse)
        lever, by_inverse, by_moment = inverse @ turn, UNIT @ turn, inverse @ TURN
        slopes = np.zeros((10, 3 * self.channels + 4))
        rows = slopes[:, : 3 * self.channels].reshape(10, 3, self.channels)
        rows[J, :, :3], rows[J, :, -6:] = UNIT, -gyro_by_inverse
        rows[J, :, 3:6], rows[J, :, 6:9] = -gravity * by_inverse, -mu * by_inverse
        rows[MOMENT, :, 3:6], rows[MOMENT, :, 6:9] = -gravity * by_moment, -mu * by_moment
        rows[MU, :, 6:9], slopes[MU, -3:] = -lever, moment
        slopes[MU, -4] = 1.0
        slopes[MOMENT, -3:] = float(mu) * np.eye(3)
        phi = np.hstack([inverse, -gravity * lever, -mu * lever, -gyro])
        return np.concatenate([phi.ravel(), [mu], float(mu) * moment]), slopes.T

    def commanded(self, wrench: Array) -> Array:
        """(..., 3) the torque about the bearing."""
        return wrench[..., :3] - cross(self.bearing, wrench[..., 3:])

    def acting(self, wrench: Array, up: Array, level_of: Array) -> Array:
        """(K, B, 9) that torque, the vertical, the level part of the force."""
        return np.concatenate([self.commanded(wrench), up, level(level_of, wrench[..., 3:])], -1)

    def by_attitude(self, motion: Motion, ups: tuple[Array, Array], skew: Array, late_s: Array) -> list[tuple[Array, Array]]:
        """The vertical, and the level part of the force."""
        force = level(motion.up, motion.wrench[..., 3:]), level(motion.up, skew[..., 3:]).sum(1)
        return [(motion.up, (ups[1] - ups[0]) * late_s), force]

    def swing(self, theta: Array, motion: Motion) -> Array:
        """(K, B, 3) by the acceleration that the CG's own swing gives the base: second order in κ."""
        kappa = theta[MOMENT]
        swung = cross(kappa, level(motion.up, lever_arm(motion.rate, motion.rate_dot, kappa))) * theta[MU]
        return times(tensor(theta[J]), swung)

    def felt(self, reference: Reference, motion: Motion, turning: Turning, position: Array) -> Felt:
        """Products of ω̇ with mu κ are split about the reference."""
        theta = self.theta(reference)
        arm, along = position - self.bearing, cross_matrix(theta[MU] * theta[MOMENT])
        onto_level = np.eye(3) - np.einsum("kbi,kbj->kij", motion.up, motion.up) / motion.up.shape[1]
        euler = onto_level @ along - cross_matrix(arm)
        own = np.empty((len(turning.whole), 3, 4))
        own[..., 0], own[..., 1:] = turning.whole[:, self.force], -onto_level @ turning.rotation
        weight = self.gravity * turning.whole[:, 3:6]
        offset = weight + times(turning.centripetal, arm) - times(onto_level @ along, turning.rate_dot)
        return Felt(euler, own, offset)

    def pushed(self, reference: Reference, wrench: Array, up: Array, position: Array) -> tuple[Array, Array]:
        """(K, 3, g) moment about the bearing, and (K, 3, g) specific force: the level part of a push moves body and base."""
        theta = self.theta(reference)
        along = theta[MU] * cross_matrix(theta[MOMENT])
        onto_level = np.eye(3) - up[:, :, None] * up[:, None, :]
        pull = onto_level @ wrench[:, 3:].T
        moment = self.commanded(wrench).T - along @ pull
        turning = self.turning(theta) @ moment
        felt = theta[MU] * pull + onto_level @ along @ turning - cross_matrix(position - self.bearing) @ turning
        return moment, felt

    def shown(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:
        """(K, 6, 10) what torque and specific force tell of the parameters; the weight, not the lever arm, shows the CG.

        A push moves the base, and so turns a body whose CG is off the bearing: a little of that is the mass.
        """
        rows = turned_rows(rate, rate_dot)
        rows[:, :3, 9] = cross(self.theta(reference)[MOMENT], level(up, force))
        rows[:, :3, 6:9] = -cross_matrix((self.gravity * up + force * reference.mu) / reference.mu)
        rows[:, 3:, 9] = force
        return rows

    def _rotating(self, theta: Array) -> Array:
        """(...,) m_r of θ (..., 10)."""
        mass = 1 / theta[..., MU]
        return np.maximum(mass - self.bearing_mass, 0.01 * mass)


def level(up: Array, v: Array) -> Array:
    """The part of vectors that lies in the level plane, P v."""
    return np.asarray(v - up * np.einsum("...i,...i->...", up, v)[..., None])
