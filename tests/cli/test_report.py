import csv
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from junitparser import JUnitXml
from typer.testing import CliRunner

import massprop_cli.report
from massprop_cli.base import escape
from massprop_cli.base.errors import InputError, UsageError
from massprop_cli.cli import app
from massprop_cli.report import html
from massprop_cli.result.schema import Result
from tests import recorded
from tests.commandline import massprop
from tests.refusal import contents


def save(folder: Path, found: Result | None = None) -> Path:
    folder.mkdir(parents=True)
    (folder / "result.json").write_text(escape.document(found or recorded.result()), encoding="utf-8")
    return folder


def missed() -> Result:
    held = {"value": 25.0, "tolerance": 0.5, "stated": "0.5 kg", "met": False, "difference": -3.0, "sigmas": -12.0}
    return recorded.result([recorded.phase("all", mass={"expected": held})], expectations={"path": "e.toml", "sha256": "c" * 64})


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_one_result_is_reported_into_its_own_folder_and_the_paths_are_printed(tmp_path: Path) -> None:
    save(tmp_path / "run")
    done = massprop(tmp_path, "report", "run", "--format", "md,csv,junit")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == ["run/report.md", "run/report.csv", "run/report.junit.xml"]
    assert names(tmp_path / "run") == ["report.csv", "report.junit.xml", "report.md", "result.json"]
    assert (tmp_path / "run" / "report.md").read_text().startswith("# Mass properties\n")
    assert JUnitXml.fromfile(str(tmp_path / "run" / "report.junit.xml")).tests == 10


def test_several_results_are_reported_into_one_folder(tmp_path: Path) -> None:
    save(tmp_path / "a" / "log")
    save(tmp_path / "b" / "log")
    done = massprop(tmp_path, "report", "a/log", "b/log/result.json", "a/../a/log", "--format", "csv")
    assert done.stdout == "massprop-out/report.csv\n"
    with (tmp_path / "massprop-out" / "report.csv").open(newline="") as file:
        assert [row["result"] for row in csv.DictReader(file)] == ["a/log", "b/log"]
    assert names(tmp_path / "a" / "log") == ["result.json"]


def test_out_names_the_folder_and_quiet_says_nothing(tmp_path: Path) -> None:
    save(tmp_path / "run")
    done = massprop(tmp_path, "report", "run", "--format", "md", "--out", "deep/er", "-q")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert names(tmp_path / "deep" / "er") == ["report.md"]


def test_a_second_report_is_the_same_bytes(tmp_path: Path) -> None:
    save(tmp_path / "run")
    arguments = ("report", "run", "--format", "md,csv,junit", "-q")
    massprop(tmp_path, *arguments)
    before = contents(tmp_path)
    massprop(tmp_path, *arguments)
    assert contents(tmp_path) == before


def test_expectations_that_were_missed_when_it_was_estimated_exit_5_after_writing(tmp_path: Path) -> None:
    save(tmp_path / "run", missed())
    done = massprop(tmp_path, "report", "run", "--format", "md")
    assert done.returncode == 5
    assert done.stdout == "run/report.md\n"
    (line,) = done.stderr.splitlines()
    assert line == ("massprop: not as expected: run: mass in phase all: expected 25 ± 0.5 kg, got 22 (off by -3, -12 sigma)")


def test_expectations_of_the_command_line_replace_those_of_the_result_and_leave_it_as_it_is(tmp_path: Path) -> None:
    save(tmp_path / "run", missed())
    before = (tmp_path / "run" / "result.json").read_bytes()
    (tmp_path / "met.toml").write_text("[all]\nmass = 22.0\n")
    (tmp_path / "unmet.toml").write_text("[all]\nixx = 0.7\nizz = 9.0\n")
    assert massprop(tmp_path, "report", "run", "--format", "md", "--expect", "met.toml").returncode == 0
    done = massprop(tmp_path, "report", "run", "--format", "junit", "--expect", "unmet.toml")
    assert done.returncode == 5
    assert "ixx in phase all" in done.stderr
    assert "izz in phase all" in done.stderr
    xml = JUnitXml.fromfile(str(tmp_path / "run" / "report.junit.xml"))
    assert (xml.tests, xml.failures) == (2, 2)
    assert (tmp_path / "run" / "result.json").read_bytes() == before


def test_a_last_line_about_very_many_results_is_cut(tmp_path: Path) -> None:
    folders = [save(tmp_path / f"run-{number:02d}", missed()) for number in range(60)]
    done = massprop(tmp_path, "report", *folders, "--format", "junit", "-q")
    assert done.returncode == 5
    assert done.stderr.rstrip().endswith("; and 10 more")


