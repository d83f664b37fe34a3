"""Logs without an accelerometer, or without single axes of a sensor: at the bound of what they hold, and honest about the rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.flow import Analysis
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import bound, scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import Flight

pytestmark = pytest.mark.numerical

TOGETHER = 10
"""Seeds whose bounds are found side by side."""
NO_ACCELEROMETER, YAW = "sensors.accel_axes=[]", 'sensors.gyro_axes=["z"]'
ALL, INERTIA = QUANTITIES[:9], QUANTITIES[:6]
PLANE = ("izz", "cg_x", "cg_y")


@dataclass(frozen=True)
class Case:
    """A scenario, what its log lacks, what that leaves observable, and of how many seeds 700 values come."""

    scenario: str
    settings: tuple[str, ...]
    told: tuple[str, ...]
    seeds: int


def plan(axes: str, seconds: int) -> tuple[str, ...]:
    return f"duration_s={seconds}", f'plan=[{{motion="random", axes=[{axes}], every_cycles=5, max_cycles=4, start_s=0.0, end_s={seconds}}}]'


FREE = plan('"roll", "pitch", "yaw", "x", "y", "z"', 20)
TABLE = plan('"x", "y", "yaw"', 20)
TURNED = ("vehicle.imu.body_from_imu=[[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]]",)
CASES = {
    "jets, gyro alone": Case("free-flyer", (*FREE, NO_ACCELEROMETER), ALL, 80),
    "wheels, gyro alone": Case("wheels", (*plan('"roll", "pitch", "yaw"', 10), NO_ACCELEROMETER), INERTIA, 120),
    "table, yaw gyro alone": Case("planar", (*TABLE, NO_ACCELEROMETER, YAW), PLANE, 240),
    "table, yaw gyro and two accelerations": Case("planar", (*TABLE, YAW, 'sensors.accel_axes=["x", "y"]'), (*PLANE, "mass"), 180),
    "air bearing, gyro alone": Case("testbed", (NO_ACCELEROMETER,), QUANTITIES, 80),
    "jets, two accelerations askew": Case("free-flyer", (*FREE, *TURNED, 'sensors.accel_axes=["x", "z"]'), QUANTITIES, 72),
}
VERDICTS = {"mass": "sensor-absent-mass"}


@cache
def flown(name: str, seeds: int) -> tuple[ScenarioSource, Flight]:
    source = scenario.load(CASES[name].scenario, CASES[name].settings)
    return source, simulate.fly(source, range(1, seeds + 1))


def estimated(flight: Flight, member: int = 0, *settings: str) -> Analysis:
    return flow.examine(flight.log(member), VehicleSource(vehiclefile.changed(flight.vehicle, settings), "", ""))


def limits(source: ScenarioSource, flight: Flight, seeds: int) -> Array:
    """(S, 10) one sigma of each log's bound."""
    parts = [bound.of_members(source, flight, slice(first, min(first + TOGETHER, seeds)))[:, 0] for first in range(0, seeds, TOGETHER)]
    found: Array = np.sqrt(np.diagonal(np.concatenate(parts), axis1=1, axis2=2))
    return found


def conclusion_of(flight: Flight, member: int) -> Conclusion:
    """With no notice, and nothing contradicted."""
    analysis = estimated(flight, member)
    assert analysis.notices == ()
    assert not analysis.conclusions[0].causes
    return analysis.conclusions[0]


@pytest.mark.parametrize("name", CASES)
def test_sigmas_are_the_bound_and_nothing_else_is_given(name: str) -> None:
    case = CASES[name]
    source, flight = flown(name, 1)
    conclusion, told = conclusion_of(flight, 0), [QUANTITIES.index(one) for one in case.told]
    assert {one for one, e in conclusion.estimates.items() if e.value is not None} == set(case.told)
    ratio = np.sqrt(np.diag(conclusion.covariance))[told] / limits(source, flight, 1)[0, told]
    assert 0.97 < ratio.min() < ratio.max() < 1.08
    assert (np.abs((conclusion.values - flight.truth[0, 0]) / conclusion.sigmas)[told] < 4.5).all()
    assert {e.verdict for one, e in conclusion.estimates.items() if one not in case.told} <= {"unobservable"}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_errors_over_many_seeds_are_within_a_tenth_of_the_bound_and_intervals_cover(name: str) -> None:
    """700 values: chance leaves 2.7 % of the rms error, 0.8 % of the cover."""
    case = CASES[name]
    source, flight = flown(name, case.seeds)
    told = [QUANTITIES.index(one) for one in case.told]
    found = [conclusion_of(flight, member) for member in range(case.seeds)]
    error = (np.array([one.values for one in found]) - flight.truth[:, 0])[:, told]
    assert np.isfinite(error).all()
    assert np.sqrt(((error / limits(source, flight, case.seeds)[:, told]) ** 2).mean()) <= 1.1
    inside = np.abs(error) <= 1.96 * np.array([one.sigmas for one in found])[:, told]
    assert 0.93 <= inside.mean() <= 0.97


