"""Refit of a hypothesis: applied to log and vehicle file, reduced again, until its values converge."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import applied, at_once, exact_of
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.screening import FITS, Screening, about_its_body, busiest, screened
from massprop_cli.errorparameters.actuatornames import NEAR
from massprop_cli.errorparameters.table import BY_NAME, ENTRIES, PRIORS
from massprop_cli.estimate.whitening import Disturbance
from massprop_cli.prepare.recorded import narrowed

PROMISED = 0.5
"""Part of what a look promises of a cause that an exact fit must gain by it: a look's own misfit, by the motion within the cycles, is none
of the log's."""
PART = 1e-3
"""Of what was left before; what leaves less explains a log though its pure error is far above the stated noise."""
HOPELESS, SMALL = 8.0, 0.01
"""Times pure error, and part of what was left before, above which a hypothesis about anything else won't make the log fit. docs/faults.md
moves."""
NO_DRIFT = (0.01, 5.0)
"""Cycles over the stretch, and sigmas, below which clocks don't drift apart."""
ASTRAY = 1e5
"""Times pure error that is more than the motion within the cycles may leave."""
NO_WAY, STRAIGHT = 100.0, 2
"""Times pure error that the next step promises to leave, from which on none leads anywhere, and how often one is applied anew all the same.
docs/faults.md moves."""
AGAIN, ROUGH = 16, 6
"""How often one is applied anew from where it led; where it goes on beside another disturbance anyhow."""
ROUNDS = 3
"""How often beside another disturbance."""
STILL, ROUGHLY = 0.01, 1.0
"""A change of −2 log likelihood that ends that; where it goes on beside another disturbance anyhow."""
BOLD = 3.0
"""Times what a step promises, that following it on may bring."""
SLOWLY, FARTHER = 0.3, 0.97
"""Parts of the last step above which the next one goes further, and that it is taken for at most."""
MOST = 24_000
"""Cycles that a cause is fitted to in the end, twenty times those of a look: of an hour at 20 Hz all would tell it less than twice as
well."""


@dataclass(frozen=True)
class Refit:
    """A hypothesis, how it is corrected, and what it leaves."""

    fitted: Fitted
    case: Case
    excess: float
    """−2 log likelihood beyond that of free coefficients, with the price of its freedom."""
    score: float
    """−2 log likelihood of what was measured, with that price."""
    fits: bool
    screening: Screening | None = None
    """What is left of the log as corrected; None where that can't be written down."""
    units: float = 0.0
    """−2 log of how densely the corrected measurements lie where they were measured."""


def hopeless(screening: Screening, found: Fitted, most: float) -> bool:
    """Whether it leaves more than so much of chi-square in the first reduction, where that is as good as exact for what it is about."""
    if _before_its_cause(screening, found):
        return True
    if float(found.chi_square.sum()) <= most:
        return False
    turns = [turn for turn in (found.hypothesis.gyro, found.hypothesis.accelerometer) if (turn != np.eye(3)).any()]
    on_bearing = screening.model.bearing is not None
    # other units make of the motion within the cycles another motion
    curved = bool(turns) if on_bearing else any(not np.isclose(abs(np.linalg.det(turn)), 1.0) for turn in turns)
    free = found.hypothesis.free
    moved = {BY_NAME[name].bends for name in ENTRIES if free[found.model.place(name)].any()}
    return not curved and not moved & ({"always", "with gravity"} if on_bearing else {"always"})


def beyond(screening: Screening) -> float:
    """Chi-square that is far too much."""
    return max(HOPELESS, SMALL * screening.misfit) * screening.freedom


def _before_its_cause(screening: Screening, found: Fitted) -> bool:
    """Whether it takes a delay, a lag, a rise or a droop below zero, by more than chance."""
    errors = ((BY_NAME[name], float(found.error(name)[0])) for name in ENTRIES if np.isfinite(BY_NAME[name].slack))
    return any(error < one.least(screening.case.setup) - one.slack for one, error in errors if error < -one.slack)


@dataclass(frozen=True)
class AppliedHypothesis:
    """A hypothesis applied once."""

    screening: Screening
    promised: float
    """Score that its next step promises."""
    least: float
    """Cost that following it on may bring."""


