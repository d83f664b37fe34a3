"""Standard input to estimates, cycle by cycle, and to a recording that is estimated in the end."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator
from itertools import chain

from massprop_cli import QUANTITIES
from massprop_cli.base.errors import InputError
from massprop_cli.estimate import flown
from massprop_cli.estimate.flown import Flight, Reported
from massprop_cli.export import resolve
from massprop_cli.export.resolve import Constants
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import kernel
from massprop_cli.live.cycles import Cycle, Gatherer
from massprop_cli.live.records import Reader, RecordError
from massprop_cli.model.handed import StatusError

UNUSED = 14
"""Where a cycle's numbers say that it is of no phase."""


class Live:
    """One flight through its phases."""

    def __init__(self, resolved: Constants) -> None:
        vehicle = resolved.vehicle
        self.legs, self.phases, self.leg = resolved.legs, vehicle.phases, -1 if vehicle.phases else 0
        self.late = resolved.commands[4] < vehicle.cycle.period_s
        """Whether a cycle's estimate comes with the next cycle."""
        self.flight = Flight(resolved.commands, resolved.legs[0].vehicle, resolved.legs[0].rule)
        self._waiting: tuple[float, int] | None = None

    def add(self, cycle: Cycle) -> list[str]:
        """Lines of JSON: of the cycle that is estimated by now, where there is one."""
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
        return self._lines(completed, found)

    def last(self) -> list[str]:
        """Of the cycle that waited for the next."""
        return self._lines(self._waiting, self.flight.last())

    def _begin(self) -> None:
        self.flight.phase(self.legs[self.leg].vehicle, self.legs[self.leg].rule)

    def _leg(self, end_s: float) -> int | None:
        if not self.phases:
            return 0
        inside = (i for i, phase in enumerate(self.phases) if phase.start_s + 1e-9 < end_s <= phase.end_s + 1e-9)
        return next(inside, None)

    def _lines(self, completed: tuple[float, int] | None, found: Reported) -> list[str]:
        # none of a cycle that is of no phase, or whose commands were issued before the first one came
        return [] if completed is None or not len(found.values) else [self._line(*completed, found)]

    def _line(self, end_s: float, leg: int, found: Reported) -> str:
        estimates = {
            name: {"value": _said(value), "sigma": _said(sigma), "verdict": flown.VERDICTS[int(verdict)]}
            for name, value, sigma, verdict in zip(QUANTITIES, found.values[-1], found.sigmas[-1], found.verdicts[-1], strict=True)
        }
        return json.dumps({"time_s": end_s, "phase": self.legs[leg].name, "estimates": estimates})


def follow(lines: Iterable[str], source: VehicleSource, keep: Callable[[str], object], warn: Callable[[str], None]) -> Iterator[str]:
    """A line of JSON for each cycle as it is estimated; ``keep`` is given what came, as lines of CSV.

    A record that must be left out is told by ``warn``. :class:`InputError` where what comes can't be used, or no more of it.
    """
    if kernel().library is None:
        raise InputError(f"massprop live wants the compiled kernel, and here runs {kernel().name}; install a C compiler and massprop again")
    resolve.stated(source)
    numbered = ((number, line) for number, line in enumerate(lines, 1) if line.strip())
    number, first = next(numbered, (0, ""))
    if not number:
        raise InputError("standard input: nothing came; a log needs at least two control cycles")
    try:
        reader = Reader(source.vehicle, first)
    except RecordError as error:
        raise InputError(f"standard input, line {number}: {error}; begin with the names of all columns, or with a JSON object") from None
    columns = reader.columns
    live = Live(resolve.stated(source, columns.attitude and source.vehicle.on_air_bearing, columns.jets))
    gatherer = Gatherer(columns, source.vehicle.cycle.period_s)
    keep(reader.header)
    for at, line in chain([(number, first)] if reader.is_json else [], numbered):
        yield from _one(at, line, reader, gatherer, live, keep, warn)
    yield from live.last()


def _one(
    number: int,
    line: str,
    reader: Reader,
    gatherer: Gatherer,
    live: Live,
    keep: Callable[[str], object],
    warn: Callable[[str], None],
) -> Iterator[str]:
    try:
        found = reader.read(line)
        cycles = gatherer.add(found)
    except RecordError as error:
        warn(f"standard input, line {number}: left out: {error}")
        return
    keep(found.row)
    for cycle in cycles:
        try:
            yield from live.add(cycle)
        except StatusError as error:
            raise InputError(f"standard input, line {number}: the cycle that ends with it can't be used ({error})") from None


def _said(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
