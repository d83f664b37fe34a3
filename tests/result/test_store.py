"""Where results go: no log's in the place of another's, nothing outside of the folder, no page beside a result that it doesn't tell of."""

import hashlib
import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from massprop_cli import estimate_log
from massprop_cli.base import escape, foldername
from massprop_cli.base.errors import UsageError
from massprop_cli.cli.guard import folder_of_its_own
from massprop_cli.flow import Analysis
from massprop_cli.result import build, store
from tests.campaigns import contents, simulate
from tests.commandline import massprop, succeeded

BASE = Path("massprop-out")


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    return estimate_log(simulate(tmp_path_factory.mktemp("store") / "flights", 1) / "seed-0001" / "log.parquet").analysis


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def of(found: Analysis, path: str) -> Analysis:
    """The same, found from a log of another name."""
    return replace(found, log=replace(found.log, path=Path(path)))


def stored(found: Analysis, path: str) -> Path:
    one = of(found, path)
    folder = store.write(None, one, escape.document(build.result(one))).folder
    assert (folder / "result.json").exists()
    return folder


@pytest.mark.usefixtures("here")
def test_logs_of_one_name_have_folders_of_their_own_and_each_log_comes_back_to_its_own(found: Analysis) -> None:
    logs = ["free-flyer/log.parquet", "docking/log.parquet", "old/docking/log.parquet", "free-flyer/log.csv", "other/log-1.csv"]
    folders = [stored(found, log) for log in logs]
    assert folders[:2] == [BASE / "log", BASE / "docking-log"]
    assert folders[2].name.startswith("docking-log-")
    assert folders[3:] == [BASE / "free-flyer-log", BASE / "log-1"]
    assert [stored(found, log) for log in reversed(logs)] == folders[::-1]
    assert [json.loads((folder / "run.json").read_text())["log"] for folder in folders] == [str(Path(log).resolve()) for log in logs]
    assert [json.loads((folder / "result.json").read_text())["log"]["path"] for folder in folders] == [Path(log).name for log in logs]


def test_a_log_comes_back_to_its_own_folder_though_a_better_name_has_become_free(found: Analysis, here: Path) -> None:
    stored(found, "a/log.csv")
    assert stored(found, "b/log.csv") == BASE / "b-log"
    (here / "massprop-out" / "log").rename(here / "elsewhere")
    assert stored(found, "b/log.csv") == BASE / "b-log"


def test_a_folder_that_holds_something_else_is_left_alone(found: Analysis, here: Path) -> None:
    for name in ("log", "flight"):
        (here / "massprop-out" / name).mkdir(parents=True)
    (here / "massprop-out" / "log" / "result.json").write_text("mine")
    (here / "massprop-out" / "flight" / "run.json").write_text("[]")
    before = contents(here)
    assert stored(found, "a/log.csv") == BASE / "a-log"
    assert stored(found, "a/flight.csv") == BASE / "a-flight"
    assert contents(here).items() >= before.items()


@pytest.mark.parametrize(
    ("log", "folder"),
    [
        ("a/...parquet", "__"),
        ("a/..parquet", "_"),
        ("a/.parquet", "_parquet"),
        ("a/ .csv", "_"),
        ("a/x\ny:z.csv", "x_y_z"),
        ("a/-rf.csv", "_rf"),
        ("a/results.csv", "a-results"),
        ("../...parquet", "__"),
        (f"a/{'x' * 240}.csv", f"{'x' * 120}-{foldername.digest('x' * 240)}"),
    ],
)
def test_nothing_is_written_outside_the_base_folder_whatever_a_log_is_called(log: str, folder: str, found: Analysis, here: Path) -> None:
    work = here / "work"
    (work / "massprop-out").mkdir(parents=True)
    for place in (here, work, work / "massprop-out"):
        (place / "result.json").write_text("mine")
    os.chdir(work)
    assert stored(found, log) == BASE / folder
    assert [(place / "result.json").read_text() for place in (here, work, work / "massprop-out")] == ["mine"] * 3
    assert sorted(path.name for path in work.iterdir()) == ["massprop-out", "result.json"]
    assert sorted(path.name for path in (work / "massprop-out").iterdir()) == sorted([folder, "result.json"])


@given(st.text())
def test_any_text_makes_one_part_of_a_path(text: str) -> None:
    name = foldername.safe(text)
    assert Path(name).parts == (name,)
    assert name not in ("", ".", "..")
    assert len(name.encode()) <= 140
    assert foldername.safe(name) == name or len(name.encode()) > 120 or len(text.encode(errors="replace")) > 120


def test_logs_that_are_estimated_at_once_do_not_meet_in_one_folder(found: Analysis, here: Path) -> None:
    logs = [f"{n}/log.csv" for n in range(12)]
    with ThreadPoolExecutor(6) as pool:
        folders = list(pool.map(lambda log: stored(found, log), logs))
    assert len(set(folders)) == 12
    assert [json.loads((here / folder / "run.json").read_text())["log"] for folder in folders] == [str(here / log) for log in logs]


