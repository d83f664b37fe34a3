"""A gyro bias that wanders is estimated along with the rest, and no sigma counts it as constant."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.testbed import scenario, simulate

SEEDS = 5
WALK = 1e-4
"""rad/s in a second: of a MEMS gyro, and a hundred times what a cycle's noise leaves of the mean rate of a minute."""
LOGGED = ("sensors.log_attitude=true", "sensors.attitude_noise_rad=1e-3")


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "settings"),
    [("free-flyer", ()), ("testbed", ()), ("testbed", LOGGED)],
    ids=["free", "bearing", "bearing with a logged attitude"],
)
def test_intervals_cover_the_truth_while_a_bias_walks(name: str, settings: tuple[str, ...]) -> None:
    """Of 50 values that are correlated in each log: an rms of 1 is known to 0.15. As a constant, the bias contradicts the log."""
    walking = (f"vehicle.imu.gyro_bias_walk_rad_s_sqrt_s={WALK}", "vehicle.imu.gyro_bias_sigma_rad_s=1e-3", *settings)
    flight = simulate.fly(scenario.load(name, walking), range(1, SEEDS + 1))
    z = []
    for member in range(SEEDS):
        found = flow.examine(flight.log(member), VehicleSource(flight.vehicle, "", ""))
        assert {notice.code for notice in found.notices} <= {"noise-estimated"}
        last = found.conclusions[-1]
        z.append((last.values - flight.truth[member][-1]) / np.sqrt(np.diag(last.covariance)))
    assert 0.6 < float(np.sqrt((np.array(z) ** 2).mean())) < 1.45
    constant = changed(flight.vehicle, ["imu.gyro_bias_walk_rad_s_sqrt_s=0"])
    without = flow.examine(flight.log(0), VehicleSource(constant, "", ""))
    assert without.notices


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_walk_without_a_sigma_is_a_bias_that_is_unknown_from_then_on() -> None:
    """What is stated of the walk alone widens sigmas as much as it moves values."""
    flight = simulate.fly(scenario.load("free-flyer", (f"vehicle.imu.gyro_bias_walk_rad_s_sqrt_s={WALK}",)), [1])
    assert flight.vehicle.imu.gyro_bias_sigma_rad_s == WALK  # by what it walks in a second, for a flight without a log as well
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "", ""))
    last = found.conclusions[-1]
    assert not found.notices
    assert np.abs((last.values - flight.truth[0][-1]) / np.sqrt(np.diag(last.covariance))).max() < 4
