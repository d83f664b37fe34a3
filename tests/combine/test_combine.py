"""Results of one vehicle added up: tested against a least-squares fit of all data at once that shares nothing with the estimator."""

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from pyarrow import csv
from scipy.spatial.transform import Rotation

from massprop_cli import QUANTITIES, flow, job
from massprop_cli.base import escape
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.combine import flow as combine
from massprop_cli.combine.joint import Piece, joint
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.plant import BearingBody, plant_of
from massprop_cli.report.figures import NAMES, WITHOUT_TIME, picture
from massprop_cli.result import schema, store
from massprop_cli.result.read import read
from massprop_cli.testbed import bound, output, scenario, simulate
from tests.campaigns import simulate as fly
from tests.commandline import massprop, succeeded

SAMPLES = Path(__file__).parents[2] / "sample_logs"
PLAN = 'plan=[{motion="random",axes=["roll","pitch","yaw","x","y","z"],start_s=0.0,end_s=20.0}]'
PULSES = """{{motion="random",axes=["roll","pitch","yaw"],closed_loop=true,start_cycle={0},end_cycle={1}}},
{{motion="random",axes=["x","y","z"],start_cycle={0},end_cycle={1}}}"""
DOCKING = (
    "duration_cycles=640",
    f"plan=[{PULSES.format(0, 180)},{{motion='hold',start_cycle=180,end_cycle=240}},{PULSES.format(240, 640)}]",
    'events=[{kind="dock",cycle=180,motion="rates_kept"},{kind="reset",cycle=240,phase="combined"}]',
)


