"""The default estimator: a regression on products of the mass properties, run through a phase once, cycle by cycle.

What the log has said stands in a triangle of constant size (:mod:`massprop_cli.estimate.regression`). The present estimate enters it only
where it multiplies what is small (:func:`massprop_cli.model.linearise.lifted`). While it still moves, the last :data:`RING` cycles are
taken in anew about where it has moved to; nothing older is looked at again. So every row depends on its own and earlier cycles only, no
starting value is needed, and the cost of a cycle does not grow with the log.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.estimate import compiled, flown
from massprop_cli.estimate.history import History
from massprop_cli.estimate.initial import fallback, first_reference
from massprop_cli.estimate.known import belied
from massprop_cli.estimate.nuisance import Taken
from massprop_cli.estimate.quantities import alone, quantities
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.residual import Residual, residual
from massprop_cli.estimate.rows import Response, Rows
from massprop_cli.estimate.triangle import Run
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.model.handed import StatusError
from massprop_cli.model.linearise import MU, natural_sizes
from massprop_cli.model.observability import excitation, observable
from massprop_cli.model.plant import Reference
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
SETTLED = 0.003
"""Largest second-order error of what is linear about the reference, in sigmas, of an off-line fit that stands still."""
SETTLINGS = 8
"""Most passes of the off-line fit."""
WHOLE = 512
"""Cycles taken in at a time by what is off-line."""
HELD = 4096
"""Cycles of which an off-line fit keeps what it took in until it stands; of more it takes them in once again."""


def replay(
    samples: Source,
    cycles: slice,
    phase: Phase,
    vehicle: Vehicle,
    consider: Consider = Consider(),  # noqa: B008  a constant: it is frozen
    progress: Callable[[float], None] | None = None,
) -> History:
    """Run the estimator through ``cycles`` (non-empty). ``vehicle`` must state noise levels (:mod:`massprop_cli.estimate.disturbances`).

    What is uncertain in ``consider`` enters every sigma. ``progress`` is told the part done, 0 to 1, on the way. Where the compiled kernel
    holds all that the vehicle asks for it runs instead of what stands here, which it follows decision by decision.
    """
    if compiled.holds(vehicle, consider):
        # what is too large to be squared is no cycle to the kernel; here it becomes nothing that can be said
        with suppress(StatusError):
            return _compiled(samples, cycles, phase, vehicle, progress)
    regression = Regression(samples, cycles, vehicle, consider)
    run = regression.begin(fallback(vehicle))
    started, due, spare = False, cycles.start + FIRST, LEARNING
    ring, told = [run], _Told(cycles, vehicle)
    while run.at < cycles.stop:
        if progress is not None:
            progress((run.at - cycles.start) / (cycles.stop - cycles.start))
        end = run.at + (min(max(BLOCK, (run.at - run.moved) // 2), LONGEST) if started else BLOCK)
        before, (run, taken), far = run, regression.take(run, min(end, cycles.stop)), None
        if not started:
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
            told.add(rows)
            break  # a block at the log's end is what it would have been in a longer log
        ring = [*_kept(ring, run.at - (RING if run.bound else LEARNING)), run]
        target: Reference | None = None
        if started:
            run = ring[-1] = regression.improved(run)
            if spare >= 0 and not regression.stands(run):
                target = run.estimate
        elif run.at >= due:
            # at due times only, in proportion, so that a long quiet stretch doesn't cost its square
            due = run.at + max(FIRST, (run.at - cycles.start) // 200)
            target = first_reference(samples, slice(cycles.start, run.at), vehicle)
            if target is not None:
                ring = [replace(one, centre=target) for one in ring]
        spare += AGAIN * (run.at - before.at)
        if target is not None:
            spare -= run.at - ring[0].at
            ring = regression.again(ring, target)
            run, started = ring[-1], True
        told.add(rows.ending(*regression.row(run)) if started else rows)
    return _history(samples, phase, told, run.estimate if started else None)


def _kept(ring: list[Run], oldest: int) -> list[Run]:
    """The checkpoints from a cycle on; one too near the one before it goes, so that their number has a bound."""
    kept = [run for run in ring if run.at >= oldest]
    return kept[:-1] if len(kept) > 1 and kept[-1].at - kept[-2].at < BLOCK else kept


def _compiled(samples: Source, cycles: slice, phase: Phase, vehicle: Vehicle, progress: Callable[[float], None] | None) -> History:
    """The same, by the compiled kernel."""
    told = _Told(cycles, vehicle)
    if isinstance(samples, Stream) and flown.holds(samples):
        parts, reference = flown.replayed(samples, cycles, vehicle, progress)
    else:
        aligned = compiled.Pass(samples, cycles, vehicle)
        parts, reference = aligned.rows(progress), aligned.reference
    for rows in parts:
        told.add(rows)
    return _history(samples, phase, told, reference())


class _Told:
    """What every cycle's estimate comes to, block by block; or of an off-line fit the last one's, and every cycle's innovations."""

    def __init__(self, cycles: slice, vehicle: Vehicle, every: bool = True) -> None:
        self.cycles, self.vehicle, self.every = cycles, vehicle, every
        count = cycles.stop - cycles.start
        self.normalised = np.empty((count, 6))
        self.values, self.sigmas = np.empty((count if every else 1, 10)), np.empty((count if every else 1, 10))
        self.innovation, self.innovation_sigma = (np.empty((len(self.values), 6)) for _ in range(2))
        self.count = 0

    def add(self, rows: Rows) -> None:
        """The next cycles."""
        if not len(rows.mean):
            return
        part = slice(self.count, self.count + len(rows.mean))
        self.normalised[part] = rows.normalised
        self.count, self.last = part.stop, (rows.mean[-1], rows.covariance[-1])
        here, own = (part, slice(None)) if self.every else (slice(None), slice(-1, None))
        self.values[here], full = quantities(rows.mean[own], rows.covariance[own], self.vehicle)
        self.sigmas[here] = np.sqrt(np.einsum("kii->ki", full))
        self.innovation[here], self.innovation_sigma[here] = rows.innovation[own], rows.sigma[own]


