"""Layout of the state vector: ten mass properties, cycle-mean rate, and the nuisance states that vehicle file and log call for.

Order of the states:

* ixx … izz [kg m²], cg_x … cg_z [m], mu = 1/m [1/kg];
* cycle-mean rate (3);
* gyro bias (3), accelerometer bias (3);
* angular acceleration by a slowly varying torque (3), damping of the rotation about each axis (3);
* on a bearing, error of the propagated attitude at the start of the cycle (3): true attitude = propagated attitude turned by this rotation
  vector, body axes;
* on a table, specific force by its slope in the middle of the cycle (2);
* with momentum devices, relative error of the thrust scale and the unknowns of each device;
* misalignment of the logged attitude's body axes (3).
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
    """Slices of the optional nuisance states in the state vector; an absent block is an empty slice."""

    gyro_bias: slice
    accel_bias: slice
    torque: slice
    damping: slice
    tilt: slice
    scale: slice
    """Thrust scale and unknowns of the momentum devices; empty without momentum devices."""
    misalignment: slice
    size: int

    @staticmethod
    def of(samples: Mounted, vehicle: Vehicle) -> Layout:
        """Layout for a vehicle and its log."""
        sizes = (
            3 * (vehicle.imu.gyro_bias_sigma_rad_s > 0),
            3 * (vehicle.imu.accel_bias_sigma_m_s2 > 0),
            3 * (vehicle.environment.disturbance_walk_n_m > 0),
            3 * (vehicle.environment.damping_sigma_n_m_s > 0),
            plant_of(vehicle).tilt_count,
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
        """Number of states without the mass properties: rate and nuisance states."""
        return self.size - RATE.start

    @staticmethod
    def has(block: slice) -> bool:
        """Whether the block is not empty."""
        return bool(block.stop > block.start)

    @staticmethod
    def in_states(block: slice) -> slice:
        """Slice of a block in the state vector without the mass properties."""
        return slice(block.start - RATE.start, block.stop - RATE.start)
