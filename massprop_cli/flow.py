"""The composed flow: a log and its vehicle in, an :class:`Analysis` out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.assumptions import Assumption, Examined, assumptions, examined
from massprop_cli.conclude.contradict import Contradiction, Fault, by_faults, by_known, by_misfit, by_no_body, together
from massprop_cli.conclude.docking import Docked, docked_object, masses_apart
from massprop_cli.conclude.physical import physical_note
from massprop_cli.conclude.score import Doubt, by_doubts, doubts
from massprop_cli.conclude.verdict import Conclusion, conclude, contradicted
from massprop_cli.diagnosis import delay
from massprop_cli.diagnosis.delay import Found
from massprop_cli.diagnosis.ready import ready
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate.history import History, phases_of
from massprop_cli.estimate.phases import Progress, as_stated, by_thesis, estimates
from massprop_cli.inputs import clipped, vehiclefile
from massprop_cli.inputs.tablefile import read_table
from massprop_cli.inputs.telemetry import SATURATED, Log, Notice, read
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.actuators import along_one_line, channel_names
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

if TYPE_CHECKING:
    from massprop_cli.diagnosis.cures import Cure
    from massprop_cli.diagnosis.diagnose import Diagnosis


@dataclass(frozen=True)
class MendedAnswer:
    """What the log gives if a named fault is mended."""

    fault: Fault
    settings: tuple[str, ...]
    """KEY=VALUE of the vehicle file that mend it."""
    conclusions: tuple[Conclusion, ...]


@dataclass(frozen=True)
class Analysis:
    """Everything that one run found, with what it was found from."""

    log: Log
    source: VehicleSource
    vehicle: Vehicle
    """As used: with the noise levels and disturbances that a first pass set."""
    stated: Vehicle
    """With its timing resolved, but without what a first pass sized."""
    samples: Stream
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
    lack_of_fit: tuple[Array, ...] = ()
    """(6,) of each phase: by how much too small the sigmas of each channel are."""
    mended: tuple[MendedAnswer, ...] = ()
    assumptions: tuple[Assumption, ...] = ()
    examination: Examined | None = None
    """What each assumption does to the off-line fits; None by another method, and where there is none."""
    faults: tuple[Fault, ...] = ()
    """What has a name."""
    unknown: str = ""
    """Why nothing has, where something should."""
    doubts: tuple[Doubt, ...] = ()
    """Assumptions that the log contradicts."""


def analyse(
    log_path: Path, vehicle_path: Path | None = None, assignments: Sequence[str] = (), progress: Progress | None = None
) -> Analysis:
    """Read, align, compensate, estimate, conclude. :class:`InputError` where the input can't be used."""
    if progress is not None:
        progress("reading", 0.0)
    log, source = _read(log_path, vehicle_path, assignments)
    return examine(log, source, assignments, progress)


def _read(log_path: Path, vehicle_path: Path | None, assignments: Sequence[str]) -> tuple[Log, VehicleSource]:
    table = read_table(log_path)
    source = vehiclefile.find(log_path, vehicle_path, table.embedded_vehicle, assignments)
    return read(table, source.vehicle), source


def examine(log: Log, source: VehicleSource, assignments: Sequence[str] = (), progress: Progress | None = None) -> Analysis:
    """The same from a log at hand: estimate, look for what contradicts, mend it beside, judge."""
    say = progress or (lambda *_: None)
    log = clipped.with_unstated(log)
    found = _estimated(log, source, assignments, say)
    change_s = next((fault.change_s for fault in found.faults if fault.change_s is not None), None)
    if change_s is not None and source.vehicle.estimator.split_on_change:
        split = replace(source, vehicle=_split(source.vehicle, [h.phase for h in found.histories], change_s))
        again = examine(log, split, assignments, progress)
        changes = (fault.notice for fault in found.faults if fault.change_s is not None)
        return replace(again, source=source, notices=(*changes, *again.notices))
    mended = [answer for fault in _distinct(found.faults) if (answer := _mended(found, fault, say)) is not None]
    judged = _judged(found, mended, [_offline(found, cure) for answer in mended for cure in answer.fault.rivals])
    return replace(judged, assumptions=_assumptions(judged))


