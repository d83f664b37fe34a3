"""massprop batch: results, restart, errors, exit codes."""

import json
import os
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import tomli_w
from filelock import FileLock
from jsonschema import Draft202012Validator
from junitparser import JUnitXml

from massprop_cli import QUANTITIES, schemas
from tests.campaigns import batch, contents, corrupt, simulate, worked_here
from tests.commandline import ended, massprop


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(tmp_path_factory.mktemp("logs") / "logs", 4)


@pytest.fixture
def here(logs: Path, tmp_path: Path) -> Path:
    shutil.copytree(logs, tmp_path / "logs")
    return tmp_path


def summary(folder: Path) -> Any:
    return json.loads((folder / "campaign.json").read_text())


def lines(stderr: str) -> list[str]:
    return [line for line in stderr.splitlines() if line.startswith("massprop: [")]


def test_a_campaign_has_a_result_for_each_log_and_tables_of_all(here: Path) -> None:
    done = batch(here, "logs", "--jobs", "2", first=None)
    assert done.returncode == 0, done.stderr
    out = here / "massprop-out"
    assert sorted(path.name for path in out.iterdir()) == ["campaign.csv", "campaign.html", "campaign.json", "campaign.parquet", "results"]
    names = [f"seed-000{n}" for n in range(1, 5)]
    assert sorted(path.name for path in (out / "results").iterdir()) == names
    assert sorted(path.name for path in (out / "results" / names[0]).iterdir()) == ["history.parquet", "outcome.json", "result.json"]
    found = summary(out)
    assert [row["name"] for row in found["logs"]] == names
    assert found["exit_codes"] == {"0": 4}
    table = pq.read_table(out / "campaign.parquet").to_pylist()
    for row, name in zip(table, names, strict=True):
        result = json.loads((out / "results" / name / "result.json").read_text())["phases"][0]["estimates"]
        assert {q: (row[q], row[f"{q}_sigma"], row[f"{q}_verdict"]) for q in QUANTITIES} == {
            q: (result[q]["value"], result[q]["sigma"], result[q]["verdict"]) for q in QUANTITIES
        }
    assert done.stdout.splitlines()[-1] == "massprop-out/campaign.html"
    assert [line.split()[2] for line in lines(done.stderr)] == [f"{name}:" for name in names]
    Draft202012Validator(schemas.schema("summary")).validate(found)


def test_a_result_is_the_one_that_estimate_writes(here: Path) -> None:
    batch(here, "logs/seed-0002/log.parquet")
    massprop(here, "estimate", "logs/seed-0002/log.parquet", "--out", "one")
    for name in ("result.json", "history.parquet"):
        assert (here / "massprop-out" / "results" / "seed-0002" / name).read_bytes() == (here / "one" / name).read_bytes()


@pytest.mark.seeds
@pytest.mark.slow
def test_bytes_and_order_do_not_depend_on_the_number_of_processes(here: Path) -> None:
    outs = {}
    for jobs in (1, 3):
        outs[jobs] = batch(here, "logs", "--out", f"out{jobs}", "--jobs", str(jobs), "--junit", f"{jobs}.xml", first=None)
    assert len({done.stderr for done in outs.values()}) == 1
    first = contents(here / "out1")
    assert contents(here / "out3") == first
    assert (here / "1.xml").read_bytes() == (here / "3.xml").read_bytes()


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_rerun_does_only_what_is_missing_or_changed(here: Path) -> None:
    batch(here, "logs", "--jobs", "1")
    results = here / "massprop-out" / "results"
    before = contents(here / "massprop-out")

    def redone(*arguments: str) -> list[int]:
        inodes = {path.name: path.stat().st_ino for path in results.iterdir()}
        # held open, so that no inode is given out again
        held = [os.open(path, os.O_RDONLY) for path in results.iterdir()]
        done = batch(here, "logs", "--jobs", "1", *arguments)
        assert done.returncode == 0, done.stderr
        changed = [n for n in range(1, 5) if inodes.get(f"seed-000{n}") != (results / f"seed-000{n}").stat().st_ino]
        assert [n for n, line in enumerate(lines(done.stderr), 1) if "unchanged" not in line] == changed
        for handle in held:
            os.close(handle)
        return changed

    assert redone() == []
    shutil.rmtree(results / "seed-0003")
    (results / "seed-0002" / "history.parquet").unlink()
    (results / "seed-0001" / "outcome.json").write_text("{}")
    assert redone() == [1, 2, 3]
    assert contents(here / "massprop-out") == before
    shutil.copy(here / "logs" / "seed-0001" / "log.parquet", here / "logs" / "seed-0004" / "log.parquet")
    assert redone() == [4]
    assert redone("--set", "convergence.count=50") == [1, 2, 3, 4]
    assert redone("--set", "convergence.count=50", "--force") == [1, 2, 3, 4]
    vehicle = (here / "logs" / "seed-0001" / "vehicle.toml").read_text()
    (here / "v.toml").write_text(vehicle)
    batch(here, "logs", "--vehicle", "v.toml", "-q", "--jobs", "1")
    (here / "v.toml").write_text(vehicle + "# weighed again\n")
    assert redone("--vehicle", "v.toml") == [1, 2, 3, 4]


