"""A plan: information adds up, the best blocks are chosen, limits are kept, and what is predicted is what its logs give."""

import json
import re
from itertools import combinations_with_replacement
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli import flow as analysis
from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.require import precise
from massprop_cli.inputs.vehiclefile import VehicleSource, parse
from massprop_cli.plan import flow, guess, limits, motions, rehearsal
from massprop_cli.plan.choose import Candidate, Criterion, PlanGoal, choose
from massprop_cli.plan.flow import PlanRequest, WrittenPlan
from massprop_cli.testbed import bound, output, scenario, simulate
from tests import cramerrao
from tests.commandline import massprop, succeeded

BODY = scenario.load("free-flyer").scenario.truth
WANT = "ixx 1 %, cg_z 0.5 mm, mass 3 %"
JETS = tuple(jet.name for jet in scenario.load("free-flyer").scenario.vehicle.jets)


WHEEL = '{name="x", axis=[1.0, 0.0, 0.0], spin_inertia_kg_m2=2e-3, locked_in_inertia=true, column="speed"}'
ROTOR = '{name="m1", position_m=[0.1, 0.0, 0.0], axis=[0.0, 0.0, 1.0], spin=1, thrust_n=[0.0, 1.0], torque_ratio_m=0.01}'


def all_but(*stems: str) -> tuple[str, ...]:
    """Jets to plan without: with few axes left few motions are flown, which is what planning takes its time for."""
    return tuple(name for name in JETS if not name.startswith(stems))


SIDEWAYS = [part for name in all_but("divert_x") for part in ("--without", name)]


def vehicle_text(name: str = "free-flyer") -> str:
    return output.vehicle_toml(scenario.load(name).scenario.vehicle)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("plan")
    (found / "vehicle.toml").write_text(vehicle_text())
    values = "\n".join(f"{name} = {value!r}" for name, value in zip(QUANTITIES, BODY.values.tolist(), strict=True))
    (found / "guess.toml").write_text(f"[body]\n{values}\n")
    return found


@pytest.fixture(scope="module")
def made(folder: Path) -> WrittenPlan:
    options = PlanRequest(precise(WANT), max_time_s=6.0, limits={"rate_rad_s": 0.4, "travel_m": 1.0})
    return flow.make(folder / "vehicle.toml", folder / "guess.toml", options, lambda *_: None)


def test_information_adds_up_to_the_bound() -> None:
    pulses = '[{motion="random",axes=["roll","pitch","yaw","x","y","z"],start_s=0.0,end_s=3.0}]'
    source = scenario.load("free-flyer", ["duration_s=3.0", f"plan={pulses}"])
    flown = simulate.fly(source, [3])
    told = bound.information(source, flown.issued, flown.truth[0])
    whole = cramerrao.cramer_rao(source, flown, 0)[0]
    sizes = bound.natural_sizes(flown.truth[0, 0])
    sigma = np.sqrt(np.diag(np.linalg.inv(told[0].sum(0)))[:10]) * sizes
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(whole)), rtol=1e-6)


def synthetic(seed: int, count: int) -> list[Candidate]:
    rng = np.random.default_rng(seed)
    roots = rng.standard_normal((count, 10, 4)) * 10.0 ** rng.uniform(0, 2, (count, 1, 1))
    told = roots @ roots.transpose(0, 2, 1)
    return [Candidate(motions.Manoeuvre("steady", ("x",), level=0.5), one[None], {"impulse_n_s": 1.0 + i}) for i, one in enumerate(told)]


@pytest.mark.parametrize("criterion", get_args(Criterion))
@pytest.mark.parametrize("seed", range(4))
def test_what_is_chosen_is_near_the_best_of_all_combinations(criterion: Criterion, seed: int) -> None:
    tried = synthetic(seed, 6)
    wanted = PlanGoal(precise("ixx 1 %, cg_z 0.5 mm, mass 2 %"), BODY.values[None], scenario.load("free-flyer").scenario.vehicle)
    chosen = choose(tried, wanted, criterion, 5, 0.0, lambda _: True)

    def score(numbers: tuple[int, ...] | list[int]) -> float:
        return float(wanted.score(sum((tried[i].information for i in numbers), np.zeros((1, 10, 10))), criterion))

    best = min(score(numbers) for numbers in combinations_with_replacement(range(6), 5))
    assert len(chosen) == 5
    assert score(chosen) <= best + 0.1 * abs(best)


