"""The default estimator: a regression on products of the mass properties, run through a phase once, cycle by cycle.

What the log has said stands in a triangle of constant size (:mod:`massprop_cli.regression`). The present estimate enters it only where it
multiplies what is small (:func:`massprop_cli.linearise.lifted`). While it still moves, the last :data:`RING` cycles are taken in anew about
where it has moved to; nothing older is looked at again. So every row depends on its own and earlier cycles only, no starting value is
needed, and the cost of a cycle does not grow with the log.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples
from massprop_cli.history import History
from massprop_cli.linearise import MU, natural_sizes
from massprop_cli.observability import excitation, observable
from massprop_cli.plant import Reference
from massprop_cli.posterior import alone, discrepancies, quantities
from massprop_cli.regression import Regression, Response, Rows
from massprop_cli.sensitivity import Consider
from massprop_cli.start import fallback, first_reference
from massprop_cli.telemetry import Notice
from massprop_cli.vehicle import Phase, Vehicle

BLOCK, LONGEST = 16, 128
"""Cycles taken in at a time: when the estimate has just moved, and at most; in between, half of those since."""
RING, LEARNING = 256, 1024
"""Cycles that are taken in anew when the estimate has moved: once each axis is known, and before."""
AGAIN = 8
"""How often, on the average, a cycle may be taken in anew."""
FIRST = 16
"""Least number of cycles between attempts to find a first reference."""
MISMATCH = 4.0
"""A known quantity further than this many sigmas from the log's own estimate is pointed out."""
SETTLED = 0.003
"""Largest second-order error of what is linear about the reference, in sigmas, of an off-line fit that stands still."""
SETTLINGS = 8
"""Most passes of the off-line fit."""
WHOLE = 512
"""Cycles taken in at a time by what is off-line."""


def replay(
    samples: Samples,
    cycles: slice,
    phase: Phase,
    vehicle: Vehicle,
    consider: Consider = Consider(),  # noqa: B008  a constant: it is frozen
    progress: Callable[[float], None] | None = None,
) -> History:
    """Run the estimator through ``cycles`` (non-empty). Noise levels must be set in ``vehicle`` (:mod:`massprop_cli.noise`).

    What is uncertain in ``consider`` enters every sigma. ``progress`` is told the part done, 0 to 1, after every block.
    """
    regression = Regression(samples, cycles, vehicle, consider)
    run = regression.begin(fallback(vehicle))
    started, due, spare = False, cycles.start + FIRST, LEARNING
    ring, rows = [run], []
    while run.at < cycles.stop:
        if progress is not None:
            progress((run.at - cycles.start) / (cycles.stop - cycles.start))
        end = run.at + (min(max(BLOCK, (run.at - run.moved) // 2), LONGEST) if started else BLOCK)
        before, (run, taken), far = run, regression.take(run, min(end, cycles.stop)), None
        if not started:
            rows.append(Rows.untold(taken))
        else:
            posed = regression.posed(before, taken)
            far = regression.astray(before, posed) if spare >= 0 else None
            if far is not None:
                # the estimate has moved too far to go on about the one before: the block ends here
                spare -= run.at - before.at - far - 1
                end, posed = before.at + far + 1, posed.first(far + 1)
                run, taken = regression.take(before, end)
            rows.append(regression.rows(before, taken, posed))
        if run.at < end:
            break  # a block at the log's end is what it would have been in a longer log
        ring = [*(one for one in ring if one.at >= run.at - (RING if run.bound else LEARNING)), run]
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
        if started:
            rows[-1] = rows[-1].ending(*regression.row(run))
    return _history(samples, cycles, phase, vehicle, Rows.joined(rows), run.estimate if started else None)


class Settled(NamedTuple):
    """An off-line fit; its rows are not causal."""

    history: History
    stands: bool
    """Whether another pass would change nothing."""


def settle(
    samples: Samples,
    cycles: slice,
    phase: Phase,
    reference: Reference,
    vehicle: Vehicle,
    consider: Consider = Consider(),  # noqa: B008
    passes: int = SETTLINGS,
) -> Settled:
    """The off-line fit: the whole phase at hand, from ``reference`` on.

    Repeated about its own last estimate until that stands still, or so many ``passes``: Gauss–Newton on the likelihood of all data.
    """
    regression = Regression(samples, cycles, vehicle, consider)
    bound = False
    for _ in range(passes):
        run, taken = replace(regression.begin(reference), bound=bound), []
        while run.at < cycles.stop:
            then, part = regression.take(run, min(run.at + WHOLE, cycles.stop))
            taken.append((run, part))
            run = then
        run = regression.improved(run)
        stands = run.bound == bound and regression.stands(run, SETTLED)
        if stands:
            break
        reference, bound = run.estimate, run.bound
    about = [(replace(before, estimate=run.estimate, bound=run.bound), part) for before, part in taken]
    rows = Rows.joined([regression.rows(before, part, regression.posed(before, part)) for before, part in about])
    return Settled(_history(samples, cycles, phase, vehicle, rows, run.estimate), stands)


def respond(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle, consider: Consider) -> Response:
    """What each assumption does, about ``reference``."""
    regression = Regression(samples, cycles, vehicle, consider)
    run = replace(regression.begin(reference), bound=True)
    while run.at < cycles.stop:
        run, _ = regression.take(run, min(run.at + WHOLE, cycles.stop))
    return regression.response(run)


def _history(samples: Samples, cycles: slice, phase: Phase, vehicle: Vehicle, rows: Rows, reference: Reference | None) -> History:
    values, full = quantities(rows.mean, rows.covariance, vehicle)
    bare = quantities(rows.mean[-1:], rows.covariance[-1:], alone(vehicle))
    apart = {name: z for name, z in discrepancies(rows.mean[-1], rows.covariance[-1], vehicle).items() if abs(z) > MISMATCH}
    sizes: Array = np.full(10, np.nan)
    share: Array = np.zeros((10, 6))
    drowned, seen = np.zeros(6, dtype=bool), np.ones(10, dtype=bool)
    if reference is not None:
        sizes = natural_sizes(reference)
        sizes[MU] = 1 / reference.mu
        share, drowned = excitation(samples, cycles, reference, vehicle)
        seen = observable(samples.executed.capability, reference, vehicle)
    return History(
        phase=phase,
        cycles=cycles,
        time_s=samples.executed.end_s[cycles],
        values=values,
        sigmas=np.sqrt(np.einsum("kii->ki", full)),
        covariance=full[-1],
        innovation=rows.innovation,
        innovation_sigma=rows.sigma,
        normalised=rows.normalised,
        natural_sizes=sizes,
        information_share=share,
        drowned=drowned,
        observable=seen,
        bare=(bare[0][0], bare[1][0]),
        reference=reference,
        belied=tuple(apart),
        notices=tuple(
            Notice(
                "known-mismatch",
                f"phase {phase.name}: known.{name} = {vehicle.known[name].value:g} lies {abs(z):.3g} sigmas from what the log alone says; "
                "check it, the thrust, and thrust.scale_sigma",
            )
            for name, z in apart.items()
        ),
    )
