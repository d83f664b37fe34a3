"""A logged attitude as a measurement: the gyro carries a reference attitude, and a filter draws it to the logged ones.

The estimators are linear about a reference attitude; their states hold the rotation vector φ from it to the true one, and each logged
attitude q̃ measures that: ``φ + noise = log(q⁻¹ ⊗ q̃)``, q the reference at the time of q̃. The reference is drawn to the
logged attitudes (:mod:`massprop_cli.prepare.attitudefilter`), so that φ stays small whatever bias and start. It may be rough: the
estimators know how it was carried, and have φ as a state of their own.
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
from massprop_cli.prepare.attitude import at_first, integrate_attitude, rotation_vectors, world_up_b
from massprop_cli.prepare.attitudefilter import STATES, Given, GyroTurns, Logged, Measured, Noise, filtered, linear
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.sensor import shown_late_s
from massprop_cli.prepare.sums import of_records

START = 1.0
"""rad, one sigma of the reference before the first logged attitude: nothing is known."""
KEPT = 4
"""References of a log that are kept, of as many IMUs."""
SURE, TWICE = 4.0, 2.0
"""Standard errors by which noise of logged attitudes must show, and how many times the stated one it may be."""
FLOOR = 1e-5
"""rad; no attitude is known better, nor is the motion within a cycle."""
TILTED, AGREED = 0.2, 18.4
"""Sine of the angle between stated and logged vertical at the beginning, and chi-square of two degrees of freedom (99.99 %): up to
these they agree."""
OPPOSED, STILL = 0.5, 0.01
"""Part of the gyro's turning by which a logged attitude may turn otherwise; rad per attitude that is none."""


def measured(log: Log, vehicle: Vehicle, gyro: float | Array = 1.0) -> Measured | None:
    """The reference attitude of a log on an air bearing, and its measurements; None where no attitude is logged, or the body isn't there.

    ``gyro`` is a factor on what the gyro measured. :class:`InputError` where attitude and gyro contradict each other.
    """
    if log.attitude_wxyz is None or not vehicle.pivoted:
        return None
    imu, late_s = vehicle.imu, shown_late_s(log, vehicle)[0]
    stated = imu.attitude_sigma_rad, imu.attitude_latency + late_s, imu.gyro_noise_rad_s, *sigmas(vehicle)
    key = (imu.body_from_imu, vehicle.environment.initial_attitude_wxyz, np.asarray(gyro, dtype=float).tobytes(), *stated)
    if id(log) not in _made:
        _made[id(log)] = {}
        weakref.finalize(log, _made.pop, id(log), None)
    made = _made[id(log)]
    if key not in made:
        for oldest in list(made)[: len(made) - KEPT + 1]:
            del made[oldest]
        found = given(log, vehicle, gyro)
        made[key] = None
        if found is not None:
            duration_s = found.motion.duration_s
            made[key] = _measured(found, at_first(vehicle, found.motion.turns / duration_s[:, None], duration_s, late_s))
    return made[key]


_made: dict[int, dict[tuple[object, ...], Measured | None]] = {}
"""Of each log that is alive, by its id."""


def sigmas(vehicle: Vehicle) -> tuple[float, float, float]:
    """Of the gyro's bias, rad/s, of its change in a second, and of the misalignment, rad."""
    imu = vehicle.imu
    return imu.gyro_bias_sigma_rad_s, imu.gyro_bias_walk_rad_s_sqrt_s, imu.attitude_misalignment_sigma_rad


def given(log: Log, vehicle: Vehicle, gyro: float | Array = 1.0) -> Given | None:
    """What the filter takes; None where no attitude is logged, or the body isn't on an air bearing.

    :class:`InputError` where attitude and gyro turn otherwise, or the attitudes scatter by far more than is stated.
    """
    if log.attitude_wxyz is None or not vehicle.pivoted:
        return None
    motion, logged = read(log, vehicle, gyro)
    if not len(logged.cycle):
        return None
    noise = _noise(log, vehicle, motion, logged)
    edges = np.searchsorted(logged.cycle, np.arange(len(motion.turns) + 1))
    return Given(motion, logged, edges, _mean_variance(logged, edges, noise), noise, *sigmas(vehicle))


