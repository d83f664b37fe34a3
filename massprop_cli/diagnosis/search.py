"""Search: refits of the best hypotheses, until none that remains can come near the best."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.levels import CERTAIN, CLEAR, STILL
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import is_discrete
from massprop_cli.diagnosis.refit import AppliedHypothesis, Refit, apply_once, drift_is_unneeded, hopeless, refitted
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.errorparameters.table import LATE

FURTHER = 1.5
"""Factor by which a screening overestimates the score of a large change before it is applied."""
LATER = 5.0
"""The same factor among codes of :data:`LATE`."""
IN_VAIN = 3.0
"""Multiple of the excess of a refit that does not fit, beyond which a screened hypothesis does not fit either; for codes of :data:`LATE`,
:data:`LATER` times that. Hypotheses that fitted nevertheless had at most 1.1, and 8 for late ones (docs/faults.md)."""


def searched(
    screening: Screening,
    begun: Sequence[Refit],
    most: tuple[int, int],
    leaving: float,
    first: Refit | None = None,
    others: Sequence[Refit] = (),
    worst: float = np.inf,
) -> list[Refit]:
    """Refits of screened hypotheses, until one fits and none that remains comes near it; ``others`` may fit as well.

    - ``first``: a corrected cause that each hypothesis is combined with, and whose residuals are screened.
    - ``begun``: initial refits; ``most``: number of further ones while none fits, and once one does.
    - ``leaving``: chi-square above which a screening that is nearly exact rules a hypothesis out.
    - ``worst``: score that a hypothesis must promise to beat.
    """
    best, near = list(begun), -np.inf
    by_promise: list[tuple[Fitted, AppliedHypothesis | None]] | None = None
    screened = screening if first is None or first.screening is None else first.screening

    def reach() -> float:
        return _reach(first, best, others, near)

    for score, candidate in screened.ranked.within(leaving, reach, CLEAR):
        fitting = [refit for refit in (*others, *best) if refit.fits]
        all_late = fitting and all(codes(refit) <= LATE for refit in fitting)
        least_excess = min((refit.excess for refit in fitting), default=np.inf)
        farthest = max((LATER if all_late and candidate.hypothesis.code in LATE else FURTHER) * least_excess, near) + CLEAR
        exhausted = len(best) - len(begun) >= most[bool(fitting)] or score > LATER * max(worst, 0.0) + CLEAR
        limit = np.inf if fitting else (LATER if candidate.hypothesis.code in LATE else 1.0) * _hopeless_score(first, best)
        if exhausted or (score > max(LATER * least_excess, near) + CLEAR and not _improbable(fitting)):
            break
        if score > limit:
            continue
        applied = None
        if candidate.hypothesis.code in LATE:
            if by_promise is None:
                by_promise = [] if fitting else _by_promise(screening, first, screened, score)
            candidate, applied = by_promise.pop() if by_promise else (candidate, None)
        repeated = any(equivalent(refit.fitted.parts[-1], candidate, refit.fits) or drift_is_unneeded(refit, candidate) for refit in best)
        best_score = min((refit.score for refit in fitting), default=np.inf)
        if repeated or (applied is not None and applied.least_cost > best_score + CLEAR):
            continue
        if (score > farthest and not _simpler(candidate, fitting)) or hopeless(screened, candidate, leaving):
            continue
        refit = refitted(screening, candidate, best_score, first, applied)
        if refit is not None:
            best.append(refit)
            near = score if refit.fits and not fitting else near
    return best


def _reach(first: Refit | None, refits: Sequence[Refit], others: Sequence[Refit], near: float) -> float:
    """Score beyond which hypotheses about single channels are not refitted; ``near`` is the screened score of the first refit that fits."""
    fitting = [refit for refit in (*others, *refits) if refit.fits]
    if not fitting:
        return _hopeless_score(first, refits)
    return np.inf if _improbable(fitting) else max(FURTHER * min(refit.excess for refit in fitting), near) + CLEAR


def _hopeless_score(first: Refit | None, refits: Sequence[Refit]) -> float:
    """Score beyond which a hypothesis fits no better than a refit that does not fit; infinite next to a ``first``, which may still move."""
    excesses = (
        [] if first is not None else [refit.excess for refit in refits if refit.screening is not None and not refit.screening.fits_closely]
    )
    return IN_VAIN * min(excesses, default=np.inf) + CLEAR


def _by_promise(
    screening: Screening, first: Refit | None, screened: Screening, rough: float
) -> list[tuple[Fitted, AppliedHypothesis | None]]:
    """Hypotheses of codes :data:`LATE` near a ``rough`` score, each applied once, in ascending order of the promise of their next step."""
    reach = LATER * max(rough, 0.0) + CLEAR
    late = [one for score, one in screened.ranked.fitted_so_far if one.hypothesis.code in LATE and score <= reach]
    applied = [(one, apply_once(screening, one, first)) for one in late if not hopeless(screened, one, np.inf)]
    return sorted(applied, key=lambda one: np.inf if one[1] is None else one[1].promised_score, reverse=True)


def equivalent(one: Fitted, other: Fitted, wherever: bool = False) -> bool:
    """Whether two fits state the same cause with the same values; with ``wherever``, with any values."""
    first, second = one.hypothesis, other.hypothesis
    turned = not (np.array_equal(first.gyro, second.gyro) and np.array_equal(first.accelerometer, second.accelerometer))
    if turned or (first.code, first.subject, first.key_values, one.unknowns) != (
        second.code,
        second.subject,
        second.key_values,
        other.unknowns,
    ):
        return False
    return wherever or float(np.abs(one.scaled - other.scaled).max(initial=0.0)) < STILL


def codes(refit: Refit) -> set[str]:
    """Codes of the causes of a refit."""
    return {part.hypothesis.code for part in refit.fitted.parts}


def _simpler(found: Fitted, fitting: Sequence[Refit]) -> bool:
    """Whether a hypothesis states that a channel is dead or reversed for which the refits so far need an improbable cause."""
    improbable = {name for refit in _improbable(fitting) for part in refit.fitted.parts for name in part.hypothesis.subject}
    return is_discrete(found) and not improbable.isdisjoint(found.hypothesis.subject)


def _improbable(fitting: Sequence[Refit]) -> list[Refit]:
    """Refits with improbable values."""
    return [refit for refit in fitting if refit.fitted.prior_chi_square > CERTAIN**2]
