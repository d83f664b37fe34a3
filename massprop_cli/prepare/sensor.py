"""Sensor kernels: how gyro and accelerometer record motion, as box mean or sample, after a low-pass and a dead time.

An increment or a mean record covers the motion from the previous record to its own time (box). A sample is the motion at its time.
Both kinds may follow a low-pass and a latency. All of this is linear and time-invariant, so massprop applies it to the commanded force
and torque instead of to the motion. The low-pass is a sum of first-order lags in parallel,

    H(s) = Σ c_i / (1 + τ_i s),   Σ c_i = 1,    τ_i y_i' = u − y_i.

The filtered signal and its integrals are then exact at any time (U' = u, V' = U, all zero before the first event):

    H u = Σ c_i y_i,   H U = U − Σ c_i τ_i y_i,   H V = V − U Σ c_i τ_i + Σ c_i τ_i² y_i
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from massprop_cli.base.arrays import Array, ComplexArray
from massprop_cli.inputs.equipment import LowPass
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import call, kernel
from massprop_cli.prepare.signal import Signal

APART = 1e-5
"""Smallest relative difference of two lags. Equal lags have no parallel form; this offset changes the response by about 1e-6."""
ROUNDED_S = 1e-9
"""s; a sample at the time of an event counts as this much earlier, so that rounded times do not include the event."""


class SensorKernel(NamedTuple):
    """Kernel of one sensor; each complex pair of lags is stored once, with twice its weight."""

    instant: bool
    """True if a record is a sample, False if it is a mean."""
    latency_s: float
    """Dead time, s."""
    weights: ComplexArray
    """(P,) weights c of the parallel lags."""
    lags_s: ComplexArray
    """(P,) time constants τ, s."""

    @staticmethod
    def of(instant: bool, low_pass: LowPass | None, lag_s: float = 0.0) -> SensorKernel:
        """Kernel of a sensor with an optional low-pass, in series with a first-order thrust lag ``lag_s``."""
        order, latency_s = (0, 0.0) if low_pass is None else (low_pass.order, low_pass.latency)
        tau = 1 / (2 * np.pi * low_pass.cutoff) if low_pass is not None and order else 0.0
        # second-order Butterworth: poles at 45 degrees
        series = {0: [], 1: [tau], 2: [tau * (1 + 1j) / np.sqrt(2), tau * (1 - 1j) / np.sqrt(2)]}[order]
        if lag_s > 0:
            near = any(abs(lag_s - one) < APART * lag_s for one in series)
            series = [*series, lag_s * (1 + 2 * APART) if near else lag_s]
        lags = np.array(series, dtype=complex)
        weights = np.array([np.prod([one / (one - other) for other in lags if other != one]) for one in lags], dtype=complex)
        kept = lags.imag >= 0
        return SensorKernel(instant, latency_s, np.where(lags.imag > 0, 2, 1)[kept] * weights[kept], lags[kept])

    @property
    def plain(self) -> bool:
        """Whether records are means without low-pass and latency."""
        return not (self.instant or self.latency_s or len(self.lags_s))

    @property
    def delay_s(self) -> float:
        """Mean delay of the sensor: latency plus the mean of the low-pass impulse response, s."""
        return self.latency_s + float((self.weights * self.lags_s).sum().real)

    @property
    def variance_s2(self) -> float:
        """Variance of the low-pass impulse response in time, s²."""
        mean, square = ((self.weights * self.lags_s**order).sum().real for order in (1, 2))
        return float(2 * square - mean**2)


class Recorder(Protocol):
    """Recording properties of an IMU, as a log or a planned log has them."""

    @property
    def sampled(self) -> tuple[bool, bool]:
        """Whether gyro and accelerometer record samples instead of means."""

    @property
    def interval_s(self) -> Array:
        """(n,) time between records, s."""


def sensors(log: Recorder, vehicle: Vehicle, lag_s: float = 0.0) -> tuple[SensorKernel, SensorKernel]:
    """Kernels of gyro and accelerometer, each in series with a first-order thrust lag ``lag_s``."""
    low_passes = vehicle.imu.gyro_filter, vehicle.imu.accel_filter
    gyro, accelerometer = (SensorKernel.of(instant, one, lag_s) for instant, one in zip(log.sampled, low_passes, strict=True))
    return gyro, accelerometer


def body_kernel(gyro: SensorKernel, lag_s: float = 0.0) -> SensorKernel:
    """Kernel of the motion that the body really makes, delayed by the gyro's mean delay instead of filtered by its low-pass."""
    return SensorKernel.of(False, None, lag_s)._replace(latency_s=gyro.delay_s)


