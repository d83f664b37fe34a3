"""What a sensor records of commands: its kernel, a box or an instant, behind a low-pass and a dead time.

A record of an increment or a mean is the motion under a box, from the record before to its own time; a sample is the motion at its time.
Either may be behind a low-pass and late. All of this is linear and the same at any time, so it commutes with what is linear in the
commands: force and torque are taken as the sensor would have shown them. With the low-pass as lags in parallel,

    H(s) = Σ c_i / (1 + τ_i s),   Σ c_i = 1,    τ_i y_i' = u − y_i,

the signal and its integrals behind it are exact at any time (U' = u, V' = U, all zero before the first event):

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
"""Part by which two lags differ at least: the same lag twice has no form in parallel, and this has its response to some millionths."""
ROUNDED_S = 1e-9
"""s, by which a sample is before what begins at its time: times are rounded, and a sample shows what went before."""


class SensorKernel(NamedTuple):
    """A kernel: of complex pairs of lags one stands for both, with twice its weight."""

    instant: bool
    """Whether a record is a sample, not a mean."""
    latency_s: float
    weights: ComplexArray
    """(P,) c."""
    lags_s: ComplexArray
    """(P,) τ."""

    @staticmethod
    def of(instant: bool, low_pass: LowPass | None, lag_s: float = 0.0) -> SensorKernel:
        """With a first-order lag of the thrust before it."""
        order, latency_s = (0, 0.0) if low_pass is None else (low_pass.order, low_pass.latency)
        tau = 1 / (2 * np.pi * low_pass.cutoff) if low_pass is not None and order else 0.0
        # Butterworth: of the second order the poles are at 45 degrees
        own = {0: [], 1: [tau], 2: [tau * (1 + 1j) / np.sqrt(2), tau * (1 - 1j) / np.sqrt(2)]}[order]
        if lag_s > 0:
            near = any(abs(lag_s - one) < APART * lag_s for one in own)
            own = [*own, lag_s * (1 + 2 * APART) if near else lag_s]
        lags = np.array(own, dtype=complex)
        weights = np.array([np.prod([one / (one - other) for other in lags if other != one]) for one in lags], dtype=complex)
        kept = lags.imag >= 0
        return SensorKernel(instant, latency_s, np.where(lags.imag > 0, 2, 1)[kept] * weights[kept], lags[kept])

    @property
    def plain(self) -> bool:
        """Whether it shows means, at once."""
        return not (self.instant or self.latency_s or len(self.lags_s))

    @property
    def delay_s(self) -> float:
        """By how much what it shows is late, in the mean."""
        return self.latency_s + float((self.weights * self.lags_s).sum().real)

    @property
    def variance_s2(self) -> float:
        """The variance of that delay, by the response of its low-pass."""
        mean, square = ((self.weights * self.lags_s**order).sum().real for order in (1, 2))
        return float(2 * square - mean**2)


class Recorder(Protocol):
    """What says how an IMU records: a log, or what takes its place."""

    @property
    def sampled(self) -> tuple[bool, bool]:
        """Whether gyro and accelerometer record samples, not means."""

    @property
    def interval_s(self) -> Array:
        """(n,) between records."""


def sensors(log: Recorder, vehicle: Vehicle, lag_s: float = 0.0) -> tuple[SensorKernel, SensorKernel]:
    """Gyro and accelerometer, with a first-order lag of the thrust before them."""
    low_passes = vehicle.imu.gyro_filter, vehicle.imu.accel_filter
    gyro, accelerometer = (SensorKernel.of(instant, one, lag_s) for instant, one in zip(log.sampled, low_passes, strict=True))
    return gyro, accelerometer


def moving(gyro: SensorKernel, lag_s: float = 0.0) -> SensorKernel:
    """By what the body is moved, as late as the gyro shows it in the mean."""
    return SensorKernel.of(False, None, lag_s)._replace(latency_s=gyro.delay_s)


class KernelEffect(NamedTuple):
    """Difference between the mean reading of a group of records and the mean motion over it.

    With C the angular acceleration that commands do not make, the gyro's mean exceeds the mean rate by
    ``curvature_s2`` (C(end) − C(begin)) / T. That is σ² / 2 for a low-pass whose delay has the variance σ², and −h² / 24 for samples
    that are h apart (Euler–Maclaurin formula).
    """

    curvature_s2: float
    later_s: float
    """By how much the motion that the accelerometer shows is later than the gyro's."""
    smearing_s2: float
    """The same as ``curvature_s2`` of the accelerometer: by so many times its second derivative the weight is shown otherwise."""


def kernel_effect(log: Recorder, vehicle: Vehicle) -> KernelEffect | None:
    """The effect of both sensors' kernels; None where both record means without a low-pass."""
    own = sensors(log, vehicle)
    if all(each.plain for each in own):
        return None
    sampled_s2 = float(np.mean(log.interval_s)) ** 2 / 24
    gyro, accelerometer = (sensor.variance_s2 / 2 - sampled_s2 * sensor.instant for sensor in own)
    late = shown_late_s(log, vehicle)
    return KernelEffect(gyro, late[1] - late[0], accelerometer)


def shown_late_s(log: Recorder, vehicle: Vehicle) -> tuple[float, float]:
    """By how much the motion that gyro and accelerometer show is later than cycles are labelled: samples at records' ends half a record."""
    half_s = float(np.mean(log.interval_s)) / 2
    gyro, accelerometer = (half_s * one.instant - one.delay_s for one in sensors(log, vehicle))
    return gyro, accelerometer


class Shown(NamedTuple):
    """(Q,) a signal behind a sensor's low-pass and dead time, and its integrals."""

    value: Array
    first: Array
    second: Array


def shown(signal: Signal, sensor: SensorKernel, time_s: Array) -> Shown:
    """At times (Q,) in their order."""
    at = time_s - sensor.latency_s
    if (library := kernel().library) is not None:
        course = signal.course
        events = np.stack([course.time_s, course.level, course.rising, course.first, course.second])
        lags, found = np.stack([sensor.weights, sensor.lags_s], 1), np.empty((3, len(at)))
        numbers = lags.view(float) if len(lags) else None
        call(library.mp_host_shown, events.shape[1], events, len(at), at, len(lags), numbers, np.array([ROUNDED_S]), found)
        return Shown(*found)
    course, place = signal.through(at, ROUNDED_S)
    value, first, second = (part[place] for part in (course.level, course.first, course.second))
    lags, weights = sensor.lags_s[:, None], sensor.weights[:, None]
    if not len(lags):
        return Shown(value, first, second)
    lagged = weights * course.lagged(lags)[:, place]
    value, by_first, by_second = ((lags**order * lagged).sum(0).real for order in range(3))
    return Shown(value, first - by_first, second - (weights * lags).sum().real * first + by_second)
