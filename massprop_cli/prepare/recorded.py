"""Corrections of what a sensor or recorder did to the increments.

A first-order low-pass of time constant τ reports ``y[k] = a y[k−1] + (1 − a) u[k]``, ``a = exp(−T / τ)`` for a record of length T. Undone,
record k takes records k − 1 and k alone, and noise that the sensor had before its low-pass is white again.

A strapdown unit reports velocity increments in the axes that it had when the record began (rotation and sculling compensated: Savage, J.
Guidance, Control, and Dynamics 21, 1998): half of the record's turn takes them back.
"""

from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import tachometer

REACH = 64
"""Cycles after which what one was is forgotten: of low-passes that are a few cycles long."""


def undone(log: Log, vehicle: Vehicle) -> Log:
    """The log without the low-passes (as of a steady motion before it) and the gyro bias that ``imu`` states.

    With the speeds of wheels at the records' ends, and velocity increments in the IMU's own axes whatever ``imu.accel_axes`` says.
    """
    log = tachometer.at_bends(log, vehicle)
    gyro, accelerometer = vehicle.imu.gyro_lag_s, vehicle.imu.accel_lag_s
    if gyro == 0 and accelerometer == 0 and vehicle.imu.accel_axes == "imu" and not any(vehicle.imu.gyro_bias_rad_s):
        return log
    turned = _undone(log.delta_theta_imu_rad, log.interval_s, gyro) - np.outer(log.interval_s, vehicle.imu.gyro_bias_rad_s)
    velocity = _undone(log.delta_v_imu_m_s, log.interval_s, accelerometer)
    if vehicle.imu.accel_axes != "imu":  # into the axes that the IMU has halfway through each record
        velocity = (rotation(-turned / 2) @ velocity[:, :, None])[..., 0]
    return replace(log, delta_theta_imu_rad=turned, delta_v_imu_m_s=velocity)


def _undone(increments: Array, interval_s: Array, lag_s: float) -> Array:
    """(n, 3) increments over intervals (n,)."""
    if lag_s == 0:
        return increments
    mean = increments / interval_s[:, None]
    kept = np.exp(-interval_s / lag_s)[:, None]
    before = np.concatenate([mean[:1], mean[:-1]])
    return np.asarray(interval_s[:, None] * (mean - kept * before) / (1 - kept))


def applied(values: Array, step_s: float, lag_s: float) -> Array:
    """(K, n) what a low-pass makes of values that follow one another by ``step_s``, nothing before; nothing of all without one."""
    kept = np.exp(-step_s / lag_s) if lag_s > 0 else 1.0
    found, now = np.empty_like(values), np.zeros(values.shape[1])
    for k, value in enumerate(values):
        found[k] = now = kept * now + (1 - kept) * value
    return found


def narrowed(lag_s: float, record_s: float, records: int) -> float:
    """Log of the innovation variance of cycles' means behind a low-pass over that without one, of white noise in ``records`` records.

    The innovation variance of the decimated means (Szegő 1915: its log is the mean log spectral density).
    """
    if lag_s == 0:
        return 0.0
    kept = np.exp(-record_s / lag_s)
    apart = np.arange(REACH * records)
    correlated = (1 - kept) / (1 + kept) * kept**apart
    # the mean over a cycle, against that over another
    pairs = np.abs(np.arange(REACH)[:, None, None] * records + np.arange(records)[:, None] - np.arange(records))
    by_cycle = correlated[np.minimum(pairs, len(apart) - 1)].sum((1, 2)) / records
    lags = np.abs(np.arange(REACH)[:, None] - np.arange(REACH))
    return 2 * float(np.log(np.diag(np.linalg.cholesky(by_cycle[lags]))[-1]))
