"""Noise levels that the vehicle file leaves open, and disturbances that its stated levels can't explain.

Both come from a first pass over the log, are stated in the result's settings, and reproduce the result when given back.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples, acceleration
from massprop_cli.dynamics import times
from massprop_cli.history import History
from massprop_cli.linearise import linearise
from massprop_cli.plant import Reference
from massprop_cli.start import first_reference
from massprop_cli.telemetry import Notice
from massprop_cli.vehicle import Vehicle

FLOOR = 1e-6
"""Where a noise is stated as zero: this part of the signal's root mean square stands in for it."""
EXCESS = 0.5
"""Mean squared normalised innovation above 1 + this (and above six of its own sigmas) is a misfit."""


def with_noise_levels(samples: Samples, cycles: Sequence[slice], vehicle: Vehicle) -> tuple[Vehicle, list[Notice]]:
    """The vehicle with both IMU noise levels set: as stated, a floor for zero, or estimated from the log where absent."""
    imu, notices = vehicle.imu, []
    levels: dict[str, float] = {}
    signals = {"gyro_noise_rad_s": samples.rate_rad_s, "accel_noise_m_s2": acceleration(samples, vehicle)}
    for key, signal in signals.items():
        stated = getattr(imu, key)
        rms = float(np.sqrt((signal**2).mean()))
        if stated == 0:
            levels[key] = FLOOR * rms or FLOOR
            notices.append(Notice("noise-floor", f"imu.{key} is stated as 0; {levels[key]:.3g} stands in for it ({FLOOR:g} of the signal)"))
        elif stated is None:
            levels[key] = max(_white_level(signal, cycles), FLOOR * rms or FLOOR)
            notices.append(Notice("noise-estimated", f"imu.{key} is not stated; {levels[key]:.3g} was estimated from the log"))
    return _changed(vehicle, imu=levels), notices


def _white_level(signal: Array, cycles: Sequence[slice]) -> float:
    """One sigma of the white part of a signal, from its quietest stretches: third differences have variance 20 σ² and little else."""
    found = []
    for piece in cycles:
        differences = np.diff(signal[piece], 3, axis=0) / np.sqrt(20.0)
        for start in range(0, max(len(differences) - 15, 1), 8):
            block = differences[start : start + 16]
            if len(block):
                found.append(np.median(np.abs(block)) / 0.6745)
    return float(np.percentile(found, 20)) if found else 0.0


def misfit(histories: Sequence[History]) -> Array:
    """(6,) mean squared normalised innovation per channel (1 where noise explains all), NaN where it is not in excess."""
    squares = np.concatenate([(h.innovation / h.innovation_sigma) ** 2 for h in histories])
    squares = squares[np.isfinite(squares).all(1)]
    if len(squares) < 20:
        return np.full(6, np.nan)
    mean: Array = squares.mean(0)
    limit = 1 + max(EXCESS, 6 * np.sqrt(2 / len(squares)))
    return np.where(mean > limit, mean, np.nan)


def with_disturbances(samples: Samples, histories: Sequence[History], vehicle: Vehicle) -> Vehicle:
    """The vehicle with disturbance torque and accelerometer noise sized so that the innovations are explained.

    Rate channels: residual moment impulses e of the differenced rates are taken as a white torque, a random-walk torque and gyro noise;
    the autocovariances g of their differences give the variances, walk = g0 + 2 g1 + 2 g2, white = −g1 − 4 g2 (pooled over axes).
    If that was done before, both are raised by what is still missing.
    """
    excess = misfit(histories)
    environment: dict[str, float] = {}
    if np.isfinite(excess[:3]).any():
        now = vehicle.environment.disturbance_torque_n_m, vehicle.environment.disturbance_walk_n_m
        factor = float(np.sqrt(np.nanmax(excess[:3])))
        white, walk = _torque_levels(samples, histories, vehicle)
        environment = {
            "disturbance_torque_n_m": max(white, factor * now[0]),
            "disturbance_walk_n_m": max(walk, factor * now[1]),
        }
    estimator: dict[str, Any] = {}
    if np.isfinite(excess[3:]).any():
        scale = np.array(vehicle.estimator.accel_noise_scale or (1.0, 1.0, 1.0)) * np.sqrt(np.fmax(excess[3:], 1.0))
        estimator["accel_noise_scale"] = tuple(float(f) for f in scale)
    return _changed(vehicle, environment=environment, estimator=estimator)


def _torque_levels(samples: Samples, histories: Sequence[History], vehicle: Vehicle) -> tuple[float, float]:
    """One sigma per cycle of a white torque, and of the change of a random-walk torque, N m."""
    moments = []
    for history in histories:
        reference = first_reference(samples, history.cycles, vehicle)
        if reference is not None and history.cycles.stop - history.cycles.start > 10:
            e = residual_torque(samples, history.cycles, reference, vehicle)
            change = np.diff(e, axis=0)
            moments.append([float((change[lag:] * change[: len(change) - lag]).mean()) for lag in range(3)])
    if not moments:
        return 0.0, 0.0
    g0, g1, g2 = np.mean(moments, 0)
    return float(np.sqrt(max(-g1 - 4 * max(g2, 0.0), 0.0))), float(np.sqrt(max(g0 + 2 * g1 + 2 * g2, 0.0)))


def residual_torque(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle) -> Array:
    """(K − 1, 3) mean torque that the differenced rates show beyond the model about ``reference``, N m."""
    duration = samples.executed.duration_s[cycles][1:, None]
    growth = np.diff(samples.rate_rad_s[cycles], axis=0)
    return times(reference.inertia, growth - linearise(samples, cycles, reference, vehicle).steps) / duration


def _changed(vehicle: Vehicle, **sections: dict[str, Any]) -> Vehicle:
    changes = {name: getattr(vehicle, name).model_copy(update=update) for name, update in sections.items() if update}
    return vehicle.model_copy(update=changes) if changes else vehicle