def _measured(given: Given, stated: Array) -> Measured:
    """About an attitude that began as logged; or with the vertical of the ``stated`` one (4,), where all attitudes agree with that.

    The vertical counts as exact then, as it does without logged attitudes. The chi-squares differ by two degrees of freedom.
    """
    begun: Array = begun_as_logged(given.motion, given.logged)
    free: Array = START**2 * np.eye(3)
    found = _offsets(given, filtered(given, begun, free))
    shown, stands, should = linear(given, found, free), world_up_b(begun), world_up_b(stated)
    axis = np.cross(should, stands)
    sine = float(np.linalg.norm(axis))
    if float(stands @ should) > 0 and sine < TILTED:
        level, held = axis * (math.asin(sine) / sine if sine > 0 else 1.0), START**2 * np.outer(should, should)
        agreeing = linear(given, found, held, at=level)
        if agreeing.chi_square - shown.chi_square < AGREED:
            begun, free, shown = quaternion_product(begun, quaternion_of(level)), held, agreeing
    turned = shown.states[-1, 6:9]  # the misalignment, which the reference hardly has then
    logged = given.logged._replace(wxyz=quaternion_product(given.logged.wxyz, quaternion_of(-turned)))
    found = _offsets(given, filtered(given._replace(logged=logged), begun, free))
    known = linear(given, found, free)
    return replace(found, known=frozen(known.states), covariance=frozen(known.covariance))


def _offsets(given: Given, reference: tuple[Array, Array]) -> Measured:
    """What logged attitudes measure about a reference; nothing of what is known of its error."""
    motion, logged, (attitude, drawn) = given.motion, given.logged, reference
    turned = logged.uneven + logged.share[:, None] * (motion.vectors + drawn)[logged.cycle]
    path = quaternion_product(attitude[logged.cycle], quaternion_of(turned))
    offset, count = rotation_vector(quaternion_product(inverse(path), logged.wxyz)), np.bincount(logged.cycle, minlength=len(drawn))

    def mean(each: Array) -> Array:
        return frozen(np.bincount(logged.cycle, each, minlength=len(count)) / np.maximum(count, 1))

    offsets, sigma = frozen(np.stack([mean(axis) for axis in offset.T], 1)), frozen(np.sqrt(given.variance))
    return Measured(
        frozen(attitude), frozen(drawn), offsets, mean(logged.share), sigma, np.zeros((0, STATES)), np.zeros((0, STATES, STATES))
    )


def read(log: Log, vehicle: Vehicle, gyro: float | Array) -> tuple[GyroTurns, Logged]:
    """What gyro and attitude of a log hold."""
    assert log.attitude_wxyz is not None
    records, duration = log.records_per_cycle, cycle_edges(log, slice(0, log.cycles))[1]
    body = np.array(vehicle.imu.body_from_imu)
    turns = times(body, gyro * of_records(log.delta_theta_imu_rad, records))
    rows = np.flatnonzero(np.isfinite(log.attitude_wxyz[:, 0]))
    # by the gyro's labels: what it shows is later than these
    time_s = log.time_s[rows] - vehicle.imu.attitude_latency - shown_late_s(log, vehicle)[0]
    within = (time_s > log.time_s[0] - log.interval_s[0]) & (time_s <= log.time_s[-1])
    rows, time_s = rows[within], time_s[within]
    record = np.searchsorted(log.time_s, time_s)
    ahead_s = log.time_s[record] - time_s  # of the record's end
    cycle, ahead = record // records, np.clip(ahead_s / log.interval_s[record], 0.0, 1.0)
    gone_s, turned = (
        np.cumsum(one.reshape(-1, records, *one.shape[1:]), 1).reshape(one.shape)[record]
        for one in (log.interval_s, log.delta_theta_imu_rad)
    )
    share = (gone_s - ahead_s) / duration[cycle]
    turned = times(body, gyro * (turned - ahead[:, None] * log.delta_theta_imu_rad[record]))
    found = Logged(log.attitude_wxyz[rows], cycle, share, turned - share[:, None] * turns[cycle])
    return GyroTurns(duration, turns, rotation_vectors(turns)), found


