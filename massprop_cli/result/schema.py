"""result.json: the models below are the schema (``massprop schema result``)."""

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
    """Part of a result; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", defer_build=True)


class SparseItem(Item):
    """Part of a result without some of its keys where they hold nothing."""

    ABSENT: ClassVar[tuple[str, ...]]

    @model_serializer(mode="wrap")
    def _without_nothing(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in handler(self).items() if key not in self.ABSENT or value not in (None, [], {})}


class Provenance(Item):
    """What produced the result and from what."""

    massprop: str
    input_sha256: str
    vehicle_sha256: str
    map_sha256: str | None = Field(None, description="of the map file, where one made the log of another recording")
    settings: dict[str, Any] = Field(description="dotted keys; given back with --set they reproduce the result")
    setting_sources: dict[str, Literal["option", "vehicle file", "default", "log"]] = Field(
        {}, description="where each setting came from; log: found in a first pass over the log"
    )
    versions: dict[str, str]

    @property
    def method(self) -> str:
        """The estimator's."""
        return str(self.settings.get("estimator.method", "default"))


class VehicleInfo(SparseItem):
    """The vehicle as its file states it."""

    ABSENT = ("rotors", "wheels", "gravity_m_s2", "initial_up", "ballast")

    name: str
    environment: EnvironmentKind
    bearing_mass_kg: float = Field(description="part of the mass, but not of CG and inertia; 0 in free flight")
    bearing_position_m: Triple
    commands: Literal["jets", "wrench", "rotors"]
    jets: list[str]
    thrust_scale_sigma: float = Field(
        description="common relative uncertainty of all forces and torques; 0 beside wheels, which show it as far as the covariance says"
    )
    rotors: list[str] = Field([], description="absent where there are none")
    wheels: list[str] = Field(
        [],
        description="what stores momentum that counts, by its name: a wheel, say; absent where there is none",
    )
    gravity_m_s2: float | None = Field(None, description="on a fixed pedestal; absent elsewhere")
    initial_up: Triple | None = Field(
        None, description="unit vector up in body axes as the log begins, on a fixed pedestal; absent elsewhere"
    )
    ballast: list[Ballast] = Field([], description="the vehicle file's; absent where there is none")


class LogInfo(Item):
    """The log that was read."""

    path: str
    rows: int
    cycles: int
    duration_s: float
    cycle_s: float
    mapped: list[str] = Field([], description="what a map file did to make the log: resampled, integrated, turned")


class Delay(Item):
    """Between the start of the cycle that issued a command and its execution."""

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
    """Cutoff and latency of a sensor, as far as the log shows them beyond what the vehicle file states."""

    sensor: Literal["gyro", "accelerometer", "attitude"]
    cutoff_hz: float | None = Field(description="null where it was not looked for")
    cutoff_sigma_hz: float | None
    latency_s: float | None = Field(description="by which values are later than their time stamps, beyond the low-pass; null likewise")
    latency_sigma_s: float | None


class Conventions(Item):
    """How inertia is to be read."""

    inertia_about: Literal["cg"] = "cg"
    products_of_inertia: Literal["tensor"] = Field("tensor", description="ixy = -sum m x y, the tensor's own element")


class Expected(Item):
    """An expectation that the value was tested against."""

    value: float = Field(description="in the estimate's unit, products as tensor elements")
    tolerance: float | None = Field(description="absolute, in the estimate's unit; null where it is in sigmas and there is no sigma")
    stated: str = Field(description='the tolerance as it was stated, e.g. "2 %" or "4 sigma"')
    met: bool
    difference: float | None = Field(description="estimate less expectation; null without an estimate")
    sigmas: float | None = Field(description="the difference over the estimate's sigma")


class ExpectationFile(Item):
    """What the result was tested against."""

    path: str = Field(description="base name")
    sha256: str


