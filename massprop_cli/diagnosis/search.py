"""What a look makes likely, put to the test one after another, until nothing that is left comes near what fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from massprop_cli.diagnosis.contest import Fitted
from massprop_cli.diagnosis.cures import at_once
from massprop_cli.diagnosis.look import CLEAR, Look
from massprop_cli.diagnosis.trial import Trial, hopeless

FURTHER = 1.5
"""Before it is applied a large change looks worse than it is, by up to so much."""
LATE, LATER = frozenset({"delay-mismatch", "thrust-lag", "thrust-rise", "gyro-filter", "clock-drift"}), 5.0
"""Codes of what makes motion late, which only the shape within a cycle tells apart; among these, by up to so much."""
NO_FURTHER = 0.1
"""Of what is to be expected, by how much less two fits of one supposition are one."""
STRANGE = 25.0
"""Sum of squares of unknowns, over what is to be expected of each, beyond which a cause hardly happens: five sigma."""
Put = Callable[[Fitted, float], Trial | None]
"""A supposition put to the test, followed no further than it may come near a score."""


def searched(
    look: Look,
    put: Put,
    begun: Sequence[Trial],
    most: tuple[int, int],
    leaving: float,
    others: Sequence[Trial] = (),
    worst: float = np.inf,
) -> list[Trial]:
    """What a look makes likely, each put to the test, until one fits and none that is left comes near it; ``others`` may fit as well.

    After those that it has ``begun`` with, and no more than so many while none of all fits, and when one does; of chi-square the look,
    where it is as good as exact, may leave no more than ``leaving``; and none may promise a score above the ``worst``.
    """
    best = list(begun)
    near = -np.inf
    for rough, found in look.ranked.within(leaving):
        fitting = [trial for trial in (*others, *best) if trial.fits]
        late = fitting and all(codes(trial) <= LATE for trial in fitting)
        least = min((trial.excess for trial in fitting), default=np.inf)
        farthest = max((LATER if late and found.supposed.code in LATE else FURTHER) * least, near) + CLEAR
        if rough > LATER * max(worst, 0.0) + CLEAR:
            break
        enough = len(best) - len(begun) >= most[bool(fitting)]
        if enough or (rough > max(LATER * least, near) + CLEAR and not _strange(fitting)):
            break
        done = any(same(trial.fitted.parts[-1], found) for trial in best)
        if done or (rough > farthest and not _simpler(found, fitting)) or hopeless(look, found, leaving):
            continue
        trial = put(found, min((trial.score for trial in fitting), default=np.inf))
        if trial is not None:
            best.append(trial)
            near = rough if trial.fits and not fitting else near
    return best


def same(one: Fitted, other: Fitted) -> bool:
    """Whether they say the same of the same, found from elsewhere."""
    ours, theirs = one.supposed, other.supposed
    turned = not (np.array_equal(ours.gyro, theirs.gyro) and np.array_equal(ours.accelerometer, theirs.accelerometer))
    if turned or (ours.code, ours.subject, one.unknowns) != (theirs.code, theirs.subject, other.unknowns):
        return False
    return float(np.abs(one.moved - other.moved).max(initial=0.0)) < NO_FURTHER


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
