"""The default estimator: a causal regression on products of the mass properties, one pass, cycle by cycle.

What the log has said stands in a triangle of constant size (:mod:`massprop_cli.estimate.regression`). The present estimate enters it only
where it multiplies what is small (:func:`massprop_cli.model.regressors.regressors`). While it still moves, the last :data:`RING` cycles are
taken in anew about where it has moved to; nothing older is looked at again. So every row depends on its own and earlier cycles only, no
starting value is needed, and the cost of a cycle does not grow with the log.
"""

from __future__ import annotations

from dataclasses import replace

from massprop_cli.estimate.initial import fallback, first_reference
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.rows import Rows
from massprop_cli.estimate.triangle import Run
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

BLOCK, LONGEST = 16, 128
"""Cycles taken in at a time: when the estimate has just moved, and at most; in between, half of those since."""
RING, LEARNING = 256, 1024
"""Cycles that are taken in anew when the estimate has moved: once each axis is known, and before. On a pedestal, where a first moment is
known to 1e-5 and what is of second order in the gyro's bias shows, always as many as before."""
AGAIN = 8
"""How often, on the average, a cycle may be taken in anew."""
FIRST = 16
"""Least number of cycles between attempts to find a first reference."""


class Causal:
    """The causal pass through one phase, where it stands between two blocks."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, consider: Consider) -> None:
        self.cycles, self.vehicle, self.consider = cycles, vehicle, consider
        self.goes_on(samples, cycles.stop)
        self.run = self.regression.begin(fallback(vehicle))
        self.started, self._due, self._spare = False, cycles.start + FIRST, LEARNING
        self._ring = [self.run]

    def goes_on(self, samples: Source, stop: int) -> None:
        """With a longer log of the same flight, up to cycle ``stop``."""
        self.samples, self.cycles = samples, slice(self.cycles.start, stop)
        self.regression = Regression(samples, self.cycles, self.vehicle, self.consider)

    def block(self) -> Rows:
        """Estimates after each of the next cycles; one that the log's end cuts short is begun again when the log has gone on."""
        regression, before, cycles, spare = self.regression, self.run, self.cycles, self._spare
        end = before.at + (min(max(BLOCK, (before.at - before.moved) // 2), LONGEST) if self.started else BLOCK)
        run, taken = regression.take(before, min(end, cycles.stop))
        if not self.started:
            rows = Rows.untold(len(taken.white))
        else:
            posed = regression.posed(before, taken)
            far = regression.astray(before, posed) if spare >= 0 else None
            if far is not None:
                # the estimate has moved too far to go on about the one before: the block ends here
                spare -= end - before.at - far - 1
                end, posed = before.at + far + 1, posed.first(far + 1)
                run, taken = regression.take(before, end)
            rows = regression.rows(before, taken, posed)
        if run.at < end:
            return rows
        self._spare = spare
        self._ends(run)
        return rows.ending(regression.row(self.run)) if self.started else rows

    def _ends(self, run: Run) -> None:
        """A block, with ``run``: the estimate anew, and cycles taken in again where it has moved."""
        regression, target = self.regression, None
        ring = [*_kept(self._ring, run.at - (RING if run.bound and not self.vehicle.on_pedestal else LEARNING)), run]
        if self.started:
            run = ring[-1] = regression.improved(run)
            if self._spare >= 0 and not regression.stands(run):
                target = run.estimate
        elif run.at >= self._due:
            # at due times only, in proportion, so that a long quiet stretch doesn't cost its square
            self._due = run.at + max(FIRST, (run.at - self.cycles.start) // 200)
            target = first_reference(self.samples, slice(self.cycles.start, run.at), self.vehicle)
            if target is not None:
                ring = [replace(one, centre=target) for one in ring]
        self._spare += AGAIN * (run.at - self.run.at)
        if target is not None:
            self._spare -= run.at - ring[0].at
            ring = regression.again(ring, target)
            run, self.started = ring[-1], True
        self._ring, self.run = ring, run


def _kept(ring: list[Run], oldest: int) -> list[Run]:
    """The checkpoints from a cycle on; one too near the one before it goes, so that their number has a bound."""
    kept = [run for run in ring if run.at >= oldest]
    return kept[:-1] if len(kept) > 1 and kept[-1].at - kept[-2].at < BLOCK else kept
