"""Fisher information of a flight on the mass properties; its inverse is the Cramér–Rao bound.

The simulator flies the issued commands open loop with each parameter slightly larger and slightly smaller. Central differences of the
noise-free increments are the sensitivities, which give the information matrix with the IMU's noise. The initial body rate is unknown, the
attitude is known. Disturbances, pulse errors and biases are not included.
"""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.testbed.motion import Bodies
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import MemberChange, fly

STEP = 1e-6
"""Step of the mass properties, as a fraction of their natural size."""
RATE_STEP = 1e-6
"""Step of the body rates, rad/s."""
NUISANCE_STEP = 1e-5
"""Step of nuisance parameters (damping, thrust scale), as a fraction of their stated sigma."""


NOTHING = np.zeros((0, 4))
"""No nuisance parameters."""


def information(source: ScenarioSource, issued: Array, values: Array, nuisance: Array = NOTHING, fine: bool = True) -> Array:
    """(S, K, 13 + n, 13 + n) information of each cycle on the ten quantities (S, 10), the initial rate and n nuisance parameters.

    Units: :func:`natural_sizes`, rad/s, and one sigma of each nuisance parameter. ``issued``: (S, K, C) commands. ``nuisance``: as in
    :func:`sensitivities`. The bound after cycle k is the inverse of the sum so far. ``fine`` as in
    :func:`massprop_cli.testbed.simulate.fly`.
    """
    slopes = sensitivities(source, [0] * len(values), issued, values, 0, nuisance, fine)
    members, unknowns = slopes.shape[:2]
    by_cycle = np.moveaxis(slopes.reshape(members, unknowns, issued.shape[1], -1), 1, 2)
    sizes = np.concatenate([[natural_sizes(body) for body in values], np.ones((members, unknowns - 10))], 1)
    return np.asarray(by_cycle @ np.swapaxes(by_cycle, -1, -2) * (sizes[:, :, None] * sizes[:, None, :])[:, None])


def noise_free(source: ScenarioSource) -> ScenarioSource:
    """The scenario without sensor noise, quantisation and fuel consumption."""
    sensors = source.scenario.sensors.model_copy(
        update={"gyro_noise_rad_s": 0.0, "accel_noise_m_s2": 0.0, "gyro_quantum_rad": 0.0, "accel_quantum_m_s": 0.0}
    )
    return ScenarioSource(source.scenario.model_copy(update={"sensors": sensors, "fuel": None}), source.source)


def sensitivities(
    source: ScenarioSource, seeds: Sequence[int], issued: Array, values: Array, start: int, nuisance: Array, fine: bool = True
) -> Array:
    """(S, 13 + n, K N, a) derivatives of each record, on the logged axes, over the noise.

    By the ten quantities (S, 10), by the rate at cycle ``start``, and by one sigma of each nuisance parameter. A row of ``nuisance`` (n, 4)
    is one sigma of the damping about each axis, N m s, and of the relative thrust scale.
    """
    scenario, members, unknowns = source.scenario, len(values), 13 + len(nuisance)
    period, records = scenario.vehicle.cycle.period_s, scenario.sensors.records_per_cycle
    sizes = [np.concatenate([STEP * natural_sizes(body), np.full(3, RATE_STEP), np.full(len(nuisance), NUISANCE_STEP)]) for body in values]
    moves = np.array(sizes)[:, :, None] * np.eye(unknowns)
    both = np.concatenate([moves, -moves], 1).reshape(-1, unknowns)
    bodies = np.repeat(values, 2 * unknowns, 0) + both[:, :10]
    others = (both[:, 13:] @ nuisance).T
    change = MemberChange(as_bodies(bodies), both[:, 10:13].T, others[:3], 1 + others[3])
    every = np.repeat(seeds, 2 * unknowns).tolist()
    flown = fly(noise_free(source), every, issued=np.repeat(issued, 2 * unknowns, 0), changes={start: change}, fine=fine)
    sensors, stated = scenario.sensors, scenario.vehicle.imu
    whitened = np.concatenate(
        [
            flown.delta_theta_rad / _sigma(sensors.gyro_noise_rad_s, stated.gyro_noise_rad_s, sensors.axes[:3]),
            flown.delta_v_m_s / _sigma(sensors.accel_noise_m_s2, stated.accel_noise_m_s2, sensors.axes[3:]),
        ],
        -1,
    ).reshape(members, 2, unknowns, -1, 6)[..., list(scenario.sensors.axes)] / (np.sqrt(records) * period / records)
    return np.asarray((whitened[:, 0] - whitened[:, 1]) / (2 * np.array(sizes)[:, :, None, None]))


def natural_sizes(values: Array) -> Array:
    """(10,) natural sizes of a body's quantities: trace of the inertia, sqrt(trace / mass) for the CG, and mass."""
    trace, mass = values[[0, 3, 5]].sum(), values[9]
    return np.concatenate([np.full(6, trace), np.full(3, np.sqrt(trace / mass)), [mass]])


def as_bodies(values: Array) -> Bodies:
    """Bodies of S rows of ten quantities (S, 10)."""
    inertia = values.T[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3, -1)
    return Bodies(inertia, np.ascontiguousarray(values[:, 6:9].T), np.ascontiguousarray(values[:, 9]))


def _sigma(real: float | None, stated: float | None, axes: Sequence[bool]) -> float:
    """Noise sigma of a sensor, true or stated; 1 if no axis is logged."""
    sigma = stated if real is None else real
    if not sigma and any(axes):
        raise ValueError("a bound needs noise on each sensor that is logged")
    return sigma or 1.0
