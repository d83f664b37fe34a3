"""Estimation of one log: timing, noise levels, causes of a misfit, estimates and their sensitivity to the assumptions."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from massprop_cli.conclude.analysis import Analysis
from massprop_cli.conclude.assumptions import SensitivityAnalysis, sensitivity_analysis, without_invalid
from massprop_cli.conclude.channelresiduals import channel_residual_test
from massprop_cli.conclude.discrepancy import PlainFits
from massprop_cli.conclude.firstfit import first_fits
from massprop_cli.conclude.reason import sigmas
from massprop_cli.conclude.score import Doubt, doubts
from massprop_cli.conclude.verdict import conclude
from massprop_cli.diagnosis import NO_CAUSE, UNKNOWN, delay
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
    f"{NO_CAUSE}: another low-pass cutoff with another delay would fit the log better than the stated cutoff; "
    'state cutoff_hz = "auto", or its cutoff_sigma_hz, in [imu.gyro_filter] and [imu.accel_filter]'
)
FEW = 2
"""Largest number of cycles with commands that cannot identify a cause other than a delay. With so few, a third of the error-free logs
without an estimate had a false cause; with three, one in forty (tests/conclude/test_few_commands.py)."""
UNITS = {"gyro-units", "accel-units", "column-kind"}
"""Causes that scale the readings."""


class Checks(NamedTuple):
    """Tests of the assumptions behind an estimate."""

    diagnosis: Diagnosis | None = None
    examination: SensitivityAnalysis | None = None
    doubts: Sequence[Doubt] = ()
    detected: FoundTiming | None = None
    """Timing as estimated from the log."""
    plain: PlainFits | None = None


def estimated(
    log: Log,
    source: VehicleSource,
    assignments: Sequence[str],
    say: Progress,
    check: bool = True,
    first: tuple[Ready, AsStated | None] | None = None,
) -> Analysis:
    """Estimate a log and test its assumptions; disturbances are estimated only if no named cause explains a misfit.

    ``check`` enables the search for causes. ``first`` is the result of :func:`first_fits`, if already available.
    """
    begun, plain = first or first_fits(log, source, say)
    if plain is None:
        checks = Checks(detected=begun.detected)
        answer: Estimates[Vehicle] = by_thesis(begun.samples, begun.phases, begun.stated)
    else:
        answer, checks = _by_default(begun, plain, check, say)
    unknown = _unknown_cause(checks.diagnosis, answer.notices) or _correlated_disturbance(checks, answer.used, begun)
    void = (Fault(notice, None) for notice in begun.log.notices if notice.code in VOID)
    unknown_notices = [Notice(UNKNOWN, unknown)] if unknown else []
    notices = *begun.log.notices, *begun.notices, *unknown_notices, *answer.notices
    return Analysis(
        log=log,
        source=source,
        vehicle=answer.used,
        stated=begun.stated,
        samples=begun.samples,
        timing=begun.timing,
        detected=checks.detected,
        histories=answer.histories,
        settled=tuple(answer.settled) or answer.histories,
        conclusions=tuple(conclude(history, answer.used) for history in answer.histories),
        docked=None,
        notices=(*notices, *(notice for history in answer.histories for notice in history.notices)),
        assignments=tuple(assignments),
        examination=checks.examination,
        faults=(*void, *(checks.diagnosis.faults if checks.diagnosis else ())),
        unknown=unknown,
        doubts=tuple(checks.doubts),
        plain=checks.plain,
    )


def _by_default(begun: Ready, plain: AsStated, check: bool, say: Progress) -> tuple[Estimates[Resolved], Checks]:
    """Estimate by the default method, with the sensitivity analysis; ``check`` enables the search for causes of a misfit."""
    refuted = check and not plain.dubious and other_cutoffs(begun.log, plain.used, begun.pieces, begun.detected)
    diagnosis = _density_diagnosis(begun, plain) if check else None
    if diagnosis is None and check and (plain.dubious or plain.quiet or refuted):
        diagnosis = _diagnosis(begun, plain.used, say, refuted)
        if diagnosis is not None and not (plain.dubious or refuted) and not _credible_in_low_noise(diagnosis, plain):
            diagnosis = None  # the stated noise is too large, which is no fault
        if diagnosis is not None and not plain.misfit and _too_few_commands(diagnosis, begun.log):
            diagnosis = None
    size = begun.stated.estimator.adapt_noise and not (diagnosis and diagnosis.faults)
    # a wrong model leaves residuals like a torque; more sensor noise would absorb half of them and keep the sigmas too small
    noisier = diagnosis is not None and not diagnosis.unknown
    answer = estimates(begun.samples, begun.phases, plain, begun.consider, say, size=size, noisier=noisier)
    used = answer.used
    fits = PlainFits(plain.used, tuple(None if fit is None else fit.history.reference for fit in plain.fits), begun.consider, plain.left)
    say("what the numbers rest on", 1.0)
    disturbed = sized(used, begun.stated)
    analysis = sensitivity_analysis(begun.log, used, begun.timing, begun.samples, answer.settled, begun.consider, disturbed)
    analysis = without_invalid(analysis, answer.settled)
    in_doubt = _doubts(analysis, begun, answer)
    if not check:
        return answer, Checks(doubts=in_doubt, detected=begun.detected, plain=fits)
    if any(one.refuted and not one.joint for one in in_doubt) and diagnosis is None:
        diagnosis = _diagnosis(begun, used, say)
    detected = begun.detected or (diagnosis.detected if diagnosis else None)
    if detected is None and not disturbed:
        detected = _checked_timing(answer.settled, begun.timing, analysis)
    return answer, Checks(diagnosis, analysis, in_doubt, detected, fits)


def _credible_in_low_noise(diagnosis: Diagnosis, plain: AsStated) -> bool:
    """Whether a diagnosis of a log with little noise is credible; without any noise, only a wrong unit is, which hides the noise."""
    codes = {one.notice.code for one in diagnosis.faults}
    noise_free = all(fit is not None and fit.history.noise_free for fit in plain.fits)
    return bool(codes) and (not noise_free or codes <= UNITS)


def _too_few_commands(diagnosis: Diagnosis, log: Log) -> bool:
    """Whether a diagnosis other than a wrong delay rests on at most :data:`FEW` cycles with commands."""
    few = not log.spinning and 0 < int(np.count_nonzero(log.command.any(1))) <= FEW
    return few and not {one.notice.code for one in diagnosis.faults} <= {"delay-mismatch"}


def _doubts(analysis: SensitivityAnalysis, begun: Ready, answer: Estimates[Resolved]) -> list[Doubt]:
    """Assumptions and channels in doubt."""
    names = channel_names(begun.log, answer.used)
    push = pushing(channel_wrench(begun.log, answer.used)[:, 3:], always_together(begun.log))
    first = len(names) - len(answer.used.momentum_wrench)
    momentum_devices = range(first, len(names))
    kinds = [range(first), momentum_devices] if first and momentum_devices else [push] if push else []
    assumptions = doubts(analysis, names, along_one_line(begun.log, answer.used), kinds)
    return assumptions + channel_residual_test(answer.settled, begun.samples, names, analysis.scatter)


def _density_diagnosis(begun: Ready, plain: AsStated) -> Diagnosis | None:
    """Another reading of the rotors' columns that gives a possible density, if the stated one gives an impossible density."""
    ends = [(fit.history.values[-1], fit.history.sigmas[-1]) for fit in plain.fits if fit is not None]
    if not plain.used.rotors or not any(exceeds_density(*end) for end in ends):
        return None
    from massprop_cli.diagnosis import rereading

    return rereading.reread(begun.log, plain.used, begun.timing, begun.phases, no_matter=True)


