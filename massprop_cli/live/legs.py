"""One flight through its phases, cycle by cycle."""

from __future__ import annotations

from typing import NamedTuple

from massprop_cli.estimate.flown import Flight, Reported
from massprop_cli.export.resolve import Resolved
from massprop_cli.live.cycles import Cycle

UNUSED = 14
"""Where a cycle's numbers say that it is of no phase."""


class Completed(NamedTuple):
    """A cycle that is estimated."""

    end_s: float
    phase: str
    found: Reported


class Legs:
    """The estimator of one flight."""

    def __init__(self, resolved: Resolved) -> None:
        vehicle = resolved.vehicle
        self.legs, self.phases, self.leg = resolved.legs, vehicle.phases, -1 if vehicle.phases else 0
        self.late = resolved.commands[4] < vehicle.cycle.period_s
        """Whether a cycle's estimate comes with the next cycle."""
        self.flight = Flight(resolved.commands, resolved.legs[0].vehicle, resolved.legs[0].rule)
        self._waiting: tuple[float, int] | None = None

    def add(self, cycle: Cycle) -> list[Completed]:
        """The cycle that is estimated by now, where there is one."""
        leg = self._leg(cycle.end_s)
        cycle.numbers[UNUSED] = leg is None
        begins, self.leg = leg not in (None, self.leg), self.leg if leg is None else leg
        if begins and not self.late:
            self._begin()
        completed = self._waiting if self.late else (cycle.end_s, self.leg)
        self._waiting = cycle.end_s, self.leg
        found = self.flight.step(cycle.numbers[None])
        if begins and self.late:
            self._begin()  # the call has completed the last cycle of the phase before
        return self._completed(completed, found)

    def last(self) -> list[Completed]:
        """The cycle that waited for the next."""
        return self._completed(self._waiting, self.flight.last())

    def _begin(self) -> None:
        self.flight.phase(self.legs[self.leg].vehicle, self.legs[self.leg].rule)

    def _leg(self, end_s: float) -> int | None:
        if not self.phases:
            return 0
        inside = (i for i, phase in enumerate(self.phases) if phase.start_s + 1e-9 < end_s <= phase.end_s + 1e-9)
        return next(inside, None)

    def _completed(self, at: tuple[float, int] | None, found: Reported) -> list[Completed]:
        # none of a cycle that is of no phase, or whose commands were issued before the first one came
        return [] if at is None or not len(found.values) else [Completed(at[0], self.legs[at[1]].name, found)]