def _estimated(log: Log, source: VehicleSource, assignments: Sequence[str], say: Progress, check: bool = True) -> Analysis:
    """Timing, noise levels, causes, estimates. Disturbances are sized where nothing that has a name explains what is left."""
    read = log
    log, stated, samples, phases, used_timing, detected, consider, told = ready(log, source, say)
    diagnosis: Diagnosis | None = None
    if stated.estimator.method == "thesis":
        answer = by_thesis(samples, phases, stated)
    else:
        plain = as_stated(samples, phases, stated, consider)
        if check and plain.dubious and not _saturated(log) and _diagnosable(stated):
            say("looking for the cause", 1.0)
            from massprop_cli.diagnosis.diagnose import diagnose  # nine modules that a clean log does without

            diagnosis = diagnose(log, plain.used, used_timing, [cycles for _, cycles in phases])
        size = stated.estimator.adapt_noise and not (diagnosis and diagnosis.explanations)
        answer = estimates(samples, phases, plain, size, consider, say)
    histories, settled, used = answer.histories, answer.settled, answer.used
    if stated.estimator.refine and settled:
        histories = tuple(settled)
    examination, doubted = None, list[Doubt]()
    if settled and check:
        say("what the numbers rest on", 1.0)
        examination = examined(log, used, used_timing, samples, settled, consider)
        # the filter takes each pulse's error as white, which it is but nearly: too sharp a test beside it
        doubted = doubts(examination, channel_names(log, used), along_one_line(log, used)) if used.thrust.pulse_sigma == 0 else []
    if not all(one.faint for one in doubted) and diagnosis is None and not _saturated(log) and _diagnosable(stated):
        say("looking for the cause", 1.0)
        from massprop_cli.diagnosis.diagnose import diagnose

        diagnosis = diagnose(log, used, used_timing, [cycles for _, cycles in phases])
    explanations, unknown = (diagnosis.explanations, diagnosis.unknown) if diagnosis else ((), "")
    if detected is None and diagnosis:
        detected = diagnosis.detected
    if detected is None and examination is not None and used == _undisturbed(used, stated):
        detected = _checked_timing(settled, used_timing, examination)
    return Analysis(
        log=read,
        source=source,
        vehicle=used,
        stated=stated,
        samples=samples,
        timing=used_timing,
        detected=detected,
        histories=histories,
        settled=tuple(settled) or histories,
        conclusions=tuple(conclude(history, used) for history in histories),
        docked=None,
        notices=(
            *log.notices,
            *told,
            *_unexplained(unknown, answer.notices),
            *answer.notices,
            *(n for h in histories for n in h.notices),
        ),
        assignments=tuple(assignments),
        examination=examination,
        faults=(
            *(Fault(n, None) for n in _saturated(log)),
            *(Fault(e.notice, e.cure, e.change_s, e.around, e.rivals) for e in explanations),
        ),
        unknown=unknown,
        doubts=tuple(doubted),
    )


def _diagnosable(stated: Vehicle) -> bool:
    """Whether causes have been thought of: not yet those of wheels and rotors."""
    return not (stated.spinning or stated.rotors)


def _unexplained(unknown: str, others: Sequence[Notice]) -> list[Notice]:
    """That nothing explains the log; not where a floor stands in for its noise, against which no model fits."""
    known = all(notice.code != "noise-floor" for notice in others)
    return [Notice("cause-unknown", unknown)] if unknown and known else []


def _saturated(log: Log) -> list[Notice]:
    return [notice for notice in log.notices if notice.code in SATURATED]


def _distinct(faults: Sequence[Fault]) -> list[Fault]:
    """One of those that the same cure mends."""
    return [fault for i, fault in enumerate(faults) if fault.cure is not None and fault.cure not in [f.cure for f in faults[:i]]]


def _mended(found: Analysis, fault: Fault, say: Progress) -> MendedAnswer | None:
    """The log examined again with the fault mended; None where it can't be."""
    say("with the fault mended", 1.0)
    cure = fault.cure
    if cure is None:
        return None
    try:
        log, source = cure.log(found.log), found.source
        if fault.change_s is not None:
            source = replace(source, vehicle=_split(source.vehicle, [h.phase for h in found.histories], fault.change_s))
        else:
            source = replace(source, vehicle=vehiclefile.changed(source.vehicle, cure.settings))
        again = _estimated(log, source, (), say, check=False)
        again = _judged(_widened(again, [_offline(found, near) for near in fault.around]), [])
    except InputError:
        return None
    return MendedAnswer(fault, (*cure.settings, *cure.column_settings(found.log, found.source.vehicle.columns)), again.conclusions)


def _offline(found: Analysis, cure: Cure) -> list[Array]:
    """(10,) what off-line fits of each phase give with a fault mended so; NaN where there is none."""
    log, vehicle = cure.log(found.log), vehiclefile.changed(found.source.vehicle, cure.settings)
    timing = stated_timing(vehicle)
    samples = Stream.of(log, vehicle, timing)
    fits = as_stated(samples, phases_of(log, vehicle, samples), vehicle, Consider()).fits
    return [np.full(10, np.nan) if fit is None else fit.history.values[-1] for fit in fits]


