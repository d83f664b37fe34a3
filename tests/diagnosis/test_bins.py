"""How many bins a cycle has where nobody states it: as many as the gyro's noise asks for, not the turns alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from tests import anyimu


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize(("noise_rad_s", "least", "most"), [(0.001, 4, 4), (1e-05, 16, 64)])
def test_a_quiet_gyro_asks_for_more_bins(noise_rad_s: float, least: int, most: int) -> None:
    """A bearing that turns by less than 0.2 rad in a record of 0.2 s, without noise: four bins move values by 2 sigma of 1e-5 rad/s."""
    rng = np.random.default_rng(5)
    imu = anyimu.Imu(measures="increment", rate_hz=5.0, gyro_noise=noise_rad_s, accel_noise=100 * noise_rad_s)
    own = anyimu.bodies(rng, 1, bearing=True)
    own = replace(own, jet_force=0.3 * own.jet_force)
    flown = anyimu.fly(rng, own, imu, 0.2, 80.0, 0.4, noise=0.0)
    used = changed(anyimu.vehicle_of(own, 0, flown, imu, 0.2, 0.4, stated=True), ("cycle.command_delay_sigma_cycles=0",))
    answer = flow.examine(anyimu.log_of(flown, 0, imu, used), VehicleSource(used, "quiet", ""))
    assert least <= answer.vehicle.estimator.bins_per_cycle <= most
    told = zip(answer.conclusions[0].estimates.values(), anyimu.truth_of(own, 0), strict=True)
    away = [(one.value - truth) / one.sigma for one, truth in told if one.value is not None and one.sigma is not None]
    assert len(away) >= 6
    assert np.abs(away).max() < 0.5