def _mean_variance(logged: Logged, edges: IntArray, noise: Noise) -> Array:
    """(K,) variance of the mean of a cycle's attitudes: their own noise, and that of the gyro within the cycle.

    The gyro's noise up to parts s and t of a cycle, less their share of the whole cycle's, has the covariance ``min(s, t) − s t``.
    """
    found = np.full(len(edges) - 1, np.inf)
    for cycle in np.unique(logged.cycle):
        s = logged.share[edges[cycle] : edges[cycle + 1]]
        within = float((np.minimum(s[:, None], s) - s[:, None] * s).mean()) if len(s) > 1 else float(s[0] * (1 - s[0]))
        found[cycle] = noise.attitude_rad**2 / len(s) + noise.gyro_rad**2 * max(within, 0.0)
    return found


def begun_as_logged(motion: GyroTurns, logged: Logged) -> Array:
    """(4,) the attitude at the log's beginning, from the first that is logged and the gyro."""
    cycle = int(logged.cycle[0])
    before = integrate_attitude(np.array([1.0, 0.0, 0.0, 0.0]), motion.turns[:cycle])[-1]
    turned = quaternion_product(before, quaternion_of(logged.uneven[0] + logged.share[0] * motion.vectors[cycle]))
    return quaternion_product(logged.wxyz[0], inverse(turned))


def _noise(log: Log, vehicle: Vehicle, motion: GyroTurns, logged: Logged) -> Noise:
    """By the differences d = n[k] − n[k−1] + gyro noise of neighbouring attitudes beside the gyro, world axes: cov(d, next) = −σ²."""
    stated = vehicle.imu
    attitude = integrate_attitude(np.array([1.0, 0.0, 0.0, 0.0]), motion.turns)
    path = quaternion_product(attitude[logged.cycle], quaternion_of(logged.uneven + logged.share[:, None] * motion.vectors[logged.cycle]))
    by_gyro, by_log = (turns_between(one) for one in (path, logged.wxyz))
    off = rotation_vector(quaternion_product(inverse(by_gyro), by_log))
    apart = times(matrices(logged.wxyz[1:]), off - (off.mean(0) if len(off) else 0.0))
    between = -apart[1:] * apart[:-1]
    mean, chance = (float(between.mean()), float(between.std()) / between.size**0.5) if len(between) > 1 else (0.0, 0.0)
    mean = max(mean, 0.0)
    _check_turns(log, off, rotation_vector(by_gyro), mean)
    if stated.attitude_sigma_rad is not None and mean - SURE * chance > (TWICE * stated.attitude_sigma_rad) ** 2:
        raise AttitudeError(
            f"{log.path}, columns quat_w … quat_z: the attitude scatters by {1e3 * mean**0.5:.2g} mrad from record to record, and "
            f"imu.attitude_sigma_rad is {stated.attitude_sigma_rad:g} rad; state its noise, or leave the key out to have it estimated"
        )
    cycles = max(float(logged.cycle[-1] - logged.cycle[0]) / max(len(off), 1), 1.0)
    gyro = stated.gyro_noise_rad_s * float(motion.duration_s.mean()) if stated.gyro_noise_rad_s else 0.0
    if not gyro and len(apart):
        gyro = (max(float((apart**2).mean()) - 2 * mean, 0.0) / cycles) ** 0.5
    return Noise(stated.attitude_sigma_rad or max((mean + chance) ** 0.5, FLOOR), gyro)


def _check_turns(log: Log, off: Array, turns: Array, variance: float) -> None:
    """Refuse attitudes (m + 1) that turn ``off`` (m, 3) the gyro's ``turns`` (m, 3) by more than noise of ``variance`` does."""
    left = max(float((off**2).sum()) - 2 * variance * off.size, 0.0) ** 0.5
    turned = float((turns**2).sum()) ** 0.5
    if left > OPPOSED * turned and left > STILL * len(off) ** 0.5:
        raise AttitudeError(
            f"{log.path}, columns quat_w … quat_z: the attitude turns by {left / turned:.2g} times the gyro's angles away from the gyro; "
            "quaternions are wxyz, world from body, of the axes of imu.body_from_imu. Correct the columns, or leave them out"
        )
