"""Positions of all states: ten mass properties, cycle-mean rate, and the nuisance states that a vehicle file asks for.

In this order: ixx … izz, cg_x … cg_z, mu = 1/m; the cycle-mean rate (3); then gyro bias (3), accelerometer bias (3), angular acceleration
by a slowly varying torque (3), damping of the turn about each axis (3); on a bearing the error of the carried attitude at the start of the
cycle (3, rotation vector in body axes: true attitude = carried attitude turned by it); on a table, what the accelerometer feels of its
slope in the middle of the cycle (2); of a vehicle with momentum devices, what is uncertain of the scale of all thrust and of each device;
the turn of a logged attitude's body axes from the vehicle's (3).
"""

from __future__ import annotations

from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.momentum import scale_sigmas
from massprop_cli.model.plant import plant_of
from massprop_cli.prepare.compensate import Mounted

PARAMETERS = slice(0, 10)
INERTIA, CG, MU = slice(0, 6), slice(6, 9), 9
RATE = slice(10, 13)


@dataclass(frozen=True)
class Layout:
    """Where the optional nuisance states stand; an absent one is an empty slice."""

    gyro_bias: slice
    accel_bias: slice
    torque: slice
    damping: slice
    tilt: slice
    scale: slice
    """Relative error of the thrust's scale and unknowns of momentum devices, of a vehicle that has any."""
    misalignment: slice
    size: int

    @staticmethod
    def of(samples: Mounted, vehicle: Vehicle) -> Layout:
        """The states that this vehicle and log ask for."""
        sizes = (
            3 * (vehicle.imu.gyro_bias_sigma_rad_s > 0),
            3 * (vehicle.imu.accel_bias_sigma_m_s2 > 0),
            3 * (vehicle.environment.disturbance_walk_n_m > 0),
            3 * (vehicle.environment.damping_sigma_n_m_s > 0),
            plant_of(vehicle).tilts,
            len(scale_sigmas(vehicle)),
            3 * (samples.attitude_logged and vehicle.imu.attitude_misalignment_sigma_rad > 0),
        )
        slices, end = [], RATE.stop
        for size in sizes:
            slices.append(slice(end, end + size))
            end += size
        gyro_bias, accel_bias, torque, damping, tilt, scale, misalignment = slices
        return Layout(gyro_bias, accel_bias, torque, damping, tilt, scale, misalignment, end)

    @property
    def states(self) -> int:
        """How many there are beside the parameters: rate and nuisances."""
        return self.size - RATE.start

    @staticmethod
    def has(block: slice) -> bool:
        """Whether there are such states."""
        return bool(block.stop > block.start)

    @staticmethod
    def own(block: slice) -> slice:
        """Where a block stands among these."""
        return slice(block.start - RATE.start, block.stop - RATE.start)
