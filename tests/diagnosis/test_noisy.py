"""Noise that is stated too small is no cause but itself."""

from __future__ import annotations

import pytest

from tests import faulty
from tests.analysed import analysed

NOISE = frozenset({"gyro-misfit", "disturbance-torque", "accelerometer-misfit", "model-misfit"})


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("free-flyer", 1.3),
        pytest.param("air-bearing", 1.7, marks=pytest.mark.thorough),
        *(pytest.param(name, 3.0, marks=pytest.mark.thorough) for name in ("free-flyer", "air-bearing")),
        *(pytest.param("high-rate", times, marks=pytest.mark.thorough) for times in (1.3, 3.0)),
    ],
)
def test_no_other_cause_is_named(name: str, times: float) -> None:
    """A look's own misfit, by the motion within the cycles, was a gyro's bias of 15 microrad/s on the free flyer."""
    imu = analysed(name).vehicle.imu
    log, used = faulty.sample(name)
    stated = (f"imu.{key}={getattr(imu, key) / times}" for key in ("gyro_noise_rad_s", "accel_noise_m_s2"))
    found = faulty.examined(log, faulty.stated(used, *stated))
    assert {notice.code for notice in found.notices} <= NOISE
    assert "gyro-misfit" in {notice.code for notice in found.notices}
    assert found.vehicle.imu.gyro_noise_rad_s == pytest.approx(imu.gyro_noise_rad_s, rel=0.1)


@pytest.mark.thorough
def test_a_fault_is_named_where_the_noise_is_left_to_be_found() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    unstated = used.model_copy(update={"imu": used.imu.model_copy(update={"gyro_noise_rad_s": None, "accel_noise_m_s2": None})})
    found = faulty.examined(log, faulty.pushing(unstated, {"yaw_p1": -1.0}))
    (notice,) = [notice for notice in found.notices if notice.code == "jet-sign"]
    assert "yaw_p1" in notice.message
    assert type(found.vehicle.imu.gyro_noise_rad_s) is float
