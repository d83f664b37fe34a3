"""Diagnosis of a log that does not fit its vehicle file: the cause, its rivals, or none.

Every hypothesis of :mod:`massprop_cli.diagnosis.hypotheses` is tested against one reduction of the log
(:mod:`massprop_cli.diagnosis.screening`). The best are applied to log and vehicle file and the log is reduced again, so that what counts in
the end is exact. One is named only if the log passes its test once it is corrected; those that come near stand beside it. Two at once are
tried where no single one suffices. massprop never changes its inputs.
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
"""How many are applied in turn until one fits: in free flight; and on a bearing, where a wrong gyro turns gravity too."""
FIRST, SECOND = (2, 3), 2
"""How many are tried with a second one, in free flight and on a bearing, where gravity tells several mountings apart from the stated but
not from one another; and how many of these each time if none makes the log fit. docs/faults.md moves, dead-turned."""
LEFT = 0.5
"""Part of what one body leaves beyond chance that two may leave in all: of a change that happened it is a tenth. docs/faults.md moves."""
WITH_IT = 0.5
"""Part of what a cause leaves that was fitted alone, more than which one that goes with it doesn't leave: beside a tilted IMU
a weak jet left up to 0.26 (docs/faults.md, weak-tilted)."""
PROPORTION = 0.02
"""Part by which bodies differ at most that answer all thrust in one proportion, or differ in the CG alone."""
NOTHING = 0.5
"""Sigmas of chance within which what is left is nothing more."""
ANSWERED = 30.0
"""Sigmas of chance by which a motion follows commands, at least: those that moved a vehicle, however wrongly stated, make hundreds, those
of another recording six, and shifted by some cycles 20."""


Search = Callable[[Screening], Diagnosis | None]
Rest = Callable[[], Undisturbed | None]
"""What else to look for; and the stretches that fit, looked for once."""


def diagnose(log: Log, vehicle: Resolved, timing: Timing, pieces: Sequence[slice]) -> Diagnosis:
    """Why the piece that fits worst doesn't fit, of a log of which a test has failed.

    Noise levels must be set in ``vehicle``, and no disturbance beyond what it states.
    """
    if not all(log.axes):
        return Diagnosis(unknown=ABSENT)
    case = Case(log, vehicle, timing, Designs())
    screenings = [screening for piece in pieces if (screening := screened(*busiest(case, piece))) is not None]
    if not screenings:
        return Diagnosis()
    # where nothing fires the columns are the noise that they should explain; another piece says more
    driven = [screening for screening in screenings if len(screening.free.fired)]
    screening = max(driven or screenings, key=lambda one: one.misfit)
    if screening.chance and (elsewhere := _elsewhere(case, pieces)) is not None:
        screening, screenings = elsewhere, [elsewhere]
    if (at_sight := _at_sight(screening)) is not None:
        return at_sight
    screening = about_its_body(screening)
    alone, rarely = _alone(screening), sparse(screening.case) or lost(log)
    if rarely and not any(map(_whole, alone)):
        return Diagnosis(unknown=rarely)
    wandering = beside_a_torque(screening)
    rest = cache(partial(undisturbed, screening, float(log.time_s[-1])))
    found = _instead(screening, alone, wandering, rest) or chosen(screening, alone)
    found = found if any(map(_whole, alone)) else _for_a_time(screening, screenings, found, alone, rest)
    # a torque that wanders may explain it too, or with what goes with it
    with_it = [refit.score for refit in alone if refit.fits and by_wander(refit, screening)]
    least = min([wandering.cost, *with_it]) - CLEAR
    moved = wandering.free.answered > ANSWERED
    for search in () if wandering.close and moved else _further(screening, alone, wandering, least, rest):
        if found is not None and found.score < least:
            break
        found = search(screening)
    if found is not None and found.score < least:
        return found
    at = next((placed for one in screenings if (placed := border(one, float(log.time_s[-1]))) is not None), None)
    if at is not None:  # all the rest needs no torque that wanders
        return Diagnosis((Fault(Notice("phase-border", at.words), at.correction),))
    kept = rest()
    if kept is not None:
        return Diagnosis((Fault(Notice("phase-border", kept.words), kept.correction(vehicle)),))
    if screening.fits and (units := chosen(screening, by_noise(screening))) is not None:
        return units
    unanswered = not moved and screening.loud
    explained = not unanswered and (wandering.close or with_it)
    return Diagnosis() if explained else _unexplained(screening, UNANSWERED if unanswered else _in_vain(screening))


def _at_sight(screening: Screening) -> Diagnosis | None:
    """What is said before any hypothesis is fitted; None where hypotheses are to tell."""
    if screening.free.dead:
        return Diagnosis(unknown=DEAD)
    shown = seen(screening.case)
    if shown is not None:
        return Diagnosis((Fault(shown, None),))
    vehicle = screening.case.vehicle
    # a swing tells ratios, so that there is no body of which anything could be left
    return Diagnosis() if vehicle.on_pedestal and not len(screening.free.fired) and not vehicle.swings else None


def _elsewhere(case: Case, pieces: Sequence[slice]) -> Screening | None:
    """The cycles about the moment from which on another body explains most, where the busiest ones fit and these don't."""
    longest = max(pieces, key=lambda piece: piece.stop - piece.start)
    if longest.stop - longest.start <= LONGEST or (case.vehicle.pivoted and case.log.attitude_wxyz is None):
        return None
    part, piece = busiest(case, longest, MOST)
    found = _likeliest_change(part, piece)
    if found is None:
        return None
    first = min(max(found[0] - LONGEST // 2, piece.start), piece.stop - LONGEST)
    about, own = busiest(part, slice(first, first + LONGEST))
    there = screened(about._replace(whole=(case.log, longest)), own)
    return None if there is None or there.chance else there


def _likeliest_change(case: Case, piece: slice) -> tuple[int, float] | None:
    """The cycle, and the time, from which on another body explains most."""
    samples = case.timing.of(case.log, case.vehicle)
    reference = first_reference(samples, piece, case.vehicle)
    at = None if reference is None else change.likeliest(samples, piece, reference, case.vehicle)
    return None if at is None else (at, round(float(samples.executed.start_s[at]), 9))


def _unexplained(screening: Screening, unknown: str) -> Diagnosis:
    """Where no cause was found: that commands are logged after they act, which no log corrected by its vehicle file shows; else none."""
    up = logged_after(screening.case)
    said = LOGGED_AFTER.format(up - screening.case.timing.delay, up)
    return Diagnosis((Fault(Notice("delay-mismatch", said), None),)) if up else Diagnosis(unknown=unknown)


def _further(screening: Screening, alone: Sequence[Refit], whole: Screening, least: float, rest: Rest) -> list[Search]:
    """What else to look for, the most likely first, that explains more than the ``least`` score: all along in pairs, or in time."""
    pair = partial(_pair, alone=alone, worst=min([least, *(refit.score for refit in alone)]))
    changed = partial(_changed, whole=whole, rest=rest)
    two: list[Search] = [swapped, pair]
    best = min(alone, key=lambda refit: refit.score, default=None)
    if best is not None and "fuel-use" in codes(best):
        return [changed, _much_later, _lowpassed, *two]
    return [*two, _much_later, _lowpassed, changed] if screening.constant or screening.upset else [_much_later, _lowpassed, changed, *two]


def _whole(refit: Refit) -> bool:
    """Whether it leaves hardly more than the stated noise does in the mean: then nothing else explains more."""
    left = refit.screening
    return refit.fits and left is not None and left.constant and left.misfit < 1 + NOTHING * np.sqrt(2 / left.freedom)


def _for_a_time(
    screening: Screening, screenings: Sequence[Screening], found: Diagnosis | None, alone: Sequence[Refit], rest: Rest
) -> Diagnosis | None:
    """A jet that fails for a time, where that explains more than what was ``found``, of causes ``alone``.

    One that leaves more than chance is none where all but the ``rest`` of the log leaves no more.
    """
    cause = min((refit for refit in alone if refit.fits and refit.screening is not None), key=lambda refit: refit.score, default=None)
    each = episodes(screening, screenings, cause)
    if not each or (found is not None and found.score < each[0].score + CLEAR):
        return found
    best, vehicle = each[0], screening.case.vehicle
    if not (best.screening.chance and best.screening.constant) and rest() is not None:
        return found
    message = f"the log fits if {', or else '.join(one.words for one in each)}; look at its valve and supply, and state thrust.failures"
    near = (best.correction(vehicle, 1.0),) if best.sigma else ()
    rivals = tuple(one.correction(vehicle) for one in each[1:])
    return Diagnosis((Fault(Notice(best.code, message), best.correction(vehicle), around=near, rivals=rivals),), score=best.score)


def _alone(screening: Screening) -> list[Refit]:
    """The most likely causes, each put to the test."""
    begun = tried_each(screening, screening.upright) if screening.upset else []
    most = SECOND if screening.upset else FINALISTS[screening.model.bearing is not None]
    best = searched(screening, begun, (most, most), beyond(screening))
    best += otherwise_filtered(screening)
    best += _leaning(screening)
    best += [] if any(map(_whole, best)) else otherwise(screening, best)
    likeliest = min((refit for refit in best if refit.fits), key=lambda refit: refit.score, default=None)
    if likeliest is not None and likeliest.fitted.hypothesis.turns:
        # actuators that are wired round may be a turn of the whole vehicle
        return [*best, *wired(screening)]
    return best if screening.upset or likeliest is not None else [*best, *tried_each(screening, screening.upright)]


def _leaning(screening: Screening) -> list[Refit]:
    """Axes of wheels and gyros: they explain much of what other parts of their momentum make, which a look takes for more."""
    each = screening.fitted(hypotheses.device_axes(screening.model, screening.names), screening.stated.value("theta"))
    return tried_each(screening, (found for found in each if not hopeless(screening, found, beyond(screening))))


def _different(each: Iterable[Fitted]) -> Iterator[Fitted]:
    """Without those that say what one before them says."""
    seen: list[Fitted] = []
    for found in each:
        if not any(same(one, found) for one in seen):
            seen.append(found)
            yield found


def _instead(screening: Screening, alone: Sequence[Refit], whole: Screening, rest: Rest) -> Diagnosis | None:
    """What the most likely of single causes may stand for: it hides what is further off than a small step leads to.

    A turned gyro for a delay of cycles, where a torque or more noise is left than is stated; a slow change of the body for one at once.
    """
    best = next(iter(fitting_causes(screening, alone)), None)
    if best is None:
        return None
    if best.screening is not None and (best.screening.free.beside or best.screening.noisy):
        later = _much_later(screening)
        return later if later is not None and later.score < best.score else None
    if "fuel-use" in codes(best):
        return _changed(screening, whole, rest, max(float(best.fitted.chi_square.sum()) - screening.freedom, 0.0))
    return None


def _much_later(screening: Screening) -> Diagnosis | None:
    """Another command delay, further off than a small step leads to: where free coefficients leave least."""
    log, vehicle, timing, *_ = screening.case
    rated = delay.search(log, vehicle, [timing.lag], pieces=[screening.piece])
    if not rated:
        return None
    at = rated[0].at
    supposed = Hypothesis("delay-mismatch", (), hypotheses.along(screening.model, ("delay", np.ones(1))))
    begun = screening.supposing(supposed, delay=at.delay - timing.delay)
    refit = refined(screening, begun, screening.case._replace(timing=timing._replace(delay=at.delay)))
    return None if refit is None else chosen(screening, [refit])


def _lowpassed(screening: Screening) -> Diagnosis | None:
    """A sensor's low-pass of cycles: further than a small step leads to."""
    refits = []
    for sensor in ("gyro", "accel"):
        supposed = next(one for one in hypotheses.timing(screening.model) if one.code == f"{sensor}-filter")
        refit = helped(screening, screening.supposing(supposed, **{f"{sensor}_lag": PRIORS[f"{sensor}_lag"]}))
        refits += [] if refit is None else [refit]
    return chosen(screening, refits)


def _changed(screening: Screening, whole: Screening, rest: Rest, less_than: float = np.inf) -> Diagnosis | None:
    """Another body from some moment on; ``whole`` is what one body leaves of the log beside a torque.

    None where two leave no ``less_than`` so much of chi-square beyond chance.
    """
    log, piece = screening.case.whole or (screening.case.log, screening.piece)
    case, piece = busiest(screening.case._replace(log=log), piece, MOST)
    found = _likeliest_change(case, piece)
    if found is None:
        return None
    at, time = found
    each = (screened(*busiest(case, part), screening.free.beside) for part in (slice(piece.start, at), slice(at, piece.stop)))
    sides = [side and about_its_body(side) for side in each]
    if not all(side is not None and side.fits for side in sides):
        return None
    left = sum(side.excess for side in sides if side is not None)
    if left > LEFT * whole.excess or left >= less_than:
        return None  # each side fits for being shorter alone, or something else explains as much
    kept = rest()
    if kept is not None and (len(kept.kept_s) > 1 or kept.answered < ANSWERED):
        return None  # what acts for a time, or nothing that is commanded, tells of no other body
    thrust, imu = _or_thrust(screening, sides), _or_imu(screening, sides)
    message = (
        f"the log fits if the mass properties change at once at {time:.6g} s, as by docking or release{thrust}{imu}; "
        "give the vehicle file [[phases]] that end and begin there "
        "(estimator.split_on_change = true does it): what is estimated over the change is no body's"
    ) + ("; what [known] states is of neither part then: state it under [[phases]]" if case.vehicle.known else "")
    cure = None if imu else Correction(("estimator.split_on_change=true",))
    return Diagnosis((Fault(Notice("mass-change", message), cure, time),))


def _or_thrust(screening: Screening, sides: Sequence[Screening | None]) -> str:
    """That all thrust may change instead, where all that answers it does so in one proportion."""
    kind = screening.case.vehicle.environment.kind
    answers = [5, MU] if kind == "planar" else [0, 3, 5] + [MU] * (kind == "free")
    before, after = (side.stated.value("theta")[answers] for side in sides if side is not None)
    by = after / before
    part = float(by.mean())
    if not screening.model.thrusting or np.ptp(by) > PROPORTION * part or abs(part - 1) < PROPORTION:
        return ""
    return f", or if all thrust is {part:.3g} of what it was from then on, as by another supply pressure"


def _or_imu(screening: Screening, sides: Sequence[Screening | None]) -> str:
    """That another IMU may record from then on, where the CG alone changes and no thrust tells where it is."""
    before, after = (side.stated.value("theta") for side in sides if side is not None)
    turned = np.abs(tensor(after[:6]) @ np.linalg.inv(tensor(before[:6])) - np.eye(3)).max()
    if screening.model.thrusting or screening.model.bearing is not None or turned > PROPORTION:
        return ""
    where = "the CG alone changes, and no thrust tells where it is: then estimate each part with its own imu.position_m"
    return f", or if another IMU, some way off, records from then on ({where})"


def _pair(screening: Screening, alone: Sequence[Refit], worst: float) -> Diagnosis | None:
    """Two causes at once that beat the ``worst`` score: two channels; or the most likely few, each with what explains the rest."""
    if (channels := two_channels(screening, any(refit.fits for refit in alone))) is not None:
        return channels
    upright = [found.hypothesis for found in screening.upright]
    likeliest = sorted((refit for refit in alone if any(refit.fitted.hypothesis is one for one in upright)), key=lambda refit: refit.score)
    turned = (replace(screening.stated, hypothesis=one) for one in screening.turned_beside_a_channel)
    each = chain((refit.fitted for refit in likeliest), turned, (found for _, found in screening.ranked))
    together, firsts = list[Refit](), list[Refit]()
    beside = partial(_beside, screening, worst=worst)
    for found in islice(_different(each), FIRST[screening.model.bearing is not None]):
        known = next((one for one in alone if one.fitted.hypothesis is found.hypothesis), None)
        refit = known or tried(screening, found)
        firsts += [] if refit is None else [refit]
        # one that fits alone was further off than the look tells
        together += [refit] if known is None and refit is not None and refit.fits else beside(refit, together)
        if any(refit.fits for refit in together):
            break  # what comes near it has a part in common with it
    # a torque that nobody stated may be what is beside a first
    together += [refit for first in firsts if (refit := _beside_a_torque(first)) is not None]
    # what explains most may have been found beside a first that was not yet as it is, or is but nearly the right one
    best = min(together, key=lambda refit: refit.score, default=None)
    parts = () if best is None else best.fitted.parts
    exact = best is not None and best.fits and best.screening is not None and best.screening.chance
    for i, part in enumerate(parts if len(parts) > 1 else ()):
        # where a pair leaves no more than chance, what is about a channel may still be about it otherwise, or about another
        if (i > 0 or part.unknowns) and not (exact and screening.model.channel(part.hypothesis) is not None):
            together += beside(corrected_alone(screening, part), together)
    return chosen(screening, together)


def _beside(screening: Screening, first: Refit | None, others: Sequence[Refit], worst: float) -> list[Refit]:
    """Pairs with a first that is corrected, where there are ``others``; what explains less than the ``worst`` score is none.

    Nor is there any with a first by which a channel does nothing, and which is looked at without that.
    """
    if first is None or first.screening is None or len(first.screening.free.fired) != len(screening.free.fired):
        return []
    most = beyond(first.screening)
    if first.fitted.unknowns and np.isfinite(first.score):
        # what a first was fitted to alone moves with a second, and so does what is left
        most = max(most, WITH_IT * first.screening.misfit * first.screening.freedom)
    left = worst - first.screening.free_cost - first.units
    return searched(screening, [], (SECOND, FINALISTS[0]), most, first, others, left)


def _beside_a_torque(first: Refit) -> Refit | None:
    """A cause that is corrected, beside a torque with which the log fits then; None where it doesn't, or without it does."""
    left = first.screening
    if left is None or left.close or not left.constant or float(left.stated.chi_square.sum()) > beyond(left):
        return None
    found = beside_a_torque(left)
    if not found.close:
        return None
    excess = found.score(found.stated.chi_square, first.fitted)
    return replace(first, excess=excess, score=found.free_cost + excess + first.units, fits=True, screening=found)


def _in_vain(screening: Screening) -> str:
    """What was tried, and what came nearest."""
    nearest: dict[str, str] = {}
    for _, found in islice(screening.ranked, 4):
        code, _ = words_of(found, screening.names, screening.case, screening.case)
        about = f" of {', '.join(found.hypothesis.subject)}" if found.hypothesis.subject else ""
        nearest.setdefault(f"{code}{about}", f"{100 * found.chi_square.sum() / screening.stated.chi_square.sum():.2g} %")
    said = ", ".join(f"{what} leaves {left}" for what, left in islice(nearest.items(), 2))
    near = f"; nearest: {said} of the misfit" if said else ""
    scatter = jitter(screening.case.log.interval_s)
    if scatter > JITTER:
        near += f"; records' intervals scatter by {100 * scatter:.2g} %: times of arrival? State imu.clock_even = true"
    return f"log and vehicle file don't fit, cause unknown: what the model leaves is {screening.misfit:.3g} times pure error{near}"