def in_halves(start: int, end: int) -> tuple[tuple[int, int], ...]:
    return ((start, (start + end) // 2), ((start + end) // 2, end))


BODY = scenario.load("free-flyer").scenario.truth.values


def at_once(
    source: scenario.ScenarioSource,
    flight: simulate.SimulatedFlight,
    quiet: simulate.SimulatedFlight,
    body: Array,
    pieces: Sequence[tuple[int, int]],
) -> tuple[Array, Array]:
    """Values and covariance of the linear fit, about the truth, of all pieces: ten quantities, and the rate at each piece's start.

    ``quiet`` is the flight without noise.
    """
    noise = np.concatenate([flight.delta_theta_rad - quiet.delta_theta_rad, flight.delta_v_m_s - quiet.delta_v_m_s], -1)[0]
    vehicle = flight.vehicle
    noise /= np.repeat([vehicle.imu.gyro_noise_rad_s or 0.0, vehicle.imu.accel_noise_m_s2 or 0.0], 3) * vehicle.cycle.period_s
    columns, left = [], []
    for number, (begin, end) in enumerate(pieces):
        # each piece begins with the first cycle whose command it holds
        start = begin + int(float(vehicle.cycle.command_delay_cycles))
        slopes = bound.sensitivities(source, flight.seeds[:1], flight.issued[:1], body[None], start, np.zeros((0, 4)))[0, :, start:end]
        own = np.zeros((10 + 3 * len(pieces), *slopes.shape[1:]))
        own[:10], own[10 + 3 * number : 13 + 3 * number] = slopes[:10], slopes[10:]
        columns.append(own.reshape(len(own), -1).T)
        left.append(noise[start:end].ravel())
    rows = np.concatenate(columns)
    size = np.sqrt((rows**2).sum(0))
    basis, triangle = np.linalg.qr(rows / size)
    step = np.linalg.solve(triangle, basis.T @ np.concatenate(left))
    root = np.linalg.inv(triangle) / size[:, None]
    return body + (step / size)[:10], (root @ root.T)[:10, :10]


def levelled(flight: simulate.SimulatedFlight, cycle: int) -> Vehicle:
    """The vehicle without its phases, on a bearing so tilted that its gyro leads to the true attitude where the other fit begins."""
    stated = flight.vehicle.model_copy(update={"phases": (), "docking": None})
    if not stated.on_air_bearing:
        return stated
    start = cycle + int(float(stated.cycle.command_delay_cycles))
    tilt = Rotation.from_quat(flight.attitude_wxyz[0, start], scalar_first=True)
    for turned in flight.delta_theta_rad[0, cycle:start][::-1] @ np.array(stated.imu.body_from_imu).T:
        tilt = tilt * Rotation.from_rotvec(-turned)
    attitude = tuple(tilt.as_quat(scalar_first=True).tolist())
    return stated.model_copy(update={"environment": stated.environment.model_copy(update={"initial_attitude_wxyz": attitude})})


@pytest.mark.parametrize(
    ("name", "keys", "phases", "seed"),
    [
        ("free-flyer", ("duration_s=10.0", PLAN), (in_halves(0, 200),), 1),
        *(
            pytest.param(*one, marks=[pytest.mark.thorough, pytest.mark.seeds])
            for one in (
                ("testbed", ("duration_s=20.0", f"plan=[{PULSES.format(0, 400)}]"), (in_halves(0, 400),), 1),
                ("docking", DOCKING, (in_halves(0, 180), in_halves(240, 640)), 1),
            )
        ),
    ],
)
def test_pieces_of_a_log_give_what_all_their_data_give_at_once(
    name: str, keys: Sequence[str], phases: Sequence[Sequence[tuple[int, int]]], seed: int
) -> None:
    source = scenario.load(name, keys)
    flight = simulate.fly(source, [seed])
    quiet = simulate.fly(bound.noise_free(source), [seed], issued=flight.issued[0])
    log = flight.log(0)
    for body, pieces in zip(flight.truth[0], phases, strict=True):
        found = []
        for begin, end in pieces:
            vehicle = levelled(flight, begin)
            alone = flow.examine(log.part(begin, end), VehicleSource(vehicle, "x", "")).conclusions[0]
            plant = plant_of(vehicle)
            bearing = plant if isinstance(plant, BearingBody) else None
            found.append(Piece(alone.values, alone.covariance, {}, bearing=bearing))
        together = joint(found)
        values, covariance = at_once(source, flight, quiet, body, pieces)
        sigma = np.sqrt(np.diag(covariance))
        assert np.abs((together.values - values) / sigma).max() < 0.1
        np.testing.assert_allclose(np.sqrt(np.diag(together.covariance)), sigma, rtol=0.03)
        assert together.freedom == 10
        assert together.chi_square < 35


def gaussians(seed: int, count: int) -> tuple[list[Array], list[Array]]:
    """Linear data on the ten quantities, near the truth: rows and measurements of each piece."""
    rng = np.random.default_rng(seed)
    size = 1e-4 * bound.natural_sizes(BODY)
    rows = [rng.standard_normal((25, 10)) / size for _ in range(count)]
    return rows, [r @ BODY + rng.standard_normal(25) for r in rows]


def solved(rows: Array, data: Array) -> tuple[Array, Array]:
    covariance = np.linalg.inv(rows.T @ rows)
    return covariance @ rows.T @ data, covariance


def test_what_is_shared_counts_once() -> None:
    """Oracle: one least-squares problem with the thrust's scale as an eleventh unknown, and the weighed mass as a row."""
    rows, data = gaussians(1, 3)
    scale, weighed, sigma = 0.02, 22.05, 0.01
    pieces = []
    for r, d in zip(rows, data, strict=True):
        values, covariance = solved(r, d)
        scaled = np.concatenate([values[:6], np.zeros(3), values[9:]])
        covariance = covariance + scale**2 * np.outer(scaled, scaled)
        gain = covariance[:, 9] / (covariance[9, 9] + sigma**2)
        values, covariance = values + gain * (weighed - values[9]), covariance - np.outer(gain, covariance[9])
        pieces.append(Piece(values, covariance, {"mass": (weighed, sigma)}, scale))
    found = joint(pieces)
    bare, spread = solved(np.concatenate(rows), np.concatenate(data))
    scaled = np.concatenate([bare[:6], np.zeros(3), bare[9:]])
    # unknowns: what the logs see, and kappa; quantities are (1 + kappa) times it, so measure mass = m + m kappa
    prior = np.zeros((11, 11))
    prior[:10, :10], prior[10, 10] = spread, scale**2
    slope = np.append(np.zeros(9), [1.0, bare[9]])
    gain = prior @ slope / (slope @ prior @ slope + sigma**2)
    mean = np.append(bare, 0.0) + gain * (weighed - bare[9])
    left = prior - np.outer(gain, slope @ prior)
    to_quantities = np.hstack([np.eye(10), scaled[:, None]])
    expected = to_quantities @ left @ to_quantities.T
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), np.sqrt(np.diag(expected)), rtol=2e-3)
    wanted = bare + to_quantities @ (mean - np.append(bare, 0.0))
    assert np.abs((found.values - wanted) / np.sqrt(np.diag(expected))).max() < 0.02
    assert np.sqrt(found.covariance[9, 9]) < sigma


