"""Motion on a table: x, y and yaw, the body's Z away from the table.

The table's reaction takes up force along Z and moments about X and Y, so ``I_zz ω̇_z = (τ − c × F)_z``; the CG feels ``F/m`` along the
table, and gravity along Z. Where the table slopes, the weight pulls the body along it. A body that slides without friction follows, and its
accelerometer, which follows too, feels nothing of it; of what something holds of that pull it feels all.
"""

from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.testbed.motion import CycleMotion, Dynamics, FixedTerms, HeldTerms, Loose, MotionIterate, Wrench, cross, to_world

YAW = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class TablePlant:
    """What a table does to what stands on it."""

    gravity: float
    held: Array
    """(3,) specific force along the table of what holds the body on its slope, world axes, m/s²."""


@dataclass(frozen=True)
class OnTable(Dynamics):
    """The coefficients above."""

    table: TablePlant

    @cached_property
    def inverse(self) -> Array:
        """(3, 3, S) of I_zz alone."""
        return np.asarray(np.diag(YAW)[..., None] / self.bodies.inertia[2, 2])

    def fixed(self, attitude: Array) -> Array:
        """(3, S) what holds it on the slope."""
        back = attitude * np.array([1.0, -1.0, -1.0, -1.0])[:, None]
        return to_world(back, np.broadcast_to(self.table.held[:, None], attitude[1:].shape))

    def advance(self, rate: Array, fixed: Array, wrench: Wrench, width_s: float) -> CycleMotion:
        """Through one cycle; nothing turns but about Z."""
        return super().advance(rate * YAW[:, None], fixed, wrench, width_s)

    def held(self, loose: Loose, driven: FixedTerms, state: MotionIterate, fixed: Array, wrench: Wrench, h: float) -> HeldTerms:
        """What stands still turns back under the body, to second order in a bin."""
        yaw = loose.rate[2, 0]
        angle = h * (np.cumsum(yaw, -1) - yaw / 2)
        along = fixed[..., None] * np.cos(angle) - cross(YAW[:, None, None] * np.sin(angle), fixed[..., None])
        return super().held(loose, driven, state, fixed, wrench, h)._replace(fixed=along)

    def centre_force(self, motion: CycleMotion, force: Array, width_s: float) -> Array:
        """(3, S, B) specific force of the CG, m/s²."""
        felt = super().centre_force(motion, force, width_s) + motion.fixed
        felt[2] = self.table.gravity
        return felt
