"""Sigmas where jets and IMU are as uncertain as the vehicle file says; over many vehicles: benchmarks/geometry.py."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.flow import Analysis
from massprop_cli.inputs.equipment import Imu, Jet
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource

TOLD = [QUANTITIES.index(name) for name in ("izz", "cg_x", "cg_y", "mass")]
THRUST, PLACE_M, ANGLE_RAD = 0.01, 0.001, 0.005
SEEDS = range(1, 4)
SECONDS = 10.0


def built(vehicle: Vehicle, jets: list[Jet], imu: Imu) -> Vehicle:
    return Vehicle.model_validate(vehicle.model_copy(update={"jets": tuple(jets), "imu": imu}).model_dump(by_alias=True))


@cache
def stated(uncertain: bool = True) -> ScenarioSource:
    plan = f'plan=[{{motion="random",axes=["x","y","yaw"],start_s=0.0,end_s={SECONDS},every_cycles=5,max_cycles=4}}]'
    source = scenario.load("planar", [f"duration_s={SECONDS}", plan])
    vehicle = source.scenario.vehicle
    sigmas = {"thrust_sigma": THRUST, "position_sigma_m": PLACE_M, "direction_sigma_rad": ANGLE_RAD}
    imu = vehicle.imu.model_copy(update={"position_sigma_m": PLACE_M, "mounting_sigma_rad": ANGLE_RAD})
    used = built(vehicle, [jet.model_copy(update=sigmas) for jet in vehicle.jets], imu) if uncertain else vehicle
    return ScenarioSource(source.scenario.model_copy(update={"vehicle": used}), source.source)


@cache
def issued() -> Array:
    """(S, K, 8) commands of the stated vehicle."""
    return simulate.fly(stated(), list(SEEDS)).issued


@cache
def flown(seed: int) -> simulate.SimulatedFlight:
    """A vehicle drawn from what is stated, flown by the commands of the stated one."""
    source, rng = stated(), np.random.default_rng([seed, 2])
    vehicle = source.scenario.vehicle
    jets = []
    for jet in vehicle.jets:
        force = (1 + THRUST * rng.standard_normal()) * rotation(ANGLE_RAD * rng.standard_normal(3)) @ np.array(jet.force_n)
        place = np.array(jet.position_m) + PLACE_M * rng.standard_normal(3)
        jets.append(jet.model_copy(update={"force_n": tuple(force.tolist()), "position_m": tuple(place.tolist())}))
    mounting = rotation(ANGLE_RAD * rng.standard_normal(3)) @ np.array(vehicle.imu.body_from_imu)
    place = np.array(vehicle.imu.position_m) + PLACE_M * rng.standard_normal(3)
    real = {"position_m": tuple(place.tolist()), "body_from_imu": tuple(map(tuple, mounting.tolist()))}
    other = built(vehicle, jets, vehicle.imu.model_copy(update=real))
    drawn = ScenarioSource(source.scenario.model_copy(update={"vehicle": other}), source.source)
    return simulate.fly(drawn, [seed], issued=issued()[SEEDS.index(seed)])


@cache
def found(seed: int, uncertain: bool = True) -> tuple[Analysis, Array]:
    """Estimated as stated; and its true values."""
    used = stated(uncertain).scenario.vehicle
    return flow.examine(flown(seed).log(0), VehicleSource(used, "planar", "")), flown(seed).truth[0][0]


@pytest.mark.thorough
@pytest.mark.numerical
def test_errors_within_what_is_stated_are_no_fault_and_within_the_sigmas() -> None:
    """Chi-square, one in a thousand is outside; innovations within four of the sigmas of their variance."""
    z = []
    for seed in SEEDS:
        analysis, truth = found(seed)
        assert analysis.notices == ()
        conclusion = analysis.conclusions[0]
        z.append(((conclusion.values - truth) / np.sqrt(np.diag(conclusion.covariance)))[TOLD])
        innovations = analysis.settled[0].normalised[1:]
        assert (np.abs((innovations**2).mean(0) - 1) < 4 * np.sqrt(2 / len(innovations))).all()
    low, high = chi2.ppf([0.0005, 0.9995], len(TOLD) * len(SEEDS))
    assert low < (np.array(z) ** 2).sum() < high


@pytest.mark.thorough
@pytest.mark.seeds
def test_the_same_errors_unstated_are_pointed_out() -> None:
    analysis, _ = found(1, uncertain=False)
    assert analysis.notices != ()


def test_reports_say_how_much_of_each_sigma_the_geometry_makes() -> None:
    analysis, _ = found(1)
    added = {a.code: a.effects[0].change for a in analysis.assumptions if a.code.startswith("uncertain-")}
    assert list(added) == [f"uncertain-{kind}" for kind in ("imu-position", "imu-mounting", "jet-thrust", "jet-position", "jet-direction")]
    sigma = analysis.conclusions[0].estimates["izz"].sigma
    assert sigma is not None
    assert all(change.get("izz", 0.0) <= sigma for change in added.values())
    # of eight jets' arms of 0.15 m, each off by 1 % and its place by 1 mm; four jets make each turn
    assert added["uncertain-jet-thrust"]["izz"] == pytest.approx(0.26 * THRUST / np.sqrt(8), rel=0.3)
    assert added["uncertain-jet-position"]["izz"] == pytest.approx(0.26 * PLACE_M / 0.15 / np.sqrt(8), rel=0.3)
