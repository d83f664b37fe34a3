"""What is wrong with the vehicle file or the log, where the two don't fit: the right cause, or none.

Every supposition of :mod:`massprop_cli.diagnosis.causes` is held against one reduction of the log (:mod:`massprop_cli.diagnosis.look`). The
best are applied to log and vehicle file and the log is reduced again, so that what counts in the end is exact. One is named only if the log
passes its test once it is mended; those that come near stand beside it. Two at once are tried where no single one suffices. Nothing is
acted on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, islice

import numpy as np

from massprop_cli.base.dataclass import dataclass
from massprop_cli.diagnosis import UNKNOWN, causes, change, delay
from massprop_cli.diagnosis.border import border
from massprop_cli.diagnosis.contest import ROUGHLY, Fitted, fitted
from massprop_cli.diagnosis.cures import Case, Cure, around, cure_of, skewed
from massprop_cli.diagnosis.delay import Found, near
from massprop_cli.diagnosis.design import Designs
from massprop_cli.diagnosis.episode import episodes
from massprop_cli.diagnosis.look import CLEAR, Look, about_its_body, beside_a_torque, busiest, looked
from massprop_cli.diagnosis.search import codes, same, searched
from massprop_cli.diagnosis.suppositions import Supposition
from massprop_cli.diagnosis.trial import Trial, beyond, helped, hopeless, mended_alone, refined, tried
from massprop_cli.diagnosis.wording import DEAD, TRIED, UNANSWERED, alone, words_of
from massprop_cli.estimate.initial import first_reference
from massprop_cli.inputs.telemetry import JITTER, Log, Notice, jitter
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.timing import Timing

FINALISTS = (6, 12)
"""How many are applied in turn until one fits: in free flight; and on a bearing, where a wrong gyro turns gravity too."""
FIRST, SECOND = (2, 3), 2
"""How many are tried with a second one, in free flight and on a bearing, where gravity tells several mountings apart from the stated but
not from one another; and how many of these each time if none makes the log fit. docs/faults.md moves, dead-turned."""
CHANNELS = 3
"""How many pairs of channels are tried."""
LEFT = 0.5
"""Part of what one body leaves beyond chance that two may leave in all: of a change that happened it is a tenth. docs/faults.md moves."""
WITH_IT = 0.5
"""Part of what a cause leaves that was fitted alone, more than which one that goes with it doesn't leave: beside a tilted IMU
a weak jet left up to 0.26 (docs/faults.md, weak-tilted)."""
NOTHING = 0.5
"""Sigmas of chance within which what is left is nothing more."""
ANSWERED = 30.0
"""Sigmas of chance by which a motion follows commands, at least: those that moved a vehicle, however wrongly stated, make hundreds, those
of another recording six, and shifted by some cycles 20."""
NEARLY = 4.6
"""−2 log of the odds (1 : 10) below which of two kinds neither is named."""
EVEN = 6.0
"""−2 log of the odds (1 : 20) below which two of a kind are named side by side."""


@dataclass(frozen=True)
class Explanation:
    """A cause that has a name."""

    code: str
    message: str
    cure: Cure | None
    """None where neither the vehicle file's keys nor factors on the log's columns mend it."""
    change_s: float | None = None
    """When the mass properties changed at once, if that is what is supposed."""
    around: tuple[Cure, ...] = ()
    """The cure with each of its unknowns one sigma further on, and with the gyro's axes out of square where they may be."""
    rivals: tuple[Cure, ...] = ()
    """Of causes that can't be ruled out."""

    @property
    def notice(self) -> Notice:
        """For the reader."""
        return Notice(self.code, self.message)


@dataclass(frozen=True)
class Diagnosis:
    """What was found: several causes are wrong together."""

    explanations: tuple[Explanation, ...] = ()
    detected: Found | None = None
    """What the log says of the command delay, if that is the cause."""
    unknown: str = ""
    """Where log and vehicle file don't fit and nothing explains it: what was tried."""
    score: float = -np.inf
    """Of what is named: −2 log likelihood, with its price."""


