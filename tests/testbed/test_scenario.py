"""Scenario files: what is refused and how it is said; how plans become demands."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from massprop_cli.base.errors import InputError
from massprop_cli.cli import app
from massprop_cli.testbed import mission, output, scenario, simulate
from tests import flight

BASE = """schema = 1
name = "small"
duration_cycles = 100
[truth]
ixx = 1.0
iyy = 2.0
izz = 2.5
mass = 20.0
[control]
rate_gain_n_m_s = [1.0, 1.0, 1.0]
attitude_gain_n_m = [1.0, 1.0, 1.0]
[vehicle]
schema = 1
[vehicle.cycle]
period_s = 0.05
command_delay_cycles = 2.0
"""
JETS = "".join(
    f'[[vehicle.jets]]\nname = "{jet["name"]}"\nposition_m = {jet["position_m"]}\nforce_n = {jet["force_n"]}\n' for jet in flight.jets()
)
HOLD = '[[plan]]\nmotion = "hold"\nstart_cycle = 0\nend_cycle = 50\n'


def refusal(text: str, assignments: tuple[str, ...] = ()) -> str:
    with pytest.raises(InputError) as caught:
        simulate.fly(scenario.parse(text, "small.toml", assignments), [1])
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("text", "assignment", "words"),
    [
        (BASE + JETS + HOLD + HOLD.replace("0\nend", "49\nend").replace("= 50", "= 60"), "", ["segments 1", "2", "overlap on roll"]),
        (BASE + JETS + '\n[[plan]]\nmotion = "random"\naxes = ["rol"]\nstart_s = 0\nend_s = 1', "", ["plan.0.axes.0", "rol", "roll"]),
        (BASE + JETS + '\n[[actuators.failures]]\njet = "couple_xp"', "", ["unknown jet 'couple_xp'", "nearest"]),
        (BASE + JETS, "truth.mass=0", ["setting truth.mass=0", "greater than"]),
        (BASE + JETS, "truth.ixy=1.5", ["truth", "singular or not positive definite"]),
        (BASE + JETS, "sensors.gyro_noise_rad_s=-1e-4", ["sensors.gyro_noise_rad_s", "greater than or equal to 0"]),
        (BASE + JETS, "actuators.pwm_tick_s=0.1", ["pwm_tick_s = 0.1 s", "longer than the control cycle of 0.05 s"]),
        (BASE + JETS, "vehicle.cycle.pwm_tick_s=0.06", ["pwm_tick_s = 0.06 s", "longer"]),
        (BASE + JETS, "sensors.gyro_noise=1", ["unknown key", "gyro_noise_rad_s"]),
        (BASE + JETS, "duration_s=5.0", ["either duration_cycles or duration_s"]),
        (BASE + JETS + HOLD.replace("end_cycle = 50", "end_cycle = 0"), "", ["end_cycle"]),
        (BASE + JETS + HOLD.replace("end_cycle = 50", "end_s = 0.33"), "", ["0.33 s", "no whole number of cycles"]),
        (BASE + JETS + HOLD.replace("end_cycle = 50\n", ""), "", ["either end_cycle or end_s"]),
        (BASE + JETS + HOLD.replace("= 0", "= 100").replace("= 50", "= 150"), "", ["starts at cycle 100, after the end at cycle 100"]),
        (
            BASE.replace("[control]", "[initial]\n#").replace("rate_gain", "#").replace("attitude_gain", "#") + JETS + HOLD,
            "",
            ["add [control]"],
        ),
        (BASE + HOLD, "", ["no jets", "max_torque_n_m"]),
        (BASE + JETS + '[[events]]\nkind = "dock"\ncycle = 10\n', "", ["[docked]", "go together"]),
        (BASE + JETS + '[[events]]\nkind = "reset"\ncycle = 100\n', "", ["comes after the end"]),
        (BASE + JETS, "vehicle.cycle.command_delay_cycles=auto", ["actuators.delay_cycles"]),
        (BASE + JETS, "vehicle.jets.3.fall_s=0.2", ["rise or fall longer than the control cycle"]),
        (BASE + JETS, 'vehicle.environment={kind="air_bearing", bearing_mass_kg=20.0}', ["includes the bearing's 20 kg"]),
        (BASE, "fuel={specific_impulse_s=50.0}", ["needs jets"]),
        (BASE + JETS, "initial.rate_rad_s=[30.0, 0.0, 0.0]", ["turns faster than one radian per cycle"]),
        (BASE + JETS + HOLD.replace('"hold"', '"random"\naxes=["x"]\nmax_cycles=9'), "", ["don't fit a redraw every 5"]),
        (BASE + JETS + HOLD.replace('"hold"', '"steady"\naxes=["x"]\ntorque_n_m=9'), "", ["torque_n_m does not fit axes x"]),
        (BASE + JETS + HOLD.replace('"hold"', '"coast"\nclosed_loop=true'), "", ["takes no pulses"]),
        (BASE + JETS, "truth.mass=true", ["truth.mass", "number"]),
        (BASE + JETS, "duration_s=1e30", ["setting duration_s"]),
        (BASE.replace("duration_cycles = 100", "duration_s = 1e12") + JETS, "", ["more than 1e+07 cycles"]),
        (BASE.replace("duration_cycles = 100", "duration_s = 1e-9") + JETS, "", ["no whole number of cycles"]),
        (BASE + JETS, "vehicle.cycle.period_s=1e-13", ["too short to simulate"]),
        (BASE + JETS, 'vehicle.phases=[{name="p", start_s=-5.0, end_s=0.04}]', ["phase 'p'", "fewer than two cycles"]),
        (BASE + JETS + '[[events]]\nkind="reset"\ncycle=9\nphase="phase-1"', "", ["phase name 'phase-1' is used twice"]),
        (BASE + JETS, "vehicle.thrust.lag_s=1e8", ["more than 1000 cycles"]),
        (BASE + JETS, "sensors.accel_bias_m_s2=[1e20, 0.0, 0.0]", ["accelerometer would log more than"]),
        (BASE + JETS + '[[actuators.failures]]\njet="divert_xp"\nstart_s=2.0\nend_s=1.0', "", ["has no duration"]),
    ],
)
def test_a_bad_scenario_is_refused_in_one_line_that_says_what_and_where(text: str, assignment: str, words: list[str]) -> None:
    message = refusal(text, (assignment,) if assignment else ())
    for word in words:
        assert word in message, message


def test_an_axis_that_the_jets_cannot_serve_is_refused_by_segment() -> None:
    one_jet = '[[vehicle.jets]]\nname = "a"\nposition_m = [0, 0, 0]\nforce_n = [1.0, 0, 0]\n'
    assert "plan segment 1: the vehicle cannot drive x in both directions" in refusal(
        BASE + one_jet + '[[plan]]\nmotion = "steady"\naxes = ["x"]\nstart_cycle = 0\nend_cycle = 5\n'
    )


def test_an_inertia_that_breaks_the_triangle_inequality_is_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "flat.toml"
    path.write_text(BASE + JETS + HOLD)
    plain = CliRunner().invoke(app, ["simulate", str(path), "--out", str(tmp_path / "a")])
    flat = CliRunner().invoke(app, ["simulate", str(path), "--out", str(tmp_path / "b"), "--set", "truth.izz=3.5"])
    assert (plain.exit_code, flat.exit_code) == (0, 0)
    assert "triangle" not in plain.output
    assert "triangle" in flat.output
    assert (tmp_path / "b" / "truth.json").exists()


def test_what_is_unlikely_to_be_meant_is_a_warning() -> None:
    strong = BASE + JETS + '[[plan]]\nmotion = "steady"\naxes = ["x"]\nforce_n = 9.0\nstart_cycle = 0\nend_cycle = 5\n'
    assert [notice.code for notice in output.warnings(scenario.parse(strong, "t"))] == ["plan-saturates"]
    docked = "[docked]\nixx = 1.0\niyy = 1.0\nizz = 1.0\nmass = 5.0\n" + '[[events]]\nkind = "dock"\ncycle = 20\n'
    over = scenario.parse(BASE + JETS + docked, "t", ['vehicle.phases=[{name="p", start_s=0.0, end_s=4.0}]'])
    assert [notice.code for notice in output.warnings(over)] == ["phase-over-docking"]
    assert over.scenario.logged.docking is None
    assert output.warnings(scenario.parse(BASE + JETS + HOLD + docked, "t")) == []


@pytest.mark.parametrize("phases", ["", "begin, reset 20 cycles later", "three"])
def test_the_vehicle_written_says_between_which_phases_it_docked(phases: str) -> None:
    docked = "[docked]\nixx = 1.0\niyy = 1.0\nizz = 1.0\nmass = 5.0\n" + '[[events]]\nkind = "dock"\ncycle = 40\n'
    reset = '[[events]]\nkind = "reset"\ncycle = {}\n'
    events = {"": "", "begin, reset 20 cycles later": reset.format(60), "three": reset.format(20) + reset.format(60)}
    logged = scenario.parse(BASE + JETS + docked + events[phases], "t").scenario.logged
    assert logged.docking is not None
    around = {phase.name: phase for phase in logged.phases}
    ends, begins = around[logged.docking.before].end_s, around[logged.docking.after].start_s
    at = 40 * logged.cycle.period_s
    assert ends == pytest.approx(at)
    assert begins == pytest.approx(at if not phases else 60 * logged.cycle.period_s)


def test_the_vehicle_written_has_no_column_names_of_its_own() -> None:
    named = scenario.parse(BASE + JETS, "t", ['vehicle.columns={time_s={from="t", scale=0.001}}']).scenario.vehicle
    assert "columns" not in output.vehicle_toml(named)


def test_refusals_leave_no_folder_and_unknown_scenarios_name_the_nearest(tmp_path: Path) -> None:
    found = CliRunner().invoke(app, ["simulate", "refind", "--out", str(tmp_path / "x")])
    assert found.exit_code == 3
    assert "nearest packaged scenario is 'refined'" in found.output
    missing = CliRunner().invoke(app, ["simulate", str(tmp_path / "none.toml"), "--out", str(tmp_path / "x")])
    assert missing.exit_code == 3
    assert "no such scenario file" in missing.output
    assert CliRunner().invoke(app, ["simulate"]).exit_code == 2
    assert not (tmp_path / "x").exists()


def test_listing_names_every_packaged_scenario_with_a_description() -> None:
    lines = CliRunner().invoke(app, ["simulate", "--list"]).output.splitlines()
    assert [line.split()[0] for line in lines] == [
        "control-moment-gyros",
        "docked-hold",
        "docking",
        "free-flyer",
        "multicopter",
        "pedestal",
        "planar",
        "preliminary",
        "refined",
        "testbed",
        "testbed-joined",
        "wheels",
        "wheels-and-jets",
    ]
    assert all(len(line.split()) > 4 for line in lines)


def test_a_vehicle_file_can_stand_beside_the_scenario(tmp_path: Path) -> None:
    own, vehicle_text = BASE.split("[vehicle]\n")
    (tmp_path / "v.toml").write_text(vehicle_text.replace("[vehicle.", "[") + JETS.replace("vehicle.", ""))
    path = tmp_path / "s.toml"
    path.write_text('vehicle = "v.toml"\n' + own + HOLD)
    inline = scenario.parse(BASE + JETS + HOLD, "inline").scenario
    assert scenario.load(str(path)).scenario == inline
    changed = scenario.load(str(path), ["vehicle.imu.gyro_noise_rad_s=0.5"]).scenario
    assert changed.vehicle.imu.gyro_noise_rad_s == 0.5
    (tmp_path / "v.toml").write_text("schema = 1\n[cycl]\n")
    with pytest.raises(InputError, match=r"v\.toml, line 2: unknown key 'cycl'"):
        scenario.load(str(path))


def test_products_of_inertia_take_the_sign_that_their_convention_says() -> None:
    tensor = scenario.parse(BASE + JETS, "t", ["truth.ixy=0.1"]).scenario.truth
    positive = scenario.parse(BASE + JETS, "t", ["truth.ixy=-0.1", "truth.poi_convention=positive_integral"]).scenario.truth
    assert np.array_equal(tensor.values, positive.values)
    assert tensor.inertia[0, 1] == 0.1


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_allocated_jets_make_the_demanded_wrench_and_no_other(axis: int, sign: float) -> None:
    rng = np.random.default_rng(3)
    # eight thrusters in no particular order, none of them a couple
    layouts = [
        flight.jets(),
        [
            {"name": f"j{i}", "position_m": p.tolist(), "force_n": f.tolist()}
            for i, (p, f) in enumerate(zip(rng.normal(0, 0.3, (14, 3)), rng.normal(0, 1, (14, 3)), strict=True))
        ],
    ]
    for jets in layouts:
        used = flight.vehicle(jets=jets)
        plan = scenario.Scenario.model_validate(
            {"schema": 1, "duration_cycles": 5, "vehicle": used, "truth": {"ixx": 1, "iyy": 1, "izz": 1, "mass": 1}}
        )
        allocated = mission.allocation(scenario.ScenarioSource(plan, "t"))
        side = 0 if sign > 0 else 1
        if np.isnan(allocated.on_time_share[axis, side]).any():
            assert jets is layouts[1]
            continue
        demand = np.zeros((1, 6))
        demand[0, axis] = 0.5 * sign * allocated.full[axis, side]
        share = allocated.commands(demand)
        assert np.allclose(share @ used.jet_wrench, demand, rtol=0, atol=1e-8)
        assert share.max() == pytest.approx(0.5)
        assert share.min() >= 0


def test_the_strong_jet_is_taken_rather_than_two_weak_ones() -> None:
    plan = scenario.parse(BASE + JETS + HOLD, "t")
    allocated = mission.allocation(plan)
    names = [jet.name for jet in plan.scenario.vehicle.jets]
    for axis, letter in enumerate("xyz", 3):
        for side, sign in enumerate("pn"):
            assert [names[i] for i in np.flatnonzero(allocated.on_time_share[axis, side])] == [f"divert_{letter}{sign}"]
    assert np.allclose(
        allocated.full, np.repeat([[2 * 1.112 * 0.1475], [2 * 1.112 * 0.2575], [2 * 1.112 * 0.2575], [2.224], [2.224], [2.224]], 2, 1)
    )


def test_a_negative_level_is_a_part_of_what_the_other_direction_can_do() -> None:
    """Of jets that turn twice as hard one way; a part of the other way's had been asked for, 0.5 of it came as all."""
    source = scenario.load("free-flyer")
    (turning, *_) = [one for one in source.scenario.plan if one.motion == "random"]
    allocated = mission.allocation(source)
    axis = 2
    full = allocated.full.copy()
    full[axis] = [2.0, 1.0]
    uneven = replace(allocated, full=full)

    def asked(motion: str, level: float) -> set[float]:
        segment = turning.model_copy(update={"motion": motion, "axes": ("yaw",), "level": level, "closed_loop": False})
        found = mission.plan(source.scenario.model_copy(update={"plan": (segment,)}), uneven, [np.random.default_rng(1)])
        return set(found.demand[0, :, axis].tolist()) - {0.0}

    assert asked("steady", 0.5) == {1.0}
    assert asked("steady", -0.5) == {-0.5}
    assert asked("alternating", 0.5) == asked("alternating", -0.5) == {1.0, -0.5}


