"""docs/where.md sends nobody to a file or a name that isn't there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROWS = [row for row in (ROOT / "docs" / "where.md").read_text(encoding="utf-8").splitlines() if row.startswith("|")][2:]
NAME = re.compile(r"`([^`]+)`")


def test_each_question_is_answered_by_one_or_two_files_that_are_there() -> None:
    assert len(ROWS) == 21
    for row in ROWS:
        files = [ROOT / name for name in NAME.findall(row) if "/" in name]
        assert 1 <= len(files) <= 2, row
        assert all(file.is_file() for file in files), row


def test_names_are_of_the_file_before_them() -> None:
    told = 0
    for row in ROWS:
        file = ""
        for name in NAME.findall(row):
            if "/" in name:
                file = (ROOT / name).read_text(encoding="utf-8")
            else:
                told += 1
                assert re.search(rf"\b{name}\b", file), name
    assert told >= 3
