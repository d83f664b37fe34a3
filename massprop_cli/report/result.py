"""result.json and history.parquet: the models below are the schema (``massprop schema result``)."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from massprop_cli import __version__, assumptions, foreign
from massprop_cli.align import cycle_edges
from massprop_cli.analysis import Analysis, MendedAnswer
from massprop_cli.arrays import Array, median
from massprop_cli.conclude import Conclusion, Estimate, Verdict
from massprop_cli.docking import Docked
from massprop_cli.history import History
from massprop_cli.physical import nearest_consistent, physical_note
from massprop_cli.settings import effective_settings, setting_sources
from massprop_cli.vehicle import ZERO, Known, Nominal, Quantity, Vehicle

AXES = ("x", "y", "z")
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
Six = Annotated[list[float], Field(min_length=6, max_length=6)]
Matrix = list[list[float | None]]
Matrix3 = Annotated[list[Annotated[list[float | None], Field(min_length=3, max_length=3)]], Field(min_length=3, max_length=3)]
Matrix10 = Annotated[list[Annotated[list[float | None], Field(min_length=10, max_length=10)]], Field(min_length=10, max_length=10)]


class Item(BaseModel):
    """Part of a result; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid")


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


class VehicleInfo(Item):
    """The vehicle as its file states it."""

    name: str
    environment: Literal["free", "air_bearing"]
    bearing_mass_kg: float = Field(description="part of the mass, but not of CG and inertia; 0 in free flight")
    bearing_position_m: Triple
    commands: Literal["jets", "wrench"]
    jets: list[str]
    thrust_scale_sigma: float = Field(description="common relative uncertainty of all forces and torques")


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
    source: Literal["vehicle", "option", "detected"]
    detected_cycles: float | None = None
    sigma_cycles: float | None = None


class Lag(Item):
    """First-order lag of the thrust."""

    lag_s: float
    source: Literal["vehicle", "option", "detected"]
    sigma_s: float | None = None


class Conventions(Item):
    """How inertia is to be read."""

    inertia_about: Literal["cg"] = "cg"
    products_of_inertia: Literal["tensor"] = Field("tensor", description="ixy = -sum m x y, the tensor's own element")


class Expected(Item):
    """An expectation that the value was held against."""

    value: float = Field(description="in the estimate's unit, products as tensor elements")
    tolerance: float | None = Field(description="absolute, in the estimate's unit; null where it is in sigmas and there is no sigma")
    stated: str = Field(description='the tolerance as it was stated, e.g. "2 %" or "4 sigma"')
    met: bool
    difference: float | None = Field(description="estimate less expectation; null without an estimate")
    sigmas: float | None = Field(description="the difference over the estimate's sigma")


class ExpectationFile(Item):
    """What the result was held against."""

    path: str = Field(description="base name")
    sha256: str


class EstimateItem(Item):
    """One quantity: sigma is one standard deviation; null where nothing can be said."""

    value: float | None
    sigma: float | None
    unit: str
    verdict: Verdict
    final_at_s: float | None = Field(description="start of the last sustained stretch")
    reason: str
    nominal: float | None = Field(None, description="the vehicle file's CAD value, products as tensor elements; never used in the estimate")
    expected: Expected | None = None


class Physical(Item):
    """Whether a real body could have this inertia."""

    consistent: bool | None
    principal_moments: Triple | None
    note: str
    nearest_consistent: Matrix3 | None = Field(None, description="the nearest inertia that a body could have, where this is none")


class Innovations(Item):
    """Whitened innovations about the final estimate: independent standard normal where model and noise levels hold."""

    cycles: int
    nis: float = Field(description="mean normalised innovation squared of a cycle, all six channels together; 6 is expected")
    channel_variance: Six = Field(description="rate x y z, specific force x y z; 1 is expected")
    lag_one_correlation: Six = Field(description="of each channel from one cycle to the next; 0 is expected")
    lack_of_fit: Six = Field(
        [1.0] * 6,
        description="by how much too small the sigmas are that each channel gives, as what commands and motion still explain of its "
        "innovations shows; 1 where that is no more than chance",
    )


class ImpliedScale(Item):
    """The thrust, as a part of what the vehicle file states, that a mass from elsewhere implies."""

    by: str = Field(description='where the mass comes from: "known.mass" or "expected mass"')
    value: float = Field(description="thrust over stated thrust; 1 if the vehicle file is right")
    sigma: float


class PhaseItem(Item):
    """One phase's ten quantities. Matrices in the order of the estimates; body axes."""

    name: str
    start_s: float
    end_s: float
    estimates: dict[str, EstimateItem]
    covariance: Matrix10
    inertia_about_origin: Matrix3 | None
    physical: Physical
    innovations: Innovations | None
    contradiction: str = Field("", description="why log and vehicle file contradict each other in this phase; empty where they don't")
    known: dict[str, tuple[float, float]] = Field({}, description="value and sigma of quantities that were measured elsewhere and enter")
    implied_thrust_scale: ImpliedScale | None = None