@pytest.mark.parametrize("out", [".", "..", "", "...", "a/..", "a/../..", "{here}", "{here}/", "{here}/..", "/", "link", "link/.."])
def test_an_out_that_is_the_current_folder_or_above_it_is_refused_however_it_is_spelt(out: str, here: Path) -> None:
    (here / "a").mkdir()
    (here / "link").symlink_to(here)
    with pytest.raises(UsageError, match=r"--out '.*': is the current folder, or one above it; name a folder of its own"):
        folder_of_its_own(Path(out.format(here=here)))


@pytest.mark.parametrize("out", ["a", "../b", "a/../c", "./a/./b", "{here}-2", "link"])
def test_any_other_out_is_taken(out: str, here: Path) -> None:
    (here / "a").mkdir()
    (here / "link").symlink_to(here / "a")
    folder_of_its_own(Path(out.format(here=here)))
    folder_of_its_own(None)


@pytest.mark.parametrize("arguments", [("estimate", "x.csv"), ("batch", "x.csv"), ("report", "x"), ("simulate", "refined")])
def test_every_command_refuses_it_and_writes_nothing(arguments: tuple[str, ...], here: Path) -> None:
    (here / "a" / "b").mkdir(parents=True)
    done = massprop(here / "a", *arguments, "--out", "b/../..")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "massprop: --out 'b/../..': is the current folder, or one above it; name a folder of its own\n"
    assert contents(here) == {}


def test_estimate_says_where_a_result_went_if_not_where_one_would_look(tmp_path: Path) -> None:
    log = simulate(tmp_path / "flights", 2) / "seed-0001" / "log.parquet"
    assert massprop(tmp_path, "estimate", log).stderr == ""
    done = massprop(tmp_path, "estimate", "flights/seed-0002/log.parquet", "--json")
    assert done.stderr == "massprop: massprop-out/log is taken; the result is in massprop-out/seed-0002-log\n"
    assert done.stdout == (tmp_path / "massprop-out" / "seed-0002-log" / "result.json").read_text()


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


@pytest.mark.seeds
@pytest.mark.thorough
def test_pages_of_an_earlier_result_go_with_it_and_what_massprop_did_not_write_stays(tmp_path: Path) -> None:
    log = simulate(tmp_path / "flights", 1) / "seed-0001" / "log.parquet"
    out = tmp_path / "out"
    massprop(tmp_path, "estimate", log, "--out", out, "-q")
    first = digest(out / "result.json")
    (out / "mass.svg").write_text("mine")
    (out / "notes.md").write_text("mine")
    succeeded(tmp_path, "report", out, "--format", "html,md,csv,svg", "--figure", "cg")
    assert f"Made from result.json, SHA-256 <code>{first}</code>.</footer>" in (out / "report.html").read_text()
    assert (out / "report.md").read_text().endswith(f"\nMade from result.json, SHA-256 `{first}`.\n")
    (out / "report.csv").write_text("changed")
    before = contents(out)

    again = massprop(tmp_path, "estimate", log, "--out", out)
    assert (again.returncode, again.stderr) == (0, ""), "the same result keeps its pages"
    assert {name for name, content in contents(out).items() if before[name] != content} <= {"run.json"}

    other = massprop(tmp_path, "estimate", log, "--out", out, "--set", "convergence.count=50")
    assert other.returncode == 0
    assert digest(out / "result.json") != first
    assert other.stderr.splitlines() == [
        f"massprop: removed cg.svg, report.html, report.md of the earlier result; make them again with massprop report {out}",
        f"massprop: warning: report.csv in {out} may belong to another result than result.json there",
    ]
    assert sorted(path.name for path in out.iterdir()) == [
        "history.parquet", "mass.svg", "notes.md", "report.csv", "result.json", "run.json",
    ]  # fmt: skip
    assert ((out / "mass.svg").read_text(), (out / "report.csv").read_text()) == ("mine", "changed")


@pytest.mark.parametrize("listed", [{"../mine.txt": "{digest}"}, {"mine.txt": 3}, ["mine.txt"], "mine.txt", {"mine.txt": "0" * 64}])
def test_a_run_file_that_was_tampered_with_removes_nothing(listed: object, found: Analysis, here: Path) -> None:
    (here / "mine.txt").write_text("mine")
    (here / "out").mkdir()
    (here / "out" / "mine.txt").write_text("mine")
    said = json.dumps({"log": "x", "rendered": listed}).replace("{digest}", digest(here / "mine.txt"))
    (here / "out" / "run.json").write_text(said)
    stored = store.write(Path("out"), found, escape.document(build.result(found)))
    assert stored.pages.removed == ()
    assert (here / "mine.txt").read_text() == (here / "out" / "mine.txt").read_text() == "mine"


def test_a_page_that_goes_elsewhere_is_no_business_of_the_result(tmp_path: Path) -> None:
    log = simulate(tmp_path / "flights", 1) / "seed-0001" / "log.parquet"
    massprop(tmp_path, "estimate", log, "-q")
    run = (tmp_path / "massprop-out" / "log" / "run.json").read_bytes()
    massprop(tmp_path, "report", "massprop-out/log", "--format", "md", "--out", "review", "-q")
    assert (tmp_path / "massprop-out" / "log" / "run.json").read_bytes() == run
    massprop(tmp_path, "estimate", log, "-q", "--set", "convergence.count=50")
    assert (tmp_path / "review" / "report.md").exists()