def begin(screening: Screening, found: Fitted, first: Refit | None) -> AppliedHypothesis | None:
    """A hypothesis with its values applied, perhaps beside a ``first`` one; None where that makes another testbed."""
    found = found if first is None else _beside(screening, first, found)
    case = applied(screening.case, found)
    mended = None if case is None else _anew(screening, case, screening.free.beside, _own_theta(found))
    if mended is None:
        return None
    more, promised = mended.next_step(found)
    units = _by_units(mended, found, screening.case)
    return AppliedHypothesis(mended, mended.free_cost + units + mended.score(more.chi_square, found), mended.cost + units - BOLD * promised)


def tried(
    screening: Screening, found: Fitted, best: float = np.inf, first: Refit | None = None, begun: AppliedHypothesis | None = None
) -> Refit | None:
    """A hypothesis with its best values in log and vehicle file, perhaps beside a ``first`` one, both fitted together.

    None where they make it another testbed's. It is followed no further than it may come near the ``best`` score so far.
    """
    found = found if first is None else _beside(screening, first, found)
    case = applied(screening.case, found)
    if case is not None:
        return refined(screening, found, case, best, begun)
    if first is not None:
        return None
    screening, found = _once_more(screening, found)
    excess = screening.score(found.chi_square, found)
    return Refit(found, screening.case, excess, screening.free_cost + excess, _passes(screening, found))


def tried_each(screening: Screening, each: Iterable[Fitted]) -> list[Refit]:
    """Several hypotheses, each put to the test."""
    return [refit for found in each if (refit := tried(screening, found)) is not None]


def drifts_no_more(refit: Refit, found: Fitted) -> bool:
    """Whether a drift of the clocks would explain no more than its price of what a trial leaves that is a delay alone."""
    if refit.screening is None or (refit.fitted.hypothesis.code, found.hypothesis.code) != ("delay-mismatch", "clock-drift"):
        return False
    _, gained = refit.screening.next_step(replace(found, x=refit.fitted.x))
    return bool(gained < np.log(refit.screening.free.gyro.spare))


def helped(screening: Screening, begun: Fitted) -> Refit | None:
    """The same from a beginning far away; None where that explains less than what is stated."""
    case = applied(screening.case, begun)
    there = None if case is None else _anew(screening, case, as_many=True)
    if case is None or there is None or there.cost + _by_units(there, begun, screening.case) > screening.cost:
        return None
    return refined(screening, replace(begun, x=np.concatenate([there.stated.x[:10], begun.x[10:]])), case)


def _beside(screening: Screening, first: Refit, second: Fitted) -> Fitted:
    """A hypothesis beside the one that is corrected already."""
    one = first.fitted
    x = _together(one.x, second.x, screening.model)
    supposed = one.hypothesis.beside(second.hypothesis)
    turned = replace(
        supposed,
        gyro=second.hypothesis.gyro @ one.hypothesis.gyro,
        accelerometer=second.hypothesis.accelerometer @ one.hypothesis.accelerometer,
    )
    return Fitted(turned, screening.model, x, second.chi_square, np.zeros(supposed.free.shape[1]))


def corrected_alone(screening: Screening, part: Fitted) -> Refit | None:
    """One of two hypotheses, with the values that it has beside the other; it is in the running with that alone."""
    own = np.asarray(part.hypothesis.free.any(1)) | (np.arange(len(part.x)) < 10)
    found = replace(part, x=np.where(own, part.x, screening.model.stated))
    case = applied(screening.case, found)
    mended = None if case is None else _anew(screening, case, (), found.value("theta"))
    if case is None or mended is None:
        return None
    return Refit(found, case, np.inf, np.inf, False, mended, _by_units(mended, found, screening.case))


def _once_more(screening: Screening, found: Fitted) -> tuple[Screening, Fitted]:
    """Fitted to a reduction about its own body, where that leaves less."""
    theta = found.value("theta")
    about = screened(screening.case, screening.piece, screening.free.beside, theta)
    if about is None:
        return screening, found
    (again,) = about.fitted([found.hypothesis], theta)
    better = about.free_cost + about.likelihood(again.chi_square) < screening.free_cost + screening.likelihood(found.chi_square)
    return (about, again) if better else (screening, found)


def _passes(screening: Screening, found: Fitted) -> bool:
    """Whether the log fits so far as the small step to it tells: of what can't be put into log or vehicle file."""
    freedom = screening.freedom - found.unknowns
    left = float(found.chi_square.sum() / freedom)
    return left < FITS[0] + FITS[1] * np.sqrt(2 / freedom) and (left < PART * screening.misfit or not screening.loud)


