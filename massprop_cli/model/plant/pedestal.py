"""A body on a spherical bearing whose pedestal is fixed to the ground."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross_matrix, elements, times
from massprop_cli.model.plant.bearing import BearingBody
from massprop_cli.model.plant.free import by_lever, turned_rows
from massprop_cli.model.plant.plant import MOMENT, MU, Felt, Motion, Plant, Reference, Turning

TOLD: BoolArray = np.arange(10) != MU
"""Of θ: all but mu."""


@dataclass(frozen=True)
class PedestalBody(BearingBody):
    """A body that turns about a fixed pivot b under its weight.

    With I_p the inertia about the pivot, κ = m (c − b) the first moment about it, u the vertical and τ_p the torque about it:

    I_p ω̇ + ω × (I_p ω + h) = τ_p − g κ × u − ḣ
    f = g u + ω̇ × ρ + ω × (ω × ρ),   ρ = r − b

    θ = (I_p⁻¹, κ, mu), and mu enters neither: it stays what the search began with, a known or an assumed mass. The state's parameters are
    those about the pivot: I_p, ``b + κ mu`` and mu. A weighed mass makes CG and inertia about the CG of them
    (:func:`massprop_cli.estimate.pivot.about_cg`).

    w[k+1] − w[k] = J l − g J [κ]× ∬u − J Γ(I_p) q
    """

    channels = 12
    force = slice(6, 6)
    translates = False
    pushed = Plant.pushed

    @property
    def told(self) -> BoolArray:
        """All but mu."""
        return TOLD

    def force_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:  # noqa: ARG002
        """(K, 3, 3) of the specific force at the pivot by an error φ of the attitude, g [u]×."""
        return self.gravity * cross_matrix(up)

    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference, whose inertia is about the pivot."""
        inverse = np.linalg.inv(reference.inertia)
        return np.concatenate([elements(inverse), (reference.cg - self.bearing) / reference.mu, [reference.mu]])

    def parameters(self, theta: Array) -> Array:
        """(..., 10) the state's parameters of θ (..., 10)."""
        found = Plant.parameters(self, theta)
        found[..., 6:9] = self.bearing + theta[..., MOMENT] * theta[..., MU, None]
        return found

    def slopes(self, theta: Array) -> Array:
        """(..., 10, 10) their derivative, mu being what it is."""
        found = Plant.slopes(self, theta)
        found[..., 6:9, MOMENT] = np.eye(3) * theta[..., MU, None, None]
        return found

    def trace_beyond(self, theta: Array) -> float:  # noqa: ARG002
        """None: both are about the pivot."""
        return 0.0

    def moment_over_cg(self, theta: Array) -> Array:
        """The mass."""
        return 1 / theta[..., MU]

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(40,) φ = (Φ, mu, 0), Φ = [J | −g J [κ]× | −J Γ(I_p)], and (40, 10) its derivative: no mass property is felt beside Φ."""
        phi, slopes = by_lever(theta, self.gravity)
        return np.concatenate([phi, np.zeros(3)]), slopes

    def acting(self, wrench: Array, up: Array, level_of: Array) -> Array:  # noqa: ARG002
        """(K, B, 6) the torque about the pivot, the vertical."""
        return np.concatenate([self.commanded(wrench), up], -1)

    def by_attitude(self, motion: Motion, ups: tuple[Array, Array], skew: Array, late_s: Array) -> list[tuple[Array, Array]]:  # noqa: ARG002
        """The vertical."""
        return [(motion.up, (ups[1] - ups[0]) * late_s)]

    def swing(self, theta: Array, motion: Motion) -> Array:  # noqa: ARG002
        """None."""
        return np.zeros_like(motion.rate)

    def felt(self, reference: Reference, motion: Motion, turning: Turning, position: Array) -> Felt:  # noqa: ARG002
        """Exact: the pivot stands still."""
        arm = position - self.bearing
        euler = np.broadcast_to(-cross_matrix(arm), turning.rotation.shape)
        offset = self.gravity * turning.whole[:, 3:6] + times(turning.centripetal, arm)
        return Felt(euler, np.zeros((len(turning.whole), 3, 4)), offset)

    def shown(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:  # noqa: ARG002
        """(K, 6, 10) what torque tells of the parameters; the specific force tells nothing."""
        rows = turned_rows(rate, rate_dot)
        rows[:, :3, 6:9] = -self.gravity / reference.mu * cross_matrix(up)
        return rows
