"""On a bearing the weight's moment tells the CG's distance times the mass: the CG is told with a mass, and not without one."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from massprop_cli import CG, flow
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.estimate import kernelflight
from massprop_cli.export import resolve
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import kernel
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from tests import cramerrao

TURNS = 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], every_cycles=5, max_cycles=4, start_s=0, end_s=10, closed_loop=true}]'
"""Nothing is pushed along the table, so nothing tells the mass."""


@cache
def flown(*settings: str) -> tuple[ScenarioSource, simulate.SimulatedFlight]:
    source = scenario.load("testbed", ("duration_s=10", TURNS, *settings))
    return source, simulate.fly(source, list(range(1, 5)))


def concluded(flight: simulate.SimulatedFlight, seed: int, *settings: str) -> Conclusion:
    vehicle = vehiclefile.changed(flight.vehicle, settings)
    return flow.examine(flight.log(seed), VehicleSource(vehicle, "", "")).conclusions[0]


@pytest.mark.thorough
@pytest.mark.numerical
def test_without_a_mass_no_cg_is_given_and_it_is_said_what_would_tell_it() -> None:
    _, flight = flown()
    estimates = concluded(flight, 0).estimates
    for name in ("mass", *CG):
        assert estimates[name].value is None
        assert estimates[name].verdict in ("not_excited", "unobservable")
    assert "known.mass" in str(estimates["cg_z"].reason)
    assert estimates["izz"].verdict == "converged"


@pytest.mark.parametrize("bearing_kg", [5.0, pytest.param(0.0, marks=pytest.mark.thorough)])
def test_a_weighed_mass_gives_the_cg_at_the_bound(bearing_kg: float) -> None:
    """Against a log's own Cramér–Rao bound with the mass struck from the unknowns: sigmas near it of two, errors within them of four."""
    source, flight = flown(*([] if bearing_kg == 5 else [f"vehicle.environment.bearing_mass_kg={bearing_kg}"]))
    assert source.scenario.vehicle.bearing_mass_kg == bearing_kg
    truth = source.scenario.truth.values
    bounds = cramerrao.of_members(source, flight, slice(0, 2))[:, 0]
    limits = [np.sqrt(np.diag(full - np.outer(full[:, 9], full[9]) / full[9, 9])[6:9]) for full in bounds]
    errors, own = [], []
    for seed in range(4):
        estimates = concluded(flight, seed, f"known.mass={{value={truth[9]}, sigma=1e-6}}").estimates
        assert estimates["mass"].value == pytest.approx(truth[9], rel=1e-6)
        assert {estimates[name].verdict for name in CG} == {"converged"}
        sigmas = np.array([estimates[name].sigma for name in CG], dtype=float)
        own.append(sigmas)
        errors.append((np.array([estimates[name].value for name in CG], dtype=float) - truth[6:9]) / sigmas)
    assert np.sqrt(np.mean(np.square(errors))) < 1.4
    ratios = np.array(own[:2]) / limits
    assert 0.95 < ratios.min() < ratios.max() < 1.2


@pytest.mark.numerical
def test_an_uncertain_mass_makes_the_cg_uncertain_in_proportion() -> None:
    """A mass known to a tenth: the CG's distance from the bearing is to a tenth of the whole mass over the rotating one."""
    source, flight = flown()
    truth = source.scenario.truth.values
    estimates = concluded(flight, 0, f"known.mass={{value={truth[9]}, sigma={0.1 * truth[9]}}}").estimates
    away = truth[6:9] - np.array(source.scenario.vehicle.environment.bearing_position_m)
    sigmas = np.array([estimates[name].sigma for name in CG], dtype=float)
    part = 0.1 * truth[9] / (truth[9] - source.scenario.vehicle.bearing_mass_kg)
    assert np.linalg.norm(sigmas) == pytest.approx(part * np.linalg.norm(away), rel=0.1)


@pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
def test_on_board_a_weighed_mass_does_the_same() -> None:
    source = scenario.load("testbed", ("sensors.accel_noise_m_s2=0.3", "vehicle.imu.accel_noise_m_s2=0.3"))
    flight, heavier = simulate.fly(source, [1]), 1.01 * source.scenario.truth.values[9]
    vehicle = vehiclefile.changed(flight.vehicle, (f"known.mass={{value={heavier}, sigma=1e-4}}",))
    log, resolved = flight.log(0), resolve.stated(VehicleSource(vehicle, "", ""))
    leg, whole = resolved.phases[0], slice(0, log.cycles)
    said = kernelflight.Flight(resolved.commands, leg.vehicle, leg.rule).step(kernelflight.cycles_of(log, whole, whole), last=True)
    (told,) = flow.examine(log, VehicleSource(vehicle, "", "")).histories
    np.testing.assert_allclose(said.values[-1], told.values[-1], atol=1e-6 * told.sigmas[-1].min())
    np.testing.assert_allclose(said.sigmas[-1], told.sigmas[-1], rtol=1e-6)


def test_inertia_that_is_known_takes_nothing_from_a_log_that_tells_no_mass() -> None:
    source, flight = flown()
    truth = source.scenario.truth.values
    inertia, mass = f"known.izz={{value={truth[5]}, sigma=0.01}}", f"known.mass={{value={truth[9]}, sigma=0.01}}"
    alone = concluded(flight, 0, inertia)
    assert {alone.estimates[name].verdict for name in ("ixx", "izz")} == {"converged"}
    first, last = concluded(flight, 0, inertia, mass), concluded(flight, 0, mass, inertia)
    assert {one.verdict for one in first.estimates.values()} == {"converged"}
    np.testing.assert_allclose(first.values, last.values, rtol=1e-9)
