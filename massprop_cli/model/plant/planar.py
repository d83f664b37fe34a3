"""A body on a table: it slides and yaws."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.model.plant.free import FreeBody
from massprop_cli.model.plant.plant import MOMENT, MU, J, Reference

TOLD = np.isin(np.arange(10), [5, 6, 7, 9])
"""Of θ: J_zz, c_x, c_y, mu."""


@dataclass(frozen=True)
class PlanarBody(FreeBody):
    """A free body but for what the table takes up: its motion has x, y and yaw alone.

    I_zz ω̇_z = τ_z − (c × F)_z
    f_xy = (mu F + ω̇ × ρ + ω × (ω × ρ))_xy + n,   ρ = r − c,   ṅ = −ω × n

    The table's reaction is whatever keeps the body on it, so commands are taken without what they do beside these three
    (:mod:`massprop_cli.prepare.actuators`), and the accelerometer without the weight along Z (:mod:`massprop_cli.prepare.compensate`). n
    stands still in the world: it is what something holds of the weight's pull along a sloping table (two states). A body that slides on it
    without friction feels none of it; one whose support pulls straight up feels all of it, gravity times the slope.

    The other parameters enter nothing. They are put where a flat body has them, I_xx = I_yy = I_zz / 2 and no products, so that the sizes
    that a body has by nature are sensible.
    """

    slope_sigma: float
    """One sigma of each component of n, m/s²."""

    @property
    def told(self) -> BoolArray:
        """J_zz, c_x, c_y and mu."""
        return TOLD

    @property
    def tilt_sigma(self) -> float:
        """That of n."""
        return self.slope_sigma

    def jet_moment(self, reference: Reference) -> Array:
        """(3, 6) wrench to moment about the CG, Z alone."""
        return np.diag([0.0, 0.0, 1.0]) @ super().jet_moment(reference)

    @property
    def tilts(self) -> int:
        """n_x and n_y in the middle of a cycle, body axes."""
        return 2 if self.slope_sigma > 0 else 0

    def tilt_step(self, rate: Array, duration: Array) -> tuple[Array, Array]:
        """The body turns under n; an error of the rate is small beside it."""
        turn = rate[:, 2] * duration
        angle = (turn[:-1] + turn[1:]) / 2
        back = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return np.moveaxis(back, -1, 0), np.zeros((len(angle), 2, 3))

    def tilt_within(self, rate: Array, duration: Array) -> tuple[Array, Array, Array]:  # noqa: ARG002
        """They stand for the middle of a cycle."""
        same = np.broadcast_to(np.eye(2), (len(rate), 2, 2))
        return same, same, same

    def force_by_tilt(self, _: Reference, up: Array, force: Array) -> Array:  # noqa: ARG002
        """N itself, in the mean over a cycle."""
        return np.broadcast_to(np.eye(3, 2), (*up.shape, 2))

    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference."""
        turning = 1 / reference.inertia[2, 2]
        x, y, _ = reference.cg
        return np.array([2 * turning, 0.0, 0.0, 2 * turning, 0.0, turning, x, y, 0.0, reference.mu])

    def turning(self, theta: Array) -> Array:
        """(3, 3) J_zz alone."""
        return np.diag([0.0, 0.0, theta[J][5]])

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(40,) φ, and (40, 10) its derivative: those of a free body in what is told."""
        turning, (x, y, _), mu = theta[J][5], theta[MOMENT], theta[MU]
        phi, slopes = np.zeros(3 * self.channels + 4), np.zeros((3 * self.channels + 4, 10))
        yaw = phi[2 * self.channels : 3 * self.channels], slopes[2 * self.channels : 3 * self.channels]
        # (c × F)_z = x F_y − y F_x
        yaw[0][2:5] = turning, turning * y, -turning * x
        yaw[1][2:5, 5] = 1.0, y, -x
        yaw[1][3, 7], yaw[1][4, 6] = turning, -turning
        phi[-4:-1] = mu, x, y
        slopes[-4:-1, [9, 6, 7]] = np.eye(3)
        return phi, slopes

    def shown(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:
        """(K, 6, 10) what torque about Z and specific force along the table tell of the parameters."""
        yaw = np.array([0.0, 0.0, 1.0])
        rows = super().shown(reference, rate * yaw, rate_dot * yaw, force, up)
        rows[:, [0, 1, 5]] = 0.0
        return rows