@pytest.mark.thorough
def test_five_corrupt_logs_among_many_are_five_rows_with_their_errors(tmp_path: Path) -> None:
    many = 15
    simulate(tmp_path / "logs", many)
    chosen = [tmp_path / "logs" / f"seed-{n:04d}" / "log.parquet" for n in (3, 5, 8, 12, many)]
    for log in chosen:
        (log.parent / "vehicle.toml").unlink()
    why = corrupt(chosen)
    done = batch(tmp_path, "logs", "--junit", "junit.xml")
    assert done.returncode == 3
    assert done.stderr.splitlines()[-1] == f"massprop: 5 of {many} logs failed (5 unusable, {many - 5} done)"
    found = summary(tmp_path / "massprop-out")
    assert found["exit_codes"] == {"0": many - 5, "3": 5}
    bad = {row["log"].split("/")[0]: row["outcome"]["message"] for row in found["logs"] if row["outcome"]["exit_code"]}
    assert bad.keys() == why.keys()
    for name, message in bad.items():
        assert why[name] in message
        assert message.startswith(f"{name}/log.parquet")
        assert str(tmp_path) not in message
    assert len(list((tmp_path / "massprop-out" / "results").glob("*/result.json"))) == many - 5
    table = pq.read_table(tmp_path / "massprop-out" / "campaign.parquet").to_pylist()
    assert sorted(row["message"] for row in table if row["exit_code"] == 3) == sorted(bad.values())
    assert [row["mass"] for row in table if row["exit_code"] == 3] == [None] * 5
    suites = JUnitXml.fromfile(str(tmp_path / "junit.xml"))
    assert (len(list(suites)), suites.errors) == (many, 5)
    errors = {suite.name: case.result[0].message for suite in suites for case in suite if suite.errors}
    assert errors == {row["name"]: row["outcome"]["message"] for row in found["logs"] if row["outcome"]["exit_code"]}
    again = batch(tmp_path, "logs", "-q")
    assert again.returncode == 3, "errors are remembered"
    assert summary(tmp_path / "massprop-out") == found


@pytest.mark.thorough
def test_the_exit_code_is_the_worst_of_all_logs(here: Path) -> None:
    (here / "expect.toml").write_text('[all]\nmass = { value = 99.0, tolerance = "1 %" }\n')
    few = ("--set", "convergence.count=119", "-q", "--jobs", "1", "--junit", "j.xml")
    assert batch(here, "logs", "--require", "mass", *few).returncode == 4
    assert [(suite.failures, suite.errors) for suite in JUnitXml.fromfile(str(here / "j.xml"))] == [(1, 0)] * 4
    assert batch(here, "logs", "--expect", "expect.toml", "-q", "--jobs", "1", "--junit", "j.xml").returncode == 5
    assert [(suite.failures, suite.errors) for suite in JUnitXml.fromfile(str(here / "j.xml"))] == [(1, 0)] * 4
    done = batch(here, "logs", "--expect", "expect.toml", "--require", "mass", "--set", "convergence.count=119")
    assert done.returncode == 4
    assert "required but not converged: mass in phase all is not_converged" in done.stderr
    assert "not as expected: mass in phase all: expected 99" in done.stderr
    (here / "logs" / "seed-0001" / "log.parquet").write_bytes(b"x")
    done = batch(here, "logs", "--expect", "expect.toml", "--require", "mass", "--set", "convergence.count=119", "-q")
    assert done.returncode == 3
    assert [row["outcome"]["exit_code"] for row in summary(here / "massprop-out")["logs"]] == [3, 4, 4, 4]


