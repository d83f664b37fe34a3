"""Estimation of one log: timing, noise levels, causes, values and what the values rest on."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from massprop_cli.conclude.analysis import Analysis
from massprop_cli.conclude.assumptions import Examined, examined, sound
from massprop_cli.conclude.channelresiduals import channel_residual_test
from massprop_cli.conclude.discrepancy import PlainFits
from massprop_cli.conclude.firstfit import first_fits
from massprop_cli.conclude.reason import sigmas
from massprop_cli.conclude.score import Doubt, doubts
from massprop_cli.conclude.verdict import conclude
from massprop_cli.diagnosis import UNKNOWN, delay
from massprop_cli.diagnosis.delay import FoundTiming
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.preprocessing import Ready
from massprop_cli.diagnosis.resolve import other_cutoffs
from massprop_cli.estimate.disturbances import sized
from massprop_cli.estimate.history import History
from massprop_cli.estimate.known import exceeds_density
from massprop_cli.estimate.phases import AsStated, Estimates, Progress, by_thesis, estimates
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import UNREAD, VOID, Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.actuators import along_one_line, always_together, channel_names, channel_wrench, pushing
from massprop_cli.prepare.timing import Timing

OTHER_CUTOFFS = (
    "log and vehicle file don't fit, cause unknown: the log would fit better with another cutoff of a low-pass and another delay than was "
    'found with the stated one; state cutoff_hz = "auto", or its cutoff_sigma_hz, in [imu.gyro_filter] and [imu.accel_filter]'
)
FEW = 2
"""Cycles with commands that refute too few of hundreds of hypotheses: of clean logs with so few, in which no body is found, a third had
another cause than a delay named, of those with three one in forty (tests/conclude/test_few_commands.py)."""
UNITS = {"gyro-units", "accel-units", "column-kind"}
"""Causes that readings are smaller or larger by."""


class Checked(NamedTuple):
    """What the log says of that which its estimate rests on."""

    diagnosis: Diagnosis | None = None
    examination: Examined | None = None
    doubts: Sequence[Doubt] = ()
    detected: FoundTiming | None = None
    """Of the timing."""
    plain: PlainFits | None = None


def estimated(
    log: Log,
    source: VehicleSource,
    assignments: Sequence[str],
    say: Progress,
    check: bool = True,
    first: tuple[Ready, AsStated | None] | None = None,
) -> Analysis:
    """Timing, noise levels, causes, estimates. Disturbances are sized where nothing that has a name explains what is left.

    ``first`` is what :func:`first_fits` gives, where that is at hand.
    """
    begun, plain = first or first_fits(log, source, say)
    if plain is None:
        told = Checked(detected=begun.detected)
        answer: Estimates[Vehicle] = by_thesis(begun.samples, begun.phases, begun.stated)
    else:
        answer, told = _by_default(begun, plain, check, say)
    unknown = _unexplained(told.diagnosis, answer.notices) or _baffled(told, answer.used, begun)
    void = (Fault(notice, None) for notice in begun.log.notices if notice.code in VOID)
    vain = [Notice(UNKNOWN, unknown)] if unknown else []
    said = *begun.log.notices, *begun.notices, *vain, *answer.notices
    return Analysis(
        log=log,
        source=source,
        vehicle=answer.used,
        stated=begun.stated,
        samples=begun.samples,
        timing=begun.timing,
        detected=told.detected,
        histories=answer.histories,
        settled=tuple(answer.settled) or answer.histories,
        conclusions=tuple(conclude(history, answer.used) for history in answer.histories),
        docked=None,
        notices=(*said, *(notice for history in answer.histories for notice in history.notices)),
        assignments=tuple(assignments),
        examination=told.examination,
        faults=(*void, *(told.diagnosis.faults if told.diagnosis else ())),
        unknown=unknown,
        doubts=tuple(told.doubts),
        plain=told.plain,
    )


def _by_default(begun: Ready, plain: AsStated, check: bool, say: Progress) -> tuple[Estimates[Resolved], Checked]:
    """By the default method, and what the values rest on is examined; with ``check`` the causes of a misfit are looked for."""
    refuted = check and not plain.dubious and other_cutoffs(begun.log, plain.used, begun.pieces, begun.detected)
    diagnosis = _of_matter(begun, plain) if check else None
    if diagnosis is None and check and (plain.dubious or plain.quiet or refuted):
        diagnosis = _diagnosis(begun, plain.used, say, refuted)
        if diagnosis is not None and not (plain.dubious or refuted) and not _found_in_quiet(diagnosis, plain):
            diagnosis = None  # noise that was stated too large is no fault
        if diagnosis is not None and not plain.misfit and _of_few_commands(diagnosis, begun.log):
            diagnosis = None
    size = begun.stated.estimator.adapt_noise and not (diagnosis and diagnosis.faults)
    # what a wrong model leaves is a torque: noise would take half of it, and tell the sigmas nothing of the other
    noisier = diagnosis is not None and not diagnosis.unknown
    answer = estimates(begun.samples, begun.phases, plain, begun.consider, say, size=size, noisier=noisier)
    used = answer.used
    fits = PlainFits(plain.used, tuple(None if fit is None else fit.history.reference for fit in plain.fits), begun.consider, plain.left)
    say("what the numbers rest on", 1.0)
    more = sized(used, begun.stated)
    examination = sound(examined(begun.log, used, begun.timing, begun.samples, answer.settled, begun.consider, more), answer.settled)
    doubted = _doubted(examination, begun, answer)
    if not check:
        return answer, Checked(doubts=doubted, detected=begun.detected, plain=fits)
    if any(one.sure and not one.faint for one in doubted) and diagnosis is None:
        diagnosis = _diagnosis(begun, used, say)
    detected = begun.detected or (diagnosis.detected if diagnosis else None)
    if detected is None and not sized(used, begun.stated):
        detected = _checked_timing(answer.settled, begun.timing, examination)  # no disturbance was added to explain a misfit
    return answer, Checked(diagnosis, examination, doubted, detected, fits)


def _found_in_quiet(diagnosis: Diagnosis, plain: AsStated) -> bool:
    """Whether it names causes of a log that fits; of one in which nothing is left, another unit alone, in which that would be more."""
    codes = {one.notice.code for one in diagnosis.faults}
    silent = all(fit is not None and fit.history.noise_free for fit in plain.fits)
    return bool(codes) and (not silent or codes <= UNITS)


def _of_few_commands(diagnosis: Diagnosis, log: Log) -> bool:
    """Whether what commands hardly tell, and no fit refutes, is laid to more than their time."""
    few = not log.spinning and 0 < int(np.count_nonzero(log.command.any(1))) <= FEW
    return few and not {one.notice.code for one in diagnosis.faults} <= {"delay-mismatch"}


def _doubted(examination: Examined, begun: Ready, answer: Estimates[Resolved]) -> list[Doubt]:
    names = channel_names(begun.log, answer.used)
    push = pushing(channel_wrench(begun.log, answer.used)[:, 3:], always_together(begun.log))
    first = len(names) - len(answer.used.momentum_wrench)
    stored = range(first, len(names))
    apart = [range(first), stored] if first and stored else [push] if push else []
    found = doubts(examination, names, along_one_line(begun.log, answer.used), apart)
    return found + channel_residual_test(answer.settled, begun.samples, names, examination.scatter)


def _of_matter(begun: Ready, plain: AsStated) -> Diagnosis | None:
    """By which rotors' columns are read as of a body of matter, where no matter is so dense as that of the stated reading."""
    ends = [(fit.history.values[-1], fit.history.sigmas[-1]) for fit in plain.fits if fit is not None]
    if not plain.used.rotors or not any(exceeds_density(*end) for end in ends):
        return None
    from massprop_cli.diagnosis import rereading

    return rereading.reread(begun.log, plain.used, begun.timing, begun.phases, no_matter=True)