class KernelEffect(NamedTuple):
    """Difference between the mean reading of a cycle's records and the mean motion over the cycle.

    With C the angular acceleration that is not commanded, the gyro's mean exceeds the mean rate by
    ``curvature_s2`` (C(end) − C(begin)) / T. ``curvature_s2`` is σ² / 2 for a low-pass with impulse-response variance σ². Samples at
    spacing h add −h² / 24 (Euler–Maclaurin formula).
    """

    curvature_s2: float
    later_s: float
    """Time by which the motion that the accelerometer records is later than the motion that the gyro records, s."""
    smearing_s2: float
    """``curvature_s2`` of the accelerometer: its mean exceeds the mean gravity by this times gravity's second derivative, s²."""


def kernel_effect(log: Recorder, vehicle: Vehicle) -> KernelEffect | None:
    """Effect of both sensor kernels; None if both sensors record means without low-pass and latency."""
    kernels = sensors(log, vehicle)
    if all(each.plain for each in kernels):
        return None
    sampled_s2 = float(np.mean(log.interval_s)) ** 2 / 24
    gyro, accelerometer = (sensor.variance_s2 / 2 - sampled_s2 * sensor.instant for sensor in kernels)
    offset_s = motion_offset_s(log, vehicle)
    return KernelEffect(gyro, offset_s[1] - offset_s[0], accelerometer)


def motion_offset_s(log: Recorder, vehicle: Vehicle) -> tuple[float, float]:
    """Time from a cycle's label to the motion that gyro and accelerometer record, s.

    Samples at the ends of records add half a record; low-pass and latency subtract their mean delay.
    """
    half_s = float(np.mean(log.interval_s)) / 2
    gyro, accelerometer = (half_s * one.instant - one.delay_s for one in sensors(log, vehicle))
    return gyro, accelerometer


class SensedSignal(NamedTuple):
    """A signal after a sensor's low-pass and dead time, at Q times."""

    value: Array
    """(Q,) the signal."""
    first: Array
    """(Q,) its integral."""
    second: Array
    """(Q,) its second integral."""


def sensed(signal: Signal, sensor: SensorKernel, time_s: Array) -> SensedSignal:
    """Signal after the low-pass and dead time of a sensor, at ascending times (Q,)."""
    at = time_s - sensor.latency_s
    if (library := kernel().library) is not None:
        course = signal.course
        events = np.stack([course.time_s, course.level, course.slope, course.first, course.second])
        lags, filtered = np.stack([sensor.weights, sensor.lags_s], 1), np.empty((3, len(at)))
        numbers = lags.view(float) if len(lags) else None
        call(library.mp_host_shown, events.shape[1], events, len(at), at, len(lags), numbers, np.array([ROUNDED_S]), filtered)
        return SensedSignal(*filtered)
    course, index = signal.with_events_at(at, ROUNDED_S)
    value, first, second = (part[index] for part in (course.level, course.first, course.second))
    lags, weights = sensor.lags_s[:, None], sensor.weights[:, None]
    if not len(lags):
        return SensedSignal(value, first, second)
    lagged = weights * course.lagged(lags)[:, index]
    value, by_first, by_second = ((lags**order * lagged).sum(0).real for order in range(3))
    return SensedSignal(value, first - by_first, second - (weights * lags).sum().real * first + by_second)
