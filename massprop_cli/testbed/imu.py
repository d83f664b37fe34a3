"""Simulated IMU (mounting, bias, white noise, low-pass, range, quantisation) and simulated attitude log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from massprop_cli.base.arrays import TINY, Array, frozen
from massprop_cli.inputs.equipment import LowPass
from massprop_cli.testbed.motion import apply, compose, dot, quaternions
from massprop_cli.testbed.scenario import Scenario


@dataclass
class RecordKernel:
    """Response of a sensor within a record: Butterworth low-pass as parallel lags, then a sample or a mean."""

    instant: bool
    """True if records are samples at their ends, False if they are means."""
    lags_s: list[complex]
    """Time constants, s."""
    weights: list[complex]
    """Weights of the lags."""
    _states: list[Array] = field(default_factory=list)

    @staticmethod
    def of(instant: bool, low_pass: LowPass | None) -> RecordKernel | None:
        """Kernel of a sensor; None for means without a low-pass."""
        if low_pass is None:
            return RecordKernel(True, [], []) if instant else None
        tau = 1 / (2 * np.pi * low_pass.cutoff)
        if low_pass.order == 1:
            return RecordKernel(instant, [tau], [1.0])
        lags = [tau * (1 + 1j) / np.sqrt(2), tau * (1 - 1j) / np.sqrt(2)]
        return RecordKernel(instant, lags, [lags[0] / (lags[0] - lags[1]), lags[1] / (lags[1] - lags[0])])

    def records(self, begin: Array, end: Array, width_s: float) -> Array:
        """(3, S, N) recorded values of a signal that is linear in each of B bins of N records, from ``begin`` to ``end`` (3, S, N, B).

        The signal is constant before the first record.
        """
        if not self.lags_s:
            return end[..., -1]
        if not self._states:
            self._states = [begin[..., 0, 0].astype(complex) for _ in self.lags_s]
        recorded = np.empty(begin.shape[:3])
        for record in range(begin.shape[2]):
            area = np.zeros(begin.shape[:2])
            for b in range(begin.shape[3]):
                first, last = begin[..., record, b], end[..., record, b]
                area += (first + last) / 2 * width_s
                for i, (lag, weight) in enumerate(zip(self.lags_s, self.weights, strict=True)):
                    rest = -np.expm1(-width_s / lag)
                    now = self._states[i] * (1 - rest) + first * rest + (last - first) / width_s * (width_s - lag * rest)
                    area -= (weight * lag * (now - self._states[i])).real
                    self._states[i] = now
            sample = np.sum([weight * state for weight, state in zip(self.weights, self._states, strict=True)], 0).real
            recorded[..., record] = sample if self.instant else area / (begin.shape[3] * width_s)
        return recorded


@dataclass
class Sensor:
    """Gyro or accelerometer of all members: converts mean rates in body axes to logged increments in IMU axes."""

    imu_from_body: Array
    """(3, 3) rotation from body to IMU axes."""
    noise: Array
    """(3, S, K, N) noise of each record's mean, IMU axes."""
    bias: Array
    """(3,) bias, IMU axes."""
    limit: float | None
    """Range, per second."""
    quantum: float
    """Smallest increment."""
    record_s: float
    """Length of a record, s."""
    kept: float = 0.0
    """Decay factor exp(−T / τ) of the record-wise low-pass."""
    response: RecordKernel | None = None
    """Kernel of records that are not plain means."""
    increments: Array = field(init=False)
    """(3, S, K, N) logged increments, IMU axes."""

    def __post_init__(self) -> None:
        self.increments = np.zeros_like(self.noise)
        self._remainder = np.zeros(self.noise.shape[:2])
        self._last: Array | None = None

    def sense(self, cycles: slice, mean: Array, jump: Array | float = 0.0) -> Array:
        """Log cycles whose records have true values ``mean`` (3, S, N), body axes; return the (3, S) sum of their increments.

        ``jump``: (3, S) step of the integrated quantity in the first record.
        """
        reading: Array = apply(self.imu_from_body[..., None, None], mean) + self.bias[:, None, None]
        reading += self.noise[:, :, cycles].reshape(reading.shape)
        if np.ndim(jump):
            reading[..., 0] += apply(self.imu_from_body[..., None], np.asarray(jump)) / self.record_s
        if self.kept > 0:
            reading = self._lowpassed(reading)
        if self.limit is not None:
            reading = np.clip(reading, -self.limit, self.limit)
        step = reading * self.record_s
        if self.quantum > 0:
            # integrating sensors carry the quantisation remainder into the next record
            whole = np.round((self._remainder[..., None] + np.cumsum(step, -1)) / self.quantum) * self.quantum
            exact = self._remainder + step.sum(-1)
            step = np.diff(whole, axis=-1, prepend=0.0)
            self._remainder = exact - whole[..., -1]
        self.increments[:, :, cycles] = step.reshape(*step.shape[:2], -1, self.increments.shape[-1])
        return np.asarray(step.sum(-1))

    def _lowpassed(self, reading: Array) -> Array:
        """(3, S, N) records after a first-order low-pass, which starts in steady state at the first record."""
        filtered = np.empty_like(reading)
        last: Array = reading[..., 0] if self._last is None else self._last
        for k in range(reading.shape[-1]):
            filtered[..., k] = self.kept * last + (1 - self.kept) * reading[..., k]
            last = filtered[..., k]
        self._last = last
        return filtered


