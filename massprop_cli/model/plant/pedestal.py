"""A body on a spherical bearing whose pedestal is fixed to the ground."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross_matrix, elements, times
from massprop_cli.model.plant.bearing import BearingBody
from massprop_cli.model.plant.free import inertia_rows, lever_coefficients
from massprop_cli.model.plant.plant import MOMENT, MU, MeanMotion, Motion, Plant, Reference, SpecificForce

OBSERVABLE: BoolArray = np.arange(10) != MU
"""(10,) of θ: all but mu."""


@dataclass(frozen=True)
class PedestalBody(BearingBody):
    """A body that rotates about a fixed pivot b under its weight.

    With I_p the inertia about the pivot, κ = m (c − b) the first moment about it, u the vertical and τ_p the torque about it:

    I_p ω̇ + ω × (I_p ω + h) = τ_p − g κ × u − ḣ
    f = g u + ω̇ × ρ + ω × (ω × ρ),   ρ = r − b

    w[k+1] − w[k] = J l − g J [κ]× ∬u − J Γ(I_p) q

    θ = (I_p⁻¹, κ, mu). The motion does not depend on mu, which keeps its initial value, a known or an assumed mass. The state's parameters
    are I_p, ``b + κ mu`` and mu. With a known mass, :func:`massprop_cli.estimate.pivot.about_cg` gives CG and inertia about the CG.
    """

    channels = 12
    force = slice(6, 6)
    translates = False
    wrench_response = Plant.wrench_response

    @property
    def observable(self) -> BoolArray:
        """(10,) all but mu."""
        return OBSERVABLE

    def force_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:  # noqa: ARG002
        """(K, 3, 3) derivative of the specific force at the pivot with respect to the attitude error: g [u]×."""
        return self.gravity * cross_matrix(up)

    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference; its inertia is about the pivot."""
        inverse = np.linalg.inv(reference.inertia)
        return np.concatenate([elements(inverse), (reference.cg - self.bearing) / reference.mu, [reference.mu]])

    def parameters(self, theta: Array) -> Array:
        """(..., 10) state parameters of θ (..., 10)."""
        values = Plant.parameters(self, theta)
        values[..., 6:9] = self.bearing + theta[..., MOMENT] * theta[..., MU, None]
        return values

    def slopes(self, theta: Array) -> Array:
        """(..., 10, 10) derivative of the state parameters with respect to θ, at a fixed mu."""
        derivative = Plant.slopes(self, theta)
        derivative[..., 6:9, MOMENT] = np.eye(3) * theta[..., MU, None, None]
        return derivative

    def parallel_axis_trace(self, theta: Array) -> float:  # noqa: ARG002
        """Zero: the state's inertia is about the pivot too."""
        return 0.0

    def moment_per_metre(self, theta: Array) -> Array:
        """(...,) the mass, kg."""
        return 1 / theta[..., MU]

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(40,) φ = (Φ, mu, 0) with Φ = [J | −g J [κ]× | −J Γ(I_p)], and (40, 10) its derivative."""
        phi, slopes = lever_coefficients(theta, self.gravity)
        return np.concatenate([phi, np.zeros(3)]), slopes

    def inputs(self, wrench: Array, up: Array, level_of: Array) -> Array:  # noqa: ARG002
        """(K, B, 6) torque about the pivot, vertical."""
        return np.concatenate([self.command_input(wrench), up], -1)

    def attitude_inputs(self, motion: Motion, ups: tuple[Array, Array], skew: Array, late_s: Array) -> list[tuple[Array, Array]]:  # noqa: ARG002
        """The vertical."""
        return [(motion.up, (ups[1] - ups[0]) * late_s)]

    def nonlinear_acceleration(self, theta: Array, motion: Motion) -> Array:  # noqa: ARG002
        """Zero: the response is exactly linear in φ."""
        return np.zeros_like(motion.rate)

    def specific_force(self, reference: Reference, motion: Motion, mean: MeanMotion, position: Array) -> SpecificForce:  # noqa: ARG002
        """Mean specific force; exact, as the pivot does not move."""
        arm = position - self.bearing
        by_rate_dot = np.broadcast_to(-cross_matrix(arm), mean.rotation.shape)
        offset = self.gravity * mean.whole[:, 3:6] + times(mean.centripetal, arm)
        return SpecificForce(by_rate_dot, np.zeros((len(mean.whole), 3, 4)), offset)

    def regressor(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:  # noqa: ARG002
        """(K, 6, 10) derivative of the torque; the specific force does not depend on the parameters."""
        rows = inertia_rows(rate, rate_dot)
        rows[:, :3, 6:9] = -self.gravity / reference.mu * cross_matrix(up)
        return rows
