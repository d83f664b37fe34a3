"""The estimate on a table that is out of level, against the Cramér–Rao bound and without what the slope would do to it.

Over many seeds: benchmarks/planar.py, docs/planar-accuracy.md.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import SimulatedFlight
from tests import cramerrao

TOLD = [QUANTITIES.index(name) for name in ("izz", "cg_x", "cg_y", "mass")]
SEEDS = range(1, 7)
SECONDS = 20.0


@cache
def flown(hold: float) -> tuple[ScenarioSource, SimulatedFlight]:
    """0.3 degrees of tilt, of whose pull this part is held."""
    plan = f'plan=[{{motion="random", axes=["x", "y", "yaw"], every_cycles=5, max_cycles=4, start_s=0.0, end_s={SECONDS}}}]'
    source = scenario.load("planar", [f"duration_s={SECONDS}", plan, f"disturbance.table_hold={hold}"])
    return source, simulate.fly(source, list(SEEDS))


@cache
def estimated(hold: float, tilt_sigma_rad: float = 0.01, seeds: int = len(SEEDS)) -> tuple[Array, Array]:
    """(S, 4) errors and (S, 4) sigmas."""
    _, flights = flown(hold)
    environment = flights.vehicle.environment.model_copy(update={"table_tilt_sigma_rad": tilt_sigma_rad})
    vehicle = flights.vehicle.model_copy(update={"environment": environment})
    found = [flow.examine(flights.log(i), VehicleSource(vehicle, "planar", "")).conclusions[0] for i in range(seeds)]
    assert all(c.estimates[name].value is None for c in found for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "cg_z"))
    assert {c.estimates["ixx"].verdict for c in found} == {"unobservable"}
    errors = np.array([c.values[TOLD] for c in found]) - flights.truth[0][0][TOLD]
    return errors, np.sqrt([np.diag(c.covariance)[TOLD] for c in found])


@pytest.mark.thorough
@pytest.mark.numerical
def test_the_sigmas_are_the_bound_and_the_errors_are_within_them() -> None:
    source, flights = flown(1.0)
    error, sigma = estimated(1.0)
    limit = np.sqrt(np.diag(cramerrao.cramer_rao(source, flights, 0)[0]))[TOLD]
    np.testing.assert_allclose(sigma[0], limit, rtol=0.06)
    chi_square = ((error / sigma) ** 2).sum()
    assert 7.5 < chi_square < 53  # of 24, one in a thousand is outside


@pytest.mark.thorough
def test_what_is_felt_of_the_slope_makes_no_difference() -> None:
    error, sigma = estimated(0.0, seeds=2)
    assert (np.abs(estimated(1.0)[0][:2] - error) < 0.02 * sigma).all()


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_slope_that_is_felt_and_not_reckoned_with_is_not_passed_over() -> None:
    """The accelerometer's noise is widened, and the mass is no better than what that leaves of it."""
    error, sigma = estimated(1.0, 0.0, seeds=1)
    assert (sigma[:, 3] > 5 * estimated(1.0)[1][:1, 3]).all()
    assert (np.abs(error[:, 3]) < 4 * sigma[:, 3]).all()


@pytest.mark.thorough
def test_a_stated_gyro_bias_makes_no_difference() -> None:
    """0.18 degrees a second about the vertical: in 20 seconds the slope turns by 3 degrees too far, no value by a tenth of a sigma."""
    _, flights = flown(1.0)

    def values(bias: float) -> tuple[Array, Array]:
        log, vehicle = flights.log(0), changed(flights.vehicle, [f"imu.gyro_bias_sigma_rad_s={bias}"])
        turned = log.delta_theta_imu_rad + log.interval_s[:, None] * np.array([0.0, 0.0, bias])
        analysis = flow.examine(replace(log, delta_theta_imu_rad=turned), VehicleSource(vehicle, "planar", ""))
        assert analysis.notices == ()
        conclusion = analysis.conclusions[0]
        return conclusion.values[TOLD], np.sqrt(np.diag(conclusion.covariance)[TOLD])

    (plain, sigma), (biased, _) = values(1e-9), values(3e-3)
    assert (np.abs(biased - plain) < 0.1 * sigma).all()


