"""Whole flights: against logs of another engine, through the estimator, and as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.cli import app
from massprop_cli.inputs import columns, vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.telemetry import read
from massprop_cli.testbed import conditions, simulate, truth
from massprop_cli.testbed.scenario import Scenario, ScenarioSource
from massprop_cli.testbed.timeline import Event
from tests import flight
from tests.analysed import analysed
from tests.campaigns import PLAN

SAMPLES = Path(__file__).parents[2] / "sample_logs"
SMALL: dict[str, Any] = {
    "schema": 1,
    "duration_cycles": 120,
    "vehicle": flight.vehicle("free", 2.0),
    "truth": dict(zip(QUANTITIES, flight.TRUTH.tolist(), strict=True)),
    "plan": [{"motion": "random", "axes": ["roll", "pitch", "yaw", "x", "y", "z"], "start_cycle": 0, "end_cycle": 120}],
}


def source(**changes: Any) -> ScenarioSource:
    return ScenarioSource(Scenario.model_validate(SMALL | changes), "small")


def quiet(**sensors: Any) -> dict[str, Any]:
    return {"gyro_noise_rad_s": 0.0, "accel_noise_m_s2": 0.0} | sensors


WHOLE = [pytest.param(name, None, marks=pytest.mark.thorough) for name in ("free-flyer", "air-bearing", "docking", "high-rate")]


@pytest.mark.parametrize(("name", "cycles"), [("air-bearing", 300), ("docking", 700), ("high-rate", 200), *WHOLE])
def test_recorded_commands_flown_again_give_the_recorded_increments_to_within_their_noise(name: str, cycles: int | None) -> None:
    """Logs of another engine (sample_logs/README.md), its truth, its on-times: the residuals are the stated noise and nothing else."""
    folder = SAMPLES / name
    recorded = json.loads((folder / "truth.json").read_text())
    used = vehiclefile.load(folder / "vehicle.toml").vehicle
    log = read(read_table(folder / "log.parquet"), used)
    issued = log.command[:cycles]
    rows = len(issued) * log.records_per_cycle
    data: dict[str, Any] = {"schema": 1, "duration_cycles": len(issued), "vehicle": used, "truth": recorded["phases"][0]}
    data["sensors"] = quiet(records_per_cycle=log.records_per_cycle)
    if "docked" in recorded:
        data |= {"docked": recorded["docked"], "events": [{"kind": "dock", "at_s": 25.0, "motion": "rates_kept"}]}
    flown = simulate.fly(ScenarioSource(Scenario.model_validate(data), name), [1], issued=issued)
    scale = np.sqrt(log.records_per_cycle) * log.interval_s[:rows, None]
    for logged, simulated, sigma in (
        (log.delta_theta_imu_rad[:rows], flown.delta_theta_rad[0], 1e-4),
        (log.delta_v_imu_m_s[:rows], flown.delta_v_m_s[0], 0.02),
    ):
        residual = (logged - simulated) / (sigma * scale)
        chi_square = float((residual**2).sum())
        # a chi-square variable of n degrees of freedom has mean n and variance 2 n: within 3.3 sigmas, on 8 of them
        assert abs(chi_square - residual.size) < 3.3 * np.sqrt(2 * residual.size)
        assert (np.abs(residual.mean(0)) < 4 / np.sqrt(len(residual))).all()
        halves = [float((half**2).mean()) for half in np.array_split(residual, 2)]
        assert abs(halves[1] - halves[0]) < 4 * np.sqrt(2 * 4 / residual.size)  # nothing runs away with time


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_a_flight_is_that_of_runge_and_kutta_on_the_unreduced_equations(kind: str) -> None:
    values = flight.TRUTH if kind == "free" else np.array([0.6, 0.04, -0.07, 2.8, 0.11, 2.5, 0.004, -0.006, -0.005, 25.0])
    used = flight.vehicle(kind, 1.5)
    on = flight.pulses(80, seed=3)
    expected = flight.fly(used, on, values, np.array([0.3, -0.2, 0.4]))
    changes = {"vehicle": used, "truth": dict(zip(QUANTITIES, values.tolist(), strict=True)), "plan": [], "duration_cycles": 80}
    found = simulate.fly(source(**changes, sensors=quiet(), initial={"rate_rad_s": [0.3, -0.2, 0.4]}), [1], issued=on)
    assert np.abs(found.delta_theta_rad[0] - expected.delta_theta).max() < 2e-8
    assert np.abs(found.delta_v_m_s[0] - expected.delta_v).max() < 5e-6


def test_the_same_seed_gives_the_same_numbers_alone_and_in_a_campaign() -> None:
    alone = simulate.fly(source(), [7])
    among = simulate.fly(source(), range(5, 12))
    for name in ("delta_theta_rad", "delta_v_m_s", "issued", "attitude_wxyz", "rate_rad_s"):
        assert np.array_equal(getattr(alone, name)[0], getattr(among, name)[2])
    assert not np.array_equal(among.delta_v_m_s[0], among.delta_v_m_s[1])


def test_noise_has_the_stated_size_per_cycle_however_many_records_a_cycle_has() -> None:
    for records in (1, 10):
        clean, noisy = (
            simulate.fly(source(duration_cycles=24, plan=[], sensors=sensors | {"records_per_cycle": records}), range(100))
            for sensors in (quiet(), {})
        )
        for kind, sigma in (("delta_theta_rad", 1e-4), ("delta_v_m_s", 0.02)):
            error: Array = getattr(noisy, kind) - getattr(clean, kind)
            per_cycle = error.reshape(100, 24, records, 3).sum(2) / flight.CYCLE
            assert np.sqrt((per_cycle**2).mean()) == pytest.approx(sigma, rel=4 / np.sqrt(2 * per_cycle.size))


def test_records_of_a_cycle_add_up_to_the_cycles_increment() -> None:
    whole = simulate.fly(source(sensors=quiet()), [3])
    parts = simulate.fly(source(sensors=quiet(records_per_cycle=20)), [3])
    for kind in ("delta_theta_rad", "delta_v_m_s"):
        assert np.allclose(getattr(parts, kind).reshape(1, 120, 20, 3).sum(2), getattr(whole, kind), rtol=0, atol=1e-13)
    assert np.allclose(parts.attitude_wxyz[:, ::20], whole.attitude_wxyz, rtol=0, atol=1e-13)


def test_bias_range_and_quantised_increments_are_those_of_a_real_sensor() -> None:
    clean = simulate.fly(source(sensors=quiet()), [3])
    biased = simulate.fly(source(sensors=quiet(gyro_bias_rad_s=[1e-3, 0, -2e-3])), [3])
    assert np.allclose(biased.delta_theta_rad - clean.delta_theta_rad, np.array([5e-5, 0, -1e-4]), rtol=0, atol=1e-15)
    counted = simulate.fly(source(sensors=quiet(gyro_quantum_rad=1e-4)), [3])
    counts = counted.delta_theta_rad / 1e-4
    assert np.allclose(counts, np.round(counts), rtol=0, atol=1e-6)
    # what one record leaves over comes with the next: the sum never drifts from the true angle by more than half a count
    assert np.abs(np.cumsum(counted.delta_theta_rad - clean.delta_theta_rad, 1)).max() <= 0.5001e-4
    limit = 0.5 * np.abs(clean.delta_theta_rad).max() / flight.CYCLE
    clipped = simulate.fly(source(vehicle=flight.vehicle(imu={"gyro_range_rad_s": limit}), sensors=quiet()), [3])
    assert np.abs(clipped.delta_theta_rad).max() == pytest.approx(limit * flight.CYCLE)


def test_momentum_is_conserved_when_an_object_docks() -> None:
    data = {"ixx": 0.3, "ixy": 0.02, "iyy": 0.5, "izz": 0.4, "cg_x": 0.6, "cg_y": 0.1, "cg_z": -0.2, "mass": 9.0}
    event = Event(kind="dock", cycle=60, docked_rate_rad_s=(0.1, -0.2, 0.3), docked_velocity_m_s=(-0.05, 0.02, 0.01))
    flown = simulate.fly(source(sensors=quiet(), docked=data, events=[event], initial={"rate_rad_s": [0.2, 0.1, -0.3]}, plan=[]), [1])
    values = flown.truth[0]
    first = truth.bodies(Scenario.model_validate(SMALL).truth, 1)
    position = np.array(flight.POSITION)
    before, after = flown.rate_rad_s[0, 59], flown.rate_rad_s[0, 60]
    # torque-free before: the rate just before docking is found by flying without it
    undisturbed = simulate.fly(source(sensors=quiet(), initial={"rate_rad_s": [0.2, 0.1, -0.3]}, plan=[]), [1])
    before = undisturbed.rate_rad_s[0, 60]
    docked = conditions.Body.model_validate(data)
    spin = first.inertia[..., 0] @ before + docked.inertia @ np.array(event.docked_rate_rad_s)
    velocity = np.array(event.docked_velocity_m_s)
    mass1, mass2, cg1, cg2, cg12 = 22.0, 9.0, first.cg[:, 0], docked.values[6:9], values[1, 6:9]
    assert np.allclose(cg12, (mass1 * cg1 + mass2 * cg2) / 31.0)
    inertia = values[1, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
    # angular momentum about the combined CG, in the frame in which the vehicle's CG is at rest before docking
    drift = mass2 * velocity / 31.0
    total = spin + mass1 * np.cross(cg1 - cg12, -drift) + mass2 * np.cross(cg2 - cg12, velocity - drift)
    assert np.allclose(inertia @ after, total, rtol=0, atol=1e-13)
    # linear momentum: the combined CG goes on with the mean velocity; the IMU's jump is what its point of the body does
    imu_before, imu_after = np.cross(before, position - cg1), drift + np.cross(after, position - cg12)
    coasting = simulate.fly(
        source(
            sensors=quiet(),
            plan=[],
            duration_cycles=4,
            initial={"rate_rad_s": after.tolist()},
            truth=dict(zip(QUANTITIES, values[1], strict=True)),
        ),
        [1],
    )
    jump = flown.delta_v_m_s[0, 60] - coasting.delta_v_m_s[0, 0]
    assert np.allclose(jump, imu_after - imu_before, rtol=0, atol=1e-12)


def test_an_object_that_moves_along_docks_without_a_jolt() -> None:
    rate, cg = (0.2, 0.1, -0.3), np.array([0.6, 0.1, -0.2])
    still = np.array([0.0, 0.0, 0.0])
    along = np.cross(rate, cg - still)
    event = Event(kind="dock", cycle=4, docked_rate_rad_s=rate, docked_velocity_m_s=tuple(along))
    body = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "mass": 22.0}
    data = {"ixx": 0.3, "iyy": 0.5, "izz": 0.4, "cg_x": 0.6, "cg_y": 0.1, "cg_z": -0.2, "mass": 9.0}
    changes = {"truth": body, "docked": data, "events": [event], "plan": [], "initial": {"rate_rad_s": rate}}
    flown = simulate.fly(source(sensors=quiet(), **changes), [1])
    assert np.allclose(flown.rate_rad_s[0, 4], rate, rtol=0, atol=1e-14)


def test_fuel_burnt_takes_a_point_mass_from_the_tank() -> None:
    tank = np.array([0.2, 0.1, -0.1])
    flown = simulate.fly(source(sensors=quiet(), fuel={"specific_impulse_s": 0.5, "tank_position_m": tank.tolist()}), [2])
    force = np.linalg.norm(flight.vehicle().jet_wrench[:, 3:], axis=1)
    # commands issued in the last two cycles burn after the end
    used = float((flown.issued[0, :-2] @ force).sum()) / (0.5 * 9.80665)
    start, end = flight.TRUTH, flown.truth[0, 0]
    assert used > 0.5
    assert end[9] == pytest.approx(22.0 - used, rel=1e-12)
    assert np.allclose(end[9] * end[6:9], 22.0 * start[6:9] - used * tank, rtol=0, atol=1e-12)

    def about_origin(v: Array, mass: float, cg: Array) -> Array:
        inertia: Array = v[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
        return inertia + mass * ((cg @ cg) * np.eye(3) - np.outer(cg, cg))

    gone = about_origin(np.zeros(6), used, tank)
    assert np.allclose(about_origin(end, end[9], end[6:9]), about_origin(start, 22.0, start[6:9]) - gone, rtol=0, atol=1e-11)


def test_fuel_that_would_leave_no_body_is_refused() -> None:
    for fuel in ({"specific_impulse_s": 0.01}, {"specific_impulse_s": 0.5, "tank_position_m": [3.0, 0.0, 0.0]}):
        with pytest.raises(InputError, match=r"small, seed 2: at .* the fuel burnt leaves no body"):
            simulate.fly(source(fuel=fuel), [2])


def test_a_jet_that_pushes_backward_burns_fuel_all_the_same() -> None:
    failures = [{"jet": jet.name, "thrust": -1.0} for jet in flight.vehicle().jets]
    fuel = {"specific_impulse_s": 5.0}
    forward, backward = (simulate.fly(source(fuel=fuel, actuators={"failures": f}), [2]).truth[0, 0, 9] for f in ([], failures))
    assert forward < 22.0 - 0.01
    assert backward == pytest.approx(forward, rel=1e-12)


def test_a_failed_jet_pushes_as_its_factor_says() -> None:
    plan = [{"motion": "steady", "axes": ["x"], "start_cycle": 0, "end_cycle": 40}]
    failure = {"jet": "divert_xp", "thrust": -0.5, "start_s": 1.1, "end_s": 1.6}
    body = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "mass": 20.0}
    changes = {"truth": body, "plan": plan, "duration_cycles": 40, "actuators": {"failures": [failure], "scale": 1.1}}
    felt = simulate.fly(source(sensors=quiet(), **changes), [1]).delta_v_m_s[0, :, 0] / flight.CYCLE
    expected = 1.1 * 2.224 / 20.0 * np.repeat([0.0, 1.0, -0.5, 1.0], [2, 20, 10, 8])  # two cycles late
    assert np.allclose(felt, expected, rtol=0, atol=1e-14)


def test_a_periodic_torque_turns_as_its_integral() -> None:
    body = {"ixx": 2.0, "iyy": 1.0, "izz": 1.0, "mass": 20.0}
    disturbance = {"periodic_n_m": [0.05, 0.0, 0.0], "periodic_s": 3.0}
    flown = simulate.fly(source(sensors=quiet(), truth=body, plan=[], disturbance=disturbance), [1])
    time, around = flight.CYCLE * np.arange(121), 2 * np.pi / 3.0
    closed = 0.05 / 2.0 / around * (1 - np.cos(around * time))
    # constant within a cycle, at its middle's value
    assert np.abs(flown.rate_rad_s[0, :, 0] - closed).max() < (around * flight.CYCLE) ** 2 / 24 * closed.max() * 1.01
    assert closed.max() > 0.02


def test_friction_slows_a_turn_exponentially() -> None:
    body = {"ixx": 2.0, "iyy": 1.0, "izz": 1.0, "mass": 20.0}
    changes = {"truth": body, "plan": [], "initial": {"rate_rad_s": [0.4, 0.0, 0.0]}, "disturbance": {"rate_n_m_s": [0.8, 0.0, 0.0]}}
    rate = simulate.fly(source(sensors=quiet(), **changes), [1]).rate_rad_s[0, :, 0]
    assert np.allclose(rate, 0.4 * np.exp(-0.8 / 2.0 * flight.CYCLE * np.arange(121)), rtol=1e-9, atol=0)
    assert rate[-1] < 0.04


@pytest.mark.thorough
def test_attitude_hold_brings_a_turning_vehicle_back() -> None:
    control = {"rate_gain_n_m_s": [1.0, 5.0, 5.0], "attitude_gain_n_m": [0.6, 3.0, 3.0]}
    changes = {"control": control, "duration_cycles": 400, "plan": [{"motion": "hold", "start_cycle": 0, "end_cycle": 400}]}
    flown = simulate.fly(source(**changes, initial={"rate_rad_s": [0.1, -0.1, 0.05]}), [1, 2])
    attitude = flown.attitude_wxyz * np.sign(flown.attitude_wxyz[..., :1])
    assert np.abs(attitude[:, :, 1:]).max() > 0.02
    assert np.abs(attitude[:, -1, 1:]).max() < 0.004
    assert np.abs(flown.rate_rad_s[:, -1]).max() < 0.005


@pytest.mark.thorough
def test_random_pulses_have_the_lengths_and_signs_that_the_plan_says() -> None:
    plan = [{"motion": "random", "axes": ["y"], "every_cycles": 5, "max_cycles": 4, "start_cycle": 0, "end_cycle": 100}]
    flown = simulate.fly(source(plan=plan, duration_cycles=100), range(200))
    names = [jet.name for jet in flight.vehicle().jets]
    signed = flown.issued[..., names.index("divert_yp")] - flown.issued[..., names.index("divert_yn")]
    blocks = np.round(signed.reshape(200, 20, 5) / flight.CYCLE)
    lengths = np.abs(blocks).sum(-1)
    assert (np.diff(np.abs(blocks), axis=-1) <= 0).all()
    counts = np.array([(lengths == length).sum() for length in range(6)])
    assert counts[0] == counts[5] == 0
    assert ((counts[1:5] - 1000) ** 2 / 1000).sum() < 16.3  # chi-square, 3 degrees of freedom, 1 in 1000
    assert abs((blocks[..., 0] > 0).mean() - 0.5) < 4 * 0.5 / np.sqrt(4000)


def test_a_vehicle_without_jets_takes_a_wrench() -> None:
    used = flight.vehicle(jets=[])
    plan = [
        {"motion": "random", "axes": ["roll", "pitch", "yaw"], "start_cycle": 0, "end_cycle": 120},
        {"motion": "alternating", "axes": ["x", "y", "z"], "every_cycles": 3, "start_cycle": 0, "end_cycle": 120},
    ]
    limits = {"max_torque_n_m": [0.3, 0.5, 0.4], "max_force_n": [2.0, 3.0, 4.0]}
    flown = simulate.fly(source(vehicle=used, plan=plan, actuators=limits, sensors=quiet()), [1])
    assert np.allclose(np.abs(flown.issued[0]).max(0), [0.3, 0.5, 0.4, 2.0, 3.0, 4.0])
    expected = np.roll(flown.issued[0, :, 3:], 2, axis=0)[2:] / 22.0
    centre = simulate.fly(
        source(
            vehicle=flight.vehicle(jets=[], imu={"position_m": flight.TRUTH[6:9].tolist()}), plan=plan, actuators=limits, sensors=quiet()
        ),
        [1],
    )
    assert np.allclose(centre.delta_v_m_s[0, 2:] / flight.CYCLE, expected, rtol=0, atol=1e-12)


SCENARIOS = ("preliminary", "refined", "docking", "testbed", "free-flyer")
SHORT = [f"--set={setting}" for setting in ("duration_s=6.0", PLAN)]


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_packaged_scenario_comes_back_out_of_the_estimator(name: str) -> None:
    recorded = json.loads((SAMPLES / "scenarios" / name / "truth.json").read_text())
    found = analysed(f"scenarios/{name}")
    assert [c.phase.name for c in found.conclusions] == [phase["name"] for phase in recorded["phases"]]
    for conclusion, phase in zip(found.conclusions, recorded["phases"], strict=True):
        for quantity, estimate in conclusion.estimates.items():
            # alternating diverts near the end of "refined" leave its mass too few quiet updates
            assert estimate.verdict == "converged" or (name == "refined" and quantity == "mass")
            assert estimate.value is not None
            assert estimate.sigma is not None
            assert abs(estimate.value - phase[quantity]) < 4.5 * estimate.sigma
    if "docked" in recorded:
        assert found.docked is not None
        for quantity, estimate in found.docked.estimates.items():
            assert abs((estimate.value or 0.0) - recorded["docked"][quantity]) < 4.5 * (estimate.sigma or 0.0)


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_docked_object_that_the_motion_cannot_tell_is_a_missing_value(tmp_path: Path) -> None:
    plan = [
        '{motion="hold", start_s=0.0, end_s=7.0}',
        '{motion="random", axes=["roll", "pitch", "yaw"], closed_loop=true, level=0.6, start_s=7.0, end_s=14.0}',
        '{motion="random", axes=["x", "y", "z"], force_n=0.6, start_s=7.0, end_s=14.0}',
    ]
    short = ["--set=duration_s=14.0", f"--set=plan=[{', '.join(plan)}]"]
    assert CliRunner().invoke(app, ["simulate", "docked-hold", *short, "--out", str(tmp_path)]).exit_code == 0
    command = ["estimate", str(tmp_path / "log.parquet"), "--expect", str(tmp_path / "truth.json"), "--out", str(tmp_path / "result")]
    found = CliRunner().invoke(app, command)
    assert found.exit_code == 5, found.output
    result = json.loads((tmp_path / "result" / "result.json").read_text())
    docked = result["docked_object"]
    assert all(item["value"] is not None for item in result["phases"][1]["estimates"].values())
    assert all(item["value"] is None and not item["expected"]["met"] for item in docked["estimates"].values())


@pytest.mark.parametrize(
    "name", [name if name == "refined" else pytest.param(name, marks=[pytest.mark.thorough, pytest.mark.seeds]) for name in SCENARIOS]
)
def test_sample_logs_are_what_their_command_makes(name: str, tmp_path: Path) -> None:
    assert CliRunner().invoke(app, ["simulate", name, "--seed", "1", "--out", str(tmp_path)]).exit_code == 0
    kept = SAMPLES / "scenarios" / name
    assert (tmp_path / "vehicle.toml").read_text() == (kept / "vehicle.toml").read_text()
    assert json.loads((tmp_path / "truth.json").read_text()) == json.loads((kept / "truth.json").read_text())
    made, stored = (pq.ParquetFile(folder / "log.parquet").read(use_threads=False) for folder in (tmp_path, kept))
    assert made.schema.equals(stored.schema)
    for column in (*columns.DELTA_THETA, *columns.DELTA_V):  # to the last digits, which another numpy may round otherwise
        assert np.allclose(made.column(column).to_numpy(), stored.column(column).to_numpy(), rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_a_campaign_folder_holds_the_same_bytes_as_single_runs(tmp_path: Path) -> None:
    runner = CliRunner()
    assert (
        runner.invoke(app, ["simulate", "free-flyer", *SHORT, "--seeds", "3", "--seed", "8", "--out", str(tmp_path / "all")]).exit_code == 0
    )
    assert runner.invoke(app, ["simulate", "free-flyer", *SHORT, "--seed", "9", "--out", str(tmp_path / "one")]).exit_code == 0
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == ["seed-0008", "seed-0009", "seed-0010"]
    again = runner.invoke(app, ["simulate", "free-flyer", *SHORT, "--seeds", "2", "--seed", "8", "--out", str(tmp_path / "all")])
    assert again.exit_code == 3
    assert "already holds 'seed-0010'" in again.output
    beside = runner.invoke(app, ["simulate", "free-flyer", *SHORT, "--csv", "--out", str(tmp_path / "one")])
    assert beside.exit_code == 3
    assert "another log is in the way" in beside.output
    for name in ("log.parquet", "vehicle.toml", "truth.json"):
        assert (tmp_path / "all" / "seed-0009" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()
