"""Speeds of wheels and rotors and angles of gimbals at their knots; wheel speeds from late, averaged, quantised, noisy tachometer readings.

A speed is linear between knots. Knots are at the ends of records, or at the torque steps a fixed time after them. A reading is the mean
speed over a window that ends a latency before its time. With Ω the speeds at the knots, readings r = H Ω + noise of variance s², and Ω a
random walk of step variance q taken from the readings, the estimate is the conditional mean
``(Hᵀ H / s² + Dᵀ D / q) Ω = Hᵀ r / s²``, D the difference operator. s is small, so this inverts H; the covariance of the errors follows.

A speed error e is also in the regressors. It biases inertia and lever arm about each axis by its variance over the variance of the
motion (errors in variables). massprop subtracts ``E[e | speed differences of all wheels nearby]`` (regression calibration; Carroll et
al., Measurement Error in Nonlinear Models, 2006, chapter 4). The remaining error is uncorrelated with these differences. The covariance
of e with the differences follows from the model, and that of the differences from the log.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, frozen
from massprop_cli.inputs.actuators.control_moment_gyro import ControlMomentGyro, GyroLog
from massprop_cli.inputs.actuators.wheel import Wheel, WheelLog
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle

NEARBY = 8
"""Cycles before and after whose speed differences predict an error; about the time in which a control loop restores the rate."""
MAX_ERROR_SIGMAS = 4.0
"""Sigmas beyond which a predicted speed error is discarded."""
PADDING = 200
"""Number of additional readings that keep the error response away from the ends of the log."""
TRUSTED, FINER, CURVED = 1e-5, 0.2, 0.1
"""Standard deviation s of the fit to readings: as a fraction of the rms step between readings, and of a reading's sigma. For rotors, whose
speed is curved between knots, as a fraction of the rms step."""


class _Speeds(NamedTuple):
    """Speeds of one wheel at its knots."""

    place: int
    """Index of the wheel among the momentum devices."""
    log: WheelLog
    values: Array
    """(n,) speeds at the knots, with the initial speed first if the log has one, rad/s."""
    covariance: Array
    """(L,) autocovariance of their errors by records apart, (rad/s)²."""
    after_s: float
    """Time of the knots after the ends of records, s."""


def at_knots(log: Log, vehicle: Vehicle) -> Log:
    """The log with speeds and gimbal angles at their knots: at the ends of records (rotors: of cycles), or at torque steps after them."""
    log = _with_gimbal_angles(_with_rotor_speeds(log, vehicle), vehicle)
    wheels = _wheel_speeds(log, vehicle)
    if not wheels:
        return log
    values = calibrated([wheel.values for wheel in wheels], [wheel.covariance for wheel in wheels], log.records_per_cycle)
    spinning = list(log.spinning)
    for wheel, speed in zip(wheels, values, strict=True):
        has_start = wheel.log.start_rad_s is not None
        start = float(speed[0]) if has_start else None
        resampled = replace(wheel.log, speed_rad_s=frozen(speed[int(has_start) :]), start_rad_s=start)
        spinning[wheel.place] = replace(resampled, corrected=True, after_s=wheel.after_s)
    return replace(log, spinning=tuple(spinning))


def _with_gimbal_angles(log: Log, vehicle: Vehicle) -> Log:
    """The log with gimbal angles at the times where gimbal rates step."""
    if not any(gyro.gimbal_steps_s for gyro in vehicle.control_moment_gyros):
        return log
    spinning, end_s = list(log.spinning), np.append(log.time_s[0] - log.interval_s[0], log.time_s)
    for place, (gyro, gyro_log) in enumerate(zip(vehicle.spinning, spinning, strict=True)):
        if not (isinstance(gyro, ControlMomentGyro) and isinstance(gyro_log, GyroLog)) or not gyro.gimbal_steps_s or gyro_log.after_s:
            continue
        angle = at_times(end_s + gyro.gimbal_steps_s, gyro_log.angle_rad, gyro.gimbal_steps_s, 0.0, TRUSTED**2)[1:]
        spinning[place] = replace(gyro_log, angle_rad=frozen(angle), after_s=gyro.gimbal_steps_s)
    return replace(log, spinning=tuple(spinning))


def _with_rotor_speeds(log: Log, vehicle: Vehicle) -> Log:
    """The log with rotor speeds at the times where rotor torques step."""
    bends_s = tuple(rotor.torque_steps_s or 0.0 for rotor in vehicle.rotors)
    if not any(bends_s) or log.bends_s:
        return log
    speeds, end_s = log.command.copy(), log.cycle_end_s
    for column, after_s in zip(speeds.T, bends_s, strict=True):
        if after_s:
            column[:] = at_times(end_s + after_s, column, after_s, 0.0, CURVED**2)
    return replace(log, command=frozen(speeds), bends_s=bends_s)


def change_sigmas(log: Log, vehicle: Vehicle) -> Array:
    """(devices,) sigma of the calibrated speed's change over a cycle, rad/s; 0 for exact speeds and devices without a logged speed."""
    sigmas = np.zeros(len(log.spinning))
    wheels = [wheel for wheel in _wheel_speeds(log, vehicle) if wheel.covariance[0] > 0]
    scaled = [_by_cycle(wheel.values, wheel.covariance, log.records_per_cycle) for wheel in wheels]
    if wheels and len(scaled[0][0]) > 2 * NEARBY:
        sigmas[[wheel.place for wheel in wheels]] = _gain(*_stacked(scaled))[1] * [size for _, size, _ in scaled]
    return sigmas