def test_a_bias_about_axes_that_the_table_holds_is_no_turn_about_them() -> None:
    """Half a degree a second about level axes is read as bias, and the values are those of a table that is level."""
    plan = 'plan=[{motion="random", axes=["x", "y", "yaw"], every_cycles=5, max_cycles=4, start_s=0.0, end_s=30.0}]'
    biased = (
        "vehicle.imu.gyro_bias_sigma_rad_s=6e-3",
        "sensors.gyro_bias_rad_s=[8e-3, -6e-3, 2e-3]",
        "vehicle.imu.accel_bias_sigma_m_s2=0.03",
    )
    quiet = "vehicle.imu.accel_noise_m_s2=1e-3", "sensors.accel_noise_m_s2=1e-3", "sensors.accel_bias_m_s2=[0.02, -0.03, 0.01]"
    level = (
        "disturbance.table_tilt_rad=[0.0, 0.0]",
        "vehicle.environment.table_tilt_sigma_rad=0.0",
        "vehicle.imu.position_m=[0.1, 0.05, 0.3]",
    )
    flight = simulate.fly(scenario.load("planar", ["duration_s=30", plan, *biased, *quiet, *level]), [1])
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "", ""))
    assert found.notices == ()
    np.testing.assert_allclose(found.vehicle.imu.gyro_bias_rad_s, [8e-3, -6e-3, 0.0], atol=1e-4)
    conclusion = found.conclusions[0]
    assert [conclusion.estimates[QUANTITIES[i]].verdict for i in TOLD] == ["converged"] * 4
    assert (np.abs(conclusion.values - flight.truth[0, 0]) / conclusion.sigmas)[TOLD].max() < 3.5


@pytest.mark.thorough
def test_a_gyro_bias_that_turns_a_held_slope_is_found() -> None:
    """The slope's direction in the body goes with the heading: 0.1 rad after a minute. It had been a specific force 20 times its noise."""
    quiet = "vehicle.imu.accel_noise_m_s2=1e-3", "sensors.accel_noise_m_s2=1e-3"
    biased = "vehicle.imu.gyro_bias_sigma_rad_s=1e-3", "sensors.gyro_bias_rad_s=[0, 0, 1.8e-3]", "vehicle.imu.accel_bias_sigma_m_s2=0.01"
    held = "disturbance.table_tilt_rad=[-0.002, 0.003]", "disturbance.table_hold=1.0"
    flight = simulate.fly(scenario.load("planar", [*quiet, *biased, *held]), [1])
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "", ""))
    assert found.notices == ()
    assert found.vehicle.imu.gyro_bias_rad_s[2] == pytest.approx(1.8e-3, abs=3e-4)
    z = (found.conclusions[0].values - flight.truth[0, 0])[TOLD] / found.conclusions[0].sigmas[TOLD]
    assert np.abs(z).max() < 4


def test_the_noise_of_held_axes_is_no_scale_of_theirs() -> None:
    """Beside thrust that is some tenths of a percent off: a gyro that showed nothing of two axes would explain their noise."""
    source = scenario.load("planar", ("duration_s=40", 'plan=[{motion="random", axes=["x", "y", "yaw"], start_s=0.0, end_s=40.0}]'))
    flight, rng = simulate.fly(source, [1]), np.random.default_rng(3)
    forces = [np.array(jet.force_n) * (1 + 0.005 * rng.normal()) for jet in flight.vehicle.jets]
    vehicle = changed(flight.vehicle, [f"jets.{i}.force_n={force.tolist()}" for i, force in enumerate(forces)])
    answer = flow.examine(flight.log(0), VehicleSource(vehicle, "planar", ""))
    (conclusion,), (discrepancy,) = answer.conclusions, answer.discrepancies
    assert discrepancy is not None
    assert discrepancy.scale < 1
    sigma = np.sqrt(np.diag(conclusion.covariance)[TOLD])
    assert (np.abs(conclusion.values[TOLD] - source.scenario.truth.values[TOLD]) < 3 * sigma).all()
    assert sigma[0] < 0.03 * conclusion.values[5]


def test_a_gyro_that_drifts_about_held_axes_is_no_torque() -> None:
    """Nothing that turns about X and Y is told on a table, however much of it was read: the sensor's own, beside what is stated of it."""
    source = scenario.load("planar", ("duration_s=40", 'plan=[{motion="random", axes=["x", "y", "yaw"], start_s=0.0, end_s=40.0}]'))
    flight = simulate.fly(source, [1])
    log = flight.log(0)
    warmed = log.delta_theta_imu_rad.copy()
    warmed[:, :2] += (5e-3 * np.sin(2 * np.pi * log.time_s / 60) * log.interval_s)[:, None]
    answer = flow.examine(replace(log, delta_theta_imu_rad=warmed), VehicleSource(flight.vehicle, "planar", ""))
    assert answer.vehicle.environment.disturbance_walk_n_m == answer.vehicle.environment.disturbance_torque_n_m == 0
    (conclusion,) = answer.conclusions
    assert {conclusion.estimates[name].verdict for name in ("izz", "cg_x", "cg_y")} == {"converged"}
    sigma = np.sqrt(np.diag(conclusion.covariance)[TOLD])
    assert (np.abs(conclusion.values[TOLD] - source.scenario.truth.values[TOLD]) < 4 * sigma).all()
    assert sigma[0] < 0.03 * conclusion.values[5]
