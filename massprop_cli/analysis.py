"""The composed flow: a log and its vehicle in, an :class:`Analysis` out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli import diagnose, estimate, noise, thesis, timing, vehicle
from massprop_cli.align import Aligned
from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples
from massprop_cli.conclude import Conclusion, conclude
from massprop_cli.docking import Docked, docked_object
from massprop_cli.errors import InputError
from massprop_cli.history import History, phase_cycles
from massprop_cli.start import first_reference
from massprop_cli.tablefile import read_table
from massprop_cli.telemetry import Log, Notice, read
from massprop_cli.timing import Found, Timing
from massprop_cli.vehicle import Phase, Vehicle, VehicleSource

ROUNDS = 6
"""How often disturbances may be raised until the innovations are explained."""
FEWER_ROUNDS = 3
"""... before the first causal run."""
_NAMES = {"delay": "command delay", "lag": "thrust lag"}
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
    timing: Timing
    """Delay and lag as used, cycles."""
    detected: Found | None
    """What the log says of them."""
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
    detected = _found_timing(log, source, say)
    used_timing = _stated_timing(source.vehicle) if detected is None else detected.at
    stated = timing.with_lag(source.vehicle, used_timing.lag * source.vehicle.cycle.period_s)
    samples = used_timing.of(log, stated)
    phases = _phases(log, stated, samples.executed)
    used, histories, settled, notices = _estimates(samples, phases, stated, say)
    if stated.estimator.refine and settled:
        histories = tuple(settled)
    conclusions = tuple(conclude(history, used) for history in histories)
    docked = docked_object(conclusions, used)
    if detected is None and settled:
        say("checking the delay", 1.0)
        detected = _checked_timing(log, _undisturbed(used, stated), settled, used_timing)
        notices = timing.mismatch(used_timing.delay, detected) + notices
    explained = {"delay-mismatch", "gyro-saturated", "accelerometer-saturated"} & {notice.code for notice in (*notices, *log.notices)}
    if notices and not explained and stated.estimator.method == "default":
        say("looking for the cause", 1.0)
        explained_by = diagnose.diagnose(log, _undisturbed(used, stated), used_timing.delay, [cycles for _, cycles in phases])
        changed = next((e for e in explained_by if e.change_s is not None), None)
        if changed is not None and changed.change_s is not None and source.vehicle.estimator.split_on_change:
            split = replace(source, vehicle=_split(source.vehicle, [phase for phase, _ in phases], changed.change_s))
            again = examine(log, split, assignments, progress)
            return replace(again, source=source, notices=(changed.notice, *again.notices))
        notices = [e.notice for e in explained_by] + notices
    found = (*log.notices, *notices, *(n for h in histories for n in h.notices), *_physical(conclusions), *_docking_notices(docked))
    judged = tuple(settled) or histories
    return Analysis(log, source, used, samples, used_timing, detected, histories, judged, conclusions, docked, found, tuple(assignments))


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


def _stated_timing(stated: Vehicle, instead: float = 0.0) -> Timing:
    """Delay and lag of the vehicle file in cycles, with ``instead`` where it says "auto"."""
    delay, lag = stated.cycle.command_delay_cycles, stated.thrust.lag_s
    return Timing(instead if delay == "auto" else delay, instead if lag == "auto" else lag / stated.cycle.period_s)


def _found_timing(log: Log, source: VehicleSource, say: Progress) -> Found | None:
    """What the vehicle file leaves to be found ("auto"); None where it states both delay and lag."""
    automatic = {"delay": source.vehicle.cycle.command_delay_cycles == "auto", "lag": source.vehicle.thrust.lag_s == "auto"}
    unknown = [name for name, auto in automatic.items() if auto]
    if not unknown:
        return None
    say("finding delay and lag", 0.0)
    given = _stated_timing(source.vehicle)
    lags = timing.LAGS if automatic["lag"] else (given.lag,)
    coarse = timing.search(log, source.vehicle, lags, timing.DELAYS if automatic["delay"] else (given.delay,))
    found = None
    if coarse is not None:
        vehicle = timing.with_lag(source.vehicle, coarse.lag * source.vehicle.cycle.period_s)
        samples = coarse.of(log, vehicle)
        pieces = [cycles for _, cycles in _phases(log, vehicle, samples.executed)]
        used, _ = noise.with_noise_levels(samples, pieces, vehicle)
        found = timing.detect(log, used, pieces, coarse, unknown)
    if found is None:
        remedy = {"delay": "the delay in cycles (--delay 2.0, or cycle.command_delay_cycles)", "lag": "the lag in seconds (thrust.lag_s)"}
        raise InputError(
            f"{log.path}: {' and '.join(f'the {_NAMES[name]}' for name in unknown)} can't be told from this log; its commands explain too "
            f"little of its motion. State {' and '.join(remedy[name] for name in unknown)}"
        )
    return found


def _checked_timing(log: Log, used: Vehicle, settled: Sequence[History], stated: Timing) -> Found | None:
    """What the log says of a stated delay; None where nothing is known of the vehicle to tell it by."""
    known = [(history.cycles, history.reference) for history in settled if history.reference is not None]
    if not known:
        return None
    return timing.detect(log, used, [cycles for cycles, _ in known], stated, ["delay"], [reference for _, reference in known])


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
        used = sized if np.isnan(excess).all() else _sized(samples, phases, sized)
        histories = tuple(
            estimate.replay(samples, cycles, phase, used, partial(say, f"estimating, phase {phase.name}")) for phase, cycles in phases
        )
        settled = [h if h.reference is None else estimate.settle(samples, h.cycles, h.phase, h.reference, used) for h in histories]
        excess = noise.misfit(settled, used)
    return used, histories, settled, notices + noise.disturbance_notices(stated, used, excess)


def _sized(samples: Samples, phases: Sequence[tuple[Phase, slice]], vehicle: Vehicle) -> Vehicle:
    """The vehicle with disturbances raised until off-line fits explain the log: a causal run for every size tried would take long."""
    for _ in range(FEWER_ROUNDS):
        references = [first_reference(samples, cycles, vehicle) for _, cycles in phases]
        settled = [
            estimate.settle(samples, cycles, phase, reference, vehicle)
            for (phase, cycles), reference in zip(phases, references, strict=True)
            if reference is not None
        ]
        raised = noise.with_disturbances(samples, [cycles for _, cycles in phases], noise.misfit(settled, vehicle), vehicle)
        if raised == vehicle:
            break
        vehicle = raised
    return vehicle


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
    """The inertia (3, 3) nearest in the sum of squares that a body could have: positive, no principal moment above the others' sum.

    A body's second moments p are positive, and its principal moments are the sums of two of them: non-negative least squares in three
    unknowns, solved by trying which of them are zero (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, chapter 23).
    """
    moments, axes = np.linalg.eigh(inertia)
    pairs = 1 - np.eye(3)
    candidates = []
    for keep in product((1.0, 0.0), repeat=3):
        second = np.linalg.pinv(pairs * keep) @ moments
        candidates.append(pairs @ np.maximum(second, 0.0))
    nearest = min(candidates, key=lambda sums: float(((sums - moments) ** 2).sum()))
    consistent: Array = (axes * nearest) @ axes.T
    return consistent


def effective_settings(analysis: Analysis) -> dict[str, Any]:
    """Dotted keys and values which, given back with ``--set``, reproduce the result."""
    used = analysis.vehicle
    keys: dict[str, Any] = {"cycle.command_delay_cycles": analysis.timing.delay, "thrust.lag_s": used.thrust.lag_s}
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
        elif part is None or vehicle.flat(part, section).get(key) != value:
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
