"""Search: refits of the best hypotheses, until none that remains can come near the best."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import at_once
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.refit import AppliedHypothesis, Refit, begin, drifts_no_more, hopeless, tried
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.errorparameters.table import LATE

FURTHER = 1.5
"""Factor by which a screening overestimates the score of a large change before it is applied."""
LATER = 5.0
"""The same factor among codes of :data:`LATE`."""
IN_VAIN = 3.0
"""Multiple of the excess of a refit that does not fit, beyond which a screened hypothesis does not fit either; for codes of :data:`LATE`,
:data:`LATER` times that. Hypotheses that fitted nevertheless had at most 1.1, and 8 for late ones (docs/faults.md)."""
NO_FURTHER = 0.1
"""Distance in prior sigmas, within which two fits of one hypothesis are the same."""
STRANGE = 25.0
"""Prior chi-square of the unknowns beyond which a cause is improbable: five sigma."""


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

    - ``first``: a corrected cause that each hypothesis is combined with; its residuals are screened.
    - ``begun``: refits to start with.
    - ``most``: number of further refits while none fits, and once one does.
    - ``leaving``: chi-square above which a screening that is nearly exact rules a hypothesis out.
    - ``worst``: score that a hypothesis must promise to beat.
    """
    best = list(begun)
    near = -np.inf
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
        limit = np.inf if fitting else (LATER if candidate.hypothesis.code in LATE else 1.0) * _vain(first, best)
        if exhausted or (score > max(LATER * least_excess, near) + CLEAR and not _strange(fitting)):
            break
        if score > limit:
            continue
        applied = None
        if candidate.hypothesis.code in LATE:
            if by_promise is None:
                by_promise = [] if fitting else _by_promise(screening, first, screened, score)
            candidate, applied = by_promise.pop() if by_promise else (candidate, None)
        repeated = any(same(refit.fitted.parts[-1], candidate, refit.fits) or drifts_no_more(refit, candidate) for refit in best)
        best_score = min((refit.score for refit in fitting), default=np.inf)
        if repeated or (applied is not None and applied.least > best_score + CLEAR):
            continue
        if (score > farthest and not _simpler(candidate, fitting)) or hopeless(screened, candidate, leaving):
            continue
        refit = tried(screening, candidate, best_score, first, applied)
        if refit is not None:
            best.append(refit)
            near = score if refit.fits and not fitting else near
    return best


def _reach(first: Refit | None, refits: Sequence[Refit], others: Sequence[Refit], near: float) -> float:
    """Score beyond which hypotheses about single channels are not refitted; ``near`` is the screened score of the first refit that fits."""
    fitting = [refit for refit in (*others, *refits) if refit.fits]
    if not fitting:
        return _vain(first, refits)
    return np.inf if _strange(fitting) else max(FURTHER * min(refit.excess for refit in fitting), near) + CLEAR


def _vain(first: Refit | None, refits: Sequence[Refit]) -> float:
    """Score beyond which a hypothesis fits no better than a refit that does not fit; infinite next to a ``first``, which may still move."""
    excesses = [] if first is not None else [refit.excess for refit in refits if refit.screening is not None and not refit.screening.close]
    return IN_VAIN * min(excesses, default=np.inf) + CLEAR


def _by_promise(
    screening: Screening, first: Refit | None, screened: Screening, rough: float
) -> list[tuple[Fitted, AppliedHypothesis | None]]:
    """Hypotheses of codes :data:`LATE` near a ``rough`` score, each applied once, in ascending order of the promise of their next step."""
    reach = LATER * max(rough, 0.0) + CLEAR
    late = [one for score, one in screened.ranked.known if one.hypothesis.code in LATE and score <= reach]
    applied = [(one, begin(screening, one, first)) for one in late if not hopeless(screened, one, np.inf)]
    return sorted(applied, key=lambda one: np.inf if one[1] is None else one[1].promised, reverse=True)


def same(one: Fitted, other: Fitted, wherever: bool = False) -> bool:
    """Whether two fits state the same cause with the same values; with ``wherever``, with any values."""
    first, second = one.hypothesis, other.hypothesis
    turned = not (np.array_equal(first.gyro, second.gyro) and np.array_equal(first.accelerometer, second.accelerometer))
    if turned or (first.code, first.subject, first.states, one.unknowns) != (second.code, second.subject, second.states, other.unknowns):
        return False
    return wherever or float(np.abs(one.moved - other.moved).max(initial=0.0)) < NO_FURTHER


def codes(refit: Refit) -> set[str]:
    """Codes of the causes of a refit."""
    return {part.hypothesis.code for part in refit.fitted.parts}


def _simpler(found: Fitted, fitting: Sequence[Refit]) -> bool:
    """Whether a hypothesis states that a channel is dead or reversed for which the refits so far need an improbable cause."""
    improbable = {name for refit in _strange(fitting) for part in refit.fitted.parts for name in part.hypothesis.subject}
    return at_once(found) and not improbable.isdisjoint(found.hypothesis.subject)


def _strange(fitting: Sequence[Refit]) -> list[Refit]:
    """Refits with improbable values."""
    return [refit for refit in fitting if refit.fitted.unlikely > STRANGE]