class DockedObject(Item):
    """The object that was docked, from the phases before and after."""

    before: str
    after: str
    estimates: dict[str, EstimateItem]
    covariance: Matrix10
    contradiction: str = Field("", description="which of its phases is contradicted; empty where none is")
    known: dict[str, tuple[float, float]] = Field({}, description="value and sigma of quantities that were measured elsewhere and enter")


class MendedEstimate(Item):
    """One quantity as the mended log gives it."""

    value: float | None
    sigma: float | None
    unit: str
    verdict: Verdict


class MendedPhase(Item):
    """One phase as the mended log gives it."""

    name: str
    estimates: dict[str, MendedEstimate]
    contradiction: str = Field("", description="what is still contradicted once it is mended; empty where nothing is")


class Mended(Item):
    """What the log gives if a fault that a warning names is mended: beside the result, never instead of it."""

    code: str = Field(description="of the warning that names the fault")
    message: str
    settings: list[str] = Field(description="KEY=VALUE, each for one --set, that mend it")
    phases: list[MendedPhase]


class Effect(Item):
    """What an assumption does to the values of one phase."""

    phase: str
    change: dict[str, float] = Field(description="of each value, in its unit, for one step; quantities that it doesn't move are left out")
    seen_sigma: float | None = Field(
        None, description="how many sigmas the log itself would misfit for one step; below about 5 the log can't tell it; null: not at all"
    )


class Assumption(Item):
    """Something that the numbers rest on and the log can't tell, or not well."""

    code: str
    message: str
    step: str = Field(description='by how much it is varied: "1 %", "1 mm", "1 degree" or "0.1 cycles"')
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
    conventions: Conventions
    phases: list[PhaseItem]
    docked_object: DockedObject | None
    expectations: ExpectationFile | None = None
    mended: list[Mended] = []
    assumptions: list[Assumption] = []
    warnings: list[WarningItem]


def result(analysis: Analysis) -> Result:
    """The result of an analysis."""
    log = analysis.log
    start, length = cycle_edges(log, slice(0, log.cycles))
    return Result(
        schema="massprop/result/1",
        provenance=Provenance(
            massprop=__version__,
            input_sha256=log.sha256,
            vehicle_sha256=analysis.source.sha256,
            map_sha256=log.made.sha256 if log.made else None,
            settings=effective_settings(analysis),
            setting_sources=setting_sources(analysis),
            versions={"python": platform.python_version(), "numpy": np.__version__},
        ),
        vehicle=_vehicle(analysis),
        log=LogInfo(
            path=log.path.name,
            rows=log.rows,
            cycles=log.cycles,
            duration_s=float(start[-1] + length[-1] - start[0]),
            cycle_s=median(length),
            mapped=list(log.made.said) if log.made else [],
        ),
        delay=_delay(analysis),
        lag=_lag(analysis),
        conventions=Conventions(),
        phases=[
            _phase(conclusion, analysis.vehicle, history, factors)
            for conclusion, history, factors in zip(analysis.conclusions, analysis.settled, analysis.lack_of_fit, strict=True)
        ],
        docked_object=_docked(analysis.docked, analysis.vehicle),
        mended=[_mended(answer) for answer in analysis.mended],
        assumptions=[_assumption(assumption) for assumption in analysis.assumptions],
        warnings=[WarningItem(code=notice.code, message=notice.message) for notice in analysis.notices],
    )


def _vehicle(analysis: Analysis) -> VehicleInfo:
    used = analysis.vehicle
    return VehicleInfo(
        name=used.name,
        environment=used.environment.kind,
        bearing_mass_kg=used.environment.bearing_mass_kg if used.on_air_bearing else 0.0,
        bearing_position_m=list(used.environment.bearing_position_m if used.on_air_bearing else ZERO),
        commands=analysis.log.command_kind,
        jets=[jet.name for jet in used.jets] if analysis.log.command_kind == "jets" else [],
        thrust_scale_sigma=used.thrust.scale_sigma,
    )


def _delay(analysis: Analysis) -> Delay:
    automatic = analysis.source.vehicle.cycle.command_delay_cycles == "auto"
    found = analysis.detected
    told = found is not None and found.sigma.delay > 0
    return Delay(
        cycles=analysis.timing.delay,
        source="detected" if automatic else "option" if _overridden(analysis, "cycle.command_delay_cycles") else "vehicle",
        detected_cycles=found.at.delay if found is not None and told else None,
        sigma_cycles=found.sigma.delay if found is not None and told else None,
    )


def _lag(analysis: Analysis) -> Lag:
    automatic = analysis.source.vehicle.thrust.lag_s == "auto"
    found, period = analysis.detected, analysis.source.vehicle.cycle.period_s
    return Lag(
        lag_s=analysis.vehicle.thrust.stated_lag_s,
        source="detected" if automatic else "option" if _overridden(analysis, "thrust.lag_s") else "vehicle",
        sigma_s=found.sigma.lag * period if automatic and found is not None else None,
    )


