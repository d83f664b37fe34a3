"""The composed flow: a log and its vehicle in, an :class:`Analysis` out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli import delay, diagnose, estimate, noise, thesis, vehicle
from massprop_cli.align import Aligned, align
from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples, compensate
from massprop_cli.conclude import Conclusion, conclude
from massprop_cli.delay import Delay
from massprop_cli.docking import Docked, docked_object
from massprop_cli.errors import InputError
from massprop_cli.history import History, phase_cycles
from massprop_cli.tablefile import read_table
from massprop_cli.telemetry import Log, Notice, read
from massprop_cli.vehicle import Phase, Vehicle, VehicleSource

ROUNDS = 6
"""How often disturbances may be raised until the innovations are explained."""
Progress = Callable[[str, float], None]
"""Told the stage and how much of it is done, 0 to 1."""


@dataclass(frozen=True)
class Analysis:
    """Everything that one run found, with what it was found from."""

    log: Log
    source: VehicleSource
    vehicle: Vehicle
    """As used: with the noise levels and disturbances that a first pass set."""
    samples: Samples
    delay_cycles: float
    detected_delay: Delay | None
    """What the log says of it."""
    histories: tuple[History, ...]
    settled: tuple[History, ...]
    """The same about their final estimates: their innovations say whether the model holds."""
    conclusions: tuple[Conclusion, ...]
    docked: Docked | None
    notices: tuple[Notice, ...]
    assignments: tuple[str, ...]


def analyse(
    log_path: Path, vehicle_path: Path | None = None, assignments: Sequence[str] = (), progress: Progress | None = None
) -> Analysis:
    """Read, align, compensate, estimate, conclude. :class:`InputError` where the input can't be used."""
    if progress is not None:
        progress("reading", 0.0)
    table = read_table(log_path)
    source = vehicle.find(log_path, vehicle_path, table.embedded_vehicle, assignments)
    return examine(read(table, source.vehicle), source, assignments, progress)


def examine(log: Log, source: VehicleSource, assignments: Sequence[str] = (), progress: Progress | None = None) -> Analysis:
    """The same from a log at hand."""
    say = progress or (lambda *_: None)
    stated = source.vehicle.cycle.command_delay_cycles
    detected = _found_delay(log, source, say) if stated == "auto" else None
    used_delay = detected.cycles if detected is not None else float(stated)
    aligned = align(log, source.vehicle, used_delay)
    samples = compensate(aligned, source.vehicle)
    phases = _phases(log, source.vehicle, aligned)
    used, histories, settled, notices = _estimates(samples, phases, source.vehicle, say)
    if source.vehicle.estimator.refine and settled:
        histories = tuple(settled)
    conclusions = tuple(conclude(history, used) for history in histories)
    docked = docked_object(conclusions, used)
    if detected is None and settled:
        say("checking the delay", 1.0)
        detected = _checked_delay(log, _undisturbed(used, source.vehicle), settled, used_delay)
        notices = delay.mismatch(used_delay, detected) + notices
    explained = {"delay-mismatch", "gyro-saturated", "accelerometer-saturated"} & {notice.code for notice in (*notices, *log.notices)}
    if notices and not explained and source.vehicle.estimator.method == "default":
        say("looking for the cause", 1.0)
        explained_by = diagnose.diagnose(log, _undisturbed(used, source.vehicle), used_delay, [cycles for _, cycles in phases])
        changed = next((e for e in explained_by if e.change_s is not None), None)
        if changed is not None and changed.change_s is not None and source.vehicle.estimator.split_on_change:
            split = replace(source, vehicle=_split(source.vehicle, [phase for phase, _ in phases], changed.change_s))
            again = examine(log, split, assignments, progress)
            return replace(again, source=source, notices=(changed.notice, *again.notices))
        notices = [e.notice for e in explained_by] + notices
    found = (*log.notices, *notices, *(n for h in histories for n in h.notices), *_physical(conclusions), *_docking_notices(docked))
    judged = tuple(settled) or histories
    return Analysis(log, source, used, samples, used_delay, detected, histories, judged, conclusions, docked, found, tuple(assignments))


