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

from massprop_cli.base.rigidbody import tensor
from massprop_cli.diagnosis import change, delay, hypotheses
from massprop_cli.diagnosis.channelpairs import swapped, two_channels, wired
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import Correction
from massprop_cli.diagnosis.design import Case, Designs
from massprop_cli.diagnosis.episode import episodes
from massprop_cli.diagnosis.explanation import (
    ABSENT,
    DEAD,
    LOGGED_AFTER,
    UNANSWERED,
    by_wander,
    chosen,
    fitting_causes,
    words_of,
)
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.inspection import lost, seen, sparse
from massprop_cli.diagnosis.phaseboundary import border
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.recordings import by_noise, logged_after, otherwise, otherwise_filtered
from massprop_cli.diagnosis.refit import MOST, Refit, beyond, corrected_alone, helped, hopeless, refined, tried, tried_each
from massprop_cli.diagnosis.screening import LONGEST, Screening, about_its_body, beside_a_torque, busiest, screened
from massprop_cli.diagnosis.search import codes, same, searched
from massprop_cli.diagnosis.undisturbed import Undisturbed, undisturbed
from massprop_cli.errorparameters.table import PRIORS
from massprop_cli.estimate.initial import first_reference
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import JITTER, Log, jitter
from massprop_cli.model.plant.plant import MU
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.timing import Timing

FINALISTS = (6, 12)
"""Most refits until one fits: in free flight; on a bearing, where a wrong gyro turns gravity too."""
FIRST, SECOND = (2, 3), 2
"""Number of first causes of pairs, in free flight and on a bearing, where gravity separates the stated mounting from others but these not
from one another; and refits of second causes for each if none fits (docs/faults.md, dead-turned)."""
LEFT = 0.5
"""Part of the excess of one body that two bodies may leave; a real change leaves a tenth (docs/faults.md)."""
WITH_IT = 0.5
"""Part of the excess of a first cause, fitted alone, that a screened second cause may leave. A weak jet next to a tilted IMU left up to
0.26 (docs/faults.md, weak-tilted)."""
PROPORTION = 0.02
"""Relative difference up to which two bodies count as proportional in all that answers thrust, or as different in the CG alone."""
NOTHING = 0.5
"""Sigmas of chance within which a refit leaves nothing to explain."""
ANSWERED = 30.0
"""Least significance, in sigmas, of a motion that follows the commands. Vehicles moved by their commands have hundreds, commands of another
recording six, and commands shifted by some cycles 20."""


Search = Callable[[Screening], Diagnosis | None]
Rest = Callable[[], Undisturbed | None]
"""Deferred search for undisturbed segments, evaluated once."""


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
    if screening.chance and (elsewhere := _elsewhere(case, pieces)) is not None:
        screening, screenings = elsewhere, [elsewhere]
    if (at_sight := _at_sight(screening)) is not None:
        return at_sight
    screening = about_its_body(screening)
    single_causes, lost_text = _alone(screening), sparse(screening.case) or lost(log)
    if lost_text and not any(map(_whole, single_causes)):
        return Diagnosis(unknown=lost_text)
    under_torque = beside_a_torque(screening)
    undisturbed_segments = cache(partial(undisturbed, screening, float(log.time_s[-1])))
    diagnosis = _instead(screening, single_causes, under_torque, undisturbed_segments) or chosen(screening, single_causes)
    diagnosis = (
        diagnosis if any(map(_whole, single_causes)) else _for_a_time(screening, screenings, diagnosis, single_causes, undisturbed_segments)
    )
    # a random-walk torque may explain it too, or a cause that goes with one
    with_walk = [refit.score for refit in single_causes if refit.fits and by_wander(refit, screening)]
    least = min([under_torque.cost, *with_walk]) - CLEAR
    follows_commands = under_torque.free.answered > ANSWERED
    for search in (
        () if under_torque.close and follows_commands else _further(screening, single_causes, under_torque, least, undisturbed_segments)
    ):
        if diagnosis is not None and diagnosis.score < least:
            break
        diagnosis = search(screening)
    if diagnosis is not None and diagnosis.score < least:
        return diagnosis
    boundary = next((placed for one in screenings if (placed := border(one, float(log.time_s[-1]))) is not None), None)
    if boundary is not None:  # the other causes need no random-walk torque
        return Diagnosis((Fault(Notice("phase-border", boundary.words), boundary.correction),))
    segments = undisturbed_segments()
    if segments is not None:
        return Diagnosis((Fault(Notice("phase-border", segments.words), segments.correction(vehicle)),))
    if screening.fits and (units := chosen(screening, by_noise(screening))) is not None:
        return units
    unanswered = not follows_commands and screening.loud
    explained = not unanswered and (under_torque.close or with_walk)
    return Diagnosis() if explained else _unexplained(screening, UNANSWERED if unanswered else _in_vain(screening))


