"""Running estimate of a flight through its phases, cycle by cycle, and of simulated vehicles."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.errors import InputError
from massprop_cli.estimate.kernelflight import VERDICTS, WAITS, Flight, Reported
from massprop_cli.export import resolve
from massprop_cli.export.resolve import Constants, Leg
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import kernel
from massprop_cli.live.cycles import RecordedCycle
from massprop_cli.live.onnumpy import OnNumPy
from massprop_cli.model.kernelargs import StatusError

CONVERGED = VERDICTS.index("converged")
UNUSED = 10
"""Index of the flag of a cycle outside all phases, among its numbers."""


class Compiled:
    """Compiled estimator, cycle by cycle."""

    def __init__(self, resolved: Constants) -> None:
        self.flight = Flight(resolved.commands, resolved.legs[0].vehicle, resolved.legs[0].rule)

    def begin(self, leg: Leg) -> None:
        """Restart the estimate with the next cycle; delayed commands and the attitude continue."""
        self.flight.phase(leg.vehicle, leg.rule)

    def step(self, numbers: Array) -> Reported | None:
        """Process the next cycle (:func:`massprop_cli.estimate.kernelflight.cycles_of`); the estimate of the cycle that it completes."""
        return _any(self.flight.step(numbers[None]))

    def last(self) -> Reported | None:
        """Estimate of the cycle that waits for the commands of the next one, at the end of the flight."""
        return _any(self.flight.last())


def _any(found: Reported) -> Reported | None:
    return found if len(found.values) else None


class Completed(NamedTuple):
    """Estimate of one cycle."""

    end_s: float
    phase: str
    found: Reported
    about_pivot: bool
    """Whether the values are the nine about a fixed pivot."""
    lacking: bool = False
    """Whether a command of this phase is unknown, so that the values are not valid."""


class Legs:
    """Estimator of one flight."""

    def __init__(self, resolved: Constants) -> None:
        vehicle = resolved.vehicle
        self.legs, self.phases, self.leg = resolved.legs, vehicle.phases, -1 if vehicle.phases else 0
        self.late = bool(resolved.commands[WAITS])
        """Whether the estimate of a cycle needs the next cycle."""
        self.flight: Compiled | OnNumPy = Compiled(resolved) if kernel().library is not None else OnNumPy(resolved)
        self.about_pivot = vehicle.on_pedestal
        self._waiting: tuple[float, int] | None = None
        self._lacking = False

    def add(self, cycle: RecordedCycle) -> list[Completed]:
        """Process a cycle; the estimates that are complete."""
        leg = self._leg(cycle.end_s)
        cycle.numbers[UNUSED] = leg is None
        begins, self.leg = leg not in (None, self.leg), self.leg if leg is None else leg
        self._lacking = cycle.lacking or (self._lacking and not begins)
        if begins and not self.late:
            self._begin()
        completed = self._waiting if self.late else (cycle.end_s, self.leg)
        self._waiting = cycle.end_s, self.leg
        found = self.flight.step(cycle.numbers)
        if begins and self.late:
            self._begin()  # the step above completed the last cycle of the previous phase
        return self._completed(completed, found)

    def last(self) -> list[Completed]:
        """Estimate of the last cycle."""
        return self._completed(self._waiting, self.flight.last())

    def _begin(self) -> None:
        self.flight.begin(self.legs[self.leg])

    def _leg(self, end_s: float) -> int | None:
        if not self.phases:
            return 0
        inside = (i for i, phase in enumerate(self.phases) if phase.start_s + 1e-9 < end_s <= phase.end_s + 1e-9)
        return next(inside, None)

    def _completed(self, at: tuple[float, int] | None, found: Reported | None) -> list[Completed]:
        # no estimate of a cycle outside all phases, or whose commands were issued before the first record
        return [] if at is None or found is None else [Completed(at[0], self.legs[at[1]].name, found, self.about_pivot, self._lacking)]


class OnboardEstimator:
    """Estimator of S simulated vehicles (:class:`massprop_cli.testbed.onboard.Running`)."""

    def __init__(self, vehicle: Vehicle, source: str, members: int) -> None:
        """:class:`InputError` if the estimator does not support the vehicle or lacks values; ``source`` begins the message."""
        source = f'{source}, control.model = "estimate"'
        if vehicle.imu.measures == "sample" or vehicle.imu.gyro_filter is not None or vehicle.imu.accel_filter is not None:
            raise InputError(f"{source}: the estimator aboard needs unfiltered IMU increments; choose another model")
        if vehicle.on_pedestal or vehicle.spinning:
            raise InputError(f"{source}: the estimator aboard supports only jets or a wrench, and no pedestal; choose another model")
        resolved = resolve.stated(VehicleSource(vehicle, source, ""))
        self.source = source
        self.each = [Legs(resolved) for _ in range(members)]
        self.before_s = 0.0
        self.values, self.verdicts = np.full((members, 10), np.nan), np.zeros((members, 10))

    def step(self, end_s: float, issued: Array, angle_imu_rad: Array, velocity_imu_m_s: Array) -> tuple[Array, BoolArray]:
        """Process the next cycle: its end, the commands (S, C) issued in it, and the IMU's increments (S, 3), IMU axes.

        Returns (S, 10) values and whether each has converged; a vehicle without an estimate keeps its last values.
        """
        for i, one in enumerate(self.each):
            numbers = (end_s, end_s - self.before_s, *angle_imu_rad[i], *velocity_imu_m_s[i], *(0.0,) * 3, *issued[i])
            try:
                found = one.add(RecordedCycle(end_s, np.array(numbers)))
            except StatusError as error:
                raise InputError(
                    f"{self.source}: the estimator aboard cannot use the cycle to {end_s:.6g} s ({error}); check sensors and forces"
                ) from None
            for completed in found:
                self.values[i], self.verdicts[i] = completed.found.values[-1], completed.found.verdicts[-1]
        self.before_s = end_s
        return self.values, self.verdicts == CONVERGED