def estimated(log: Path, out: Path, *assignments: str) -> None:
    """What ``massprop estimate`` writes, without a process for it."""
    found = job.of_file(log, assignments=assignments)
    store.write(out, found.analysis, escape.document(found.result))


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_thrust_scale_common_to_logs_on_a_bearing_enters_once(tmp_path: Path) -> None:
    """Oracle: what the joint values do if every jet pushes half a per cent more or less, beside their sigmas at exact thrust."""
    output.simulate(scenario.load("testbed", ("duration_s=10.0", f"plan=[{PULSES.format(0, 200)}]")), tmp_path / "logs", 1, 2)

    def combined(name: str, *settings: str) -> tuple[Array, Array]:
        folders = [tmp_path / f"{name}-{seed}" for seed in (1, 2)]
        for seed, folder in zip((1, 2), folders, strict=True):
            estimated(tmp_path / "logs" / f"seed-000{seed}" / "log.parquet", folder, *settings)
        (phase,) = combine.together(list(map(read, folders))).phases
        assert {item.verdict for item in phase.estimates.values()} == {"converged"}
        assert phase.covariance is not None
        return np.array([item.value for item in phase.estimates.values()]), np.array(phase.covariance)

    vehicle = tomllib.loads((tmp_path / "logs" / "seed-0001" / "vehicle.toml").read_text())
    plain, covariance = combined("exact")
    by = 0.005
    pushed = []
    for name, factor in (("more", 1 + by), ("less", 1 - by)):
        jets = [jet | {"force_n": [factor * one for one in jet["force_n"]]} for jet in vehicle["jets"]]
        pushed.append(combined(name, f"jets={json.dumps(jets)}".replace('": ', '" = '))[0])
    slope = (pushed[0] - pushed[1]) / (2 * by)
    values, wide = combined("scaled", "thrust.scale_sigma=0.02")
    np.testing.assert_allclose((values - plain) / np.sqrt(np.diag(wide)), 0.0, atol=0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(wide)), np.sqrt(np.diag(covariance) + (0.02 * slope) ** 2), rtol=0.01)


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_cg_is_combined_where_nothing_tells_the_mass(tmp_path: Path) -> None:
    """Gyros alone turn the vehicle: the CG is told by the rotation that the accelerometer feels; it had been called not excited."""
    settings = ("duration_s=40", 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0, end_s=40}]')
    output.simulate(scenario.load("control-moment-gyros", settings), tmp_path / "logs", 1, 2)
    folders = [tmp_path / f"run-{seed}" for seed in (1, 2)]
    for seed, folder in zip((1, 2), folders, strict=True):
        estimated(tmp_path / "logs" / f"seed-000{seed}" / "log.parquet", folder)
    each = list(map(read, folders))
    (phase,) = combine.together(each).phases
    for name in ("cg_x", "cg_y", "cg_z"):
        own = [one.result.phases[0].estimates[name] for one in each]
        assert {one.verdict for one in own} <= {"converged", "not_converged"}
        assert phase.estimates[name].verdict in {one.verdict for one in own}
        assert (phase.estimates[name].sigma or 1.0) < min(one.sigma or 0.0 for one in own)


def test_what_makes_one_log_doubt_the_thrust_holds_for_all() -> None:
    rows, data = gaussians(2, 2)
    (one, sharp), (other, blunt) = solved(rows[0], data[0]), solved(rows[1], data[1])
    proportional = np.concatenate([one[:6], np.zeros(3), one[9:]])
    exact = joint([Piece(one, sharp, {}), Piece(other, blunt, {})])
    wary = joint([Piece(one, sharp + 0.02**2 * np.outer(proportional, proportional), {}, 0.02), Piece(other, blunt, {})])
    np.testing.assert_allclose(wary.values, exact.values, rtol=1e-9)
    scaled = np.concatenate([exact.values[:6], np.zeros(3), exact.values[9:]])
    np.testing.assert_allclose(wary.covariance, exact.covariance + 0.02**2 * np.outer(scaled, scaled), rtol=1e-6, atol=1e-12)


