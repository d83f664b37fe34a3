"""Disturbance torques are sized at the levels that they were flown with."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate import sizing
from massprop_cli.estimate.history import phases_of
from massprop_cli.model import regressors
from massprop_cli.prepare.stream import Stream
from massprop_cli.testbed import scenario, simulate
from tests.flight import resolved

SEEDS = range(1, 9)


def plan(seconds: float) -> list[str]:
    axes = '"roll", "pitch", "yaw", "x", "y", "z"'
    return [f"duration_s={seconds}", f'plan=[{{motion="random", axes=[{axes}], start_s=0.0, end_s={seconds}}}]']


@cache
def flown(name: str, *keys: str, seconds: float = 10.0) -> simulate.SimulatedFlight:
    return simulate.fly(scenario.load(name, [*plan(seconds), *keys]), list(SEEDS))


def sized(flight: simulate.SimulatedFlight, times: float = 1.0, noisier: bool = True) -> np.ndarray:
    """(S, 3) levels found: torques, white and wandering, N m; times as noisy as stated.

    The gyro is ``times`` as noisy as stated.
    """
    found = []
    for member in range(len(SEEDS)):
        log, used = flight.log(member), resolved(flight.vehicle)
        more = np.sqrt(times**2 - 1) * used.imu.gyro_noise_rad_s * log.interval_s[:, None]
        turned = log.delta_theta_imu_rad + more * np.random.default_rng(member).standard_normal((log.rows, 3))
        samples = Stream.of(replace(log, delta_theta_imu_rad=turned), flight.vehicle, stated_timing(flight.vehicle))
        cycles = [cycles for _, cycles in phases_of(log, flight.vehicle, samples)]
        found.append(sizing.torque_levels(samples, cycles, used, noisier))
    return np.array(found)


LONG = [
    *(("free-flyer", "torque_n_m", true) for true in (0.003, 0.05)),
    *(("free-flyer", "walk_n_m", true) for true in (1e-4, 3e-3)),
    *(("testbed", "torque_n_m", 0.05), ("testbed", "walk_n_m", 1e-4)),
]


@pytest.mark.numerical
@pytest.mark.parametrize(
    ("name", "key", "true", "seconds"),
    [
        ("free-flyer", "torque_n_m", 0.02, 10.0),
        ("testbed", "walk_n_m", 1e-3, 10.0),
        *(pytest.param(*one, 20.0, marks=pytest.mark.thorough) for one in LONG),
    ],
)
def test_the_level_of_a_torque_is_found_and_is_no_noise_of_the_gyro(name: str, key: str, true: float, seconds: float) -> None:
    """Within an eighth on the mean of eight seeds, none by more than a third off: a walk of 200 cycles is what it came to be."""
    found = sized(flown(name, f"disturbance.{key}={true}", seconds=seconds))
    column = ("torque_n_m", "walk_n_m").index(key)
    ratio = found[:, column] / true
    assert np.exp(np.log(ratio).mean()) == pytest.approx(1.0, abs=0.125)
    assert 0.67 < ratio.min() < ratio.max() < 1.5
    assert (found[:, 2] == 1.0).all()


def test_where_there_is_none_none_is_found() -> None:
    """... that matters: a hundredth of the torque by which a cycle moves the rate as much as the gyro's noise does."""
    flight = flown("free-flyer")
    moment = min(flight.truth[0, 0][[0, 3, 5]]) * (flight.vehicle.imu.gyro_noise_rad_s or 0.0) / flight.vehicle.cycle.period_s
    assert sized(flight, noisier=False)[:, :2].max() < 0.01 * moment


@pytest.mark.parametrize("name", ["free-flyer", pytest.param("testbed", marks=pytest.mark.thorough)])
@pytest.mark.parametrize("times", [1.3, 3.0])
def test_a_gyro_that_is_noisier_than_stated_is_no_torque(name: str, times: float) -> None:
    """What no coefficients explain of 200 cycles tells one sigma to 3 %, on three axes."""
    found = sized(flown(name), times)
    np.testing.assert_array_equal(found[:, :2], 0.0)
    np.testing.assert_allclose(found[:, 2], times, rtol=0.08)


@pytest.mark.numerical
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in (1, 2, 3))])
def test_rounding_decides_no_level(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of columns that are sums of others it leaves some, which another CPU's kernels leave otherwise: levels had moved with it."""
    flown = simulate.fly(scenario.load("free-flyer", [*plan(10.0), "disturbance.torque_n_m=0.02", "disturbance.walk_n_m=5e-4"]), [seed])
    log, used = flown.log(0), resolved(flown.vehicle)
    rng, integrals = np.random.default_rng(seed), regressors.integrals_about
    mixed = rng.standard_normal((6, 4))
    found = []
    for noise in (0.0, 1e-15, 1e-15, 1e-14):

        def rounded(*arguments: Any, noise: float = noise) -> Any:
            step, *rest = integrals(*arguments)
            more = np.hstack([step, step[:, :6] @ mixed])
            return more * (1 + noise * rng.standard_normal(more.shape)), *rest

        monkeypatch.setattr("massprop_cli.estimate.sizing.integrals_about", rounded)
        samples = Stream.of(log, used, stated_timing(used))
        found.append(sizing.torque_levels(samples, [slice(2, 200)], used))
    assert found[0].white > 0
    np.testing.assert_allclose(found, np.tile(found[0], (4, 1)), rtol=1e-12)
