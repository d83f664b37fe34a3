"""The corrected estimate of a log: with a named fault corrected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.analysis import Analysis, MendedAnswer
from massprop_cli.conclude.estimated import estimated
from massprop_cli.conclude.firstfit import first_fits
from massprop_cli.conclude.judge import judged
from massprop_cli.diagnosis import UNKNOWN, outliers
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


FOUND = (
    *("imu.gyro_noise_rad_s", "imu.accel_noise_m_s2", "imu.attitude_sigma_rad", "imu.gyro_outliers_s", "imu.accel_outliers_s"),
    *("imu.gyro_filter", "imu.accel_filter", "environment.disturbance_torque_n_m", "environment.disturbance_walk_n_m"),
    "estimator.accel_noise_scale",
)
"""Keys of noise, disturbances, outliers and low-passes, which an estimate finds: with them values differ by a remedy alone."""
VAIN = "log and vehicle file don't fit, cause unknown. Likest to it would be, but corrected it leaves most of the misfit:"
MOST = 0.5
"""Part of the mean squared residual beyond the noise, which a remedy of the cause leaves next to nothing of, and of another all but all."""


def proven(found: Analysis, say: Progress) -> tuple[Analysis, list[MendedAnswer]]:
    """One answer for each named fault that has a remedy; a name whose remedy leaves most of the misfit is none."""
    each = [(fault.cure, _mended(found, fault, say)) for fault in _distinct(found.faults)]
    vain = [cure for cure, answer in each if answer == "vain"]
    answers = [answer for _, answer in each if isinstance(answer, MendedAnswer)]
    if not vain:
        return found, answers
    unproven = [fault for fault in found.faults if fault.cure in vain]
    unknown = f"{VAIN} {' and '.join(dict.fromkeys(fault.notice.message for fault in unproven))}"
    faults = tuple(fault for fault in found.faults if fault not in unproven)
    return replace(found, faults=faults, unknown=unknown, notices=(Notice(UNKNOWN, unknown), *found.notices)), answers


def _distinct(faults: Sequence[Fault]) -> list[Fault]:
    """One of those that the same remedy corrects."""
    return [fault for i, fault in enumerate(faults) if fault.cure is not None and fault.cure not in [f.cure for f in faults[:i]]]


def _mended(found: Analysis, fault: Fault, say: Progress) -> MendedAnswer | Literal["vain"] | None:
    """The log examined again with the fault corrected; None where it can't be, "vain" where that leaves most of the misfit."""
    say("with the fault corrected", 1.0)
    cure = fault.cure
    if cure is None:
        return None
    settings = _with_sigmas(found, cure, (*fault.around, *fault.rivals))
    try:
        vehicle = vehiclefile.changed(found.source.vehicle, settings)
        if fault.change_s is not None:
            vehicle = _split_at(found, fault.change_s).vehicle
        log, source = cure.log(found.log), replace(found.source, vehicle=vehicle)
        first = first_fits(log, source, say)
        if _vain(found, first[1]):
            return "vain"
        again = estimated(log, source, (), say, first=first)
        rivals = tuple(_beside(found, again, rival, offline.MAX_PASSES) for rival in fault.rivals)
    except InputError:
        return None
    # as who follows the remedy has it; each name that is proven leaves less than half, so that this ends
    told = judged(*proven(again, say)) if _excess(found) > 0 else judged(again)
    return MendedAnswer(fault, settings, told.conclusions, again.vehicle, rivals, cure.by_keys)


def _excess(found: Analysis) -> float:
    """Mean squared residual beyond the stated noise."""
    return 0.0 if found.plain is None else found.plain.left - 1


def _vain(found: Analysis, corrected: AsStated | None) -> bool:
    """Whether most of what the stated noise doesn't explain is left, beyond chance."""
    return corrected is not None and corrected.misfit and corrected.left - 1 > MOST * _excess(found) > 0


