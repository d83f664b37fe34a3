"""Noise levels that a vehicle file leaves open."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.estimate import noiselevels
from tests import flight

CYCLES = [slice(2, 300)]


def test_absent_noise_levels_are_estimated_from_the_log() -> None:
    used = flight.vehicle(imu={"gyro_noise_rad_s": None, "accel_noise_m_s2": None})
    flown = flight.fly(used, flight.pulses(300, quiet=40), flight.TRUTH)
    for seed in range(5):
        found, notices = noiselevels.with_noise_levels(flown.samples(np.random.default_rng(seed)), CYCLES, used)
        assert found.imu.gyro_noise_rad_s == pytest.approx(1e-4, rel=0.35)
        assert found.imu.accel_noise_m_s2 == pytest.approx(0.02, rel=0.35)
        assert [n.code for n in notices] == ["noise-estimated"] * 2


def test_zero_noise_gets_a_named_floor() -> None:
    used = flight.vehicle(imu={"gyro_noise_rad_s": 0.0, "accel_noise_m_s2": 0.0})
    flown = flight.standard("free")
    found, notices = noiselevels.with_noise_levels(flown.samples(), [slice(2, 100)], used)
    assert 0 < found.imu.gyro_noise_rad_s < 1e-5
    assert [n.code for n in notices] == ["noise-floor"] * 2
