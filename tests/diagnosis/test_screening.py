"""What is left of a log as stated."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli.base.levels import CHANCE
from massprop_cli.diagnosis import change
from massprop_cli.diagnosis.comparison import fitted
from massprop_cli.diagnosis.design import Case, Designs
from massprop_cli.diagnosis.diagnose import _pairs_with
from massprop_cli.diagnosis.hypotheses import listed
from massprop_cli.diagnosis.masschange import mass_change
from massprop_cli.diagnosis.refit import _insignificant, refitted
from massprop_cli.diagnosis.screening import Screening, busiest, relinearised, screened, under_likeliest_torque
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.noiselevels import with_noise_levels
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import changed
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from massprop_cli.testbed import scenario
from tests import faulty
from tests.flown import PLAN, fly

DOCKED = (
    "docked={ixx=0.2, iyy=0.3, izz=0.3, mass=4.0, cg_x=0.4, cg_y=0.1}",
    'events=[{kind="dock", cycle=173, motion="momentum_conserved"}]',
    'vehicle.phases=[{name="all", start_s=0.0, end_s=20.0}]',
)
LONGER = tuple(key.replace("15.0", "20.0") for key in PLAN)
"""Each half of which tells every coefficient."""


def look_at(name: str, *keys: str) -> Screening:
    """Of a log as one phase, about its own body; what is found out about it later is its caller's alone."""
    return replace(_look_at(name, *keys))


@cache
def _look_at(name: str, *keys: str) -> Screening:
    flown = fly(name, *keys)
    return look_of(flown.log(0), flown.vehicle)


def otherwise(*assignments: str) -> Screening:
    """Of a log whose vehicle file says something else than what was flown."""
    return replace(_otherwise(*assignments))


@cache
def _otherwise(*assignments: str) -> Screening:
    flown = fly("free-flyer", *PLAN)
    return look_of(flown.log(0), changed(flown.vehicle, assignments))


def thrust(jet: str, part: float) -> str:
    """The file's force of a jet of which so large a part is given."""
    jets = scenario.load("free-flyer").scenario.vehicle.jets
    ((number, force),) = [(i, one.force_n) for i, one in enumerate(jets) if one.name == jet]
    return f"jets.{number}.force_n={[x / part for x in force]}"


def look_of(log: Log, vehicle: Vehicle) -> Screening:
    """The same of a log that is there."""
    timing = Timing(float(vehicle.cycle.command_delay_cycles), 0.0)
    piece = slice(5, log.cycles)
    used, _ = with_noise_levels(Stream.of(log, vehicle, timing), [piece], vehicle)
    screening = screened(*busiest(Case(log, used, timing, Designs()), piece))
    assert screening is not None
    return relinearised(screening)


def test_another_unit_is_fitted_whose_body_regression_does_not_find() -> None:
    """Rates over records of 10 ms for increments are a hundred times as much, as of a hundredth of the mass."""
    flown = fly("free-flyer", *PLAN, "sensors.records_per_cycle=5")
    log = flown.log(0)
    screening = look_of(replace(log, delta_v_imu_m_s=log.delta_v_imu_m_s / log.interval_s[:, None]), flown.vehicle)
    _, best = next(iter(screening.ranked))
    assert best.hypothesis.subject == ("accelerometer columns hold rates, not increments",)
    assert 1 / best.value("theta")[9] == pytest.approx(flown.truth[0][0][9], rel=0.02)


def test_on_a_table_no_unit_or_mounting_is_supposed_of_axes_that_show_nothing() -> None:
    """The gyro's X and Y are noise there, which fits in degrees as well as in radians."""
    turns = look_of(fly("planar").log(0), fly("planar").vehicle).imu_hypotheses
    same = np.eye(3)
    assert any(not np.allclose(one.gyro, same) for one in turns)
    assert all(not np.allclose(one.gyro[2], same[2]) or not np.allclose(one.accelerometer, same) for one in turns)


SCATTER = {
    "impulses": "vehicle.thrust.pulse_sigma=0.01",
    "torques": "vehicle.environment.disturbance_torque_n_m=0.002",
    "torques that walk": "vehicle.environment.disturbance_walk_n_m=0.0003",
    "a gyro's bias": "vehicle.imu.gyro_bias_walk_rad_s_sqrt_s=0.002",
}


