"""What is wrong with the vehicle file or the log, where the two don't fit: the right cause, or none.

Every supposition of :mod:`massprop_cli.causes` is held against one reduction of the log (:mod:`massprop_cli.look`). The best are applied to
log and vehicle file and the log is reduced again, so that what counts in the end is exact. One is named only if the log passes its test
once it is mended; those that come near stand beside it. Two at once are tried where no single one suffices. Nothing is acted on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from massprop_cli import causes, change
from massprop_cli.arrays import Array
from massprop_cli.contest import Fitted, fitted
from massprop_cli.cures import Case, Cure, applied, cure_of
from massprop_cli.look import CLEAR, FITS, Look, at_once, busiest, looked
from massprop_cli.start import first_reference
from massprop_cli.suppositions import Model, Supposition
from massprop_cli.telemetry import Log, Notice
from massprop_cli.timing import Found, Timing, near, search
from massprop_cli.vehicle import Vehicle
from massprop_cli.wording import alone, words_of

NEARLY, PART = 6.0, 1e-3
"""Mended, it fits as well with up to so many times pure error, if that is so small a part of what was left before."""
FINALISTS = (5, 12)
"""How many are applied in turn until one fits: in free flight; and on a bearing, where a wrong gyro turns gravity too."""
FIRST, SECOND = 3, 2
"""How many are tried with a second one, and how many of these each time."""
AGAIN = 8
"""How often one is applied anew from where it led."""
STILL = 0.01
"""A change of −2 log likelihood that ends that."""
FURTHER = 1.5
"""Before it is applied a large change looks worse than it is, by up to so much."""
TRIED = (
    "tried: sign, thrust, place and direction of each channel, groups of channels, delay, rise, lag, clock drift, units, scales, biases, "
    "low-pass and mounting of gyro and accelerometer, IMU position, attitude at the start, steady and rate-proportional torque, fuel use, "
    "a change of the mass properties, and pairs of these"
)
EVEN = 6.0
"""−2 log of the odds (1 : 20) below which two of a kind are named side by side."""


class Trial(NamedTuple):
    """A supposition, how it is mended, and what it leaves."""

    fitted: Fitted
    case: Case
    score: float
    """−2 log likelihood, with the price of its freedom."""
    fits: bool


@dataclass(frozen=True)
class Explanation:
    """A cause that has a name."""

    code: str
    message: str
    cure: Cure | None
    """None where neither the vehicle file's keys nor factors on the log's columns mend it."""
    change_s: float | None = None
    """When the mass properties changed at once, if that is what is supposed."""

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


def diagnose(log: Log, vehicle: Vehicle, timing: Timing, pieces: Sequence[slice]) -> Diagnosis:
    """Why the piece that fits worst doesn't fit. Noise levels must be set in ``vehicle``, and no disturbance beyond what it states."""
    case = Case(log, vehicle, timing)
    looks = [look for piece in pieces if (look := looked(*busiest(case, piece))) is not None]
    if not looks:
        return Diagnosis()
    look = max(looks, key=lambda one: one.misfit)
    if look.fits:
        return Diagnosis()
    return _single(look) or _much_later(look) or _changed(look) or _pair(look) or Diagnosis(unknown=_in_vain(look))


def _single(look: Look) -> Diagnosis | None:
    """One cause that makes the log fit, with what comes near it."""
    best: list[Trial] = []
    most = FINALISTS[look.model.bearing is not None]
    for rough, found in look.ranked:
        if len(best) >= most or (any(t.fits for t in best) and rough > FURTHER * min(t.score for t in best if t.fits) + CLEAR):
            break
        trial = _tried(look, found)
        if trial is not None:
            best.append(trial)
    return _chosen(look, best)


