"""Models of result.json; they are the schema (``massprop schema result``)."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer

from massprop_cli.conclude.reason import VerdictReason
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.inputs.ballast import Ballast
from massprop_cli.inputs.equipment import EnvironmentKind

AXES = ("x", "y", "z")
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
Six = Annotated[list[float], Field(min_length=6, max_length=6)]
SixRead = Annotated[list[float | None], Field(min_length=6, max_length=6)]
Matrix = list[list[float | None]]
Matrix3 = Annotated[list[Annotated[list[float | None], Field(min_length=3, max_length=3)]], Field(min_length=3, max_length=3)]
Matrix9 = Annotated[list[Annotated[list[float | None], Field(min_length=9, max_length=9)]], Field(min_length=9, max_length=9)]
Matrix10 = Annotated[list[Annotated[list[float | None], Field(min_length=10, max_length=10)]], Field(min_length=10, max_length=10)]


class Item(BaseModel):
    """Part of a result. Refuses unknown keys."""

    model_config = ConfigDict(extra="forbid", defer_build=True)


class SparseItem(Item):
    """Part of a result that leaves out empty values of the keys in ``ABSENT``."""

    ABSENT: ClassVar[tuple[str, ...]]

    @model_serializer(mode="wrap")
    def _without_nothing(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in handler(self).items() if key not in self.ABSENT or value not in (None, [], {})}


class Provenance(Item):
    """Sources of the result: program, inputs and settings."""

    massprop: str
    input_sha256: str
    vehicle_sha256: str
    map_sha256: str | None = Field(None, description="digest of the map file, if a map converted another recording")
    settings: dict[str, Any] = Field(description="settings by dotted key; with --set they reproduce the result")
    setting_sources: dict[str, Literal["option", "vehicle file", "default", "log"]] = Field(
        {}, description="source of each setting; log: estimated in a first pass over the log"
    )
    versions: dict[str, str]

    @property
    def method(self) -> str:
        """Estimation method."""
        return str(self.settings.get("estimator.method", "default"))


class VehicleInfo(SparseItem):
    """Vehicle as stated in its file."""

    ABSENT = ("rotors", "wheels", "gravity_m_s2", "initial_up", "ballast")

    name: str
    environment: EnvironmentKind
    bearing_mass_kg: float = Field(description="part of the mass that is not part of CG and inertia; 0 in free flight")
    bearing_position_m: Triple
    commands: Literal["jets", "wrench", "rotors"]
    jets: list[str]
    thrust_scale_sigma: float = Field(
        description=(
            "relative uncertainty common to all forces and torques; with wheels 0, because the log then determines the "
            "thrust scale with the uncertainty that the covariance includes"
        )
    )
    rotors: list[str] = Field([], description="names of the rotors; absent without any")
    wheels: list[str] = Field(
        [],
        description="names of the momentum devices, such as wheels; absent without any",
    )
    gravity_m_s2: float | None = Field(None, description="gravity on a fixed pedestal; absent in other environments")
    initial_up: Triple | None = Field(
        None, description="unit vector up in body axes at the start of the log, on a fixed pedestal; absent in other environments"
    )
    ballast: list[Ballast] = Field([], description="ballast of the vehicle file; absent without any")


class LogInfo(Item):
    """Log that was read."""

    path: str
    rows: int
    cycles: int
    duration_s: float
    cycle_s: float
    mapped: list[str] = Field([], description="conversions by a map file: resampling, integration, rotation")


class Delay(Item):
    """Delay from the start of the cycle that issues a command to its execution."""

    cycles: float
    source: Literal["vehicle", "option", "detected", "default"]
    detected_cycles: float | None = None
    sigma_cycles: float | None = None


class Lag(Item):
    """First-order lag of the thrust."""

    lag_s: float
    source: Literal["vehicle", "option", "detected", "default"]
    sigma_s: float | None = None


class DetectedLowPass(Item):
    """Cutoff and latency of a sensor that the log shows, in addition to those of the vehicle file."""

    sensor: Literal["gyro", "accelerometer", "attitude"]
    cutoff_hz: float | None = Field(description="cutoff frequency; null: not estimated")
    cutoff_sigma_hz: float | None
    latency_s: float | None = Field(description="delay of values after their time stamps beyond that of the low-pass; null: not estimated")
    latency_sigma_s: float | None


class Conventions(Item):
    """Conventions of inertia."""

    inertia_about: Literal["cg"] = "cg"
    products_of_inertia: Literal["tensor"] = Field("tensor", description="ixy = -sum m x y, the element of the tensor")


class Expected(Item):
    """Expected value and the test against it."""

    value: float = Field(description="expected value in the estimate's unit, products as tensor elements")
    tolerance: float | None = Field(description="absolute tolerance in the estimate's unit; null: it is in sigmas and there is no sigma")
    stated: str = Field(description='tolerance as stated, such as "2 %" or "4 sigma"')
    met: bool
    difference: float | None = Field(description="estimate minus expected value; null without an estimate")
    sigmas: float | None = Field(description="difference over the estimate's sigma")


class ExpectationFile(Item):
    """File with expected values."""

    path: str = Field(description="base name of the file")
    sha256: str


class EstimateItem(SparseItem):
    """One quantity. Sigma is one standard deviation; null values are not estimated."""

    ABSENT = ("segment_sigma",)

    value: float | None
    sigma: float | None
    unit: str
    verdict: Verdict
    final_at_s: float | None = Field(description="start of the last run of updates within tolerance")
    reason: str
    reason_code: VerdictReason | Literal[""] = Field("", description="stable code of the reason; empty in results of older versions")
    nominal: float | None = Field(None, description="CAD value of the vehicle file, products as tensor elements; not used in the estimate")
    expected: Expected | None = None
    segment_sigma: float | None = Field(
        None, description="sigma from the scatter of the phase's segments, without stated noise; absent without estimator.cross_validate"
    )


class Physical(Item):
    """Whether a real body can have this inertia."""

    consistent: bool | None = Field(description="false: not even within the sigmas; null: not all six elements are informed")
    principal_moments: Triple | None
    note: str
    nearest_consistent: Matrix3 | None = Field(None, description="nearest inertia of a real body, if the estimate is not one")


class Innovations(Item):
    """Whitened innovations about the final estimate; independent and standard normal if model and noise levels are right."""

    cycles: int
    nis: float = Field(
        description="mean normalised innovation squared per cycle over all channels; its expected value is the number of channels"
    )
    channel_variance: SixRead = Field(
        description="variance of rate x y z and specific force x y z; expected: 1; null: no such channel in the log"
    )
    lag_one_correlation: SixRead = Field(
        description="correlation of each channel between successive cycles; expected: 0; null: no such channel in the log"
    )
    lack_of_fit: Six = Field(
        [1.0] * 6,
        description=(
            "factor by which the sigmas from each channel are too small, from the part of its innovations that commands and"
            " motion explain; 1: not significant"
        ),
    )


class DiscrepancyItem(Item):
    """Unexplained misfit of a log that its sigmas include."""

    scale: float = Field(
        description="size of all error parameters estimated from the log, over their usual size; massprop uses at least 0.3"
    )
    thrust_scale_sigma: float = Field(description="relative error common to all thrust in the covariance, in addition to the stated one")
    behaves_like: list[str] = Field(description="error parameters with significant size: probable causes, not proven")
    shares: dict[str, list[float | None]] = Field(
        description=(
            "sigma of each of the ten quantities from each family of error parameters, from noise, and from unexplained "
            "residuals, in their units; null: not estimated"
        )
    )


BY_OBJECT = "added object"
"""Source of an implied scale: the added object of a combined result."""


THRUST, MOMENTUM = "thrust", "momentum of wheels"
"""Possible subjects of an implied scale."""


class ImpliedScale(Item):
    """Scale of the thrust, or of the wheels' momentum, over the stated one, that a mass from another source implies."""

    by: str = Field(description='source of the mass: "known.mass", "expected mass" or "added object"')
    of: str = Field(
        THRUST,
        description=(
            '"thrust"; "momentum of wheels" without jets or if wheels determine the thrust scale (thrust.scale_sigma); or '
            "both, if the result does not decide"
        ),
    )
    value: float = Field(description="scale over the stated one; 1 if the vehicle file is right")
    sigma: float


