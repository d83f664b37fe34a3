"""Settings of the estimators, of convergence, and of drifting quantities."""

from typing import Literal, Self

from pydantic import Field, model_validator

from massprop_cli.inputs.section import NonNegative, Positive, Real, Section

UNWIDENED = (1.0, 1.0, 1.0)
"""Factors that leave the accelerometer noise as stated."""


class ThesisSettings(Section):
    """Hand-tuned matrices of the thesis (appendix B): diagonals, SI. The first filter has nine states, the second the mass."""

    p1: tuple[Positive, ...] = (10.0,) * 9
    q1: tuple[NonNegative, ...] = (5e-9, 1e-11, 1e-11, 5e-9, 1e-11, 5e-9, 1e-9, 1e-9, 1e-9)
    r1: Positive = 5e-2
    p2: Positive = 50.0
    q2: NonNegative = 1e-5
    r2: Positive = 5e-2
    p1_again: tuple[Positive, ...] | None = Field(None, description="p1 of every phase after the first; absent: p1")
    p2_again: Positive | None = Field(None, description="p2 of every phase after the first; absent: p2")
    initial: tuple[Real, ...] = Field((0.0,) * 10, description="initial values of the ten quantities")

    @model_validator(mode="after")
    def _has_sizes(self) -> Self:
        for key, size in (("p1", 9), ("q1", 9), ("p1_again", 9), ("initial", 10)):
            values = getattr(self, key)
            if values is not None and len(values) != size:
                raise ValueError(f"{key} has {len(values)} values; give {size}")
        return self


class EstimatorSettings(Section):
    """Settings of the estimators; the defaults suit every vehicle."""

    method: Literal["default", "thesis"] = "default"
    bins_per_cycle: int = Field(
        4,
        ge=2,
        le=200,
        description=(
            "bins per control cycle for the motion within it; absent: the default method uses 8, 16, 32 or 64 for rotations of 0.15, "
            "0.3, 0.6 or 1.2 rad per cycle, and 16 or 64 where more bins could change a value by 0.3 sigma"
        ),
    )
    prior_scale: Positive = Field(
        100.0, le=1e6, description="prior sigma over the vehicle's natural size; a larger prior has less influence"
    )
    accel_noise_scale: tuple[Positive, Positive, Positive] = Field(
        UNWIDENED, description="factor of accel_noise_m_s2 on each body axis; adapt_noise may increase it"
    )
    adapt_noise: bool = Field(True, description="estimate disturbances in a first pass if the stated noise cannot explain the log")
    split_on_change: bool = Field(False, description="start a new phase where the mass properties change suddenly within a phase")
    refine: bool = Field(False, description="report the off-line maximum-likelihood fit of each phase instead of its last causal row")
    cross_validate: float | None = Field(
        None,
        gt=0.0,
        lt=1.0,
        description=(
            "confidence level at which the other segments must predict each segment of a phase, else exit code 5; absent: no test"
        ),
    )
    thesis: ThesisSettings = ThesisSettings.unset()


class ConvergenceSettings(Section):
    """Rule of sustained convergence."""

    count: int = Field(100, ge=1, description="number of consecutive updates within tolerance")
    relative: bool | None = Field(None, description="whether tolerances are relative to the natural size; absent: by method")
    inertia_tolerance: Positive | None = Field(None, description="default: 0.01 of the trace; thesis: 0.05 kg m^2")
    cg_tolerance: Positive | None = Field(None, description="default: 0.01 of sqrt(trace/mass); thesis: 0.05 m")
    mass_tolerance: Positive | None = Field(None, description="default: 0.01 of the mass; thesis: 0.1 kg")


class Drift(Section):
    """Random walk of each quantity: one sigma per sqrt(s), in the quantity's unit."""

    ixx: NonNegative = 0.0
    ixy: NonNegative = 0.0
    ixz: NonNegative = 0.0
    iyy: NonNegative = 0.0
    iyz: NonNegative = 0.0
    izz: NonNegative = 0.0
    cg_x: NonNegative = 0.0
    cg_y: NonNegative = 0.0
    cg_z: NonNegative = 0.0
    mass: NonNegative = 0.0
