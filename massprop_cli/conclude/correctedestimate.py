"""Estimate of a log with a named fault corrected, and the test whether the correction explains the misfit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import ITERATIONS, MAIN_PART
from massprop_cli.conclude.analysis import Analysis, CorrectedEstimate
from massprop_cli.conclude.estimated import estimated
from massprop_cli.conclude.firstfit import first_fits
from massprop_cli.conclude.judge import judged
from massprop_cli.diagnosis import NO_CAUSE, UNKNOWN, outliers
from massprop_cli.diagnosis.fault import Fault
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.errorparameters.setup import stating_as
from massprop_cli.estimate import offline
from massprop_cli.estimate.history import phases_of
from massprop_cli.estimate.noiselevels import with_noise_levels
from massprop_cli.estimate.phases import AsStated, Progress
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.prepare.stream import Stream

if TYPE_CHECKING:
    from massprop_cli.diagnosis.corrections import Correction


ESTIMATED_KEYS = (
    *("imu.gyro_noise_rad_s", "imu.accel_noise_m_s2", "imu.attitude_sigma_rad", "imu.gyro_outliers_s", "imu.accel_outliers_s"),
    *("imu.gyro_filter", "imu.accel_filter", "environment.disturbance_torque_n_m", "environment.disturbance_walk_n_m"),
    "estimator.accel_noise_scale",
)
"""Keys that an estimate sets: noise, disturbances, outliers, low-passes. Two estimates with the same values differ by the correction
only."""
INEFFECTIVE = f"{NO_CAUSE}; the nearest hypothesis leaves most of the misfit when corrected:"


def with_corrections(found: Analysis, say: Progress) -> tuple[Analysis, list[CorrectedEstimate]]:
    """The analysis with the faults whose correction is effective, and the corrected estimate of each.

    If a correction leaves most of the misfit, the cause becomes unknown.
    """
    results = [(fault.cure, _corrected(found, fault, say)) for fault in _distinct(found.faults)]
    ineffective = [correction for correction, result in results if result == "ineffective"]
    estimates = [result for _, result in results if isinstance(result, CorrectedEstimate)]
    if not ineffective:
        return found, estimates
    unproven = [fault for fault in found.faults if fault.cure in ineffective]
    unknown = f"{INEFFECTIVE} {' and '.join(dict.fromkeys(fault.notice.message for fault in unproven))}"
    faults = tuple(fault for fault in found.faults if fault not in unproven)
    return replace(found, faults=faults, unknown=unknown, notices=(Notice(UNKNOWN, unknown), *found.notices)), estimates


def _distinct(faults: Sequence[Fault]) -> list[Fault]:
    """The first fault of each correction."""
    return [fault for i, fault in enumerate(faults) if fault.cure is not None and fault.cure not in [f.cure for f in faults[:i]]]


def _corrected(found: Analysis, fault: Fault, say: Progress) -> CorrectedEstimate | Literal["ineffective"] | None:
    """Estimate with the fault corrected; None if it cannot be corrected, "ineffective" if the correction leaves most of the misfit."""
    say("estimating with the fault corrected", 1.0)
    correction = fault.cure
    if correction is None:
        return None
    settings = _settings(found, correction, (*fault.around, *fault.rivals))
    try:
        vehicle = vehiclefile.changed(found.source.vehicle, settings)
        if fault.change_s is not None:
            vehicle = _split_at(found, fault.change_s).vehicle
        log, source = correction.log(found.log), replace(found.source, vehicle=vehicle)
        first = first_fits(log, source, say)
        if _leaves_misfit(found, first[1]):
            return "ineffective"
        again = estimated(log, source, (), say, first=first)
        rivals = tuple(_rival_estimates(found, again, rival, ITERATIONS) for rival in fault.rivals)
    except InputError:
        return None
    # further faults are corrected like those of any log; each correction halves the misfit at least, so the recursion ends
    judgement = judged(*with_corrections(again, say)) if _excess(found) > 0 else judged(again)
    return CorrectedEstimate(fault, settings, judgement.conclusions, again.vehicle, rivals, correction.by_keys)


def _excess(found: Analysis) -> float:
    """Mean squared residual over the stated noise, minus one."""
    return 0.0 if found.plain is None else found.plain.left - 1


def _leaves_misfit(found: Analysis, corrected: AsStated | None) -> bool:
    """Whether the corrected fit leaves a significant misfit of more than :data:`MAIN_PART` of the original one."""
    return corrected is not None and corrected.misfit and corrected.left - 1 > MAIN_PART * _excess(found) > 0


def _settings(found: Analysis, correction: Correction, others: Sequence[Correction]) -> tuple[str, ...]:
    """KEY=VALUE settings of a correction and its uncertainty: ``others`` are the correction changed by prior sigmas, and its rivals."""
    stated = found.source.vehicle
    keys, sigma_keys = correction.keys
    entries, more_sigmas = [*stated.uncertain], dict[str, object]()
    for other in others:
        other_keys, other_sigmas = other.keys
        more_sigmas |= {key: value for key, value in other_sigmas.items() if key not in sigma_keys}
        values = {key: _stated(stated, key) for key in keys if key not in other_keys}
        values |= {key: value for key, value in other_keys.items() if keys.get(key) != value} | other.factors_after(correction)
        entries += [values] if values else []
    settings = [*correction.settings, *correction.column_settings(found.log, stated.columns)]
    settings += [f"{key}={configfile.written(value)}" for key, value in more_sigmas.items()]
    settings += [f"uncertain={configfile.written(entries)}"] if len(entries) > len(stated.uncertain) else []
    return tuple(settings)


def _stated(vehicle: Vehicle, key: str) -> Any:
    """Value of a dotted key of the vehicle file."""
    section, *path = key.split(".")
    node: Any = vehicle.model_dump(by_alias=True, mode="json", exclude_none=True)[section]
    for part in path:
        node = node[int(part)] if isinstance(node, list) else node[part]
    return node


def _rival_estimates(found: Analysis, corrected: Analysis, rival: Correction, passes: int) -> list[Array]:
    """(10,) estimates by phase with a rival correction, after ``passes`` iterations from the corrected fit; NaN without a fit."""
    vehicle = stating_as(vehiclefile.changed(found.source.vehicle, rival.settings), corrected.vehicle, ESTIMATED_KEYS)
    samples = Stream.of(outliers.without_outliers(rival.log(found.log), vehicle), vehicle, stated_timing(vehicle, corrected.timing))
    phases = phases_of(samples.log, vehicle, samples)
    used, _ = with_noise_levels(samples, [cycles for _, cycles in phases], vehicle)
    references = [settled.reference for settled in corrected.settled]
    return [
        np.full(10, np.nan) if reference is None else offline.estimate_after(samples, cycles, reference, used.in_phase(phase), passes)
        for (phase, cycles), reference in zip(phases, references, strict=True)
    ]


def split_at_change(found: Analysis) -> VehicleSource | None:
    """Vehicle with a new phase from the first named change on; None without a change or without ``estimator.split_on_change``."""
    change_s = next((fault.change_s for fault in found.faults if fault.change_s is not None), None)
    return _split_at(found, change_s) if change_s is not None and found.source.vehicle.estimator.split_on_change else None


def _split_at(found: Analysis, change_s: float) -> VehicleSource:
    """Vehicle with a new phase from ``change_s`` on."""
    return replace(found.source, vehicle=split(found.source.vehicle, [history.phase for history in found.histories], change_s))


def split(vehicle: Vehicle, phases: Sequence[Phase], at_s: float) -> Vehicle:
    """Vehicle with the phase around ``at_s`` split in two. Known values of that phase apply to neither part.

    If the docking names that phase, it refers to the adjacent part.
    """
    parts: list[Phase] = []
    docking = vehicle.docking
    for phase in phases:
        if phase.start_s < at_s < phase.end_s:
            before, after = f"{phase.name}-1", f"{phase.name}-2"
            parts.append(Phase(name=before, start_s=phase.start_s, end_s=at_s))
            parts.append(Phase(name=after, start_s=at_s, end_s=phase.end_s))
            if docking is not None and docking.before == phase.name:
                docking = docking.model_copy(update={"before": after})
            if docking is not None and docking.after == phase.name:
                docking = docking.model_copy(update={"after": before})
        else:
            parts.append(phase.model_copy(update={"known": {**vehicle.known, **phase.known}}))
    return vehicle.model_copy(update={"phases": tuple(parts), "docking": docking, "known": {}})