def diagnose(log: Log, vehicle: Resolved, timing: Timing, pieces: Sequence[slice]) -> Diagnosis:
    """Why the piece that fits worst doesn't fit, of a log of which a test has failed.

    Noise levels must be set in ``vehicle``, and no disturbance beyond what it states.
    """
    case = Case(log, vehicle, timing, Designs())
    looks = [look for piece in pieces if (look := looked(*busiest(case, piece))) is not None]
    if not looks:
        return Diagnosis()
    # where nothing fires the columns are the noise that they should explain; another piece says more
    driven = [look for look in looks if len(look.free.fired)]
    look = max(driven or looks, key=lambda one: one.misfit)
    if look.free.dead:
        return Diagnosis(unknown=DEAD)
    look = about_its_body(look)
    alone, wandering = _alone(look), beside_a_torque(look)
    found = _instead(look, alone, wandering) or _chosen(look, alone)
    found = found if any(map(_whole, alone)) else _for_a_time(look, looks, found)
    # a torque that wanders may explain it too, or with what goes with it
    with_it = [trial.score for trial in alone if trial.fits and _by_wander(trial, look)]
    least = min([wandering.cost, *with_it]) - CLEAR
    moved = wandering.free.answered > ANSWERED
    for search in () if wandering.close and moved else _further(look, alone, wandering, least):
        if found is not None and found.score < least:
            break
        found = search(look)
    if found is not None and found.score < least:
        return found
    at = next((placed for one in looks if (placed := border(one, float(log.time_s[-1]))) is not None), None)
    if at is not None:  # all the rest needs no torque that wanders
        return Diagnosis((Explanation("phase-border", at.words, at.cure),))
    if not moved and look.loud:
        return Diagnosis(unknown=UNANSWERED)
    return Diagnosis() if wandering.close or with_it else Diagnosis(unknown=_in_vain(look))


def _further(look: Look, alone: Sequence[Trial], whole: Look, least: float) -> list[Callable[[Look], Diagnosis | None]]:
    """What else to look for, the likeliest first, that explains more than the ``least`` score: all along in pairs, or in time."""
    pair = partial(_pair, alone=alone, worst=min([least, *(trial.score for trial in alone)]))
    changed = partial(_changed, whole=whole)
    two: list[Callable[[Look], Diagnosis | None]] = [_swapped, pair]
    best = min(alone, key=lambda trial: trial.score, default=None)
    if best is not None and "fuel-use" in codes(best):
        return [changed, _much_later, _lowpassed, *two]
    return [*two, _much_later, _lowpassed, changed] if look.constant or look.upset else [_much_later, _lowpassed, changed, *two]


def _whole(trial: Trial) -> bool:
    """Whether it leaves hardly more than the stated noise does in the mean: then nothing else explains more."""
    left = trial.look
    return trial.fits and left is not None and left.constant and left.misfit < 1 + NOTHING * np.sqrt(2 / left.freedom)


def _for_a_time(look: Look, looks: Sequence[Look], found: Diagnosis | None) -> Diagnosis | None:
    """A jet that fails for a time, where that explains more than what was ``found``."""
    each = episodes(look, looks)
    if not each or (found is not None and found.score < each[0].score + CLEAR):
        return found
    best, vehicle = each[0], look.case.vehicle
    message = f"the log fits if {', or else '.join(one.words for one in each)}; look at its valve and supply, and state thrust.failures"
    near = (best.cure(vehicle, 1.0),) if best.sigma else ()
    said = Explanation(best.code, message, best.cure(vehicle), around=near, rivals=tuple(one.cure(vehicle) for one in each[1:]))
    return Diagnosis((said,), score=best.score)


def _alone(look: Look) -> list[Trial]:
    """The likeliest causes, each put to the test."""
    begun = _turned(look) if look.upset else []
    most = SECOND if look.upset else FINALISTS[look.model.bearing is not None]
    best = searched(look, begun, (most, most), beyond(look))
    return best if look.upset or any(trial.fits for trial in best) else [*best, *_turned(look)]