def test_what_a_piece_does_not_tell_is_left_to_the_others() -> None:
    rows, data = gaussians(2, 2)
    whole, half = solved(rows[0], data[0]), solved(rows[1], data[1])
    untold = half[0].copy()
    untold[9] = np.nan
    covariance = half[1].copy()
    covariance[9], covariance[:, 9] = np.nan, np.nan
    found = joint([Piece(*whole, {}), Piece(untold, covariance, {})])
    marginal = np.zeros((10, 10))
    marginal[:9, :9] = np.linalg.inv(half[1][:9, :9])
    information = np.linalg.inv(whole[1]) + marginal
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), np.sqrt(np.diag(np.linalg.inv(information))), rtol=2e-3)
    assert np.isnan(found.deviates[1][9])
    alone = joint([Piece(untold, covariance, {}), Piece(untold, covariance, {})])
    assert np.isnan(alone.values[9])
    assert np.isfinite(alone.values[:9]).all()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("combine")
    fly(found / "flights", 2)
    fly(found / "other", 1, "truth.mass=24.0", "truth.ixx=0.7", first=3)
    for name, log in (("a", "flights/seed-0001"), ("b", "flights/seed-0002"), ("c", "other/seed-0003")):
        estimated(found / log / "log.parquet", found / name)
    flight = found / "flights" / "seed-0001"
    csv.write_csv(pq.read_table(flight / "log.parquet"), found / "log.csv")
    succeeded(found, "estimate", "log.csv", "--vehicle", flight / "vehicle.toml", "--out", "as-csv", "-q")
    return found


def test_two_logs_tell_more_than_one_and_their_result_is_a_result(folder: Path) -> None:
    done = succeeded(folder, "combine", "a", "b", "--out", "both", "--require", "ixx<1%", "--json")
    told = schema.Result.model_validate(json.loads(done.stdout))
    one = [json.loads((folder / name / "result.json").read_text())["phases"][0]["estimates"] for name in "ab"]
    truth = dict(zip(QUANTITIES, BODY, strict=True))
    for name, item in told.phases[0].estimates.items():
        sigmas = [each[name]["sigma"] for each in one]
        assert item.value is not None
        assert item.sigma is not None
        assert 0.4 * min(sigmas) < item.sigma < min(sigmas)
        assert abs(item.value - truth[name]) < 4.5 * item.sigma
    assert told.warnings == []
    succeeded(folder, "report", "both", "--format", "md,csv")
    assert massprop(folder, "compare", "both", "a").returncode == 0
    short = massprop(folder, "combine", "a", "b", "--out", "both", "-q", "--require", "mass<0.1%")
    assert short.returncode == 4
    assert "mass<0.1% requires" in short.stderr


@pytest.mark.thorough
def test_a_joint_result_is_drawn_as_far_as_it_goes_without_time(folder: Path) -> None:
    assert massprop(folder, "combine", "a", "b", "--out", "drawn", "-q").returncode == 0
    succeeded(folder, "report", "drawn", "--figure", "all", "--format", "svg,md", "-q")
    assert sorted(file.stem for file in (folder / "drawn").glob("*.svg")) == sorted(WITHOUT_TIME)
    assert (folder / "drawn" / "report.md").exists()
    recorded = read(folder / "drawn")
    for name in set(NAMES) - set(WITHOUT_TIME):
        with pytest.raises(InputError, match="combines several logs and has no history; draw figures against time from"):
            picture(name, recorded)


def test_logs_of_two_bodies_contradict_each_other(folder: Path) -> None:
    done = massprop(folder, "combine", "a", "b", "c", "--out", "three")
    assert done.returncode == 6
    assert "c differs from the joint estimate of the others: ixx by " in done.stderr
    assert "was it the same vehicle in the same state? Without it all others agree." in " ".join(done.stderr.split())
    assert "a differs from the joint" not in done.stderr
    told = json.loads((folder / "three" / "result.json").read_text())
    assert told["phases"][0]["estimates"]["ixx"]["verdict"] == "contradicted"
    assert told["warnings"][0]["code"] == "results-disagree"