def test_what_is_chosen_keeps_to_its_budget() -> None:
    tried = synthetic(1, 6)
    wanted = PlanGoal(precise("mass 2 %"), BODY.values[None], scenario.load("free-flyer").scenario.vehicle)
    spent = [tried[i].used["impulse_n_s"] for i in choose(tried, wanted, "worst", 20, 0.0, lambda c: sum(i + 1 for i in c) <= 9)]
    assert 0 < sum(spent) <= 9


def test_a_steady_push_takes_what_mechanics_says() -> None:
    """Travel a t²/2 and impulse F t of a point that is pushed through its CG; a turn's rate is τ t / I."""
    body = np.array([0.6, 0.0, 0.0, 2.7, 0.0, 2.4, 0.0, 0.0, 0.0, 22.0])
    settings = ["duration_s=2.0", "truth.ixy=0.0", "truth.ixz=0.0", "truth.iyz=0.0"]
    settings += [f"truth.cg_{axis}=0.0" for axis in "xyz"] + ["vehicle.imu.position_m=[0,0,0]"]
    source = scenario.load("free-flyer", [*settings, 'plan=[{motion="steady",axes=["x"],start_s=0.0,end_s=2.0}]'])
    used = limits.used(simulate.fly(bound.noise_free(source), [1]))
    force, time = 2.224110808, 2.0 - 0.1
    assert used["impulse_n_s"] == pytest.approx(force * 2.0, rel=1e-9)
    assert used["travel_m"] == pytest.approx(force / body[9] * time**2 / 2, rel=5e-3)
    assert used["accel_m_s2"] == pytest.approx(force / body[9], rel=1e-9)
    turning = scenario.load("free-flyer", [*settings, 'plan=[{motion="steady",axes=["roll"],start_s=0.0,end_s=2.0}]'])
    used = limits.used(simulate.fly(bound.noise_free(turning), [1]))
    torque = 2 * 0.1475 * 1.112055404
    assert used["rate_rad_s"] == pytest.approx(torque * time / body[0], rel=5e-3)
    assert used["tilt_rad"] == pytest.approx(torque * time**2 / 2 / body[0], rel=5e-3)


def test_the_bodies_that_a_vehicle_may_be_are_bodies_within_the_spread() -> None:
    source = parse(vehicle_text(), "vehicle.toml")
    bodies = guess._bodies(guess.GuessFile(body=BODY), source)
    assert np.array_equal(bodies[0], BODY.values)
    assert (np.diff(bodies[1:, 9]) <= 0).all()
    for body in bodies[1:]:
        low, middle, high = np.linalg.eigvalsh(body[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3))
        assert low > 0
        assert low + middle > high
        assert abs(body[9] / BODY.mass - 1) <= 0.2
    traces = bodies[:, [0, 3, 5]].sum(1)
    assert traces.min() < 0.95 * traces[0] < 1.05 * traces[0] < traces.max()


def flown(made: WrittenPlan, seeds: list[int]) -> tuple[Array, Array, dict[str, float]]:
    """Sigmas over what is predicted, errors over sigmas, and the most that is taken, of the plan's own logs."""
    source = scenario.parse(made.scenario, "scenario.toml")
    predicted = np.array([item.sigma for item in made.plan.quantities.values()])
    flight = simulate.fly(source, seeds)
    sigmas, errors = [], []
    for member in range(len(seeds)):
        found = analysis.examine(flight.log(member), VehicleSource(flight.vehicle, "plan", ""))
        sigmas.append(np.sqrt(np.diag(found.conclusions[0].covariance)))
        errors.append((found.conclusions[0].values - flight.truth[member, 0]) / sigmas[-1])
    quiet = limits.used(simulate.fly(bound.noise_free(source), seeds))
    return np.array(sigmas) / predicted, np.array(errors), quiet


