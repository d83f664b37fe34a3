"""result.json and history.parquet: the models below are the schema (``massprop schema result``)."""

from __future__ import annotations

import json
import platform
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from massprop_cli import QUANTITIES, __version__, arrow
from massprop_cli.analysis import Analysis, effective_settings, nearest_consistent, physical_note
from massprop_cli.arrays import Array
from massprop_cli.conclude import Conclusion, Estimate, Verdict
from massprop_cli.docking import Docked
from massprop_cli.history import History
from massprop_cli.vehicle import Nominal

AXES = ("x", "y", "z")


class Item(BaseModel):
    """Part of a result; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid")


class Provenance(Item):
    """What produced the result and from what."""

    massprop: str
    input_sha256: str
    vehicle_sha256: str
    settings: dict[str, Any] = Field(description="dotted keys; given back with --set they reproduce the result")
    versions: dict[str, str]


class LogInfo(Item):
    """The log that was read."""

    path: str
    rows: int
    cycles: int
    duration_s: float
    cycle_s: float


class Delay(Item):
    """Between the start of the cycle that issued a command and its execution."""

    cycles: float
    source: Literal["vehicle", "option", "detected"]
    detected_cycles: float | None = None
    sigma_cycles: float | None = None


class Conventions(Item):
    """How inertia is to be read."""

    inertia_about: Literal["cg"] = "cg"
    products_of_inertia: Literal["tensor"] = Field("tensor", description="ixy = -sum m x y, the tensor's own element")


class EstimateItem(Item):
    """One quantity: sigma is one standard deviation; null where nothing can be said."""

    value: float | None
    sigma: float | None
    unit: str
    verdict: Verdict
    final_at_s: float | None = Field(description="start of the last sustained stretch")
    reason: str
    nominal: float | None = Field(None, description="the vehicle file's CAD value, products as tensor elements; never used in the estimate")


class Physical(Item):
    """Whether a real body could have this inertia."""

    consistent: bool | None
    principal_moments: list[float] | None
    note: str
    nearest_consistent: list[list[float | None]] | None = Field(
        None, description="the nearest inertia that a body could have, where this is none"
    )


Matrix = list[list[float | None]]


class Innovations(Item):
    """Whitened innovations about the final estimate: independent standard normal where model and noise levels hold."""

    cycles: int
    nis: float = Field(description="mean normalised innovation squared of a cycle, all six channels together; 6 is expected")
    channel_variance: list[float] = Field(description="rate x y z, specific force x y z; 1 is expected")
    lag_one_correlation: list[float] = Field(description="of each channel from one cycle to the next; 0 is expected")


class PhaseItem(Item):
    """One phase's ten quantities. Matrices in the order of the estimates; body axes."""

    name: str
    start_s: float
    end_s: float
    estimates: dict[str, EstimateItem]
    covariance: Matrix
    inertia_about_origin: Matrix | None
    physical: Physical
    innovations: Innovations | None


class DockedObject(Item):
    """The object that was docked, from the phases before and after."""

    before: str
    after: str
    estimates: dict[str, EstimateItem]
    covariance: Matrix


class WarningItem(Item):
    """Something a reader must know."""

    code: str
    message: str


class Result(Item):
    """The whole of result.json."""

    schema_: Literal["massprop/result/1"] = Field("massprop/result/1", alias="schema")
    provenance: Provenance
    log: LogInfo
    delay: Delay
    conventions: Conventions
    phases: list[PhaseItem]
    docked_object: DockedObject | None
    warnings: list[WarningItem]


def result(analysis: Analysis) -> Result:
    """The result of an analysis."""
    log, aligned = analysis.log, analysis.aligned
    return Result(
        schema="massprop/result/1",
        provenance=Provenance(
            massprop=__version__,
            input_sha256=log.sha256,
            vehicle_sha256=analysis.source.sha256,
            settings=effective_settings(analysis),
            versions={"python": platform.python_version(), "numpy": np.__version__},
        ),
        log=LogInfo(
            path=log.path.name,
            rows=log.rows,
            cycles=log.cycles,
            duration_s=float(aligned.end_s[-1] - aligned.start_s[0]),
            cycle_s=float(np.median(aligned.duration_s)),
        ),
        delay=_delay(analysis),
        conventions=Conventions(),
        phases=[
            _phase(conclusion, analysis.vehicle.nominal, history)
            for conclusion, history in zip(analysis.conclusions, analysis.settled, strict=True)
        ],
        docked_object=_docked(analysis.docked),
        warnings=[WarningItem(code=notice.code, message=notice.message) for notice in analysis.notices],
    )


