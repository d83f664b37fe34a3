"""Values about a pivot are compared, tested against expectations and in a campaign's tables like the ten quantities."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from massprop_cli import ABOUT_PIVOT, PIVOT, PIVOT_UNITS, QUANTITIES, estimate_log
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.campaign import kept, markdown
from massprop_cli.campaign.summary import Summary
from massprop_cli.estimate.pivot import about_pivot
from massprop_cli.inputs.require import precise
from massprop_cli.report import vocabulary
from massprop_cli.result.schema import EstimateItem, PhaseItem
from tests import flight, recorded
from tests.commandline import massprop
from tests.recording import SAMPLES
from tests.report.page import Page

SHORT = ("--set", "duration_s=20", "--set", 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0, end_s=20}]')


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table's log, its truth, its result, and another seed's result."""
    place = tmp_path_factory.mktemp("pivot")
    for seed in ("1", "2"):
        assert massprop(place, "simulate", "pedestal", "--out", f"log-{seed}", "--seed", seed, "-q", *SHORT).returncode == 0
        massprop(place, "estimate", f"log-{seed}/log.parquet", "--out", f"run-{seed}", "--expect", f"log-{seed}/truth.json", "-q")
    return place


def test_a_truth_is_that_of_the_motion_about_the_pivot(folder: Path) -> None:
    """Nine values, each tested against the estimate."""
    truth = json.loads((folder / "log-1" / "truth.json").read_text())["phases"][0]
    assert tuple(truth["about_pivot"]) == ABOUT_PIVOT
    result = json.loads((folder / "run-1" / "result.json").read_text())["phases"][0]["about_pivot"]
    assert all(abs(result[name]["value"] - truth["about_pivot"][name]) < 4.5 * result[name]["sigma"] for name in ABOUT_PIVOT)
    assert {name: item["expected"]["met"] for name, item in result.items()} == dict.fromkeys(ABOUT_PIVOT, True)


def test_what_moves_without_turning_has_no_part_in_it() -> None:
    """A bearing that carries 5 of 25 kg."""
    sample = SAMPLES / "scenarios" / "testbed"
    found = estimate_log(sample / "log.parquet", expected=sample / "truth.json")
    about = found.result.phases[0].about_pivot
    assert {name: item.expected.met for name, item in about.items() if item.expected} == dict.fromkeys(ABOUT_PIVOT, True)


@pytest.mark.thorough
def test_a_corrected_estimate_is_about_the_pivot_too(folder: Path) -> None:
    """A wheel that is stated to be lighter is named, and the moments of inertia about the pivot are those of the motion again."""
    vehicle = (folder / "log-1" / "vehicle.toml").read_text()
    stated = re.search(r"^spin_inertia_kg_m2 = (\S+)$", vehicle, re.MULTILINE)
    assert stated is not None
    lighter = vehicle.replace(stated[0], f"spin_inertia_kg_m2 = {0.9 * float(stated[1])}", 1)
    (folder / "lighter.toml").write_text(lighter)
    done = massprop(folder, "estimate", "log-1/log.parquet", "--vehicle", "lighter.toml", "--out", "lighter")
    assert done.returncode == 6, done.stderr
    truth = json.loads((folder / "log-1" / "truth.json").read_text())["phases"][0]["about_pivot"]
    (mended,) = json.loads((folder / "lighter" / "result.json").read_text())["mended"]
    found = mended["phases"][0]["about_pivot"]
    assert all(abs(found[name]["value"] - truth[name]) < 4.5 * found[name]["sigma"] for name in ABOUT_PIVOT)
    assert "moment_z about the pivot" in done.stdout


def test_an_expectation_of_the_moment_that_is_not_met_is_named(folder: Path) -> None:
    moment = json.loads((folder / "run-1" / "result.json").read_text())["phases"][0]["about_pivot"]["moment_z"]
    (folder / "expect.toml").write_text(f'[all.about_pivot]\nmoment_z = {{ value = {moment["value"] + 1e-3}, tolerance = "2e-4 kg m" }}\n')
    done = massprop(folder, "estimate", "log-1/log.parquet", "--out", "held", "--expect", "expect.toml", "-q")
    assert done.returncode == 5
    assert "about_pivot.moment_z in phase all: expected" in done.stderr
    assert "± 0.0002 kg m" in done.stderr


