"""What a sensor records of commands: its kernel, a box or an instant, behind a low-pass and a dead time.

A record of an increment or a mean is the motion under a box, from the record before to its own time; a sample is the motion at its time.
Either may be behind a low-pass and late. All of this is linear and the same at any time, so it commutes with what is linear in the
commands: force and torque are taken as the sensor would have shown them. With the low-pass as lags in parallel,

    H(s) = Σ c_i / (1 + τ_i s),   Σ c_i = 1,    τ_i y_i' = u − y_i,

the signal and its integrals behind it are exact at any time (U' = u, V' = U, all zero before the first event):

    H u = Σ c_i y_i,   H U = U − Σ c_i τ_i y_i,   H V = V − U Σ c_i τ_i + Σ c_i τ_i² y_i
"""

from __future__ import annotations

import ctypes
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from massprop_cli.base.arrays import Array, ComplexArray, IntArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.equipment import LowPass
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import LAGS, kernel, pointer
from massprop_cli.prepare.signal import Course, Signal

Lags = Array | ComplexArray
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


def kernel_effect(log: Recorder, vehicle: Vehicle) -> KernelEffect | None:
    """The effect of both sensors' kernels; None where both record means without a low-pass."""
    own = sensors(log, vehicle)
    if all(each.plain for each in own):
        return None
    gyro, _ = own
    sampled_s = float(np.mean(log.interval_s)) * gyro.instant
    late = shown_late_s(log, vehicle)
    return KernelEffect(gyro.variance_s2 / 2 - sampled_s**2 / 24, late[1] - late[0])


def shown_late_s(log: Recorder, vehicle: Vehicle) -> tuple[float, float]:
    """By how much the motion that gyro and accelerometer show is later than cycles are labelled: samples at records' ends half a record."""
    half_s = float(np.mean(log.interval_s)) / 2
    gyro, accelerometer = (half_s * one.instant - one.delay_s for one in sensors(log, vehicle))
    return gyro, accelerometer


@dataclass(frozen=True)
class Shown:
    """A signal behind a sensor's low-pass and dead time at some times, and its integrals, each computed as it is asked for."""

    signal: Signal
    sensor: SensorKernel
    time_s: Array
    """(Q,) in their order"""

    @cached_property
    def _compiled(self) -> tuple[Array, Array, Array] | None:
        """(Q,) each, the signal and both integrals by the compiled kernel, where that is there."""
        library = kernel().library
        if library is None or len(self.sensor.lags_s) > LAGS:
            return None
        course, at = self.signal.course, np.ascontiguousarray(self.time_s - self.sensor.latency_s)
        events = np.stack([course.time_s, course.level, course.rising, course.first, course.second])
        lags, found = np.stack([self.sensor.weights, self.sensor.lags_s], 1), np.empty((3, len(at)))
        sizes = [ctypes.c_long(n) for n in (events.shape[1], len(at), len(lags))]
        numbers = pointer(lags.view(float)) if len(lags) else None
        library.mp_host_shown(
            sizes[0], pointer(events), sizes[1], pointer(at), sizes[2], numbers, pointer(np.array([ROUNDED_S])), pointer(found)
        )
        return found[0], found[1], found[2]

    @property
    def value(self) -> Array:
        """(Q,) the signal."""
        if self._compiled is not None:
            return self._compiled[0]
        if len(self._lags):
            return self._begun(self._weighted.sum(0).real)
        course, at = self.signal.course, self._at
        return self._begun(course.level[at] + course.rising[at] * self._since)

    @cached_property
    def first(self) -> Array:
        """(Q,) its integral."""
        if self._compiled is not None:
            return self._compiled[1]
        return self._begun(self._first - (self._lags * self._weighted).sum(0).real if len(self._lags) else self._first)

    @property
    def second(self) -> Array:
        """(Q,) the integral of that."""
        if self._compiled is not None:
            return self._compiled[2]
        course, at, since = self.signal.course, self._at, self._since
        found = course.second[at] + since * (course.first[at] + since * (course.level[at] / 2 + course.rising[at] * since / 6))
        if len(self._lags):
            mean = float((self.sensor.weights * self.sensor.lags_s).sum().real)
            found = found - mean * self._first + (self._lags**2 * self._weighted).sum(0).real
        return self._begun(found)

    @cached_property
    def _place(self) -> IntArray:
        """Which event each time follows; -1: none."""
        return np.searchsorted(self.signal.course.time_s, self.time_s - self.sensor.latency_s - ROUNDED_S) - 1

    @cached_property
    def _at(self) -> IntArray:
        return np.maximum(self._place, 0)

    def _begun(self, found: Array) -> Array:
        return np.where(self._place < 0, 0.0, found)

    @cached_property
    def _since(self) -> Array:
        return np.where(self._place < 0, 0.0, self.time_s - self.sensor.latency_s - self.signal.course.time_s[self._at])

    @cached_property
    def _first(self) -> Array:
        """The integral before the low-pass."""
        course, at, since = self.signal.course, self._at, self._since
        return course.first[at] + since * (course.level[at] + course.rising[at] * since / 2)

    @cached_property
    def _lags(self) -> Lags:
        """(P, 1), real where all are: complex numbers take several times as long."""
        lags = self.sensor.lags_s[:, None]
        return lags if lags.imag.any() else lags.real

    @cached_property
    def _weighted(self) -> Lags:
        """(P, Q) what each lag is at, times its weight."""
        course, at, lags = self.signal.course, self._at, self._lags
        began, kept = _at_events(course, lags), _kept(self._since, lags)
        lagged = began[:, at] * kept + _let_through(course.level[at], course.rising[at], self._since, lags, kept)
        weights = self.sensor.weights[:, None]
        return (weights if np.iscomplexobj(lags) else weights.real) * lagged


def _kept(for_s: Array, lags: Lags) -> Lags:
    """(P, Q) exp(−t / τ); by sines and cosines NumPy is several times as fast as by its complex exponential."""
    by_second = 1 / lags
    size = np.exp(-for_s * by_second.real)
    if not np.iscomplexobj(lags):
        return size
    angle = for_s * by_second.imag
    return size * (np.cos(angle) - 1j * np.sin(angle))


def _let_through(level: Array, rising: Array, for_s: Array, lags: Lags, kept: Lags) -> Lags:
    """(P, Q) what lags (P, 1) have come to, from zero, after signals that begin at a level and rise (Q,)."""
    rest = 1.0 - kept
    found: Lags = level * rest
    return found + rising * (for_s - lags * rest) if rising.any() else found


def _at_events(course: Course, lags: Lags) -> Lags:
    """(P, E) what each lag is at as each event comes: y[e + 1] = d[e] y[e] + f[e], with twice the reach in each pass."""
    during = _kept(course.lasting_s, lags)
    forced = _let_through(course.level[:-1], course.rising[:-1], course.lasting_s, lags, during)
    kept = np.concatenate([np.zeros_like(lags), during], 1)
    found = np.concatenate([np.zeros_like(lags), forced], 1)
    reach = 1
    while reach < found.shape[1] and np.abs(kept).max() > FORGOTTEN:
        found[:, reach:] += kept[:, reach:] * found[:, :-reach]
        kept[:, reach:] = kept[:, reach:] * kept[:, :-reach]
        kept[:, :reach] = 0.0
        reach *= 2
    return found