def refined(screening: Screening, found: Fitted, case: Case, best: float = np.inf, begun: AppliedHypothesis | None = None) -> Refit | None:
    """What is left once the case is reduced anew, its unknowns moved on from there until they stand, or can't come near the ``best`` score.

    First beside the disturbance that it was found with: a misfit may hide behind that, and without it the way is too steep. Then beside
    what is most likely there, until that stays.
    """
    beside = screening.free.beside
    found, case, mended = _led(screening, found, case, beside, best, bool(beside), begun)
    for _ in range(ROUNDS):
        if (
            mended is None
            or not beside
            or (not found.unknowns and _by_units(mended, found, screening.case) + mended.cost > screening.cost + CLEAR)
        ):
            break
        before = case
        found, case, mended = _led(screening, found, case, (), best)
        if case is before:
            break
        beside = () if mended is None or mended.free.beside == beside else mended.free.beside
    if mended is None:
        return None
    rounded = _rounded(screening, found)
    if rounded is not found:
        # what is lighter by as much as its forces are weaker looks like one whose forces are none, but for what these do to it
        case = applied(screening.case, rounded) or case
        found, mended = rounded, screened(case, screening.piece, mended.free.beside, found.value("theta")) or mended
    found = replace(found, chi_square=mended.stated.chi_square)
    much = mended.misfit < PART * screening.misfit
    fits = (
        mended.close
        and (much or not mended.loud)
        and not _no_drift(found)
        and not any(_nothing(part) or _no_unit(part) for part in found.parts)
    )
    # noise that was stated too small may be all that is wrong with a log that fits as it is
    fits = fits and (not (screening.fits and screening.noisy) or _gained(screening, mended) > PROMISED * (screening.cost - mended.cost))
    excess = mended.score(mended.stated.chi_square, found)
    units = _by_units(mended, found, screening.case)
    return Refit(found, case, excess, mended.free_cost + excess + units, fits, mended, units)


def over_all(screening: Screening, refit: Refit) -> Refit:
    """A cause with its values as all of a long log has them, of which the look was a part; as it is where the whole does not fit."""
    found, whole = refit.fitted, screening.case.whole
    if whole is None or found.unknowns == 0 or refit.screening is None:
        return refit
    case, piece = busiest(screening.case._replace(log=whole[0], whole=None), whole[1], MOST)
    longer = screened(case, piece, refit.screening.free.beside, found.value("theta"))
    if longer is None or not np.array_equal(longer.free.fired, screening.free.fired):
        return refit
    there = applied(case, replace(found, model=longer.model))
    better = None if there is None else refined(longer, replace(found, model=longer.model), there)
    if better is None or not better.fits:
        return refit
    told = replace(found, x=better.fitted.x, spread=better.fitted.spread)
    mended = applied(screening.case, told)
    return refit if mended is None else replace(refit, fitted=told, case=mended)


def _rounded(screening: Screening, found: Fitted) -> Fitted:
    """With the factors of channels that are dead, push the other way round or are logged in rpm as they are then."""
    thrust = screening.model.place("thrust")
    exact = [part for part in found.parts if at_once(part)]
    if not exact:
        return found
    x = found.x.copy()
    for part in exact:
        x[thrust][part.hypothesis.free[thrust].any(1)] = exact_of(part)
    return replace(found, x=x)


def _gained(screening: Screening, mended: Screening) -> float:
    """By how much −2 log likelihood of free noise levels is less once corrected, of a fit as exact as the estimator is."""
    before, after = screening.exact, mended.exact
    return -np.inf if before is None or after is None else float((len(before) * np.log((before**2).mean(0) / (after**2).mean(0))).sum())


def _nothing(part: Fitted) -> bool:
    """Whether its values are none but by chance: then the log fits for what else was found on the way to them."""
    return bool(part.unknowns and not part.hypothesis.states and not at_once(part) and ((part.moved / part.spread) ** 2).sum() < CLEAR)


def _no_unit(part: Fitted) -> bool:
    """Whether a place that is supposed to be in another unit was led to where it is in none: then it is anywhere."""
    return part.hypothesis.code == "imu-position" and bool(part.hypothesis.start) and float(abs(part.moved[0] - 1)) > NEAR


def _no_drift(found: Fitted) -> bool:
    """Whether a drift of the clocks is none beside the delay that is supposed with it: then it is the delay alone."""
    drift = abs(float(found.value("drift")[0]))
    own = found.hypothesis.code == "clock-drift"
    return own and drift < max(NO_DRIFT[0], NO_DRIFT[1] * float(found.spread[-1]) * PRIORS["drift"])


