"""The Cramér–Rao bound of a flight: how well any unbiased estimator could tell the mass properties from its log.

The commands that were issued are flown again open loop, once for each parameter a little larger and once a little smaller. The differences
of the noise-free increments are the sensitivities; with the IMU's noise they make the information matrix. Body rates at the start of a
phase are unknown too; the attitude is known; disturbances, pulse errors and biases are not counted.
"""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.testbed.motion import Bodies
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import Change, Flight, fly

STEP = 1e-6
"""Parameters are changed by this part of their natural size."""
RATE_STEP = 1e-6
"""rad/s; body rates by this much."""
RESOLVED = 1e-11
"""Singular values of the sensitivities below this part of the largest are not told from zero."""


def cramer_rao(source: ScenarioSource, flight: Flight, member: int) -> list[Array]:
    """(10, 10) covariance bound of the ten quantities for each phase of one member's log.

    Gyro and accelerometer noise must be above zero.
    """
    scenario = source.scenario
    period, records = scenario.vehicle.cycle.period_s, scenario.sensors.records_per_cycle
    found = []
    for phase, values in zip(flight.phases, flight.truth[member], strict=True):
        start = int(np.floor(phase.start_s / period + 0.5))
        end = int(min(scenario.cycles, np.floor(phase.end_s / period + 1e-6)))
        slopes = _sensitivities(source, flight.seeds[member], flight.issued[member][None], values[None], start)
        found.append(_covariance(slopes[0, :, start * records : end * records].reshape(13, -1))[:10, :10])
    return found


def information(source: ScenarioSource, issued: Array, values: Array) -> Array:
    """(S, K, 13, 13) what each cycle's records tell of the ten quantities (S, 10) and the rate at the start, (S, K, C) commands issued.

    In units of :func:`natural_sizes` and rad/s. Information adds up: the bound after cycle k is the inverse of the sum so far.
    """
    slopes = _sensitivities(source, 0, issued, values, 0)
    members, unknowns = slopes.shape[:2]
    by_cycle = np.moveaxis(slopes.reshape(members, unknowns, issued.shape[1], -1), 1, 2)
    sizes = np.concatenate([[natural_sizes(body) for body in values], np.ones((members, 3))], 1)
    told: Array = by_cycle @ np.swapaxes(by_cycle, -1, -2) * (sizes[:, :, None] * sizes[:, None, :])[:, None]
    return told


def noise_free(source: ScenarioSource) -> ScenarioSource:
    """The same with perfect sensors, and no fuel burnt."""
    sensors = source.scenario.sensors.model_copy(
        update={"gyro_noise_rad_s": 0.0, "accel_noise_m_s2": 0.0, "gyro_quantum_rad": 0.0, "accel_quantum_m_s": 0.0}
    )
    return ScenarioSource(source.scenario.model_copy(update={"sensors": sensors, "fuel": None}), source.source)


def _sensitivities(source: ScenarioSource, seed: int, issued: Array, values: Array, start: int) -> Array:
    """(S, 13, K N, 6) whitened change of each record by one unit of each of the ten quantities (S, 10) and the rate at cycle ``start``."""
    scenario, members = source.scenario, len(values)
    period, records = scenario.vehicle.cycle.period_s, scenario.sensors.records_per_cycle
    moves = np.zeros((members, 13, 13))
    moves[:, range(13), range(13)] = [np.concatenate([STEP * natural_sizes(body), np.full(3, RATE_STEP)]) for body in values]
    both = np.concatenate([moves, -moves], 1)
    bodies = values[:, None] + both[..., :10]
    change = Change(as_bodies(bodies.reshape(-1, 10)), both[..., 10:].reshape(-1, 3).T)
    flown = fly(noise_free(source), [seed] * (26 * members), issued=np.repeat(issued, 26, 0), changes={start: change})
    whitened = np.concatenate(
        [
            flown.delta_theta_rad / _sigma(scenario.sensors.gyro_noise_rad_s, scenario.vehicle.imu.gyro_noise_rad_s),
            flown.delta_v_m_s / _sigma(scenario.sensors.accel_noise_m_s2, scenario.vehicle.imu.accel_noise_m_s2),
        ],
        -1,
    ).reshape(members, 2, 13, -1, 6) / (np.sqrt(records) * period / records)
    size = moves[:, range(13), range(13)]
    found: Array = (whitened[:, 0] - whitened[:, 1]) / (2 * size[:, :, None, None])
    return found


def natural_sizes(values: Array) -> Array:
    """(10,) trace, sqrt(trace/mass) and mass of a body: how large its quantities are by nature."""
    trace, mass = values[[0, 3, 5]].sum(), values[9]
    sizes: Array = np.concatenate([np.full(6, trace), np.full(3, np.sqrt(trace / mass)), [mass]])
    return sizes


def as_bodies(values: Array) -> Bodies:
    """One body for each row of (S, 10)."""
    inertia = values.T[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3, -1)
    return Bodies(inertia, np.ascontiguousarray(values[:, 6:9].T), np.ascontiguousarray(values[:, 9]))


def _sigma(real: float | None, stated: float | None) -> float:
    sigma = stated if real is None else real
    if not sigma:
        raise ValueError("a bound needs noise on both sensors")
    return sigma


def _covariance(slopes: Array) -> Array:
    """Inverse of the information matrix ``S Sᵀ`` of whitened sensitivities S, without forming it."""
    size = np.sqrt((slopes**2).sum(1))
    size = np.where(size > 0, size, 1.0)
    vectors, values, _ = np.linalg.svd(slopes / size[:, None], full_matrices=False)
    root = vectors / np.maximum(values, RESOLVED * values[0]) / size[:, None]
    covariance: Array = root @ root.T
    return covariance
