"""Motion on an air bearing.

The spherical bearing is at b on a base that slides on a horizontal plane (5 degrees of freedom). s = c − b, u is the vertical,
``p = s × u``, m_r the rotating mass and m the whole mass. ``A ω̇ = M w − ω × (A₀ ω + h) + p q`` with ``A₀ = I − (m_r − m_r²/m) [s]×²``,
``A = A₀ + (m_r²/m) p pᵀ``, ``M w = τ − b × F − (m_r/m) s × F`` and ``q = (m_r/m) u·F − m_r g − (m_r²/m) u·(ω × (ω × s))``. This is the
moment equation about the CG with the base's horizontal acceleration and its reaction eliminated.
"""

from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.testbed.motion import (
    Constrained,
    CycleMotion,
    Dynamics,
    FixedTerms,
    FreeTerms,
    MotionIterate,
    Wrench,
    apply,
    cross,
    dot,
    lever,
    outer_square,
    paired,
    vertical,
)


@dataclass(frozen=True)
class Bearing:
    """Position and translating mass of an air bearing, and gravity."""

    position: Array
    """(3,) from O, m."""
    mass: float
    """kg"""
    gravity: float
    """m/s²"""


@dataclass(frozen=True)
class OnBearing(Dynamics):
    """Dynamics on an air bearing, with the coefficients of the module's equation."""

    bearing: Bearing

    @cached_property
    def arm(self) -> Array:
        """(3, S) s, bearing to CG, m."""
        return self.bodies.cg - self.bearing.position[:, None]

    @cached_property
    def rotating_mass(self) -> Array:
        """(S,) m_r, kg."""
        return self.bodies.mass - self.bearing.mass

    @cached_property
    def share(self) -> Array:
        """(S,) m_r / m."""
        return self.rotating_mass / self.bodies.mass

    @cached_property
    def inertia(self) -> Array:
        """(3, 3, S) A₀, kg m²."""
        return self.bodies.inertia + self.rotating_mass * (1 - self.share) * outer_square(self.arm)

    @cached_property
    def centre(self) -> Array:
        """(3, S) position of the bearing from O, m."""
        return np.broadcast_to(self.bearing.position[:, None], self.bodies.cg.shape)

    def fixed(self, attitude: Array) -> Array:
        """(3, S) vertical, body axes."""
        return vertical(attitude)

    def moment(self, wrench: Array) -> Array:
        """(3, S, B) M w, N m."""
        torque, force = wrench[:3], wrench[3:]
        return torque - cross(self.bearing.position[:, None, None] + (self.share * self.arm)[..., None], force)

    def constrain(self, free: FreeTerms, driven: FixedTerms, state: MotionIterate, fixed: Array, wrench: Wrench, h: float) -> Constrained:
        """Terms with the bearing's reaction, which carries the weight."""
        ups, q = self._vertical_and_reaction(fixed, free.rate, state, wrench, h)
        # p = s × u, and its rate of change s × (u × ω) for the slope
        levers = cross(self.arm[:, None, :, None], paired(ups, cross(ups, free.rate[:, 0])))
        turned = apply(self.inverse[:, :, None, :, None], levers)
        rest = self._with_bearing(free.rest[:, 0] + driven.mean, levers[:, 0], q, turned[:, 0]) - driven.mean
        return Constrained(ups, rest, free.rest[:, 1] - (self.rotating_mass * self.bearing.gravity)[:, None] * turned[:, 1])

    def centre_force(self, motion: CycleMotion, force: Array, width_s: float) -> Array:
        """(3, S, B) specific force of the bearing, m/s²: horizontal acceleration of the base, and gravity."""
        acceleration = force / self.bodies.mass[:, None] - self.share[:, None] * lever(motion, self.arm[..., None], width_s)
        return acceleration - motion.fixed * dot(motion.fixed, acceleration) + self.bearing.gravity * motion.fixed

    def _vertical_and_reaction(self, up: Array, rate: Array, state: MotionIterate, wrench: Wrench, h: float) -> tuple[Array, Array]:
        """Vertical (3, S, B), body axes, and q (S, B), N, at rates and their slopes (3, 2, S, B)."""
        first = cross(state.fixed[:, None], rate)
        slope, mean = first[:, 0], rate[:, 0]
        second = cross(slope[:, None], rate)
        turning = slope + h * h / 12 * second[:, 1]
        start = up[..., None] + h * (np.cumsum(turning, -1) - turning)
        ups = start + h / 2 * turning - h * h / 12 * (second[:, 0] + first[:, 1])
        arm, share = self.arm[..., None], self.share[:, None]
        force = wrench.mean[3:] - self.rotating_mass[:, None] * cross(mean, cross(mean, arm))
        return ups, share * dot(ups, force) - self.rotating_mass[:, None] * self.bearing.gravity

    def _with_bearing(self, driven: Array, p: Array, q: Array, turned: Array) -> Array:
        """(A₀ + k p pᵀ)⁻¹ (A₀ driven + p q) by the Sherman–Morrison formula, ``turned = A₀⁻¹ p``."""
        k = (self.rotating_mass * self.share)[:, None]
        size = dot(p, turned)
        return driven + turned * (q - k * (dot(p, driven) + size * q) / (1 + k * size))


@dataclass(frozen=True)
class OnPedestal(OnBearing):
    """Dynamics on a bearing whose pedestal is fixed to the ground.

    ``I_p ω̇ = τ − b × F − m g s × u − ω × (I_p ω + h)``, the equation of an air bearing in the limit m_r / m = 0.
    """

    @cached_property
    def share(self) -> Array:
        """(S,) zeros: no force moves the base."""
        return np.zeros_like(self.bodies.mass)

    def centre_force(self, motion: CycleMotion, force: Array, width_s: float) -> Array:  # noqa: ARG002
        """(3, S, B) specific force of the pivot, m/s²: gravity alone."""
        return self.bearing.gravity * motion.fixed