def _wheel_speeds(log: Log, vehicle: Vehicle) -> list[_Speeds]:
    """Speeds at the knots of each wheel whose readings are late, averaged or noisy and not yet corrected."""
    speeds, time_s = [], np.append(log.time_s[0] - log.interval_s[0], log.time_s)
    for place, (wheel, wheel_log) in enumerate(zip(vehicle.spinning, log.spinning, strict=True)):
        if not (isinstance(wheel, Wheel) and isinstance(wheel_log, WheelLog)) or wheel_log.speed_rad_s is None or wheel_log.corrected:
            continue
        has_start, after_s = wheel_log.start_rad_s is not None, wheel.torque_steps_s or 0.0
        logged = np.append([wheel_log.start_rad_s] * has_start, wheel_log.speed_rad_s).astype(float)
        readings, variance, _ = wheel.dequantised_speed(logged)
        sigma, late = float(np.sqrt(variance.mean())), (wheel.speed_latency_s + after_s, wheel.speed_window_s)
        if sigma == 0 and not any(late):
            continue
        walk = float(np.mean(np.diff(readings) ** 2)) if len(readings) > 1 else 0.0
        noise = max(TRUSTED**2, (FINER * sigma) ** 2 / walk) if walk else 1.0
        values = at_times(time_s + after_s, readings, *late, noise)[int(not has_start) :] if any(late) and walk else readings
        lags = 2 * (NEARBY + 1) * log.records_per_cycle
        covariance = sigma**2 * _error_autocovariance(float(np.median(log.interval_s)), *late, noise, lags)
        speeds.append(_Speeds(place, wheel_log, values, covariance, after_s))
    return speeds