def test_events_make_the_phases_that_the_estimator_takes() -> None:
    docked = "[docked]\nixx = 1.0\niyy = 1.0\nizz = 1.0\nmass = 5.0\n"
    dock = '[[events]]\nkind = "dock"\ncycle = 20\n'
    reset = '[[events]]\nkind = "reset"\ncycle = 30\n'

    def names(text: str) -> list[tuple[str, float, float]]:
        return [(p.name, p.start_s, p.end_s) for p in scenario.parse(text, "t").scenario.phases]

    assert names(BASE + JETS) == [("all", 0.0, 5.0)]
    assert names(BASE + JETS + docked + dock) == [("single", 0.0, 1.0), ("combined", 1.0, 5.0)]
    assert names(BASE + JETS + docked + dock + reset) == [("single", 0.0, 1.0), ("combined", 1.5, 5.0)]
    assert names(BASE + JETS + docked + dock + 'phase = "after"\n' + reset) == [
        ("single", 0.0, 1.0),
        ("after", 1.0, 1.5),
        ("combined", 1.5, 5.0),
    ]
    assert names(BASE + JETS + reset) == [("phase-1", 0.0, 1.5), ("phase-2", 1.5, 5.0)]


def test_the_scenario_schema_accepts_the_packaged_files() -> None:
    import tomllib
    from importlib import resources

    import jsonschema

    schema = jsonschema.Draft202012Validator(json.loads((Path(__file__).parents[2] / "schemas" / "scenario.schema.json").read_text()))
    for name in scenario.packaged():
        text = (resources.files("massprop_cli.testbed") / "scenarios" / f"{name}.toml").read_text()
        schema.validate(tomllib.loads(text))


def test_a_second_clock_is_refused() -> None:
    assert "one clock only" in refusal(BASE + "[vehicle.imu]\nclock_drift_ppm = 100.0\n" + JETS + HOLD)