def _overridden(analysis: Analysis, key: str) -> bool:
    return any(assignment.startswith(f"{key}=") for assignment in analysis.assignments)


def _phase(conclusion: Conclusion, used: Vehicle, settled: History, factors: Array) -> PhaseItem:
    about_origin = conclusion.inertia_about_origin
    moments = conclusion.principal_moments
    note = physical_note(conclusion)
    known = bool(np.isfinite(moments).all())
    return PhaseItem(
        name=conclusion.phase.name,
        start_s=conclusion.phase.start_s,
        end_s=conclusion.phase.end_s,
        estimates=_estimates(conclusion.estimates, used.nominal),
        covariance=_matrix(conclusion.covariance),
        inertia_about_origin=_matrix(about_origin) if np.isfinite(about_origin).all() else None,
        physical=Physical(
            consistent=not note if known else None,
            principal_moments=[float(m) for m in moments] if known else None,
            note=note,
            nearest_consistent=_matrix(nearest_consistent(conclusion.inertia)) if note else None,
        ),
        innovations=_innovations(settled, factors),
        contradiction=conclusion.contradiction,
        known=_known(used.in_phase(conclusion.phase).known),
        implied_thrust_scale=_implied(conclusion, used.in_phase(conclusion.phase).known.get("mass")),
    )


def _known(known: Mapping[Quantity, Known]) -> dict[str, tuple[float, float]]:
    return {name: (quantity.value, quantity.sigma) for name, quantity in known.items()}


def _implied(conclusion: Conclusion, known: Known | None) -> ImpliedScale | None:
    """A known mass over the one that the log gives by itself."""
    mass, variance = float(conclusion.bare[0][9]), float(conclusion.bare[1][9, 9])
    if known is None or not np.isfinite(mass + variance) or mass <= 0:
        return None
    value = known.value / mass
    return ImpliedScale(by="known.mass", value=value, sigma=value * float(np.hypot(known.sigma / known.value, np.sqrt(variance) / mass)))


def _mended(answer: MendedAnswer) -> Mended:
    phases = [
        MendedPhase(
            name=conclusion.phase.name,
            estimates={
                name: MendedEstimate(value=e.value, sigma=e.sigma, unit=e.unit, verdict=e.verdict)
                for name, e in conclusion.estimates.items()
            },
            contradiction=conclusion.contradiction,
        )
        for conclusion in answer.conclusions
    ]
    notice = answer.fault.notice
    return Mended(code=notice.code, message=notice.message, settings=list(answer.settings), phases=phases)


def _assumption(found: assumptions.Assumption) -> Assumption:
    effects = [Effect(phase=e.phase, change=e.change, seen_sigma=e.seen_sigma) for e in found.effects]
    return Assumption(code=found.code, message=found.message, step=found.step, stated=found.stated, effects=effects)


def _innovations(history: History, factors: Array) -> Innovations | None:
    z = history.normalised[np.isfinite(history.normalised).all(1)]
    if len(z) < 3:
        return None
    variance = (z**2).mean(0)
    return Innovations(
        cycles=len(z),
        nis=float((z**2).sum(1).mean()),
        channel_variance=[float(v) for v in variance],
        lag_one_correlation=[float(c) for c in (z[1:] * z[:-1]).mean(0) / np.maximum(variance, 1e-300)],
        lack_of_fit=[float(factor) for factor in factors],
    )


def _estimates(estimates: dict[str, Estimate], nominal: Nominal | None = None) -> dict[str, EstimateItem]:
    return {
        name: EstimateItem(
            value=e.value,
            sigma=e.sigma,
            unit=e.unit,
            verdict=e.verdict,
            final_at_s=e.final_at_s,
            reason=e.reason,
            nominal=nominal.value(name) if nominal else None,
        )
        for name, e in estimates.items()
    }


def _docked(found: Docked | None, used: Vehicle) -> DockedObject | None:
    if found is None:
        return None
    return DockedObject(
        before=found.before,
        after=found.after,
        estimates=_estimates(found.estimates),
        covariance=_matrix(found.covariance),
        contradiction=found.contradiction,
        known=_known(used.docking.known if used.docking else {}),
    )


def _matrix(values: Array) -> Matrix:
    return [[float(cell) if np.isfinite(cell) else None for cell in row] for row in values]


def to_json(found: Result) -> str:
    """Canonical text: same result, same bytes. NaN and infinity can't appear."""
    return foreign.json(json.dumps(found.model_dump(by_alias=True, mode="json"), indent=1, allow_nan=False, ensure_ascii=False)) + "\n"


def schema() -> dict[str, Any]:
    """JSON Schema of result.json."""
    return Result.model_json_schema(by_alias=True)
