"""Reference attitude from gyro and logged attitudes, and the measurements that logged attitudes make of its error.

The estimators are linear about a reference attitude and have the rotation vector φ from it to the true attitude as a state. Each logged
attitude q̃ measures ``φ + noise = log(q⁻¹ ⊗ q̃)``, q the reference at the time of q̃. A filter corrects the reference towards the logged
attitudes (:mod:`massprop_cli.prepare.attitudefilter`), so that φ stays small for any bias and start. The reference may be rough, because
the estimators know how it was propagated.
"""

from __future__ import annotations

import math
import weakref
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, IntArray, frozen
from massprop_cli.base.errors import AttitudeError
from massprop_cli.base.quaternion import inverse, matrices, quaternion_of, quaternion_product, rotation_vector, turns_between
from massprop_cli.base.rigidbody import times
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.attitude import initial_attitude, integrate_attitude, rotation_vectors, world_up_b
from massprop_cli.prepare.attitudefilter import (
    STATES,
    FilterInput,
    GyroTurns,
    LoggedAttitudes,
    Noise,
    ReferenceAttitude,
    filtered_reference,
    linear_filter,
)
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.sensor import motion_offset_s
from massprop_cli.prepare.sums import of_records

START = 1.0
"""rad; prior sigma of the initial attitude before the first logged one, practically uninformative."""
KEPT = 4
"""Number of references kept per log, one for each set of IMU values."""
SURE, TWICE = 4.0, 2.0
"""Standard errors by which the estimated attitude noise must exceed its limit, and that limit as a multiple of the stated noise."""
FLOOR = 1e-5
"""rad; lower limit of the attitude noise, which also covers motion within a cycle."""
TILTED, AGREED = 0.2, 18.4
"""Limits within which the stated and the logged initial vertical agree: sine of the angle between them, and chi-square with two degrees
of freedom (99.99 %)."""
OPPOSED, STILL = 0.5, 0.01
"""Limits of the rotation of logged attitudes that the gyro does not show: fraction of the gyro's rotation, and rad rms per attitude."""


def reference_attitude(log: Log, vehicle: Vehicle, gyro: float | Array = 1.0) -> ReferenceAttitude | None:
    """Reference attitude of a log and its measurements; None without logged attitudes or without a pivot.

    ``gyro``: scale factor of the gyro readings. Results are cached per log. Raises :class:`InputError` if attitude and gyro contradict
    each other.
    """
    if log.attitude_wxyz is None or not vehicle.pivoted:
        return None
    imu, late_s = vehicle.imu, motion_offset_s(log, vehicle)[0]
    stated = imu.attitude_sigma_rad, imu.attitude_latency + late_s, imu.gyro_noise_rad_s, *sigmas(vehicle)
    key = (imu.body_from_imu, vehicle.environment.initial_attitude_wxyz, np.asarray(gyro, dtype=float).tobytes(), *stated)
    if id(log) not in _cache:
        _cache[id(log)] = {}
        weakref.finalize(log, _cache.pop, id(log), None)
    references = _cache[id(log)]
    if key not in references:
        for oldest in list(references)[: len(references) - KEPT + 1]:
            del references[oldest]
        inputs = filter_input(log, vehicle, gyro)
        references[key] = None
        if inputs is not None:
            duration_s = inputs.motion.duration_s
            stated_wxyz = initial_attitude(vehicle, inputs.motion.turns / duration_s[:, None], duration_s, late_s)
            references[key] = _reference(inputs, stated_wxyz)
    return references[key]


_cache: dict[int, dict[tuple[object, ...], ReferenceAttitude | None]] = {}
"""References by the id of each live log, then by IMU values."""


def sigmas(vehicle: Vehicle) -> tuple[float, float, float]:
    """Stated sigmas: gyro bias, rad/s; its random walk, rad/s/√s; attitude misalignment, rad."""
    imu = vehicle.imu
    return imu.gyro_bias_sigma_rad_s, imu.gyro_bias_walk_rad_s_sqrt_s, imu.attitude_misalignment_sigma_rad


def filter_input(log: Log, vehicle: Vehicle, gyro: float | Array = 1.0) -> FilterInput | None:
    """Inputs of the attitude filters; None without logged attitudes or without a pivot.

    Raises :class:`InputError` if attitude and gyro rotate differently, or if the attitudes scatter far more than stated.
    """
    if log.attitude_wxyz is None or not vehicle.pivoted:
        return None
    motion, logged = _read(log, vehicle, gyro)
    if not len(logged.cycle):
        return None
    noise = _noise(log, vehicle, motion, logged)
    edges = np.searchsorted(logged.cycle, np.arange(len(motion.turns) + 1))
    return FilterInput(motion, logged, edges, _mean_variance(logged, edges, noise), noise, *sigmas(vehicle))


