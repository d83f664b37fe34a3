"""Noise levels that a vehicle file leaves open."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis import outliers
from massprop_cli.estimate import noiselevels
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from tests import faulty, flight

CYCLES = [slice(2, 300)]


def test_absent_noise_levels_are_estimated_from_the_log() -> None:
    used = flight.vehicle(imu={"gyro_noise_rad_s": None, "accel_noise_m_s2": None})
    flown = flight.fly(used, flight.pulses(300, quiet=40), flight.TRUTH)
    for seed in range(5):
        found, notices = noiselevels.with_noise_levels(flown.samples(np.random.default_rng(seed)), CYCLES, used)
        assert found.imu.gyro_noise_rad_s == pytest.approx(1e-4, rel=0.1)
        assert found.imu.accel_noise_m_s2 == pytest.approx(0.02, rel=0.1)
        assert [n.code for n in notices] == ["noise-estimated"] * 2


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5])
def test_readings_that_are_not_used_take_nothing_from_the_noise(share: float) -> None:
    """They were counted as if they had none: 8.8e-5, 6.5e-5 and 4.4e-5 rad/s for 1e-4."""
    log, stated = faulty.sample("free-flyer")
    rows = np.sort(np.random.default_rng(1).choice(log.rows, int(share * log.rows), replace=False))
    left_out = {f"{sensor}_outliers_s": tuple(float(log.time_s[row]) for row in rows) for sensor in ("gyro", "accel")}
    imu = stated.imu.model_copy(update=left_out | {"gyro_noise_rad_s": None, "accel_noise_m_s2": None})
    used = stated.model_copy(update={"imu": imu})
    samples = Stream.of(outliers.without_outliers(log, used), used, Timing(2.0, 0.0))
    found, _ = noiselevels.with_noise_levels(samples, [slice(2, log.cycles)], used)
    assert found.imu.gyro_noise_rad_s == pytest.approx(1e-4, rel=0.05)
    assert found.imu.accel_noise_m_s2 == pytest.approx(0.02, rel=0.05)


def test_zero_noise_gets_a_named_floor() -> None:
    used = flight.vehicle(imu={"gyro_noise_rad_s": 0.0, "accel_noise_m_s2": 0.0})
    flown = flight.standard("free")
    found, notices = noiselevels.with_noise_levels(flown.samples(), [slice(2, 100)], used)
    assert 0 < found.imu.gyro_noise_rad_s < 1e-5
    assert [n.code for n in notices] == ["noise-floor"] * 2


@pytest.mark.parametrize("count", [400, 4000])
def test_the_quietest_stretches_of_white_noise_tell_it_without_bias(count: int) -> None:
    """... and scatter by a third of what CHANCE allows."""
    every, read = [slice(0, count)], np.ones(count, dtype=bool)
    found = [noiselevels.white_level(np.random.default_rng(seed).normal(size=(count, 3)), every, read) for seed in range(100)]
    assert np.mean(found) == pytest.approx(1.0, abs=0.01)
    assert np.std(found) * count**0.5 == pytest.approx(noiselevels.CHANCE / 3, rel=0.25)


def white(torque: float, seed: int, period_s: float) -> Callable[[float], Array]:
    """Another one in each cycle."""
    each = torque * np.random.default_rng(100 + seed).normal(size=(301, 3))
    return lambda time_s: each[int(time_s / period_s)]


@pytest.mark.parametrize(
    ("torque", "seeds"), [(0.0, 6), (3e-3, 3), *(pytest.param(torque, 6, marks=pytest.mark.thorough) for torque in (1e-3, 3e-3))]
)
def test_a_white_torque_takes_nothing_from_the_gyros_noise(torque: float, seeds: int) -> None:
    """Its impulses turn the rate in two steps, which is what noise that is taken back in the next one does with another sign.

    The largest turns X by 2.4 times the gyro's noise in a cycle.
    """
    used = flight.vehicle(imu={"gyro_noise_rad_s": None, "accel_noise_m_s2": None})
    found = []
    for seed in range(seeds):
        push = white(torque, seed, used.cycle.period_s)
        flown = (
            flight.fly(used, flight.pulses(300), flight.TRUTH, torque=push, step_s=2 * flight.STEP) if torque else flight.standard("free")
        )
        samples = flown.samples(np.random.default_rng(seed))
        found.append(noiselevels.with_noise_levels(samples, CYCLES, used)[0].imu.gyro_noise_rad_s)
    assert np.mean(found) == pytest.approx(1e-4, rel=0.06)
