"""The default estimator: a causal regression on products of the mass properties, one pass, cycle by cycle.

The information of the log is a triangle of constant size (:mod:`massprop_cli.estimate.regression`). The present estimate enters only the
second-order terms (:func:`massprop_cli.model.regressors.regressors`). While it still changes, the last :data:`RING` cycles are processed
again about the new estimate; older ones are not. So every row depends on its own and earlier cycles only, and no initial values are needed.
The cost of a cycle does not grow with the log.
"""

from __future__ import annotations

from dataclasses import replace

from massprop_cli.base.levels import ITERATIONS
from massprop_cli.estimate.initial import fallback, first_reference
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.rows import Rows
from massprop_cli.estimate.triangle import Run
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

BLOCK, LONGEST = 16, 128
"""Cycles per block: after a change of the reference, and at most; in between, half of the cycles since that change."""
RING, LEARNING = 256, 1024
"""Cycles that are processed again about a new reference: once each axis' response is known, and before. On a pedestal it is always the
latter: the first moment is known to 1e-5 there, so that second-order effects of the gyro bias are significant."""
FIRST = 16
"""Least number of cycles between two searches for an initial reference."""


class Causal:
    """Causal pass through one phase, block by block."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, consider: Consider) -> None:
        self.cycles, self.vehicle, self.consider = cycles, vehicle, consider
        self.extend(samples, cycles.stop)
        self.run = self.regression.begin(fallback(vehicle))
        self.started, self._due, self._budget = False, cycles.start + FIRST, LEARNING
        self._ring = [self.run]

    def extend(self, samples: Source, stop: int) -> None:
        """Continue with a longer log of the same flight, up to cycle ``stop``."""
        self.samples, self.cycles = samples, slice(self.cycles.start, stop)
        self.regression = Regression(samples, self.cycles, self.vehicle, self.consider)

    def block(self) -> Rows:
        """Estimates after each cycle of the next block; a block that the log's end cuts is repeated when the log is extended."""
        regression, before, cycles, budget = self.regression, self.run, self.cycles, self._budget
        end = before.at + (min(max(BLOCK, (before.at - before.relinearised_at) // 2), LONGEST) if self.started else BLOCK)
        run, whitened = regression.process(before, min(end, cycles.stop))
        if not self.started:
            rows = Rows.empty(len(whitened.innovations))
        else:
            posed = regression.posed(before, whitened)
            far = regression.first_nonlinear(before, posed) if budget >= 0 else None
            if far is not None:
                # the estimate is too far from the block's reference: the block ends here
                budget -= end - before.at - far - 1
                end, posed = before.at + far + 1, posed.first(far + 1)
                run, whitened = regression.process(before, end)
            rows = regression.rows(before, whitened, posed)
        if run.at < end:
            return rows
        self._budget = budget
        self._finish(run)
        return rows.ending(regression.row(self.run)) if self.started else rows

    def _finish(self, run: Run) -> None:
        """End a block with ``run``: solve for the estimate, and process the ring again where the reference must change."""
        regression, target = self.regression, None
        ring = [*_kept(self._ring, run.at - (RING if run.tied and not self.vehicle.on_pedestal else LEARNING)), run]
        if self.started:
            run = ring[-1] = regression.solved(run)
            if self._budget >= 0 and not regression.reference_is_close(run):
                target = run.estimate
        elif run.at >= self._due:
            # intervals grow with the phase, so that the cost of a long phase without motion is not quadratic
            self._due = run.at + max(FIRST, (run.at - self.cycles.start) // 200)
            target = first_reference(self.samples, slice(self.cycles.start, run.at), self.vehicle)
            if target is not None:
                ring = [replace(one, centre=target) for one in ring]
        self._budget += ITERATIONS * (run.at - self.run.at)
        if target is not None:
            self._budget -= run.at - ring[0].at
            ring = regression.relinearised(ring, target)
            run, self.started = ring[-1], True
        self._ring, self.run = ring, run


def _kept(ring: list[Run], oldest: int) -> list[Run]:
    """The runs from cycle ``oldest``; a last one too close to the one before is dropped, so that their number is bounded."""
    kept = [run for run in ring if run.at >= oldest]
    return kept[:-1] if len(kept) > 1 and kept[-1].at - kept[-2].at < BLOCK else kept