def _at_sight(screening: Screening) -> Diagnosis | None:
    """Result without hypotheses; None if hypotheses are to be fitted."""
    if screening.free.dead:
        return Diagnosis(unknown=DEAD)
    notice = seen(screening.case)
    if notice is not None:
        return Diagnosis((Fault(notice, None),))
    vehicle = screening.case.vehicle
    # a swing determines ratios only, so a body leaves no residual
    return Diagnosis() if vehicle.on_pedestal and not len(screening.free.fired) and not vehicle.swings else None


def _elsewhere(case: Case, pieces: Sequence[slice]) -> Screening | None:
    """Screening of the cycles around the most likely change of the body, if the most commanded cycles fit and these do not."""
    longest = max(pieces, key=lambda piece: piece.stop - piece.start)
    if longest.stop - longest.start <= LONGEST or (case.vehicle.pivoted and case.log.attitude_wxyz is None):
        return None
    part, piece = busiest(case, longest, MOST)
    change_at = _likeliest_change(part, piece)
    if change_at is None:
        return None
    first = min(max(change_at[0] - LONGEST // 2, piece.start), piece.stop - LONGEST)
    about, around = busiest(part, slice(first, first + LONGEST))
    screening = screened(about._replace(whole=(case.log, longest)), around)
    return None if screening is None or screening.chance else screening


def _likeliest_change(case: Case, piece: slice) -> tuple[int, float] | None:
    """Cycle and time, s, from which on another body explains most."""
    samples = case.timing.of(case.log, case.vehicle)
    reference = first_reference(samples, piece, case.vehicle)
    at = None if reference is None else change.likeliest(samples, piece, reference, case.vehicle)
    return None if at is None else (at, round(float(samples.executed.start_s[at]), 9))


def _unexplained(screening: Screening, unknown: str) -> Diagnosis:
    """Result without a cause: commands logged after they act, which no vehicle file corrects; otherwise no fault."""
    cycles = logged_after(screening.case)
    text = LOGGED_AFTER.format(cycles - screening.case.timing.delay, cycles)
    return Diagnosis((Fault(Notice("delay-mismatch", text), None),)) if cycles else Diagnosis(unknown=unknown)


def _further(
    screening: Screening, single_causes: Sequence[Refit], under_torque: Screening, least: float, undisturbed_segments: Rest
) -> list[Search]:
    """Further searches that may score below ``least``, the most likely first: constant errors by pairs, or changes in time."""
    pair = partial(_pair, single_causes=single_causes, worst=min([least, *(refit.score for refit in single_causes)]))
    changed = partial(_changed, under_torque=under_torque, undisturbed_segments=undisturbed_segments)
    two: list[Search] = [swapped, pair]
    best = min(single_causes, key=lambda refit: refit.score, default=None)
    if best is not None and "fuel-use" in codes(best):
        return [changed, _much_later, _lowpassed, *two]
    return [*two, _much_later, _lowpassed, changed] if screening.constant or screening.upset else [_much_later, _lowpassed, changed, *two]


def _whole(refit: Refit) -> bool:
    """Whether a refit leaves hardly more than the stated noise, so that nothing else can explain more."""
    left = refit.screening
    return refit.fits and left is not None and left.constant and left.misfit < 1 + NOTHING * np.sqrt(2 / left.freedom)


def _for_a_time(
    screening: Screening,
    screenings: Sequence[Screening],
    found: Diagnosis | None,
    single_causes: Sequence[Refit],
    undisturbed_segments: Rest,
) -> Diagnosis | None:
    """Temporary failure of a jet if it explains more than ``found`` from the causes ``single_causes``; otherwise ``found``.

    A failure that leaves more than chance does not count if the ``undisturbed_segments`` of the log leaves no more.
    """
    cause = min(
        (refit for refit in single_causes if refit.fits and refit.screening is not None), key=lambda refit: refit.score, default=None
    )
    failures = episodes(screening, screenings, cause)
    if not failures or (found is not None and found.score < failures[0].score + CLEAR):
        return found
    best, vehicle = failures[0], screening.case.vehicle
    if not (best.screening.chance and best.screening.constant) and undisturbed_segments() is not None:
        return found
    message = f"the log fits if {', or else '.join(one.words for one in failures)}; look at its valve and supply, and state thrust.failures"
    sigma_variant = (best.correction(vehicle, 1.0),) if best.sigma else ()
    rivals = tuple(one.correction(vehicle) for one in failures[1:])
    return Diagnosis((Fault(Notice(best.code, message), best.correction(vehicle), around=sigma_variant, rivals=rivals),), score=best.score)


def _alone(screening: Screening) -> list[Refit]:
    """Refits of the most likely single causes."""
    begun = tried_each(screening, screening.upright) if screening.upset else []
    most = SECOND if screening.upset else FINALISTS[screening.model.bearing is not None]
    refits = searched(screening, begun, (most, most), beyond(screening))
    refits += otherwise_filtered(screening)
    refits += _leaning(screening)
    refits += [] if any(map(_whole, refits)) else otherwise(screening, refits)
    best = min((refit for refit in refits if refit.fits), key=lambda refit: refit.score, default=None)
    if best is not None and best.fitted.hypothesis.turns:
        # exchanged actuators may look like a turn of the whole vehicle
        return [*refits, *wired(screening)]
    return refits if screening.upset or best is not None else [*refits, *tried_each(screening, screening.upright)]


def _leaning(screening: Screening) -> list[Refit]:
    """Refits of the axes of wheels and gyros. Screening prefers other scales of their momentum, which the axes explain in part."""
    fits = screening.fitted(hypotheses.device_axes(screening.model, screening.names), screening.stated.value("theta"))
    return tried_each(screening, (found for found in fits if not hopeless(screening, found, beyond(screening))))


def _different(each: Iterable[Fitted]) -> Iterator[Fitted]:
    """Fits without repeated causes."""
    distinct: list[Fitted] = []
    for fit in each:
        if not any(same(one, fit) for one in distinct):
            distinct.append(fit)
            yield fit


def _instead(screening: Screening, single_causes: Sequence[Refit], under_torque: Screening, undisturbed_segments: Rest) -> Diagnosis | None:
    """A distant cause that the most likely single cause may stand for.

    A turned gyro may stand for a delay of cycles, if a torque or more noise than stated remains; fuel use for a sudden change of the body.
    """
    best = next(iter(fitting_causes(screening, single_causes)), None)
    if best is None:
        return None
    if best.screening is not None and (best.screening.free.beside or best.screening.noisy):
        with_delay = _much_later(screening)
        return with_delay if with_delay is not None and with_delay.score < best.score else None
    if "fuel-use" in codes(best):
        return _changed(screening, under_torque, undisturbed_segments, max(float(best.fitted.chi_square.sum()) - screening.freedom, 0.0))
    return None


def _much_later(screening: Screening) -> Diagnosis | None:
    """A distant command delay, started at the delay of least free-response cost."""
    log, vehicle, timing, *_ = screening.case
    rated = delay.search(log, vehicle, [timing.lag], pieces=[screening.piece])
    if not rated:
        return None
    at = rated[0].at
    hypothesis = Hypothesis("delay-mismatch", (), hypotheses.along(screening.model, ("delay", np.ones(1))))
    start = screening.supposing(hypothesis, delay=at.delay - timing.delay)
    refit = refined(screening, start, screening.case._replace(timing=timing._replace(delay=at.delay)))
    return None if refit is None else chosen(screening, [refit])


def _lowpassed(screening: Screening) -> Diagnosis | None:
    """A distant low-pass of a sensor."""
    refits = []
    for sensor in ("gyro", "accel"):
        hypothesis = next(one for one in hypotheses.timing(screening.model) if one.code == f"{sensor}-filter")
        refit = helped(screening, screening.supposing(hypothesis, **{f"{sensor}_lag": PRIORS[f"{sensor}_lag"]}))
        refits += [] if refit is None else [refit]
    return chosen(screening, refits)


def _changed(screening: Screening, under_torque: Screening, undisturbed_segments: Rest, less_than: float = np.inf) -> Diagnosis | None:
    """Another body from some moment on; ``under_torque`` is the screening of one body under a torque.

    None if two bodies leave no less than ``less_than`` of excess chi-square.
    """
    log, piece = screening.case.whole or (screening.case.log, screening.piece)
    case, piece = busiest(screening.case._replace(log=log), piece, MOST)
    change_at = _likeliest_change(case, piece)
    if change_at is None:
        return None
    at, time = change_at
    each = (screened(*busiest(case, part), screening.free.beside) for part in (slice(piece.start, at), slice(at, piece.stop)))
    sides = [side and about_its_body(side) for side in each]
    if not all(side is not None and side.fits for side in sides):
        return None
    excess = sum(side.excess for side in sides if side is not None)
    if excess > LEFT * under_torque.excess or excess >= less_than:
        return None  # the sides fit only because they are shorter, or something else explains as much
    segments = undisturbed_segments()
    if segments is not None and (len(segments.kept_s) > 1 or segments.answered < ANSWERED):
        return None  # a temporary disturbance, or uncommanded motion, gives no evidence of another body
    thrust, imu = _or_thrust(screening, sides), _or_imu(screening, sides)
    message = (
        f"the log fits if the mass properties change at once at {time:.6g} s, as by docking or release{thrust}{imu}; "
        "give the vehicle file [[phases]] that end and begin there "
        "(estimator.split_on_change = true does it): what is estimated over the change is no body's"
    ) + ("; what [known] states is of neither part then: state it under [[phases]]" if case.vehicle.known else "")
    correction = None if imu else Correction(("estimator.split_on_change=true",))
    return Diagnosis((Fault(Notice("mass-change", message), correction, time),))


def _or_thrust(screening: Screening, sides: Sequence[Screening | None]) -> str:
    """Text that all thrust may change instead, if all that answers it changes in one proportion."""
    kind = screening.case.vehicle.environment.kind
    answers = [5, MU] if kind == "planar" else [0, 3, 5] + [MU] * (kind == "free")
    before, after = (side.stated.value("theta")[answers] for side in sides if side is not None)
    ratios = after / before
    ratio = float(ratios.mean())
    if not screening.model.thrusting or np.ptp(ratios) > PROPORTION * ratio or abs(ratio - 1) < PROPORTION:
        return ""
    return f", or if all thrust is {ratio:.3g} of what it was from then on, as by another supply pressure"


def _or_imu(screening: Screening, sides: Sequence[Screening | None]) -> str:
    """Text that another IMU may record instead, if only the CG changes and no thrust determines it."""
    before, after = (side.stated.value("theta") for side in sides if side is not None)
    turned = np.abs(tensor(after[:6]) @ np.linalg.inv(tensor(before[:6])) - np.eye(3)).max()
    if screening.model.thrusting or screening.model.bearing is not None or turned > PROPORTION:
        return ""
    where = "the CG alone changes, and no thrust tells where it is: then estimate each part with its own imu.position_m"
    return f", or if another IMU, some way off, records from then on ({where})"


def _pair(screening: Screening, single_causes: Sequence[Refit], worst: float) -> Diagnosis | None:
    """Two causes at once that score below ``worst``: two channels, or one of the most likely few and what explains its residual."""
    if (channels := two_channels(screening, any(refit.fits for refit in single_causes))) is not None:
        return channels
    upright = [found.hypothesis for found in screening.upright]
    likeliest = sorted(
        (refit for refit in single_causes if any(refit.fitted.hypothesis is one for one in upright)), key=lambda refit: refit.score
    )
    turned = (replace(screening.stated, hypothesis=one) for one in screening.turned_beside_a_channel)
    each = chain((refit.fitted for refit in likeliest), turned, (found for _, found in screening.ranked))
    pairs, firsts = list[Refit](), list[Refit]()
    beside = partial(_beside, screening, worst=worst)
    for found in islice(_different(each), FIRST[screening.model.bearing is not None]):
        known_refit = next((one for one in single_causes if one.fitted.hypothesis is found.hypothesis), None)
        refit = known_refit or tried(screening, found)
        firsts += [] if refit is None else [refit]
        # a refit that fits alone was beyond the screening's accuracy
        pairs += [refit] if known_refit is None and refit is not None and refit.fits else beside(refit, pairs)
        if any(refit.fits for refit in pairs):
            break  # its rivals share a part with it
    # the second cause may be an unstated torque
    pairs += [refit for first in firsts if (refit := _beside_a_torque(first)) is not None]
    # the second cause may have been found next to an inaccurate or wrong first one
    best = min(pairs, key=lambda refit: refit.score, default=None)
    parts = () if best is None else best.fitted.parts
    exact = best is not None and best.fits and best.screening is not None and best.screening.chance
    for i, part in enumerate(parts if len(parts) > 1 else ()):
        # if the pair is exact, a part about a channel has rivals about it or about others
        if (i > 0 or part.unknowns) and not (exact and screening.model.channel(part.hypothesis) is not None):
            pairs += beside(corrected_alone(screening, part), pairs)
    return chosen(screening, pairs)


def _beside(screening: Screening, first: Refit | None, others: Sequence[Refit], worst: float) -> list[Refit]:
    """Pairs with a corrected first cause and score below ``worst``; ``others`` are refits that compete.

    A first cause that leaves a channel without effect has none, since its screening lacks the channel.
    """
    if first is None or first.screening is None or len(first.screening.free.fired) != len(screening.free.fired):
        return []
    most = beyond(first.screening)
    if first.fitted.unknowns and np.isfinite(first.score):
        # the values of a first cause fitted alone move with a second
        most = max(most, WITH_IT * first.screening.misfit * first.screening.freedom)
    worst_excess = worst - first.screening.free_cost - first.units
    return searched(screening, [], (SECOND, FINALISTS[0]), most, first, others, worst_excess)


def _beside_a_torque(first: Refit) -> Refit | None:
    """A corrected cause under a disturbance torque; None if the log does not fit then, or fits without it."""
    corrected = first.screening
    if corrected is None or corrected.close or not corrected.constant or float(corrected.stated.chi_square.sum()) > beyond(corrected):
        return None
    with_torque = beside_a_torque(corrected)
    if not with_torque.close:
        return None
    excess = with_torque.score(with_torque.stated.chi_square, first.fitted)
    return replace(first, excess=excess, score=with_torque.free_cost + excess + first.units, fits=True, screening=with_torque)


def _in_vain(screening: Screening) -> str:
    """Text for an unknown cause: what was tried, and what came nearest."""
    nearest: dict[str, str] = {}
    for _, found in islice(screening.ranked, 4):
        code, _ = words_of(found, screening.names, screening.case, screening.case)
        about = f" of {', '.join(found.hypothesis.subject)}" if found.hypothesis.subject else ""
        nearest.setdefault(f"{code}{about}", f"{100 * found.chi_square.sum() / screening.stated.chi_square.sum():.2g} %")
    text = ", ".join(f"{what} leaves {left}" for what, left in islice(nearest.items(), 2))
    near = f"; nearest: {text} of the misfit" if text else ""
    scatter = jitter(screening.case.log.interval_s)
    if scatter > JITTER:
        near += f"; records' intervals scatter by {100 * scatter:.2g} %: times of arrival? State imu.clock_even = true"
    return f"log and vehicle file don't fit, cause unknown: what the model leaves is {screening.misfit:.3g} times pure error{near}"
