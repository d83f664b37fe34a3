"""Noise levels that the vehicle file leaves open, estimated once in a first pass over the log.

They are stated in the result's settings, and reproduce the result when given back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.estimate.initial import beginning
from massprop_cli.estimate.unexplained import residual_growth, unfelt
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Samples, Source, acceleration, gathered

FLOOR = 1e-6
"""A noise level found in the log is not below this part of its signal's root mean square: sensors resolve some twenty
bits of it, and what is left of a log without noise is rounding."""
QUIET, BLOCK, STRIDE = 20, 16, 8
"""The white part of a signal is the percentile of its quietest stretches of so many cycles, half overlapping: manoeuvres make the others
louder. They are short beside the pauses between manoeuvres, and long enough for a median."""
LOW = 0.836
"""That percentile, of white noise alone, in sigmas: the mean of many (tests/estimate/test_noiselevels.py)."""
CHANCE = 3.2
"""Over the root of the count of cycles, three standard deviations of it."""
LEAST = 30
"""Cycles of which anything is said."""
MEDIAN = 0.6745
"""The median of a normal deviate's size, in sigmas."""
ABSENT = 1.0
"""Noise level of a sensor that the log doesn't have: it weighs nothing."""


def with_noise_levels(samples: Source, cycles: Sequence[slice], vehicle: Vehicle) -> tuple[Resolved, list[Notice]]:
    """The vehicle with both IMU noise levels set: as stated, or found in the log where absent or stated as zero, not below a floor."""
    stated = Resolved.stated(vehicle)
    if stated is not None:
        return stated, []
    unexplained = _unexplained(samples, cycles, vehicle)
    gyro, of_gyro = _level(0, samples, cycles, vehicle, lambda here: here.rate_rad_s, unexplained[0])
    accel, of_accel = _level(1, samples, cycles, vehicle, partial(acceleration, vehicle=vehicle), unexplained[1])
    return Resolved.of(vehicle, gyro, accel), [*of_gyro, *of_accel]


def _level(
    sensor: int, samples: Source, cycles: Sequence[slice], vehicle: Vehicle, found_of: Callable[[Samples], Array], unexplained: float
) -> tuple[float, list[Notice]]:
    """The noise level of gyro (0) or accelerometer (1), and what to tell of it."""
    key = ("gyro_noise_rad_s", "accel_noise_m_s2")[sensor]
    stated: float | None = getattr(vehicle.imu, key)
    if stated:
        return stated, []
    axes = ~np.split(samples.unread, 2)[sensor]
    if not axes.any():
        return stated or ABSENT, []
    every = slice(0, len(samples))
    ignored = gathered(samples, every, lambda here: here.executed.ignored)
    signal, unused = gathered(samples, every, found_of)[:, axes], np.split(ignored, 2, 1)[sensor]
    read = np.asarray(~unused[:, axes].any(1))
    floor = FLOOR * float(np.sqrt((signal**2).mean())) or FLOOR
    white, count = white_level(signal, cycles, read), sum(piece.stop - piece.start for piece in cycles)
    # what no mass properties explain tells noise the better, unless it holds more than that
    least = np.nan_to_num(white, nan=np.inf) * (1 + CHANCE / max(count, 1) ** 0.5)
    found = unexplained if unexplained < least else np.nan_to_num(white)
    level = float(max(found, floor))
    if stated is None:
        return level, [Notice("noise-estimated", f"imu.{key} is not stated; {level:.3g} was estimated from the log")]
    source = f"a floor of {FLOOR:g} of the signal" if found <= floor else "what the log shows"
    return level, [Notice("noise-floor", f"imu.{key} is stated as 0; {level:.3g} stands in for it ({source})")]


def white_level(signal: Array, cycles: Sequence[slice], read: BoolArray) -> float:
    """One sigma of the white part of a signal, from its quietest stretches: third differences have variance 20 σ² and little else.

    Those of readings that are not used, in whose place others stand, are left out: ``read`` (K,). NaN where none is left.
    """
    found = []
    for piece in cycles:
        whole = np.lib.stride_tricks.sliding_window_view(read[piece], 4).all(1) if piece.stop - piece.start > 3 else np.zeros(0, dtype=bool)
        differences = np.diff(signal[piece], 3, axis=0)[whole] / np.sqrt(20.0)
        for start in range(0, max(len(differences) - BLOCK + 1, 1), STRIDE):
            block = differences[start : start + BLOCK]
            if len(block):
                found.append(median(np.abs(block)) / MEDIAN)
    return float(np.percentile(found, QUIET)) / LOW if found else np.nan


def _unexplained(samples: Source, cycles: Sequence[slice], vehicle: Vehicle) -> tuple[float, float]:
    """One sigma of gyro and accelerometer noise from what no mass properties explain; infinite where nothing can be said.

    Rate: white noise n enters the growth as n[k+1] − n[k], with variance 2 σ² and lag-one autocovariance −σ². A white torque's impulse s
    enters half in each of two steps, with s² / 2 and s² / 4. So a fourth of the variance less twice the autocovariance is σ² whatever the
    torque. Force: half the mean squared difference.
    """
    rate, force = [], []
    for piece in cycles:
        reference = beginning(samples, piece, vehicle)
        if reference is None or piece.stop - piece.start < LEAST:
            continue
        growth = residual_growth(samples, piece, reference, vehicle)
        if growth.read.any(1).sum() >= LEAST:
            rate.append(float(growth.variance[growth.axes].mean() - 2 * growth.lagged[growth.axes].mean()) / 4)
        left = unfelt(samples, piece, reference, vehicle)
        if left.read.any(1).sum() >= LEAST:
            force.append(float(left.stepped[left.axes].mean()) / 2)
    gyro = float(np.mean(rate)) if rate else -1.0
    return (np.sqrt(gyro) if gyro > 0 else np.inf), (float(np.sqrt(np.mean(force))) if force else np.inf)
