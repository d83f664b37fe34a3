"""Text from outside on its way to a terminal, a page, a table or a file name."""

import ast
import json
import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import massprop_cli
from massprop_cli.base import escape, foldername
from tests.commandline import massprop, succeeded
from tests.hostile import ESCAPES, SAMPLE, flight, vehicle
from tests.refusal import save
from tests.source import nodes

ROOMS = Path(massprop_cli.__file__).parent


def obeyed(text: str) -> list[str]:
    """What a terminal would obey, or a reader not see."""
    return [character for character in text if unicodedata.category(character) in ("Cc", "Cf", "Cs") and character != "\n"]


@given(st.text())
def test_no_way_out_lets_through_what_a_terminal_obeys(text: str) -> None:
    for way in (escape.line, escape.name, escape.message, escape.rich, escape.cell, escape.markdown):
        assert not obeyed(way(text))
        assert way is escape.markdown or "\n" not in way(text)


@given(st.recursive(st.text() | st.integers() | st.none(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)))
def test_json_reads_back_the_same_and_holds_nothing_that_a_terminal_obeys(data: object) -> None:
    text = escape.json(json.dumps(data, indent=1, ensure_ascii=False))
    assert not obeyed(text)
    assert json.loads(text) == data


@pytest.mark.parametrize("sign", "=+-@＝＋－＠﹢﹣﹦﹫")
def test_no_cell_begins_as_a_formula(sign: str) -> None:
    assert escape.cell(f"{sign}1+1").startswith("'")


def test_of_a_long_message_beginning_and_remedy_stay() -> None:
    told = escape.message(f"vehicle.toml, line 3: key {'k' * 1_000_000} is unknown; drop it")
    assert len(told) < 10_000
    assert told.startswith("vehicle.toml, line 3: key kk")
    assert told.endswith("is unknown; drop it")


def test_no_other_room_writes_to_the_terminal() -> None:
    """``typer.echo``, ``print`` and rich's ``escape`` in one place each; data of massprop's own by name."""
    allowed = {
        "cli/terminal.py": {"echo"},
        "base/escape.py": {"escape"},
        "cli/__init__.py": {"echo"},
        "cli/schema.py": {"echo"},
        "cli/batch.py": {"echo"},
    }
    for file in ROOMS.rglob("*.py"):
        calls = {name(node.func) for node in nodes(file) if isinstance(node, ast.Call)}
        found = calls & {"echo", "print_exc", "secho"} | ({"escape"} if "rich.markup" in file.read_text(encoding="utf-8") else set())
        assert found <= allowed.get(file.relative_to(ROOMS).as_posix(), set()), file


def name(function: ast.expr) -> str:
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


@pytest.mark.parametrize(
    "place",
    ["vehicle", *(pytest.param(one, marks=[pytest.mark.thorough, pytest.mark.seeds]) for one in ("phase", "jet", "file", "column"))],
)
def test_hostile_names_reach_no_terminal(place: str, tmp_path: Path) -> None:
    said = json.dumps(ESCAPES)
    changes = {
        "vehicle": ('name = "free-flyer"', f"name = {said}"),
        "phase": ("[environment]", f"[[phases]]\nname = {said}\nstart_s = 0.0\nend_s = 5.0\n[environment]"),
        "jet": ('name = "roll_p1"', f"name = {said}"),
        "column": ("[environment]", f"[columns]\ntime_s = {{ from = {said} }}\n[environment]"),
    }
    vehicle(tmp_path, "", *changes.get(place, ("", "")))
    log = save(flight(100), tmp_path / (f"{ESCAPES[:12]}.parquet" if place == "file" else "log.parquet"))
    done = massprop(tmp_path, "estimate", log, "--out", tmp_path / "out")
    assert not obeyed(done.stdout + done.stderr)
    if done.returncode == 0:
        for arguments in (
            ["report", "--format", "md,csv,html,junit"],
            ["compare", tmp_path / "out"],
            ["compare", "--json", tmp_path / "out"],
        ):
            told = succeeded(tmp_path, *arguments, tmp_path / "out")
            assert not obeyed(told.stdout + told.stderr)
        for page in ("report.md", "report.csv", "report.html", "report.junit.xml"):
            assert not obeyed((tmp_path / "out" / page).read_text(encoding="utf-8").replace("\r\n", "\n"))


@pytest.mark.parametrize("argument", [f"--{ESCAPES}", f"{ESCAPES}.parquet", "--set=" + ESCAPES, "\udcff.parquet"])
def test_what_was_asked_reaches_no_terminal_as_it_was(argument: str, tmp_path: Path) -> None:
    done = massprop(tmp_path, "estimate", SAMPLE / "log.parquet", argument)
    assert done.returncode in (2, 3)
    assert not obeyed(done.stderr)
    assert done.stderr.count("\n") == 1


FOLDERS = {
    "con": "con_", "NUL.flight": "NUL_.flight", "com1": "com1_", "console": "console", "lpt": "lpt", "a:b": "a_b", "a\\b": "a_b",
    "a<b>|?*": "a_b____", "ends.": "ends_", "ends ": "ends_", "..": "__", "": "log", "-rf": "_rf", "é": "é", "a\nb": "a_b",
}  # fmt: skip


@pytest.mark.parametrize(("log", "folder"), FOLDERS.items())
def test_a_folder_has_a_name_that_windows_macos_and_linux_take(log: str, folder: str) -> None:
    assert foldername.safe(log) == folder


NAMES = [
    "two words",
    "-rf",
    "--out",
    "new\nline",
    "tab\tbed",
    "n" * 247,
    "con",
    "nul.txt",
    "a:b",
    "a\\b",
    "$(id)",
    "'\"",
    "%s",
    "..",
    "﹍",
    "\udcff\udcfe",
]


@pytest.mark.parametrize("stem", NAMES)
def test_a_log_of_any_name_is_estimated_or_refused_in_one_line(stem: str, tmp_path: Path) -> None:
    vehicle(tmp_path)
    save(flight(100), tmp_path / "log.parquet").rename(tmp_path / f"{stem}.parquet")
    done = massprop(tmp_path, "estimate", "-q", "--", f"{stem}.parquet")
    assert done.returncode in (0, 3), done.stderr
    assert not obeyed(done.stderr)
    assert done.stderr.count("\n") <= 1
    assert sorted(path.name for path in tmp_path.iterdir() if path.name != "massprop-out") == sorted([f"{stem}.parquet", "vehicle.toml"])
    if done.returncode == 0:
        (folder,) = (tmp_path / "massprop-out").iterdir()
        assert sorted(path.name for path in folder.iterdir()) == ["history.parquet", "result.json", "run.json"]
