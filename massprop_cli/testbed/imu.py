"""The IMU as it really is: mounting, bias, white noise, low-pass, range, quantised increments; and the attitude logged beside it."""

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
    """How a sensor answers within a record: a Butterworth low-pass as lags in parallel, and whether it is read off at records' ends."""

    instant: bool
    lags_s: list[complex]
    weights: list[complex]
    _states: list[Array] = field(default_factory=list)

    @staticmethod
    def of(instant: bool, low_pass: LowPass | None) -> RecordKernel | None:
        """None for means over records."""
        if low_pass is None:
            return RecordKernel(True, [], []) if instant else None
        tau = 1 / (2 * np.pi * low_pass.cutoff)
        if low_pass.order == 1:
            return RecordKernel(instant, [tau], [1.0])
        lags = [tau * (1 + 1j) / np.sqrt(2), tau * (1 - 1j) / np.sqrt(2)]
        return RecordKernel(instant, lags, [lags[0] / (lags[0] - lags[1]), lags[1] / (lags[1] - lags[0])])

    def records(self, begin: Array, end: Array, width_s: float) -> Array:
        """(3, S, N) of what grows from ``begin`` to ``end`` (3, S, N, B) in each of the bins of N records; at rest before the first."""
        if not self.lags_s:
            return end[..., -1]
        if not self._states:
            self._states = [begin[..., 0, 0].astype(complex) for _ in self.lags_s]
        found = np.empty(begin.shape[:3])
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
            shown = np.sum([weight * state for weight, state in zip(self.weights, self._states, strict=True)], 0).real
            found[..., record] = shown if self.instant else area / (begin.shape[3] * width_s)
        return found


@dataclass
class Sensor:
    """A gyro or an accelerometer of all members: mean rates in body axes to increments in IMU axes."""

    imu_from_body: Array
    """(3, 3)"""
    noise: Array
    """(3, S, K, N) of a record's mean, IMU axes."""
    bias: Array
    """(3,) IMU axes."""
    limit: float | None
    """Range, per second."""
    quantum: float
    """Smallest increment."""
    record_s: float
    kept: float = 0.0
    """What its low-pass keeps of a record in the next."""
    response: RecordKernel | None = None
    """Where its records are no means."""
    increments: Array = field(init=False)
    """(3, S, K, N) what is logged, IMU axes."""

    def __post_init__(self) -> None:
        self.increments = np.zeros_like(self.noise)
        self._left = np.zeros(self.noise.shape[:2])
        self._last: Array | None = None

    def sense(self, cycles: slice, mean: Array, jump: Array | float = 0.0) -> Array:
        """Log cycles from (3, S, N) what their records show, ``jump`` (3, S) on top of the first; the sum of their increments, (3, S)."""
        seen: Array = apply(self.imu_from_body[..., None, None], mean) + self.bias[:, None, None]
        seen += self.noise[:, :, cycles].reshape(seen.shape)
        if np.ndim(jump):
            seen[..., 0] += apply(self.imu_from_body[..., None], np.asarray(jump)) / self.record_s
        if self.kept > 0:
            seen = self._lowpassed(seen)
        if self.limit is not None:
            seen = np.clip(seen, -self.limit, self.limit)
        step = seen * self.record_s
        if self.quantum > 0:
            # what a count does not hold is carried over, as integrating sensors do
            whole = np.round((self._left[..., None] + np.cumsum(step, -1)) / self.quantum) * self.quantum
            exact = self._left + step.sum(-1)
            step = np.diff(whole, axis=-1, prepend=0.0)
            self._left = exact - whole[..., -1]
        self.increments[:, :, cycles] = step.reshape(*step.shape[:2], -1, self.increments.shape[-1])
        return np.asarray(step.sum(-1))

    def _lowpassed(self, seen: Array) -> Array:
        """(3, S, N) records of a cycle after a first-order low-pass, which began at rest with the first."""
        found = np.empty_like(seen)
        last: Array = seen[..., 0] if self._last is None else self._last
        for k in range(seen.shape[-1]):
            found[..., k] = self.kept * last + (1 - self.kept) * seen[..., k]
            last = found[..., k]
        self._last = last
        return found


def gyro(scenario: Scenario, rngs: list[np.random.Generator]) -> Sensor:
    """The scenario's gyro, rad."""
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
    """The scenario's accelerometer, m/s."""
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
    # sigma is that of a cycle's mean: a record's is larger by the root of their number
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
    """(S, K N, 4) after each record, NaN where none is logged; None where the scenario logs none.

    ``true_wxyz`` (S, K N + 1, 4) is the attitude at the start and after each record; between two of them the body turns at a steady rate.
    """
    sensors, stated = scenario.sensors, scenario.vehicle.imu
    if not sensors.log_attitude:
        return None
    latency_s = stated.attitude_latency if sensors.attitude_latency_s is None else sensors.attitude_latency_s
    sigma = stated.attitude_sigma_rad if sensors.attitude_noise_rad is None else sensors.attitude_noise_rad
    records = true_wxyz.shape[1] - 1
    late = np.arange(1, records + 1) - latency_s * sensors.records_per_cycle / scenario.vehicle.cycle.period_s
    found = _between(np.moveaxis(true_wxyz, -1, 0), np.maximum(late, 0.0))
    noise = np.stack([rng.standard_normal((records, 3)) for rng in rngs]) * (sigma or 0.0)
    turned = compose(found, quaternions(np.array(sensors.attitude_misalignment_rad))[:, None, None])
    seen = np.moveaxis(compose(turned, quaternions(np.moveaxis(noise, -1, 0))), 0, -1)
    seen[:, np.arange(1, records + 1) % sensors.attitude_every_records > 0] = np.nan
    seen[:, late < 0] = np.nan
    return frozen(seen)


def _between(attitude: Array, at: Array) -> Array:
    """(4, S, m) of attitudes (4, S, n) at places ``at`` (m,) among them, which need not be whole."""
    before = np.minimum(at.astype(int), attitude.shape[2] - 2)
    first, second = attitude[..., before], attitude[..., before + 1]
    turn = compose(first * np.array([1.0, -1.0, -1.0, -1.0])[:, None, None], second)
    turn = turn * np.where(turn[0] < 0, -1.0, 1.0)
    sine = np.sqrt(dot(turn[1:], turn[1:]))
    angle = 2 * np.arctan2(sine, turn[0])
    vector = turn[1:] * np.where(sine > 0, angle / np.maximum(sine, TINY), 2.0)
    return compose(first, quaternions(vector * (at - before)))
