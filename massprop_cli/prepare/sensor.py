"""What a sensor records of commands: its kernel, a box or an instant, behind a low-pass and a dead time.

A record of an increment or a mean is the motion under a box, from the record before to its own time; a sample is the motion at its time.
Either may be behind a low-pass and late. All of this is linear and the same at any time, so it commutes with what is linear in the
commands: force and torque are taken as the sensor would have shown them. With the low-pass as lags in parallel,

    H(s) = Σ c_i / (1 + τ_i s),   Σ c_i = 1,    τ_i y_i' = u − y_i,

the signal and its integrals behind it are exact at any time (U' = u, V' = U, all zero before the first event):

    H u = Σ c_i y_i,   H U = U − Σ c_i τ_i y_i,   H V = V − U Σ c_i τ_i + Σ c_i τ_i² y_i
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, ComplexArray
from massprop_cli.inputs.equipment import LowPass
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.signal import Signal

APART = 1e-5
"""Part by which two lags differ at least: the same lag twice has no form in parallel, and this has its response to some millionths."""
FORGOTTEN = 1e-18
"""What a lag keeps that is below the last digit of anything."""
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
        tau = 0.0 if low_pass is None else 1 / (2 * np.pi * low_pass.cutoff)
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


def sensors(log: Log, vehicle: Vehicle, lag_s: float = 0.0) -> tuple[SensorKernel, SensorKernel]:
    """Gyro and accelerometer."""
    low_passes = vehicle.imu.gyro_filter, vehicle.imu.accel_filter
    gyro, accelerometer = (SensorKernel.of(instant, one, lag_s) for instant, one in zip(log.sampled, low_passes, strict=True))
    return gyro, accelerometer


class KernelEffect(NamedTuple):
    """Difference between the mean reading of a group of records and the mean motion over it.

    With C the angular acceleration that commands do not make, the gyro's mean exceeds the mean rate by
    ``curvature_s2`` (C(end) − C(begin)) / T. That is σ² / 2 for a low-pass whose delay has the variance σ², and −h² / 24 for samples
    that are h apart (Euler–Maclaurin formula).
    """

    curvature_s2: float
    later_s: float
    """By how much the motion that the accelerometer shows is later than the gyro's."""


def kernel_effect(log: Log, vehicle: Vehicle) -> KernelEffect | None:
    """The effect of both sensors' kernels; None where both record means without a low-pass."""
    own = sensors(log, vehicle)
    if all(each.plain for each in own):
        return None
    gyro, _ = own
    sampled_s = float(np.mean(log.interval_s)) * gyro.instant
    late = shown_late_s(log, vehicle)
    return KernelEffect(gyro.variance_s2 / 2 - sampled_s**2 / 24, late[1] - late[0])


def shown_late_s(log: Log, vehicle: Vehicle) -> tuple[float, float]:
    """By how much the motion that gyro and accelerometer show is later than cycles are labelled: samples at records' ends half a record."""
    half_s = float(np.mean(log.interval_s)) / 2
    gyro, accelerometer = (half_s * one.instant - one.delay_s for one in sensors(log, vehicle))
    return gyro, accelerometer


class Shown(NamedTuple):
    """A signal behind a sensor's low-pass at some times, and its integrals."""

    value: Array
    first: Array
    second: Array


def shown(signal: Signal, sensor: SensorKernel, time_s: Array) -> Shown:
    """A piecewise linear signal as a sensor has it in what it shows at times (Q,), its latency included."""
    order = np.argsort(signal.time_s, kind="stable")
    time, step, slope = signal.time_s[order], signal.step[order], signal.slope[order]
    if not len(time):
        return Shown(*np.zeros((3, len(time_s))))
    lasting = np.diff(time)
    rising = np.cumsum(slope)
    level = np.cumsum(step) + np.append(0.0, np.cumsum(rising[:-1] * lasting))
    grown = level[:-1] * lasting + rising[:-1] * lasting**2 / 2
    first = np.append(0.0, np.cumsum(grown))
    second = np.append(0.0, np.cumsum(first[:-1] * lasting + level[:-1] * lasting**2 / 2 + rising[:-1] * lasting**3 / 6))
    asked = time_s - sensor.latency_s
    at = np.searchsorted(time, asked - ROUNDED_S) - 1
    before, at = at < 0, np.maximum(at, 0)
    since = np.where(before, 0.0, asked - time[at])
    level_at, rising_at, first_at = level[at], rising[at], first[at]
    value = level_at + rising_at * since
    found = Shown(
        value,
        first_at + since * (level_at + rising_at * since / 2),
        second[at] + since * (first_at + since * (level_at / 2 + rising_at * since / 6)),
    )
    if len(sensor.lags_s):
        lags = sensor.lags_s[:, None]
        began = _at_events(level, rising, lasting, lags)
        kept = _kept(since, lags)
        lagged = began[:, at] * kept + _let_through(level_at, rising_at, since, lags, kept)
        weighted = sensor.weights[:, None] * lagged
        mean = float((sensor.weights * sensor.lags_s).sum().real)
        found = Shown(
            weighted.sum(0).real,
            found.first - (lags * weighted).sum(0).real,
            found.second - mean * found.first + (lags**2 * weighted).sum(0).real,
        )
    return Shown(*(np.where(before, 0.0, part) for part in found))


def _kept(for_s: Array, lags: ComplexArray) -> ComplexArray:
    """(P, Q) exp(−t / τ): real where all lags are; by sines and cosines NumPy is several times as fast as by its complex exponential."""
    by_second = 1 / lags
    size = np.exp(-for_s * by_second.real)
    if not by_second.imag.any():
        return size.astype(np.complex128)
    angle = for_s * by_second.imag
    found: ComplexArray = size * (np.cos(angle) - 1j * np.sin(angle))
    return found


def _let_through(level: Array, rising: Array, for_s: Array, lags: ComplexArray, kept: ComplexArray) -> ComplexArray:
    """(P, Q) what lags (P, 1) have come to, from zero, after signals that begin at a level and rise (Q,)."""
    rest = 1.0 - kept
    found: ComplexArray = level * rest
    return found + rising * (for_s - lags * rest) if rising.any() else found


def _at_events(level: Array, rising: Array, lasting: Array, lags: ComplexArray) -> ComplexArray:
    """(P, E) what each lag is at as each event comes: y[e + 1] = d[e] y[e] + f[e], with twice the reach in each pass."""
    during = _kept(lasting, lags)
    forced = _let_through(level[:-1], rising[:-1], lasting, lags, during)
    kept = np.concatenate([np.zeros_like(lags), during], 1)
    found = np.concatenate([np.zeros_like(lags), forced], 1)
    reach = 1
    while reach < found.shape[1] and np.abs(kept).max() > FORGOTTEN:
        found[:, reach:] += kept[:, reach:] * found[:, :-reach]
        kept[:, reach:] = kept[:, reach:] * kept[:, :-reach]
        kept[:, :reach] = 0.0
        reach *= 2
    return found