def _led(
    screening: Screening,
    found: Fitted,
    case: Case,
    likely: tuple[Disturbance, ...],
    best: float,
    roughly: bool = False,
    begun: AppliedHypothesis | None = None,
) -> tuple[Fitted, Case, Screening | None]:
    """A hypothesis moved on until it stands, beside one of the ``likely`` disturbances, or what is most likely now.

    Or until it promises too little to come near the ``best`` cost.
    """
    mended = _anew(screening, case, likely, _own_theta(found)) if begun is None else begun.screening
    if mended is None:
        return found, case, None
    if not found.unknowns:
        return found, case, mended if likely or mended.misfit > ASTRAY else about_its_body(mended)
    last: Array = np.zeros(found.unknowns)
    too_far = False
    still, most = (ROUGHLY, ROUGH) if roughly else (STILL, AGAIN)
    for i in range(most):
        more, promised = mended.next_step(found)
        found = replace(found, spread=_of_stated(found, more.spread) * np.sqrt(max(mended.misfit, 1.0)))
        now = mended.cost + _by_units(mended, found, screening.case)
        if i >= STRAIGHT and float(more.chi_square.sum()) > NO_WAY * mended.freedom:
            break
        if promised < still or now - BOLD * promised > best + CLEAR:
            break
        step = more.moved
        ratio = min(max(float(step @ last) / float(last @ last), 0.0), FARTHER) if last.any() else 0.0
        # where steps shrink by little, what they sum up to (Aitken 1926); else one alone
        parts = (1 / (1 - ratio), 1.0) if ratio > SLOWLY and not too_far else (1.0,)
        too_far = False
        for part in parts:
            further = replace(found, x=_together(found.x, more.along(part), screening.model))
            then = applied(screening.case, further)
            there = None if then is None else _anew(screening, then, mended.free.beside, more.value("theta"), as_many=True)
            if then is not None and there is not None and there.cost + _by_units(there, further, screening.case) < now - still:
                break
            too_far = True  # not tried again at once
        else:
            break
        found, case, mended, last = further, then, there, part * step
    return found, case, mended


def _anew(
    screening: Screening, case: Case, likely: tuple[Disturbance, ...] = (), theta: Array | None = None, as_many: bool = False
) -> Screening | None:
    """A corrected case reduced about θ; None where that is too short, or other channels fire: where ``as_many`` will do, more or fewer."""
    there = screened(case, screening.piece, likely, theta)
    if there is None or len(there.free.fired) != len(screening.free.fired):
        return None
    return there if as_many or (there.free.fired == screening.free.fired).all() else None


def _own_theta(found: Fitted) -> Array | None:
    """θ of a hypothesis that was fitted; None of one without unknowns."""
    return found.value("theta") if found.unknowns else None


def _together(x: Array, more: Array, model: Model) -> Array:
    """Both changes of x one after the other; the second was found with the first in place."""
    found = more.copy()
    own = slice(10, None)
    found[own] = x[own] + more[own] - model.stated[own]
    thrust = model.place("thrust")
    found[thrust] = x[thrust] * more[thrust]
    return found


def _of_stated(found: Fitted, spread: Array) -> Array:
    """(d,) sigmas of the unknowns as they change what is stated, of those (d,) by which they change it again: factors multiply."""
    place = found.model.place("thrust")
    free = np.abs(found.hypothesis.free[place])
    before, after = free.max(0, initial=0.0), (np.abs(found.x[place])[:, None] * free).max(0, initial=0.0)
    return spread * np.where(before > 0, after / np.where(before > 0, before, 1.0), 1.0)


def _by_units(mended: Screening, found: Fitted, stated: Case) -> float:
    """−2 log of the density of corrected measurements in the units, along the axes and behind the low-passes of the measured."""
    supposed, free, log = found.hypothesis, mended.free, stated.log
    record_s = median(log.interval_s)
    sensors = (("gyro", supposed.gyro, free.gyro), ("accel", supposed.accelerometer, free.accelerometer))
    total = 0.0
    for name, turn, told in sensors:
        scale = 2 * (found.value(f"{name}_scale").sum() + np.log(abs(np.linalg.det(turn))))
        lags = (getattr(case.vehicle.imu, f"{name}_lag_s") for case in (mended.case, stated))
        now, before = (3 * narrowed(lag_s, record_s, log.records_per_cycle) for lag_s in lags)
        total += told.spare * (scale + now - before)
    return float(total)