def _different(each: Iterable[Fitted]) -> Iterator[Fitted]:
    """Without those that say what one before them says."""
    seen: list[Fitted] = []
    for found in each:
        if not any(same(one, found) for one in seen):
            seen.append(found)
            yield found


def _turned(look: Look) -> list[Trial]:
    return [trial for found in look.upright if (trial := tried(look, found)) is not None]


def _chosen(look: Look, trials: Sequence[Trial]) -> Diagnosis | None:
    """The likeliest of those with which the log fits."""
    fitting = _likeliest(look, trials)
    if not fitting:
        return None
    rivals = [trial for trial in fitting[1:] if trial.score < fitting[0].score + CLEAR]
    first = fitting[0]
    detected = None
    if first.fitted.supposed.code == "delay-mismatch":
        before, after = look.misfit, float(first.fitted.chi_square.sum() / look.freedom)
        by = first.case.timing.delay - look.case.timing.delay
        detected = near(look.case.timing, by, float(first.fitted.spread[0]), before, after)
    return Diagnosis(_explained(look, first, rivals), detected, score=first.score)


def _likeliest(look: Look, trials: Sequence[Trial]) -> list[Trial]:
    """Those with which the log fits, but for rivals of what doesn't; these come last where they are too faint to be named themselves."""
    fitting = [(look.ranked.faint(trial.fitted.supposed), trial) for trial in trials if trial.fits and not _by_wander(trial, look)]
    if all(faint for faint, _ in fitting):
        return []
    return [trial for _, trial in sorted(fitting, key=lambda one: (one[0], one[1].score))]


def _instead(look: Look, alone: Sequence[Trial], whole: Look) -> Diagnosis | None:
    """What the likeliest of single causes may stand for: it hides what is further off than a small step leads to.

    A turned gyro for a delay of cycles, where a torque or more noise is left than is stated; a slow change of the body for one at once.
    """
    best = next(iter(_likeliest(look, alone)), None)
    if best is None:
        return None
    if best.look is not None and (best.look.free.beside or best.look.noisy):
        later = _much_later(look)
        return later if later is not None and later.score < best.score else None
    if "fuel-use" in codes(best):
        return _changed(look, whole, max(float(best.fitted.chi_square.sum()) - look.freedom, 0.0))
    return None


def _by_wander(trial: Trial, look: Look) -> bool:
    """Whether it goes with a torque that wanders: its mean, its part along the rate, or what the accelerometer feels of it."""
    beside = (trial.look or look).free.beside
    return bool(codes(trial) & {"gyro-bias", "accel-bias", "steady-torque", "rate-torque"}) and any(one.walk > 0 for one in beside)


def _much_later(look: Look) -> Diagnosis | None:
    """Another command delay, further off than a small step leads to: where free coefficients leave least."""
    log, vehicle, timing, _ = look.case
    at = delay.search(log, vehicle, [timing.lag], pieces=[look.piece])
    if at is None:
        return None
    x = look.stated.x.copy()
    x[look.model.place("delay")] = at.delay - timing.delay
    supposed = Supposition("delay-mismatch", (), causes.along(look.model, ("delay", np.ones(1))))
    begun = Fitted(supposed, look.model, x, look.stated.chi_square, np.zeros(1))
    trial = refined(look, begun, look.case._replace(timing=timing._replace(delay=at.delay)))
    return None if trial is None else _chosen(look, [trial])


def _lowpassed(look: Look) -> Diagnosis | None:
    """A sensor's low-pass of cycles: further than a small step leads to."""
    trials = []
    for sensor in ("gyro", "accel"):
        supposed = next(one for one in causes.timing(look.model, False) if one.code == f"{sensor}-filter")
        x = look.stated.x.copy()
        x[look.model.place(f"{sensor}_lag")] = causes.EXPECTED[f"{sensor}_lag"]
        begun = Fitted(supposed, look.model, x, look.stated.chi_square, np.zeros(1))
        trial = helped(look, begun)
        trials += [] if trial is None else [trial]
    return _chosen(look, trials)