def test_what_an_accelerometer_would_tell_is_said_to_be_unobservable_for_want_of_it() -> None:
    _, flight = flown("jets, gyro alone", 1)
    mass = estimated(flight).conclusions[0].estimates["mass"]
    assert (mass.value, mass.verdict, mass.reason.code) == (None, "unobservable", "sensor-absent-mass")
    assert "no accelerometer" in str(mass.reason)
    assert "state known.mass" in str(mass.reason)
    _, flight = flown("wheels, gyro alone", 1)
    reasons = {one: e.reason.code for one, e in estimated(flight).conclusions[0].estimates.items() if e.value is None}
    assert reasons == {"cg_x": "sensor-absent", "cg_y": "sensor-absent", "cg_z": "sensor-absent", "mass": "no-motion-informs"}


def test_a_known_mass_is_given_and_leaves_the_others() -> None:
    _, flight = flown("jets, gyro alone", 1)
    plain, weighed = estimated(flight).conclusions[0], estimated(flight, 0, "known.mass={ value = 22.0, sigma = 0.01 }").conclusions[0]
    np.testing.assert_allclose([weighed.values[9], weighed.sigmas[9]], [22.0, 0.01], rtol=1e-3)
    np.testing.assert_allclose(weighed.values[:9], plain.values[:9], rtol=0, atol=1e-3 * plain.sigmas[:9].min())
    np.testing.assert_allclose(weighed.sigmas[:9], plain.sigmas[:9], rtol=1e-6)


def test_a_gyro_alone_on_an_air_bearing_tells_the_cg_by_the_weight_once_the_mass_is_known() -> None:
    """Gravity's torque is mass times offset: beside the mass of a weighed vehicle the offset is as good as that product."""
    _, flight = flown("air bearing, gyro alone", 1)
    plain, weighed = (estimated(flight, 0, *settings).conclusions[0] for settings in ((), ("known.mass={ value = 25.0, sigma = 0.01 }",)))
    assert (weighed.sigmas[6:9] < 0.1 * plain.sigmas[6:9]).all()
    assert (np.abs(weighed.values - flight.truth[0, 0]) < 4 * weighed.sigmas).all()


def test_a_log_that_lacks_its_accelerometer_is_as_good_as_one_with_a_deaf_one() -> None:
    """Of noise a million times larger nothing is left but what the gyro tells."""
    source, flight = flown("jets, gyro alone", 1)
    whole = scenario.load("free-flyer", (*FREE, "sensors.accel_noise_m_s2=0.02", "vehicle.imu.accel_noise_m_s2=2e4"))
    deaf = estimated(simulate.fly(whole, [1])).conclusions[0]
    alone = estimated(flight).conclusions[0]
    np.testing.assert_allclose(alone.sigmas[:9], deaf.sigmas[:9], rtol=1e-4)
    assert source.scenario.sensors.axes == (True,) * 3 + (False,) * 3


def test_a_fault_is_contradicted_without_a_search_for_its_cause() -> None:
    """A delay that is a cycle off."""
    _, flight = flown("jets, gyro alone", 1)
    analysis = estimated(flight, 0, "cycle.command_delay_cycles=3")
    assert "causes are looked for only in logs with all three axes" in analysis.unknown
    verdicts = {e.verdict for e in analysis.conclusions[0].estimates.values()}
    assert verdicts == {"contradicted", "unobservable"}


@pytest.mark.parametrize("name", ["jets, gyro alone", "table, yaw gyro and two accelerations"])
def test_an_unknown_delay_is_found_without_the_absent_axes(name: str) -> None:
    _, flight = flown(name, 1)
    analysis = estimated(flight, 0, "cycle.command_delay_cycles=auto")
    assert analysis.timing.delay == pytest.approx(flight.vehicle.cycle.command_delay_cycles, abs=0.01)
    assert not analysis.conclusions[0].causes


@pytest.mark.parametrize("name", ["jets, gyro alone", "jets, two accelerations askew"])
def test_noise_levels_that_are_left_open_are_those_of_the_axes_that_are_there(name: str) -> None:
    _, flight = flown(name, 1)
    stated = {"imu.gyro_noise_rad_s": 1e-4, "imu.accel_noise_m_s2": 0.02}
    analysis = estimated(flight, 0, *(f"{key}=0" for key in stated))
    imu = analysis.vehicle.imu
    assert imu.gyro_noise_rad_s == pytest.approx(1e-4, rel=0.1)
    told = [notice.message for notice in analysis.notices if notice.code == "noise-floor"]
    assert sum("imu.accel_noise_m_s2" in message for message in told) == (name != "jets, gyro alone")
    if name != "jets, gyro alone":
        assert imu.accel_noise_m_s2 == pytest.approx(0.02, rel=0.1)
