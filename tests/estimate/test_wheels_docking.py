"""Docking of a vehicle with reaction wheels: what they tell of the object, with jets and alone."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.testbed import bound, scenario, simulate
from tests import faulty
from tests.estimate.test_wheels import PUSHES, TURNS, estimated

DOCKED = "docked={ixx=0.5, iyy=0.8, izz=0.6, ixy=0.02, ixz=-0.01, iyz=0.03, cg_x=0.7, cg_y=0.05, cg_z=-0.1, mass=8.0}"


def docking_at(seconds: int, dock: str) -> list[str]:
    """Settings of a flight that docks with 8 kg in its middle; turns by wheels and by jets, and pushes, before and after."""
    third, middle, last = seconds // 4, seconds // 2, 3 * seconds // 4
    halves = [(0, third, middle - 1), (middle + 1, last, seconds)]
    segments = [
        f'{{motion="random", axes=[{axes}], by_wheels={wheels}, start_s={start}, end_s={end}}}'
        for begin, between, stop in halves
        for axes, wheels, start, end in (
            (TURNS, "true", begin, between),
            (TURNS, "false", between, stop),
            (PUSHES, "false", begin, stop),
        )
    ]
    return [
        f"duration_s={seconds}",
        f"plan=[{', '.join(segments)}]",
        DOCKED,
        f'events=[{{kind="dock", at_s={middle}, {dock}}}, {{kind="reset", at_s={middle + 1}}}]',
        "vehicle.imu.accel_noise_m_s2=0.002",
    ]


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.numerical
@pytest.mark.parametrize(("column", "seeds"), [("torque", 12), ("speed", 12)])
def test_an_object_that_docks_with_a_vehicle_with_wheels_is_told_within_its_sigmas(column: str, seeds: int) -> None:
    """Both tumble and move before. All its values go with its mass, so errors over sigmas are 1 rms as of one value a log, by 3 sigma."""
    tumbling = "docked_rate_rad_s=[0.1, -0.05, 0.08], docked_velocity_m_s=[-0.05, 0.01, 0.02]"
    columns = [f'vehicle.wheels.{i}.column="{column}"' for i in range(3)]
    source = scenario.load("wheels-and-jets", (*docking_at(44, tumbling), *columns))
    flight = simulate.fly(source, range(1, seeds + 1))
    assert flight.docked is not None
    z = []
    for member in range(seeds):
        of = faulty.examined(flight.log(member), flight.vehicle)
        assert not of.notices
        assert of.docked is not None
        values = np.array([one.value for one in of.docked.estimates.values()])
        assert {one.verdict for one in of.docked.estimates.values()} == {"converged"}
        z.append((values - flight.docked) / np.sqrt(np.diag(of.docked.covariance)))
    assert abs(np.sqrt(np.mean(np.square(z))) - 1) < 3 / np.sqrt(2 * seeds)
    perfect = estimated(simulate.fly(bound.noise_free(source), [1])).docked
    assert perfect is not None
    values = np.array([one.value for one in perfect.estimates.values()])
    assert np.abs((values - flight.docked) / np.sqrt(np.diag(perfect.covariance))).max() < 0.1


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.numerical
@pytest.mark.parametrize("seeds", [12])
def test_wheels_alone_tell_a_docked_object_of_known_mass(seeds: int) -> None:
    """Nothing pushes, so no log tells a mass: both phases were weighed, to 10 g. Errors over sigmas are 1 rms, by 3 sigma of 3 a log."""
    weighed = [
        f'{{name="{name}", start_s={start}, end_s={end}, known={{mass={{value={mass}, sigma=0.01}}}}}}'
        for name, start, end, mass in (("alone", 0, 30, 22.0), ("both", 31, 60, 30.0))
    ]
    turns = f'plan=[{{motion="random", axes=[{TURNS}], start_s=0, end_s=29}}, {{motion="random", axes=[{TURNS}], start_s=31, end_s=60}}]'
    phases = (f"vehicle.phases=[{', '.join(weighed)}]", 'vehicle.docking={before="alone", after="both"}')
    event = 'events=[{kind="dock", at_s=30, docked_rate_rad_s=[0.1, -0.05, 0.08], docked_velocity_m_s=[-0.05, 0.01, 0.02]}]'
    flight = simulate.fly(scenario.load("wheels", ("duration_s=60", turns, DOCKED, event, *phases)), range(21, 21 + seeds))
    assert flight.docked is not None
    z = []
    for member in range(seeds):
        told = faulty.examined(flight.log(member), flight.vehicle).docked
        assert told is not None
        values = np.array([one.value for one in told.estimates.values()], dtype=float)
        z.append((values - flight.docked) / np.sqrt(np.diag(told.covariance)))
        assert told.covariance[9, 9] == pytest.approx(2e-4)
    assert abs(np.sqrt(np.mean(np.square(z)[:, :9])) - 1) < 3 / np.sqrt(2 * 3 * seeds)
