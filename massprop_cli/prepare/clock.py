"""Start and length of control cycles, and conversion of the IMU's time to the commands' clock."""

from __future__ import annotations

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle


def cycle_edges(log: Log, cycles: slice) -> tuple[Array, Array]:
    """(K,) start times by the IMU's clock and (K,) lengths of cycles, s."""
    records = log.records_per_cycle
    duration = log.interval_s[cycles.start * records : cycles.stop * records].reshape(-1, records).sum(1)
    return log.cycle_end_s[cycles] - duration, duration


def clock_ratio(vehicle: Vehicle) -> float:
    """Seconds on the commands' clock per second on the IMU's clock."""
    return 1.0 - 1e-6 * vehicle.imu.clock_drift_ppm


def by_commands_clock(log: Log, vehicle: Vehicle, time_s: Array) -> Array:
    """Convert times on the IMU's clock to the commands' clock; both agree at the log's origin."""
    if vehicle.imu.clock_drift_ppm == 0:
        return time_s
    return log.origin_s + (time_s - log.origin_s) * clock_ratio(vehicle)
