"""A simulated IMU that is sampled or low-pass filtered, estimated with the vehicle file that comes with its log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from massprop_cli import QUANTITIES, job
from massprop_cli.testbed import output, scenario, simulate

KINDS = {
    "samples": ('vehicle.imu.measures="sample"',),
    "means of first order": (
        "vehicle.imu.measures=mean",
        *(f"vehicle.imu.{s}_filter={{order=1, cutoff_hz=40}}" for s in ("gyro", "accel")),
    ),
    "samples of second order": ('vehicle.imu.measures="sample"', *(f"vehicle.imu.{s}_filter={{cutoff_hz=30}}" for s in ("gyro", "accel"))),
}


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.thorough, pytest.mark.seeds] if kind != "samples" else ()) for kind in KINDS]
)
def test_a_simulated_imu_of_any_kernel_is_estimated(kind: str, tmp_path: Path) -> None:
    plan = 'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], every_cycles=5, max_cycles=4, start_s=0.0, end_s=20.0}]'
    source = scenario.load("free-flyer", ["duration_s=20", plan, "sensors.records_per_cycle=5", *KINDS[kind]])
    flight = simulate.fly(source, [3])
    output.write(flight, 0, source.scenario, tmp_path)
    found = job.of_file(tmp_path / "log.parquet").analysis
    estimates = found.conclusions[0].estimates
    value, sigma = (np.array([getattr(estimates[name], part) for name in QUANTITIES], dtype=float) for part in ("value", "sigma"))
    assert np.abs((value - flight.truth[0, 0]) / sigma).max() < 4.5
    assert not [notice.code for notice in found.notices if not notice.code.startswith("noise")]
    assert found.vehicle.imu.measures == flight.vehicle.imu.measures


def test_what_cannot_be_simulated_is_refused() -> None:
    with pytest.raises(Exception, match="give the true cutoff_hz"):
        scenario.load("free-flyer", ['vehicle.imu.gyro_filter={cutoff_hz="auto"}'])
