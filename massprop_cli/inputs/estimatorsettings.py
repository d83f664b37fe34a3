"""How the estimators are set: the default one, the thesis's, when a value is converged, what drifts."""

from typing import Literal, Self

from pydantic import Field, model_validator

from massprop_cli.inputs.section import NonNegative, Positive, Real, Section

UNWIDENED = (1.0, 1.0, 1.0)
"""Of accelerometer noise that counts as it is stated."""


class ThesisSettings(Section):
    """Hand-set matrices of the thesis (appendix B): diagonals, SI. First filter nine states, second filter mass."""

    p1: tuple[Positive, ...] = (10.0,) * 9
    q1: tuple[NonNegative, ...] = (5e-9, 1e-11, 1e-11, 5e-9, 1e-11, 5e-9, 1e-9, 1e-9, 1e-9)
    r1: Positive = 5e-2
    p2: Positive = 50.0
    q2: NonNegative = 1e-5
    r2: Positive = 5e-2
    p1_again: tuple[Positive, ...] | None = Field(None, description="p1 of every phase but the first; absent: p1")
    p2_again: Positive | None = Field(None, description="p2 of every phase but the first; absent: p2")
    initial: tuple[Real, ...] = Field((0.0,) * 10, description="the ten quantities at the start")

    @model_validator(mode="after")
    def _has_sizes(self) -> Self:
        for key, size in (("p1", 9), ("q1", 9), ("p1_again", 9), ("initial", 10)):
            values = getattr(self, key)
            if values is not None and len(values) != size:
                raise ValueError(f"{key} has {len(values)} values; give {size}")
        return self


class EstimatorSettings(Section):
    """Settings of the estimators; the defaults serve every vehicle."""

    method: Literal["default", "thesis"] = "default"
    bins_per_cycle: int = Field(
        4,
        ge=2,
        le=200,
        description="resolution of motion within a control cycle; left out, the default method takes 8, 16, 32 or 64 where the log turns "
        "by 0.15, 0.3, 0.6 or 1.2 rad in one, and 16 or 64 where more could move a value by 0.3 sigma",
    )
    prior_scale: Positive = Field(100.0, le=1e6, description="prior sigma over the vehicle's natural size; larger pulls less")
    accel_noise_scale: tuple[Positive, Positive, Positive] = Field(
        UNWIDENED, description="factor on accel_noise_m_s2 per body axis, to which adapt_noise may add"
    )
    adapt_noise: bool = Field(True, description="size disturbances from a first pass where the stated noise can't explain the log")
    split_on_change: bool = Field(False, description="where the mass properties change at once within a phase, begin a new phase there")
    refine: bool = Field(False, description="report the off-line maximum-likelihood fit of each phase instead of its last causal row")
    cross_validate: float | None = Field(
        None,
        gt=0.0,
        lt=1.0,
        description="confidence level at which each segment of a phase must be predicted by all others, else exit 5; absent: untested",
    )
    thesis: ThesisSettings = ThesisSettings.unset()


class ConvergenceSettings(Section):
    """The sustained-convergence rule."""

    count: int = Field(100, ge=1, description="consecutive updates within tolerance")
    relative: bool | None = Field(None, description="tolerances relative to the natural size; absent: by method")
    inertia_tolerance: Positive | None = Field(None, description="default 0.01 of the trace; thesis 0.05 kg m^2")
    cg_tolerance: Positive | None = Field(None, description="default 0.01 of sqrt(trace/mass); thesis 0.05 m")
    mass_tolerance: Positive | None = Field(None, description="default 0.01 of the mass; thesis 0.1 kg")


class Drift(Section):
    """Random walk per quantity, one sigma per sqrt(s), in the quantity's unit."""

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
