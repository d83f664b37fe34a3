"""Colour where the terminal has it, and nowhere else."""

import io
import sys

import pytest

from massprop_cli.base import escape
from massprop_cli.cli import terminal
from massprop_cli.inputs.notice import Notice

SAID = "massprop: warning: look [some-code]"


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


def warned(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, no_color: bool = False, settings: dict[str, str] | None = None) -> str:
    for key in ("NO_COLOR", "TERM"):
        monkeypatch.delenv(key, raising=False)
    for key, value in (settings or {}).items():
        monkeypatch.setenv(key, value)
    monkeypatch.setattr(sys, "stderr", stream)
    terminal.warn([Notice("some-code", "look")], quiet=False, no_color=no_color)
    return stream.getvalue()


def test_a_warning_is_yellow_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    assert warned(monkeypatch, Screen()) == f"\x1b[33m{SAID}\x1b[0m\n"


@pytest.mark.parametrize("settings", [{"NO_COLOR": "1"}, {"TERM": "dumb"}])
def test_no_colour_where_the_environment_says_so(monkeypatch: pytest.MonkeyPatch, settings: dict[str, str]) -> None:
    assert warned(monkeypatch, Screen(), settings=settings) == f"{SAID}\n"


def test_no_colour_by_option_or_into_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    assert warned(monkeypatch, Screen(), no_color=True) == f"{SAID}\n"
    assert warned(monkeypatch, io.StringIO()) == f"{SAID}\n"


def test_a_foreign_escape_sequence_stays_visible_beside_our_own(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Screen()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.delenv("NO_COLOR", raising=False)
    terminal.warn([Notice("c", "\x1b[31mred")], quiet=False)
    assert "\x1b[31m" not in stream.getvalue()


def test_a_name_between_colons_is_no_picture(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.console(no_color=True).print(escape.rich("phase :cat:"))
    assert capsys.readouterr().out == "phase :cat:\n"
