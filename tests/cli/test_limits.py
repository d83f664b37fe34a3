"""Every row of docs/limits.md holds: within a gigabyte and ten seconds, one line, the exit code, nothing written."""

import re
import time
from pathlib import Path

import pytest

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError
from tests.commandline import massprop
from tests.hostile import INPUTS

DOCS = (Path(__file__).parents[2] / "docs" / "limits.md").read_text(encoding="utf-8")
ROWS = {name: (message, int(code)) for name, message, code in re.findall(r"^\| (.+?) \| .+ \| (.+) \| (\d+) \|$", DOCS, re.MULTILINE)}
GIGABYTE = 2**30


def test_every_row_is_an_input_and_every_input_a_row() -> None:
    assert list(ROWS) == list(INPUTS)


LARGE = (
    *("Parquet: 60 texts of 10 MB, one page", "Parquet: lists of 700,000", "Parquet: values of 10 MB", "Parquet: 4,000 row groups"),
    *("Parquet: 700,000 empty column chunks", "CSV: a cell of 1 MB"),
)
"""Take a second or more; others of the same format or limit are less."""


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.thorough] * (name in LARGE)) for name in INPUTS])
def test_an_input_that_would_hurt_is_refused(name: str, tmp_path: Path) -> None:
    message, code = ROWS[name]
    arguments = INPUTS[name](tmp_path)
    began = time.monotonic()
    done = massprop(tmp_path, *arguments)
    assert time.monotonic() - began < 10
    assert done.returncode == code, done.stderr
    assert done.peak_bytes < GIGABYTE
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < 10_000
    assert arguments[0] == "batch" or (done.stderr.count("\n") == 1 and not (tmp_path / "out").exists())


def test_every_limit_is_told_in_docs_with_its_number() -> None:
    for limit in [value for value in vars(limits).values() if isinstance(value, limits.Limit)]:
        assert f"`{limit.variable}`" in DOCS


def test_the_environment_sets_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    limits.COLUMNS.check("log", 4096)
    monkeypatch.setenv("MASSPROP_MAX_COLUMNS", "10")
    limits.COLUMNS.check("log", 10)
    with pytest.raises(InputError, match=r"log: 11 columns; the limit is 10 .*MASSPROP_MAX_COLUMNS"):
        limits.COLUMNS.check("log", 11)


@pytest.mark.parametrize("said", ["", "0", "-1", "many", "1e9", "٣", "9" * 19])
def test_a_limit_that_is_no_number_is_refused(said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MASSPROP_MAX_COLUMNS", said)
    with pytest.raises(InputError, match="not a limit; give an integer above 0"):
        limits.COLUMNS.check("log", 1)
