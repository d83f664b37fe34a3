"""A result that was edited such that nobody could believe its numbers is refused by every command that reads it."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.result.read import read
from tests.targets import CORPUS

Edit = Callable[[dict[str, Any]], object]
EDITS: dict[str, tuple[Edit, str]] = {
    "a value that is no number": (lambda phase: phase["estimates"]["mass"].update(value=float("nan")), "NaN is not a finite number"),
    "an endless sigma": (lambda phase: phase["estimates"]["mass"].update(sigma=float("inf")), "Infinity is not a finite number"),
    "a value beyond all": (lambda phase: phase["estimates"]["mass"].update(value=1e308), r"1e\+308 is larger than 1e\+150"),
    "a whole number beyond all": (lambda phase: phase["estimates"]["mass"].update(value=10**200), r"0 is larger than 1e\+150"),
    "a sigma that is next to nothing": (lambda phase: phase["estimates"]["mass"].update(value=1.0, sigma=1e-320), "smaller than any but 0"),
    "a sigma below 0": (lambda phase: phase["estimates"]["mass"].update(sigma=-1.0), "the sigma of mass is -1, below 0"),
    "a value without a sigma": (lambda phase: phase["estimates"]["mass"].update(value=1.0, sigma=None), "mass has a value and no sigma"),
    "another unit": (lambda phase: phase["estimates"]["mass"].update(unit="lb"), "the unit of mass is 'lb', not 'kg'"),
    "a lopsided covariance": (lambda phase: phase["covariance"][0].__setitem__(1, 5.0), "not symmetric"),
    "a variance below 0": (lambda phase: phase["covariance"][0].__setitem__(0, -5.0), "below 0"),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edited_result_is_refused(name: str, tmp_path: Path) -> None:
    edit, words = EDITS[name]
    result = json.loads((CORPUS / "result" / "good").read_text(encoding="utf-8"))
    file = tmp_path / "result.json"
    file.write_text(json.dumps(result), encoding="utf-8")
    read(file)
    edit(result["phases"][0])
    file.write_text(json.dumps(result), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read(file)


def test_a_number_too_large_for_any_is_refused(tmp_path: Path) -> None:
    text = (CORPUS / "result" / "good").read_text(encoding="utf-8")
    file = tmp_path / "result.json"
    file.write_text(re.sub(r'"duration_s": ?[\d.]+', '"duration_s": 1e999', text), encoding="utf-8")
    with pytest.raises(InputError, match="1e999 is not a finite number"):
        read(file)