def _reference(inputs: FilterInput, stated: Array) -> ReferenceAttitude:
    """Reference that starts at the logged attitude, or at the vertical of the ``stated`` one (4,) if the logged attitudes agree with it.

    An adopted stated vertical counts as exact, as it does without logged attitudes. The test compares the chi-squares of both starts,
    which differ by two degrees of freedom.
    """
    initial: Array = _initial_from_log(inputs.motion, inputs.logged)
    P0: Array = START**2 * np.eye(3)
    reference = _offsets(inputs, filtered_reference(inputs, initial, P0))
    estimate, logged_up, stated_up = linear_filter(inputs, reference, P0), world_up_b(initial), world_up_b(stated)
    axis = np.cross(stated_up, logged_up)
    sine = float(np.linalg.norm(axis))
    if float(logged_up @ stated_up) > 0 and sine < TILTED:
        tilt, yaw_only = axis * (math.asin(sine) / sine if sine > 0 else 1.0), START**2 * np.outer(stated_up, stated_up)
        constrained = linear_filter(inputs, reference, yaw_only, initial=tilt)
        if constrained.chi_square - estimate.chi_square < AGREED:
            initial, P0, estimate = quaternion_product(initial, quaternion_of(tilt)), yaw_only, constrained
    misalignment = estimate.states[-1, 6:9]
    logged = inputs.logged._replace(wxyz=quaternion_product(inputs.logged.wxyz, quaternion_of(-misalignment)))
    reference = _offsets(inputs, filtered_reference(inputs._replace(logged=logged), initial, P0))
    estimate = linear_filter(inputs, reference, P0)
    return replace(reference, known=frozen(estimate.states), covariance=frozen(estimate.covariance))


def _offsets(inputs: FilterInput, reference: tuple[Array, Array]) -> ReferenceAttitude:
    """Measurements of the error of a reference (attitude and correction); states and their covariance stay empty."""
    motion, logged, (attitude, correction) = inputs.motion, inputs.logged, reference
    turned = logged.excess_turn + logged.share[:, None] * (motion.vectors + correction)[logged.cycle]
    predicted = quaternion_product(attitude[logged.cycle], quaternion_of(turned))
    offset = rotation_vector(quaternion_product(inverse(predicted), logged.wxyz))
    count = np.bincount(logged.cycle, minlength=len(correction))

    def mean(each: Array) -> Array:
        return frozen(np.bincount(logged.cycle, each, minlength=len(count)) / np.maximum(count, 1))

    offsets, sigma = frozen(np.stack([mean(axis) for axis in offset.T], 1)), frozen(np.sqrt(inputs.variance))
    states = np.zeros((0, STATES)), np.zeros((0, STATES, STATES))
    return ReferenceAttitude(frozen(attitude), frozen(correction), offsets, mean(logged.share), sigma, *states)


def _read(log: Log, vehicle: Vehicle, gyro: float | Array) -> tuple[GyroTurns, LoggedAttitudes]:
    """Gyro increments and logged attitudes of a log, with latencies removed from the attitudes' times."""
    assert log.attitude_wxyz is not None
    records, duration = log.records_per_cycle, cycle_edges(log, slice(0, log.cycles))[1]
    body = np.array(vehicle.imu.body_from_imu)
    turns = times(body, gyro * of_records(log.delta_theta_imu_rad, records))
    rows = np.flatnonzero(np.isfinite(log.attitude_wxyz[:, 0]))
    # times on the gyro's labels, which the recorded motion follows by its offset
    time_s = log.time_s[rows] - vehicle.imu.attitude_latency - motion_offset_s(log, vehicle)[0]
    within = (time_s > log.time_s[0] - log.interval_s[0]) & (time_s <= log.time_s[-1])
    rows, time_s = rows[within], time_s[within]
    record = np.searchsorted(log.time_s, time_s)
    remaining_s = log.time_s[record] - time_s
    cycle, remaining = record // records, np.clip(remaining_s / log.interval_s[record], 0.0, 1.0)
    elapsed_s, turned = (
        np.cumsum(one.reshape(-1, records, *one.shape[1:]), 1).reshape(one.shape)[record]
        for one in (log.interval_s, log.delta_theta_imu_rad)
    )
    share = (elapsed_s - remaining_s) / duration[cycle]
    turned = times(body, gyro * (turned - remaining[:, None] * log.delta_theta_imu_rad[record]))
    logged = LoggedAttitudes(log.attitude_wxyz[rows], cycle, share, turned - share[:, None] * turns[cycle])
    return GyroTurns(duration, turns, rotation_vectors(turns)), logged


