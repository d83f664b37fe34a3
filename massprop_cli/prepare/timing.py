"""Command delay and first-order thrust lag, and the samples of a log for given values of both."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import recorded
from massprop_cli.prepare.align import Impulses, align
from massprop_cli.prepare.compensate import Samples, compensate
from massprop_cli.prepare.referenceattitude import reference_attitude


class Timing(NamedTuple):
    """Command delay and first-order thrust lag, in control cycles."""

    delay: float
    lag: float

    def of(self, log: Log, vehicle: Vehicle, made: Impulses | None = None) -> Samples:
        """Samples of the log under this timing; ``made`` holds the executed impulses if they are already computed."""
        log = recorded.corrected_log(log, vehicle)
        return compensate(
            align(log, vehicle, self.delay, self.lag_s(vehicle), made=made), vehicle, measured=reference_attitude(log, vehicle)
        )

    def lag_s(self, vehicle: Vehicle) -> float:
        """The lag, s."""
        return self.lag * vehicle.cycle.period_s

    def moved(self, unknown: Sequence[str], steps: Iterable[float]) -> Timing:
        """The timing with ``steps`` added to the entries named in ``unknown``, limited to zero or more."""
        return self._replace(**{name: max(getattr(self, name) + float(step), 0.0) for name, step in zip(unknown, steps, strict=True)})
