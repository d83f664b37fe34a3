"""A body that turns by much within a cycle: its motion is followed in bins as fine as that asks for."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis.preprocessing import finer
from massprop_cli.flow import Analysis
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight
from tests import faulty


def segment(axes: str, start: int, end: int, every: int, most: int) -> str:
    named = ", ".join(f'"{axis}"' for axis in axes.split())
    pulses = f"every_cycles={every}, max_cycles={most}"
    return f'{{motion="random", axes=[{named}], {pulses}, start_cycle={start}, end_cycle={end}}}'


SEGMENTS = (
    segment("x y z", 0, 30, 4, 1),
    segment("roll", 30, 60, 4, 1),
    segment("pitch", 60, 90, 3, 2),
    segment("yaw", 90, 120, 3, 2),
    segment("roll pitch yaw x y z", 120, 240, 4, 2),
)
PLAN = (
    "duration_s=60.0",
    f"plan=[{', '.join(SEGMENTS)}]",
    "vehicle.cycle.period_s=0.25",
    "vehicle.cycle.pwm_tick_s=0.0025",
    "vehicle.imu.gyro_noise_rad_s=3e-5",
    "vehicle.imu.accel_noise_m_s2=5e-3",
)
FAST = (0, 1, 5)
"""Members that turn by 0.45 rad a cycle and more."""


@pytest.fixture(scope="module")
def flights() -> SimulatedFlight:
    return simulate.fly(scenario.load("free-flyer", PLAN), list(range(1, 7)))


def test_bins_follow_the_turn_of_a_cycle_where_none_are_stated(flights: SimulatedFlight) -> None:
    log, vehicle = flights.log(0), flights.vehicle
    assert [finer(flights.log(member), vehicle).estimator.bins_per_cycle for member in range(6)] == [16, 16, 8, 8, 8, 16]
    assert finer(log, changed(vehicle, ["estimator.bins_per_cycle=4"])).estimator.bins_per_cycle == 4
    assert finer(log, changed(vehicle, ["imu.gyro_noise_rad_s=1e-3"])).estimator.bins_per_cycle == 16
    assert finer(*faulty.sample("free-flyer")).estimator.bins_per_cycle == 4


@pytest.mark.numerical
def test_errors_are_within_their_sigmas(flights: SimulatedFlight) -> None:
    """Six logs of ten values: root mean square of unit normal deviates, one in ten thousand beyond 1.37."""
    z = []
    for member in range(6):
        found = flow.examine(flights.log(member), VehicleSource(flights.vehicle, "", ""))
        assert {item.verdict for item in found.conclusions[0].estimates.values()} == {"converged"}
        z.append(sigmas(found, flights.truth[member][0]))
    assert np.sqrt(np.mean(np.square(z))) < 1.37


def sigmas(found: Analysis, other: Array) -> Array:
    """(10,) by how many of their sigmas the values are away from others."""
    estimates = found.conclusions[0].estimates.values()
    return np.array([((item.value or 0.0) - value) / (item.sigma or np.nan) for item, value in zip(estimates, other, strict=True)])


@pytest.mark.numerical
@pytest.mark.parametrize("member", [FAST[0], *(pytest.param(member, marks=pytest.mark.thorough) for member in FAST[1:])])
def test_finer_bins_would_change_nothing_and_four_do(member: int, flights: SimulatedFlight) -> None:
    log = flights.log(member)

    def examined(*settings: str) -> Analysis:
        return flow.examine(log, VehicleSource(changed(flights.vehicle, settings), "", ""))

    finest = examined("estimator.bins_per_cycle=64")
    exact = finest.conclusions[0].values
    coarse = np.abs(sigmas(examined("estimator.bins_per_cycle=4"), exact)).max()
    assert coarse > 0.3
    assert np.abs(sigmas(examined(), exact)).max() < 0.15 * coarse


@pytest.mark.thorough
@pytest.mark.numerical
def test_a_body_that_turns_by_more_than_half_a_radian_in_a_cycle_is_followed_in_finer_bins_still() -> None:
    slower = [value for value in PLAN if not value.startswith(("duration_s", "vehicle.cycle.period_s"))]
    flown = simulate.fly(scenario.load("free-flyer", (*slower, "duration_s=76.8", "vehicle.cycle.period_s=0.32")), [1])

    def examined(*settings: str) -> Analysis:
        return flow.examine(flown.log(0), VehicleSource(changed(flown.vehicle, settings), "", ""))

    assert finer(flown.log(0), flown.vehicle).estimator.bins_per_cycle == 32
    found, exact = examined(), examined("estimator.bins_per_cycle=128").conclusions[0].values
    assert {item.verdict for item in found.conclusions[0].estimates.values()} == {"converged"}
    assert np.abs(sigmas(examined("estimator.bins_per_cycle=16"), exact)).max() > 0.5
    assert np.abs(sigmas(found, exact)).max() < 0.3


ON_A_BEARING = (
    *("vehicle.cycle.period_s=0.2", "vehicle.imu.gyro_noise_rad_s=2e-5", "sensors.gyro_noise_rad_s=0", "sensors.accel_noise_m_s2=0"),
    *("vehicle.imu.gyro_bias_sigma_rad_s=0", "sensors.gyro_bias_rad_s=[0,0,0]"),
)


@pytest.mark.numerical
@pytest.mark.parametrize("settings", [(), ("vehicle.cycle.command_delay_cycles=0", "control.rate_gain_n_m_s=[0.1,0.5,0.5]")])
def test_on_a_bearing_pulses_turn_the_body_about_other_axes_than_their_mean_rate(settings: tuple[str, ...]) -> None:
    """Up to 0.23 rad in a cycle. Without the coning that pulses make values of the first were 7.4 sigma off and converged."""
    flown = simulate.fly(scenario.load("testbed", (*ON_A_BEARING, *settings)), [2])
    found = flow.examine(flown.log(0), VehicleSource(flown.vehicle, "", ""))
    assert not found.notices
    assert np.abs(sigmas(found, flown.truth[0, 0])).max() < 0.5