def _widened(found: Analysis, around: Sequence[Sequence[Array]]) -> Analysis:
    """With sigmas that hold by how much the values move if each unknown of what was mended is one sigma further on."""
    if not around:
        return found
    histories = []
    for i, (history, settled) in enumerate(zip(found.histories, found.settled, strict=True)):
        moved = np.stack([values[i] - settled.values[-1] for values in around], 1)
        sigmas = np.sqrt(history.sigmas**2 + (moved**2).sum(1))
        histories.append(replace(history, sigmas=sigmas, covariance=history.covariance + moved @ moved.T))
    return replace(found, histories=tuple(histories), conclusions=tuple(conclude(history, found.vehicle) for history in histories))


def _judged(found: Analysis, mended: Sequence[MendedAnswer], rivals: Sequence[Sequence[Array]] = ()) -> Analysis:
    """Conclusions with what is contradicted, the docked object, and every notice.

    ``rivals``: (10,) values of each phase if a cause is mended instead that can't be ruled out.
    """
    by_method, faults = found.vehicle.estimator.method == "default", found.faults
    conclusions, factors = [], []
    for i, (conclusion, history, settled) in enumerate(zip(found.conclusions, found.histories, found.settled, strict=True)):
        own = [f for f in faults if f.change_s is None or conclusion.phase.start_s < f.change_s < conclusion.phase.end_s]
        answers = [next((c for c in answer.conclusions if c.phase.name == conclusion.phase.name), None) for answer in mended]
        misfit, factor = by_misfit(conclusion, settled, found.samples, found.vehicle) if by_method else (None, np.ones(6))
        nameless = [_explained(misfit, found.unknown), by_doubts(conclusion, i, found.doubts), by_no_body(conclusion)]
        unnamed = nameless if by_method and not own else []
        against = together([by_faults(conclusion, own, answers, [values[i] for values in rivals]), by_known(history), *unnamed])
        conclusions.append(conclusion if against is None else contradicted(conclusion, against.cause, against.touched))
        factors.append(factor)
    docked = docked_object(tuple(conclusions), found.vehicle)
    causes = [fault.notice for fault in faults if fault.notice not in found.notices]
    said = [notice.message for notice in (*causes, *found.notices)]
    others = [
        Notice("contradicted", f"phase {c.phase.name}: {c.contradiction}")
        for c in conclusions
        if c.contradiction and not any(message in c.contradiction for message in said)
    ]
    about_docking = _docking_notices(docked, tuple(conclusions), found.vehicle)
    notices = (*causes, *others, *found.notices, *_physical(found.conclusions), *about_docking)
    return replace(found, conclusions=tuple(conclusions), docked=docked, notices=notices, lack_of_fit=tuple(factors), mended=tuple(mended))


def _explained(against: Contradiction | None, unknown: str) -> Contradiction | None:
    """With what was tried to find its cause."""
    return against if against is None or not unknown else replace(against, cause=f"{unknown}; {against.cause}")


def _assumptions(found: Analysis) -> tuple[Assumption, ...]:
    if found.examination is None:
        return ()
    return assumptions(found.examination, found.log, found.vehicle, found.settled, found.conclusions)


def _split(vehicle: Vehicle, phases: Sequence[Phase], at_s: float) -> Vehicle:
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


def _undisturbed(used: Vehicle, stated: Vehicle) -> Vehicle:
    """The vehicle with its noise levels, but without the disturbances that were added to explain a misfit."""
    return used.model_copy(update={"environment": stated.environment, "estimator": stated.estimator})


def _checked_timing(settled: Sequence[History], at: Timing, examination: Examined) -> Found | None:
    """What the log says of a stated delay that is off by little if at all; None where nothing tells."""
    known = [history.cycles for history in settled if history.reference is not None]
    later = examination.delay()
    if later is None or abs(later.cycles) >= delay.MISMATCH or at.delay + later.cycles < 0:
        return None
    rows = 6 * sum(cycles.stop - cycles.start for cycles in known)
    scale = max(later.before / rows, 1.0)
    return delay.near(at, later.cycles, later.sigma * scale**0.5, later.before / rows, later.after / rows)


def _docking_notices(docked: Docked | None, conclusions: tuple[Conclusion, ...], used: Vehicle) -> list[Notice]:
    apart = masses_apart(conclusions, used) if docked is None else None
    if apart is not None:
        message = (
            f"the two phases' masses differ by {apart[0]:.3g} ± {apart[1]:.2g} kg, too little to tell of a docking, so no docked object is "
            "given; name the phases under [docking] (before, after) if there is one"
        )
        return [Notice("no-docked-object", message)]
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


__all__ = ["Analysis", "MendedAnswer", "Progress", "analyse", "examine"]
