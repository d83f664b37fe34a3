"""Logs of a campaign made one result, as the campaign file says."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from junitparser import JUnitXml

from massprop_cli import QUANTITIES
from massprop_cli.testbed import output, scenario
from tests.campaigns import batch, simulate
from tests.commandline import massprop

FILE = """
logs = ["logs", "axes"]
[[combine]]
name = "both"
logs = ["logs/*"]
require = "ixx<1%"
[[combine]]
name = "axes together"
logs = ["axes/*"]
"""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("joining")
    simulate(folder / "logs", 2)
    for seed, axes in enumerate(('"roll"', '"pitch"', '"yaw"', '"x", "y", "z"'), 11):
        pulses = f'plan=[{{motion="random", axes=[{axes}], start_s=0.0, end_s=6.0}}]'
        output.simulate(scenario.load("free-flyer", ["duration_s=6.0", pulses]), folder / "axes" / f"log-{seed}", seed, None)
    (folder / "campaign.toml").write_text(FILE)
    return folder


@pytest.fixture(scope="module")
def done(here: Path) -> Any:
    made = batch(here, "campaign.toml", "--junit", "j.xml")
    assert made.returncode == 0, made.stderr
    assert "combined into both (seed-0001/log.parquet, seed-0002/log.parquet): done" in made.stdout
    return json.loads((here / "massprop-out" / "campaign.json").read_text())


def test_what_is_combined_in_a_campaign_is_what_the_command_combines(here: Path, done: Any) -> None:
    both, axes = done["combined"]
    assert (both["name"], axes["name"]) == ("both", "axes together")
    assert len(done["logs"]) == 6
    results = here / "massprop-out" / "results"
    alone = massprop(here, "combine", results / "seed-0001", results / "seed-0002", "--out", "own", "--json")
    own, told = json.loads(alone.stdout), json.loads((results / "both" / "result.json").read_text())
    assert told["phases"] == own["phases"]
    page = (here / "massprop-out" / "campaign.html").read_text()
    assert 'href="results/both/result.json"' in page
    suites = {suite.name: suite for suite in JUnitXml.fromfile(str(here / "j.xml"))}
    assert suites["both"].tests == 10


def test_logs_of_some_axes_each_are_fitted_at_once_in_a_campaign_too(here: Path, done: Any) -> None:
    """The campaign has no run.json that names a log: it knows them itself."""
    told = json.loads((here / "massprop-out" / "results" / "axes together" / "result.json").read_text())["phases"][0]["estimates"]
    truth = dict(zip(QUANTITIES, scenario.load("free-flyer").scenario.truth.values, strict=True))
    for name, item in told.items():
        assert abs(item["value"] - truth[name]) < 4 * item["sigma"]
        assert item["sigma"] < 0.02 * max(abs(truth["iyy"]), abs(truth[name]))
    assert "result-partial" not in done["combined"][1]["outcome"]["warnings"]


def test_a_log_without_a_result_fails_what_it_was_to_be_part_of_alone(here: Path, tmp_path: Path) -> None:
    shutil.copytree(here / "logs", tmp_path / "logs")
    (tmp_path / "logs" / "seed-0002" / "log.parquet").write_bytes(b"no parquet")
    (tmp_path / "c.toml").write_text('logs = ["logs"]\n[[combine]]\nname = "both"\nlogs = ["logs/*"]\n')
    made = batch(tmp_path, "c.toml", "-q")
    assert made.returncode == 3
    found = json.loads((tmp_path / "massprop-out" / "campaign.json").read_text())
    assert found["combined"][0]["outcome"]["message"] == "seed-0002/log.parquet: has no result to combine; see its own row"
    assert found["logs"][0]["outcome"]["exit_code"] == 0


@pytest.mark.usefixtures("done")
@pytest.mark.parametrize(
    "damaged",
    [b"\xff\xfe", *(pytest.param(text, marks=pytest.mark.thorough) for text in (b"{", b"[]", b'{"schema": "massprop/result/1"}'))],
)
def test_a_damaged_result_fails_what_it_was_to_be_part_of_alone(damaged: bytes, here: Path, tmp_path: Path) -> None:
    """It had ended the whole batch."""
    shutil.copytree(here, tmp_path / "again")
    (tmp_path / "again" / "massprop-out" / "results" / "seed-0001" / "result.json").write_bytes(damaged)
    made = batch(tmp_path / "again", "campaign.toml", "--json")
    assert made.returncode == 3, made.stderr
    both, axes = json.loads(made.stdout)["combined"]
    assert both["outcome"]["exit_code"] == 3
    assert "results/seed-0001/result.json: " in both["outcome"]["message"]
    assert both["outcome"]["message"].endswith("(massprop batch --force)")
    assert axes["outcome"]["exit_code"] == 0


@pytest.mark.parametrize(
    ("combine", "said"),
    [
        ('name = "x"', "name logs alone, or before and after"),
        ('name = "x"\nbefore = ["logs/*"]', "name logs alone, or before and after"),
        ('name = "x"\nlogs = ["flights/*"]', "combine.0.logs = ['flights/*']: matches none of the 6 logs; correct the pattern"),
        ('name = "x"\nlogs = ["logs/seed-0001/*"]', "matches only one log, seed-0001/log.parquet; name two or more"),
        ('name = "seed-0001"\nlogs = ["logs/*"]', "is a log's (seed-0001/log.parquet) already; choose another"),
        ('name = "x"\nlogs = ["logs/*"]\nrequire = "mass<1"', "the unit is missing; give it in % or kg or g"),
    ],
)
def test_what_can_not_be_combined_is_refused_before_anything_is_done(combine: str, said: str, here: Path) -> None:
    (here / "bad.toml").write_text(f'logs = ["logs", "axes"]\n[[combine]]\n{combine}\n')
    made = batch(here, "bad.toml", "--out", "nothing")
    assert (made.returncode, made.stdout) == (3, "")
    assert said in made.stderr
    assert len(made.stderr.splitlines()) == 1
    assert not (here / "nothing").exists()