class Settled(NamedTuple):
    """An off-line fit; its rows are not causal."""

    history: History
    stands: bool
    """Whether another pass would change nothing."""


def settle(
    samples: Source,
    cycles: slice,
    phase: Phase,
    reference: Reference,
    vehicle: Vehicle,
    consider: Consider = Consider(),  # noqa: B008
    passes: int = SETTLINGS,
    bound: bool = False,
) -> Settled:
    """The off-line fit: the whole phase at hand, from ``reference`` on.

    ``bound``: each axis is known to be told without the gyroscopic coupling.

    Repeated about its own last estimate until that stands still, or so many ``passes``: Gauss–Newton on the likelihood of all data.
    """
    regression = Regression(samples, cycles, vehicle, consider)
    last = _last_pass(regression, reference, passes, bound)
    told, left = _Told(cycles, vehicle, every=vehicle.estimator.refine), list[Residual]()
    for before, taken, after in last.held or blocks(regression, last.begun):
        about = replace(before, estimate=last.run.estimate, bound=last.run.bound)
        rows = regression.rows(about, taken, regression.posed(about, taken, told.every))
        told.add(rows.ending(*regression.row(last.run)) if after.at == cycles.stop else rows)
        left.append(residual(regression, before, taken, last.run))
    return Settled(replace(_history(samples, phase, told, last.run.estimate), residual=Residual.joined(left)), last.stands)


class Led(NamedTuple):
    """What a fit may begin about."""

    reference: Reference
    bound: bool = False
    """Whether each axis is known to be told without the gyroscopic coupling."""


def led(samples: Source, cycles: slice, start: Led, vehicle: Vehicle, passes: int) -> Led:
    """The body that so many passes find in ``cycles``."""
    run = _last_pass(Regression(samples, cycles, vehicle, Consider()), start.reference, passes, start.bound).run
    return Led(run.estimate, run.bound)


class _Pass(NamedTuple):
    """One pass of an off-line fit."""

    begun: Run
    run: Run
    """With the estimate that it found."""
    stands: bool
    """Whether another pass would change nothing."""
    held: list[_Block]
    """What it took in, of a short phase."""


def _last_pass(regression: Regression, reference: Reference, passes: int, bound: bool) -> _Pass:
    cycles = regression.cycles
    short = cycles.stop - cycles.start <= HELD
    for _ in range(passes):
        begun = run = replace(regression.begin(reference), bound=bound)
        held = []
        for block in blocks(regression, begun):
            run = block.after
            held += [block] if short else []
        run = regression.improved(run)
        stands = run.bound == bound and regression.still(run, SETTLED)
        if stands:
            break
        reference, bound = run.estimate, run.bound
    return _Pass(begun, run, stands, held)


class _Block(NamedTuple):
    """Cycles taken in at once."""

    before: Run
    taken: Taken
    after: Run


def blocks(regression: Regression, run: Run) -> Iterator[_Block]:
    """All cycles from a run on."""
    while run.at < regression.cycles.stop:
        before, (run, taken) = run, regression.take(run, min(run.at + WHOLE, regression.cycles.stop))
        yield _Block(before, taken, run)


def respond(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, consider: Consider) -> Response:
    """What each assumption does, about ``reference``."""
    regression = Regression(samples, cycles, vehicle, consider)
    run = replace(regression.begin(reference), bound=True)
    for block in blocks(regression, run):
        run = block.after
    return regression.response(run)


def _history(samples: Source, phase: Phase, told: _Told, reference: Reference | None) -> History:
    vehicle, cycles, (mean, covariance) = told.vehicle, told.cycles, told.last
    _, full = quantities(mean[None], covariance[None], vehicle)
    bare = quantities(mean[None], covariance[None], alone(vehicle))
    against, notices = belied(mean, covariance, vehicle, phase.name)
    sizes: Array = np.full(10, np.nan)
    share: Array = np.zeros((10, 6))
    drowned, seen = np.zeros(6, dtype=bool), np.ones(10, dtype=bool)
    if reference is not None:
        sizes = natural_sizes(reference)
        sizes[MU] = 1 / reference.mu
        share, drowned = excitation(samples, cycles, reference, vehicle)
        seen = observable(samples.capability, reference, vehicle)
    return History(
        phase=phase,
        cycles=cycles,
        time_s=samples.end_s[cycles][-len(told.values) :].copy(),
        values=told.values,
        sigmas=told.sigmas,
        covariance=full[0],
        innovation=told.innovation,
        innovation_sigma=told.innovation_sigma,
        normalised=told.normalised,
        natural_sizes=sizes,
        information_share=share,
        drowned=drowned,
        observable=seen,
        bare=(bare[0][0], bare[1][0]),
        reference=reference,
        belied=against,
        notices=notices,
    )
