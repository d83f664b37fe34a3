"""A body that turns by much within a cycle: its motion is followed in bins as fine as that asks for."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.diagnosis.ready import finer
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import Flight

PLAN = (
    "duration_s=60.0",
    "initial.rate_rad_s=[1.0, -0.8, 1.2]",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], every_cycles=8, max_cycles=1, start_cycle=10, end_cycle=240}]',
    "vehicle.cycle.period_s=0.25",
    "vehicle.imu.gyro_noise_rad_s=3e-5",
    "vehicle.imu.accel_noise_m_s2=5e-3",
    "vehicle.cycle.pwm_tick_s=0.0025",
)


@pytest.fixture(scope="module")
def flights() -> Flight:
    return simulate.fly(scenario.load("free-flyer", PLAN), list(range(1, 7)))


def test_bins_follow_the_turn_of_a_cycle_where_none_are_stated(flights: Flight) -> None:
    log, vehicle = flights.log(0), flights.vehicle
    turn = np.linalg.norm(log.delta_theta_imu_rad, axis=1)
    assert np.median(turn) > 0.3
    assert finer(log, vehicle).estimator.bins_per_cycle == 16
    assert finer(log, changed(vehicle, ["estimator.bins_per_cycle=4"])).estimator.bins_per_cycle == 4
    assert finer(log, changed(vehicle, ["imu.gyro_noise_rad_s=1e-3"])).estimator.bins_per_cycle == 16
    still = simulate.fly(scenario.load("free-flyer"), [1])
    assert finer(still.log(0), still.vehicle).estimator.bins_per_cycle == 4


@pytest.mark.numerical
def test_errors_are_within_their_sigmas_and_four_bins_would_not_do(flights: Flight) -> None:
    """Six logs of ten values: root mean square of unit normal deviates, one in ten thousand beyond 1.37."""

    def errors(*settings: str) -> tuple[float, set[str]]:
        z, verdicts = [], set[str]()
        for member in range(6):
            found = flow.examine(flights.log(member), VehicleSource(changed(flights.vehicle, settings), "", ""))
            for item, true in zip(found.conclusions[0].estimates.values(), flights.truth[member][0], strict=True):
                verdicts.add(item.verdict)
                if item.value is not None and item.sigma:
                    z.append((item.value - true) / item.sigma)
        return float(np.sqrt(np.mean(np.square(z)))), verdicts

    size, verdicts = errors()
    assert size < 1.37
    assert "contradicted" not in verdicts
    coarse, _ = errors("estimator.bins_per_cycle=4")
    assert coarse > 1.5 * size
