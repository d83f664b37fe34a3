"""The vehicle with known noise levels, as the estimators use it.

A vehicle file may leave noise levels open, or state them as zero. :mod:`massprop_cli.estimate.noiselevels` sets them once. A function that
needs them takes a :class:`Resolved`, any other a :class:`massprop_cli.inputs.vehicle.Vehicle`. Delay and lag, which may be open too, are a
:class:`massprop_cli.prepare.timing.Timing`.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.equipment import Imu
from massprop_cli.inputs.section import Positive
from massprop_cli.inputs.vehicle import Vehicle


class Levelled(Imu):
    """An IMU with known noise levels."""

    gyro_noise_rad_s: Positive
    accel_noise_m_s2: Positive
    estimated: tuple[str, ...] = Field((), exclude=True)
    """Keys of the levels that the log gave, in the units of its columns."""


class Resolved(Vehicle):
    """A vehicle whose IMU has known noise levels."""

    imu: Levelled

    @classmethod
    def of(cls, vehicle: Vehicle, gyro_rad_s: float, accel_m_s2: float) -> Resolved:
        """The vehicle with these noise levels, one sigma of a cycle's mean rate and specific force."""
        levels: dict[str, object] = {"gyro_noise_rad_s": gyro_rad_s, "accel_noise_m_s2": accel_m_s2}
        levels["estimated"] = tuple(key for key in levels if not getattr(vehicle.imu, key))
        imu = Levelled.model_construct(vehicle.imu.model_fields_set | set(levels), **{**dict(vehicle.imu), **levels})
        return cls.model_construct(vehicle.model_fields_set | {"imu"}, **{**dict(vehicle), "imu": imu})

    @classmethod
    def stated(cls, vehicle: Vehicle) -> Resolved | None:
        """The vehicle with the noise levels of its file; None if the file leaves one open."""
        gyro, accel = vehicle.imu.gyro_noise_rad_s, vehicle.imu.accel_noise_m_s2
        return cls.of(vehicle, gyro, accel) if gyro and accel else None

    @property
    def noise(self) -> Array:
        """(6,) one sigma of a cycle's mean rate, rad/s, and mean specific force, m/s², along each body axis."""
        scale = np.array(self.estimator.accel_noise_scale)
        return np.concatenate([np.full(3, self.imu.gyro_noise_rad_s), scale * self.imu.accel_noise_m_s2])
