"""Noise levels that the vehicle file leaves open, estimated once from the log.

The result's settings state them; with these settings the result is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from massprop_cli.base.arrays import NORMAL_MEDIAN, Array, BoolArray, median
from massprop_cli.base.levels import ENOUGH
from massprop_cli.estimate.initial import early_reference
from massprop_cli.estimate.unexplained import residual_force, residual_growth
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Samples, Source, acceleration, gathered

FLOOR = 1e-6
"""Least noise level over the signal's root mean square. Sensors resolve some twenty bits of it, and residuals of a log without noise are
rounding."""
QUIET, BLOCK, STRIDE = 20, 16, 8
"""The white noise of a signal is this percentile over blocks of so many cycles, half overlapping; manoeuvres raise the others. A block is
shorter than pauses between manoeuvres, and long enough for a median."""
LOW = 0.836
"""Mean of that percentile for white noise alone, in sigmas (tests/estimate/test_noiselevels.py)."""
CHANCE = 3.2
"""Three standard deviations of that percentile, times the root of the number of cycles."""
ABSENT = 1.0
"""Noise level of a sensor that the log doesn't have; it carries no information."""


def with_noise_levels(samples: Source, cycles: Sequence[slice], vehicle: Vehicle) -> tuple[Resolved, list[Notice]]:
    """The vehicle with both IMU noise levels: as stated, or estimated where absent or stated as zero; and notices of these."""
    stated = Resolved.stated(vehicle)
    if stated is not None:
        return stated, []
    unexplained = _unexplained(samples, cycles, vehicle)
    gyro, gyro_notices = _level(0, samples, cycles, vehicle, lambda here: here.rate_rad_s, unexplained[0])
    accel, accel_notices = _level(1, samples, cycles, vehicle, partial(acceleration, vehicle=vehicle), unexplained[1])
    return Resolved.of(vehicle, gyro, accel), [*gyro_notices, *accel_notices]


def _level(
    sensor: int, samples: Source, cycles: Sequence[slice], vehicle: Vehicle, signal_of: Callable[[Samples], Array], unexplained: float
) -> tuple[float, list[Notice]]:
    """Noise level of gyro (0) or accelerometer (1), and notices of it."""
    key = ("gyro_noise_rad_s", "accel_noise_m_s2")[sensor]
    stated: float | None = getattr(vehicle.imu, key)
    if stated:
        return stated, []
    axes = ~np.split(samples.unread, 2)[sensor]
    if not axes.any():
        return stated or ABSENT, []
    every = slice(0, len(samples))
    ignored = gathered(samples, every, lambda here: here.executed.ignored)
    signal, unused = gathered(samples, every, signal_of)[:, axes], np.split(ignored, 2, 1)[sensor]
    read = np.asarray(~unused[:, axes].any(1))
    floor = FLOOR * float(np.sqrt((signal**2).mean())) or FLOOR
    white, count = white_level(signal, cycles, read), sum(piece.stop - piece.start for piece in cycles)
    # residuals give the noise more precisely, unless they hold more than noise
    least = np.nan_to_num(white, nan=np.inf) * (1 + CHANCE / max(count, 1) ** 0.5)
    estimate = unexplained if unexplained < least else np.nan_to_num(white)
    level = float(max(estimate, floor))
    if stated is None:
        return level, [Notice("noise-estimated", f"imu.{key} is not stated; massprop estimated {level:.3g} from the log")]
    source = f"a floor of {FLOOR:g} of the signal" if estimate <= floor else "estimated from the log"
    return level, [Notice("noise-floor", f"imu.{key} is stated as 0; massprop uses {level:.3g} instead ({source})")]


def white_level(signal: Array, cycles: Sequence[slice], read: BoolArray) -> float:
    """One sigma of a signal's white noise, from its blocks with the least motion; NaN if there are none.

    Third differences have variance 20 σ² and little of the motion. Only readings that are used, ``read`` (K,), count.
    """
    levels = []
    for piece in cycles:
        whole = np.lib.stride_tricks.sliding_window_view(read[piece], 4).all(1) if piece.stop - piece.start > 3 else np.zeros(0, dtype=bool)
        differences = np.diff(signal[piece], 3, axis=0)[whole] / np.sqrt(20.0)
        for start in range(0, max(len(differences) - BLOCK + 1, 1), STRIDE):
            block = differences[start : start + BLOCK]
            if len(block):
                levels.append(median(np.abs(block)) / NORMAL_MEDIAN)
    return float(np.percentile(levels, QUIET)) / LOW if levels else np.nan


def _unexplained(samples: Source, cycles: Sequence[slice], vehicle: Vehicle) -> tuple[float, float]:
    """One sigma of gyro and of accelerometer noise, from residuals that no mass properties explain; infinite without an estimate.

    Rate: white noise n enters the growth as n[k+1] − n[k], with variance 2 σ² and lag-one autocovariance −σ². A white torque's impulse s
    enters half in each of two steps, with s² / 2 and s² / 4. So variance minus twice the autocovariance is 4 σ² for any torque. Force: half
    the mean squared difference of neighbours.
    """
    rate, force = [], []
    for piece in cycles:
        reference = early_reference(samples, piece, vehicle)
        if reference is None or piece.stop - piece.start < ENOUGH:
            continue
        growth = residual_growth(samples, piece, reference, vehicle)
        if growth.used.any(1).sum() >= ENOUGH:
            rate.append(float(growth.variance[growth.axes].mean() - 2 * growth.lagged[growth.axes].mean()) / 4)
        residual = residual_force(samples, piece, reference, vehicle)
        if residual.used.any(1).sum() >= ENOUGH:
            force.append(float(residual.stepped[residual.axes].mean()) / 2)
    gyro = float(np.mean(rate)) if rate else -1.0
    return (np.sqrt(gyro) if gyro > 0 else np.inf), (float(np.sqrt(np.mean(force))) if force else np.inf)