def implied_of(vehicle: VehicleInfo) -> str:
    """Subject of the scale that a mass from another source determines, as far as the result decides."""
    return f"{THRUST}, or {MOMENTUM}" if vehicle.wheels and vehicle.jets else MOMENTUM if vehicle.wheels else THRUST


class SegmentItem(Item):
    """Prediction of a time segment by the estimate from all other segments of its phase."""

    start_s: float
    end_s: float
    chi_square: float
    freedom: int
    p: float = Field(description="probability of a difference at least this large")


class CrossValidationItem(Item):
    """Test whether the other segments of a phase predict each segment."""

    level: float = Field(description="confidence level of estimator.cross_validate")
    p: float = Field(description="p-value of the worst segment with Bonferroni correction for the number of segments")
    passes: bool = Field(description="whether p is above 1 - level")
    segments: list[SegmentItem]


class PhaseItem(SparseItem):
    """Ten quantities of one phase, body axes. Matrices are in the order of the estimates."""

    ABSENT = ("about_pivot", "about_pivot_covariance", "discrepancy", "cross_validation", "alike")

    name: str
    start_s: float
    end_s: float
    estimates: dict[str, EstimateItem]
    covariance: Matrix10
    inertia_about_origin: Matrix3 | None
    physical: Physical
    innovations: Innovations | None
    about_pivot: dict[str, EstimateItem] = Field(
        {},
        description=(
            "on an air bearing or fixed pedestal: inertia about the pivot (ixx ... izz, kg m^2), and first moment about it,"
            " mass (without the bearing's) times CG offset (moment_x, moment_y, moment_z, kg m), body axes; absent in other"
            " environments"
        ),
    )
    about_pivot_covariance: Matrix9 | None = Field(None, description="covariance of about_pivot, in its order; absent with it")
    contradiction: str = Field("", description="reason for a contradiction between log and vehicle file in this phase; empty without one")
    known: dict[str, tuple[float, float]] = Field(
        {}, description="value and sigma of quantities from other measurements that the estimate uses"
    )
    implied_thrust_scale: ImpliedScale | None = None
    discrepancy: DiscrepancyItem | None = Field(None, description="absent if the log fits")
    cross_validation: CrossValidationItem | None = Field(None, description="absent without estimator.cross_validate")
    alike: list[float] = Field(
        [],
        description=(
            "fraction of each sigma in a combined result from errors that its logs may share, in addition to thrust scale "
            "and known values; more logs do not reduce it; for about_pivot on a pedestal; absent without any"
        ),
    )


