"""What a look makes likely, put to the test one after another, until nothing that is left comes near what fits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprop_cli.diagnosis.contest import Fitted
from massprop_cli.diagnosis.cures import at_once
from massprop_cli.diagnosis.look import CLEAR, Look
from massprop_cli.diagnosis.trial import Begun, Trial, begin, drifts_no_more, hopeless, tried
from massprop_cli.errorparameters.table import LATE

FURTHER = 1.5
"""Before it is applied a large change looks worse than it is, by up to so much."""
LATER = 5.0
"""The same among codes of :data:`LATE`."""
IN_VAIN = 3.0
"""Times what doesn't fit leaves, from which on one that is looked at roughly doesn't either; among what makes motion late ``LATER`` times
that. What fitted after one that didn't was at most 1.1, and 8 if late. docs/faults.md moves."""
NO_FURTHER = 0.1
"""Of what is to be expected, by how much less two fits of one supposition are one."""
STRANGE = 25.0
"""Sum of squares of unknowns, over what is to be expected of each, beyond which a cause hardly happens: five sigma."""


def searched(
    look: Look,
    begun: Sequence[Trial],
    most: tuple[int, int],
    leaving: float,
    first: Trial | None = None,
    others: Sequence[Trial] = (),
    worst: float = np.inf,
) -> list[Trial]:
    """What a look makes likely, each put to the test, until one fits and none that is left comes near it; ``others`` may fit as well.

    Beside a ``first`` that is mended already, where there is one, by what that leaves. After those that it has ``begun`` with, and no more
    than so many while none of all fits, and when one does; of chi-square the look, where it is as good as exact, may leave no more than
    ``leaving``; and none may promise a score above the ``worst``.
    """
    best = list(begun)
    near = -np.inf
    by_promise: list[tuple[Fitted, Begun | None]] | None = None
    seen = look if first is None or first.look is None else first.look

    def reach() -> float:
        return _reach(first, best, others, near)

    for rough, found in seen.ranked.within(leaving, reach, CLEAR):
        fitting = [trial for trial in (*others, *best) if trial.fits]
        late = fitting and all(codes(trial) <= LATE for trial in fitting)
        least = min((trial.excess for trial in fitting), default=np.inf)
        farthest = max((LATER if late and found.supposed.code in LATE else FURTHER) * least, near) + CLEAR
        enough = len(best) - len(begun) >= most[bool(fitting)] or rough > LATER * max(worst, 0.0) + CLEAR
        bar = np.inf if fitting else (LATER if found.supposed.code in LATE else 1.0) * _vain(first, best)
        if enough or (rough > max(LATER * least, near) + CLEAR and not _strange(fitting)):
            break
        if rough > bar:
            continue
        once = None
        if found.supposed.code in LATE:
            if by_promise is None:
                by_promise = [] if fitting else _by_promise(look, first, seen, rough)
            found, once = by_promise.pop() if by_promise else (found, None)
        done = any(same(trial.fitted.parts[-1], found, trial.fits) or drifts_no_more(trial, found) for trial in best)
        score = min((trial.score for trial in fitting), default=np.inf)
        if done or (once is not None and once.least > score + CLEAR):
            continue
        if (rough > farthest and not _simpler(found, fitting)) or hopeless(seen, found, leaving):
            continue
        trial = tried(look, found, score, first, once)
        if trial is not None:
            best.append(trial)
            near = rough if trial.fits and not fitting else near
    return best


def _reach(first: Trial | None, before: Sequence[Trial], others: Sequence[Trial], near: float) -> float:
    """Score beyond which nothing is tried that is about a channel alone; what fitted first was looked at as ``near``."""
    fitting = [trial for trial in (*others, *before) if trial.fits]
    if not fitting:
        return _vain(first, before)
    return np.inf if _strange(fitting) else max(FURTHER * min(trial.excess for trial in fitting), near) + CLEAR


def _vain(first: Trial | None, before: Sequence[Trial]) -> float:
    """Score from which on one would leave no less than another that doesn't fit; beside a first that may yet move none tells."""
    unfit = [] if first is not None else [trial.excess for trial in before if trial.look is not None and not trial.look.close]
    return IN_VAIN * min(unfit, default=np.inf) + CLEAR


def _by_promise(look: Look, first: Trial | None, seen: Look, rough: float) -> list[tuple[Fitted, Begun | None]]:
    """Of what makes motion late, those that one with a ``rough`` score may stand for, each applied once; the last promises most then."""
    reach = LATER * max(rough, 0.0) + CLEAR
    found = [one for score, one in seen.ranked.known if one.supposed.code in LATE and score <= reach]
    once = [(one, begin(look, one, first)) for one in found if not hopeless(seen, one, np.inf)]
    return sorted(once, key=lambda one: np.inf if one[1] is None else one[1].promised, reverse=True)


def same(one: Fitted, other: Fitted, wherever: bool = False) -> bool:
    """Whether they say the same of the same, found from elsewhere; of one that fits already ``wherever`` it begins."""
    ours, theirs = one.supposed, other.supposed
    turned = not (np.array_equal(ours.gyro, theirs.gyro) and np.array_equal(ours.accelerometer, theirs.accelerometer))
    if turned or (ours.code, ours.subject, one.unknowns) != (theirs.code, theirs.subject, other.unknowns):
        return False
    return wherever or float(np.abs(one.moved - other.moved).max(initial=0.0)) < NO_FURTHER


def codes(trial: Trial) -> set[str]:
    """Of what it supposes."""
    return {part.supposed.code for part in trial.fitted.parts}


def _simpler(found: Fitted, fitting: Sequence[Trial]) -> bool:
    """Whether it says of a channel that it is dead or reversed, of which what fits so far says what hardly happens."""
    strange = {name for trial in _strange(fitting) for part in trial.fitted.parts for name in part.supposed.subject}
    return at_once(found) and not strange.isdisjoint(found.supposed.subject)


def _strange(fitting: Sequence[Trial]) -> list[Trial]:
    """Those that say what hardly happens."""
    return [trial for trial in fitting if trial.fitted.unlikely > STRANGE]
