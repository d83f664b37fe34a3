"""massprop batch --check: each log's check in place of its result, beside the results of a campaign that estimates."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from junitparser import JUnitXml

from massprop_cli import QUANTITIES, run_campaign
from massprop_cli.base import escape
from massprop_cli.check import flow
from massprop_cli.inputs.require import requirements
from tests.campaigns import batch, contents, simulate
from tests.commandline import massprop

NAMES = ["seed-0001", "seed-0002", "seed-0003"]
"""A good log, one that stops in the middle of its file, and one whose jets never fired."""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checks")
    simulate(folder / "logs", 2)
    simulate(folder / "quiet", 1, "plan=[]", first=3)
    (folder / "quiet" / NAMES[2]).rename(folder / "logs" / NAMES[2])
    broken = folder / "logs" / NAMES[1] / "log.parquet"
    broken.write_bytes(broken.read_bytes()[:2000])
    return folder


def test_each_log_has_the_check_that_the_command_gives_and_no_result(here: Path) -> None:
    done = batch(here, "logs", "--check", "--require", "ixx<1%", "--junit", "j.xml", "--out", "out")
    assert done.returncode == 3, "the worst of 0, 3 and 4"
    place = here / "out" / "checks"
    assert sorted(path.name for path in (here / "out").iterdir()) == ["checks"]
    found = json.loads((place / "campaign.json").read_text())
    assert [row["outcome"]["exit_code"] for row in found["logs"]] == [0, 3, 4]
    for name in (NAMES[0], NAMES[2]):
        log = here / "logs" / name / "log.parquet"
        own = escape.document(flow.check(log, None, requirements("ixx<1%"), ()))
        assert (place / "results" / name / "check.json").read_text() == own
        assert sorted(path.name for path in (place / "results" / name).iterdir()) == ["check.json", "outcome.json"]
    assert "nothing-commanded" in found["logs"][2]["outcome"]["warnings"]
    assert found["pooled"] == []
    rows = {row["name"]: row for row in pq.read_table(place / "campaign.parquet").to_pylist()}
    assert all(rows[NAMES[0]][name] is None and rows[NAMES[0]][f"{name}_sigma"] > 0 for name in QUANTITIES)
    assert f"results/{NAMES[0]}/check.json" in (place / "campaign.html").read_text()
    suites = {suite.name: suite for suite in JUnitXml.fromfile(str(here / "j.xml"))}
    assert [(suites[name].errors, suites[name].failures) for name in NAMES] == [(0, 0), (1, 0), (0, 2)]


def test_what_has_not_changed_is_not_checked_again_and_results_stay(here: Path) -> None:
    estimated = batch(here, "logs", "--out", "both", "-q")
    assert estimated.returncode == 3
    before = contents(here / "both" / "results")
    assert batch(here, "logs", "--check", "--out", "both").returncode == 3
    again = batch(here, "logs", "--check", "--out", "both")
    assert f"{NAMES[0]}, unchanged: done" in again.stderr
    assert contents(here / "both" / "results") == before


def test_python_checks_a_campaign_too(here: Path, tmp_path: Path) -> None:
    found = run_campaign(here / "logs", tmp_path / "out", check=True, jobs=1)
    outcome = found.outcomes[NAMES[0]]
    assert outcome is not None
    assert (outcome.method, outcome.files) == ("check", ["check.json"])


@pytest.mark.parametrize("more", [("--expect", "truth.json"), ("--baseline", "campaign.json"), ("--report",)])
def test_what_holds_values_against_something_is_refused(more: tuple[str, ...], here: Path) -> None:
    done = massprop(here, "batch", "logs", "--check", *more)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{more[0]}: a check gives no values; leave it out" in done.stderr