REFUSED = {
    "an unknown format": (("run", "--format", "xls"), 2, ("xls", "html, md, csv, junit")),
    "an empty format": (("run", "--format", ""), 2, ("no such format",)),
    "a format of figures without a figure": (("run", "--format", "md,png"), 2, ("png", "--figure all")),
    "no result": ((), 2, ("RESULT",)),
    "an out that is no folder of its own": (("run", "--format", "md", "--out", "."), 2, ("--out '.'",)),
    "an out below a file": (("run", "--format", "md", "--out", "file/x"), 3, ("file/x", "cannot be written", "--out")),
    "a report that is a folder": (("taken", "--format", "csv,md"), 3, ("report.md", "is a folder", "nothing was written")),
    "a result that is not there": (("run", "nowhere", "--format", "md"), 3, ("nowhere", "no such result.json")),
    "a folder of results": ((".", "--format", "md"), 3, (".: holds no result.json", "such as other")),
    "a log": (("log.parquet", "--format", "md"), 3, ("log.parquet: is a table, not a result", "massprop estimate log.parquet")),
    "a result that is no text": (("binary.json", "--format", "md"), 3, ("not a text file", "a result.json is UTF-8 JSON")),
    "a folder without a result": (("empty", "--format", "md"), 3, ("empty", "holds no result.json")),
    "a result of another version": (("other", "--format", "md"), 3, ("massprop/result/9", "massprop/result/1")),
    "an expect file that is not there": (("run", "--format", "md", "--expect", "no.toml"), 3, ("no.toml", "no such expect file")),
    "an expect file of another phase": (
        ("run", "--format", "md", "--expect", "other.toml"),
        3,
        ("run/result.json: other.toml", "'cruise'", "'all'"),
    ),
}


@pytest.mark.parametrize(("arguments", "code", "says"), REFUSED.values(), ids=REFUSED.keys())
def test_report_refuses_and_writes_nothing_with(arguments: tuple[str, ...], code: int, says: tuple[str, ...], tmp_path: Path) -> None:
    save(tmp_path / "run")
    save(tmp_path / "taken")
    (tmp_path / "taken" / "report.md").mkdir()
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe")
    (tmp_path / "other.toml").write_text('[[phases]]\nname = "cruise"\nmass = 1\n')
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "result.json").write_text('{"schema": "massprop/result/9"}')
    before = contents(tmp_path)
    done = massprop(tmp_path, "report", *arguments)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    for text in says:
        assert text in done.stderr
    assert contents(tmp_path) == before


# Pages and figures, drawn by stand-ins


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    def draw(name: str, item: Any, kind: str) -> bytes:
        if name == "moon":
            raise UsageError(f"no figure {name!r}")
        if name == "innovations" and not item.history:
            raise InputError("no history.parquet")
        return f"{name} {item.name} {kind}".encode()

    monkeypatch.setattr(html, "page", lambda items: f"<p>{' '.join(item.name for item in items)}")
    stand_in = SimpleNamespace(NAMES=("inertia", "mass"), draw=draw)
    monkeypatch.setitem(sys.modules, "massprop_cli.report.figures", stand_in)
    monkeypatch.setattr(massprop_cli.report, "figures", stand_in, raising=False)


def run(*arguments: str | Path) -> tuple[int, list[str]]:
    found = CliRunner().invoke(app, ["report", *map(str, arguments)])
    return found.exit_code, found.stdout.splitlines()


@pytest.mark.usefixtures("drawn")
def test_html_is_the_default(tmp_path: Path) -> None:
    folder = save(tmp_path / "run")
    assert run(folder) == (0, [str(folder / "report.html")])
    assert (folder / "report.html").read_text() == "<p>run"


@pytest.mark.usefixtures("drawn")
def test_open_shows_the_page_that_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    monkeypatch.setattr(typer, "launch", shown.append)
    folder = save(tmp_path / "run")
    assert run(folder, "--open", "--out", tmp_path / "page") == (0, [str(tmp_path / "page" / "report.html")])
    assert shown == [str(tmp_path / "page" / "report.html")]


@pytest.mark.usefixtures("drawn")
def test_figures_alone_are_written_if_no_text_is_asked_for(tmp_path: Path) -> None:
    folder = save(tmp_path / "run")
    assert run(folder, "--figure", "mass", "--figure", "mass") == (0, [str(folder / "mass.svg")])
    assert (folder / "mass.svg").read_bytes() == b"mass run svg"
    assert run(folder, "--figure", "all", "--format", "png,svg,md", "--out", tmp_path / "o") == (
        0,
        [str(tmp_path / "o" / name) for name in ("report.md", "inertia.svg", "inertia.png", "mass.svg", "mass.png")],
    )


@pytest.mark.usefixtures("drawn")
def test_figures_of_several_results_bear_the_names_of_their_folders(tmp_path: Path) -> None:
    folders = [save(tmp_path / name) for name in ("a/log", "b/log")]
    code, written = run(*folders, "--figure", "mass", "--out", tmp_path / "o")
    assert (code, [Path(path).name for path in written]) == (0, ["a-log-mass.svg", "b-log-mass.svg"])


@pytest.mark.usefixtures("drawn")
def test_no_figure_takes_the_place_of_another(tmp_path: Path) -> None:
    folders = [save(tmp_path / name) for name in ("a-b/c", "x/a/b-c", "y/a/b-c")]
    code, written = run(*folders, "--figure", "mass", "--out", tmp_path / "o")
    assert (code, len(set(written)), len(names(tmp_path / "o"))) == (0, 3, 3)


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize(("figure", "code"), [("moon", 2), ("innovations", 3)])
def test_a_figure_that_can_not_be_drawn_leaves_nothing_behind(figure: str, code: int, tmp_path: Path) -> None:
    folder = save(tmp_path / "run")
    assert run(folder, "--figure", "mass", "--figure", figure, "--format", "md,svg") == (code, [])
    assert names(folder) == ["result.json"]
