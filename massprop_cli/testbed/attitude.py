"""The attitude as it is logged, by motion capture or a star tracker: late, noisy, in axes of its own, in some of the records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.testbed.motion import compose, dot, quaternions
from massprop_cli.testbed.scenario import Scenario


def logged(scenario: Scenario, rngs: Sequence[np.random.Generator], true_wxyz: Array) -> Array | None:
    """(S, K N, 4) after each record, NaN where none is logged; None where the scenario logs none.

    ``true_wxyz`` (S, K N + 1, 4) is the attitude at the start and after each record; between two of them the body turns at a steady rate.
    """
    sensors, stated = scenario.sensors, scenario.vehicle.imu
    if not sensors.log_attitude:
        return None
    latency_s = stated.attitude_latency_s if sensors.attitude_latency_s is None else sensors.attitude_latency_s
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
    vector = turn[1:] * np.where(sine > 0, angle / np.maximum(sine, 1e-300), 2.0)
    return compose(first, quaternions(vector * (at - before)))
