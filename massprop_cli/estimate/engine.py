"""Causal pass of the default estimator through a phase, by the compiled kernel or by NumPy."""

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
    """Run the causal estimator through ``cycles`` (non-empty).

    Every sigma includes the uncertainty in ``consider``. ``progress`` is called with the completed part, 0 to 1. If the compiled kernel
    supports the log and the vehicle, it runs instead of the NumPy code; both take the same decisions.
    """
    if compiled.supports(samples, vehicle, consider):
        # the kernel refuses cycles whose squares overflow; NumPy gives NaN from there on
        with suppress(StatusError):
            return _compiled(samples, cycles, phase, vehicle, progress)
    causal, recorder = Causal(samples, cycles, vehicle, consider), HistoryRecorder(samples, cycles, vehicle)
    while causal.run.at < cycles.stop:
        if progress is not None:
            progress((causal.run.at - cycles.start) / (cycles.stop - cycles.start))
        begun = causal.run.at
        try:
            recorder.add(causal.block())
        except np.linalg.LinAlgError:
            # a divergent estimate overflowed: no estimate from here on
            recorder.add(Rows.empty(cycles.stop - cycles.start - recorder.count))
            return recorder.history(phase, None)
        if causal.run.at == begun:
            break  # the log ends within a block, whose rows are those of a longer log
    return recorder.history(phase, causal.run.estimate if causal.started else None)


def _compiled(samples: Source, cycles: slice, phase: Phase, vehicle: Resolved, progress: Callable[[float], None] | None) -> History:
    """The same pass, by the compiled kernel."""
    recorder = HistoryRecorder(samples, cycles, vehicle)
    if isinstance(samples, Stream) and kernelflight.supports(samples):
        parts, reference = kernelflight.replayed(samples, cycles, vehicle, progress)
    else:
        aligned = compiled.Pass(samples, cycles, vehicle)
        parts, reference = aligned.rows(progress), aligned.reference
    for rows in parts:
        recorder.add(rows)
    return recorder.history(phase, reference())