def _diagnosis(begun: Ready, used: Resolved, say: Progress, refuted: bool = False) -> Diagnosis | None:
    """Causes of a misfit; None if a sensor saturates or stands still.

    Other readings of the columns are tested for rotors if no hypothesis explains the log, and for control moment gyros first. A log that
    ``refuted`` a cutoff always has a cause, known or unknown.
    """
    if _unusable_readings(begun.log):
        return None
    say("looking for the cause", 1.0)
    from massprop_cli.diagnosis import diagnose, rereading  # most logs do without these modules

    reread = partial(rereading.reread, begun.log, used, begun.timing, begun.phases)
    if used.control_moment_gyros and (other_reading := reread()) is not None:
        return other_reading
    found = diagnose.diagnose(begun.log, used, begun.timing, begun.pieces)
    found = (reread() or found) if used.rotors and found.unknown and not found.faults else found
    return replace(found, unknown=OTHER_CUTOFFS) if refuted and not (found.faults or found.unknown) else found


def _unknown_cause(diagnosis: Diagnosis | None, others: Sequence[Notice]) -> str:
    """Message of a misfit without a known cause; empty if a noise floor replaces the noise, because no model fits that closely."""
    known = all(notice.code != "noise-floor" for notice in others)
    return diagnosis.unknown if diagnosis and known else ""


def _correlated_disturbance(checks: Checks, used: Vehicle, begun: Ready) -> str:
    """Message that the estimated disturbance is none: the log refutes an assumption in spite of it, and no named cause explains that."""
    first = next((doubt for doubt in checks.doubts if doubt.refuted and not doubt.joint), None)
    if first is None or _unusable_readings(begun.log) or (checks.diagnosis and checks.diagnosis.faults) or not sized(used, begun.stated):
        return ""
    assumption = first.assumption.replace("-", " ")
    return (
        f"{NO_CAUSE}: even with an added disturbance, another {assumption} would fit better by {sigmas(first.sigmas)} sigma, so the error "
        f"is not a disturbance. Check {assumption}, and other errors that follow the commands"
    )


def _unusable_readings(log: Log) -> list[Notice]:
    """Notices of a sensor that saturates or stands still."""
    return [notice for notice in log.notices if notice.code in UNREAD]


def _checked_timing(settled: Sequence[History], at: Timing, analysis: SensitivityAnalysis) -> FoundTiming | None:
    """Timing with a small correction of the stated delay, by its score test; None if the log does not inform it or it is not small."""
    fitted = [history.cycles for history in settled if history.reference is not None]
    error = analysis.delay()
    if error is None or abs(error.cycles) >= delay.MISMATCH or at.delay + error.cycles < 0:
        return None
    rows = 6 * sum(cycles.stop - cycles.start for cycles in fitted)
    scale = max(error.before / rows, 1.0)
    return delay.timing_near(at, error.cycles, error.sigma * scale**0.5, error.after / rows)
