"""The Cramér–Rao bound of a flight: how well any unbiased estimator could tell the mass properties from its log.

By the sensitivities of :mod:`massprop_cli.testbed.bound`. Body rates at the start of a phase are unknown, and so are damping and, beside
wheels, the scale of all thrust, as far as the vehicle file says.
"""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.testbed.bound import sensitivities
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import SimulatedFlight

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
        slopes = sensitivities(source, seeds, flight.issued[members], flight.truth[members, i], start, _beside(source))
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


def _covariance(slopes: Array) -> Array:
    """Inverse of the information matrix ``S Sᵀ`` of whitened sensitivities S, without forming it."""
    size = np.sqrt((slopes**2).sum(1))
    size = np.where(size > 0, size, 1.0)
    vectors, values, _ = np.linalg.svd(slopes / size[:, None], full_matrices=False)
    root = vectors / np.maximum(values, RESOLVED * values[0]) / size[:, None]
    found: Array = root @ root.T
    return found