def gyro(scenario: Scenario, rngs: list[np.random.Generator]) -> Sensor:
    """Gyro of the scenario; increments in rad."""
    stated, real = scenario.vehicle.imu, scenario.sensors
    sigma = stated.gyro_noise_rad_s if real.gyro_noise_rad_s is None else real.gyro_noise_rad_s
    limits = stated.gyro_range_rad_s, real.gyro_quantum_rad
    found = _sensor(scenario, rngs, sigma or 0.0, real.gyro_bias_rad_s, (stated.gyro_lag_s, stated.gyro_filter), *limits)
    walk = stated.gyro_bias_walk_rad_s_sqrt_s if real.gyro_bias_walk_rad_s_sqrt_s is None else real.gyro_bias_walk_rad_s_sqrt_s
    if walk > 0:
        steps = np.stack([rng.standard_normal((3, found.noise[0, 0].size)) for rng in rngs], 1)
        found.noise += walk * found.record_s**0.5 * np.cumsum(steps, -1).reshape(found.noise.shape)
    return found


def accelerometer(scenario: Scenario, rngs: list[np.random.Generator]) -> Sensor:
    """Accelerometer of the scenario; increments in m/s."""
    stated, real = scenario.vehicle.imu, scenario.sensors
    sigma = stated.accel_noise_m_s2 if real.accel_noise_m_s2 is None else real.accel_noise_m_s2
    limits = stated.accel_range_m_s2, real.accel_quantum_m_s
    return _sensor(scenario, rngs, sigma or 0.0, real.accel_bias_m_s2, (stated.accel_lag_s, stated.accel_filter), *limits)


def _sensor(
    scenario: Scenario,
    rngs: list[np.random.Generator],
    sigma: float,
    bias: tuple[float, ...],
    slow: tuple[float, LowPass | None],
    limit: float | None,
    quantum: float,
) -> Sensor:
    records = scenario.sensors.records_per_cycle
    record_s = scenario.vehicle.cycle.period_s / records
    shape = (scenario.cycles, records, 3)
    # sigma is of a cycle's mean; a record's sigma is larger by the root of the records per cycle
    noise = np.stack([rng.standard_normal(shape) * (sigma * np.sqrt(records)) for rng in rngs])
    return Sensor(
        imu_from_body=np.array(scenario.vehicle.imu.body_from_imu).T,
        noise=np.ascontiguousarray(np.moveaxis(noise, -1, 0)),
        bias=np.array(bias),
        limit=limit,
        quantum=quantum,
        record_s=record_s,
        kept=float(np.exp(-record_s / slow[0])) if slow[0] > 0 else 0.0,
        response=RecordKernel.of(scenario.vehicle.imu.measures == "sample", slow[1]),
    )


def logged_attitude(scenario: Scenario, rngs: Sequence[np.random.Generator], true_wxyz: Array) -> Array | None:
    """(S, K N, 4) logged attitude at the end of each record, NaN if not logged; None if the scenario logs no attitude.

    ``true_wxyz``: (S, K N + 1, 4) true attitude at the start and at the end of each record, with constant rate in between.
    """
    sensors, stated = scenario.sensors, scenario.vehicle.imu
    if not sensors.log_attitude:
        return None
    latency_s = stated.attitude_latency if sensors.attitude_latency_s is None else sensors.attitude_latency_s
    sigma = stated.attitude_sigma_rad if sensors.attitude_noise_rad is None else sensors.attitude_noise_rad
    records = true_wxyz.shape[1] - 1
    late = np.arange(1, records + 1) - latency_s * sensors.records_per_cycle / scenario.vehicle.cycle.period_s
    delayed = _interpolated(np.moveaxis(true_wxyz, -1, 0), np.maximum(late, 0.0))
    noise = np.stack([rng.standard_normal((records, 3)) for rng in rngs]) * (sigma or 0.0)
    misaligned = compose(delayed, quaternions(np.array(sensors.attitude_misalignment_rad))[:, None, None])
    logged = np.moveaxis(compose(misaligned, quaternions(np.moveaxis(noise, -1, 0))), 0, -1)
    logged[:, np.arange(1, records + 1) % sensors.attitude_every_records > 0] = np.nan
    logged[:, late < 0] = np.nan
    return frozen(logged)


def _interpolated(attitude: Array, at: Array) -> Array:
    """(4, S, m) attitudes (4, S, n) interpolated at fractional indices ``at`` (m,)."""
    before = np.minimum(at.astype(int), attitude.shape[2] - 2)
    first, second = attitude[..., before], attitude[..., before + 1]
    turn = compose(first * np.array([1.0, -1.0, -1.0, -1.0])[:, None, None], second)
    turn = turn * np.where(turn[0] < 0, -1.0, 1.0)
    sine = np.sqrt(dot(turn[1:], turn[1:]))
    angle = 2 * np.arctan2(sine, turn[0])
    vector = turn[1:] * np.where(sine > 0, angle / np.maximum(sine, TINY), 2.0)
    return compose(first, quaternions(vector * (at - before)))
