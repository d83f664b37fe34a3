"""Estimates of vehicles with reaction wheels: at the bound, honest about what wheels can't tell, and in scale by the wheels."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.campaign import kept
from massprop_cli.conclude import docking
from massprop_cli.diagnosis import resolve
from massprop_cli.estimate.quantities import in_common
from massprop_cli.flow import Analysis
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.actuators.wheel import WheelLog, step_of
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.result import build
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from tests import anypedestal, cramerrao

TRUTH = np.array([0.6, 0.05, -0.06, 2.7, 0.1, 2.4, -0.02, 0.025, 0.01, 22.0])


TURNS, PUSHES = '"roll", "pitch", "yaw"', '"x", "y", "z"'


def plan(name: str, seconds: int) -> str:
    """Turns about each axis; where there are jets too, by these in the first half and by wheels in the other, and pushes all along."""
    half = seconds // 2
    if name == "wheels":
        return f'plan=[{{motion="random", axes=[{TURNS}], start_s=0, end_s={seconds}}}]'
    return (
        f'plan=[{{motion="random", axes=[{TURNS}], start_s=0, end_s={half}}}, '
        f'{{motion="random", axes=[{PUSHES}], start_s=0, end_s={seconds}}}, '
        f'{{motion="random", axes=[{TURNS}], start_s={half}, end_s={seconds}, by_wheels=true}}]'
    )


@cache
def flown(name: str, *settings: str, seconds: int = 10) -> tuple[ScenarioSource, simulate.SimulatedFlight]:
    source = scenario.load(name, (f"duration_s={seconds}", plan(name, seconds), *settings))
    return source, simulate.fly(source, [1])


def limits(source: ScenarioSource, flight: simulate.SimulatedFlight) -> Array:
    """(10,) one sigma of the bound."""
    found: Array = np.sqrt(np.diag(cramerrao.cramer_rao(source, flight, 0)[0]))
    return found


def estimated(flight: simulate.SimulatedFlight, *settings: str) -> Analysis:
    vehicle = vehiclefile.changed(flight.vehicle, settings)
    return flow.examine(flight.log(0), VehicleSource(vehicle, "", ""))


def found(analysis: Analysis) -> tuple[Array, Array]:
    """(10,) values and sigmas."""
    conclusion = analysis.conclusions[0]
    return conclusion.values, np.sqrt(np.diag(conclusion.covariance))


@pytest.mark.numerical
@pytest.mark.parametrize(
    ("name", "told", "thrust"),
    [("wheels", 9, 1.0), ("wheels-and-jets", 10, 0.95), pytest.param("wheels-and-jets", 10, 1.0, marks=pytest.mark.thorough)],
)
def test_wheels_tell_what_they_can_at_the_bound_and_fix_the_scale_that_thrust_leaves_open(name: str, told: int, thrust: float) -> None:
    """Errors within 4.5 sigma, sigmas 0.9 to 1.2 of the bound; without a push no mass, and it is said.

    Thrust 5 % weaker than stated ± 5 %: beside wheels values are right to their sigmas, hardly wider than with thrust known.
    """
    source, flight = flown(name, *([f"actuators.scale={thrust}"] if thrust != 1 else []))
    analysis = estimated(flight)
    values, sigmas = found(analysis)
    assert np.abs((values - TRUTH) / sigmas)[:told].max() < 4.5
    over = (sigmas / limits(source, flight))[:told]
    assert 0.9 < over.min() < over.max() < 1.2
    verdicts = [estimate.verdict for estimate in analysis.conclusions[0].estimates.values()]
    assert verdicts[:6] == ["converged"] * 6
    assert verdicts[told:] == ["unobservable"] * (10 - told)
    reference = analysis.histories[0].reference
    assert reference is not None
    if told == 10:
        assert abs(reference.scale[0] + 1 - thrust) < 1e-3  # the thrust's scale is found
    assert not analysis.notices


@pytest.mark.thorough
def test_beside_wheels_no_scale_is_added_to_what_logs_and_phases_have_alike() -> None:
    """The filter has it in its covariance: pooled inertia was ± 0.030 of two logs that tell it to 2e-5, and two phases had it twice."""
    _, flight = flown("wheels-and-jets", seconds=20)
    halves = 'phases=[{name="a", start_s=0, end_s=10}, {name="b", start_s=10, end_s=20}]'
    analysis = estimated(flight, halves, "thrust.scale_sigma=0.05")
    result = build.result(analysis)
    for conclusion, phase in zip(analysis.conclusions, result.phases, strict=True):
        sigma = np.sqrt(np.diag(conclusion.covariance))[:6]
        assert (kept.shared(phase, analysis.vehicle)[[0, 3, 5]] < 0.01 * sigma[[0, 3, 5]]).all()
    _, joint = docking._joint(analysis.conclusions[:2], analysis.vehicle)  # type: ignore[arg-type]
    for half, conclusion in enumerate(analysis.conclusions):
        np.testing.assert_allclose(np.diag(joint)[10 * half :][:6], np.diag(conclusion.bare[1])[:6], rtol=1e-9)


def test_where_wheels_tell_the_scale_of_thrust_a_weighed_mass_implies_their_momentum() -> None:
    """The thrust is 0.95 of what is stated, and the wheels are what is stated."""
    _, flight = flown("wheels-and-jets", "actuators.scale=0.95", seconds=20)
    weighed = f"known.mass={{value={TRUTH[9]}, sigma={1e-4 * TRUTH[9]}}}"
    (phase,) = build.result(estimated(flight, "thrust.scale_sigma=0.05", weighed)).phases
    implied = phase.implied_thrust_scale
    assert implied is not None
    assert implied.of == "momentum of wheels"
    assert abs(implied.value - 1) < 4 * implied.sigma < 0.04


def test_where_wheels_tell_little_of_the_scale_logs_have_it_alike_all_the_same() -> None:
    """Drawn: what a log tells of an unknown scale, its prior beside that, and how much of the error is then the prior's."""
    rng = np.random.default_rng(1)
    used = vehiclefile.changed(flown("wheels-and-jets")[1].vehicle, ("thrust.scale_sigma=0.05",))
    slope = np.append(1.0, np.zeros(9))
    for weak in (0.01, 0.05, 1.0):
        kappa = 0.05 * rng.standard_normal(20_000)
        told = kappa + weak * rng.standard_normal(20_000)
        error = kappa - told * 0.05**2 / (0.05**2 + weak**2)
        covariance = np.diag(np.append(error.var(), np.zeros(9)))
        shared = in_common(slope, covariance, {}, used)[0]
        assert shared == pytest.approx((error * kappa).mean() / 0.05, rel=0.05)


