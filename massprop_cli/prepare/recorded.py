"""Corrections of the logged increments for low-pass, gyro bias and axes of the velocity increments.

A first-order low-pass of time constant τ reports ``y[k] = a y[k−1] + (1 − a) u[k]``, ``a = exp(−T / τ)`` for a record of length T. The
inverse ``u[k] = (y[k] − a y[k−1]) / (1 − a)`` uses records k − 1 and k, and makes noise from before the low-pass white again.

A strapdown unit may report velocity increments in its axes at the start of the record (rotation and sculling compensated: Savage, J.
Guidance, Control, and Dynamics 21, 1998). A rotation by half of the record's turn refers them to the axes at mid-record.
"""

from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import tachometer

REACH = 64
"""Number of cycles after which the correlation of a low-pass of a few cycles has decayed."""


def corrected_log(log: Log, vehicle: Vehicle) -> Log:
    """The log with stated low-passes inverted, the stated gyro bias subtracted, and velocity increments in the IMU's axes at mid-record.

    The motion before the log counts as steady. Device speeds are corrected as in :func:`massprop_cli.prepare.tachometer.at_knots`.
    """
    log = tachometer.at_knots(log, vehicle)
    gyro, accelerometer = vehicle.imu.gyro_lag_s, vehicle.imu.accel_lag_s
    if gyro == 0 and accelerometer == 0 and vehicle.imu.accel_axes == "imu" and not any(vehicle.imu.gyro_bias_rad_s):
        return log
    angle = _inverted(log.delta_theta_imu_rad, log.interval_s, gyro) - np.outer(log.interval_s, vehicle.imu.gyro_bias_rad_s)
    velocity = _inverted(log.delta_v_imu_m_s, log.interval_s, accelerometer)
    if vehicle.imu.accel_axes != "imu":
        velocity = (rotation(-angle / 2) @ velocity[:, :, None])[..., 0]
    return replace(log, delta_theta_imu_rad=angle, delta_v_imu_m_s=velocity)


def _inverted(increments: Array, interval_s: Array, lag_s: float) -> Array:
    """(n, 3) increments before a low-pass of time constant ``lag_s``, from logged ones over intervals (n,)."""
    if lag_s == 0:
        return increments
    mean = increments / interval_s[:, None]
    kept = np.exp(-interval_s / lag_s)[:, None]
    before = np.concatenate([mean[:1], mean[:-1]])
    return np.asarray(interval_s[:, None] * (mean - kept * before) / (1 - kept))


def low_pass_response(values: Array, step_s: float, lag_s: float) -> Array:
    """(K, n) response of a low-pass, from zero, to values sampled every ``step_s``; all zeros if ``lag_s`` is 0."""
    kept = np.exp(-step_s / lag_s) if lag_s > 0 else 1.0
    response, state = np.empty_like(values), np.zeros(values.shape[1])
    for k, value in enumerate(values):
        response[k] = state = kept * state + (1 - kept) * value
    return response


def narrowed(lag_s: float, record_s: float, records: int) -> float:
    """Logarithm of the ratio of one-step innovation variances of cycle means of white noise: with a low-pass to without.

    A cycle has ``records`` records of ``record_s``. The log innovation variance is the mean log spectral density (Szegő 1915).
    """
    if lag_s == 0:
        return 0.0
    kept = np.exp(-record_s / lag_s)
    apart = np.arange(REACH * records)
    correlated = (1 - kept) / (1 + kept) * kept**apart
    # covariance of the means of two cycles, by cycles apart
    pairs = np.abs(np.arange(REACH)[:, None, None] * records + np.arange(records)[:, None] - np.arange(records))
    by_cycle = correlated[np.minimum(pairs, len(apart) - 1)].sum((1, 2)) / records
    lags = np.abs(np.arange(REACH)[:, None] - np.arange(REACH))
    return 2 * float(np.log(np.diag(np.linalg.cholesky(by_cycle[lags]))[-1]))
