"""Speeds of wheels and rotors, and angles of gimbals, where they bend; of wheels by what tachometers show: late, means, rounded, noisy.

A reading is the mean of the speed over a window that ends a latency before its time. With the speed linear from each record's end to the
next, or so long after them as the torque on the wheel steps, Ω there, readings r = H Ω, and Ω a random walk of the readings' own steps q,
the estimate is the conditional mean (in information form)
``(Hᵀ H / s² + Dᵀ D / q) Ω = Hᵀ r / s²``, D the differences. s is small: this undoes H, and what of the errors comes with it is known.

An error e of a speed is in the regressors, too, so it biases inertia and lever arm by its variance over that of the motion, about each
axis (errors in variables; Carroll et al., Measurement Error in Nonlinear Models, 2006, chapter 4: regression calibration). The speeds
less ``E[e | differences of all wheels' speeds nearby]`` have what is left of e uncorrelated with these differences. The covariance of the
differences with e is known, and their own is the log's.
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
"""Cycles before and after, whose changes tell of an error: in so many a control loop brings the vehicle's rate back."""
MOST = 4.0
"""Sigmas, beyond which what is taken for an error is none."""
MIDST = 200
"""Readings, in the midst of which a log's ends do not count."""
TRUSTED, FINER, CURVED = 1e-5, 0.2, 0.1
"""Part of the usual step from reading to reading, and of a reading's sigma, by which a solution may be off a reading; part of a step of
rotors', whose speed is no straight line between bends."""


class _Speeds(NamedTuple):
    """Of one wheel."""

    place: int
    """Among all that stores momentum."""
    said: WheelLog
    values: Array
    """(n,) where they bend, or with the one before the log."""
    covariance: Array
    """(L,) of their errors, by records apart, (rad/s)²."""
    after_s: float
    """So long after each record's end."""


def at_bends(log: Log, vehicle: Vehicle) -> Log:
    """The log with the speed of each wheel at each record's end, of each rotor at each cycle's, or so long after it as its torque steps."""
    log = _of_gimbals(_of_rotors(log, vehicle), vehicle)
    own = _undelayed(log, vehicle)
    if not own:
        return log
    values = calibrated([one.values for one in own], [one.covariance for one in own], log.records_per_cycle)
    spinning = list(log.spinning)
    for one, speed in zip(own, values, strict=True):
        begun = one.said.start_rad_s is not None
        start = float(speed[0]) if begun else None
        bent = replace(one.said, speed_rad_s=frozen(speed[int(begun) :]), start_rad_s=start)
        spinning[one.place] = replace(bent, corrected=True, after_s=one.after_s)
    return replace(log, spinning=tuple(spinning))


def _of_gimbals(log: Log, vehicle: Vehicle) -> Log:
    if not any(gyro.gimbal_steps_s for gyro in vehicle.control_moment_gyros):
        return log
    spinning, end_s = list(log.spinning), np.append(log.time_s[0] - log.interval_s[0], log.time_s)
    for place, (gyro, said) in enumerate(zip(vehicle.spinning, spinning, strict=True)):
        if not (isinstance(gyro, ControlMomentGyro) and isinstance(said, GyroLog)) or not gyro.gimbal_steps_s or said.after_s:
            continue
        angle = at_times(end_s + gyro.gimbal_steps_s, said.angle_rad, gyro.gimbal_steps_s, 0.0, TRUSTED**2)[1:]
        spinning[place] = replace(said, angle_rad=frozen(angle), after_s=gyro.gimbal_steps_s)
    return replace(log, spinning=tuple(spinning))


def _of_rotors(log: Log, vehicle: Vehicle) -> Log:
    bends_s = tuple(rotor.torque_steps_s or 0.0 for rotor in vehicle.rotors)
    if not any(bends_s) or log.bends_s:
        return log
    speeds, end_s = log.command.copy(), log.cycle_end_s
    for column, after_s in zip(speeds.T, bends_s, strict=True):
        if after_s:
            column[:] = at_times(end_s + after_s, column, after_s, 0.0, CURVED**2)
    return replace(log, command=frozen(speeds), bends_s=bends_s)


