"""Off-line fits of a whole phase, relinearised about their own estimate until it converges. Their rows are not causal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.estimate.history import History, Stages
from massprop_cli.estimate.historyrecorder import HistoryRecorder
from massprop_cli.estimate.nuisance import Taken
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.residual import Residual, coefficients, residual
from massprop_cli.estimate.rows import Response
from massprop_cli.estimate.triangle import Run
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import Tangent
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

SETTLED = 0.003
"""Largest second-order error of what is linear about the reference, in sigmas, of an off-line fit that stands still."""
SETTLINGS = 8
"""Most passes of the off-line fit."""
WHOLE = 1024
"""Cycles taken in at a time by what is off-line."""
HELD = 4096
"""Cycles of which an off-line fit keeps what it took in until it stands; of more it takes them in once again."""

STAGES = 32
"""Moments, evenly over a phase, up to which its log is looked at by itself."""


class Settled(NamedTuple):
    """An off-line fit; its rows are not causal."""

    history: History
    stands: bool
    """Whether another pass would change nothing."""
    bound: bool = False
    """Whether each axis turned out to be told without the gyroscopic coupling."""


def settle(
    samples: Source,
    cycles: slice,
    phase: Phase,
    reference: Reference,
    vehicle: Resolved,
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
    told, left = HistoryRecorder(samples, cycles, vehicle, every=vehicle.estimator.refine), Residual.empty(cycles.stop - cycles.start)
    phi = coefficients(regression, last.run.estimate)
    stops, passed = np.linspace(cycles.start, cycles.stop, STAGES + 1).astype(int)[1:], list[Run]()
    for before, taken, after in last.held or blocks(regression, last.begun):
        about = replace(before, estimate=last.run.estimate, bound=last.run.bound)
        rows = regression.rows(about, taken, regression.posed(about, taken)) if told.every else regression.innovations(about, taken)
        part = slice(before.at - cycles.start, after.at - cycles.start)
        left.value[part], left.sigma[part] = residual(regression, before, taken, phi)
        told.add(rows.ending(regression.row(last.run)) if after.at == cycles.stop else rows)
        passed += [after] if len(passed) < STAGES and after.at >= stops[len(passed)] else []
    # of a long phase they are had at once, and nothing of it is held for them
    stages = partial(_stages, regression, last, passed) if last.held else partial(Stages, *_stages(regression, last, passed))
    history = replace(told.history(phase, last.run.estimate), residual=left, stages=stages, unexplained=last.run.unexplained)
    return Settled(history, last.stands, last.run.bound)


def _stages(regression: Regression, last: _Pass, passed: Sequence[Run]) -> Stages:
    """What the log says up to a few moments, about the same estimate."""
    runs = _split(regression, last) if last.held else passed
    each = [regression.linear(replace(run, estimate=last.run.estimate, bound=last.run.bound)) for run in runs]
    return Stages(np.array([run.at for run in runs]), *(np.array(part) for part in zip(*each, strict=True)))


def _split(regression: Regression, last: _Pass) -> list[Run]:
    """Runs up to the moments, of a short phase that was taken in by larger blocks."""
    stops, runs = np.linspace(regression.cycles.start, regression.cycles.stop, STAGES + 1).astype(int)[1:], list[Run]()
    for before, taken, after in last.held:
        run, rows = before, regression.ordered(taken).reshape(after.at - before.at, -1, len(before.triangle))
        for stop in stops[(stops > before.at) & (stops <= after.at)]:
            more = rows[run.at - before.at : stop - before.at].reshape(-1, rows.shape[-1])
            run = replace(run, at=int(stop), triangle=triangle_of(np.vstack([run.triangle, more])))
            runs.append(run)
    return runs


def predicted(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved) -> tuple[Residual, Residual]:
    """What ``reference`` leaves of the motion, in one pass about it that fits no body; and what a body that answers to nothing leaves.

    The second is the motion itself, but for its unknown beginnings: first rate, biases, tilt.
    """
    regression = Regression(samples, cycles, vehicle, Consider())
    phi = coefficients(regression, reference)
    left, motion = (Residual.empty(cycles.stop - cycles.start) for _ in range(2))
    for before, taken, after in blocks(regression, regression.begin(reference)):
        part = slice(before.at - cycles.start, after.at - cycles.start)
        for into, by in ((left, phi), (motion, np.zeros_like(phi))):
            into.value[part], into.sigma[part] = residual(regression, before, taken, by)
    return left, motion


def value(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, passes: int) -> Array:
    """(10,) what so many passes from ``reference`` on give, and no more of it."""
    regression = Regression(samples, cycles, vehicle, Consider())
    return np.asarray(quantities(regression.row(_last_pass(regression, reference, passes, bound=False).run), vehicle)[0][0])


class Led(NamedTuple):
    """What a fit may begin about."""

    reference: Reference
    bound: bool = False
    """Whether each axis is known to be told without the gyroscopic coupling."""


def led(samples: Source, cycles: slice, start: Led, vehicle: Resolved, passes: int) -> Led:
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


def respond(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider) -> Response:
    """What each assumption does, about ``reference``: that is all along the tangent there."""
    plant = plant_of(vehicle)
    regression = Regression(samples, cycles, vehicle, consider, Tangent(plant, plant.theta(reference)))
    run = replace(regression.begin(reference), bound=True)
    for block in blocks(regression, run):
        run = block.after
    return regression.response(run)