def _diagnosis(begun: Ready, used: Resolved, say: Progress, refuted: bool = False) -> Diagnosis | None:
    """None where causes are not looked for: of a sensor that saturates or stands still.

    Where no hypothesis explains the log of rotors, other readings of the columns are fitted; of control moment gyros before all else. A log
    that has ``refuted`` a cutoff has a cause, known or unknown.
    """
    if _unread(begun.log):
        return None
    say("looking for the cause", 1.0)
    from massprop_cli.diagnosis import diagnose, rereading  # nine modules that a clean log does without

    reread = partial(rereading.reread, begun.log, used, begun.timing, begun.phases)
    if used.control_moment_gyros and (read := reread()) is not None:
        return read
    found = diagnose.diagnose(begun.log, used, begun.timing, begun.pieces)
    found = (reread() or found) if used.rotors and found.unknown and not found.faults else found
    return replace(found, unknown=OTHER_CUTOFFS) if refuted and not (found.faults or found.unknown) else found


def _unexplained(diagnosis: Diagnosis | None, others: Sequence[Notice]) -> str:
    """That nothing explains the log; not where a floor stands in for its noise, against which no model fits."""
    known = all(notice.code != "noise-floor" for notice in others)
    return diagnosis.unknown if diagnosis and known else ""


def _baffled(told: Checked, used: Vehicle, begun: Ready) -> str:
    """That a disturbance was sized for what is none: beside it the log contradicts an assumption, and no named cause explains that."""
    first = next((doubt for doubt in told.doubts if doubt.sure and not doubt.faint), None)
    if first is None or _unread(begun.log) or (told.diagnosis and told.diagnosis.faults) or not sized(used, begun.stated):
        return ""
    what = first.what.replace("-", " ")
    return (
        f"log and vehicle file don't fit, cause unknown: beside the disturbance that stands for what is left the log would fit better by "
        f"{sigmas(first.sigmas)} sigma with another {what}; so it is no disturbance, and if not that, something that goes with the commands"
    )


def _unread(log: Log) -> list[Notice]:
    return [notice for notice in log.notices if notice.code in UNREAD]


def _checked_timing(settled: Sequence[History], at: Timing, examination: Examined) -> FoundTiming | None:
    """What the log says of a stated delay that is off by little if at all; None where nothing tells."""
    known = [history.cycles for history in settled if history.reference is not None]
    later = examination.delay()
    if later is None or abs(later.cycles) >= delay.MISMATCH or at.delay + later.cycles < 0:
        return None
    rows = 6 * sum(cycles.stop - cycles.start for cycles in known)
    scale = max(later.before / rows, 1.0)
    return delay.near(at, later.cycles, later.sigma * scale**0.5, later.after / rows)
