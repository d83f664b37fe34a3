"""Off-line fits of a whole phase, relinearised about their own estimate until they converge. Their rows are not causal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.base.levels import BLOCK, ITERATIONS, LONG, PARTS
from massprop_cli.estimate.history import History, Stages
from massprop_cli.estimate.historyrecorder import HistoryRecorder
from massprop_cli.estimate.nuisance import Whitened
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.residual import Residual, coefficients, residual
from massprop_cli.estimate.rows import AssumptionResponse
from massprop_cli.estimate.triangle import Run
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import Tangent
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

CONVERGED = 0.003
"""Largest second-order error of the linearisation, in sigmas, of a converged off-line fit."""


class OfflineFit(NamedTuple):
    """An off-line fit; its rows are not causal."""

    history: History
    converged: bool
    """Whether another pass would not change the estimate."""
    tied: bool = False
    """Whether each axis' response is known without the gyroscopic coupling."""
    values: Array = np.zeros(0)
    """(r,) estimates of the ``uncertain`` values, in sigmas from the stated ones."""


def fit(
    samples: Source,
    cycles: slice,
    phase: Phase,
    reference: Reference,
    vehicle: Resolved,
    consider: Consider = Consider(),  # noqa: B008
    passes: int = ITERATIONS,
    tied: bool = False,
) -> OfflineFit:
    """Fit the whole phase, from ``reference``: Gauss–Newton on the likelihood of all data.

    The fit is relinearised about its own last estimate until it converges, at most ``passes`` times. ``tied``: each axis' response is known
    without the gyroscopic coupling.
    """
    regression = Regression(samples, cycles, vehicle, consider)
    last = _last_pass(regression, reference, passes, tied)
    recorder = HistoryRecorder(samples, cycles, vehicle, every=vehicle.estimator.refine)
    residuals = Residual.empty(cycles.stop - cycles.start)
    phi = coefficients(regression, last.run.estimate)
    stops, passed = np.linspace(cycles.start, cycles.stop, PARTS + 1).astype(int)[1:], list[Run]()
    for before, whitened, after in last.kept or blocks(regression, last.begun):
        about = replace(before, estimate=last.run.estimate, tied=last.run.tied)
        if recorder.every:
            rows = regression.rows(about, whitened, regression.posed(about, whitened))
        else:
            rows = regression.innovations(about, whitened)
        part = slice(before.at - cycles.start, after.at - cycles.start)
        residuals.value[part], residuals.sigma[part] = residual(regression, before, whitened, phi)
        recorder.add(rows.ending(regression.row(last.run)) if after.at == cycles.stop else rows)
        passed += [after] if len(passed) < PARTS and after.at >= stops[len(passed)] else []
    # the stages of a long phase are computed now, so that none of its blocks must be kept
    stages = partial(_stages, regression, last, passed) if last.kept else partial(Stages, *_stages(regression, last, passed))
    history = replace(recorder.history(phase, last.run.estimate), residual=residuals, stages=stages, unexplained=last.run.unexplained)
    return OfflineFit(history, last.converged, last.run.tied, last.run.values)


def _stages(regression: Regression, last: _Pass, passed: Sequence[Run]) -> Stages:
    """Information of the log up to each stage, about the final estimate."""
    runs = _split(regression, last) if last.kept else passed
    each = [regression.linear(replace(run, estimate=last.run.estimate, tied=last.run.tied)) for run in runs]
    return Stages(np.array([run.at for run in runs]), *(np.array(part) for part in zip(*each, strict=True)))


def _split(regression: Regression, last: _Pass) -> list[Run]:
    """Runs up to each stage, from the kept blocks of a short phase."""
    stops, runs = np.linspace(regression.cycles.start, regression.cycles.stop, PARTS + 1).astype(int)[1:], list[Run]()
    for before, whitened, after in last.kept:
        run, rows = before, regression.ordered(whitened).reshape(after.at - before.at, -1, len(before.triangle))
        for stop in stops[(stops > before.at) & (stops <= after.at)]:
            more = rows[run.at - before.at : stop - before.at].reshape(-1, rows.shape[-1])
            run = replace(run, at=int(stop), triangle=triangle_of(np.vstack([run.triangle, more])))
            runs.append(run)
    return runs


def prediction_residuals(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved) -> tuple[Residual, Residual]:
    """Residuals of the motion predicted by ``reference``, without a fit; and those of a body that does not respond to any input.

    The second are the motion itself, except for its unknown initial states: rate, biases, tilt.
    """
    regression = Regression(samples, cycles, vehicle, Consider())
    phi = coefficients(regression, reference)
    predicted, motion = (Residual.empty(cycles.stop - cycles.start) for _ in range(2))
    for before, whitened, after in blocks(regression, regression.begin(reference)):
        part = slice(before.at - cycles.start, after.at - cycles.start)
        for into, by in ((predicted, phi), (motion, np.zeros_like(phi))):
            into.value[part], into.sigma[part] = residual(regression, before, whitened, by)
    return predicted, motion


def estimate_after(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, passes: int) -> Array:
    """(10,) estimate after so many passes from ``reference``."""
    regression = Regression(samples, cycles, vehicle, Consider())
    return np.asarray(quantities(regression.row(_last_pass(regression, reference, passes, tied=False).run), vehicle)[0][0])


class Start(NamedTuple):
    """Reference from which a fit starts."""

    reference: Reference
    tied: bool = False
    """Whether each axis' response is known without the gyroscopic coupling."""


def start_after(samples: Source, cycles: slice, start: Start, vehicle: Resolved, passes: int) -> Start:
    """The estimate after so many passes through ``cycles``, as the start of another fit."""
    run = _last_pass(Regression(samples, cycles, vehicle, Consider()), start.reference, passes, start.tied).run
    return Start(run.estimate, run.tied)


class _Pass(NamedTuple):
    """One pass of an off-line fit."""

    begun: Run
    run: Run
    """After all cycles, with the new estimate."""
    converged: bool
    """Whether another pass would not change the estimate."""
    kept: list[_CycleBlock]
    """All blocks of a short phase; empty for a long one."""


def _last_pass(regression: Regression, reference: Reference, passes: int, tied: bool) -> _Pass:
    cycles = regression.cycles
    short = cycles.stop - cycles.start <= LONG
    for _ in range(passes):
        begun = run = replace(regression.begin(reference), tied=tied)
        kept = []
        for block in blocks(regression, begun):
            run = block.after
            kept += [block] if short else []
        run = regression.solved(run)
        converged = run.tied == tied and regression.converged(run, CONVERGED)
        if converged:
            break
        reference, tied = run.estimate, run.tied
    return _Pass(begun, run, converged, kept)


class _CycleBlock(NamedTuple):
    """Cycles processed at once, and the runs before and after them."""

    before: Run
    whitened: Whitened
    after: Run


def blocks(regression: Regression, run: Run) -> Iterator[_CycleBlock]:
    """Process all cycles after ``run``, block by block."""
    while run.at < regression.cycles.stop:
        before, (run, whitened) = run, regression.process(run, min(run.at + BLOCK, regression.cycles.stop))
        yield _CycleBlock(before, whitened, run)


def assumption_response(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, consider: Consider) -> AssumptionResponse:
    """Response of the estimate to each assumption, along the tangent at ``reference``."""
    plant = plant_of(vehicle)
    regression = Regression(samples, cycles, vehicle, consider, Tangent(plant, plant.theta(reference)))
    run = replace(regression.begin(reference), tied=True)
    for block in blocks(regression, run):
        run = block.after
    return regression.assumption_response(run)
