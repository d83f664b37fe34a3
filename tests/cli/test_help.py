"""What ``--help`` shows of each command: groups, examples, no type behind a flag; and what shells complete."""

import inspect
import shlex
from pathlib import Path

import pytest

from massprop_cli.cli import app, application
from massprop_cli.cli.help import docstring_of
from tests.commandline import massprop

COMMANDS = {str(command.name): command.callback for command in app.registered_commands if command.callback is not None}


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_each_command_shows_examples_of_itself_with_options_that_it_has(name: str, tmp_path: Path) -> None:
    text = massprop(tmp_path, name, "--help").stdout
    assert "<bool>" not in text
    examples = docstring_of(COMMANDS[name]).examples
    assert examples
    for example in examples:
        assert example in text
        words = shlex.split(example)
        assert words[:2] == ["massprop", name]
        for word in words:
            assert not word.startswith("--") or f" {word} " in text, word


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_a_paragraph_is_not_broken_where_the_docstring_was(name: str) -> None:
    said = docstring_of(COMMANDS[name])
    written = inspect.cleandoc(COMMANDS[name].__doc__ or "")
    assert len(said.text.split("\n\n")) == written.count("\n\n") + (0 if said.examples else 1)
    assert "\n" not in said.text.replace("\n\n", "")


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_a_command_is_built_alone_where_it_alone_is_asked_for(name: str) -> None:
    (alone,) = application(name).registered_commands
    assert alone.name == name
    assert alone.callback is COMMANDS[name]


def test_all_commands_are_built_where_none_of_them_is_asked_for() -> None:
    for asked in (None, "--help", "estmate"):
        assert {command.name for command in application(asked).registered_commands} == set(COMMANDS)


def test_options_stand_in_groups(tmp_path: Path) -> None:
    text = massprop(tmp_path, "estimate", "-h").stdout
    assert massprop(tmp_path, "estimate", "--help").stdout == text
    groups = [line.split("─ ")[1].split(" ─")[0] for line in text.splitlines() if line.startswith("╭─ ")]
    assert groups == ["Arguments", "Options", "Input", "Output", "Settings", "Requirements"]
    only = text.split("╭─ Options ")[1].split("╭─")[0]
    assert "--help" in only
    assert only.count("--") == 1


def test_shells_can_be_told_the_commands(tmp_path: Path) -> None:
    assert "--install-completion" in massprop(tmp_path, "--help").stdout
    settings = {"_MASSPROP_COMPLETE": "complete_bash", "COMP_WORDS": "massprop est", "COMP_CWORD": "1"}
    assert massprop(tmp_path, **settings).stdout.split() == ["estimate"]


def test_open_without_a_page_is_refused(tmp_path: Path) -> None:
    done = massprop(tmp_path, "report", "x", "--format", "csv", "--open")
    assert done.returncode == 2
    assert "--open" in done.stderr
    assert "html" in done.stderr


UNLIKE = {
    "a log given to report": (["report", "log.parquet"], "log.parquet: is a table, not a result; if it is a log, run massprop estimate"),
    "a folder given to estimate": (["estimate", "."], "is a folder; name the log file itself, or all logs in it with massprop batch"),
    "a text in a tab-separated table": (
        ["estimate", "text.tsv", "--vehicle", "v.toml"],
        "text.tsv, line 3, column time_s: 'soon' is not a number",
    ),
    "a folder without a result": (["report", "."], "holds no result.json; name a folder that massprop estimate wrote"),
}


@pytest.mark.parametrize("mistake", UNLIKE)
def test_unlike_mistakes_get_unlike_messages(mistake: str, tmp_path: Path) -> None:
    arguments, said = UNLIKE[mistake]
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    (tmp_path / "text.tsv").write_text("time_s\tgyro_x_rad_s\n0.1\t0\nsoon\t0\n", encoding="utf-8")
    (tmp_path / "v.toml").write_text("schema = 1\n[cycle]\nperiod_s = 0.1\n", encoding="utf-8")
    done = massprop(tmp_path, *arguments)
    assert done.returncode == 3
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
