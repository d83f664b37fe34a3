"""A gyro whose axes are out of square: it looks turned, and no value that a shear moves is called good."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import frozen
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate

TURNS = ", ".join(
    f'{{motion="random", axes=["{axis}"], every_cycles=5, max_cycles=4, start_cycle={60 * i}, end_cycle={60 * i + 60}}}'
    for i, axis in enumerate(("roll", "pitch", "yaw", "x", "y", "z"))
)
ALL = '{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], every_cycles=5, max_cycles=4, start_cycle=360, end_cycle=500}'
LEANING = np.array([[1.0, 0.01, 0.0], [0.0, 1.0, 0.01], [0.01, 0.0, 1.0]])
"""What each axis measures of the rates about the three."""


@pytest.mark.numerical
@pytest.mark.parametrize(("size", "seed"), [(0.3, 2), (1.0, 1), (1.0, 3)])
def test_what_a_shear_moves_is_not_called_good_where_a_turn_is_named(size: float, seed: int) -> None:
    """Before, moments had been converged 45 sigma off on other vehicles, stated and mended alike."""
    flown = simulate.fly(scenario.load("free-flyer", ("duration_s=25.0", f"plan=[{TURNS}, {ALL}]")), [seed])
    log, leaning = flown.log(0), np.eye(3) + size * (LEANING - np.eye(3))
    skewed = replace(log, delta_theta_imu_rad=frozen(log.delta_theta_imu_rad @ leaning.T))
    found = flow.examine(skewed, VehicleSource(flown.vehicle, "", ""))
    assert found.faults or found.unknown
    for conclusions in (found.conclusions, *(answer.conclusions for answer in found.mended)):
        for item, true in zip(conclusions[0].estimates.values(), flown.truth[0][0], strict=True):
            if item.verdict == "converged":
                assert item.value is not None
                assert item.sigma is not None
                assert abs(item.value - true) < 4 * item.sigma
    if size == 0.3:  # its mended sigmas hold a shear as large as the turn
        assert "imu-mounting" in {fault.notice.code for fault in found.faults}
        clean = flow.examine(log, VehicleSource(flown.vehicle, "", "")).conclusions[0].estimates
        for name in ("ixx", "iyy", "izz"):
            sigmas = [each[name].sigma for each in (found.mended[0].conclusions[0].estimates, clean)]
            assert sigmas[0] is not None
            assert sigmas[1] is not None
            assert sigmas[0] > 3 * sigmas[1]