@pytest.mark.parametrize("kind", SCATTER)
def test_what_is_stated_to_scatter_leaves_a_clean_log_no_more_than_chance(kind: str) -> None:
    """And no torque is looked for beside it; by a vehicle file that doesn't state it one is."""
    key, _, _ = SCATTER[kind].removeprefix("vehicle.").partition("=")
    left = []
    for seed in (3, 4, 5):
        flown = fly("free-flyer", *PLAN, "vehicle.imu.gyro_bias_sigma_rad_s=0.01", SCATTER[kind], seeds=(seed,))
        stated, unstated = (look_of(flown.log(0), vehicle) for vehicle in (flown.vehicle, changed(flown.vehicle, [f"{key}=0.0"])))
        left.append(stated.misfit)
        assert stated.within_chance
        assert not stated.free.disturbances
        assert unstated.free.disturbances
    assert np.mean(left) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("sigmas", [0.0, 10.0])
def test_a_bias_costs_what_its_stated_sigma_makes_of_it(sigmas: float) -> None:
    """It is unknown beside whatever is supposed, and no fault; but a reading of the columns that takes more of it is less likely."""
    flown = fly("free-flyer", *PLAN)
    log, used = flown.log(0), changed(flown.vehicle, ["imu.accel_bias_sigma_m_s2=0.05"])
    away = 0.05 * sigmas * log.interval_s[:, None] * np.array([1.0, 0.0, 0.0]) @ np.array(used.imu.body_from_imu)
    left = look_of(replace(log, delta_v_imu_m_s=log.delta_v_imu_m_s + away), used).stated.chi_square
    assert left[3] - look_of(log, used).stated.chi_square[3] == pytest.approx(max(sigmas**2 - CHANCE**2, 0.0), abs=10.0)


@pytest.mark.parametrize("name", ["free-flyer", "air-bearing"])
def test_a_clean_sample_leaves_no_more_than_chance_about_its_own_body(name: str) -> None:
    log, vehicle = faulty.sample(name)
    by_chance(look_of(log, vehicle), faulty.truth(name)[9])


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("name", ["free-flyer", "testbed"])
def test_a_clean_log_leaves_no_more_than_chance_about_its_own_body(name: str) -> None:
    flown = fly(name, seeds=(1001, 1003))
    for member in range(2):
        by_chance(look_of(flown.log(member), flown.vehicle), flown.truth[member, 0, 9])


def by_chance(screening: Screening, mass: float) -> None:
    """Columns that say the same twice, but for the noise in them, explain noise that no body does: 1.4 times pure error on a bearing."""
    assert screening.misfit < 1 + 5 * np.sqrt(2 / screening.degrees_of_freedom)
    # noise is what it is stated to be
    assert 0.8 < (screening.free.pure_error / screening.noise).min() < (screening.free.pure_error / screening.noise).max() < 1.25
    assert screening.stated.value("theta")[9] == pytest.approx(1 / mass, rel=0.05)


@pytest.mark.parametrize(
    ("key", "constant"),
    [
        ("jets.3.force_n=[0.0, 0.0, 2.0]", True),
        ("imu.body_from_imu=[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]", True),
        ("cycle.command_delay_cycles=1.0", True),  # a column stands for that much
        ("cycle.command_delay_cycles=5.0", False),
        ("cycle.command_delay_cycles=0.0", False),
    ],
)
def test_what_is_wrong_all_along_leaves_free_coefficients_the_stated_noise(key: str, constant: bool) -> None:
    screening = otherwise(key)
    assert screening.constant is constant
    assert not screening.within_chance


def test_a_gyro_in_degrees_is_wrong_all_along_too_whatever_its_unit() -> None:
    screening = look_at("free-flyer", *PLAN)
    assert screening.constant
    for factor, constant in ((np.radians(1.0) ** -2, True), (4.0, False)):
        gyro = screening.free.gyro._replace(left=screening.free.gyro.left * factor)
        assert replace(screening, free=replace(screening.free, gyro=gyro)).constant is constant