@pytest.mark.thorough
def test_what_is_predicted_is_what_the_plans_own_logs_give(made: WrittenPlan) -> None:
    assert made.plan.reached
    assert made.exit_code == 0
    ratio, errors, most = flown(made, [4, 5, 6])
    assert 0.9 < ratio.min() <= ratio.max() < 1.1
    assert np.abs(errors).max() < 4
    assert most["rate_rad_s"] <= 0.4
    assert most["travel_m"] <= 1.0


@pytest.mark.seeds
@pytest.mark.thorough
def test_what_no_bound_counts_is_in_what_is_predicted(folder: Path) -> None:
    settings = ("thrust.pulse_sigma=0.03", "environment.disturbance_torque_n_m=0.002", "thrust.scale_sigma=0.01")
    options = PlanRequest(precise("ixx 2 %, mass 5 %"), max_time_s=6.0, off=all_but("divert_x", "roll", "pitch", "yaw"))
    made = flow.make(folder / "vehicle.toml", folder / "guess.toml", options, lambda *_: None, settings)
    assert made.plan.reached
    assert made.plan.beyond_bound["ixx"] > 2
    ratio, errors, _ = flown(made, [4, 5, 6, 7])
    assert 0.85 < np.sqrt((ratio**2).mean(0)).min() <= np.sqrt((ratio**2).mean(0)).max() < 1.15
    assert np.abs(errors).max() < 4.5


def test_the_course_falls_to_what_is_predicted(made: WrittenPlan) -> None:
    for name, item in made.plan.quantities.items():
        told = [sigma for sigma in made.plan.course[name] if sigma is not None]
        assert (np.diff(told) <= 1e-12).all(), "information is never lost"
        assert told[-1] == pytest.approx(item.sigma, rel=1e-9)
        assert item.longer["4"] == pytest.approx(item.sigma / 2, rel=1e-3)
    mass = made.plan.quantities["mass"]
    assert mass.wanted_sigma == pytest.approx(0.03 * BODY.mass)
    assert mass.ratio is not None
    assert mass.ratio <= 1
    assert mass.reached_at_s is not None
    assert mass.reached_at_s <= made.plan.duration_s <= 6.0
    assert made.plan.timeline[-1].end_s == made.plan.duration_s


def by_momentum(folder: Path, name: str, options: PlanRequest) -> tuple[WrittenPlan, simulate.SimulatedFlight]:
    """A plan for a packaged vehicle that turns by what it stores, and two flights of it."""
    source = scenario.load(name).scenario
    full = {key: value for key, value in source.actuators.model_dump().items() if key.startswith("max_") and value is not None}
    values = dict(zip(QUANTITIES, source.truth.values.tolist(), strict=True))
    (folder / "vehicle.toml").write_text(vehicle_text(name))
    (folder / "guess.toml").write_text(configfile.toml({"body": values, "actuators": full}))
    made = flow.make(folder / "vehicle.toml", folder / "guess.toml", options, lambda *_: None)
    return made, simulate.fly(scenario.parse(made.scenario, "scenario.toml", ()), (1, 2))


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("name", ["wheels", "control-moment-gyros"])
def test_motions_by_what_stores_momentum_are_planned_and_give_what_is_predicted(name: str, tmp_path: Path) -> None:
    """Wheels begin with up to 200 rad/s, and are not to pass 260."""
    made, flight = by_momentum(
        tmp_path, name, PlanRequest(precise("ixx 0.3 %, iyy 0.3 %, izz 0.3 %"), max_time_s=8.0, limits={"wheel_rad_s": 260.0})
    )
    assert made.plan.reached
    predicted = {quantity: item.sigma for quantity, item in made.plan.quantities.items()}
    for member in range(2):
        found = analysis.examine(flight.log(member), VehicleSource(flight.vehicle, "", "")).conclusions[0]
        for i in (0, 3, 5):
            quantity = QUANTITIES[i]
            sigma = float(np.sqrt(found.covariance[i, i]))
            assert sigma == pytest.approx(predicted[quantity], rel=0.03)
            assert abs(found.values[i] - flight.truth[member, 0, i]) < 4.5 * sigma
    speeds = [np.abs(speed).max() for column, speed in flight.turning.items() if column.startswith("wheel_")]
    assert max(speeds, default=0.0) <= 260.0


