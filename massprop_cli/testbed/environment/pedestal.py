"""Motion on a spherical bearing whose pedestal is fixed to the ground: the sliding bearing's, with a base that no force moves."""

from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.testbed.environment.bearing import OnBearing
from massprop_cli.testbed.motion import CycleMotion


@dataclass(frozen=True)
class OnPedestal(OnBearing):
    """``I_p ω̇ = τ − b × F − m g s × u − ω × (I_p ω + h)``: the coefficients of a bearing in the limit m_r / m = 0."""

    @cached_property
    def share(self) -> Array:
        """(S,) none of a push moves the base."""
        return np.zeros_like(self.bodies.mass)

    def centre_force(self, motion: CycleMotion, force: Array, width_s: float) -> Array:  # noqa: ARG002
        """(3, S, B) specific force of the pivot, m/s²: gravity's."""
        felt: Array = self.bearing.gravity * motion.fixed
        return felt