class DockedObject(Item):
    """Docked object, from the phases before and after docking."""

    before: str
    after: str
    estimates: dict[str, EstimateItem]
    covariance: Matrix10
    contradiction: str = Field("", description="phase with a contradiction; empty without one")
    known: dict[str, tuple[float, float]] = Field(
        {}, description="value and sigma of quantities from other measurements that the estimate uses"
    )


class MendedEstimate(Item):
    """One quantity of the corrected log."""

    value: float | None
    sigma: float | None
    unit: str
    verdict: Verdict


class MendedPhase(SparseItem):
    """One phase of the corrected log."""

    ABSENT = ("about_pivot",)

    name: str
    estimates: dict[str, MendedEstimate]
    about_pivot: dict[str, MendedEstimate] = Field({}, description="as about_pivot of a phase; absent without any")
    contradiction: str = Field("", description="reason for a contradiction that remains after the correction; empty without one")


class Mended(Item):
    """Estimates after correction of a fault that a warning names. The result itself is not changed."""

    code: str = Field(description="code of the warning that names the fault")
    message: str
    settings: list[str] = Field(
        description="KEY=VALUE assignments for --set that correct the fault, with the uncertainty of the correction"
    )
    whole: bool = Field(
        True, description="whether these settings alone give these estimates; false: columns of the log need a correction, too"
    )
    phases: list[MendedPhase]


class Effect(Item):
    """Effect of an assumption on the values of one phase."""

    phase: str
    change: dict[str, float] = Field(description="change of each value, in its unit, for one step; without unchanged quantities")
    seen_sigma: float | None = Field(
        None, description="misfit of the log for one step, in sigmas; below about 5 the log cannot show it; null: none"
    )


class Assumption(Item):
    """Assumption of the estimate that the log cannot test, or not well."""

    code: str
    message: str
    step: str = Field(description='size of its variation: "1 %", "1 mm along X", "1 degree about X" or "0.1 cycles"')
    stated: bool = Field(description="whether the vehicle file states it; false: default")
    effects: list[Effect]


class WarningItem(Item):
    """Warning about the result."""

    code: str
    message: str


class Result(Item):
    """Document result.json."""

    schema_: Literal["massprop/result/1"] = Field("massprop/result/1", alias="schema")
    provenance: Provenance
    vehicle: VehicleInfo
    log: LogInfo
    delay: Delay
    lag: Lag
    low_passes: list[DetectedLowPass] = Field([], description="sensors whose cutoff or latency the log shows")
    conventions: Conventions
    phases: list[PhaseItem]
    docked_object: DockedObject | None
    expectations: ExpectationFile | None = None
    mended: list[Mended] = []
    assumptions: list[Assumption] = []
    warnings: list[WarningItem]
