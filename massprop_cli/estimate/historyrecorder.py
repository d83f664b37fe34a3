"""The history of one pass through a phase, recorded block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base import spill
from massprop_cli.estimate.history import History
from massprop_cli.estimate.known import belied
from massprop_cli.estimate.pivot import about_pivot
from massprop_cli.estimate.quantities import alone, quantities
from massprop_cli.estimate.rows import Rows
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.layout import MU
from massprop_cli.model.observability import excitation, observable
from massprop_cli.model.parameters import sizes_of_quantities
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Source


class HistoryRecorder:
    """What every cycle's estimate comes to, block by block; or of an off-line fit the last one's, and every cycle's innovations."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, every: bool = True) -> None:
        self.samples, self.cycles, self.vehicle, self.every = samples, cycles, vehicle, every
        count = cycles.stop - cycles.start
        self.normalised = spill.empty(count, 6)
        self.values, self.sigmas = (spill.empty(count if every else 1, 10) for _ in range(2))
        self.pivot = spill.empty(len(self.values), 18) if vehicle.on_pedestal else None
        self.innovation, self.innovation_sigma = (spill.empty(len(self.values), 6) for _ in range(2))
        self.count = 0

    def add(self, rows: Rows) -> None:
        """The next cycles."""
        if not len(rows.normalised):
            return
        part = slice(self.count, self.count + len(rows.normalised))
        self.normalised[part] = rows.normalised
        unread = self.samples.unread
        if unread.any():
            self.normalised[part, unread] = np.where(np.isfinite(rows.normalised[:, ~unread]).all(1), 0.0, np.nan)[:, None]
        self.count, self.last = part.stop, rows.last().parameters
        here, own = (part, slice(None)) if self.every else (slice(None), slice(-1, None))
        told = rows.parameters if self.every else self.last
        values, full = quantities(told, self.vehicle)
        variance = np.einsum("kii->ki", full)
        # where what is known is orders of magnitude more than the log tells, rounding may leave nothing of a variance
        left = variance > 0
        self.values[here], self.sigmas[here] = np.where(left, values, np.nan), np.sqrt(np.where(left, variance, np.nan))
        if self.pivot is not None:
            about, spread = about_pivot(values, full, np.array(self.vehicle.environment.bearing_position_m), 1 / told.mean[:, MU])
            self.pivot[here] = np.hstack([about, np.sqrt(np.maximum(np.einsum("kii->ki", spread), 0.0))])
        self.innovation[here], self.innovation_sigma[here] = rows.innovation[own], rows.sigma[own]
        spill.give_back()

    def history(self, phase: Phase, reference: Reference | None) -> History:
        """All of it; ``reference`` is the estimate at the end, None where there is none. What could be told is not looked at yet."""
        vehicle, cycles, samples = self.vehicle, self.cycles, self.samples
        if self.count != cycles.stop - cycles.start:
            raise RuntimeError(f"{self.count} cycles were estimated from, not {cycles.stop - cycles.start}")
        _, full = quantities(self.last, vehicle)
        bare = quantities(self.last, alone(vehicle))
        against, notices = belied(self.last, vehicle, phase.name)
        return History(
            phase=phase,
            cycles=cycles,
            time_s=samples.end_s[cycles][-len(self.values) :].copy(),
            values=self.values,
            sigmas=self.sigmas,
            covariance=full[0],
            innovation=self.innovation,
            innovation_sigma=self.innovation_sigma,
            normalised=self.normalised,
            natural_sizes=np.full(10, np.nan) if reference is None else sizes_of_quantities(reference),
            information_share=np.zeros((10, 6)),
            drowned=np.zeros(6, dtype=bool),
            observable=np.ones(10, dtype=bool),
            bare=(bare[0][0], bare[1][0]),
            reference=reference,
            unread=samples.unread,
            pivot=self.pivot,
            belied=against,
            notices=notices,
        )


def informed(passes: Sequence[History], samples: Source, vehicle: Resolved) -> list[History]:
    """Passes through one phase, with what its commands could tell and by which channel, about the last pass that came to a body."""
    about = [history.reference for history in passes if history.reference is not None]
    if not about:
        return list(passes)
    share, drowned = excitation(samples, passes[-1].cycles, about[-1], vehicle)
    seen = observable(samples.capability, about[-1], vehicle, samples.unread)
    seen[MU] |= "mass" in vehicle.known
    unsensed = observable(samples.capability, about[-1], vehicle) & ~seen if samples.unread.any() else np.zeros(10, dtype=bool)
    return [replace(one, information_share=share, drowned=drowned, observable=seen, unsensed=unsensed) for one in passes]
