"""The Cramér–Rao bound of a flight: how well any unbiased estimator could tell the mass properties from its log.

The commands that were issued are flown again open loop, once for each parameter a little larger and once a little smaller. The differences
of the noise-free increments are the sensitivities; with the IMU's noise they make the information matrix. Body rates at the start of a
phase are unknown too, and so are damping and, beside wheels, the scale of all thrust, as far as the vehicle file says (:func:`cramer_rao`);
the attitude is known; disturbances, pulse errors and biases are not counted.
"""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.testbed.motion import Bodies
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import MemberChange, SimulatedFlight, fly

STEP = 1e-6
"""Parameters are changed by this part of their natural size."""
RATE_STEP = 1e-6
"""rad/s; body rates by this much."""
BESIDE_STEP = 1e-5
"""Of its stated sigma, by how much damping and the scale of thrust are changed."""
RESOLVED = 1e-11
"""Singular values of the sensitivities below this part of the largest are not told from zero."""


def cramer_rao(source: ScenarioSource, flight: SimulatedFlight, member: int) -> list[Array]:
    """(10, 10) covariance bound of the ten quantities for each phase of one member's log.

    Beside them the damping is unknown where ``environment.damping_sigma_n_m_s`` is stated, and ``thrust.scale_sigma`` where wheels tell it;
    both from a prior of that sigma. Gyro and accelerometer noise must be above zero.
    """
    return list(of_members(source, flight, slice(member, member + 1))[0])


def of_members(source: ScenarioSource, flight: SimulatedFlight, members: slice) -> Array:
    """(M, phases, 10, 10) the same of several members, flown again side by side; their records take memory for 26 or more flights each."""
    scenario, seeds = source.scenario, flight.seeds[members]
    period, records = scenario.vehicle.cycle.period_s, scenario.sensors.records_per_cycle
    found = np.empty((len(seeds), len(flight.phases), 10, 10))
    for i, phase in enumerate(flight.phases):
        start = int(np.floor(phase.start_s / period + 0.5))
        end = int(min(scenario.cycles, np.floor(phase.end_s / period + 1e-6)))
        slopes = _sensitivities(source, seeds, flight.issued[members], flight.truth[members, i], start, _beside(source))
        for one, told in zip(found, slopes[:, :, start * records : end * records], strict=True):
            known = np.eye(len(told))[:, 13:]  # in sigmas
            one[i] = _covariance(np.hstack([told.reshape(len(told), -1), known]))[:10, :10]
    return found


def _beside(source: ScenarioSource) -> Array:
    """(n, 4) one sigma of each unknown beside the body and its rate: of damping about each axis, and of the scale of all thrust."""
    vehicle, sigmas = source.scenario.vehicle, np.zeros(4)
    sigmas[:3] = vehicle.environment.damping_sigma_n_m_s
    sigmas[3] = vehicle.thrust.scale_sigma if vehicle.spinning else 0.0
    return np.diag(sigmas)[sigmas > 0]


def information(source: ScenarioSource, issued: Array, values: Array) -> Array:
    """(S, K, 13, 13) what each cycle's records tell of the ten quantities (S, 10) and the rate at the start, (S, K, C) commands issued.

    In units of :func:`natural_sizes` and rad/s. Information adds up: the bound after cycle k is the inverse of the sum so far.
    """
    slopes = _sensitivities(source, [0] * len(values), issued, values, 0, np.zeros((0, 4)))
    members, unknowns = slopes.shape[:2]
    by_cycle = np.moveaxis(slopes.reshape(members, unknowns, issued.shape[1], -1), 1, 2)
    sizes = np.concatenate([[natural_sizes(body) for body in values], np.ones((members, 3))], 1)
    return by_cycle @ np.swapaxes(by_cycle, -1, -2) * (sizes[:, :, None] * sizes[:, None, :])[:, None]


def noise_free(source: ScenarioSource) -> ScenarioSource:
    """The same with perfect sensors, and no fuel burnt."""
    sensors = source.scenario.sensors.model_copy(
        update={"gyro_noise_rad_s": 0.0, "accel_noise_m_s2": 0.0, "gyro_quantum_rad": 0.0, "accel_quantum_m_s": 0.0}
    )
    return ScenarioSource(source.scenario.model_copy(update={"sensors": sensors, "fuel": None}), source.source)


def _sensitivities(source: ScenarioSource, seeds: Sequence[int], issued: Array, values: Array, start: int, beside: Array) -> Array:
    """(S, 13 + n, K N, a) whitened change of each record, of the axes that are logged.

    By one unit of each of the ten quantities (S, 10) and the rate at cycle ``start``, and by one sigma of what is ``beside`` them (n, 4).
    """
    scenario, members, unknowns = source.scenario, len(values), 13 + len(beside)
    period, records = scenario.vehicle.cycle.period_s, scenario.sensors.records_per_cycle
    sizes = [np.concatenate([STEP * natural_sizes(body), np.full(3, RATE_STEP), np.full(len(beside), BESIDE_STEP)]) for body in values]
    moves = np.array(sizes)[:, :, None] * np.eye(unknowns)
    both = np.concatenate([moves, -moves], 1).reshape(-1, unknowns)
    bodies = np.repeat(values, 2 * unknowns, 0) + both[:, :10]
    others = (both[:, 13:] @ beside).T
    change = MemberChange(as_bodies(bodies), both[:, 10:13].T, others[:3], 1 + others[3])
    flown = fly(
        noise_free(source), np.repeat(seeds, 2 * unknowns).tolist(), issued=np.repeat(issued, 2 * unknowns, 0), changes={start: change}
    )
    sensors, stated = scenario.sensors, scenario.vehicle.imu
    whitened = np.concatenate(
        [
            flown.delta_theta_rad / _sigma(sensors.gyro_noise_rad_s, stated.gyro_noise_rad_s, sensors.axes[:3]),
            flown.delta_v_m_s / _sigma(sensors.accel_noise_m_s2, stated.accel_noise_m_s2, sensors.axes[3:]),
        ],
        -1,
    ).reshape(members, 2, unknowns, -1, 6)[..., list(scenario.sensors.axes)] / (np.sqrt(records) * period / records)
    return (whitened[:, 0] - whitened[:, 1]) / (2 * np.array(sizes)[:, :, None, None])


def natural_sizes(values: Array) -> Array:
    """(10,) trace, sqrt(trace/mass) and mass of a body: how large its quantities are by nature."""
    trace, mass = values[[0, 3, 5]].sum(), values[9]
    return np.concatenate([np.full(6, trace), np.full(3, np.sqrt(trace / mass)), [mass]])


def as_bodies(values: Array) -> Bodies:
    """One body for each row of (S, 10)."""
    inertia = values.T[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3, -1)
    return Bodies(inertia, np.ascontiguousarray(values[:, 6:9].T), np.ascontiguousarray(values[:, 9]))


def _sigma(real: float | None, stated: float | None, axes: Sequence[bool]) -> float:
    sigma = stated if real is None else real
    if not sigma and any(axes):
        raise ValueError("a bound needs noise on each sensor that is logged")
    return sigma or 1.0


def _covariance(slopes: Array) -> Array:
    """Inverse of the information matrix ``S Sᵀ`` of whitened sensitivities S, without forming it."""
    size = np.sqrt((slopes**2).sum(1))
    size = np.where(size > 0, size, 1.0)
    vectors, values, _ = np.linalg.svd(slopes / size[:, None], full_matrices=False)
    root = vectors / np.maximum(values, RESOLVED * values[0]) / size[:, None]
    return root @ root.T
