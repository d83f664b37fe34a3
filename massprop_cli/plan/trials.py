"""Single motions, each flown once for a block of cycles however often a plan asks: what they take, and what they show."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.plan.motions import Manoeuvre
from massprop_cli.plan.rehearsal import Rehearsal

SEARCHED = 2
"""Bodies that single motions are flown with; the whole plan is flown with every one."""
MEMBERS = 12
"""Bodies flown at once for what they show."""


class Trials:
    """Motions of a vehicle that were flown so far."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        self.rehearsal = rehearsal
        self._flown: dict[tuple[Manoeuvre, int], tuple[Array, dict[str, float]]] = {}
        self._information: dict[tuple[Manoeuvre, int], Array] = {}

    @property
    def _bodies(self) -> Array:
        return self.rehearsal.guess.bodies[:SEARCHED]

    def used(self, motion: Manoeuvre, block: int) -> dict[str, float]:
        """What a motion of ``block`` cycles takes of each limit, the most of any body."""
        if (motion, block) not in self._flown:
            self._flown[motion, block] = self.rehearsal.flown(motion.segments(0, block), block, self._bodies)
        return self._flown[motion, block][1]

    def open(self, motions: Sequence[Manoeuvre], block: int) -> list[list[Manoeuvre]]:
        """Those of motions that were flown whose information is not known yet, in groups of what :meth:`examine` takes at once."""
        some = [motion for motion in motions if (motion, block) not in self._information]
        size = MEMBERS // SEARCHED
        return [some[start : start + size] for start in range(0, len(some), size)]

    def examine(self, motions: Sequence[Manoeuvre], block: int) -> None:
        """Calculate the information of motions that were flown."""
        issued = np.concatenate([self._flown[motion, block][0] for motion in motions])
        told = self.rehearsal.information(block, issued, np.tile(self._bodies, (len(motions), 1))).sum(1)
        alone = _without_rate(told)
        for motion, one in zip(motions, alone.reshape(len(motions), SEARCHED, *alone.shape[1:]), strict=True):
            self._information[motion, block] = one

    def information(self, motion: Manoeuvre, block: int) -> Array:
        """(G, 10 or 11, the same) in natural sizes, where the rate at the start is unknown."""
        return self._information[motion, block]


def _without_rate(told: Array) -> Array:
    """(…, 10 or 11, the same) what is told of all else where the rate at the start is unknown: the Schur complement."""
    rates, rest = slice(10, 13), np.delete(np.arange(told.shape[-1]), slice(10, 13))
    across, rate = told[..., rest, rates], told[..., rates, rates]
    rate = rate + 1e-12 * np.trace(rate, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    return np.asarray(told[..., rest[:, None], rest] - across @ np.linalg.solve(rate, np.swapaxes(across, -1, -2)))
