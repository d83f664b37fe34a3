"""Noise that is stated too small is no cause but itself."""

from __future__ import annotations

import pytest

from massprop_cli.flow import analyse
from tests.analysed import SAMPLES

NOISE = frozenset({"gyro-misfit", "disturbance-torque", "accelerometer-misfit", "model-misfit"})
pytestmark = pytest.mark.numerical


@pytest.mark.parametrize("times", [1.3, 1.7, 3.0])
@pytest.mark.parametrize("name", ["free-flyer", "air-bearing", "high-rate"])
def test_no_other_cause_is_named(name: str, times: float) -> None:
    """A look's own misfit, by the motion within the cycles, was a gyro's bias of 15 microrad/s on the free flyer."""
    imu = analyse(SAMPLES / name / "log.parquet").vehicle.imu
    stated = (f"imu.{key}={getattr(imu, key) / times}" for key in ("gyro_noise_rad_s", "accel_noise_m_s2"))
    found = analyse(SAMPLES / name / "log.parquet", assignments=tuple(stated))
    assert {notice.code for notice in found.notices} <= NOISE
    assert "gyro-misfit" in {notice.code for notice in found.notices}
    assert found.vehicle.imu.gyro_noise_rad_s == pytest.approx(imu.gyro_noise_rad_s, rel=0.1)