class EstimateItem(SparseItem):
    """One quantity: sigma is one standard deviation; null where nothing can be said."""

    ABSENT = ("segment_sigma",)

    value: float | None
    sigma: float | None
    unit: str
    verdict: Verdict
    final_at_s: float | None = Field(description="start of the last sustained stretch")
    reason: str
    reason_code: VerdictReason | Literal[""] = Field("", description="stable name of the reason; empty in results of versions without it")
    nominal: float | None = Field(None, description="the vehicle file's CAD value, products as tensor elements; never used in the estimate")
    expected: Expected | None = None
    segment_sigma: float | None = Field(
        None, description="by the scatter of the phase's segments, without stated noise; absent without estimator.cross_validate"
    )


class Physical(Item):
    """Whether a real body could have this inertia."""

    consistent: bool | None = Field(description="false where its sigmas do not allow it; null unless the whole inertia is informed")
    principal_moments: Triple | None
    note: str
    nearest_consistent: Matrix3 | None = Field(None, description="the nearest inertia that a body could have, where the values are none")


class Innovations(Item):
    """Whitened innovations about the final estimate: independent standard normal where model and noise levels hold."""

    cycles: int
    nis: float = Field(description="mean normalised innovation squared of a cycle, all channels together; as many are expected")
    channel_variance: SixRead = Field(description="rate x y z, specific force x y z; 1 is expected; null: the log has no such channel")
    lag_one_correlation: SixRead = Field(description="of each channel from one cycle to the next; 0 is expected; null likewise")
    lack_of_fit: Six = Field(
        [1.0] * 6,
        description="by how much too small the sigmas are that each channel gives, as what commands and motion still explain of its "
        "innovations shows; 1 where that is no more than chance",
    )


class DiscrepancyItem(Item):
    """What the sigmas of a log include that does not fit and whose cause has no name."""

    scale: float = Field(description="common size of all error parameters as the log shows it, over their usual ones; at least 0.3 is used")
    thrust_scale_sigma: float = Field(
        description="relative, of an error common to all thrust: what the covariance has of it beyond what is stated"
    )
    behaves_like: list[str] = Field(description="error parameters that stand out, with their size: likely causes, none of them proven")
    shares: dict[str, list[float | None]] = Field(
        description="by family of error parameters, of noise, and of what no error parameter explains: the sigma of each of the ten "
        "quantities that it makes by itself, in their units; null where that can't be said"
    )


BY_OBJECT = "added object"
"""Of an implied scale: of a joint result."""


THRUST, MOMENTUM = "thrust", "momentum of wheels"
"""What an implied scale is of."""


class ImpliedScale(Item):
    """The thrust, as a part of what the vehicle file states, that a mass from elsewhere implies; or the momentum of wheels."""

    by: str = Field(description='where the mass comes from: "known.mass", "expected mass" or "added object"')
    of: str = Field(
        THRUST,
        description='"thrust"; "momentum of wheels" where there are no jets, or wheels tell the scale of the thrust (thrust.scale_sigma); '
        "or either, where the result does not say which",
    )
    value: float = Field(description="over what is stated; 1 if the vehicle file is right")
    sigma: float


def implied_of(vehicle: VehicleInfo) -> str:
    """The scale that a mass from elsewhere determines, as far as a result says."""
    return f"{THRUST}, or {MOMENTUM}" if vehicle.wheels and vehicle.jets else MOMENTUM if vehicle.wheels else THRUST


class SegmentItem(Item):
    """A segment of time predicted by the estimate from all other segments of its phase."""

    start_s: float
    end_s: float
    chi_square: float
    freedom: int
    p: float = Field(description="chance of as large a difference")


class CrossValidationItem(Item):
    """Whether each segment of a phase is predicted by all others."""

    level: float = Field(description="confidence level, of estimator.cross_validate")
    p: float = Field(description="chance of a segment that is predicted as badly as the worst one, all segments counted (Bonferroni)")
    passes: bool = Field(description="p is above 1 - level")
    segments: list[SegmentItem]


