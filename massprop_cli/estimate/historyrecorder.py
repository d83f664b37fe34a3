"""Recording of a phase's history, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base import spill
from massprop_cli.estimate.history import History
from massprop_cli.estimate.known import contradicted_values
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
    """Records the estimate after each cycle, or with ``every`` false only the last one; and each cycle's innovations."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, every: bool = True) -> None:
        self.samples, self.cycles, self.vehicle, self.every = samples, cycles, vehicle, every
        count = cycles.stop - cycles.start
        self.normalised = spill.empty(count, 6)
        self.values, self.sigmas = (spill.empty(count if every else 1, 10) for _ in range(2))
        self.pivot = spill.empty(len(self.values), 18) if vehicle.on_pedestal else None
        self.innovation, self.innovation_sigma = (spill.empty(len(self.values), 6) for _ in range(2))
        self.count = 0

    def add(self, rows: Rows) -> None:
        """Record the next cycles."""
        if not len(rows.normalised):
            return
        part = slice(self.count, self.count + len(rows.normalised))
        self.normalised[part] = rows.normalised
        unread = self.samples.unread
        if unread.any():
            self.normalised[part, unread] = np.where(np.isfinite(rows.normalised[:, ~unread]).all(1), 0.0, np.nan)[:, None]
        self.count, self.last = part.stop, rows.last().parameters
        target, source = (part, slice(None)) if self.every else (slice(None), slice(-1, None))
        parameters = rows.parameters if self.every else self.last
        values, full = quantities(parameters, self.vehicle)
        variance = np.einsum("kii->ki", full)
        # if known values are orders of magnitude more precise than the log, rounding may make a variance zero or negative
        positive = variance > 0
        self.values[target], self.sigmas[target] = np.where(positive, values, np.nan), np.sqrt(np.where(positive, variance, np.nan))
        if self.pivot is not None:
            position = np.array(self.vehicle.environment.bearing_position_m)
            about, spread = about_pivot(values, full, position, 1 / parameters.mean[:, MU])
            self.pivot[target] = np.hstack([about, np.sqrt(np.maximum(np.einsum("kii->ki", spread), 0.0))])
        self.innovation[target], self.innovation_sigma[target] = rows.innovation[source], rows.sigma[source]
        spill.give_back()

    def history(self, phase: Phase, reference: Reference | None) -> History:
        """The history; ``reference`` is the estimate at the end, None if there is none. Observability is not evaluated yet."""
        vehicle, cycles, samples = self.vehicle, self.cycles, self.samples
        if self.count != cycles.stop - cycles.start:
            raise RuntimeError(f"{self.count} cycles were estimated from, not {cycles.stop - cycles.start}")
        _, full = quantities(self.last, vehicle)
        bare = quantities(self.last, alone(vehicle))
        contradicted, notices = contradicted_values(self.last, vehicle, phase.name)
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
            contradicted=contradicted,
            notices=notices,
        )


def with_observability(passes: Sequence[History], samples: Source, vehicle: Resolved) -> list[History]:
    """Passes through one phase with observability and excitation, evaluated about the last pass that has an estimate."""
    about = [history.reference for history in passes if history.reference is not None]
    if not about:
        return list(passes)
    share, drowned = excitation(samples, passes[-1].cycles, about[-1], vehicle)
    sensed = observable(samples.capability, about[-1], vehicle, samples.unread)
    sensed[MU] |= "mass" in vehicle.known
    unsensed = observable(samples.capability, about[-1], vehicle) & ~sensed if samples.unread.any() else np.zeros(10, dtype=bool)
    return [replace(one, information_share=share, drowned=drowned, observable=sensed, unsensed=unsensed) for one in passes]
