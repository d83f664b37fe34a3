"""Values about a pivot are compared, tested against expectations and in a campaign's tables like the ten quantities."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from massprop_cli import ABOUT_PIVOT
from tests.commandline import massprop

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


def test_a_campaigns_tables_have_values_about_the_pivot(folder: Path) -> None:
    massprop(folder, "batch", "log-1/log.parquet", "log-2/log.parquet", "--out", "batch", "--jobs", "1", "-q")
    rows = list(csv.DictReader((folder / "batch" / "campaign.csv").read_text(encoding="utf-8").splitlines()))
    result = json.loads((folder / "run-1" / "result.json").read_text())["phases"][0]["about_pivot"]
    assert float(rows[0]["pivot_moment_x_kg_m"]) == pytest.approx(result["moment_x"]["value"], rel=1e-9)
    assert rows[1]["pivot_izz_verdict"] == "converged"
    table = pq.read_table(folder / "batch" / "campaign.parquet")
    assert table["pivot_izz"].to_pylist()[0] == pytest.approx(result["izz"]["value"], rel=1e-9)
