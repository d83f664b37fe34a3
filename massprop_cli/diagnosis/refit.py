"""Refit of a hypothesis: applied to log and vehicle file, reduced again, until its values converge."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import CERTAIN, CLEAR, ITERATIONS, MAIN_PART, SLOW_ITERATIONS
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import applied, discrete_factors, is_discrete
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.screening import FITS, Screening, busiest, relinearised, screened
from massprop_cli.errorparameters.actuatornames import NEAR
from massprop_cli.errorparameters.table import BY_NAME, ENTRIES, PRIORS
from massprop_cli.estimate.whitening import Disturbance
from massprop_cli.prepare.recorded import narrowed

PART = 1e-3
"""Misfit over the former one, below which a hypothesis explains a log even if its pure error far exceeds the stated noise."""
HOPELESS, SMALL = 8.0, 0.01
"""Multiple of pure error, and part of the stated misfit, above which a screened hypothesis does not make the log fit (docs/faults.md)."""
NO_DRIFT = (0.01, 5.0)
"""Drift of the clocks over the segment, cycles, and its sigmas, below which there is none."""
ASTRAY = 1e5
"""Misfit beyond which the intra-cycle motion of the fitted body is meaningless."""
NO_WAY, STRAIGHT = 100.0, 2
"""Predicted misfit of the next step beyond which an iteration is abandoned, and the iterations before this test (docs/faults.md)."""
STILL, ROUGHLY = 0.01, 1.0
"""Change of −2 log likelihood that ends the iterations; and before the disturbance is estimated again."""
BOLD = 3.0
"""Multiple of a predicted decrease that further iterations may reach."""
SLOWLY, FARTHER = 0.3, 0.97
"""Ratio of successive steps above which a step is extrapolated, and its largest value."""
MOST_CYCLES = 24_000
"""Cycles of the final fit, twenty times those of a screening. An hour at 20 Hz would lower the sigmas by less than a half."""


@dataclass(frozen=True)
class Refit:
    """A hypothesis applied to its case, and the fit that results."""

    fitted: Fitted
    case: Case
    excess: float
    """−2 log likelihood relative to free coefficients, with penalties."""
    score: float
    """−2 log likelihood of the measurements, with penalties."""
    fits: bool
    screening: Screening | None = None
    """Screening of the corrected log; None if the correction cannot be applied."""
    unit_cost: float = 0.0
    """−2 log Jacobian of the corrected measurements."""


def hopeless(screening: Screening, fit: Fitted, most: float) -> bool:
    """Whether a screened hypothesis leaves more than ``most`` of chi-square, if the screening is nearly exact for it; or is acausal."""
    if _acausal(screening, fit):
        return True
    if float(fit.chi_square.sum()) <= most:
        return False
    imu_turns = [turn for turn in (fit.hypothesis.gyro, fit.hypothesis.accelerometer) if (turn != np.eye(3)).any()]
    on_bearing = screening.model.bearing is not None
    # another unit changes the intra-cycle motion
    changes_motion = bool(imu_turns) if on_bearing else any(not np.isclose(abs(np.linalg.det(turn)), 1.0) for turn in imu_turns)
    free = fit.hypothesis.directions
    nonlinear = {BY_NAME[name].bends for name in ENTRIES if free[fit.model.place(name)].any()}
    return not changes_motion and not nonlinear & ({"always", "with gravity"} if on_bearing else {"always"})


def chi_square_limit(screening: Screening) -> float:
    """Chi-square above which a screened hypothesis is ruled out."""
    return max(HOPELESS, SMALL * screening.misfit) * screening.degrees_of_freedom


def _acausal(screening: Screening, fit: Fitted) -> bool:
    """Whether a delay, a lag, a rise or a droop is negative by more than chance."""
    errors = ((BY_NAME[name], float(fit.error(name)[0])) for name in ENTRIES if np.isfinite(BY_NAME[name].slack))
    return any(error < one.least(screening.case.setup) - one.slack for one, error in errors if error < -one.slack)


@dataclass(frozen=True)
class AppliedHypothesis:
    """A hypothesis applied once."""

    screening: Screening
    promised_score: float
    """Score that its next step predicts."""
    least_cost: float
    """Cost that further iterations may reach."""


def apply_once(screening: Screening, fit: Fitted, first: Refit | None) -> AppliedHypothesis | None:
    """Apply a hypothesis once, in addition to ``first``; None if the corrected log cannot be reduced."""
    fit = fit if first is None else _combined(screening, first, fit)
    case = applied(screening.case, fit)
    corrected = None if case is None else _reduced_again(screening, case, screening.free.disturbances, _fitted_theta(fit))
    if corrected is None:
        return None
    next_fit, promised = corrected.next_step(fit)
    units = _unit_cost(corrected, fit, screening.case)
    return AppliedHypothesis(
        corrected, corrected.free_cost + units + corrected.score(next_fit.chi_square, fit), corrected.cost + units - BOLD * promised
    )


def refitted(
    screening: Screening, fit: Fitted, best: float = np.inf, first: Refit | None = None, applied_once: AppliedHypothesis | None = None
) -> Refit | None:
    """Refit of a hypothesis, jointly with ``first`` if there is one; None if the correction cannot be applied.

    Iterations end if they cannot come near the ``best`` score.
    """
    fit = fit if first is None else _combined(screening, first, fit)
    case = applied(screening.case, fit)
    if case is not None:
        return refined(screening, fit, case, best, applied_once)
    if first is not None:
        return None
    screening, fit = _relinearised(screening, fit)
    excess = screening.score(fit.chi_square, fit)
    return Refit(fit, screening.case, excess, screening.free_cost + excess, _fits_linearly(screening, fit))


def refitted_each(screening: Screening, fits: Iterable[Fitted]) -> list[Refit]:
    """Refits of several hypotheses."""
    return [refit for fit in fits if (refit := refitted(screening, fit)) is not None]


def drift_is_unneeded(refit: Refit, fit: Fitted) -> bool:
    """Whether a clock drift explains no more than its penalty after a refit of the delay alone."""
    if refit.screening is None or (refit.fitted.hypothesis.code, fit.hypothesis.code) != ("delay-mismatch", "clock-drift"):
        return False
    _, gained = refit.screening.next_step(replace(fit, x=refit.fitted.x))
    return bool(gained < np.log(refit.screening.free.gyro.spare))


def refined_from(screening: Screening, start: Fitted) -> Refit | None:
    """Refit from distant initial values; None if these explain less than the stated case."""
    case = applied(screening.case, start)
    corrected = None if case is None else _reduced_again(screening, case, as_many=True)
    if case is None or corrected is None or corrected.cost + _unit_cost(corrected, start, screening.case) > screening.cost:
        return None
    return refined(screening, replace(start, x=np.concatenate([corrected.stated.x[:10], start.x[10:]])), case)


def _combined(screening: Screening, first: Refit, second: Fitted) -> Fitted:
    """The pair of a corrected hypothesis and another one."""
    first_fit = first.fitted
    x = _composed(first_fit.x, second.x, screening.model)
    pair = first_fit.hypothesis.combined_with(second.hypothesis)
    with_turns = replace(
        pair,
        gyro=second.hypothesis.gyro @ first_fit.hypothesis.gyro,
        accelerometer=second.hypothesis.accelerometer @ first_fit.hypothesis.accelerometer,
    )
    return Fitted(with_turns, screening.model, x, second.chi_square, np.zeros(pair.directions.shape[1]))


def corrected_alone(screening: Screening, part: Fitted) -> Refit | None:
    """One part of a pair applied alone, with its values from the pair; its score is infinite."""
    entries = np.asarray(part.hypothesis.directions.any(1)) | (np.arange(len(part.x)) < 10)
    fit = replace(part, x=np.where(entries, part.x, screening.model.stated))
    case = applied(screening.case, fit)
    corrected = None if case is None else _reduced_again(screening, case, (), fit.value("theta"))
    if case is None or corrected is None:
        return None
    return Refit(fit, case, np.inf, np.inf, False, corrected, _unit_cost(corrected, fit, screening.case))


def _relinearised(screening: Screening, fit: Fitted) -> tuple[Screening, Fitted]:
    """Fit on a reduction about the fitted body, if that lowers the cost."""
    theta = fit.value("theta")
    about = screened(screening.case, screening.piece, screening.free.disturbances, theta)
    if about is None:
        return screening, fit
    (again,) = about.fitted([fit.hypothesis], theta)
    better = about.free_cost + about.likelihood(again.chi_square) < screening.free_cost + screening.likelihood(fit.chi_square)
    return (about, again) if better else (screening, fit)


def _fits_linearly(screening: Screening, fit: Fitted) -> bool:
    """Whether a linear fit makes the log fit, for errors that cannot be applied to log or vehicle file."""
    freedom = screening.degrees_of_freedom - fit.unknowns
    misfit = float(fit.chi_square.sum() / freedom)
    return misfit < FITS + CERTAIN * np.sqrt(2 / freedom) and (misfit < PART * screening.misfit or not screening.far_exceeds_noise)


def refined(
    screening: Screening, fit: Fitted, case: Case, best: float = np.inf, applied_once: AppliedHypothesis | None = None
) -> Refit | None:
    """Iterate a hypothesis from ``case`` until its values converge, or cannot come near the ``best`` score.

    First under the disturbance of the screening, which may hide a misfit and without which the cost is too steep. Then under the maximum
    likelihood disturbance, until that stays the same.
    """
    disturbances = screening.free.disturbances
    fit, case, corrected = _iterated(screening, fit, case, disturbances, best, bool(disturbances), applied_once)
    for _ in range(ITERATIONS):
        if (
            corrected is None
            or not disturbances
            or (not fit.unknowns and _unit_cost(corrected, fit, screening.case) + corrected.cost > screening.cost + CLEAR)
        ):
            break
        previous = case
        fit, case, corrected = _iterated(screening, fit, case, (), best)
        if case is previous:
            break
        disturbances = () if corrected is None or corrected.free.disturbances == disturbances else corrected.free.disturbances
    if corrected is None:
        return None
    rounded = _rounded(screening, fit)
    if rounded is not fit:
        # a body that is lighter in proportion to its forces looks like one with weaker forces, but for other effects
        case = applied(screening.case, rounded) or case
        fit, corrected = rounded, screened(case, screening.piece, corrected.free.disturbances, fit.value("theta")) or corrected
    fit = replace(fit, chi_square=corrected.stated.chi_square)
    explained_most = corrected.misfit < PART * screening.misfit
    fits = (
        corrected.fits_closely
        and (explained_most or not corrected.far_exceeds_noise)
        and not _without_drift(fit)
        and not any(_insignificant(part) or _in_no_unit(part) for part in fit.parts)
    )
    # the stated noise may be too small, and nothing else wrong
    fits = fits and (
        not (screening.fits and screening.exceeds_noise)
        or _exact_gain(screening, corrected) > MAIN_PART * (screening.cost - corrected.cost)
    )
    excess = corrected.score(corrected.stated.chi_square, fit)
    units = _unit_cost(corrected, fit, screening.case)
    return Refit(fit, case, excess, corrected.free_cost + excess + units, fits, corrected, units)


def refined_on_whole_log(screening: Screening, refit: Refit) -> Refit:
    """Refit on the whole of a long log, of which the screening used a segment; unchanged if the whole does not fit."""
    fit, whole = refit.fitted, screening.case.whole
    if whole is None or fit.unknowns == 0 or refit.screening is None:
        return refit
    case, piece = busiest(screening.case._replace(log=whole[0], whole=None), whole[1], MOST_CYCLES)
    longer = screened(case, piece, refit.screening.free.disturbances, fit.value("theta"))
    if longer is None or not np.array_equal(longer.free.fired, screening.free.fired):
        return refit
    applied_case = applied(case, replace(fit, model=longer.model))
    refitted_whole = None if applied_case is None else refined(longer, replace(fit, model=longer.model), applied_case)
    if refitted_whole is None or not refitted_whole.fits:
        return refit
    final = replace(fit, x=refitted_whole.fitted.x, spread=refitted_whole.fitted.spread)
    final_case = applied(screening.case, final)
    return refit if final_case is None else replace(refit, fitted=final, case=final_case)


def _rounded(screening: Screening, fit: Fitted) -> Fitted:
    """With exact thrust factors of channels that are dead, reversed or logged in rpm."""
    thrust = screening.model.place("thrust")
    exact = [part for part in fit.parts if is_discrete(part)]
    if not exact:
        return fit
    x = fit.x.copy()
    for part in exact:
        x[thrust][part.hypothesis.directions[thrust].any(1)] = discrete_factors(part)
    return replace(fit, x=x)


def _exact_gain(screening: Screening, corrected: Screening) -> float:
    """Decrease of −2 log likelihood by the correction, from exact innovations with free noise levels."""
    before, after = screening.innovations, corrected.innovations
    return -np.inf if before is None or after is None else float((len(before) * np.log((before**2).mean(0) / (after**2).mean(0))).sum())


def _insignificant(part: Fitted) -> bool:
    """Whether the values of a hypothesis are not significant, so that something else made the log fit."""
    return bool(
        part.unknowns and not part.hypothesis.key_values and not is_discrete(part) and ((part.scaled / part.spread) ** 2).sum() < CLEAR
    )


def _in_no_unit(part: Fitted) -> bool:
    """Whether a place supposed in another unit converged to one in no unit."""
    return part.hypothesis.code == "imu-position" and bool(part.hypothesis.initial_values) and float(abs(part.scaled[0] - 1)) > NEAR


def _without_drift(fit: Fitted) -> bool:
    """Whether a clock drift is not significant next to the delay."""
    drift = abs(float(fit.value("drift")[0]))
    is_drift = fit.hypothesis.code == "clock-drift"
    return is_drift and drift < max(NO_DRIFT[0], NO_DRIFT[1] * float(fit.spread[-1]) * PRIORS["drift"])


def _iterated(
    screening: Screening,
    fit: Fitted,
    case: Case,
    likely: tuple[Disturbance, ...],
    best: float,
    roughly: bool = False,
    once: AppliedHypothesis | None = None,
) -> tuple[Fitted, Case, Screening | None]:
    """Iterate a hypothesis under one of the ``likely`` disturbances, or the maximum likelihood one, until it converges.

    Or until it cannot come near the ``best`` cost.
    """
    corrected = _reduced_again(screening, case, likely, _fitted_theta(fit)) if once is None else once.screening
    if corrected is None:
        return fit, case, None
    if not fit.unknowns:
        return fit, case, corrected if likely or corrected.misfit > ASTRAY else relinearised(corrected)
    last: Array = np.zeros(fit.unknowns)
    too_far = False
    tolerance, most = (ROUGHLY, ITERATIONS) if roughly else (STILL, SLOW_ITERATIONS)
    for i in range(most):
        next_fit, promised = corrected.next_step(fit)
        fit = replace(fit, spread=_scaled_spread(fit, next_fit.spread) * np.sqrt(max(corrected.misfit, 1.0)))
        cost = corrected.cost + _unit_cost(corrected, fit, screening.case)
        if i >= STRAIGHT and float(next_fit.chi_square.sum()) > NO_WAY * corrected.degrees_of_freedom:
            break
        if promised < tolerance or cost - BOLD * promised > best + CLEAR:
            break
        step = next_fit.scaled
        ratio = min(max(float(step @ last) / float(last @ last), 0.0), FARTHER) if last.any() else 0.0
        # if steps shrink slowly, their sum to infinity (Aitken 1926)
        parts = (1 / (1 - ratio), 1.0) if ratio > SLOWLY and not too_far else (1.0,)
        too_far = False
        for part in parts:
            guess = replace(fit, x=_composed(fit.x, next_fit.extrapolated(part), screening.model))
            then = applied(screening.case, guess)
            there = (
                None
                if then is None
                else _reduced_again(screening, then, corrected.free.disturbances, next_fit.value("theta"), as_many=True)
            )
            if then is not None and there is not None and there.cost + _unit_cost(there, guess, screening.case) < cost - tolerance:
                break
            too_far = True  # no extrapolation in the next iteration
        else:
            break
        fit, case, corrected, last = guess, then, there, part * step
    return fit, case, corrected


def _reduced_again(
    screening: Screening, case: Case, likely: tuple[Disturbance, ...] = (), theta: Array | None = None, as_many: bool = False
) -> Screening | None:
    """Reduce a corrected case about θ; None if it is too short, or if other channels act.

    With ``as_many``, only their number must agree.
    """
    screening_again = screened(case, screening.piece, likely, theta)
    if screening_again is None or len(screening_again.free.fired) != len(screening.free.fired):
        return None
    return screening_again if as_many or (screening_again.free.fired == screening.free.fired).all() else None


def _fitted_theta(fit: Fitted) -> Array | None:
    """θ of a hypothesis that was fitted; None without unknowns."""
    return fit.value("theta") if fit.unknowns else None


def _composed(x: Array, second: Array, model: Model) -> Array:
    """Apply two successive changes to x; the second was found with the first applied."""
    composed = second.copy()
    errors = slice(10, None)
    composed[errors] = x[errors] + second[errors] - model.stated[errors]
    thrust = model.place("thrust")
    composed[thrust] = x[thrust] * second[thrust]
    return composed


def _scaled_spread(fit: Fitted, spread: Array) -> Array:
    """(d,) sigmas relative to the stated values, from those (d,) relative to the applied ones: thrust factors multiply."""
    place = fit.model.place("thrust")
    free = np.abs(fit.hypothesis.directions[place])
    before, after = free.max(0, initial=0.0), (np.abs(fit.x[place])[:, None] * free).max(0, initial=0.0)
    return spread * np.where(before > 0, after / np.where(before > 0, before, 1.0), 1.0)


def _unit_cost(corrected: Screening, fit: Fitted, stated: Case) -> float:
    """−2 log Jacobian of the correction: density of the corrected measurements in the units, axes and low-passes of the measured ones."""
    hypothesis, free, log = fit.hypothesis, corrected.free, stated.log
    record_s = median(log.interval_s)
    sensors = (("gyro", hypothesis.gyro, free.gyro), ("accel", hypothesis.accelerometer, free.accelerometer))
    total = 0.0
    for name, turn, sensor in sensors:
        scale = 2 * (fit.value(f"{name}_scale").sum() + np.log(abs(np.linalg.det(turn))))
        lags = (getattr(case.vehicle.imu, f"{name}_lag_s") for case in (corrected.case, stated))
        lag_now, lag_before = (3 * narrowed(lag_s, record_s, log.records_per_cycle) for lag_s in lags)
        total += sensor.spare * (scale + lag_now - lag_before)
    return float(total)
