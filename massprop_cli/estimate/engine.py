"""The default estimator: a regression on products of the mass properties, run through a phase once, cycle by cycle.

What the log has said stands in a triangle of constant size (:mod:`massprop_cli.estimate.regression`). The present estimate enters it only
where it multiplies what is small (:func:`massprop_cli.model.lifted.lifted`). While it still moves, the last :data:`RING` cycles are
taken in anew about where it has moved to; nothing older is looked at again. So every row depends on its own and earlier cycles only, no
starting value is needed, and the cost of a cycle does not grow with the log.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from massprop_cli.estimate import compiled, flown
from massprop_cli.estimate.history import History
from massprop_cli.estimate.initial import fallback, first_reference
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.rows import Rows
from massprop_cli.estimate.told import Told
from massprop_cli.estimate.triangle import Run
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.handed import StatusError
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source
from massprop_cli.prepare.stream import Stream

BLOCK, LONGEST = 16, 128
"""Cycles taken in at a time: when the estimate has just moved, and at most; in between, half of those since."""
RING, LEARNING = 256, 1024
"""Cycles that are taken in anew when the estimate has moved: once each axis is known, and before."""
AGAIN = 8
"""How often, on the average, a cycle may be taken in anew."""
FIRST = 16
"""Least number of cycles between attempts to find a first reference."""


def replay(
    samples: Source,
    cycles: slice,
    phase: Phase,
    vehicle: Resolved,
    consider: Consider = Consider(),  # noqa: B008  a constant: it is frozen
    progress: Callable[[float], None] | None = None,
) -> History:
    """Run the estimator through ``cycles`` (non-empty).

    What is uncertain in ``consider`` enters every sigma. ``progress`` is told the part done, 0 to 1, on the way. Where the compiled kernel
    holds all that the vehicle asks for it runs instead of what stands here, which it follows decision by decision.
    """
    if compiled.holds(vehicle, consider):
        # what is too large to be squared is no cycle to the kernel; here it becomes nothing that can be said
        with suppress(StatusError):
            return _compiled(samples, cycles, phase, vehicle, progress)
    told, causal = Told(cycles, vehicle), _Causal(samples, cycles, vehicle, consider)
    while causal.run.at < cycles.stop:
        if progress is not None:
            progress((causal.run.at - cycles.start) / (cycles.stop - cycles.start))
        told.add(causal.step())
    return told.history(samples, phase, causal.run.estimate if causal.started else None)


class _Causal:
    """The causal pass, as it stands after some of its cycles."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, consider: Consider) -> None:
        self.samples, self.cycles, self.vehicle = samples, cycles, vehicle
        self.regression = Regression(samples, cycles, vehicle, consider)
        self.run = self.regression.begin(fallback(vehicle))
        self.ring = [self.run]
        self.started, self.due, self.spare = False, cycles.start + FIRST, LEARNING

    def step(self) -> Rows:
        """The next block of cycles."""
        begun = self.run.at
        rows, whole = self._taken()
        if not whole:
            return rows  # a block at the log's end is what it would have been in a longer log
        self.ring = [*_kept(self.ring, self.run.at - (RING if self.run.bound else LEARNING)), self.run]
        target = self._moved() if self.started else self._first()
        self.spare += AGAIN * (self.run.at - begun)
        if target is not None:
            self.spare -= self.run.at - self.ring[0].at
            self.ring = self.regression.again(self.ring, target)
            self.run, self.started = self.ring[-1], True
        return rows.ending(*self.regression.row(self.run)) if self.started else rows

    def _taken(self) -> tuple[Rows, bool]:
        """The rows of the next block, about the estimate before it; and whether the log held all of it."""
        before = self.run
        end = before.at + (min(max(BLOCK, (before.at - before.moved) // 2), LONGEST) if self.started else BLOCK)
        self.run, taken = self.regression.take(before, min(end, self.cycles.stop))
        if not self.started:
            return Rows.untold(len(taken.white)), self.run.at == end
        posed = self.regression.posed(before, taken)
        far = self.regression.astray(before, posed) if self.spare >= 0 else None
        if far is not None:
            # the estimate has moved too far to go on about the one before: the block ends here
            self.spare -= end - before.at - far - 1
            end, posed = before.at + far + 1, posed.first(far + 1)
            self.run, taken = self.regression.take(before, end)
        return self.regression.rows(before, taken, posed), self.run.at == end

    def _moved(self) -> Reference | None:
        """The estimate that the log now gives, where it has moved too far to go on about the one before."""
        self.run = self.ring[-1] = self.regression.improved(self.run)
        return self.run.estimate if self.spare >= 0 and not self.regression.stands(self.run) else None

    def _first(self) -> Reference | None:
        """A first reference; None where the log tells none yet."""
        if self.run.at < self.due:
            return None
        # at due times only, in proportion, so that a long quiet stretch doesn't cost its square
        self.due = self.run.at + max(FIRST, (self.run.at - self.cycles.start) // 200)
        target = first_reference(self.samples, slice(self.cycles.start, self.run.at), self.vehicle)
        if target is not None:
            self.ring = [replace(one, centre=target) for one in self.ring]
        return target


def _kept(ring: list[Run], oldest: int) -> list[Run]:
    """The checkpoints from a cycle on; one too near the one before it goes, so that their number has a bound."""
    kept = [run for run in ring if run.at >= oldest]
    return kept[:-1] if len(kept) > 1 and kept[-1].at - kept[-2].at < BLOCK else kept


def _compiled(samples: Source, cycles: slice, phase: Phase, vehicle: Resolved, progress: Callable[[float], None] | None) -> History:
    """The same, by the compiled kernel."""
    told = Told(cycles, vehicle)
    if isinstance(samples, Stream) and flown.holds(samples):
        parts, reference = flown.replayed(samples, cycles, vehicle, progress)
    else:
        aligned = compiled.Pass(samples, cycles, vehicle)
        parts, reference = aligned.rows(progress), aligned.reference
    for rows in parts:
        told.add(rows)
    return told.history(samples, phase, reference())
