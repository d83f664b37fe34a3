"""The default estimator run through a phase, by the compiled kernel or by NumPy."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from massprop_cli.estimate import compiled, kernelflight
from massprop_cli.estimate.causal import Causal
from massprop_cli.estimate.history import History
from massprop_cli.estimate.historyrecorder import HistoryRecorder
from massprop_cli.estimate.rows import Rows
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.kernelargs import StatusError
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source
from massprop_cli.prepare.stream import Stream


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
    if compiled.holds(samples, vehicle, consider):
        # what is too large to be squared is no cycle to the kernel; here it becomes nothing that can be said
        with suppress(StatusError):
            return _compiled(samples, cycles, phase, vehicle, progress)
    causal, told = Causal(samples, cycles, vehicle, consider), HistoryRecorder(samples, cycles, vehicle)
    while causal.run.at < cycles.stop:
        if progress is not None:
            progress((causal.run.at - cycles.start) / (cycles.stop - cycles.start))
        begun = causal.run.at
        try:
            told.add(causal.block())
        except np.linalg.LinAlgError:
            # an estimate so far astray that its numbers end: nothing more can be said
            told.add(Rows.untold(cycles.stop - cycles.start - told.count))
            return told.history(phase, None)
        if causal.run.at == begun:
            break  # a block at the log's end is what it would have been in a longer log
    return told.history(phase, causal.run.estimate if causal.started else None)


def _compiled(samples: Source, cycles: slice, phase: Phase, vehicle: Resolved, progress: Callable[[float], None] | None) -> History:
    """The same, by the compiled kernel."""
    told = HistoryRecorder(samples, cycles, vehicle)
    if isinstance(samples, Stream) and kernelflight.holds(samples):
        parts, reference = kernelflight.replayed(samples, cycles, vehicle, progress)
    else:
        aligned = compiled.Pass(samples, cycles, vehicle)
        parts, reference = aligned.rows(progress), aligned.reference
    for rows in parts:
        told.add(rows)
    return told.history(phase, reference())
