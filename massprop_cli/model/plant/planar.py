"""A body on a table, which slides and yaws."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.model.plant.free import FreeBody
from massprop_cli.model.plant.plant import MOMENT, MU, J, Reference

OBSERVABLE = np.isin(np.arange(10), [5, 6, 7, 9])
"""(10,) of θ: J_zz, c_x, c_y, mu."""


@dataclass(frozen=True)
class PlanarBody(FreeBody):
    """A body that moves along x and y and yaws; the table's reaction takes up everything else.

    I_zz ω̇_z = τ_z − (c × F)_z
    f_xy = (mu F + ω̇ × ρ + ω × (ω × ρ))_xy + n,   ρ = r − c,   ṅ = −ω × n

    Commands have no part along the other axes (:mod:`massprop_cli.prepare.actuators`), and the specific force has no weight along Z
    (:mod:`massprop_cli.prepare.compensate`). n is the specific force by the table's slope, constant in the world: two states. It is zero
    for a body that slides without friction, and gravity times the slope for one whose support is vertical.

    The motion does not depend on the other parameters. They have the values of a flat body, I_xx = I_yy = I_zz / 2 without products, so
    that the natural sizes are sensible.
    """

    slope_sigma: float
    """Prior sigma of each component of n, m/s²."""

    @property
    def observable(self) -> BoolArray:
        """(10,) J_zz, c_x, c_y and mu."""
        return OBSERVABLE

    @property
    def tilt_sigma(self) -> float:
        """Prior sigma of each component of n, m/s²."""
        return self.slope_sigma

    def jet_moment(self, reference: Reference) -> Array:
        """(3, 6) matrix that maps a wrench about O to the moment about the CG, along Z alone."""
        return np.diag([0.0, 0.0, 1.0]) @ super().jet_moment(reference)

    @property
    def tilt_count(self) -> int:
        """Two, n_x and n_y in the middle of a cycle, body axes; none if the slope is known to be zero."""
        return 2 if self.slope_sigma > 0 else 0

    def tilt_step(self, rate: Array, duration: Array) -> tuple[Array, Array]:
        """Rotation of n in body axes; the effect of a rate error is neglected."""
        turn = rate[:, 2] * duration
        angle = (turn[:-1] + turn[1:]) / 2
        back = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return np.moveaxis(back, -1, 0), np.zeros((len(angle), 2, 3))

    def tilt_in_cycle(self, rate: Array, duration: Array) -> tuple[Array, Array, Array]:  # noqa: ARG002
        """Identity: the states are the values in the middle of the cycle."""
        same = np.broadcast_to(np.eye(2), (len(rate), 2, 2))
        return same, same, same

    def force_by_tilt(self, _: Reference, up: Array, force: Array) -> Array:  # noqa: ARG002
        """(K, 3, 2) identity: n itself is the mean over the cycle."""
        return np.broadcast_to(np.eye(3, 2), (*up.shape, 2))

    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference."""
        inverse = 1 / reference.inertia[2, 2]
        x, y, _ = reference.cg
        return np.array([2 * inverse, 0.0, 0.0, 2 * inverse, 0.0, inverse, x, y, 0.0, reference.mu])

    def inverse_inertia(self, theta: Array) -> Array:
        """(3, 3) J_zz alone; the other elements are zero."""
        return np.diag([0.0, 0.0, theta[J][5]])

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(40,) φ and (40, 10) its derivative: those of a free body, but only elements that depend on the observable parameters."""
        inverse, (x, y, _), mu = theta[J][5], theta[MOMENT], theta[MU]
        phi, slopes = np.zeros(3 * self.channels + 4), np.zeros((3 * self.channels + 4, 10))
        yaw = phi[2 * self.channels : 3 * self.channels], slopes[2 * self.channels : 3 * self.channels]
        # (c × F)_z = x F_y − y F_x
        yaw[0][2:5] = inverse, inverse * y, -inverse * x
        yaw[1][2:5, 5] = 1.0, y, -x
        yaw[1][3, 7], yaw[1][4, 6] = inverse, -inverse
        phi[-4:-1] = mu, x, y
        slopes[-4:-1, [9, 6, 7]] = np.eye(3)
        return phi, slopes

    def regressor(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:
        """(K, 6, 10) derivative of the torque about Z and the specific force along the table."""
        yaw = np.array([0.0, 0.0, 1.0])
        rows = super().regressor(reference, rate * yaw, rate_dot * yaw, force, up)
        rows[:, [0, 1, 5]] = 0.0
        return rows