def change_sigmas(log: Log, vehicle: Vehicle) -> Array:
    """One sigma of what is left of errors of each device's speed in its change over a cycle, rad/s; 0 of what is exact or no speed."""
    found = np.zeros(len(log.spinning))
    own = [one for one in _undelayed(log, vehicle) if one.covariance[0] > 0]
    scaled = [_by_cycle(one.values, one.covariance, log.records_per_cycle) for one in own]
    if own and len(scaled[0][0]) > 2 * NEARBY:
        found[[one.place for one in own]] = _gain(*_together(scaled))[1] * [size for _, size, _ in scaled]
    return found


def _undelayed(log: Log, vehicle: Vehicle) -> list[_Speeds]:
    """Of each wheel whose logged speeds are not those at which they bend."""
    found, time_s = [], np.append(log.time_s[0] - log.interval_s[0], log.time_s)
    for place, (wheel, said) in enumerate(zip(vehicle.spinning, log.spinning, strict=True)):
        if not (isinstance(wheel, Wheel) and isinstance(said, WheelLog)) or said.speed_rad_s is None or said.corrected:
            continue
        begun, after_s = said.start_rad_s is not None, wheel.torque_steps_s or 0.0
        readings, variance, _ = wheel.dequantised_speed(np.append([said.start_rad_s] * begun, said.speed_rad_s).astype(float))
        sigma, late = float(np.sqrt(variance.mean())), (wheel.speed_latency_s + after_s, wheel.speed_window_s)
        if sigma == 0 and not any(late):
            continue
        walk = float(np.mean(np.diff(readings) ** 2)) if len(readings) > 1 else 0.0
        noise = max(TRUSTED**2, (FINER * sigma) ** 2 / walk) if walk else 1.0
        values = at_times(time_s + after_s, readings, *late, noise)[int(not begun) :] if any(late) and walk else readings
        lags = 2 * (NEARBY + 1) * log.records_per_cycle
        found.append(_Speeds(place, said, values, sigma**2 * _passed(float(np.median(log.interval_s)), *late, noise, lags), after_s))
    return found


