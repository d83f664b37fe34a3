"""The composed flow: a log and its vehicle in, an :class:`Analysis` out."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.errors import AttitudeError, InputError, UntoldError
from massprop_cli.conclude import correctedestimate
from massprop_cli.conclude.analysis import Analysis, CorrectedEstimate
from massprop_cli.conclude.assumptions import assumptions
from massprop_cli.conclude.estimated import estimated
from massprop_cli.conclude.firstfit import first_fits
from massprop_cli.conclude.judge import judged
from massprop_cli.conclude.pivot import with_pivot
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import in_doubt
from massprop_cli.diagnosis import UNKNOWN, sensorkernel
from massprop_cli.estimate.crossvalidation import CrossValidation, cross_validation
from massprop_cli.estimate.phases import AsStated, Progress
from massprop_cli.inputs import clipped, vehiclefile
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.resolved import Resolved

UNFIT = (
    "the log fits only without columns quat_w … quat_z, so massprop did not use them; check their convention (wxyz, world from body, Z "
    "up), frame (Z vertical) and latency"
)
"""Of a logged attitude."""
TILTED = "attitude-start"
"""Cause of what is left without a logged attitude, whose room was out of level, too: the vehicle began otherwise than is stated."""
LATE = {"delay-mismatch"}
"""Causes for which one sensor may be taken that is later than the other."""
EXPLAINED, FITS, FAR = 0.1, 2.0, 1e3
"""Part of the mean squared residual, and times the noise, beyond which a low-pass with about the most likely cutoff is not what is wrong: a
cutoff that is off by a fifth leaves a part of 0.04. And times the noise beyond which it never is: the fit without may have run away."""


def examine(log: Log, source: VehicleSource, assignments: Sequence[str] = (), progress: Progress | None = None) -> Analysis:
    """A log at hand: estimate, look for what contradicts, correct it beside, judge."""
    try:
        return _examined(log, source, assignments, progress or (lambda *_: None))
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"{log.path}: cannot estimate: the log and {source.source or 'this vehicle'} give an ill-conditioned problem ({error}); check "
            "units, noise levels, [known] and estimator settings"
        ) from None


def _examined(log: Log, source: VehicleSource, assignments: Sequence[str], say: Progress) -> Analysis:
    read, stated = clipped.with_unstated(log), source
    log, source, *_ = sensorkernel.found(read, stated, say)
    logged = carried = log.attitude_wxyz is not None and source.vehicle.pivoted
    try:
        first = first_fits(log, source, say)
        if carried and first[1] is not None and first[1].misfit:
            carried = False  # tried once: before anything else is doubted of a log that does not fit
            without = _tried(_without_attitude(log, UNFIT), source, assignments, say)
            if without is not None and _explained(without):
                return without
        found = estimated(log, source, assignments, say, first=first)
    except UntoldError as error:
        if source is not stated:  # of a low-pass that is too short to be found
            return _examined(read, sensorkernel.without(stated), assignments, say)
        return _by_likeliest(log, source, assignments, say, error)
    except AttitudeError as error:
        return _examined(
            _without_attitude(log, f"{str(error).removeprefix(f'{log.path}, ')}: massprop did not use them"), source, assignments, say
        )
    parts = correctedestimate.split_at_change(found)
    if parts is not None:
        again = _examined(found.log, parts, assignments, say)
        changes = (fault.notice for fault in found.faults if fault.change_s is not None)
        return replace(again, source=source, notices=(*changes, *again.notices))
    told = None if carried and (found.faults or found.unknown) else judged(*correctedestimate.with_corrections(found, say))
    if (carried and (told is None or not _explained(told))) or (logged and told is not None and _unexplained(told)):
        again = _examined(_without_attitude(log, UNFIT), source, assignments, say)
        if _explained(again) or {fault.notice.code for fault in again.faults} == {TILTED}:
            return again
    told = told or judged(*correctedestimate.with_corrections(found, say))
    if {fault.notice.code for fault in told.faults} <= LATE and not _fits(told):
        tried = _by_other_kernels(log, source, assignments, say, first[1], not told.faults)
        if tried is not None:
            return tried
    if source is not stated and not told.faults and not _fits(told):
        # a wrong delay looks like a low-pass of both sensors
        again = _examined(read, sensorkernel.without(stated), assignments, say)
        if again.faults or _fits(again):
            return again
    return _complete(told)


def _complete(told: Analysis) -> Analysis:
    """With what its values rest on, and about a pivot."""
    rests_on = assumptions(told.examination, told.log, told.vehicle, told.settled, told.conclusions)
    return with_pivot(replace(told, assumptions=rests_on, cross_validations=_cross_validations(told)))


def _cross_validations(found: Analysis) -> tuple[CrossValidation | None, ...]:
    """Of each phase; empty where nobody asks for them."""
    if found.stated.estimator.cross_validate is None:
        return ()
    every = list[CrossValidation | None]()
    for settled in found.settled:
        one = None
        if settled.reference is not None and found.plain is not None and isinstance(found.vehicle, Resolved):
            vehicle = found.vehicle.in_phase(settled.phase)
            with suppress(np.linalg.LinAlgError):
                one = cross_validation(found.samples, settled.cycles, settled.reference, vehicle, found.plain.consider)
        every.append(one)
    return tuple(every)


def _by_other_kernels(
    log: Log, source: VehicleSource, assignments: Sequence[str], say: Progress, plain: AsStated | None, unnamed: bool
) -> Analysis | None:
    """With sensors behind low-passes, or one later than the other, as the log shows; None where nearly so it leaves most of ``plain``.

    Nor where it doesn't fit then, behind low-passes or where a cause is named otherwise. By which sensor is later, a little may be left: of
    fast turns it is known to first order. So where none is named otherwise none is looked for in that little; sigmas include it.
    """
    shown = sensorkernel.found(log, source, say, unfit=True)
    if shown.log is log or plain is None:
        return None
    with suppress(InputError):
        _, nearly = first_fits(shown.log, shown.source if shown.apart else shown.nearest, say)
        if nearly is None or nearly.left > max(min(EXPLAINED * plain.left, FAR), FITS):
            return None
        if not shown.apart:
            found = _tried(shown.log, shown.source, assignments, say)
            return found if found is not None and _fits(found) else None
        found = _examined(shown.log, shown.source, assignments, say)
        if found.faults and unnamed and nearly.left < FITS:
            found = _complete(judged(estimated(shown.log, shown.source, assignments, say, check=False)))
        return found if _fits(found) or (unnamed and not found.faults) else None
    return None


def _tried(log: Log, source: VehicleSource, assignments: Sequence[str], say: Progress) -> Analysis | None:
    """The same; None where the log can't tell what it was asked for, or the stated noise doesn't explain it as it is then either."""
    try:
        _, plain = first_fits(log, source, say)
        return None if plain is None or plain.misfit else _examined(log, source, assignments, say)
    except InputError:
        return None


def _fits(found: Analysis) -> bool:
    """Whether nothing is known to be wrong with a log."""
    verdicts = {one.verdict for conclusion in found.conclusions for one in conclusion.estimates.values()}
    return not found.faults and "contradicted" not in verdicts and UNKNOWN not in {notice.code for notice in found.notices}


def _explained(found: Analysis) -> bool:
    """Whether nothing is, and its sigmas are those of what is stated."""
    return _fits(found) and not any(found.discrepancies)


def _unexplained(found: Analysis) -> bool:
    """Whether something is wrong, and nothing that has a name."""
    return not _fits(found) and all(fault.notice.code == UNKNOWN for fault in found.faults)


def _without_attitude(log: Log, why: str) -> Log:
    """The gyro carries the attitude from environment.initial_attitude_wxyz on."""
    return replace(log, attitude_wxyz=None, notices=(*log.notices, Notice("attitude-misfit", why)))


def _by_likeliest(log: Log, source: VehicleSource, assignments: Sequence[str], say: Progress, error: UntoldError) -> Analysis:
    """What the most likely timing gives where the log can't tell it; no value is called converged then.

    Another fault may hide it, which has a name under about the right one.
    """
    if not error.settings:
        raise error
    found = _examined(log, replace(source, vehicle=vehiclefile.changed(source.vehicle, error.settings)), assignments, say)
    taken = " and ".join(error.settings[::2])
    told = Notice(
        "timing-untold",
        f"{str(error).removeprefix(f'{log.path}: ')}; massprop assumed the most likely: {taken}; no value counts as converged",
    )
    conclusions = tuple(in_doubt(one, dict.fromkeys(QUANTITIES, Reason.of("timing-untold", taken=taken))) for one in found.conclusions)
    return replace(found, source=source, conclusions=conclusions, notices=(told, *found.notices))


__all__ = ["Analysis", "CorrectedEstimate", "Progress", "examine"]