def test_fail_fast_stops_at_the_first_that_fails(here: Path) -> None:
    (here / "logs" / "seed-0002" / "log.parquet").write_bytes(b"x")
    done = batch(here, "logs", "--fail-fast", "--jobs", "1", "--junit", "j.xml")
    assert done.returncode == 3
    outcomes = [row["outcome"] and row["outcome"]["exit_code"] for row in summary(here / "massprop-out")["logs"]]
    assert outcomes == [0, 3, None, None]
    assert "(1 unusable, 2 not tried, 1 done)" in done.stderr
    assert JUnitXml.fromfile(str(here / "j.xml")).errors == 3


@pytest.mark.thorough
def test_a_second_batch_on_one_folder_says_so_and_stops(here: Path) -> None:
    out = here / "massprop-out"
    out.mkdir()
    with FileLock(out / ".lock"):
        before = contents(out)
        done = batch(here, "logs")
        assert done.returncode == 3
        assert done.stderr == ("massprop: massprop-out: another massprop is writing there; wait for it, or choose another folder (--out)\n")
        assert contents(out) == before
    (out / ".lock").touch()
    assert batch(here, "logs", "-q").returncode == 0, "a lock file that nobody holds is no lock"
    assert not (out / ".lock").exists()


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_campaign_is_held_against_an_earlier_one(here: Path) -> None:
    batch(here, "logs", "--out", "before", "-q")
    same = batch(here, "logs", "--out", "after", "--baseline", "before/campaign.json", "-q")
    assert same.returncode == 0, same.stderr
    assert summary(here / "after")["baseline"]["compared"] == 4
    shutil.rmtree(here / "logs" / "seed-0004")
    vehicle = tomllib.loads((here / "logs" / "seed-0001" / "vehicle.toml").read_text())
    for jet in vehicle["jets"]:
        jet["force_n"] = [1.5 * force for force in jet["force_n"]]
    (here / "v.toml").write_text(tomli_w.dumps(vehicle))
    done = batch(here, "logs", "--out", "after", "--baseline", "before", "--vehicle", "v.toml", "--junit", "j.xml")
    assert done.returncode == 5
    found = summary(here / "after")["baseline"]
    assert {item["log"] for item in found["beyond"]} >= {"seed-0001", "seed-0004", None}
    lost = next(item for item in found["beyond"] if item["log"] == "seed-0004")
    assert lost["message"] == "seed-0004: has a result in the baseline, none here: the log is not in this campaign"
    moved = next(item for item in found["beyond"] if item["log"] == "seed-0001" and item["sigmas"])
    assert moved["sigmas"] > 4
    assert moved["value"] / moved["baseline_value"] == pytest.approx(1.5, rel=1e-3)
    assert "beyond the baseline" in done.stderr.splitlines()[-1]
    assert JUnitXml.fromfile(str(here / "j.xml")).errors == len(found["beyond"])
    (here / "t.toml").write_text('[[phases]]\nname = "dokced"\nmass = "2 %"\n')
    vain = batch(here, "logs", "--out", "vain", "--baseline", "before", "--tolerance", "t.toml")
    assert (vain.returncode, (here / "vain").exists()) == (3, False)
    assert "names phase 'dokced', which the results do not have; they have 'all'" in vain.stderr
    wide = batch(here, "logs", "--out", "wide", "--baseline", "before", "--max-sigma", "1e9", "-q")
    assert [item["log"] for item in summary(here / "wide")["baseline"]["beyond"]] == ["seed-0004"], wide.stderr


@pytest.mark.thorough
def test_json_is_the_whole_of_stdout_and_quiet_says_nothing(here: Path) -> None:
    done = batch(here, "logs", "--json")
    assert done.stdout == (here / "massprop-out" / "campaign.json").read_text()
    done = batch(here, "logs", "-q")
    assert (done.stdout, done.stderr) == ("", "")


def test_a_report_of_each_log_is_rendered_if_asked(here: Path) -> None:
    done = batch(here, "logs/seed-0001", "--report", "-q", first=worked_here)
    assert done.returncode == 0, done.stderr
    page = (here / "massprop-out" / "results" / "seed-0001" / "report.html").read_text()
    ended(here, ("report", "massprop-out/results/seed-0001", "--out", "alone"), first=worked_here)
    assert page == (here / "alone" / "report.html").read_text()
    assert 'href="results/seed-0001/report.html"' in (here / "massprop-out" / "campaign.html").read_text()


