"""Motion on a planar table: x, y and yaw, body Z away from the table.

The table's reaction balances force along Z and moments about X and Y, so ``I_zz ω̇_z = (τ − c × F)_z``. The specific force of the CG is
``F/m`` along the table and gravity along Z. On a tilted table, weight pulls the body along it. If the body slides freely, the
accelerometer does not measure this pull. It measures the part of the pull that something holds.
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
    cross,
    to_world,
)

YAW = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class TablePlant:
    """Gravity and holding force on a table."""

    gravity: float
    """m/s²"""
    held: Array
    """(3,) specific force along the table that holds the body on the slope, world axes, m/s²."""


@dataclass(frozen=True)
class OnTable(Dynamics):
    """Dynamics on a planar table, with the coefficients of the module's equation."""

    table: TablePlant

    @cached_property
    def inverse(self) -> Array:
        """(3, 3, S) inverse of I_zz, zero about X and Y."""
        return np.asarray(np.diag(YAW)[..., None] / self.bodies.inertia[2, 2])

    def fixed(self, attitude: Array) -> Array:
        """(3, S) holding specific force, body axes, m/s²."""
        back = attitude * np.array([1.0, -1.0, -1.0, -1.0])[:, None]
        return to_world(back, np.broadcast_to(self.table.held[:, None], attitude[1:].shape))

    def advance(self, rate: Array, fixed: Array, wrench: Wrench, width_s: float) -> CycleMotion:
        """Motion through one cycle, with rotation about Z only."""
        return super().advance(rate * YAW[:, None], fixed, wrench, width_s)

    def constrain(self, free: FreeTerms, driven: FixedTerms, state: MotionIterate, fixed: Array, wrench: Wrench, h: float) -> Constrained:
        """Terms with the world-fixed vector rotated back by the yaw angle, to second order in a bin."""
        yaw = free.rate[2, 0]
        angle = h * (np.cumsum(yaw, -1) - yaw / 2)
        along = fixed[..., None] * np.cos(angle) - cross(YAW[:, None, None] * np.sin(angle), fixed[..., None])
        return super().constrain(free, driven, state, fixed, wrench, h)._replace(fixed=along)

    def centre_force(self, motion: CycleMotion, force: Array, width_s: float) -> Array:
        """(3, S, B) specific force of the CG, m/s²."""
        specific_force = super().centre_force(motion, force, width_s) + motion.fixed
        specific_force[2] = self.table.gravity
        return specific_force
