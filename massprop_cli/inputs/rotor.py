"""Rotors (propellers) as a vehicle file states them."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.section import NonNegative, Place, Positive, Real, Section, Vector
from massprop_cli.inputs.wheel import Wheel


class Rotor(Section):
    """One rotor: where it is, which way it pushes and turns, its thrust by command or speed, how fast that follows."""

    name: str = Field(min_length=1, pattern=r"^[^\x00-\x1f\x7f]+$")
    position_m: Place
    axis: Vector = Field(description="direction of its thrust on the vehicle, body axes; of any length")
    spin: Literal[1, -1] = Field(
        description="1: it turns right-handed about the axis, and its drag turns the vehicle left-handed; -1: the other way"
    )
    thrust_n: Annotated[tuple[Real, ...], Field(min_length=1, max_length=8)] = Field(
        description="coefficients c0, c1, c2, … of its thrust in N: c0 + c1 x + c2 x² + …, x the number in its column"
    )
    column: Literal["command", "speed"] = Field(
        "command", description="x: rotor_NAME_command, as commanded for the cycle, or rotor_NAME_rad_s, as measured at time_s"
    )
    torque_ratio_m: NonNegative = Field(0.0, description="drag torque about its axis over thrust")
    lag_up_s: NonNegative | None = Field(None, description="first-order lag of x behind a command that is higher; absent: thrust.lag_s")
    lag_down_s: NonNegative | None = Field(None, description="the same behind one that is lower; absent: lag_up_s")
    nominal_v: Positive | None = Field(
        None, description="supply voltage that thrust_n holds for; commands count in proportion to column supply_v then"
    )
    spin_inertia_kg_m2: Positive | None = Field(None, description="about its axis, of blades and motor; needs its speed")
    spin_inertia_sigma_kg_m2: NonNegative = 0.0
    locked_in_inertia: bool = Field(True, description="whether the body's inertia has it in it as if it were locked")

    @field_validator("axis")
    @classmethod
    def _points(cls, axis: Vector) -> Vector:
        if not any(axis):
            raise ValueError("points nowhere; give the direction of the rotor's thrust in body axes")
        return axis

    @model_validator(mode="after")
    def _fits_its_column(self) -> Self:
        if self.column == "speed" and (self.lag_up_s or self.lag_down_s or self.nominal_v):
            raise ValueError("a measured speed has no lag and needs no voltage: drop lag_up_s, lag_down_s and nominal_v")
        if self.column == "command" and self.spin_inertia_kg_m2 is not None:
            raise ValueError('spin_inertia_kg_m2 needs the rotor\'s speed: log it and state column = "speed", or drop spin_inertia_kg_m2')
        return self

    @property
    def wrench(self) -> Array:
        """(6,) torque about O and force of one newton of thrust."""
        along = np.array(self.axis) / np.linalg.norm(self.axis)
        return np.concatenate([np.cross(self.position_m, along) - self.spin * self.torque_ratio_m * along, along])

    def lags(self, otherwise_s: float) -> tuple[float, float]:
        """Of rising and of falling thrust, s."""
        if self.column == "speed":
            return 0.0, 0.0
        up = otherwise_s if self.lag_up_s is None else self.lag_up_s
        return up, up if self.lag_down_s is None else self.lag_down_s

    @property
    def wheel(self) -> Wheel | None:
        """What turns with it, where that is known."""
        if self.spin_inertia_kg_m2 is None:
            return None
        x, y, z = self.axis
        return Wheel(
            name=self.name,
            axis=(self.spin * x, self.spin * y, self.spin * z),
            spin_inertia_kg_m2=self.spin_inertia_kg_m2,
            spin_inertia_sigma_kg_m2=self.spin_inertia_sigma_kg_m2,
            locked_in_inertia=self.locked_in_inertia,
        )
