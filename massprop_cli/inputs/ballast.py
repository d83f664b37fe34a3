"""Ballast file of a table on a pedestal (``massprop schema ballast``): sliding weights, and places for added weight."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import at_key, check_once
from massprop_cli.inputs.actuators.actuator import pointing, unit
from massprop_cli.inputs.section import Metres, NonNegative, Place, Positive, Section, Vector

_SLIDING = ("mass_kg", "axis", "travel_m")


class Ballast(Section):
    """Sliding weight (mass_kg, axis, travel_m), or place for added weight (max_mass_kg)."""

    name: str = Field(min_length=1, pattern=r"^[^\x00-\x1f\x7f=,]+$")
    position_m: Place = Field(description="centre of mass from O, body axes: at zero travel, or of the added weight")
    mass_kg: Positive | None = Field(None, description="mass of a sliding weight")
    axis: Annotated[Vector, pointing("positive travel")] | None = Field(
        None, description="direction of positive travel, body axes; any length"
    )
    travel_m: tuple[Metres, Metres] | None = Field(None, description="least and greatest travel along the axis")
    at_m: Metres = Field(0.0, description="travel during the log")
    max_mass_kg: Positive | None = Field(None, description="largest weight that can be added")
    mass_sigma_kg: NonNegative = Field(0.0, description="one sigma of mass_kg or of the added weight; 0: exact")
    position_sigma_m: NonNegative = Field(
        0.0, le=1.0, description="one sigma of a travel setting along the axis, or of the added weight's position along each body axis"
    )

    @model_validator(mode="after")
    def _slides_or_is_added(self) -> Self:
        stated = [key for key in _SLIDING if getattr(self, key) is not None]
        missing = next((key for key in _SLIDING if key not in stated), None)
        if self.max_mass_kg is not None and stated:
            raise at_key(stated[0], "does not go with max_mass_kg; a ballast slides, or is a place where weight is added: state two")
        if self.max_mass_kg is None and missing:
            raise at_key(missing, "is missing; a weight that slides needs mass_kg, axis and travel_m, a place to add weight max_mass_kg")
        low, high = self.travel_m or (-math.inf, math.inf)
        if not low < high:
            raise at_key("travel_m", f"[{low:g}, {high:g}] has no length; give the least travel, then the greatest")
        if not low <= self.at_m <= high:
            raise at_key("at_m", f"{self.at_m:g} m is outside of travel_m = [{low:g}, {high:g}]; correct the one or the other")
        if self.mass_sigma_kg > (self.mass_kg or self.max_mass_kg or 0.0):
            raise at_key("mass_sigma_kg", f"{self.mass_sigma_kg:g} kg is more than mass_kg itself; state one sigma in kg")
        if self.max_mass_kg is not None and self.at_m:
            raise at_key("at_m", "is only for a weight that slides; leave it out where weight is added")
        return self

    @property
    def slides(self) -> bool:
        """Whether it is a sliding weight."""
        return self.max_mass_kg is None

    @property
    def direction(self) -> Array:
        """(3,) unit vector of positive travel, body axes."""
        assert self.axis is not None
        return unit(self.axis)

    @property
    def room(self) -> tuple[float, float]:
        """Least and greatest change: of the travel, m, or of the added weight, kg."""
        low, high = self.travel_m or (0.0, self.max_mass_kg or 0.0)
        return low - self.at_m, high - self.at_m


class BallastFile(Section):
    """Ballast file."""

    schema_: Literal["massprop/ballast/1"] = Field("massprop/ballast/1", alias="schema")
    ballast: tuple[Ballast, ...] = Field(min_length=1, max_length=64)

    @model_validator(mode="after")
    def _names_each_once(self) -> Self:
        check_once((one.name for one in self.ballast), "ballast", "give each its own")
        return self