def _explained(look: Look, trial: Trial, rivals: Sequence[Trial] = ()) -> tuple[Explanation, ...]:
    """In words, with the settings that mend it: one for each of two causes at once.

    What a rival that is nearly as likely has not got is not named.
    """
    said = _said(look, trial)
    message, beside, sure = _joined(said), [], [code for code, _ in said]
    for rival in rivals:
        its = _said(look, rival)
        if _subjects(rival) == _subjects(trial) and sorted(code for code, _ in its) == sorted(code for code, _ in said):
            continue  # the same, found from elsewhere
        if [code for code, _ in its] == [code for code, _ in said] and rival.score < trial.score + EVEN:
            message += f", or else {_joined(its)}"
        else:
            beside.append(f"{_joined(its)} (odds {np.exp((trial.score - rival.score) / 2):.2g} to 1)")
            sure = [code for code in sure if code in dict(its) or rival.score > trial.score + NEARLY]
    message = f"the log fits if {message}"
    if beside:
        message += "; rivals that the log can't rule out: " + "; or ".join(beside[:2])
    if not sure:
        message = f"log and vehicle file don't fit, cause unknown: {message}"
    others = (cure_of(look.case, rival.case, rival.fitted) for rival in rivals)
    cure = cure_of(look.case, trial.case, trial.fitted)
    near = (*around(look.case, trial.fitted, look.free.fired), *skewed(cure, trial.fitted))
    instead = tuple(other for other in others if other is not None)
    return tuple(Explanation(code, message, cure, around=near, rivals=instead) for code in sure or [UNKNOWN])


def _said(look: Look, trial: Trial) -> list[tuple[str, str]]:
    """(code, words) of each cause."""
    return [words_of(part, look.names, look.case, trial.case) for part in trial.fitted.parts]


def _joined(said: Sequence[tuple[str, str]]) -> str:
    return ", and ".join(words for _, words in said) + " as well" * (len(said) > 1)


def _subjects(trial: Trial) -> list[tuple[str, ...]]:
    return sorted(part.supposed.subject for part in trial.fitted.parts)


def _changed(look: Look, whole: Look, less_than: float = np.inf) -> Diagnosis | None:
    """Another body from some moment on; ``whole`` is what one body leaves of the log beside a torque.

    None where two leave no ``less_than`` so much of chi-square beyond chance.
    """
    log, vehicle, timing, _ = look.case
    samples = timing.of(log, vehicle)
    reference = first_reference(samples, look.piece, vehicle)
    at = None if reference is None else change.likeliest(samples, look.piece, reference, vehicle)
    if at is None:
        return None
    sides = [looked(look.case, part, look.free.beside) for part in (slice(look.piece.start, at), slice(at, look.piece.stop))]
    if not all(side is not None and side.fits for side in sides):
        return None
    left = sum(side.excess for side in sides if side is not None)
    if left > LEFT * whole.excess or left >= less_than:
        return None  # each side fits for being shorter alone, or something else explains as much
    time = round(float(samples.executed.start_s[at]), 9)
    message = (
        f"the log fits if the mass properties change at once at {time:.6g} s, as by docking or release; give the vehicle file "
        "[[phases]] that end and begin there (estimator.split_on_change = true does it): what is estimated over the change is no body's"
    )
    return Diagnosis((Explanation("mass-change", message, Cure(("estimator.split_on_change=true",)), time),))


def _pair(look: Look, alone: Sequence[Trial], worst: float) -> Diagnosis | None:
    """Two causes at once that beat the ``worst`` score: two channels; or the likeliest few, each with what explains the rest."""
    if (channels := _two_channels(look)) is not None:
        return channels
    upright = [found.supposed for found in look.upright]
    likeliest = sorted((trial for trial in alone if any(trial.fitted.supposed is one for one in upright)), key=lambda trial: trial.score)
    turned = (replace(look.stated, supposed=one) for one in look.turned_beside_a_channel)
    each = chain((trial.fitted for trial in likeliest), turned, (found for _, found in look.ranked))
    together: list[Trial] = []
    beside = partial(_beside, look, worst=worst)
    for found in islice(_different(each), FIRST[look.model.bearing is not None]):
        known = next((one for one in alone if one.fitted.supposed is found.supposed), None)
        trial = known or tried(look, found)
        # one that fits alone was further off than the look tells
        together += [trial] if known is None and trial is not None and trial.fits else beside(trial, together)
        if any(trial.fits for trial in together):
            break  # what comes near it has a part in common with it
    # what explains most may have been found beside a first that was not yet as it is, or is but nearly the right one
    best = min(together, key=lambda trial: trial.score, default=None)
    parts = () if best is None else best.fitted.parts
    exact = best is not None and best.fits and best.look is not None and best.look.chance
    for i, part in enumerate(parts if len(parts) > 1 else ()):
        # where a pair leaves no more than chance, what is about a channel may still be about it otherwise, or about another
        if (i > 0 or part.unknowns) and not (exact and look.model.channel(part.supposed) is not None):
            together += beside(mended_alone(look, part), together)
    return _chosen(look, together)


