"""What a plan must keep to, and what of it a flight takes."""

from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.motion import to_world, vertical
from massprop_cli.testbed.simulate import SimulatedFlight

TILT_RAD = 0.5
"""Of an air bearing, where nothing else is stated: hemispherical ones end between 30 and 45 degrees."""
RANGE_USED = 0.9
"""Part of an IMU's range that a plan may take: what is above clips at the next gust."""
LIMITS = {
    "impulse_n_s": ("impulse of the jets", "N s"),
    "rate_rad_s": ("body rate", "rad/s"),
    "tilt_rad": ("tilt", "rad"),
    "travel_m": ("travel", "m"),
    "wheel_rad_s": ("change of a wheel's speed", "rad/s"),
    "gyro_rad_s": ("rate about an axis of the gyro", "rad/s"),
    "accel_m_s2": ("specific force along an axis of the accelerometer", "m/s^2"),
}
"""Name and unit of each."""


def allowed(vehicle: Vehicle, stated: Mapping[str, float]) -> dict[str, float]:
    """What is stated, what the IMU can show, and on a bearing :data:`TILT_RAD`; of the fastest wheel's speed what is beyond its start."""
    found, imu = dict(stated), vehicle.imu
    if vehicle.pivoted:
        found.setdefault("tilt_rad", TILT_RAD)
    if "wheel_rad_s" in found:
        found["wheel_rad_s"] -= fastest_start(vehicle)
    ranges = {"gyro_rad_s": imu.gyro_range_rad_s, "accel_m_s2": imu.accel_range_m_s2}
    return found | {name: RANGE_USED * limit for name, limit in ranges.items() if limit}


def fastest_start(vehicle: Vehicle) -> float:
    """Speed of the wheel that begins fastest, rad/s; 0 without wheels."""
    return max((abs(wheel.start_rad_s or 0.0) for wheel in vehicle.wheels), default=0.0)


def exceeded(used: dict[str, float], limits: dict[str, float]) -> dict[str, float]:
    """By what factor each limit is passed that is."""
    return {name: used[name] / limit for name, limit in limits.items() if used[name] > limit * (1 + 1e-9)}


def used(flight: SimulatedFlight) -> dict[str, float]:
    """The most that any member of a flight with perfect sensors takes. Travel is that of the IMU, on a bearing or a table level."""
    record = float(flight.time_s[0])
    attitude = np.moveaxis(flight.attitude_wxyz, -1, 0)
    up = vertical(attitude)
    # the change of each wheel's speed since the start
    gained = [flight.turning[f"wheel_{wheel.name}_rad_s"] - (wheel.start_rad_s or 0.0) for wheel in flight.vehicle.wheels]
    taken = {
        "impulse_n_s": _impulse(flight),
        "rate_rad_s": np.linalg.norm(flight.rate_rad_s, axis=-1),
        "tilt_rad": np.arccos(np.clip((up * up[:, :, :1]).sum(0), -1.0, 1.0)),
        "travel_m": _travel(flight, attitude, record),
        "wheel_rad_s": np.abs(gained) if gained else np.zeros(1),
        "gyro_rad_s": np.abs(flight.delta_theta_rad) / record,
        "accel_m_s2": np.abs(flight.delta_v_m_s) / record,
    }
    return {name: float(np.max(values)) for name, values in taken.items()}


def _impulse(flight: SimulatedFlight) -> Array:
    """(S,) N s of all jets, or of the commanded force."""
    vehicle = flight.vehicle
    if vehicle.jets:
        return np.asarray(flight.issued[..., : len(vehicle.jets)].sum(1) @ np.linalg.norm(vehicle.jet_wrench[:, 3:], axis=1))
    return np.asarray(np.linalg.norm(flight.issued[..., 3:6], axis=-1).sum(1) * vehicle.cycle.period_s)


def _travel(flight: SimulatedFlight, attitude: Array, record: float) -> Array:
    """(S, K) m from the start at which the IMU is, by integrating its specific force in world axes less gravity."""
    vehicle = flight.vehicle
    felt = np.moveaxis(flight.delta_v_m_s @ np.array(vehicle.imu.body_from_imu).T, -1, 0) / record
    middle = (attitude[:, :, 1:] + attitude[:, :, :-1]) / 2
    world = to_world(middle / np.linalg.norm(middle, axis=0), felt)
    if vehicle.environment.kind != "free":
        world[2] = 0.0
    velocity = np.cumsum(world, -1) * record
    place = np.cumsum(velocity - world * record / 2, -1) * record
    return np.asarray(np.linalg.norm(place, axis=0))