def test_without_wheels_the_same_weak_thrust_makes_inertia_and_mass_too_large() -> None:
    """Without what wheels tell of it: 1 / 0.95, and the sigmas hold the 5 %."""
    short = ("duration_s=10", plan("wheels", 10), "control.rate_gain_n_m_s=[1, 1, 1]")
    source = scenario.load("free-flyer", (*short, "actuators.scale=0.95", "vehicle.thrust.scale_sigma=0.05"))
    analysis = estimated(simulate.fly(source, [1]))
    values, sigmas = found(analysis)
    assert np.abs(values[[0, 3, 5]] * 0.95 / TRUTH[[0, 3, 5]] - 1).max() < 1e-3
    assert (sigmas[[0, 3, 5]] / values[[0, 3, 5]]).min() > 0.05


def test_an_uncertain_spin_inertia_is_in_every_sigma() -> None:
    """Of three wheels of 1 % each the scale is known to better than that and not to a third of it; wrong by one sigma, it is covered."""
    uncertain = tuple(f"vehicle.wheels.{i}.spin_inertia_sigma_kg_m2=2e-5" for i in range(3))
    _, flight = flown("wheels", "actuators.wheel_scale=1.01", *uncertain)
    values, sigmas = found(estimated(flight))
    assert 0.0033 < (sigmas[[0, 3, 5]] / TRUTH[[0, 3, 5]]).min() < (sigmas[[0, 3, 5]] / TRUTH[[0, 3, 5]]).max() < 0.01
    assert np.abs((values - TRUTH) / sigmas)[:9].max() < 3.5


