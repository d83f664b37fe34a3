"""Command delay and thrust lag, and a log's samples under them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import recorded
from massprop_cli.prepare.align import Impulses, align
from massprop_cli.prepare.compensate import Samples, compensate
from massprop_cli.prepare.measured import measured


class Timing(NamedTuple):
    """Delay and first-order lag, control cycles each."""

    delay: float
    lag: float

    def of(self, log: Log, vehicle: Vehicle, made: Impulses | None = None) -> Samples:
        """The log's samples under this timing; ``made`` is what commands do under it, where that is known."""
        log = recorded.undone(log, vehicle)
        return compensate(align(log, vehicle, self.delay, self.lag_s(vehicle), made=made), vehicle, measured=measured(log, vehicle))

    def lag_s(self, vehicle: Vehicle) -> float:
        """The lag in seconds."""
        return self.lag * vehicle.cycle.period_s

    def moved(self, unknown: Sequence[str], steps: Iterable[float]) -> Timing:
        """With some entries changed, none below zero."""
        return self._replace(**{name: max(getattr(self, name) + float(step), 0.0) for name, step in zip(unknown, steps, strict=True)})
