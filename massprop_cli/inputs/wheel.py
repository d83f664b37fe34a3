"""Reaction wheels as a vehicle file states them, and what a log says of them.

A wheel turns about an axis a that is fixed in the body and carries the momentum ``h = J W`` along it, J its spin inertia, W its speed
relative to the body. With the wheel locked the body's inertia about its CG is I; what the motor does to the wheel, the body feels the
opposite of. All moments on body and wheels together:

    I ω̇ + a J Ẇ + ω × (I ω + a J W) = τ − c × F          by speed
    (I − J a aᵀ) ω̇ + a T + ω × ((I − J a aᵀ) ω + a h) = τ − c × F,   ḣ = T,  h = J (W + a · ω)          by torque T on the wheel
"""

from dataclasses import replace
from typing import Literal, Self

import numpy as np
from pydantic import Field, field_validator

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.section import NonNegative, Positive, Real, Section, Vector


class Wheel(Section):
    """One reaction wheel: its axis, what it weighs about it, and which of its columns the log has."""

    name: str = Field(min_length=1, pattern=r"^[^\x00-\x1f\x7f]+$")
    axis: Vector = Field(description="direction of positive speed, body axes; of any length")
    spin_inertia_kg_m2: Positive = Field(description="about its axis")
    spin_inertia_sigma_kg_m2: NonNegative = Field(0.0, description="one sigma of it; goes into every sigma")
    locked_in_inertia: bool = Field(
        description="whether the body's inertia, as given and reported, has this wheel in it as if it were locked; false: without its spin "
        "inertia about its axis. The wheel's mass, and its inertia across the axis, are always in it"
    )
    column: Literal["speed", "torque"] = Field(
        "speed",
        description="what the log has: wheel_NAME_rad_s, relative to the body at time_s, or wheel_NAME_n_m on the wheel over the cycle",
    )
    torque_is: Literal["commanded", "measured"] = Field(
        "commanded", description="of a torque column: commanded torque acts after cycle.command_delay_cycles, measured torque at once"
    )
    torque_scale_sigma: NonNegative = Field(0.0, description="relative uncertainty of a torque column; goes into every sigma")
    start_rad_s: Real | None = Field(
        None,
        description="speed relative to the body when the first torque of the log acts, which a commanded one does after the delay; absent: "
        "the first cell of wheel_NAME_rad_s. For a torque column; "
        "speeds that begin at this in another unit, or with the other sign, are refused",
    )
    start_sigma_rad_s: NonNegative = Field(0.0, description="one sigma of that speed; goes into every sigma")
    coulomb_friction_n_m: NonNegative = Field(0.0, description="against the speed, whatever that is. For a torque column")
    viscous_friction_n_m_s: NonNegative = Field(0.0, description="against the speed, over it. For a torque column")

    @field_validator("axis")
    @classmethod
    def _points(cls, axis: Vector) -> Vector:
        if not any(axis):
            raise ValueError("points nowhere; give the direction of the wheel's axis in body axes")
        return axis

    @property
    def direction(self) -> Array:
        """(3,) the axis, of length one."""
        unit: Array = np.array(self.axis) / np.linalg.norm(self.axis)
        return unit

    @property
    def locked(self) -> Array:
        """(3, 3) J a aᵀ, what the wheel adds about its axis to a body that it is locked to, kg m²."""
        found: Array = self.spin_inertia_kg_m2 * np.outer(self.direction, self.direction)
        return found

    @property
    def locked_beyond_reported(self) -> int:
        """How many times J a aᵀ the inertia that answers to this log's column has beyond the one that is reported."""
        return int(self.column == "speed") - int(self.locked_in_inertia)

    def friction(self, speed: float) -> float:
        """Torque against the speed [rad/s], N m."""
        return float(self.viscous_friction_n_m_s * speed + self.coulomb_friction_n_m * np.sign(speed))


@dataclass(frozen=True)
class WheelLog:
    """What a log says of one wheel."""

    speed_rad_s: Array | None
    """(n,) relative to the body, at each record's ``time_s``."""
    torque_n_m: Array | None
    """(K,) on the wheel, of each control cycle; None where the speed is known."""
    start_rad_s: float | None
    """Speed at the beginning of the log, or of a torque's log when its first torque acts; None: unknown."""

    def part(self, rows: slice) -> Self:
        """Of some records; ValueError of a torque's log, whose speed follows from all that went before."""
        if self.speed_rad_s is None:
            raise ValueError("the speed of a wheel whose torque was logged follows from its whole log")
        before = float(self.speed_rad_s[rows.start - 1]) if rows.start else self.start_rad_s
        return replace(self, speed_rad_s=self.speed_rad_s[rows], start_rad_s=before)


def backwards(said: WheelLog) -> WheelLog:
    """The same of a wheel that turns the other way."""
    speed, torque, start = said.speed_rad_s, said.torque_n_m, said.start_rad_s
    return WheelLog(None if speed is None else -speed, None if torque is None else -torque, None if start is None else -start)