def test_axes_that_are_uncertain_are_found_with_the_mass_properties() -> None:
    """Three axes half a degree off, which make inertia 2 % wrong: stated to be so uncertain, values are right to a two-thousandth."""
    _, flight = flown("wheels", seconds=20)
    draw = np.random.default_rng(0)
    axes = [wheel.direction + 0.009 * draw.standard_normal(3) for wheel in flight.vehicle.wheels]
    stated = [f"wheels.{i}.{key}" for i, axis in enumerate(axes) for key in (f"axis={axis.tolist()}", "axis_sigma_rad=0.01")]
    analysis = estimated(flight, *stated)
    values, sigmas = found(analysis)
    assert np.abs((values - TRUTH) / sigmas)[:9].max() < 3.5
    assert (sigmas[[0, 3, 5]] / TRUTH[[0, 3, 5]]).max() < 5e-4
    assert not analysis.notices


def test_inertia_follows_the_spin_inertia_that_is_assumed() -> None:
    """Of wheels alone, whose momentum is all that there is to compare with: 1 % of one makes 1 % of the other."""
    _, flight = flown("wheels")
    (assumed,) = (one for one in estimated(flight).assumptions if one.code == "wheel-inertia")
    for name, change in assumed.effects[0].change.items():
        assert change == pytest.approx(0.01 * TRUTH[QUANTITIES.index(name)], rel=0.05), name
    assert set(QUANTITIES[:6]) <= assumed.effects[0].change.keys()


@pytest.mark.parametrize("name", ["wheels", pytest.param("wheels-and-jets", marks=pytest.mark.thorough)])
def test_what_is_stated_of_the_locked_wheel_moves_the_inertia_by_just_that(name: str) -> None:
    _, flight = flown(name)
    locked, bare = (found(estimated(flight, f"wheels.1.locked_in_inertia={word}"))[0] for word in ("true", "false"))
    assert locked[3] - bare[3] == pytest.approx(2e-3, rel=1e-9)
    others = [i for i, _ in enumerate(QUANTITIES[:9]) if i != 3]
    assert locked[others] == pytest.approx(bare[others], rel=1e-9)


@pytest.mark.thorough
@pytest.mark.seeds
def test_no_momentum_that_is_held_may_be_left_out() -> None:
    """The same log with the wheels' momentum at the start misstated: the log contradicts it."""
    _, flight = flown("wheels-and-jets")
    log = flight.log(0)
    still = vehiclefile.changed(flight.vehicle, ["wheels.2.spin_inertia_kg_m2=1e-9"])
    analysis = flow.examine(log, VehicleSource(still, "", ""))
    assert analysis.notices


@pytest.mark.parametrize("delay", [1.3, *(pytest.param(delay, marks=pytest.mark.thorough) for delay in (1.0, 2.0))])
def test_momentum_begins_with_the_rate_that_the_body_has_when_the_first_torque_acts(delay: float) -> None:
    """Wheels logged by their torque, on a body that tumbles at 40 degrees a second: a cycle's mean rate is half a cycle old by then."""
    by_torque = [f'vehicle.wheels.{i}.column="torque"' for i in range(3)]
    turning = ("initial.rate_rad_s=[0.4, -0.4, 0.3]", "vehicle.imu.gyro_noise_rad_s=1e-5", "sensors.records_per_cycle=10")
    loose = (f"vehicle.cycle.command_delay_cycles={delay}", "control.rate_gain_n_m_s=[0, 0, 0]", "control.attitude_gain_n_m=[0, 0, 0]")
    _, flight = flown("wheels", *by_torque, *turning, *loose)
    then = [speed[0, round(10 * delay) - 1] for speed in flight.turning.values()]
    log = flight.log(0)
    started = [replace(said, start_rad_s=float(speed)) for said, speed in zip(log.spinning, then, strict=True)]  # type: ignore[type-var]
    log = replace(log, spinning=tuple(started))
    analysis = flow.examine(log, VehicleSource(flight.vehicle, "", ""))
    values, sigmas = found(analysis)
    assert np.abs((values - TRUTH) / sigmas)[:9].max() < 4.0
    assert not analysis.notices


