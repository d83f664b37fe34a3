"""Limits of a plan, and how much of each a simulated flight uses."""

from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.motion import to_world, vertical
from massprop_cli.testbed.simulate import SimulatedFlight

TILT_RAD = 0.5
"""Default tilt limit on an air bearing: hemispherical bearings allow 30 to 45 degrees (0.52 to 0.79 rad)."""
RANGE_USED = 0.9
"""Part of an IMU's range that a plan may use; the rest is a margin for disturbances."""
LIMITS = {
    "impulse_n_s": ("impulse of the jets", "N s"),
    "rate_rad_s": ("body rate", "rad/s"),
    "tilt_rad": ("tilt", "rad"),
    "travel_m": ("travel", "m"),
    "wheel_rad_s": ("change of a wheel's speed", "rad/s"),
    "gyro_rad_s": ("rate about an axis of the gyro", "rad/s"),
    "accel_m_s2": ("specific force along an axis of the accelerometer", "m/s^2"),
}
"""Description and unit of each limit."""


def allowed(vehicle: Vehicle, stated: Mapping[str, float]) -> dict[str, float]:
    """The limits of a plan: stated ones, the IMU's ranges, and on a bearing the default tilt.

    A stated wheel speed becomes a limit on its change: the speed minus :func:`fastest_start`.
    """
    limits, imu = dict(stated), vehicle.imu
    if vehicle.pivoted:
        limits.setdefault("tilt_rad", TILT_RAD)
    if "wheel_rad_s" in limits:
        limits["wheel_rad_s"] -= fastest_start(vehicle)
    ranges = {"gyro_rad_s": imu.gyro_range_rad_s, "accel_m_s2": imu.accel_range_m_s2}
    return limits | {name: RANGE_USED * limit for name, limit in ranges.items() if limit}


def fastest_start(vehicle: Vehicle) -> float:
    """Largest initial wheel speed, rad/s; 0 without wheels."""
    return max((abs(wheel.start_rad_s or 0.0) for wheel in vehicle.wheels), default=0.0)


def exceeded(used: dict[str, float], limits: dict[str, float]) -> dict[str, float]:
    """Ratio of use to limit, for each exceeded limit."""
    return {name: used[name] / limit for name, limit in limits.items() if used[name] > limit * (1 + 1e-9)}


def used(flight: SimulatedFlight) -> dict[str, float]:
    """Largest use of each limit over all members of a flight without sensor noise.

    Travel is that of the IMU, and is horizontal except for a free vehicle.
    """
    record = float(flight.time_s[0])
    attitude = np.moveaxis(flight.attitude_wxyz, -1, 0)
    up = vertical(attitude)
    speed_changes = [flight.turning[f"wheel_{wheel.name}_rad_s"] - (wheel.start_rad_s or 0.0) for wheel in flight.vehicle.wheels]
    courses = {
        "impulse_n_s": _impulse(flight),
        "rate_rad_s": np.linalg.norm(flight.rate_rad_s, axis=-1),
        "tilt_rad": np.arccos(np.clip((up * up[:, :, :1]).sum(0), -1.0, 1.0)),
        "travel_m": _travel(flight, attitude, record),
        "wheel_rad_s": np.abs(speed_changes) if speed_changes else np.zeros(1),
        "gyro_rad_s": np.abs(flight.delta_theta_rad) / record,
        "accel_m_s2": np.abs(flight.delta_v_m_s) / record,
    }
    return {name: float(np.max(values)) for name, values in courses.items()}


def _impulse(flight: SimulatedFlight) -> Array:
    """(S,) total impulse of all jets, or of the commanded force, N s."""
    vehicle = flight.vehicle
    if vehicle.jets:
        return np.asarray(flight.issued[..., : len(vehicle.jets)].sum(1) @ np.linalg.norm(vehicle.jet_wrench[:, 3:], axis=1))
    return np.asarray(np.linalg.norm(flight.issued[..., 3:6], axis=-1).sum(1) * vehicle.cycle.period_s)


def _travel(flight: SimulatedFlight, attitude: Array, record: float) -> Array:
    """(S, K) distance of the IMU from its start, m, from the double integral of specific force in world axes.

    The vertical component is omitted unless the vehicle is free, since it contains gravity. ``record`` is the record interval, s.
    """
    vehicle = flight.vehicle
    specific_force_b = np.moveaxis(flight.delta_v_m_s @ np.array(vehicle.imu.body_from_imu).T, -1, 0) / record
    middle = (attitude[:, :, 1:] + attitude[:, :, :-1]) / 2
    specific_force_w = to_world(middle / np.linalg.norm(middle, axis=0), specific_force_b)
    if vehicle.environment.kind != "free":
        specific_force_w[2] = 0.0
    velocity = np.cumsum(specific_force_w, -1) * record
    position = np.cumsum(velocity - specific_force_w * record / 2, -1) * record
    return np.asarray(np.linalg.norm(position, axis=0))
