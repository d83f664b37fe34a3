"""Disturbance torques are sized at the levels that they were flown with."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate import sizing
from massprop_cli.estimate.history import phases_of
from massprop_cli.model import lifted
from massprop_cli.prepare.stream import Stream
from massprop_cli.testbed import scenario, simulate
from tests.flight import resolved

PLAN = [
    "duration_s=20.0",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=20.0}]',
]
SEEDS = range(1, 9)
pytestmark = pytest.mark.numerical


def sized(name: str, keys: list[str], noisier: bool = False) -> np.ndarray:
    """(S, 3) levels found: torques, white and wandering, N m; times as noisy as stated."""
    flown = simulate.fly(scenario.load(name, [*PLAN, *keys]), list(SEEDS))
    found = []
    for member in range(len(SEEDS)):
        log, used = flown.log(member), flown.vehicle
        samples = Stream.of(log, used, stated_timing(used))
        found.append(sizing.torque_levels(samples, [cycles for _, cycles in phases_of(log, used, samples)], resolved(used), noisier))
    return np.array(found)


@pytest.mark.parametrize("name", ["free-flyer", "testbed"])
@pytest.mark.parametrize(("key", "column", "levels"), [("torque_n_m", 0, (0.003, 0.05)), ("walk_n_m", 1, (1e-4, 3e-3))])
def test_the_level_of_a_torque_is_found(name: str, key: str, column: int, levels: tuple[float, float]) -> None:
    """Within an eighth on the mean of eight seeds, none by more than a third off: a walk of 400 cycles is what it came to be."""
    for true in levels:
        ratio = sized(name, [f"disturbance.{key}={true}"])[:, column] / true
        assert np.exp(np.log(ratio).mean()) == pytest.approx(1.0, abs=0.125)
        assert 0.67 < ratio.min() < ratio.max() < 1.5


def test_where_there_is_none_none_is_found() -> None:
    """... that matters: a hundredth of the torque by which a cycle moves the rate as much as the gyro's noise does."""
    flown = simulate.fly(scenario.load("free-flyer", PLAN), [1])
    moment = min(flown.truth[0, 0][[0, 3, 5]]) * (flown.vehicle.imu.gyro_noise_rad_s or 0.0) / flown.vehicle.cycle.period_s
    assert sized("free-flyer", [])[:, :2].max() < 0.01 * moment


@pytest.mark.parametrize("name", ["free-flyer", "testbed"])
@pytest.mark.parametrize("times", [1.3, 3.0])
def test_a_gyro_that_is_noisier_than_stated_is_no_torque(name: str, times: float) -> None:
    """What no coefficients explain of 400 cycles tells one sigma to 2 %, on three axes."""
    noise = scenario.load(name, PLAN).scenario.vehicle.imu.gyro_noise_rad_s or 0.0
    found = sized(name, [f"sensors.gyro_noise_rad_s={times * noise}"], noisier=True)
    np.testing.assert_array_equal(found[:, :2], 0.0)
    np.testing.assert_allclose(found[:, 2], times, rtol=0.08)


@pytest.mark.parametrize("key", ["torque_n_m=0.02", "walk_n_m=0.001"])
def test_a_torque_is_no_noise_of_the_gyro(key: str) -> None:
    found = sized("free-flyer", [f"disturbance.{key}"], noisier=True)
    assert (found[:, 2] == 1.0).all()
    assert (found[:, :2].max(1) > 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_rounding_decides_no_level(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of columns that are sums of others it leaves some, which another CPU's kernels leave otherwise: levels had moved with it."""
    flown = simulate.fly(scenario.load("free-flyer", [*PLAN, "disturbance.torque_n_m=0.02", "disturbance.walk_n_m=5e-4"]), [seed])
    log, used = flown.log(0), resolved(flown.vehicle)
    rng, integrals = np.random.default_rng(seed), lifted.integrals_about
    mixed = rng.standard_normal((6, 4))
    found = []
    for noise in (0.0, 1e-15, 1e-15, 1e-14):

        def rounded(*arguments: Any, noise: float = noise) -> Any:
            step, *rest = integrals(*arguments)
            more = np.hstack([step, step[:, :6] @ mixed])
            return more * (1 + noise * rng.standard_normal(more.shape)), *rest

        monkeypatch.setattr("massprop_cli.estimate.sizing.integrals_about", rounded)
        samples = Stream.of(log, used, stated_timing(used))
        found.append(sizing.torque_levels(samples, [slice(2, 400)], used))
    assert found[0].white > 0
    np.testing.assert_allclose(found, np.tile(found[0], (4, 1)), rtol=1e-12)