def test_two_results_are_compared_about_the_pivot(folder: Path) -> None:
    found = json.loads(massprop(folder, "compare", "run-1", "run-2", "--json").stdout)
    differences = found["parts"][0]["differences"]
    assert found["compared"] == 19
    assert all(abs(differences[f"about_pivot.{name}"]["sigmas"]) < 4.5 for name in ABOUT_PIVOT)
    (folder / "tolerance.toml").write_text('[all.about_pivot]\nmoment_x = "0 kg m"\n')
    done = massprop(folder, "compare", "run-1", "run-2", "--tolerance", "tolerance.toml")
    assert done.returncode == 5
    assert "about_pivot.moment_x in phase all" in done.stderr


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_campaigns_tables_have_values_about_the_pivot(folder: Path) -> None:
    massprop(folder, "batch", "log-1/log.parquet", "log-2/log.parquet", "--out", "batch", "--jobs", "1", "-q")
    rows = list(csv.DictReader((folder / "batch" / "campaign.csv").read_text(encoding="utf-8").splitlines()))
    result = json.loads((folder / "run-1" / "result.json").read_text())["phases"][0]["about_pivot"]
    assert float(rows[0]["pivot_moment_x_kg_m"]) == pytest.approx(result["moment_x"]["value"], rel=1e-9)
    assert rows[1]["pivot_izz_verdict"] == "converged"
    table = pq.read_table(folder / "batch" / "campaign.parquet")
    assert table["pivot_izz"].to_pylist()[0] == pytest.approx(result["izz"]["value"], rel=1e-9)
    (pool,) = json.loads((folder / "batch" / "campaign.json").read_text())["pooled"]
    values, sigmas = ([row[f"pivot_izz{key}_kg_m2"] for row in rows] for key in ("", "_sigma"))
    weight = np.array(sigmas, dtype=float) ** -2
    assert tuple(pool["about_pivot"]) == ABOUT_PIVOT
    assert pool["about_pivot"]["izz"]["value"] == pytest.approx(weight @ np.array(values, dtype=float) / weight.sum(), rel=1e-9)
    assert pool["about_pivot"]["izz"]["sigma"] < min(map(float, sigmas))
    page = Page((folder / "batch" / "campaign.html").read_text(encoding="utf-8")).said()
    assert "Moment z about pivot" in page
    assert found_in_summary(folder / "batch") >= set(ABOUT_PIVOT)


def found_in_summary(out: Path) -> set[str]:
    """Quantities about the pivot that a job's summary has rows of."""
    written = Summary.model_validate_json((out / "campaign.json").read_text(encoding="utf-8"))
    text = markdown.text(written, 100_000).replace("\\", "")
    return {name for name in ABOUT_PIVOT if f"| {vocabulary.SYMBOLS[f'{PIVOT}{name}']} |" in text}