def _split(vehicle: Vehicle, phases: Sequence[Phase], at_s: float) -> Vehicle:
    """The vehicle with the phase that holds ``at_s`` cut in two."""
    cut: list[Phase] = []
    for phase in phases:
        if phase.start_s < at_s < phase.end_s:
            cut.append(Phase(name=f"{phase.name}-1", start_s=phase.start_s, end_s=at_s))
            cut.append(Phase(name=f"{phase.name}-2", start_s=at_s, end_s=phase.end_s))
        else:
            cut.append(phase)
    return vehicle.model_copy(update={"phases": tuple(cut)})


def _undisturbed(used: Vehicle, stated: Vehicle) -> Vehicle:
    """The vehicle with its noise levels, but without the disturbances that were added to explain a misfit."""
    return used.model_copy(update={"environment": stated.environment, "estimator": stated.estimator})


def _found_delay(log: Log, source: VehicleSource, say: Progress) -> Delay:
    """The delay of a log whose vehicle file says "auto"."""
    say("finding the delay", 0.0)
    coarse = delay.search(log, source.vehicle)
    found = None
    if coarse is not None:
        aligned = align(log, source.vehicle, coarse)
        samples = compensate(aligned, source.vehicle)
        pieces = [cycles for _, cycles in _phases(log, source.vehicle, aligned)]
        used, _ = noise.with_noise_levels(samples, pieces, source.vehicle)
        found = delay.detect(log, used, pieces, coarse)
    if found is None:
        raise InputError(
            f"{log.path}: the command delay can't be told from this log; its commands explain too little of its motion. "
            "State it in cycles (--delay 2.0, or cycle.command_delay_cycles)"
        )
    return found


def _checked_delay(log: Log, used: Vehicle, settled: Sequence[History], stated: float) -> Delay | None:
    """What the log says of a stated delay; None where nothing is known of the vehicle to tell it by."""
    known = [(history.cycles, history.reference) for history in settled if history.reference is not None]
    if not known:
        return None
    return delay.detect(log, used, [cycles for cycles, _ in known], stated, [reference for _, reference in known])


def _phases(log: Log, used: Vehicle, aligned: Aligned) -> list[tuple[Phase, slice]]:
    start, end = round(float(aligned.start_s[0]), 9) + 0.0, round(float(aligned.end_s[-1]), 9)  # + 0.0: no minus zero
    found = []
    for phase in used.phases or (Phase(name="all", start_s=start, end_s=end),):
        cycles = phase_cycles(phase, aligned.end_s, aligned.usable)
        if cycles.stop - cycles.start < 2:
            raise InputError(
                f"{log.path}: phase {phase.name!r} ({phase.start_s:g} to {phase.end_s:g} s) holds "
                f"{cycles.stop - cycles.start} usable cycles; "
                f"the log runs from {start:g} to {end:g} s. Mend [[phases]] in the vehicle file"
            )
        found.append((phase, cycles))
    return found


def _estimates(
    samples: Samples, phases: Sequence[tuple[Phase, slice]], stated: Vehicle, say: Progress
) -> tuple[Vehicle, tuple[History, ...], list[History], list[Notice]]:
    """Estimates, and the off-line fits of each phase that they are judged by.

    Noise levels first, then the estimator through every phase; disturbances are sized where the stated noise can't explain the log.
    """
    pieces = [cycles for _, cycles in phases]
    if stated.estimator.method == "thesis":
        return stated, _thesis(samples, phases, stated), [], []
    used, notices = noise.with_noise_levels(samples, pieces, stated)
    adapt = used.estimator.adapt_noise
    excess = noise.gross_misfit(samples, pieces, used) if adapt else np.full(6, np.nan)
    histories: tuple[History, ...] = ()
    settled: list[History] = []
    for _ in range(ROUNDS):
        sized = noise.with_disturbances(samples, pieces, excess, used) if adapt else used
        if histories and sized == used:
            break
        used = sized
        histories = tuple(
            estimate.replay(samples, cycles, phase, used, partial(say, f"estimating, phase {phase.name}")) for phase, cycles in phases
        )
        settled = [estimate.settle(samples, phase, history, used) for (phase, _), history in zip(phases, histories, strict=True)]
        excess = noise.misfit(settled, used)
    return used, histories, settled, notices + noise.disturbance_notices(stated, used, excess)


