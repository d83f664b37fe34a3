"""What a pass through a phase has told: its history, from the rows of each block of cycles."""

from __future__ import annotations

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array
from massprop_cli.estimate.history import History
from massprop_cli.estimate.known import belied
from massprop_cli.estimate.quantities import alone, quantities
from massprop_cli.estimate.rows import Rows
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.layout import MU
from massprop_cli.model.observability import excitation, observable
from massprop_cli.model.parameters import natural_sizes
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Source


class Told:
    """What every cycle's estimate comes to, block by block; or of an off-line fit the last one's, and every cycle's innovations."""

    def __init__(self, cycles: slice, vehicle: Resolved, every: bool = True) -> None:
        self.cycles, self.vehicle, self.every = cycles, vehicle, every
        count = cycles.stop - cycles.start
        self.normalised = spill.empty(count, 6)
        self.values, self.sigmas = (spill.empty(count if every else 1, 10) for _ in range(2))
        self.innovation, self.innovation_sigma = (spill.empty(len(self.values), 6) for _ in range(2))
        self.count = 0

    def add(self, rows: Rows) -> None:
        """The next cycles."""
        if not len(rows.mean):
            return
        part = slice(self.count, self.count + len(rows.mean))
        self.normalised[part] = rows.normalised
        self.count, self.last = part.stop, rows.last().parameters
        here, own = (part, slice(None)) if self.every else (slice(None), slice(-1, None))
        values, full = quantities(rows.parameters if self.every else self.last, self.vehicle)
        variance = np.einsum("kii->ki", full)
        # where what is known is orders of magnitude more than the log tells, rounding may leave nothing of a variance
        left = variance > 0
        self.values[here], self.sigmas[here] = np.where(left, values, np.nan), np.sqrt(np.where(left, variance, np.nan))
        self.innovation[here], self.innovation_sigma[here] = rows.innovation[own], rows.sigma[own]
        spill.give_back()

    def history(self, samples: Source, phase: Phase, reference: Reference | None) -> History:
        """All of it, with what the log could tell; ``reference`` is the estimate at the end, None where there is none."""
        vehicle, cycles = self.vehicle, self.cycles
        if self.count != cycles.stop - cycles.start:
            raise RuntimeError(f"{self.count} cycles were estimated from, not {cycles.stop - cycles.start}")
        _, full = quantities(self.last, vehicle)
        bare = quantities(self.last, alone(vehicle))
        against, notices = belied(self.last, vehicle, phase.name)
        sizes: Array = np.full(10, np.nan)
        share: Array = np.zeros((10, 6))
        drowned, seen = np.zeros(6, dtype=bool), np.ones(10, dtype=bool)
        if reference is not None:
            sizes = natural_sizes(reference)
            sizes[MU] = 1 / reference.mu
            share, drowned = excitation(samples, cycles, reference, vehicle)
            seen = observable(samples.capability, reference, vehicle)
            seen[MU] |= "mass" in vehicle.known
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
            natural_sizes=sizes,
            information_share=share,
            drowned=drowned,
            observable=seen,
            bare=(bare[0][0], bare[1][0]),
            reference=reference,
            belied=against,
            notices=notices,
        )