def _chosen(look: Look, trials: Sequence[Trial]) -> Diagnosis | None:
    """The likeliest of those with which the log fits."""
    fitting = sorted((trial for trial in trials if trial.fits), key=lambda trial: trial.score)
    if not fitting:
        return None
    rivals = [trial for trial in fitting[1:] if trial.score < fitting[0].score + CLEAR]
    first = fitting[0]
    detected = None
    if first.fitted.supposed.code == "delay-mismatch":
        before, after = look.misfit, float(first.fitted.chi_square.sum() / look.freedom)
        by = first.case.timing.delay - look.case.timing.delay
        detected = near(look.case.timing, by, float(first.fitted.spread[0]), before, after)
    return Diagnosis((_explained(look, first, rivals),), detected)


def _much_later(look: Look) -> Diagnosis | None:
    """Another command delay, further off than a small step leads to: where free coefficients leave least."""
    log, vehicle, timing = look.case
    at = search(log, vehicle, [timing.lag], pieces=[look.piece])
    if at is None:
        return None
    x = look.stated.x.copy()
    x[look.model.place("delay")] = at.delay - timing.delay
    supposed = Supposition("delay-mismatch", (), causes.along(look.model, ("delay", np.ones(1))))
    begun = Fitted(supposed, look.model, x, look.stated.chi_square, np.zeros(1))
    trial = _refined(look, begun, look.case._replace(timing=timing._replace(delay=at.delay)))
    return None if trial is None else _chosen(look, [trial])


def _tried(look: Look, found: Fitted) -> Trial | None:
    """A supposition with its best values in log and vehicle file; None where that can't be written down."""
    case = applied(look.case, found, look.free.fired)
    if case is None:
        return Trial(found, look.case, look.score(found.chi_square, found), _passes(look, found))
    return _refined(look, found, case)


def _passes(look: Look, found: Fitted) -> bool:
    """Whether the log fits so far as the small step to it tells: of what can't be put into log or vehicle file."""
    freedom = look.freedom - found.unknowns
    left = float(found.chi_square.sum() / freedom)
    return left < FITS[0] + FITS[1] * np.sqrt(2 / freedom) and (left < PART * look.misfit or not look.loud)


def _refined(look: Look, found: Fitted, case: Case) -> Trial | None:
    """What is left once the case is reduced anew, its unknowns moved on from there until they stand."""
    mended = looked(case, look.piece)
    if mended is None or mended.model.places != look.model.places:
        return None
    spread = found.spread
    for _ in range(AGAIN if found.unknowns else 0):
        (more,) = fitted(mended.model, mended.free, mended.free.variance, [found.supposed])
        spread = more.spread
        further = replace(found, x=_together(found.x, more.x, look.model))
        then = applied(look.case, further, look.free.fired)
        there = None if then is None else looked(then, look.piece)
        if then is None or there is None or there.cost > mended.cost - STILL:
            break
        found, case, mended = further, then, there
    found = replace(found, chi_square=mended.stated.chi_square, spread=spread * np.sqrt(max(mended.misfit, 1.0)))
    if at_once(found):
        x = found.x.copy()
        thrust = look.model.place("thrust")
        x[thrust] = np.where(x[thrust] == 1.0, 1.0, x[thrust].round())
        found = replace(found, x=x)
        case = applied(look.case, found, look.free.fired) or case
    much = mended.misfit < PART * look.misfit
    fits = (mended.fits and not mended.loud) or (much and (mended.fits or mended.misfit < NEARLY))
    return Trial(found, case, mended.score(mended.stated.chi_square, found), fits)


def _explained(look: Look, trial: Trial, rivals: Sequence[Trial] = ()) -> Explanation:
    """In words, with the settings that mend it."""
    code, message = words_of(trial.fitted, look.names, look.case, trial.case)
    beside = []
    for rival in rivals:
        its_code, other = words_of(rival.fitted, look.names, look.case, rival.case)
        if rival.fitted.supposed.subject == trial.fitted.supposed.subject and its_code == code:
            continue  # the same, found from elsewhere
        if its_code == code and rival.score < trial.score + EVEN:
            message += f", or else {other}"
        else:
            beside.append(f"{other} (odds {np.exp((trial.score - rival.score) / 2):.2g} to 1)")
    message = f"the log fits if {message}"
    if beside:
        message += "; rivals that the log can't rule out: " + "; or ".join(beside[:2])
    return Explanation(code, message, cure_of(look.case, trial.case, trial.fitted))