@pytest.mark.thorough
def test_wheels_beside_jets_stand_while_these_are_planned(folder: Path) -> None:
    options = PlanRequest(precise("mass 5 %"), max_time_s=2.0, off=all_but("divert_x"))
    vehicle, body = folder / "vehicle.toml", folder / "guess.toml"
    uncertain = "thrust.scale_sigma=0.3"
    made, without = (flow.make(vehicle, body, options, lambda *_: None, (uncertain, *own)).plan for own in ((f"wheels=[{WHEEL}]",), ()))
    assert "the wheels keep their initial speed: the plan moves the vehicle by jets or a wrench" in made.notes
    assert made.quantities["mass"].sigma == pytest.approx(without.quantities["mass"].sigma, rel=0.02)


def turning_wheel(speed_rad_s: float) -> tuple[str, ...]:
    """Settings of a vehicle with jets, 30 % uncertain, and a wheel that turns at this speed."""
    return "thrust.scale_sigma=0.3", f"wheels=[{WHEEL.replace('}', f', start_rad_s={speed_rad_s}}}')}]"


@pytest.mark.parametrize(("speed_rad_s", "least", "most"), [(0.0, 0.3, 0.31), (300.0, 0.01, 0.03)])
def test_stored_momentum_calibrates_the_thrust_as_the_cramer_rao_bound_says(
    speed_rad_s: float, least: float, most: float, folder: Path
) -> None:
    """A wheel's 0.6 N m s precesses as the vehicle turns: torque by a stated momentum, beside which the thrust shows."""
    source = parse(vehicle_text(), "vehicle.toml", turning_wheel(speed_rad_s))
    own = rehearsal.rehearsal(source, guess.load(folder / "guess.toml", source))
    shaken = motions.Manoeuvre("alternating", ("roll", "pitch", "yaw", "x", "y", "z"), 5).segments(0, 80)
    planned = own.scenario(shaken, 80)
    flight = simulate.fly(planned, [1])
    wanted = PlanGoal(precise("mass 2 %"), BODY.values[None], own.vehicle)
    sigmas = wanted.sigmas(own.information(80, flight.issued, BODY.values[None]).sum(1))[0]
    np.testing.assert_allclose(sigmas, np.sqrt(np.diag(cramerrao.cramer_rao(planned, flight, 0)[0])), rtol=1e-3)
    assert least < sigmas[9] / BODY.mass < most


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_precision_that_stored_momentum_makes_possible_is_planned(folder: Path) -> None:
    options = PlanRequest(precise("mass 5 %"), max_time_s=4.0, off=all_but("divert_x", "roll", "pitch"))
    made = flow.make(folder / "vehicle.toml", folder / "guess.toml", options, lambda *_: None, turning_wheel(300.0))
    assert made.plan.reached
    ratio, errors, _ = flown(made, [4])
    assert ratio[0, 9] == pytest.approx(1.0, abs=0.1)
    assert abs(errors[0, 9]) < 4.5


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_precision_out_of_reach_exits_4_with_the_best_and_what_limits_it(folder: Path) -> None:
    arguments = ["--vehicle", "vehicle.toml", "--guess", "guess.toml", *SIDEWAYS, "--max-time", "1", "-q", "--out", "far"]
    done = massprop(folder, "plan", "--want", "mass 0.1 %", *arguments)
    assert done.returncode == 4
    assert done.stderr.startswith("massprop: not reached: mass comes to ± ")
    assert "would reach it (--max-time)" in done.stderr
    told = json.loads((folder / "far" / "plan.json").read_text())
    assert not told["reached"]
    assert (folder / "far" / "plan.html").read_text().count("<svg") >= 1
    succeeded(folder, "simulate", "far/scenario.toml", "--out", "log", "-q")


