"""Recursive estimator of a flight through its phases, and of simulated vehicles in flight."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.errors import InputError
from massprop_cli.estimate.kernelflight import VERDICTS, WAITS, Flight, Reported
from massprop_cli.export import resolve
from massprop_cli.export.resolve import FlightConstants, PhaseConstants
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import kernel
from massprop_cli.live.cycles import RecordedCycle
from massprop_cli.live.numpyestimator import NumPyEstimator
from massprop_cli.model.kernelargs import StatusError

CONVERGED = VERDICTS.index("converged")
UNUSED = 10
"""Index, in the kernel inputs of a cycle, of the flag for a cycle outside all phases."""


class KernelEstimator:
    """Recursive estimator with the compiled kernel."""

    def __init__(self, constants: FlightConstants) -> None:
        self.flight = Flight(constants.commands, constants.phases[0].vehicle, constants.phases[0].rule)

    def begin(self, phase: PhaseConstants) -> None:
        """Restart the estimate with the next cycle; delayed commands and the attitude continue."""
        self.flight.phase(phase.vehicle, phase.rule)

    def step(self, numbers: Array) -> Reported | None:
        """Process the next cycle (:func:`massprop_cli.estimate.kernelflight.cycles_of`) and return the report that it completes."""
        return _report(self.flight.step(numbers[None]))

    def last(self) -> Reported | None:
        """At the end of the flight, return the report of the cycle that waits for the commands of the next one."""
        return _report(self.flight.last())


def _report(reported: Reported) -> Reported | None:
    """The report, None if it is empty."""
    return reported if len(reported.values) else None


class CycleEstimate(NamedTuple):
    """Estimate after one cycle."""

    end_s: float
    """End of the cycle, s."""
    phase: str
    reported: Reported
    about_pivot: bool
    """Whether the values are the nine about a fixed pivot."""
    command_lost: bool = False
    """Whether a command of this phase is unknown, so that the values are not valid."""


class FlightEstimator:
    """Recursive estimator of one flight, with a new estimate for each phase."""

    def __init__(self, constants: FlightConstants) -> None:
        vehicle = constants.vehicle
        self.phase_constants, self.phases = constants.phases, vehicle.phases
        self.current = -1 if vehicle.phases else 0
        """Index of the current phase; -1 before the first."""
        self.late = bool(constants.commands[WAITS])
        """Whether the estimate of a cycle needs the next cycle."""
        compiled = kernel().library is not None
        self.flight: KernelEstimator | NumPyEstimator = KernelEstimator(constants) if compiled else NumPyEstimator(constants)
        self.about_pivot = vehicle.on_pedestal
        self._waiting: tuple[float, int] | None = None
        """End [s] and phase of the last cycle."""
        self._command_lost = False

    def add(self, cycle: RecordedCycle) -> list[CycleEstimate]:
        """Process a cycle and return the estimate that it completes, if any."""
        phase = self._phase(cycle.end_s)
        cycle.numbers[UNUSED] = phase is None
        begins, self.current = phase not in (None, self.current), self.current if phase is None else phase
        self._command_lost = cycle.command_lost or (self._command_lost and not begins)
        if begins and not self.late:
            self._begin()
        completed = self._waiting if self.late else (cycle.end_s, self.current)
        self._waiting = cycle.end_s, self.current
        reported = self.flight.step(cycle.numbers)
        if begins and self.late:
            self._begin()  # the step above completed the last cycle of the previous phase
        return self._estimates(completed, reported)

    def last(self) -> list[CycleEstimate]:
        """At the end of the flight, return the estimate of the last cycle, if it waits for a next one."""
        return self._estimates(self._waiting, self.flight.last())

    def _begin(self) -> None:
        self.flight.begin(self.phase_constants[self.current])

    def _phase(self, end_s: float) -> int | None:
        """Index of the phase that contains a cycle with this end; None outside all phases."""
        if not self.phases:
            return 0
        inside = (i for i, phase in enumerate(self.phases) if phase.start_s + 1e-9 < end_s <= phase.end_s + 1e-9)
        return next(inside, None)

    def _estimates(self, cycle: tuple[float, int] | None, reported: Reported | None) -> list[CycleEstimate]:
        """The estimate of a cycle (end [s], phase); none outside all phases, or for a cycle with commands from before the first record."""
        if cycle is None or reported is None:
            return []
        return [CycleEstimate(cycle[0], self.phase_constants[cycle[1]].name, reported, self.about_pivot, self._command_lost)]


class OnboardEstimator:
    """Estimator of S simulated vehicles (:class:`massprop_cli.testbed.onboard.Running`)."""

    def __init__(self, vehicle: Vehicle, source: str, members: int) -> None:
        """Raise :class:`InputError`, which begins with ``source``, if the vehicle is not supported or a value is missing."""
        source = f'{source}, control.model = "estimate"'
        if vehicle.imu.measures == "sample" or vehicle.imu.gyro_filter is not None or vehicle.imu.accel_filter is not None:
            raise InputError(f"{source}: the estimator aboard needs unfiltered IMU increments; choose another model")
        if vehicle.on_pedestal or vehicle.spinning:
            raise InputError(f"{source}: the estimator aboard supports only jets or a wrench, and no pedestal; choose another model")
        constants = resolve.stated(VehicleSource(vehicle, source, ""))
        self.source = source
        self.estimators = [FlightEstimator(constants) for _ in range(members)]
        self.before_s = 0.0
        """End of the last cycle, s."""
        self.values, self.verdicts = np.full((members, 10), np.nan), np.zeros((members, 10))

    def step(self, end_s: float, issued: Array, angle_imu_rad: Array, velocity_imu_m_s: Array) -> tuple[Array, BoolArray]:
        """Process the next cycle with its end, issued commands (S, C), and IMU increments (S, 3), IMU axes.

        Return the values (S, 10), and whether each has converged; a vehicle without a new estimate keeps its last values.
        """
        for i, estimator in enumerate(self.estimators):
            numbers = (end_s, end_s - self.before_s, *angle_imu_rad[i], *velocity_imu_m_s[i], *(0.0,) * 3, *issued[i])
            try:
                estimates = estimator.add(RecordedCycle(end_s, np.array(numbers)))
            except StatusError as error:
                raise InputError(
                    f"{self.source}: the estimator aboard cannot use the cycle to {end_s:.6g} s ({error}); check sensors and forces"
                ) from None
            for estimate in estimates:
                self.values[i], self.verdicts[i] = estimate.reported.values[-1], estimate.reported.verdicts[-1]
        self.before_s = end_s
        return self.values, self.verdicts == CONVERGED