def _passed(step_s: float, latency_s: float, window_s: float, noise: float, lags: int) -> Array:
    """(lags,) covariance of errors of speeds by independent readings of variance 1."""
    single = np.eye(1, MIDST + 2 * lags, MIDST // 2 + lags)[0]
    if latency_s + window_s > 0:
        single = at_times(step_s * np.arange(len(single)), single, latency_s, window_s, noise)
    return np.correlate(single, single, "full")[len(single) - 1 :][:lags]


def at_times(time_s: Array, readings: Array, latency_s: float, window_s: float, noise: float) -> Array:
    """(n,) speeds at ``time_s`` of readings (m,) at the last m of them, means over windows that ended a latency before.

    ``noise`` is the variance of a reading, over that of a step.
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
    """(m,) of the speeds at m knots from ``first`` on in the means over the windows that end at ``end_s`` (m,), or in speeds then."""
    step = np.diff(knot_s)
    wide = np.concatenate([step[:1], step, step[-1:]])
    own = slice(first, first + len(end_s))
    at_s, left, right = knot_s[own], wide[:-1][own], wide[1:][own]

    def rises(to_s: Array) -> tuple[Array, Array]:
        return np.clip((to_s - at_s + left) / left, 0.0, 1.0), np.clip((to_s - at_s) / right, 0.0, 1.0)

    def integral(to_s: Array) -> Array:
        up, down = rises(to_s)
        return left * up**2 / 2 + right * (down - down**2 / 2)

    if window_s == 0:
        up, down = rises(end_s)
        return up - down
    return (integral(end_s) - integral(end_s - window_s)) / window_s


_ByCycle = tuple[Array, float, Array]
"""(K,) means of speeds over cycles, over one sigma of their errors; that; and the errors' correlation, by cycles apart."""


def calibrated(speeds: Sequence[Array], covariances: Sequence[Array], together: int = 1) -> list[Array]:
    """Speeds (n,) of each wheel less what all speeds tell of their errors; ``together`` to a cycle, up to the last one.

    ``covariances`` (L,) are those of the errors, by records apart; speeds without errors stay as they are.
    """
    kept = [n for n, own in enumerate(covariances) if own[0] > 0 and len(speeds[n]) > 2 * NEARBY * together]
    found = list(speeds)
    if not kept:
        return found
    scaled = [_by_cycle(speeds[n], covariances[n], together) for n in kept]
    own, correlation = _together(scaled)
    gain, _ = _gain(own, correlation)
    errors = np.concatenate([part @ gain for part in _windows(own)])
    errors[np.abs(errors) > MOST] = 0.0  # a motion as there is nowhere else in the log, as at its ends
    for error, (_, size, _), n in zip(errors.T, scaled, kept, strict=True):
        cycle = (np.arange(len(speeds[n])) - len(speeds[n])) // together + len(own)
        found[n] = speeds[n] - size * error[np.maximum(cycle, 0)]
    return found


def _by_cycle(speeds: Array, covariance: Array, together: int) -> _ByCycle:
    count = len(speeds) // together
    means = speeds[len(speeds) - count * together :].reshape(count, together).mean(1)
    apart = np.arange(2 * NEARBY + 1)[:, None, None] * together + np.arange(together)[:, None] - np.arange(together)
    by_cycle = covariance[np.abs(apart)].mean((1, 2))
    size = float(np.sqrt(by_cycle[0]))
    return means / size, size, by_cycle / by_cycle[0]


def _together(scaled: Sequence[_ByCycle]) -> tuple[Array, Array]:
    """(K, w) and (w, 2 N + 1) of all wheels, of the cycles that all have."""
    count = min(len(values) for values, _, _ in scaled)
    return np.stack([values[len(values) - count :] for values, _, _ in scaled], 1), np.stack([one for _, _, one in scaled])


def _gain(own: Array, correlation: Array) -> tuple[Array, Array]:
    """(2 N w, w) of E[e | differences], and (w,) one sigma of what is left of e's change, for values (K, w) of which each error is 1.

    No direction of the differences varies less than errors let it.
    """
    wheels, inner = own.shape[1], range(NEARBY, len(own) - NEARBY)
    square, at = np.zeros((2 * NEARBY * wheels, 2 * NEARBY * wheels)), 0
    for part in _windows(own):
        used = part[max(inner.start - at, 0) : max(inner.stop - at, 0)]
        square, at = square + used.T @ used, at + len(part)
    each = np.eye(wheels)
    place = np.arange(2 * NEARBY)
    apart = place[:, None] - place
    alone = 2 * correlation[:, np.abs(apart)] - correlation[:, np.abs(apart + 1)] - correlation[:, np.abs(apart - 1)]
    by_errors = np.einsum("wij,wv->iwjv", alone, each).reshape(square.shape)
    root = np.linalg.inv(np.linalg.cholesky(by_errors))
    values, axes = np.linalg.eigh(root @ (square / max(len(inner), 1)) @ root.T)
    whitened = axes.T @ root
    now, before = (
        np.einsum("wi,wv->iwv", correlation[:, np.abs(k - place)] - correlation[:, np.abs(k + 1 - place)], each).reshape(-1, wheels)
        for k in (NEARBY - 1, NEARBY - 2)
    )
    known = (whitened @ (now - before)) ** 2 / np.maximum(values, 1.0)[:, None]
    left = 2 * (1 - correlation[:, 1]) - known.sum(0)
    return whitened.T @ (whitened @ now / np.maximum(values, 1.0)[:, None]), np.sqrt(np.maximum(left, 0.0))


def _windows(own: Array) -> Iterator[Array]:
    """Parts (m, 2 N w) of the N differences before each value (K, w), and the N after, none beyond the log."""
    steps = np.zeros((len(own) + 2 * NEARBY - 1, own.shape[1]))
    steps[NEARBY : NEARBY + len(own) - 1] = np.diff(own, axis=0)
    for part in spill.parts(len(own)):
        seen = np.lib.stride_tricks.sliding_window_view(steps[part.start : part.stop + 2 * NEARBY - 1], 2 * NEARBY, axis=0)
        yield np.moveaxis(seen, 2, 1).reshape(part.stop - part.start, -1)