@pytest.mark.thorough
def test_a_delay_is_found_in_a_long_log_of_wheels_whose_torque_was_logged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their speed follows from the whole log, of which no stretch can be looked at alone: it had ended in an internal error."""
    monkeypatch.setattr(resolve, "LONG", 200)
    by_torque = [f'vehicle.wheels.{i}.column="torque"' for i in range(3)]
    _, flight = flown("wheels", *by_torque)
    analysis = estimated(flight, 'cycle.command_delay_cycles="auto"')
    assert analysis.timing.delay == pytest.approx(float(flight.vehicle.cycle.command_delay_cycles), abs=0.01)


TABLE = (
    "duration_s=10",
    "actuators.max_wheel_torque_n_m=0.05",
    'plan=[{motion="random", axes=["x", "y"], start_s=0, end_s=10}, {motion="random", axes=["yaw"], start_s=0, end_s=2.5}, '
    '{motion="random", axes=["yaw"], start_s=2.5, end_s=10, by_wheels=true}]',
)


@cache
def on_table(column: str, *settings: str) -> tuple[ScenarioSource, simulate.SimulatedFlight]:
    """Two wheels, one of them askew: the table takes up what it does about X, and the momentum that it turns about Z."""
    wheels = (
        f'vehicle.wheels=[{{name="z", axis=[0, 0, 1], spin_inertia_kg_m2=2e-3, locked_in_inertia=true, column="{column}", '
        "start_rad_s=60}, "
        f'{{name="askew", axis=[0.5, 0, 1], spin_inertia_kg_m2=2e-3, locked_in_inertia=false, column="{column}", start_rad_s=-40}}]'
    )
    source = scenario.load("planar", (*TABLE, wheels, *settings))
    return source, simulate.fly(source, [1])


@pytest.mark.numerical
@pytest.mark.parametrize(
    ("column", "thrust"), [("speed", 0.95), *(pytest.param(*one, marks=pytest.mark.thorough) for one in (("torque", 1.0), ("speed", 1.0)))]
)
def test_a_table_tells_the_same_four_beside_wheels_which_tell_the_thrust_as_well(column: str, thrust: float) -> None:
    """Errors within 4 sigma, sigmas 0.9 to 1.2 of the bound with thrust known, whether it is or is 5 % weaker than stated ± 5 %."""
    weak = () if thrust == 1 else (f"actuators.scale={thrust}", "vehicle.thrust.scale_sigma=0.05")
    source, flight = on_table(column, *weak)
    analysis = estimated(flight)
    values, sigmas = found(analysis)
    told = [QUANTITIES.index(name) for name in ("izz", "cg_x", "cg_y", "mass")]
    assert np.abs((values - flight.truth[0][0]) / sigmas)[told].max() < 4
    over = (sigmas / limits(source, flight))[told]
    assert 0.9 < over.min() < over.max() < 1.2
    assert [estimate.verdict for estimate in analysis.conclusions[0].estimates.values()].count("unobservable") == 6
    assert not analysis.notices


@pytest.mark.numerical
def test_where_jets_are_uncertain_the_wheels_still_tell_izz() -> None:
    """Eight jets ± 1 mm, four along each axis: the CG ± 1 mm / √4; Izz, which jets alone would tell to 1 %, to twice what exact ones do."""
    _, flight = on_table("torque")
    places = [f"jets.{i}.position_sigma_m=0.001" for i in range(8)]
    exact, uncertain = (found(estimated(flight, *settings))[1] for settings in ((), places))
    np.testing.assert_allclose(uncertain[6:8], 0.5e-3, rtol=0.1)
    assert exact[5] < uncertain[5] < 2.5 * exact[5]


BEARING = (
    "duration_s=6",
    "actuators.max_wheel_torque_n_m=0.05",
    'plan=[{motion="random", axes=["x", "y"], start_s=0, end_s=6}, '
    '{motion="random", axes=["roll", "pitch", "yaw"], start_s=0, end_s=2}, '
    '{motion="random", axes=["roll", "pitch", "yaw"], start_s=2, end_s=6, by_wheels=true}]',
    'vehicle.wheels=[{name="x", axis=[1, 0, 0], spin_inertia_kg_m2=2e-3, locked_in_inertia=true, start_rad_s=60}, '
    '{name="y", axis=[0, 1, 0], spin_inertia_kg_m2=2e-3, locked_in_inertia=true, start_rad_s=-50}, '
    '{name="askew", axis=[0.5, 0, 1], spin_inertia_kg_m2=2e-3, locked_in_inertia=false, start_rad_s=-40}]',
)


@pytest.mark.numerical
@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.thorough)])
def test_weak_thrust_on_a_bearing_is_weak_in_what_moves_the_base_too(seed: int) -> None:
    """Thrust 5 % weaker than stated ± 5 %: every error within 4 sigma, and the mass as good as the bound of known thrust."""
    source = scenario.load("testbed", (*BEARING, "actuators.scale=0.95", "vehicle.thrust.scale_sigma=0.05"))
    flight = simulate.fly(source, [seed])
    values, sigmas = found(estimated(flight))
    assert np.abs((values - flight.truth[0][0]) / sigmas).max() < 4
    assert 0.9 < sigmas[9] / limits(source, flight)[9] < 1.2


SMALL = [
    *(f"truth.{name}={value}" for name, value in zip(QUANTITIES[:6], (0.36, 0.041, 0.011, 0.368, 0.04, 0.389), strict=True)),
    *("truth.mass=8.7", "vehicle.imu.gyro_noise_rad_s=1.2e-4", "vehicle.cycle.period_s=0.1", "duration_s=118"),
    *(f"vehicle.wheels.{number}.spin_inertia_kg_m2=9.4e-4" for number in range(3)),
    *("control.rate_gain_n_m_s=[0.3, 0.3, 0.3]", "control.attitude_gain_n_m=[0.1, 0.1, 0.1]"),
]
"""A vehicle whose momentum turns by more than a thousandth of itself in each cycle."""


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("settings", [[], SMALL], ids=["scenario", "small"])
def test_speeds_in_whole_rpm_are_counted_with_their_steps(settings: list[str]) -> None:
    """While a count stands still, so does its error: values had been 2.6 sigma off in the root mean square.

    An error of the momentum turns the rest of it astray: of the small vehicle they had been 2.2 sigma off, and up to 8.5.
    """
    flight = simulate.fly(scenario.load("wheels", settings), [1, 2, 3])
    z = []
    for k in range(3):
        log = anypedestal.in_whole_rpm(flight.log(k))
        found = flow.examine(log, VehicleSource(flight.vehicle, "", ""))
        assert [notice.code for notice in found.notices] == ["noise-estimated"]
        z.append((found.conclusions[0].values - flight.truth[k, 0])[:6] / found.conclusions[0].sigmas[:6])
    assert 0.25 < np.sqrt((np.array(z) ** 2).mean()) < 1.4
    assert np.abs(z).max() < 4
    assert build.result(found).provenance.setting_sources["wheels.0.speed_error_in_noise"] == "log"
    keys = [f"{key}={configfile.written(value)}" for key, value in build.effective_settings(found).items() if value is not None]
    again = flow.examine(log, VehicleSource(vehiclefile.changed(flight.vehicle, keys), "", ""))
    np.testing.assert_array_equal(again.conclusions[0].sigmas, found.conclusions[0].sigmas)  # counted once


def logged(flight: simulate.SimulatedFlight) -> Array:
    """(n,) speeds of the last wheel."""
    said = flight.log(0).spinning[-1]
    assert isinstance(said, WheelLog)
    return np.asarray(said.speed_rad_s)


@pytest.mark.numerical
def test_late_and_averaged_speeds_give_what_exact_ones_do() -> None:
    """Within half a sigma, of the very same noise of the IMU: the last cycles, and the first of a window, are not used."""
    late = "vehicle.wheels.0.speed_latency_s=0.02", "vehicle.wheels.1.speed_window_s=0.03", "vehicle.wheels.2.speed_latency_s=0.06"
    of_each = []
    for keys in ((), late):
        _, flight = flown("wheels", *keys)
        found = estimated(flight)
        assert not found.notices
        of_each.append((found.conclusions[0].values, found.conclusions[0].sigmas, logged(flight)))
    (exact, sigma, speed), (values, _, shown) = of_each
    assert np.abs((values - exact) / sigma)[:9].max() < 0.5
    assert np.abs(shown - speed).max() > 10 * np.abs(np.diff(speed)).max() / 100


def test_a_step_is_told_by_the_speeds_themselves() -> None:
    rng = np.random.default_rng(1)
    exact = rng.uniform(-50, 50, 200)
    assert step_of(np.round(exact / 0.1) * 0.1) == pytest.approx(0.1)
    assert step_of(exact) == 0.0
    assert step_of(np.zeros(200)) == 0.0