def test_a_common_uncertainty_of_the_thrust_is_named_as_what_no_time_mends(folder: Path) -> None:
    options = PlanRequest(precise("mass 1 %"), max_time_s=1.0, off=all_but("divert_x"))
    made = flow.make(folder / "vehicle.toml", folder / "guess.toml", options, lambda *_: None, ("thrust.scale_sigma=0.02",))
    assert made.exit_code == 4
    assert "thrust.scale_sigma keeps it above ± 0.44 kg for any duration: weigh the vehicle" in made.plan.limited_by


@pytest.mark.parametrize(
    ("more", "code", "said"),
    [
        (["--want", "mass 2"], 3, "--want mass 2: the unit is missing; give it in % or kg or g"),
        (["--want", "weight 2 %"], 3, "no such quantity"),
        (["--want", "mass"], 3, "states no precision"),
        (["--want", "mass two"], 2, "is not a precision"),
        (["--want", "mass 2 %", "--without", "nose"], 3, "--without nose: vehicle.toml has no such jet; it has roll_p1"),
        (["--want", "mass 2 %", "--max-time", "0.15"], 3, "give more time"),
        (
            ["--want", "mass 2 %", *SIDEWAYS, "--max-time", "0.5", "--max-rate", "1e-6"],
            3,
            "no motion keeps the limit of 1e-06 rad/s on the body rate",
        ),
        (["--want", "mass 2 %", "--set", "imu.gyro_noise_rad_s=0.0"], 3, "imu.gyro_noise_rad_s is 0; a plan needs the noise"),
        (["--want", "mass 2 %", "--set", "jets=[]"], 3, "no actuators to plan with"),
        (["--want", "ixx 2 %", "--set", "jets=[]", "--set", f"wheels=[{WHEEL}]"], 3, "[actuators] max_wheel_torque_n_m"),
        (["--want", "mass 2 %", "--set", "jets=[]", "--set", f"rotors=[{ROTOR}]"], 3, "massprop cannot plan for a hovering vehicle"),
        (["--want", "mass 2 %", "--out", "."], 2, "is the current folder"),
    ],
)
def test_what_can_not_be_planned_is_refused_with_the_remedy(more: list[str], code: int, said: str, folder: Path) -> None:
    before = sorted(folder.rglob("*"))
    done = massprop(folder, "plan", "--vehicle", "vehicle.toml", "--guess", "guess.toml", *more)
    assert (done.returncode, done.stdout) == (code, "")
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr
    assert sorted(folder.rglob("*")) == before


def test_a_vehicle_file_without_nominal_values_asks_for_a_guess(folder: Path) -> None:
    done = massprop(folder, "plan", "--vehicle", "vehicle.toml", "--want", "mass 2 %")
    assert done.returncode == 3
    assert "does not state ixx, iyy, izz, mass; a plan needs a rough guess" in done.stderr


def test_a_guess_that_no_body_is_like_is_told(folder: Path, made: WrittenPlan) -> None:
    values = dict(zip(QUANTITIES, BODY.values.tolist(), strict=True)) | {"izz": 2 * float(BODY.ixx + BODY.iyy)}
    (folder / "flat.toml").write_text("[body]\n" + "\n".join(f"{name} = {value!r}" for name, value in values.items()))
    options = PlanRequest(precise("mass 20 %"), max_time_s=1.0, off=all_but("divert_x"))
    told = flow.make(folder / "vehicle.toml", folder / "flat.toml", options, lambda *_: None).plan.notes
    assert [note for note in told if "triangle inequality" in note]
    assert not [note for note in made.plan.notes if "triangle inequality" in note]