def _mean_variance(logged: LoggedAttitudes, edges: IntArray, noise: Noise) -> Array:
    """(K,) variance of the mean of a cycle's logged attitudes, rad²: their noise and the gyro noise within the cycle.

    Gyro noise up to the fractions s and t of a cycle, less s and t times its total, is a Brownian bridge: covariance ``min(s, t) − s t``.
    """
    variance = np.full(len(edges) - 1, np.inf)
    for cycle in np.unique(logged.cycle):
        s = logged.share[edges[cycle] : edges[cycle + 1]]
        bridge = float((np.minimum(s[:, None], s) - s[:, None] * s).mean()) if len(s) > 1 else float(s[0] * (1 - s[0]))
        variance[cycle] = noise.attitude_rad**2 / len(s) + noise.gyro_rad**2 * max(bridge, 0.0)
    return variance


def _initial_from_log(motion: GyroTurns, logged: LoggedAttitudes) -> Array:
    """(4,) attitude at the start of the log, from the first logged attitude and the gyro."""
    cycle = int(logged.cycle[0])
    before = integrate_attitude(np.array([1.0, 0.0, 0.0, 0.0]), motion.turns[:cycle])[-1]
    turned = quaternion_product(before, quaternion_of(logged.excess_turn[0] + logged.share[0] * motion.vectors[cycle]))
    return quaternion_product(logged.wxyz[0], inverse(turned))


def _noise(log: Log, vehicle: Vehicle, motion: GyroTurns, logged: LoggedAttitudes) -> Noise:
    """Noise of logged attitude and gyro, stated or estimated; raises :class:`InputError` if the attitudes scatter far more than stated.

    d = n[k] − n[k−1] + gyro noise is the rotation between successive logged attitudes that the gyro does not show, world axes. Its lag-one
    covariance is −σ², σ the attitude noise; the rest of its variance is gyro noise.
    """
    stated = vehicle.imu
    attitude = integrate_attitude(np.array([1.0, 0.0, 0.0, 0.0]), motion.turns)
    turned = quaternion_of(logged.excess_turn + logged.share[:, None] * motion.vectors[logged.cycle])
    integrated = quaternion_product(attitude[logged.cycle], turned)
    by_gyro, by_log = (turns_between(one) for one in (integrated, logged.wxyz))
    difference = rotation_vector(quaternion_product(inverse(by_gyro), by_log))
    d = times(matrices(logged.wxyz[1:]), difference - (difference.mean(0) if len(difference) else 0.0))
    products = -d[1:] * d[:-1]
    variance, standard_error = (float(products.mean()), float(products.std()) / products.size**0.5) if len(products) > 1 else (0.0, 0.0)
    variance = max(variance, 0.0)
    _check_turns(log, difference, rotation_vector(by_gyro), variance)
    if stated.attitude_sigma_rad is not None and variance - SURE * standard_error > (TWICE * stated.attitude_sigma_rad) ** 2:
        raise AttitudeError(
            f"{log.path}, columns quat_w … quat_z: the attitude noise is {1e3 * variance**0.5:.2g} mrad from record to record, but "
            f"imu.attitude_sigma_rad is {stated.attitude_sigma_rad:g} rad; correct the key, or leave it out and massprop estimates it"
        )
    cycles = max(float(logged.cycle[-1] - logged.cycle[0]) / max(len(difference), 1), 1.0)
    gyro = stated.gyro_noise_rad_s * float(motion.duration_s.mean()) if stated.gyro_noise_rad_s else 0.0
    if not gyro and len(d):
        gyro = (max(float((d**2).mean()) - 2 * variance, 0.0) / cycles) ** 0.5
    return Noise(stated.attitude_sigma_rad or max((variance + standard_error) ** 0.5, FLOOR), gyro)


def _check_turns(log: Log, difference: Array, turns: Array, variance: float) -> None:
    """Raise :class:`InputError` if the ``difference`` (m, 3) to the gyro's ``turns`` (m, 3) exceeds attitude noise of ``variance``."""
    excess = max(float((difference**2).sum()) - 2 * variance * difference.size, 0.0) ** 0.5
    turned = float((turns**2).sum()) ** 0.5
    if excess > OPPOSED * turned and excess > STILL * len(difference) ** 0.5:
        raise AttitudeError(
            f"{log.path}, columns quat_w … quat_z: attitude and gyro disagree by {excess / turned:.2g} times the gyro's angles; "
            "quaternions are wxyz, world from body, of the axes of imu.body_from_imu. Correct the columns, or leave them out"
        )
