"""Diagnosis of a log that does not fit its vehicle file: the cause, its rivals, or none.

- Every hypothesis of :mod:`massprop_cli.diagnosis.hypotheses` is fitted to one reduction of the log
  (:mod:`massprop_cli.diagnosis.screening`).
- The best ones are applied to log and vehicle file, and the log is reduced again. So the result is exact.
- A cause is named only if the corrected log passes its test. Causes with a similar score are reported as rivals.
- If no single cause suffices, pairs are tested.

massprop never changes its inputs.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import chain, islice

import numpy as np

from massprop_cli.base.levels import CLEAR, MAIN_PART, SHORT
from massprop_cli.diagnosis import NO_CAUSE, delay, hypotheses
from massprop_cli.diagnosis.channelpairs import swapped, two_channels, wired
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.design import Case, Designs
from massprop_cli.diagnosis.episode import episodes
from massprop_cli.diagnosis.explanation import (
    ABSENT,
    DEAD,
    LOGGED_AFTER,
    UNANSWERED,
    chosen,
    fitting_causes,
    goes_with_random_walk,
    words_of,
)
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.inspection import gravity_felt, lost_records, sparse_commands
from massprop_cli.diagnosis.masschange import COMMANDED, Segments, likeliest_change, mass_change
from massprop_cli.diagnosis.phaseboundary import phase_boundary
from massprop_cli.diagnosis.recordings import logged_after, low_pass_refits, recording_refits, units_by_noise
from massprop_cli.diagnosis.refit import (
    MOST_CYCLES,
    Refit,
    chi_square_limit,
    corrected_alone,
    hopeless,
    refined,
    refined_from,
    refitted,
    refitted_each,
)
from massprop_cli.diagnosis.screening import Screening, busiest, relinearised, screened, under_likeliest_torque
from massprop_cli.diagnosis.search import codes, equivalent, searched
from massprop_cli.diagnosis.undisturbed import undisturbed
from massprop_cli.errorparameters.table import PRIORS
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import JITTER, Log, jitter
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.timing import Timing

FINALISTS = (6, 12)
"""Most refits until one fits: in free flight; on a bearing, where a wrong gyro turns gravity too."""
FIRST, SECOND = (2, 3), 2
"""Number of first causes of pairs, in free flight and on a bearing, where gravity separates the stated mounting from others but these not
from one another; and refits of second causes for each if none fits (docs/faults.md, dead-turned)."""
NOTHING = 0.5
"""Sigmas of chance within which a refit leaves nothing to explain."""


Search = Callable[[Screening], Diagnosis | None]


def diagnose(log: Log, vehicle: Resolved, timing: Timing, pieces: Sequence[slice]) -> Diagnosis:
    """Cause of the misfit of the piece that fits worst, in a log that failed a test.

    ``vehicle`` must state noise levels, and no disturbance beyond what the vehicle file states.
    """
    if not all(log.axes):
        return Diagnosis(unknown=ABSENT)
    case = Case(log, vehicle, timing, Designs())
    screenings = [screening for piece in pieces if (screening := screened(*busiest(case, piece))) is not None]
    if not screenings:
        return Diagnosis()
    # without commands the columns are the noise that they should explain
    driven = [screening for screening in screenings if len(screening.free.fired)]
    screening = max(driven or screenings, key=lambda one: one.misfit)
    if screening.within_chance and (elsewhere := _around_change(case, pieces)) is not None:
        screening, screenings = elsewhere, [elsewhere]
    if (at_sight := _before_hypotheses(screening)) is not None:
        return at_sight
    screening = relinearised(screening)
    causes, lost_text = _single_causes(screening), sparse_commands(screening.case) or lost_records(log)
    if lost_text and not any(map(_explains_all, causes)):
        return Diagnosis(unknown=lost_text)
    torque = under_likeliest_torque(screening)
    segments = cache(partial(undisturbed, screening, float(log.time_s[-1])))
    diagnosis = _distant_cause(screening, causes, torque, segments) or chosen(screening, causes)
    diagnosis = diagnosis if any(map(_explains_all, causes)) else _temporary_failure(screening, screenings, diagnosis, causes, segments)
    # a random-walk torque may explain it too, or a cause that goes with one
    walking = [refit.score for refit in causes if refit.fits and goes_with_random_walk(refit, screening)]
    least = min([torque.cost, *walking]) - CLEAR
    following = torque.free.command_significance > COMMANDED
    for search in () if torque.fits_closely and following else _further(screening, causes, torque, least, segments):
        if diagnosis is not None and diagnosis.score < least:
            break
        diagnosis = search(screening)
    if diagnosis is not None and diagnosis.score < least:
        return diagnosis
    boundary = next((placed for one in screenings if (placed := phase_boundary(one, float(log.time_s[-1]))) is not None), None)
    if boundary is not None:  # the other causes need no random-walk torque
        return Diagnosis((Fault(Notice("phase-border", boundary.words), boundary.correction),))
    kept = segments()
    if kept is not None:
        return Diagnosis((Fault(Notice("phase-border", kept.words), kept.correction(vehicle)),))
    if screening.fits and (units := chosen(screening, units_by_noise(screening))) is not None:
        return units
    unanswered = not following and screening.far_exceeds_noise
    explained = not unanswered and (torque.fits_closely or walking)
    return Diagnosis() if explained else _without_cause(screening, UNANSWERED if unanswered else _unknown_cause(screening))


def _before_hypotheses(screening: Screening) -> Diagnosis | None:
    """Result without hypotheses; None if hypotheses are to be fitted."""
    if screening.free.dead_sensor:
        return Diagnosis(unknown=DEAD)
    notice = gravity_felt(screening.case)
    if notice is not None:
        return Diagnosis((Fault(notice, None),))
    vehicle = screening.case.vehicle
    # a swing determines ratios only, so a body leaves no residual
    return Diagnosis() if vehicle.on_pedestal and not len(screening.free.fired) and not vehicle.swings else None


def _around_change(case: Case, pieces: Sequence[slice]) -> Screening | None:
    """Screening of the cycles around the most likely change of the body, if the most commanded cycles fit and these do not."""
    longest = max(pieces, key=lambda piece: piece.stop - piece.start)
    if longest.stop - longest.start <= SHORT or (case.vehicle.pivoted and case.log.attitude_wxyz is None):
        return None
    part, piece = busiest(case, longest, MOST_CYCLES)
    change_at = likeliest_change(part, piece)
    if change_at is None:
        return None
    first = min(max(change_at[0] - SHORT // 2, piece.start), piece.stop - SHORT)
    about, around = busiest(part, slice(first, first + SHORT))
    screening = screened(about._replace(whole=(case.log, longest)), around)
    return None if screening is None or screening.within_chance else screening


def _without_cause(screening: Screening, unknown: str) -> Diagnosis:
    """Result without a cause: commands logged after they act, which no vehicle file corrects; otherwise no fault."""
    cycles = logged_after(screening.case)
    text = LOGGED_AFTER.format(cycles - screening.case.timing.delay, cycles)
    return Diagnosis((Fault(Notice("delay-mismatch", text), None),)) if cycles else Diagnosis(unknown=unknown)


def _further(screening: Screening, causes: Sequence[Refit], torque: Screening, least: float, segments: Segments) -> list[Search]:
    """Further searches that may score below ``least``, the most likely first: constant errors by pairs, or changes in time."""
    pair = partial(_pair, causes=causes, worst=min([least, *(refit.score for refit in causes)]))
    changed = partial(mass_change, torque=torque, segments=segments)
    two: list[Search] = [swapped, pair]
    best = min(causes, key=lambda refit: refit.score, default=None)
    if best is not None and "fuel-use" in codes(best):
        return [changed, _distant_delay, _distant_low_pass, *two]
    return (
        [*two, _distant_delay, _distant_low_pass, changed]
        if screening.constant or screening.gravity_misplaced
        else [_distant_delay, _distant_low_pass, changed, *two]
    )


def _explains_all(refit: Refit) -> bool:
    """Whether a refit leaves hardly more than the stated noise, so that nothing else can explain more."""
    left = refit.screening
    return refit.fits and left is not None and left.constant and left.misfit < 1 + NOTHING * np.sqrt(2 / left.degrees_of_freedom)


def _temporary_failure(
    screening: Screening, screenings: Sequence[Screening], found: Diagnosis | None, causes: Sequence[Refit], segments: Segments
) -> Diagnosis | None:
    """Temporary failure of a jet if it explains more than ``found`` and the single ``causes``; otherwise ``found``.

    A failure that leaves more than chance does not count if undisturbed segments leave no more.
    """
    cause = min((refit for refit in causes if refit.fits and refit.screening is not None), key=lambda refit: refit.score, default=None)
    failures = episodes(screening, screenings, cause)
    if not failures or (found is not None and found.score < failures[0].score + CLEAR):
        return found
    best, vehicle = failures[0], screening.case.vehicle
    if not (best.screening.within_chance and best.screening.constant) and segments() is not None:
        return found
    message = f"the log fits if {', or else '.join(one.words for one in failures)}; check its valve and supply, and state thrust.failures"
    sigma_variant = (best.correction(vehicle, 1.0),) if best.sigma else ()
    rivals = tuple(one.correction(vehicle) for one in failures[1:])
    return Diagnosis((Fault(Notice(best.code, message), best.correction(vehicle), around=sigma_variant, rivals=rivals),), score=best.score)


def _single_causes(screening: Screening) -> list[Refit]:
    """Refits of the most likely single causes."""
    begun = refitted_each(screening, screening.gravity_candidates) if screening.gravity_misplaced else []
    most = SECOND if screening.gravity_misplaced else FINALISTS[screening.model.bearing is not None]
    refits = searched(screening, begun, (most, most), chi_square_limit(screening))
    refits += low_pass_refits(screening)
    refits += _device_axes(screening)
    refits += [] if any(map(_explains_all, refits)) else recording_refits(screening, refits)
    best = min((refit for refit in refits if refit.fits), key=lambda refit: refit.score, default=None)
    if best is not None and best.fitted.hypothesis.turns_gyro:
        # exchanged actuators may look like a turn of the whole vehicle
        return [*refits, *wired(screening)]
    return refits if screening.gravity_misplaced or best is not None else [*refits, *refitted_each(screening, screening.gravity_candidates)]


def _device_axes(screening: Screening) -> list[Refit]:
    """Refits of the axes of wheels and gyros. Screening prefers other scales of their momentum, which the axes explain in part."""
    fits = screening.fitted(hypotheses.device_axes(screening.model, screening.names), screening.stated.value("theta"))
    return refitted_each(screening, (found for found in fits if not hopeless(screening, found, chi_square_limit(screening))))


def _distinct(each: Iterable[Fitted]) -> Iterator[Fitted]:
    """Fits without repeated causes."""
    distinct: list[Fitted] = []
    for fit in each:
        if not any(equivalent(one, fit) for one in distinct):
            distinct.append(fit)
            yield fit


def _distant_cause(screening: Screening, causes: Sequence[Refit], torque: Screening, segments: Segments) -> Diagnosis | None:
    """A distant cause that the most likely single cause may stand for.

    A turned gyro may stand for a delay of cycles, if a torque or more noise than stated remains; fuel use for a sudden change of the body.
    """
    best = next(iter(fitting_causes(screening, causes)), None)
    if best is None:
        return None
    if best.screening is not None and (best.screening.free.disturbances or best.screening.exceeds_noise):
        with_delay = _distant_delay(screening)
        return with_delay if with_delay is not None and with_delay.score < best.score else None
    if "fuel-use" in codes(best):
        return mass_change(screening, torque, segments, max(float(best.fitted.chi_square.sum()) - screening.degrees_of_freedom, 0.0))
    return None


def _distant_delay(screening: Screening) -> Diagnosis | None:
    """A distant command delay, started at the delay of least free-response cost."""
    log, vehicle, timing, *_ = screening.case
    rated = delay.search(log, vehicle, [timing.lag], pieces=[screening.piece])
    if not rated:
        return None
    at = rated[0].at
    hypothesis = Hypothesis("delay-mismatch", (), hypotheses.along(screening.model, ("delay", np.ones(1))))
    start = screening.unfitted(hypothesis, delay=at.delay - timing.delay)
    refit = refined(screening, start, screening.case._replace(timing=timing._replace(delay=at.delay)))
    return None if refit is None else chosen(screening, [refit])


def _distant_low_pass(screening: Screening) -> Diagnosis | None:
    """A distant low-pass of a sensor."""
    refits = []
    for sensor in ("gyro", "accel"):
        hypothesis = next(one for one in hypotheses.timing(screening.model) if one.code == f"{sensor}-filter")
        refit = refined_from(screening, screening.unfitted(hypothesis, **{f"{sensor}_lag": PRIORS[f"{sensor}_lag"]}))
        refits += [] if refit is None else [refit]
    return chosen(screening, refits)


def _pair(screening: Screening, causes: Sequence[Refit], worst: float) -> Diagnosis | None:
    """Two causes at once that score below ``worst``: two channels, or one of the most likely few and what explains its residual."""
    if (channels := two_channels(screening, any(refit.fits for refit in causes))) is not None:
        return channels
    gravity_candidates = [found.hypothesis for found in screening.gravity_candidates]
    likeliest = sorted(
        (refit for refit in causes if any(refit.fitted.hypothesis is one for one in gravity_candidates)), key=lambda refit: refit.score
    )
    turned = (replace(screening.stated, hypothesis=one) for one in screening.turn_with_free_channel)
    each = chain((refit.fitted for refit in likeliest), turned, (found for _, found in screening.ranked))
    pairs, firsts = list[Refit](), list[Refit]()
    pairs_with = partial(_pairs_with, screening, worst=worst)
    for found in islice(_distinct(each), FIRST[screening.model.bearing is not None]):
        known_refit = next((one for one in causes if one.fitted.hypothesis is found.hypothesis), None)
        refit = known_refit or refitted(screening, found)
        firsts += [] if refit is None else [refit]
        # a refit that fits alone was beyond the screening's accuracy
        pairs += [refit] if known_refit is None and refit is not None and refit.fits else pairs_with(refit, pairs)
        if any(refit.fits for refit in pairs):
            break  # its rivals share a part with it
    # the second cause may be an unstated torque
    pairs += [refit for first in firsts if (refit := _beside_a_torque(first)) is not None]
    # the second cause may have been found next to an inaccurate or wrong first one
    best = min(pairs, key=lambda refit: refit.score, default=None)
    parts = () if best is None else best.fitted.parts
    exact = best is not None and best.fits and best.screening is not None and best.screening.within_chance
    for i, part in enumerate(parts if len(parts) > 1 else ()):
        # if the pair is exact, a part about a channel has rivals about it or about others
        if (i > 0 or part.unknowns) and not (exact and screening.model.channel(part.hypothesis) is not None):
            pairs += pairs_with(corrected_alone(screening, part), pairs)
    return chosen(screening, pairs)


def _pairs_with(screening: Screening, first: Refit | None, others: Sequence[Refit], worst: float) -> list[Refit]:
    """Pairs with a corrected first cause and score below ``worst``; ``others`` are refits that compete.

    A first cause that leaves a channel without effect has none, since its screening lacks the channel.
    """
    if first is None or first.screening is None or len(first.screening.free.fired) != len(screening.free.fired):
        return []
    most = chi_square_limit(first.screening)
    if first.fitted.unknowns and np.isfinite(first.score):
        # the values of a first cause fitted alone move with a second
        most = max(most, MAIN_PART * first.screening.misfit * first.screening.degrees_of_freedom)
    worst_excess = worst - first.screening.free_cost - first.unit_cost
    return searched(screening, [], (SECOND, FINALISTS[0]), most, first, others, worst_excess)


def _beside_a_torque(first: Refit) -> Refit | None:
    """A corrected cause under a disturbance torque; None if the log does not fit then, or fits without it."""
    corrected = first.screening
    if (
        corrected is None
        or corrected.fits_closely
        or not corrected.constant
        or float(corrected.stated.chi_square.sum()) > chi_square_limit(corrected)
    ):
        return None
    with_torque = under_likeliest_torque(corrected)
    if not with_torque.fits_closely:
        return None
    excess = with_torque.score(with_torque.stated.chi_square, first.fitted)
    return replace(first, excess=excess, score=with_torque.free_cost + excess + first.unit_cost, fits=True, screening=with_torque)


def _unknown_cause(screening: Screening) -> str:
    """Text for an unknown cause: what was tried, and what came nearest."""
    nearest: dict[str, str] = {}
    for _, found in islice(screening.ranked, 4):
        code, _ = words_of(found, screening.names, screening.case, screening.case)
        about = f" of {', '.join(found.hypothesis.subject)}" if found.hypothesis.subject else ""
        nearest.setdefault(f"{code}{about}", f"{100 * found.chi_square.sum() / screening.stated.chi_square.sum():.2g} %")
    text = ", ".join(f"{what} leaves {left}" for what, left in islice(nearest.items(), 2))
    near = f"; nearest hypotheses: {text} of the misfit" if text else ""
    scatter = jitter(screening.case.log.interval_s)
    if scatter > JITTER:
        near += f"; record intervals scatter by {100 * scatter:.2g} %: if time_s are arrival times, state imu.clock_even = true"
    return f"{NO_CAUSE}: residuals are {screening.misfit:.3g} times the noise variance{near}"