@pytest.fixture(scope="module")
def bearings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One vehicle on a bearing of 5 kg and on one of 9 kg, whose result is there once more with 5 kg stated."""
    found = tmp_path_factory.mktemp("bearings")
    for name, mass in (("light", 5.0), ("heavy", 9.0)):
        keys = ["duration_s=10.0", f"plan=[{PULSES.format(0, 200)}]", f"vehicle.environment.bearing_mass_kg={mass}"]
        output.simulate(scenario.load("testbed", keys), found / f"log-{name}", int(mass), None)
        estimated(found / f"log-{name}" / "log.parquet", found / name)
    estimated(found / "log-heavy" / "log.parquet", found / "misstated", "environment.bearing_mass_kg=5")
    return found


@pytest.mark.parametrize("arguments", [("light", "heavy"), ("--before", "light", "--before", "heavy", "--after", "misstated")])
def test_results_on_bearings_of_different_mass_are_refused(arguments: tuple[str, ...], bearings: Path) -> None:
    done = massprop(bearings, "combine", *arguments, "--out", "joint")
    assert done.returncode == 3
    assert "heavy/result.json: bearing mass [kg] is 9.0, and 5.0 in light/result.json; the results are not of one vehicle." in done.stderr
    assert not (bearings / "joint").exists()


def test_a_bearing_of_another_mass_than_stated_contradicts_all_that_it_pulls_along(bearings: Path) -> None:
    """The first moment is hundreds of sigma off, and the mass that makes the best of it is a tenth: no value may look good."""
    done = massprop(bearings, "combine", "light", "misstated", "--out", "both")
    assert done.returncode == 6
    assert "misstated differs from the joint estimate of the others: cg_x by " in done.stderr
    assert "away from it; was it the same vehicle in the same state?" in done.stderr
    told = json.loads((bearings / "both" / "result.json").read_text())["phases"][0]
    truth = dict(zip(QUANTITIES, scenario.load("testbed").scenario.truth.values, strict=True))
    assert abs(told["estimates"]["mass"]["value"] - truth["mass"]) > 4 * told["estimates"]["mass"]["sigma"]
    for name, item in told["estimates"].items():
        if item["verdict"] == "converged":
            assert abs(item["value"] - truth[name]) < 4 * item["sigma"]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["a"], 2, "name two results or more"),
        (["a", "--before", "b"], 2, "name results alone, or those --before and those --after"),
        (["--before", "a"], 2, "name results alone"),
        (["a", "a"], 3, "a/result.json: is named twice; its information would count twice. Name it once"),
        (["a", "b", "a/result.json"], 3, "a/result.json: is named twice"),
        (["a", "copy"], 3, "copy/result.json: is of the same log as a/result.json; its information would count twice. Name it once"),
        (["a", "joint"], 3, "joint/result.json: shares a log with a/result.json"),
        (["joint", "other"], 3, "other/result.json: shares a log with joint/result.json"),
        (["a", "as-csv"], 3, "as-csv/result.json: all values and sigmas are those of a/result.json: the same recording in another file"),
        (["--before", "a", "--after", "a"], 3, "phase all of the same log is on both sides of docking"),
        (["--before", "a", "--before", "a", "--after", "b"], 3, "is named twice"),
        (["a", "renamed"], 3, "vehicle is 'another', and 'free flyer' in"),
        (["a", "turned"], 3, "conventions.products_of_inertia"),
        (["a", "borne"], 3, "environment is 'air_bearing', and 'free' in"),
        (["a", "phased"], 3, "has phases first, and"),
        (["a", "scaled"], 3, "thrust.scale_sigma is 0.01, and 0.0 in"),
        (["a", "thesis"], 3, "made with --method thesis, whose sigmas are not errors"),
        (["a", "nowhere"], 3, "nowhere"),
        (["a", "b", "--out", "a"], 3, "holds the result of a log, with its history"),
    ],
)
def test_what_does_not_belong_together_is_refused(arguments: list[str], code: int, said: str, odd: Path) -> None:
    done = massprop(odd, "combine", *arguments)
    assert (done.returncode, done.stdout) == (code, "")
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr


@pytest.fixture(scope="module")
def odd(folder: Path) -> Path:
    """Beside the results of three logs: what combine makes of them, and what does not belong with them."""
    told = json.loads((folder / "b" / "result.json").read_text())
    changed = {
        "copy": json.loads((folder / "a" / "result.json").read_text()),
        "renamed": told | {"vehicle": told["vehicle"] | {"name": "another"}},
        "turned": told | {"conventions": told["conventions"] | {"products_of_inertia": "positive_integral"}},
        "borne": told | {"vehicle": told["vehicle"] | {"environment": "air_bearing"}},
        "phased": told | {"phases": [told["phases"][0] | {"name": "first"}]},
        "scaled": told | {"vehicle": told["vehicle"] | {"thrust_scale_sigma": 0.01}},
        "thesis": told | {"provenance": told["provenance"] | {"settings": {"estimator.method": "thesis"}}},
    }
    for name, members, code in (("joint", "ab", 0), ("other", "bc", 6)):
        assert massprop(folder, "combine", *members, "--out", name, "-q").returncode == code
    for name, content in changed.items():
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "result.json").write_text(json.dumps(content))
    return folder
