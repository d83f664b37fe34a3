"""Search: refits of the most likely hypotheses, until none that remains can come near the best."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import at_once
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.refit import AppliedHypothesis, Refit, begin, drifts_no_more, hopeless, tried
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.errorparameters.table import LATE

FURTHER = 1.5
"""Before it is applied a large change looks worse than it is, by up to so much."""
LATER = 5.0
"""The same among codes of :data:`LATE`."""
IN_VAIN = 3.0
"""Times what doesn't fit leaves, from which on one that is looked at roughly doesn't either; among what makes motion late ``LATER`` times
that. What fitted after one that didn't was at most 1.1, and 8 if late. docs/faults.md moves."""
NO_FURTHER = 0.1
"""Of what is to be expected, by how much less two fits of one hypothesis are one."""
STRANGE = 25.0
"""Sum of squares of unknowns, over what is to be expected of each, beyond which a cause hardly happens: five sigma."""


def searched(
    screening: Screening,
    begun: Sequence[Refit],
    most: tuple[int, int],
    leaving: float,
    first: Refit | None = None,
    others: Sequence[Refit] = (),
    worst: float = np.inf,
) -> list[Refit]:
    """What a look makes likely, each put to the test, until one fits and none that is left comes near it; ``others`` may fit as well.

    Beside a ``first`` that is corrected already, where there is one, by what that leaves. After those that it has ``begun`` with, and no
    more than so many while none of all fits, and when one does; of chi-square the look, where it is as good as exact, may leave no more
    than ``leaving``; and none may promise a score above the ``worst``.
    """
    best = list(begun)
    near = -np.inf
    by_promise: list[tuple[Fitted, AppliedHypothesis | None]] | None = None
    seen = screening if first is None or first.screening is None else first.screening

    def reach() -> float:
        return _reach(first, best, others, near)

    for rough, found in seen.ranked.within(leaving, reach, CLEAR):
        fitting = [refit for refit in (*others, *best) if refit.fits]
        late = fitting and all(codes(refit) <= LATE for refit in fitting)
        least = min((refit.excess for refit in fitting), default=np.inf)
        farthest = max((LATER if late and found.hypothesis.code in LATE else FURTHER) * least, near) + CLEAR
        enough = len(best) - len(begun) >= most[bool(fitting)] or rough > LATER * max(worst, 0.0) + CLEAR
        bar = np.inf if fitting else (LATER if found.hypothesis.code in LATE else 1.0) * _vain(first, best)
        if enough or (rough > max(LATER * least, near) + CLEAR and not _strange(fitting)):
            break
        if rough > bar:
            continue
        once = None
        if found.hypothesis.code in LATE:
            if by_promise is None:
                by_promise = [] if fitting else _by_promise(screening, first, seen, rough)
            found, once = by_promise.pop() if by_promise else (found, None)
        done = any(same(refit.fitted.parts[-1], found, refit.fits) or drifts_no_more(refit, found) for refit in best)
        score = min((refit.score for refit in fitting), default=np.inf)
        if done or (once is not None and once.least > score + CLEAR):
            continue
        if (rough > farthest and not _simpler(found, fitting)) or hopeless(seen, found, leaving):
            continue
        refit = tried(screening, found, score, first, once)
        if refit is not None:
            best.append(refit)
            near = rough if refit.fits and not fitting else near
    return best


def _reach(first: Refit | None, before: Sequence[Refit], others: Sequence[Refit], near: float) -> float:
    """Score beyond which nothing is tried that is about a channel alone; what fitted first was looked at as ``near``."""
    fitting = [refit for refit in (*others, *before) if refit.fits]
    if not fitting:
        return _vain(first, before)
    return np.inf if _strange(fitting) else max(FURTHER * min(refit.excess for refit in fitting), near) + CLEAR


def _vain(first: Refit | None, before: Sequence[Refit]) -> float:
    """Score from which on one would leave no less than another that doesn't fit; beside a first that may yet move none tells."""
    unfit = [] if first is not None else [refit.excess for refit in before if refit.screening is not None and not refit.screening.close]
    return IN_VAIN * min(unfit, default=np.inf) + CLEAR


def _by_promise(screening: Screening, first: Refit | None, seen: Screening, rough: float) -> list[tuple[Fitted, AppliedHypothesis | None]]:
    """Of what makes motion late, those that one with a ``rough`` score may stand for, each applied once; the last promises most then."""
    reach = LATER * max(rough, 0.0) + CLEAR
    found = [one for score, one in seen.ranked.known if one.hypothesis.code in LATE and score <= reach]
    once = [(one, begin(screening, one, first)) for one in found if not hopeless(seen, one, np.inf)]
    return sorted(once, key=lambda one: np.inf if one[1] is None else one[1].promised, reverse=True)


def same(one: Fitted, other: Fitted, wherever: bool = False) -> bool:
    """Whether they say the same of the same, found from elsewhere; of one that fits already ``wherever`` it begins."""
    ours, theirs = one.hypothesis, other.hypothesis
    turned = not (np.array_equal(ours.gyro, theirs.gyro) and np.array_equal(ours.accelerometer, theirs.accelerometer))
    if turned or (ours.code, ours.subject, ours.states, one.unknowns) != (theirs.code, theirs.subject, theirs.states, other.unknowns):
        return False
    return wherever or float(np.abs(one.moved - other.moved).max(initial=0.0)) < NO_FURTHER


def codes(refit: Refit) -> set[str]:
    """Of what it supposes."""
    return {part.hypothesis.code for part in refit.fitted.parts}


def _simpler(found: Fitted, fitting: Sequence[Refit]) -> bool:
    """Whether it says of a channel that it is dead or reversed, of which what fits so far says what hardly happens."""
    strange = {name for refit in _strange(fitting) for part in refit.fitted.parts for name in part.hypothesis.subject}
    return at_once(found) and not strange.isdisjoint(found.hypothesis.subject)


def _strange(fitting: Sequence[Refit]) -> list[Refit]:
    """Those that say what hardly happens."""
    return [refit for refit in fitting if refit.fitted.unlikely > STRANGE]