def _thesis(samples: Samples, phases: Sequence[tuple[Phase, slice]], used: Vehicle) -> tuple[History, ...]:
    histories: list[History] = []
    filters = None
    for phase, cycles in phases:
        history, filters = thesis.replay(samples, cycles, phase, used, filters)
        histories.append(history)
    return tuple(histories)


def _docking_notices(docked: Docked | None) -> list[Notice]:
    mass = docked.estimates["mass"].value if docked else None
    if docked is None or mass is None or mass > 0:
        return []
    message = f"the docked object's mass is {mass:.4g} kg: phase {docked.after} weighs less than phase {docked.before}; mend [docking]"
    return [Notice("docked-mass", message)]


def _physical(conclusions: Sequence[Conclusion]) -> list[Notice]:
    found = []
    for conclusion in conclusions:
        note = physical_note(conclusion)
        if note:
            found.append(Notice("unphysical-inertia", f"phase {conclusion.phase.name}: {note}"))
    return found


def physical_note(conclusion: Conclusion) -> str:
    """What no real body could have in this inertia, or an empty text; nothing is said of an inertia that is not wholly informed."""
    low, middle, high = (float(moment) for moment in conclusion.principal_moments)
    if np.isnan(low):
        return ""
    if low <= 0:
        return f"the inertia is not positive definite (least principal moment {low:.4g} kg m^2)"
    if low + middle < high * (1 - 1e-9):
        return f"the inertia breaks the triangle inequality: {low:.4g} + {middle:.4g} < {high:.4g} kg m^2; check jets, units and thrust"
    return ""


def nearest_consistent(inertia: Array) -> Array:
    """The inertia (3, 3) nearest in the sum of squares that a body could have: positive, no principal moment above the others' sum."""
    from scipy.optimize import nnls

    moments, axes = np.linalg.eigh(inertia)
    # a body's second moments p are positive, and its principal moments are the sums of two of them
    second, _ = nnls(1 - np.eye(3), moments)
    nearest: Array = (axes * (second.sum() - second)) @ axes.T
    return nearest


def effective_settings(analysis: Analysis) -> dict[str, Any]:
    """Dotted keys and values which, given back with ``--set``, reproduce the result."""
    used = analysis.vehicle
    keys: dict[str, Any] = {"cycle.command_delay_cycles": analysis.delay_cycles}
    for section, names in (
        ("imu", ("gyro_noise_rad_s", "accel_noise_m_s2")),
        ("environment", ("disturbance_torque_n_m", "disturbance_walk_n_m")),
    ):
        keys |= {k: v for k, v in vehicle.flat(getattr(used, section), section).items() if k.split(".")[1] in names}
    final = used.estimator.model_copy(update={"adapt_noise": False})
    return keys | vehicle.flat(final, "estimator") | vehicle.flat(used.convergence, "convergence") | _set_by_user(analysis, keys)


def setting_sources(analysis: Analysis) -> dict[str, str]:
    """Where each of :func:`effective_settings` came from: "option", "vehicle file", "default", or "log" if a first pass found it."""
    stated = analysis.source.vehicle
    options = {assignment.partition("=")[0].strip() for assignment in analysis.assignments}
    found = {}
    for key, value in effective_settings(analysis).items():
        section, _, name = key.partition(".")
        part = getattr(stated, section, None)
        if key in options:
            found[key] = "option"
        elif part is None or (key != "estimator.adapt_noise" and vehicle.flat(part, section).get(key) != value):
            found[key] = "log"
        else:
            found[key] = "vehicle file" if name.partition(".")[0] in part.model_fields_set else "default"
    return found


def _set_by_user(analysis: Analysis, keys: dict[str, Any]) -> dict[str, Any]:
    """Other keys that the command line overrode."""
    from massprop_cli.configfile import literal

    pairs = (assignment.partition("=") for assignment in analysis.assignments)
    others = {key.strip(): literal(value.strip()) for key, _, value in pairs}
    return {k: v for k, v in others.items() if k not in keys and not k.startswith(("estimator.", "convergence."))}


__all__ = ["Analysis", "analyse", "effective_settings", "examine", "nearest_consistent", "physical_note", "setting_sources"]
