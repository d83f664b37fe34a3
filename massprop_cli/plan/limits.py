"""What a plan must keep to, and what of it a flight takes."""

from dataclasses import fields

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.motion import to_world, vertical
from massprop_cli.testbed.simulate import SimulatedFlight

TILT_RAD = 0.5
"""Of an air bearing, where nothing else is stated: hemispherical ones end between 30 and 45 degrees."""
RANGE_USED = 0.9
"""Part of an IMU's range that a plan may take: what is above clips at the next gust."""
UNITS = {
    "impulse_n_s": "N s",
    "rate_rad_s": "rad/s",
    "tilt_rad": "rad",
    "travel_m": "m",
    "wheel_rad_s": "rad/s",
    "gyro_rad_s": "rad/s",
    "accel_m_s2": "m/s^2",
}
NAMES = {
    "impulse_n_s": "impulse of the jets",
    "rate_rad_s": "body rate",
    "tilt_rad": "tilt",
    "travel_m": "travel",
    "wheel_rad_s": "change of a wheel's speed",
    "gyro_rad_s": "rate about an axis of the gyro",
    "accel_m_s2": "specific force along an axis of the accelerometer",
}


@dataclass(frozen=True)
class Used:
    """The most that a flight takes, for each of its members (S,), or what is allowed of it; infinite where nothing limits it."""

    impulse_n_s: Array
    rate_rad_s: Array
    tilt_rad: Array
    travel_m: Array
    wheel_rad_s: Array
    gyro_rad_s: Array
    accel_m_s2: Array

    def most(self) -> dict[str, float]:
        """Of all members."""
        return {field.name: float(np.max(getattr(self, field.name))) for field in fields(self)}


def allowed(
    vehicle: Vehicle,
    impulse_n_s: float | None = None,
    rate_rad_s: float | None = None,
    tilt_rad: float | None = None,
    travel_m: float | None = None,
    wheel_rad_s: float | None = None,
) -> dict[str, float]:
    """What is stated, what the IMU can show, and on a bearing :data:`TILT_RAD`; of the fastest wheel's speed what is beyond its start."""
    inertial = vehicle.imu
    starts = [wheel.start_rad_s or 0.0 for wheel in vehicle.wheels]
    tilt = TILT_RAD if tilt_rad is None and vehicle.pivoted else tilt_rad
    stated = {
        "impulse_n_s": impulse_n_s,
        "rate_rad_s": rate_rad_s,
        "tilt_rad": tilt,
        "travel_m": travel_m,
        "wheel_rad_s": None if wheel_rad_s is None else wheel_rad_s - max(map(abs, starts), default=0.0),
        "gyro_rad_s": RANGE_USED * inertial.gyro_range_rad_s if inertial.gyro_range_rad_s else None,
        "accel_m_s2": RANGE_USED * inertial.accel_range_m_s2 if inertial.accel_range_m_s2 else None,
    }
    return {name: value for name, value in stated.items() if value is not None}


def exceeded(used: dict[str, float], limits: dict[str, float]) -> dict[str, float]:
    """By what factor each limit is passed that is."""
    return {name: used[name] / limit for name, limit in limits.items() if used[name] > limit * (1 + 1e-9)}


def used(flight: SimulatedFlight) -> Used:
    """What the members of a flight with perfect sensors take. Travel is the IMU's from where it starts, level on a bearing or a table."""
    vehicle = flight.vehicle
    record = float(flight.time_s[0])
    attitude = np.moveaxis(flight.attitude_wxyz, -1, 0)
    up = vertical(attitude)
    tilt = np.arccos(np.clip((up * up[:, :, :1]).sum(0), -1.0, 1.0)).max(1)
    return Used(
        impulse_n_s=_impulse(flight),
        rate_rad_s=np.linalg.norm(flight.rate_rad_s, axis=-1).max(1),
        tilt_rad=tilt,
        travel_m=_travel(flight, attitude, record, vehicle),
        wheel_rad_s=_gained(flight),
        gyro_rad_s=np.abs(flight.delta_theta_rad).max((1, 2)) / record,
        accel_m_s2=np.abs(flight.delta_v_m_s).max((1, 2)) / record,
    )


def _gained(flight: SimulatedFlight) -> Array:
    """(S,) most by which any wheel's speed differs from the one that it begins with."""
    most = np.zeros(len(flight.seeds))
    for wheel in flight.vehicle.wheels:
        most = np.maximum(most, np.abs(flight.turning[f"wheel_{wheel.name}_rad_s"] - (wheel.start_rad_s or 0.0)).max(1))
    return most


def _impulse(flight: SimulatedFlight) -> Array:
    vehicle = flight.vehicle
    if vehicle.jets:
        return np.asarray(flight.issued[..., : len(vehicle.jets)].sum(1) @ np.linalg.norm(vehicle.jet_wrench[:, 3:], axis=1))
    return np.asarray(np.linalg.norm(flight.issued[..., 3:6], axis=-1).sum(1) * vehicle.cycle.period_s)


def _travel(flight: SimulatedFlight, attitude: Array, record: float, vehicle: Vehicle) -> Array:
    """(S,) farthest that the IMU gets, by integrating its specific force in world axes less gravity."""
    felt = np.moveaxis(flight.delta_v_m_s @ np.array(vehicle.imu.body_from_imu).T, -1, 0) / record
    middle = (attitude[:, :, 1:] + attitude[:, :, :-1]) / 2
    world = to_world(middle / np.linalg.norm(middle, axis=0), felt)
    if vehicle.environment.kind != "free":
        world[2] = 0.0
    velocity = np.cumsum(world, -1) * record
    place = np.cumsum(velocity - world * record / 2, -1) * record
    return np.asarray(np.linalg.norm(place, axis=0).max(-1))
