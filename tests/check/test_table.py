"""On a table the IMU feels gravity along the body's Z and turns about it: one that is mounted otherwise is told."""

import numpy as np
import pytest

from massprop_cli.check.signals import on_table
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed import scenario, simulate

LEANING = ((1.0, 0.0, 0.0), (0.0, np.cos(0.1), -np.sin(0.1)), (0.0, np.sin(0.1), np.cos(0.1)))
DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))


@pytest.fixture(scope="module")
def flown() -> tuple[Log, Vehicle]:
    found = simulate.fly(scenario.load("planar", ["duration_s=6.0", "plan=[]", "initial.rate_rad_s=[0.0,0.0,0.3]"]), [1])
    plan = 'plan=[{motion="random",axes=["yaw"],start_s=0.0,end_s=12.0,every_cycles=5,max_cycles=4}]'
    pushed = simulate.fly(scenario.load("planar", ["duration_s=12.0", plan]), [1])
    assert on_table(found.log(0), found.vehicle) == []  # a steady turn tells nothing of the gyro's axes
    return pushed.log(0), pushed.vehicle


def mounted(vehicle: Vehicle, rows: tuple[tuple[float, ...], ...]) -> Vehicle:
    return vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update={"body_from_imu": rows})})


def test_nothing_is_said_of_an_imu_as_it_is_stated(flown: tuple[Log, Vehicle]) -> None:
    assert on_table(*flown) == []


def test_one_that_leans_shows_yaw_about_the_other_axes_and_gravity_beside_z(flown: tuple[Log, Vehicle]) -> None:
    log, vehicle = flown
    found = {one.code: one.what for one in on_table(log, mounted(vehicle, LEANING))}
    assert set(found) == {"table-gravity", "table-rocking"}
    assert "9.759 m/s^2" in found["table-gravity"]  # g cos 0.1


def test_one_that_is_upside_down_feels_gravity_the_other_way(flown: tuple[Log, Vehicle]) -> None:
    log, vehicle = flown
    found = {one.code: one.what for one in on_table(log, mounted(vehicle, DOWN))}
    assert set(found) == {"table-gravity"}
    assert "-9.807 m/s^2" in found["table-gravity"]


def test_nothing_is_said_but_on_a_table(flown: tuple[Log, Vehicle]) -> None:
    log, vehicle = flown
    free = vehicle.model_copy(update={"environment": vehicle.environment.model_copy(update={"kind": "free"})})
    assert on_table(log, mounted(free, DOWN)) == []