@pytest.mark.thorough
@pytest.mark.seeds
def test_values_about_the_pivot_may_be_required(folder: Path) -> None:
    """Without a known mass none of the ten is observable, and a contradiction is one of the nine alone."""
    vehicle = (folder / "log-1" / "vehicle.toml").read_text()
    (folder / "unweighed.toml").write_text(re.sub(r"\[known\.mass\]\nvalue.*\nsigma.*\n", "", vehicle))
    estimate = ("estimate", "log-1/log.parquet", "--vehicle", "unweighed.toml", "--out", "required", "-q")
    assert massprop(folder, *estimate, "--require", "about_pivot.ixx<1%, moment_z<10 g mm").returncode == 0
    done = massprop(folder, *estimate, "--require", "about_pivot.ixx<0.0001%, mass")
    assert done.returncode == 4
    assert "mass in phase all is unobservable" in done.stderr
    assert "about_pivot.ixx in phase all has a sigma of" in done.stderr
    done = massprop(folder, "check", "log-1/log.parquet", "--vehicle", "unweighed.toml", "--want", "moment_x<0.0001%")
    assert done.returncode == 4
    assert "about_pivot.moment_x in phase all has a sigma of" in done.stderr
    done = massprop(folder, *estimate, "--set", "wheels.0.axis=[-1.0, 0.0, 0.0]")
    assert done.returncode == 6
    assert "the log contradicts the vehicle file: all quantities in phase all (" in done.stderr
    done = massprop(folder, "estimate", SAMPLES / "high-rate" / "log.parquet", "--out", "free", "-q", "--require", "moment_x")
    assert done.returncode == 3
    assert "about_pivot.moment_x is required, and phase all has no pivot" in done.stderr
    assert not (folder / "free").exists()
    with pytest.raises(InputError, match=r"--want about_pivot.ixx: a plan gives sigmas of only the ten quantities"):
        precise("about_pivot.ixx<1%")


def about(values: Array) -> tuple[Array, Array]:
    """Nine values and their covariance, of ten on a bearing of 5 kg at the origin."""
    covariance = np.diag(1e-8 * np.maximum(values, 1e-2) ** 2)
    return about_pivot(values - np.append(np.zeros(9), 5.0), covariance, np.zeros(3), np.array(7.0))


def pivoted(ten: Array, told: bool) -> PhaseItem:
    """A phase of a body whose CG is off the pivot; without values of the ten unless ``told``."""
    estimates = {name: {"value": float(value) if told else None} for name, value in zip(QUANTITIES, ten, strict=True)}
    values, covariance = about(ten)
    nine = {
        name: EstimateItem(value=float(value), sigma=1e-3, unit=PIVOT_UNITS[name], verdict="converged", final_at_s=None, reason="")
        for name, value in zip(ABOUT_PIVOT, values, strict=True)
    }
    spread = np.diag(1e-8 * np.maximum(ten, 1e-2) ** 2).tolist()
    phase = recorded.result([recorded.phase("all", **estimates) | {"covariance": spread}]).phases[0]
    return phase.model_copy(update={"about_pivot": nine, "about_pivot_covariance": covariance.tolist()})


def test_what_logs_share_of_values_about_a_pivot_is_the_thrusts_scale() -> None:
    """On a pedestal they are proportional to it; on a bearing as the ten are: inertia, mass and first moment of what turns."""
    ten = np.append(np.array(flight.TRUTH[:9]), 12.0)
    scale, gravity = {"scale_sigma": 0.02}, {"gravity_m_s2": 9.80665, "bearing_position_m": (0.0, 0.0, 0.0)}
    pedestal = flight.vehicle("pedestal", thrust=scale, environment=gravity)
    common, alike = kept.shared_about_pivot(pivoted(ten, told=False), pedestal, np.zeros(10))
    np.testing.assert_allclose(common, 0.02 * np.abs(about(ten)[0]), rtol=1e-9)
    np.testing.assert_array_equal(alike, 0.0)

    def scaled(by: float) -> Array:
        more = (1 + by) * ten
        more[6:9] = (1 + by) * ten[6:9] * (ten[9] - 5.0) / (more[9] - 5.0)
        return about(more)[0]

    bearing = flight.vehicle("air_bearing", thrust=scale, environment=gravity | {"bearing_mass_kg": 5.0})
    heavier = np.append(np.zeros(9), 0.1)
    common, alike = kept.shared_about_pivot(pivoted(ten, told=True), bearing, heavier)
    np.testing.assert_allclose(common, 0.02 * np.abs(scaled(1e-5) - scaled(-1e-5)) / 2e-5, rtol=1e-6)
    np.testing.assert_allclose(alike, np.abs(about(ten + heavier)[0] - about(ten)[0]), rtol=1e-6, atol=1e-15)
    _, alike = kept.shared_about_pivot(pivoted(ten, told=False), pedestal, heavier)
    assert np.isinf(alike).all()