class PhaseItem(SparseItem):
    """One phase's ten quantities. Matrices in the order of the estimates; body axes."""

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
        description="on a bearing or fixed pedestal: inertia about that point (ixx ... izz, kg m^2) and first moment about it, mass "
        "(without the bearing's) times offset of the CG (moment_x, moment_y, moment_z, kg m), body axes; absent elsewhere",
    )
    about_pivot_covariance: Matrix9 | None = Field(None, description="of about_pivot, in its order; absent with it")
    contradiction: str = Field("", description="why log and vehicle file contradict each other in this phase; empty where they don't")
    known: dict[str, tuple[float, float]] = Field({}, description="value and sigma of quantities that were measured elsewhere and enter")
    implied_thrust_scale: ImpliedScale | None = None
    discrepancy: DiscrepancyItem | None = Field(None, description="absent where the log fits")
    cross_validation: CrossValidationItem | None = Field(None, description="absent without estimator.cross_validate")
    alike: list[float] = Field(
        [],
        description="of a combined result: the part of each sigma that its logs may have in common, beside the thrust's scale and what is "
        "known, and that more logs don't make smaller; on a pedestal of about_pivot; absent where there is none",
    )


class DockedObject(Item):
    """The object that was docked, from the phases before and after."""

    before: str
    after: str
    estimates: dict[str, EstimateItem]
    covariance: Matrix10
    contradiction: str = Field("", description="which of its phases is contradicted; empty where none is")
    known: dict[str, tuple[float, float]] = Field({}, description="value and sigma of quantities that were measured elsewhere and enter")


class MendedEstimate(Item):
    """One quantity as the corrected log gives it."""

    value: float | None
    sigma: float | None
    unit: str
    verdict: Verdict


class MendedPhase(SparseItem):
    """One phase as the corrected log gives it."""

    ABSENT = ("about_pivot",)

    name: str
    estimates: dict[str, MendedEstimate]
    about_pivot: dict[str, MendedEstimate] = Field({}, description="as that of a phase; absent where there is none")
    contradiction: str = Field("", description="what is still contradicted once it is corrected; empty where nothing is")


class Mended(Item):
    """What the log gives if a fault that a warning names is corrected: beside the result, never instead of it."""

    code: str = Field(description="of the warning that names the fault")
    message: str
    settings: list[str] = Field(description="KEY=VALUE, each for one --set, that correct it; with how uncertain what was found is")
    whole: bool = Field(
        True, description="whether these settings alone give these estimates; false: the log's columns have to be corrected, too"
    )
    phases: list[MendedPhase]


class Effect(Item):
    """What an assumption does to the values of one phase."""

    phase: str
    change: dict[str, float] = Field(description="of each value, in its unit, for one step; quantities that it doesn't move are left out")
    seen_sigma: float | None = Field(
        None, description="how many sigmas the log itself would misfit for one step; below about 5 the log cannot show it; null: not at all"
    )


class Assumption(Item):
    """Something that the numbers rest on and the log can't tell, or not well."""

    code: str
    message: str
    step: str = Field(description='by how much it is varied: "1 %", "1 mm along X", "1 degree about X" or "0.1 cycles"')
    stated: bool = Field(description="whether the vehicle file states it; false: a default")
    effects: list[Effect]


class WarningItem(Item):
    """Something a reader must know."""

    code: str
    message: str


class Result(Item):
    """The whole of result.json."""

    schema_: Literal["massprop/result/1"] = Field("massprop/result/1", alias="schema")
    provenance: Provenance
    vehicle: VehicleInfo
    log: LogInfo
    delay: Delay
    lag: Lag
    low_passes: list[DetectedLowPass] = Field([], description="of sensors whose cutoff or latency the log shows")
    conventions: Conventions
    phases: list[PhaseItem]
    docked_object: DockedObject | None
    expectations: ExpectationFile | None = None
    mended: list[Mended] = []
    assumptions: list[Assumption] = []
    warnings: list[WarningItem]