def _error_autocovariance(step_s: float, latency_s: float, window_s: float, noise: float, lags: int) -> Array:
    """(lags,) autocovariance of the errors of :func:`at_times` from independent readings of variance 1."""
    response = np.eye(1, PADDING + 2 * lags, PADDING // 2 + lags)[0]
    if latency_s + window_s > 0:
        response = at_times(step_s * np.arange(len(response)), response, latency_s, window_s, noise)
    return np.correlate(response, response, "full")[len(response) - 1 :][:lags]


def at_times(time_s: Array, readings: Array, latency_s: float, window_s: float, noise: float) -> Array:
    """(n,) speeds at ``time_s`` (n,) from readings (m,) at the last m of these times.

    A reading is the mean over a window that ends ``latency_s`` before. ``noise``: variance of a reading over that of a random-walk step.
    """
    from scipy.linalg import solveh_banded

    step_s, count = float(np.median(np.diff(time_s))), len(readings)
    before = int(np.ceil((latency_s + window_s) / step_s)) + 1
    knot_s = np.append(time_s[0] + step_s * np.arange(-before, 0), time_s)
    read_s, first = time_s[len(time_s) - count :], len(knot_s) - count
    weights = [_weight(knot_s, first - back, read_s - latency_s, window_s) for back in range(before + 1)]
    banded, right = np.zeros((before + 1, len(knot_s))), np.zeros(len(knot_s))
    for back, weight in enumerate(weights):
        right[first - back : len(knot_s) - back] += weight * readings / noise
        for further in range(back, before + 1):
            banded[further - back, first - further : len(knot_s) - further] += weight * weights[further] / noise
    banded[0, 1:] += 1.0
    banded[0, :-1] += 1.0
    banded[1, :-1] -= 1.0
    return np.asarray(solveh_banded(banded, right, lower=True)[before:])


def _weight(knot_s: Array, first: int, end_s: Array, window_s: float) -> Array:
    """(m,) weight of the speed at each of m knots from ``first`` on in the mean over a window that ends at ``end_s`` (m,).

    The weight is the knot's linear interpolation (hat) function, or its mean over the window.
    """
    step = np.diff(knot_s)
    padded = np.concatenate([step[:1], step, step[-1:]])
    knots = slice(first, first + len(end_s))
    at_s, left, right = knot_s[knots], padded[:-1][knots], padded[1:][knots]

    def fractions(to_s: Array) -> tuple[Array, Array]:
        return np.clip((to_s - at_s + left) / left, 0.0, 1.0), np.clip((to_s - at_s) / right, 0.0, 1.0)

    def integral(to_s: Array) -> Array:
        up, down = fractions(to_s)
        return left * up**2 / 2 + right * (down - down**2 / 2)

    if window_s == 0:
        up, down = fractions(end_s)
        return up - down
    return (integral(end_s) - integral(end_s - window_s)) / window_s


_ByCycle = tuple[Array, float, Array]
"""(K,) cycle means of speeds over the sigma of their errors; that sigma; (2 N + 1,) correlation of the errors by cycles apart."""


def calibrated(speeds: Sequence[Array], covariances: Sequence[Array], per_cycle: int = 1) -> list[Array]:
    """(n,) speeds of each wheel less the error predicted from the speed differences of all wheels (regression calibration).

    ``covariances``: (L,) autocovariance of each wheel's errors by records apart; speeds without errors stay unchanged. A cycle has
    ``per_cycle`` speeds, and the last cycle ends with the last speed.
    """
    noisy = [n for n, covariance in enumerate(covariances) if covariance[0] > 0 and len(speeds[n]) > 2 * NEARBY * per_cycle]
    corrected = list(speeds)
    if not noisy:
        return corrected
    scaled = [_by_cycle(speeds[n], covariances[n], per_cycle) for n in noisy]
    means, correlation = _stacked(scaled)
    gain, _ = _gain(means, correlation)
    errors = np.concatenate([window @ gain for window in _windows(means)])
    errors[np.abs(errors) > MAX_ERROR_SIGMAS] = 0.0  # an unusual motion, for example at the ends of the log
    for error, (_, size, _), n in zip(errors.T, scaled, noisy, strict=True):
        cycle = (np.arange(len(speeds[n])) - len(speeds[n])) // per_cycle + len(means)
        corrected[n] = speeds[n] - size * error[np.maximum(cycle, 0)]
    return corrected


def _by_cycle(speeds: Array, covariance: Array, per_cycle: int) -> _ByCycle:
    count = len(speeds) // per_cycle
    means = speeds[len(speeds) - count * per_cycle :].reshape(count, per_cycle).mean(1)
    lag = np.arange(2 * NEARBY + 1)[:, None, None] * per_cycle + np.arange(per_cycle)[:, None] - np.arange(per_cycle)
    by_cycle = covariance[np.abs(lag)].mean((1, 2))
    size = float(np.sqrt(by_cycle[0]))
    return means / size, size, by_cycle / by_cycle[0]


def _stacked(scaled: Sequence[_ByCycle]) -> tuple[Array, Array]:
    """(K, w) scaled cycle means and (w, 2 N + 1) error correlations of w wheels, for the cycles that all wheels have."""
    count = min(len(values) for values, _, _ in scaled)
    return np.stack([values[len(values) - count :] for values, _, _ in scaled], 1), np.stack([one for _, _, one in scaled])


def _gain(means: Array, correlation: Array) -> tuple[Array, Array]:
    """(2 N w, w) gain of E[e | differences], and (w,) sigma of the remaining error of e's change, for means (K, w) with error sigma 1.

    The covariance of the differences is limited from below by the covariance of their errors.
    """
    wheels, inner = means.shape[1], range(NEARBY, len(means) - NEARBY)
    products, at = np.zeros((2 * NEARBY * wheels, 2 * NEARBY * wheels)), 0
    for window in _windows(means):
        used = window[max(inner.start - at, 0) : max(inner.stop - at, 0)]
        products, at = products + used.T @ used, at + len(window)
    identity = np.eye(wheels)
    place = np.arange(2 * NEARBY)
    lag = place[:, None] - place
    per_wheel = 2 * correlation[:, np.abs(lag)] - correlation[:, np.abs(lag + 1)] - correlation[:, np.abs(lag - 1)]
    error_covariance = np.einsum("wij,wv->iwjv", per_wheel, identity).reshape(products.shape)
    root = np.linalg.inv(np.linalg.cholesky(error_covariance))
    values, axes = np.linalg.eigh(root @ (products / max(len(inner), 1)) @ root.T)
    whitening = axes.T @ root
    now, before = (
        np.einsum("wi,wv->iwv", correlation[:, np.abs(k - place)] - correlation[:, np.abs(k + 1 - place)], identity).reshape(-1, wheels)
        for k in (NEARBY - 1, NEARBY - 2)
    )
    explained = (whitening @ (now - before)) ** 2 / np.maximum(values, 1.0)[:, None]
    remaining = 2 * (1 - correlation[:, 1]) - explained.sum(0)
    return whitening.T @ (whitening @ now / np.maximum(values, 1.0)[:, None]), np.sqrt(np.maximum(remaining, 0.0))


def _windows(means: Array) -> Iterator[Array]:
    """Parts (m, 2 N w) of the windows of N differences before and N after each of the means (K, w), zero beyond the log."""
    steps = np.zeros((len(means) + 2 * NEARBY - 1, means.shape[1]))
    steps[NEARBY : NEARBY + len(means) - 1] = np.diff(means, axis=0)
    for part in spill.parts(len(means)):
        windows = np.lib.stride_tricks.sliding_window_view(steps[part.start : part.stop + 2 * NEARBY - 1], 2 * NEARBY, axis=0)
        yield np.moveaxis(windows, 2, 1).reshape(part.stop - part.start, -1)