@pytest.mark.parametrize("walk", [3e-4, *(pytest.param(walk, marks=pytest.mark.thorough) for walk in (1e-3, 3e-3))])
def test_a_torque_that_wanders_is_found_at_the_level_that_explains_most(walk: float) -> None:
    """Of levels a hundred times apart the nearest costs up to 100 in −2 log likelihood more, and a gyro's scale took the difference."""
    screening = look_at("free-flyer", *PLAN, f"disturbance.walk_n_m={walk}")
    found = under_likeliest_torque(screening)
    (level,), theta = found.free.disturbances, screening.stated.value("theta")
    assert level.walk > 0
    for by in 10.0 ** np.linspace(-1.5, 1.5, 13):
        other = screened(screening.case, screening.piece, [level._replace(walk=level.walk * by)], theta)
        assert other is not None
        assert found.cost < other.cost + 4


@pytest.mark.parametrize("part", [1.0, 0.9])
def test_a_cause_whose_values_are_chance_is_none(part: float) -> None:
    screening = otherwise(thrust("roll_p1", part))
    every = listed(screening.model, screening.names)
    supposed = [one for one in every if (one.code, one.subject) == ("thrust-scale", ("roll_p1",)) and not one.initial_values]
    (found,) = fitted(screening.model, screening.free, screening.free.variance, supposed)
    assert found.factors[0] == pytest.approx(part, abs=2e-3)
    assert _insignificant(found) is (part == 1.0)


@pytest.mark.parametrize(("keys", "seed", "changed"), [(DOCKED, 3, True), (("disturbance.walk_n_m=0.01",), 2, False)])
def test_a_change_leaves_two_bodies_less_than_half_of_what_it_leaves_one(keys: tuple[str, ...], seed: int, changed: bool) -> None:
    """A docking leaves a thirtieth to a sixth; a torque that wanders four fifths, though each of two halves of the log fits: it is shorter.

    How much of the cycle in which it docks is left hangs on the direction that columns which are sums of others take from the fit: rounding
    has it, and the compiled kernel and NumPy differ.
    """
    flown = fly("free-flyer", *LONGER, *keys, seeds=(seed,))
    screening = look_of(flown.log(0), flown.vehicle)
    whole = under_likeliest_torque(screening)
    samples = screening.case.timing.of(screening.case.log, screening.case.vehicle)
    reference = first_reference(samples, screening.piece, screening.case.vehicle)
    assert reference is not None
    at = change.change_cycle(samples, screening.piece, reference, screening.case.vehicle)
    parts = [
        screened(screening.case, part, screening.free.disturbances)
        for part in (slice(screening.piece.start, at), slice(at, screening.piece.stop))
    ]
    sides = [part for part in parts if part is not None]
    assert len(sides) == 2
    assert all(side.fits for side in sides)
    left = sum(side.excess for side in sides) / whole.excess
    assert left < 0.25 if changed else left > 0.7
    named = mass_change(screening, whole, lambda: None)
    assert (named is not None) is changed
    if named is not None:
        (one,) = named.faults
        assert one.notice.code == "mass-change"
        assert one.change_s == pytest.approx(173 * 0.05, abs=0.05)


def test_nothing_is_looked_for_beside_a_component_that_does_nothing() -> None:
    """Once it is mended the log is looked at without that component, and has fewer unknowns."""
    flown = fly("free-flyer", *PLAN, "vehicle.jets=[]", "actuators.max_torque_n_m=[0.1, 0.4, 0.4]", "actuators.max_force_n=[2.0, 2.0, 2.0]")
    log, idle = flown.log(0), np.random.default_rng(1)
    command = log.command.copy()
    command[:, 2] = 0.4 * idle.choice([-1.0, 0.0, 1.0], log.cycles)
    screening = look_of(replace(log, command=command), flown.vehicle)
    refit = refitted(screening, next(one for _, one in screening.ranked if one.hypothesis.subject == ("cmd_torque_z_n_m",)))
    assert refit is not None
    assert refit.screening is not None
    assert len(refit.screening.names) == len(screening.names) - 1
    assert _pairs_with(screening, refit, [], np.inf) == []
