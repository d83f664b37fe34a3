"""Segments and events of a mission, as a scenario file states them."""

from typing import Annotated, Literal, Self

from pydantic import Field, FiniteFloat, model_validator

from massprop_cli.inputs.section import ZERO, NonNegative, Positive, Section, Vector

TURNS = ("roll", "pitch", "yaw")
AXES = (*TURNS, "x", "y", "z")
Axis = Literal["roll", "pitch", "yaw", "x", "y", "z"]
LONGEST = 10_000_000
"""Maximum number of cycles in a scenario."""
WHOLE = 1e-6
"""Tolerance of a time that must be a whole number of cycles, in cycles."""


class Timed(Section):
    """Something with a place in time, in cycles or in seconds."""

    @staticmethod
    def _cycles(cycle: int | None, seconds: float | None, period_s: float, what: str) -> int:
        if cycle is not None:
            return cycle
        assert seconds is not None
        found = seconds / period_s
        if found > LONGEST:
            raise ValueError(f"{what} at {seconds:g} s is more than {LONGEST:g} cycles of {period_s:g} s away; is it in seconds?")
        if abs(found - round(found)) > WHOLE * max(1.0, found) or (seconds > 0 and round(found) == 0):
            raise ValueError(f"{what} at {seconds:g} s is no whole number of cycles of {period_s:g} s")
        return round(found)


class Segment(Timed):
    """A stretch of the mission plan. Axes that no segment drives are left alone."""

    motion: Literal["hold", "alternating", "random", "steady", "coast"]
    axes: tuple[Axis, ...] = Field((), description="roll, pitch, yaw turn, x, y, z push; absent: hold all turns, coast all six")
    start_cycle: Annotated[int, Field(ge=0)] | None = None
    end_cycle: Annotated[int, Field(gt=0)] | None = None
    start_s: NonNegative | None = None
    end_s: Positive | None = None
    every_cycles: int = Field(
        5, ge=1, le=LONGEST, description="alternating: the sign changes this often; random: a new pulse is drawn this often"
    )
    max_cycles: int = Field(4, ge=1, le=LONGEST, description="random: pulses last 1 to this many cycles, all lengths alike")
    level: FiniteFloat = Field(1.0, ge=-1, le=1, description="part of the full torque or force; its sign comes first")
    torque_n_m: Positive | None = Field(None, description="instead of level")
    force_n: Positive | None = Field(None, description="instead of level")
    closed_loop: bool = Field(False, description="hold the attitude beneath the pulses about roll, pitch and yaw")
    by_wheels: bool = Field(False, description="turn by wheels, or what else stores momentum, and not by the jets")

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        for edge in ("start", "end"):
            if (getattr(self, f"{edge}_cycle") is None) == (getattr(self, f"{edge}_s") is None):
                raise ValueError(f"give either {edge}_cycle or {edge}_s")
        pulsed = self.motion in ("alternating", "random", "steady")
        if pulsed and not self.axes:
            raise ValueError(f'motion "{self.motion}" needs axes, for instance axes = ["roll"]')
        if len(set(self.axes)) < len(self.axes):
            raise ValueError("an axis is named twice")
        if self.motion == "hold" and not set(self.axes) <= set(TURNS):
            raise ValueError("hold turns about roll, pitch and yaw only; it cannot hold a position")
        given = self.model_fields_set
        if not pulsed and (self.closed_loop or given & {"level", "torque_n_m", "force_n", "every_cycles", "max_cycles"}):
            raise ValueError(
                f'motion "{self.motion}" takes no pulses: drop closed_loop, level, torque_n_m, force_n, every_cycles, max_cycles'
            )
        if self.by_wheels and not set(self.driven) <= set(TURNS):
            raise ValueError("wheels turn about roll, pitch and yaw only; drop by_wheels, or the other axes")
        if self.closed_loop and not set(self.axes) & set(TURNS):
            raise ValueError("closed_loop holds the axes of its own segment: name roll, pitch or yaw, or write a segment that holds them")
        if "level" in given and (self.torque_n_m or self.force_n):
            raise ValueError("give either level, or torque_n_m or force_n")
        if pulsed and self.level == 0:
            raise ValueError('level is zero; write motion = "coast"')
        if self.motion == "random" and self.max_cycles > self.every_cycles:
            raise ValueError(f"pulses of up to {self.max_cycles} cycles don't fit a redraw every {self.every_cycles} cycles")
        for key, allowed in (("torque_n_m", set(TURNS)), ("force_n", set(AXES) - set(TURNS))):
            if getattr(self, key) is not None and not set(self.axes) <= allowed:
                raise ValueError(f"{key} does not fit axes {', '.join(self.axes)}; write a segment of their own for them")
        return self

    @property
    def driven(self) -> tuple[Axis, ...]:
        """The axes that this segment claims."""
        return self.axes or (AXES if self.motion == "coast" else TURNS)  # type: ignore[return-value]

    def cycles(self, period_s: float) -> tuple[int, int]:
        """First cycle, and the cycle after the last."""
        start = self._cycles(self.start_cycle, self.start_s, period_s, "start")
        end = self._cycles(self.end_cycle, self.end_s, period_s, "end")
        if end <= start:
            raise ValueError(f"ends at cycle {end}, not after its start at cycle {start}")
        return start, end


class Event(Timed):
    """What happens to the vehicle or to the estimator at the start of a cycle."""

    kind: Literal["dock", "reset"] = Field(description="dock: [docked] is joined; reset: a new phase, its covariance afresh")
    cycle: Annotated[int, Field(gt=0)] | None = None
    at_s: Positive | None = None
    motion: Literal["momentum_conserved", "rates_kept"] = Field(
        "momentum_conserved", description="rates_kept: body rates and the velocity of O stay, as the thesis has it"
    )
    docked_rate_rad_s: Vector = Field(ZERO, description="of the object before docking, body axes")
    docked_velocity_m_s: Vector = Field(ZERO, description="of the object's CG before docking, relative to the vehicle's CG, body axes")
    phase: str | None = Field(None, description="name of the phase that begins here")

    @model_validator(mode="after")
    def _has_time(self) -> Self:
        if (self.cycle is None) == (self.at_s is None):
            raise ValueError("give either cycle or at_s")
        given = self.model_fields_set & {"motion", "docked_rate_rad_s", "docked_velocity_m_s"}
        if given and (self.kind == "reset" or (self.motion == "rates_kept" and given != {"motion"})):
            raise ValueError(f"{', '.join(sorted(given))} has no meaning here; drop it")
        return self

    def at(self, period_s: float) -> int:
        """Cycle at whose start the event happens."""
        return self._cycles(self.cycle, self.at_s, period_s, "event")
