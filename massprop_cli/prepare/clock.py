"""Start and length of control cycles, by the IMU's clock and by that of the commands."""

from __future__ import annotations

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle


def cycle_edges(log: Log, cycles: slice) -> tuple[Array, Array]:
    """(K,) start and length of cycles."""
    records = log.records_per_cycle
    duration = log.interval_s[cycles.start * records : cycles.stop * records].reshape(-1, records).sum(1)
    return log.cycle_end_s[cycles] - duration, duration


def pace(vehicle: Vehicle) -> float:
    """Seconds of the commands' clock to one of the IMU's."""
    return 1.0 - 1e-6 * vehicle.imu.clock_drift_ppm


def by_commands_clock(log: Log, vehicle: Vehicle, time_s: Array) -> Array:
    """What the commands' clock shows at times of the IMU's."""
    if vehicle.imu.clock_drift_ppm == 0:
        return time_s
    return log.origin_s + (time_s - log.origin_s) * pace(vehicle)