def test_hostile_names_of_logs_harm_nothing(here: Path) -> None:
    log = (here / "logs" / "seed-0001" / "log.parquet").read_bytes()
    shutil.rmtree(here / "logs")
    names = ["a\x1b[31mb\n::error::c.parquet", "<script>alert(1)<\\script>.parquet", "--help.csv", "%20&#x.csv", "x' y\".parquet"]
    (here / "logs").mkdir()
    for name in names:
        (here / "logs" / name).write_bytes(log if name.endswith(".parquet") else b"")
    (here / os.fsdecode(b"logs/not-\xff-utf8.parquet")).write_bytes(log)
    done = batch(here, "logs", "--junit", "j.xml", settings={"GITHUB_ACTIONS": "true"})
    assert done.returncode == 3
    assert "\x1b" not in done.stdout + done.stderr
    assert not [line for line in done.stderr.splitlines() if line.startswith("::error::c")]
    found = summary(here / "massprop-out")
    assert found["exit_codes"] == {"0": 3, "3": 3}
    assert "<script>alert" not in (here / "massprop-out" / "campaign.html").read_text()
    assert "not-?-utf8.parquet: the file's name is not UTF-8; rename it" in [row["outcome"]["message"] for row in found["logs"]]
    assert len(list(JUnitXml.fromfile(str(here / "j.xml")))) == 6
    assert {path.name for path in (here / "massprop-out" / "results").iterdir()} == {row["name"] for row in found["logs"]}


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["nowhere"], 3, "nowhere: no such file or folder"),
        (["logs/*.csv"], 3, "logs/*.csv: no log matches this pattern"),
        (["empty"], 3, "empty: holds no log"),
        (["logs", "--vehicle", "none.toml"], 3, "none.toml: no such vehicle file"),
        (["logs", "--expect", "none.toml"], 3, "none.toml: no such expect file"),
        (["logs", "--baseline", "none.json"], 3, "none.json: no such campaign.json"),
        (["logs", "--baseline", "logs/seed-0001/truth.json"], 3, "name a campaign.json that massprop batch"),
        (["logs", "--require", "weight"], 2, "--require weight: no such quantity"),
        (["logs", "--jobs", "2", "--cluster", "tcp://127.0.0.1:9"], 2, "--jobs 2: is for this machine"),
        (["logs", "--junit", "nowhere/j.xml"], 2, "--junit nowhere/j.xml: name a file in a folder that exists"),
        (["logs", "--delay", "soon"], 3, "--delay 'soon': not a delay"),
        (["logs", "--out", "."], 2, "name a folder of its own"),
        (["logs", "--out", "logs/seed-0001/log.parquet"], 3, "cannot be written"),
    ],
)
def test_what_makes_no_campaign_is_refused_in_one_line(here: Path, arguments: list[str], code: int, said: str) -> None:
    (here / "empty").mkdir()
    before = contents(here)
    done = batch(here, *arguments)
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (code, "")
    assert said in line
    assert contents(here) == before


class Missing:
    """An import that finds none of the packages of two extras."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        if name.partition(".")[0] in {"fsspec", "s3fs", "distributed", "dask"}:
            raise ModuleNotFoundError(f"No module named {name!r}")


def without_extras() -> None:
    worked_here()
    sys.meta_path.insert(0, Missing())


@pytest.mark.thorough
def test_without_the_extras_a_batch_runs_here_and_names_the_extra_otherwise(here: Path) -> None:
    assert batch(here, "logs/seed-0001", "--out", "with").returncode == 0
    assert batch(here, "logs/seed-0001", "--out", "without", first=without_extras).returncode == 0
    assert contents(here / "with") == contents(here / "without")
    for arguments, extra in {("s3://flights/logs",): "remote", ("logs", "--out", "s3://flights/x"): "remote"}.items():
        done = batch(here, *arguments, first=without_extras)
        assert done.returncode == 3
        assert done.stderr.endswith(f"needs the package fsspec; pip install 'massprop[{extra}]'\n")
    done = batch(here, "logs", "--cluster", "tcp://127.0.0.1:9", first=without_extras)
    assert (done.returncode, done.stderr) == (
        3,
        "massprop: cluster tcp://127.0.0.1:9: needs the package distributed; pip install 'massprop[cluster]'\n",
    )