def _delay(analysis: Analysis) -> Delay:
    automatic = analysis.source.vehicle.cycle.command_delay_cycles == "auto"
    found = analysis.detected_delay
    return Delay(
        cycles=analysis.delay_cycles,
        source="detected" if automatic else "option" if _delay_overridden(analysis) else "vehicle",
        detected_cycles=None if found is None else found.cycles,
        sigma_cycles=None if found is None else found.sigma,
    )


def _delay_overridden(analysis: Analysis) -> bool:
    return any(assignment.startswith("cycle.command_delay_cycles=") for assignment in analysis.assignments)


def _phase(conclusion: Conclusion, nominal: Nominal, settled: History) -> PhaseItem:
    about_origin = conclusion.inertia_about_origin
    moments = conclusion.principal_moments
    note = physical_note(conclusion)
    known = bool(np.isfinite(moments).all())
    return PhaseItem(
        name=conclusion.phase.name,
        start_s=conclusion.phase.start_s,
        end_s=conclusion.phase.end_s,
        estimates=_estimates(conclusion.estimates, nominal),
        covariance=_matrix(conclusion.covariance),
        inertia_about_origin=_matrix(about_origin) if np.isfinite(about_origin).all() else None,
        physical=Physical(
            consistent=not note if known else None,
            principal_moments=[float(m) for m in moments] if known else None,
            note=note,
            nearest_consistent=_matrix(nearest_consistent(conclusion.inertia)) if note else None,
        ),
        innovations=_innovations(settled),
    )


def _innovations(history: History) -> Innovations | None:
    z = history.normalised[np.isfinite(history.normalised).all(1)]
    if len(z) < 3:
        return None
    variance = (z**2).mean(0)
    return Innovations(
        cycles=len(z),
        nis=float((z**2).sum(1).mean()),
        channel_variance=[float(v) for v in variance],
        lag_one_correlation=[float(c) for c in (z[1:] * z[:-1]).mean(0) / np.maximum(variance, 1e-300)],
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


def _docked(found: Docked | None) -> DockedObject | None:
    if found is None:
        return None
    return DockedObject(before=found.before, after=found.after, estimates=_estimates(found.estimates), covariance=_matrix(found.covariance))


def _matrix(values: Array) -> Matrix:
    return [[float(cell) if np.isfinite(cell) else None for cell in row] for row in values]


def to_json(found: Result) -> str:
    """Canonical text: same result, same bytes. NaN and infinity can't appear."""
    return json.dumps(found.model_dump(by_alias=True, mode="json"), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def write_history(analysis: Analysis, path: Path) -> None:
    """history.parquet: one row per cycle and phase, null where nothing can be said."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    histories = analysis.histories
    columns: dict[str, Any] = {
        "phase": arrow.text([h.phase.name for h in histories for _ in h.time_s]),
        "time_s": arrow.numbers(np.concatenate([h.time_s for h in histories])),
    }
    names = (*QUANTITIES, *(f"{name}_sigma" for name in QUANTITIES))
    channels = [f"innovation_{kind}_{axis}" for kind in ("torque", "force") for axis in AXES]
    names = (*names, *channels, *(f"{name}_sigma" for name in channels))
    blocks = [np.hstack([h.values, h.sigmas, h.innovation, h.innovation_sigma]) for h in histories]
    for name, values in zip(names, np.concatenate(blocks).T, strict=True):
        columns[name] = arrow.numbers(values)
    pq.write_table(pa.table(columns), path, compression="zstd")


def schema() -> dict[str, Any]:
    """JSON Schema of result.json."""
    return Result.model_json_schema(by_alias=True)
