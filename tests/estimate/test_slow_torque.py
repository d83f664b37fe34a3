"""Beside a slow torque, which a weight off the bearing makes up for: neither is told alone, and nothing else may be drawn from that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import parallel_axis, tensor
from massprop_cli.estimate.regression import Regression
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.plant import Reference
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from massprop_cli.testbed import scenario, simulate
from tests.estimate.test_on_the_way import SCENARIOS, flown
from tests.flight import resolved

NAME = "vehicle-40, slow torque"
"""On a bearing, for nine seconds, tilted by no more than a fifth of a degree."""


def pushed() -> simulate.SimulatedFlight:
    """Beside a steady torque, too."""
    data = {name: part for name, part in SCENARIOS[NAME].items() if name != "seed"}
    data["disturbance"] = {"constant_n_m": [8.0, -8.0, 4.0]}
    return simulate.fly(scenario.ScenarioSource(scenario.Scenario.model_validate(data), "vehicle-40"), range(1, 4))


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("fly", "members"), [(lambda: flown(NAME, None), range(1, 3)), (pushed, range(3))], ids=["alone", "beside a steady one"]
)
def test_the_cg_is_as_far_off_as_its_sigma_says(fly: Callable[[], simulate.SimulatedFlight], members: range) -> None:
    """What swings the body was taken as commands and weight alone: it was 2 cm ± 1.5 mm off, and on the way 15 sigma."""
    flight, squares = fly(), 0.0
    for k in members:
        (conclusion,) = flow.examine(flight.log(k), VehicleSource(flight.vehicle, "", "")).conclusions
        off = (conclusion.values - flight.truth[k][0])[6:9] / np.sqrt(np.diag(conclusion.covariance))[6:9]
        squares += float(off @ off)
    assert squares < chi2(3 * len(members)).ppf(0.9999)


def sigmas_about(member: int, offset: Array) -> Array:
    """(10,) of the state parameters about the truth with its CG moved, and a steady torque that holds it up."""
    flight = flown(NAME, None)
    log, truth, vehicle = flight.log(member), flight.truth[member][0], flight.vehicle
    environment, stream = vehicle.environment, Stream.of(log, vehicle, Timing(float(vehicle.cycle.command_delay_cycles), 0.0))
    turning, about = truth[9] - environment.bearing_mass_kg, truth[6:9] + offset - np.array(environment.bearing_position_m)
    weight = environment.gravity_m_s2 * turning * np.cross(offset, [0.0, 0.0, 1.0])
    held = np.linalg.solve(tensor(truth[:6]) + parallel_axis(turning, about), weight)
    regression = Regression(stream, slice(2, log.cycles), resolved(vehicle), Consider())
    begun = regression.begin(Reference(tensor(truth[:6]), truth[6:9] + offset, 1 / truth[9], acceleration=held))
    run, _ = regression.process(replace(begun, tied=True), log.cycles)
    found: Array = np.sqrt(np.diag(regression.row(run).covariance[0]))
    return found


@pytest.mark.thorough
@pytest.mark.seeds
def test_what_is_told_of_the_cg_is_the_same_about_any_reference_that_the_log_can_t_tell_apart() -> None:
    """The CG's height was told to 1.5 mm instead of 3.3 about a CG 16 mm off: by a swing of 3e-1 rad/s² that nothing made."""
    member = flown(NAME, None).seeds.index(14)
    plain = sigmas_about(member, np.zeros(3))
    for axis in range(2):
        np.testing.assert_allclose(sigmas_about(member, 0.016 * np.eye(3)[axis])[6:9], plain[6:9], rtol=0.03)