def test_failures_are_of_another_log(folder: Path, tmp_path: Path) -> None:
    assigned = ('thrust.failures=[{jet="roll_p1", start_s=1.0}]',)
    options = PlanRequest(precise("mass 20 %"), max_time_s=1.0, off=all_but("divert_x"))
    planned = flow.make(folder / "vehicle.toml", folder / "guess.toml", options, lambda *_: None, assigned)
    assert [note for note in planned.plan.notes if "ignore thrust.failures, which belong to another log" in note]
    (tmp_path / "scenario.toml").write_text(planned.scenario)
    assert not scenario.load(str(tmp_path / "scenario.toml")).scenario.failures


def test_an_axis_that_no_jet_serves_is_not_planned(folder: Path) -> None:
    source = parse((folder / "vehicle.toml").read_text(), "vehicle.toml")
    known = guess.load(folder / "guess.toml", source)
    assert rehearsal.rehearsal(source, known).axes == ("roll", "pitch", "yaw", "x", "y", "z")
    few = rehearsal.rehearsal(source, known, [name for name in JETS if name.startswith(("divert_z", "roll"))])
    assert set(few.axes) == {"pitch", "yaw", "x", "y"}
    with pytest.raises(InputError, match="leaves no jet"):
        rehearsal.rehearsal(source, known, JETS)


@pytest.mark.thorough
def test_a_vehicle_that_can_not_hold_its_roll_is_planned_with_what_it_can_do(folder: Path) -> None:
    off = all_but("yaw", "divert_x")
    made = flow.make(
        folder / "vehicle.toml", folder / "guess.toml", PlanRequest(precise("mass 20 %"), max_time_s=1.0, off=off), lambda *_: None
    )
    axes = {axis for segment in scenario.parse(made.scenario, "scenario.toml").scenario.plan for axis in segment.driven}
    assert "yaw" in axes
    assert not axes & {"roll", "z"}


@pytest.mark.parametrize(
    ("options", "said", "option"),
    [
        (
            PlanRequest(precise("mass 1 %"), 1.0, limits={"impulse_n_s": 0.5}, off=all_but("divert_x")),
            "with 0.5 N s; about ",
            "(--max-impulse, --max-time)",
        ),
        (
            PlanRequest(precise("mass 1 %"), 1.0, limits={"travel_m": 1e-3}, off=all_but("divert_x", "divert_y")),
            "with the limit on the travel; about ",
            "(--max-time)",
        ),
    ],
)
def test_the_limit_that_keeps_a_precision_from_being_reached_is_named(options: PlanRequest, said: str, option: str, folder: Path) -> None:
    made = flow.make(folder / "vehicle.toml", folder / "guess.toml", options, lambda *_: None)
    assert said in made.plan.limited_by
    assert made.plan.limited_by.endswith(option)
    assert all(item.allowed is None or item.used <= item.allowed for item in made.plan.limits.values())


def test_the_impulse_that_is_named_reaches_the_precision(folder: Path) -> None:
    """Two pairs of jets, a rate limit far off: 1 N s tells the mass half as well as is wanted, and no time but impulse tells it better."""
    wants, off, slow = precise("mass 10 %"), all_but("divert_x", "divert_y"), {"rate_rad_s": 2.0}

    def planned(impulse_n_s: float) -> WrittenPlan:
        options = PlanRequest(wants, 2.0, limits=slow | {"impulse_n_s": impulse_n_s}, off=off)
        return flow.make(folder / "vehicle.toml", folder / "guess.toml", options, lambda *_: None)

    short = planned(1.0).plan
    found = re.search(r"in ([\d.]+) s at worst, ([\d.]+) times .* with 1 N s; about ([\d.]+) N s would reach it", short.limited_by)
    assert found is not None
    assert float(found[1]) == short.duration_s
    assert short.quantities["mass"].ratio == pytest.approx(float(found[2]), rel=5e-3)
    assert 1 < float(found[3]) < 1.5 * float(found[2]) ** 2
    assert planned(float(found[3])).plan.reached
