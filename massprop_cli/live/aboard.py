"""The running estimate of vehicles that fly in software: what the testbed's control is handed."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.errors import InputError
from massprop_cli.estimate import flown
from massprop_cli.export import resolve
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.live.cycles import Cycle
from massprop_cli.live.legs import Legs
from massprop_cli.model.handed import StatusError

CONVERGED = flown.VERDICTS.index("converged")


class Aboard:
    """The estimator of S vehicles, each fed with its own cycles as they arrive (:class:`massprop_cli.testbed.onboard.Running`)."""

    def __init__(self, vehicle: Vehicle, source: str, members: int) -> None:
        """``source`` is for messages; :class:`InputError` where the estimator can't hold the vehicle, or it is not stated in full."""
        resolved = resolve.stated(VehicleSource(vehicle, f'{source}, control.model = "estimate"', ""))
        self.source = source
        self.each = [Legs(resolved) for _ in range(members)]
        self.before_s = 0.0
        self.values, self.verdicts = np.full((members, 10), np.nan), np.zeros((members, 10))

    def step(self, end_s: float, issued: Array, angle_imu_rad: Array, velocity_imu_m_s: Array) -> tuple[Array, BoolArray]:
        """The next cycle: its end, commands (S, C) issued in it, increments (S, 3) that the IMU sensed in it, IMU axes.

        (S, 10) values, of a vehicle of which nothing can be said the last that were, and whether each has converged.
        """
        for i, one in enumerate(self.each):
            numbers = (end_s, end_s - self.before_s, *angle_imu_rad[i], *velocity_imu_m_s[i], *(0.0,) * 7, *issued[i])
            try:
                found = one.add(Cycle(end_s, np.array(numbers)))
            except StatusError as error:
                raise InputError(
                    f"{self.source}: the estimator aboard can't use the cycle to {end_s:.6g} s ({error}); check sensors and forces"
                ) from None
            for completed in found:
                self.values[i], self.verdicts[i] = completed.found.values[-1], completed.found.verdicts[-1]
        self.before_s = end_s
        return self.values, self.verdicts == CONVERGED
