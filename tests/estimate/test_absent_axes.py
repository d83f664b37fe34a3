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
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import SimulatedFlight
from tests import cramerrao

TOGETHER, FEW = 10, 3
"""Seeds whose bounds are found side by side, and those whose bounds are found."""
NO_ACCELEROMETER, YAW = "sensors.accel_axes=[]", 'sensors.gyro_axes=["z"]'
ALL, INERTIA = QUANTITIES[:9], QUANTITIES[:6]
PLANE = ("izz", "cg_x", "cg_y")


@dataclass(frozen=True)
class Case:
    """A scenario, what its log lacks, what that leaves observable, and seeds; on a bearing and by wheels a log's values go together."""

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
    "jets, gyro alone": Case("free-flyer", (*FREE, NO_ACCELEROMETER), ALL, 7),
    "wheels, gyro alone": Case("wheels", (*plan('"roll", "pitch", "yaw"', 10), NO_ACCELEROMETER), INERTIA, 42),
    "table, yaw gyro alone": Case("planar", (*TABLE, NO_ACCELEROMETER, YAW), PLANE, 21),
    "table, yaw gyro and two accelerations": Case("planar", (*TABLE, YAW, 'sensors.accel_axes=["x", "y"]'), (*PLANE, "mass"), 15),
    "air bearing, gyro alone": Case("testbed", (NO_ACCELEROMETER,), QUANTITIES, 60),
    "jets, two accelerations askew": Case("free-flyer", (*FREE, *TURNED, 'sensors.accel_axes=["x", "z"]'), QUANTITIES, 6),
}
FIRST = ("jets, gyro alone", "table, yaw gyro and two accelerations")
VERDICTS = {"mass": "sensor-absent-mass"}


@cache
def flown(name: str, seeds: int) -> tuple[ScenarioSource, SimulatedFlight]:
    source = scenario.load(CASES[name].scenario, CASES[name].settings)
    return source, simulate.fly(source, range(1, seeds + 1))


def estimated(flight: SimulatedFlight, member: int = 0, *settings: str) -> Analysis:
    return flow.examine(flight.log(member), VehicleSource(vehiclefile.changed(flight.vehicle, settings), "", ""))


def limits(source: ScenarioSource, flight: SimulatedFlight, seeds: int) -> Array:
    """(S, 10) one sigma of each log's bound."""
    parts = [cramerrao.of_members(source, flight, slice(first, min(first + TOGETHER, seeds)))[:, 0] for first in range(0, seeds, TOGETHER)]
    found: Array = np.sqrt(np.diagonal(np.concatenate(parts), axis1=1, axis2=2))
    return found


def conclusion_of(flight: SimulatedFlight, member: int) -> Conclusion:
    """With no notice, and nothing contradicted."""
    analysis = estimated(flight, member)
    assert analysis.notices == ()
    assert not analysis.conclusions[0].causes
    return analysis.conclusions[0]


@pytest.mark.numerical
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.thorough] * (name not in FIRST)) for name in CASES])
def test_sigmas_are_the_bound_and_nothing_else_is_given(name: str) -> None:
    case = CASES[name]
    source, flight = flown(name, 1)
    conclusion, told = conclusion_of(flight, 0), [QUANTITIES.index(one) for one in case.told]
    assert {one for one, e in conclusion.estimates.items() if e.value is not None} == set(case.told)
    ratio = np.sqrt(np.diag(conclusion.covariance))[told] / limits(source, flight, 1)[0, told]
    assert 0.97 < ratio.min() < ratio.max() < 1.08
    assert (np.abs((conclusion.values - flight.truth[0, 0]) / conclusion.sigmas)[told] < 4.5).all()
    assert {e.verdict for one, e in conclusion.estimates.items() if one not in case.told} <= {"unobservable"}


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_errors_over_many_seeds_are_within_a_tenth_of_the_bound_and_intervals_cover(name: str) -> None:
    """Some 60 to 125 independent values: chance leaves 6 to 9 % of the rms error. Of a few logs sigmas are tested against their bounds."""
    case = CASES[name]
    source, flight = flown(name, case.seeds)
    told = [QUANTITIES.index(one) for one in case.told]
    found = [conclusion_of(flight, member) for member in range(case.seeds)]
    sigmas = np.array([one.sigmas for one in found])[:, told]
    deviation = (np.array([one.values for one in found]) - flight.truth[:, 0])[:, told] / sigmas
    assert np.isfinite(deviation).all()
    beyond_bound = np.sqrt(((sigmas[:FEW] / limits(source, flight, FEW)[:, told]) ** 2).mean())
    assert beyond_bound * np.sqrt((deviation**2).mean()) <= 1.1
    assert abs((np.abs(deviation) <= 1.96).mean() - 0.95) < 2.5 * np.sqrt(0.95 * 0.05 / deviation.size)
