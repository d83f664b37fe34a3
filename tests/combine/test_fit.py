"""Logs that each drive some axes alone, fitted at once, against a least-squares fit of all data that shares nothing with the estimator."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import QUANTITIES, job
from massprop_cli.base import escape
from massprop_cli.base.arrays import Array
from massprop_cli.combine import flow
from massprop_cli.result import schema, store
from massprop_cli.result.read import read
from massprop_cli.result.schema import Result
from massprop_cli.testbed import bound, output, scenario, simulate
from tests.flown import fly

AXES = {"roll": "roll", "pitch": "pitch", "yaw": "yaw", "pushes": "x y z"}
SECONDS = 6.0


def driven(axes: str, *more: str) -> tuple[str, ...]:
    named = ", ".join(f'"{axis}"' for axis in axes.split())
    pulses = f'plan=[{{motion="random", axes=[{named}], start_s=0.0, end_s={SECONDS}}}]'
    return (f"duration_s={SECONDS}", pulses, *more)


def estimated(name: str, settings: tuple[str, ...], seed: int, folder: Path, *stated: str) -> None:
    """Log and result in a folder, with what is stated otherwise."""
    output.write(fly(name, *settings, seeds=(seed,)), 0, scenario.load(name, settings).scenario, folder / "log", "parquet")
    judged = job.of_file(folder / "log" / "log.parquet", assignments=stated)
    store.write(folder / "result", judged.analysis, escape.document(judged.result))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("fit")
    for name in ("free-flyer", "testbed"):
        for seed, (part, axes) in enumerate(AXES.items(), 1):
            estimated(name, driven(axes), seed, found / name / part)
    estimated("free-flyer", driven("roll", "truth.ixx=0.61"), 9, found / "other")
    return found


def at_once(name: str, seeds: Sequence[tuple[int, str]]) -> tuple[Array, Array]:
    """Values and covariance of the linear fit about the truth: the ten quantities, and the rate at the start of each log."""
    source = scenario.load(name, driven("roll"))  # whose plan counts for nothing: commands are those that were issued
    flights = [fly(name, *driven(axes), seeds=(seed,)) for seed, axes in seeds]
    numbers, issued, truth = (
        [seed for seed, _ in seeds],
        *(np.concatenate([getattr(one, key) for one in flights]) for key in ("issued", "truth")),
    )
    quiet = simulate.fly(bound.noise_free(source), numbers, issued=issued)
    # the first cycle whose command is known is the third
    slopes = bound.sensitivities(source, numbers, issued, truth[:, 0], 2, np.zeros((0, 4)))[:, :, 2:]
    columns, left = [], []
    for member, (flight, changes) in enumerate(zip(flights, slopes, strict=True)):
        noise = np.concatenate(
            [flight.delta_theta_rad[0] - quiet.delta_theta_rad[member], flight.delta_v_m_s[0] - quiet.delta_v_m_s[member]], -1
        )
        noise /= np.repeat([1e-4, 0.02], 3) * source.scenario.vehicle.cycle.period_s
        own = np.zeros((10 + 3 * len(seeds), *changes.shape[1:]))
        own[:10], own[10 + 3 * member : 13 + 3 * member] = changes[:10], changes[10:]
        columns.append(own.reshape(len(own), -1).T)
        left.append(noise[2:].ravel())
    rows = np.concatenate(columns)
    size = np.sqrt((rows**2).sum(0))
    basis, triangle = np.linalg.qr(rows / size)
    step = np.linalg.solve(triangle, basis.T @ np.concatenate(left))
    root = np.linalg.inv(triangle) / size[:, None]
    return truth[0, 0] + (step / size)[:10], (root @ root.T)[:10, :10]


def numbers(found: Result) -> tuple[Array, Array]:
    items = found.phases[0].estimates.values()
    return np.array([item.value for item in items], dtype=float), np.array([item.sigma for item in items], dtype=float)


@pytest.mark.parametrize(("name", "within"), [("free-flyer", 0.1), pytest.param("testbed", 0.3, marks=pytest.mark.thorough)])
def test_logs_of_one_axis_each_give_together_what_all_their_data_give(name: str, within: float, place: Path) -> None:
    """On the bearing the estimator takes the vertical from its gyro, which the other fit knows."""
    found = flow.together(list(map(read, [place / name / part / "result" for part in AXES])))
    values, sigma = numbers(found)
    wanted, covariance = at_once(name, list(enumerate(AXES.values(), 1)))
    expected = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(sigma, expected, rtol=0.05)
    assert np.abs((values - wanted) / expected).max() < within
    assert {item.verdict for name, item in found.phases[0].estimates.items() if name != "mass"} == {"converged"}
    assert found.warnings == []
    alone = [numbers(schema.Result.model_validate_json((place / name / part / "result/result.json").read_text()))[0] for part in AXES]
    assert all(np.isnan(one).any() for one in alone), "no log has an estimate of all by itself"


@pytest.mark.parametrize(("sigma_m", "verdicts"), [(0.002, {"converged"}), (0.0, {"contradicted"})])
def test_a_jet_that_sits_elsewhere_is_found_by_all_logs_together(sigma_m: float, verdicts: set[str], tmp_path: Path) -> None:
    """By as much as its place is uncertain, which is one unknown for all logs; as certain, the logs contradict one another."""
    for seed, (part, axes) in enumerate(AXES.items(), 1):
        stated = "jets.0.position_m=[0.002, 0.1475, 0.0]", f"jets.0.position_sigma_m={sigma_m}"
        estimated("free-flyer", driven(axes), seed, tmp_path / part, *stated)
    found = flow.together([read(tmp_path / part / "result") for part in AXES])
    assert {item.verdict for name, item in found.phases[0].estimates.items() if name != "mass"} == verdicts
    if sigma_m:
        values, sigma = numbers(found)
        assert np.abs((values - fly("free-flyer", *driven("roll"), seeds=(1,)).truth[0, 0]) / sigma).max() < 4
        assert found.warnings == []


def test_without_their_logs_results_of_some_axes_add_nothing_to_the_inertia(place: Path, tmp_path: Path) -> None:
    for part in ("roll", "pushes"):
        shutil.copytree(place / "free-flyer" / part / "result", tmp_path / part)
        told = json.loads((tmp_path / part / "run.json").read_text())
        (tmp_path / part / "run.json").write_text(json.dumps(told | {"log": str(tmp_path / "gone.parquet")}))
    found = flow.together(list(map(read, [tmp_path / "roll", tmp_path / "pushes"])))
    (warning,) = [one for one in found.warnings if one.code == "result-partial"]
    assert "roll, pushes informs only some axes" in warning.message
    assert "gone.parquet: no such file; combine needs the log of the result" in warning.message
    values, _ = numbers(found)
    assert np.isnan(values[:6]).all()
    pushes, sigma = numbers(schema.Result.model_validate_json((tmp_path / "pushes" / "result.json").read_text()))
    assert abs(values[9] - pushes[9]) < sigma[9]


def test_a_log_that_has_changed_since_is_not_taken_for_what_it_was(place: Path, tmp_path: Path) -> None:
    shutil.copytree(place / "free-flyer" / "roll", tmp_path / "roll")
    shutil.copy(place / "free-flyer" / "yaw" / "log" / "log.parquet", tmp_path / "roll" / "log" / "log.parquet")
    told = json.loads((tmp_path / "roll" / "result" / "run.json").read_text())
    run = told | {"log": str(tmp_path / "roll" / "log" / "log.parquet")}
    (tmp_path / "roll" / "result" / "run.json").write_text(json.dumps(run))
    found = flow.together(list(map(read, [tmp_path / "roll" / "result", place / "free-flyer" / "pushes" / "result"])))
    assert "changed after the result was made" in found.warnings[0].message


def test_a_log_of_another_body_is_named(place: Path) -> None:
    parts = [place / "free-flyer" / part / "result" for part in ("roll", "pitch", "yaw", "pushes")]
    found = flow.together(list(map(read, [*parts, place / "other" / "result"])))
    said = [one.message for one in found.warnings if one.code == "results-disagree"]
    assert any("other/result does not fit the joint body of the others" in one for one in said)
    assert found.phases[0].estimates["ixx"].verdict == "contradicted"


@pytest.mark.thorough
def test_what_is_shared_by_the_logs_counts_once(place: Path, tmp_path: Path) -> None:
    """The thrust's scale moves mass and inertia of all logs alike: it stays in full, and a weighed mass takes it out."""
    for part in AXES:
        shutil.copytree(place / "testbed" / part / "log", tmp_path / part / "log")
        vehicle = tmp_path / part / "log" / "vehicle.toml"
        text = vehicle.read_text() + "\n[thrust]\nscale_sigma = 0.02\n\n[known]\nmass = { value = 25.0, sigma = 0.01 }\n"
        vehicle.write_text(text)
        judged = job.of_file(tmp_path / part / "log" / "log.parquet", vehicle)
        store.write(tmp_path / part / "result", judged.analysis, escape.document(judged.result))
    values, sigma = numbers(flow.together(list(map(read, [tmp_path / part / "result" for part in AXES]))))
    bare, own = numbers(flow.together(list(map(read, [place / "testbed" / part / "result" for part in AXES]))))
    assert sigma[9] == pytest.approx(0.01, rel=0.01)
    assert abs(values[9] - 25.0) < 0.001
    # inertia per mass is what the logs tell beside the mass, and the weighed mass brings the scale
    gain = 1 + (25.0 - bare[9]) / bare[9] * (0.02 * bare[9]) ** 2 / ((0.02 * bare[9]) ** 2 + own[9] ** 2)
    assert values[0] / bare[0] == pytest.approx(gain, abs=2e-4)
    assert dict(zip(QUANTITIES, sigma, strict=True))["ixx"] < 0.02 * values[0]