def _changed(look: Look) -> Diagnosis | None:
    """Another body from some moment on."""
    log, vehicle, timing = look.case
    samples = timing.of(log, vehicle)
    reference = first_reference(samples, look.piece, vehicle)
    at = None if reference is None else change.likeliest(samples, look.piece, reference, vehicle)
    if at is None:
        return None
    sides = [looked(look.case, part) for part in (slice(look.piece.start, at), slice(at, look.piece.stop))]
    if not all(side is not None and side.fits for side in sides):
        return None
    time = round(float(samples.executed.start_s[at]), 9)
    message = (
        f"the log fits if the mass properties change at once at {time:.6g} s, as by docking or release; give the vehicle file "
        "[[phases]] that end and begin there (estimator.split_on_change = true does it): what is estimated over the change is no body's"
    )
    return Diagnosis((Explanation("mass-change", message, Cure(("estimator.split_on_change=true",)), time),))


def _pair(look: Look) -> Diagnosis | None:
    """Two causes at once: the likeliest few, each with what explains the rest; or any two channels."""
    found: list[tuple[float, Trial, Look, Trial]] = []
    for _, first in look.ranked[:FIRST]:
        trial = _tried(look, first)
        mended = None if trial is None or trial.case is look.case else looked(trial.case, look.piece)
        if trial is None or mended is None:
            continue
        for _, second in mended.ranked[:SECOND]:
            other = _tried(mended, second)
            if other is not None and other.fits:
                found.append((other.score + first.unknowns * np.log(look.free.gyro.spare), trial, mended, other))
                break
    if not found:
        return _two_channels(look)
    _, trial, mended, other = min(found, key=lambda one: one[0])
    one, two = _explained(look, trial), _explained(mended, other)
    both = one.cure.followed_by(two.cure) if one.cure is not None and two.cure is not None else None
    message = f"{one.message}, and {two.message.removeprefix('the log fits if ')} as well"
    return Diagnosis((Explanation(one.code, message, both), Explanation(two.code, message, both)))


def _two_channels(look: Look) -> Diagnosis | None:
    """The thrust of any two channels at once."""
    supposed = causes.two_channels(look.model, look.names)
    if not supposed:
        return None
    found = fitted(look.model, look.free, look.free.variance, supposed)
    best = min(found, key=lambda one: (look.likelihood(one.chi_square), one.supposed.subject))
    trial = _tried(look, best)
    if trial is None or not trial.fits:
        return None
    both = cure_of(look.case, trial.case, trial.fitted)
    return Diagnosis(
        tuple(
            Explanation(code, f"the log fits if {words}", both)
            for name in best.supposed.subject
            for code, words in [words_of(alone(trial.fitted, name), look.names, look.case, trial.case)]
        )
    )


def _in_vain(look: Look) -> str:
    """What was tried, and what came nearest."""
    nearest = []
    for _, found in look.ranked[:2]:
        code, _ = words_of(found, look.names, look.case, look.case)
        nearest.append(f"{code} leaves {100 * found.chi_square.sum() / look.stated.chi_square.sum():.2g} %")
    near = f"; nearest: {', '.join(nearest)} of the misfit" if nearest else ""
    return f"log and vehicle file don't fit, cause unknown: what the model leaves is {look.misfit:.3g} times pure error{near}; {TRIED}"


def _together(x: Array, more: Array, model: Model) -> Array:
    """Both changes of x one after the other; the second was found with the first in place."""
    found = more.copy()
    own = slice(10, None)
    found[own] = x[own] + more[own] - model.stated[own]
    thrust = model.place("thrust")
    found[thrust] = x[thrust] * more[thrust]
    return found