def _beside(look: Look, first: Trial | None, others: Sequence[Trial], worst: float) -> list[Trial]:
    """Pairs with a first that is mended, where there are ``others``; what explains less than the ``worst`` score is none."""
    if first is None or first.look is None:
        return []
    most = beyond(first.look)
    if first.fitted.unknowns and np.isfinite(first.score):
        # what a first was fitted to alone moves with a second, and so does what is left
        most = max(most, WITH_IT * first.look.misfit * first.look.freedom)
    left = worst - first.look.free_cost - first.units
    return searched(look, [], (SECOND, FINALISTS[0]), most, first, others, left)


def _swapped(look: Look) -> Diagnosis | None:
    """Two jets, each of which does what is stated of the other."""
    supposed = causes.swapped(look.model, look.names) if look.case.log.command_kind == "jets" else []
    found = fitted(look.model, look.free, look.free.variance, supposed, still=ROUGHLY) if supposed else []
    likeliest = sorted(found, key=lambda one: (look.likelihood(one.chi_square), one.supposed.subject))[:CHANNELS]
    trials = (tried(look, one) for one in likeliest if not hopeless(look, one, beyond(look)))
    return _chosen(look, [trial for trial in trials if trial is not None])


def _two_channels(look: Look) -> Diagnosis | None:
    """The thrust of any two channels at once."""
    supposed = causes.two_channels(look.model, look.names)
    if not supposed:
        return None
    found = fitted(look.model, look.free, look.free.variance, supposed, still=ROUGHLY)
    likeliest = sorted(found, key=lambda one: (look.likelihood(one.chi_square), one.supposed.subject))[:CHANNELS]
    trials = [tried(look, one) for one in likeliest if not hopeless(look, one, beyond(look))]
    trial = min((one for one in trials if one is not None and one.fits), key=lambda one: one.score, default=None)
    if trial is None:
        return None
    both, near = cure_of(look.case, trial.case, trial.fitted), around(look.case, trial.fitted, look.free.fired)
    return Diagnosis(
        tuple(
            Explanation(code, f"the log fits if {words}", both, around=near)
            for name in trial.fitted.supposed.subject
            for code, words in [words_of(alone(trial.fitted, name), look.names, look.case, trial.case)]
        ),
        score=trial.score,
    )


def _in_vain(look: Look) -> str:
    """What was tried, and what came nearest."""
    nearest: dict[str, str] = {}
    for _, found in islice(look.ranked, 4):
        code, _ = words_of(found, look.names, look.case, look.case)
        about = f" of {', '.join(found.supposed.subject)}" if found.supposed.subject else ""
        nearest.setdefault(f"{code}{about}", f"{100 * found.chi_square.sum() / look.stated.chi_square.sum():.2g} %")
    said = ", ".join(f"{what} leaves {left}" for what, left in islice(nearest.items(), 2))
    near = f"; nearest: {said} of the misfit" if said else ""
    scatter = jitter(look.case.log.interval_s)
    if scatter > JITTER:
        near += f"; records' intervals scatter by {100 * scatter:.2g} %: times of arrival? State even = true under the clock in a map"
    return f"log and vehicle file don't fit, cause unknown: what the model leaves is {look.misfit:.3g} times pure error{near}; {TRIED}"