def _with_sigmas(found: Analysis, cure: Correction, others: Sequence[Correction]) -> tuple[str, ...]:
    """The settings of a remedy with how uncertain it is: ``others`` hold it changed by its prior sigma, or what may be wrong instead."""
    stated = found.source.vehicle
    own, spreads = cure.keys
    entries, estimated_too = [*stated.uncertain], dict[str, object]()
    for other in others:
        there, also = other.keys
        estimated_too |= {key: value for key, value in also.items() if key not in spreads}
        values = {key: _stated(stated, key) for key in own if key not in there}
        values |= {key: value for key, value in there.items() if own.get(key) != value} | other.factors_after(cure)
        entries += [values] if values else []
    settings = [*cure.settings, *cure.column_settings(found.log, stated.columns)]
    settings += [f"{key}={configfile.written(value)}" for key, value in estimated_too.items()]
    settings += [f"uncertain={configfile.written(entries)}"] if len(entries) > len(stated.uncertain) else []
    return tuple(settings)


def _stated(vehicle: Vehicle, key: str) -> Any:
    """What a vehicle says under a dotted key."""
    section, *path = key.split(".")
    node: Any = vehicle.model_dump(by_alias=True, mode="json", exclude_none=True)[section]
    for part in path:
        node = node[int(part)] if isinstance(node, list) else node[part]
    return node


def _beside(found: Analysis, mended: Analysis, cure: Correction, passes: int = 1) -> list[Array]:
    """(10,) what so many passes on from the corrected fit of each phase give with another remedy instead; NaN where there is none."""
    vehicle = stating_as(vehiclefile.changed(found.source.vehicle, cure.settings), mended.vehicle, FOUND)
    samples = Stream.of(outliers.without(cure.log(found.log), vehicle), vehicle, stated_timing(vehicle, mended.timing))
    phases = phases_of(samples.log, vehicle, samples)
    used, _ = with_noise_levels(samples, [cycles for _, cycles in phases], vehicle)
    references = [settled.reference for settled in mended.settled]
    return [
        np.full(10, np.nan) if reference is None else offline.estimate_after(samples, cycles, reference, used.in_phase(phase), passes)
        for (phase, cycles), reference in zip(phases, references, strict=True)
    ]


def split_at_change(found: Analysis) -> VehicleSource | None:
    """The vehicle with another phase from the first named change on; None without one, or ``estimator.split_on_change``."""
    change_s = next((fault.change_s for fault in found.faults if fault.change_s is not None), None)
    return _split_at(found, change_s) if change_s is not None and found.source.vehicle.estimator.split_on_change else None


def _split_at(found: Analysis, change_s: float) -> VehicleSource:
    """The vehicle with another phase from ``change_s`` on."""
    return replace(found.source, vehicle=split(found.source.vehicle, [history.phase for history in found.histories], change_s))


def split(vehicle: Vehicle, phases: Sequence[Phase], at_s: float) -> Vehicle:
    """The vehicle with the phase that holds ``at_s`` cut in two. What was known of that phase is of neither part.

    A docking that names it is between the parts that are next to it.
    """
    cut: list[Phase] = []
    docking = vehicle.docking
    for phase in phases:
        if phase.start_s < at_s < phase.end_s:
            before, after = f"{phase.name}-1", f"{phase.name}-2"
            cut.append(Phase(name=before, start_s=phase.start_s, end_s=at_s))
            cut.append(Phase(name=after, start_s=at_s, end_s=phase.end_s))
            if docking is not None and docking.before == phase.name:
                docking = docking.model_copy(update={"before": after})
            if docking is not None and docking.after == phase.name:
                docking = docking.model_copy(update={"after": before})
        else:
            cut.append(phase.model_copy(update={"known": {**vehicle.known, **phase.known}}))
    return vehicle.model_copy(update={"phases": tuple(cut), "docking": docking, "known": {}})
