"""Every code of a warning, and every verdict, has its page; every page its code."""

import ast
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import get_args

import pytest

from massprop_cli.conclude.verdict import Verdict
from massprop_cli.diagnosis import UNKNOWN
from massprop_cli.errorparameters.table import CODES
from tests.source import nodes
from website.examples import VERDICTS, WARNINGS
from website.pictures import picture
from website.stage import ROOT

PAGES = {path.stem for path in (ROOT / "docs" / "warnings").glob("*.md")} - {"index"}
TOLD = {"Notice", "WarningItem", "Supposition", "ColumnReading"}
"""What is made with a code: by its name, or the first of its arguments that may be one."""
CODE = re.compile(r"[a-z]+(-[a-z]+)+|outliers|contradicted")


def literals(node: ast.expr) -> Iterator[str]:
    """The texts that an expression may be, with .+ for what is put in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else ".+" for part in node.values)
    elif isinstance(node, ast.IfExp):
        yield from literals(node.body)
        yield from literals(node.orelse)


def codes() -> set[str]:
    found = {*CODES, UNKNOWN}
    for path in (ROOT / "massprop_cli").rglob("*.py"):
        for node in nodes(path):
            if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in TOLD:
                given = [*node.args[:2], *(word.value for word in node.keywords if word.arg == "code")]
                found |= {text for part in given for text in literals(part) if CODE.fullmatch(text.replace(".+", "x"))}
    return found


def test_every_code_in_the_code_has_its_page() -> None:
    known = codes()
    assert len(known) > 40
    missing = {code for code in known if not any(re.fullmatch(code, page) for page in PAGES)}
    assert not missing, "write docs/warnings/CODE.md for each, and name it in docs/warnings/index.md"


def test_every_page_is_of_a_code_and_has_cause_test_and_remedy() -> None:
    index = (ROOT / "docs" / "warnings" / "index.md").read_text(encoding="utf-8")
    known = codes()
    for page in PAGES:
        text = (ROOT / "docs" / "warnings" / f"{page}.md").read_text(encoding="utf-8")
        assert text.startswith(f"# {page}\n")
        assert all(f"**{part}.**" in text for part in ("Cause", "Test", "Remedy")), page
        assert f"[{page}]({page}.md)" in index
        assert any(re.fullmatch(code, page) for code in known), page


def test_every_verdict_has_its_page() -> None:
    pages = {path.stem for path in (ROOT / "docs" / "verdicts").glob("*.md")} - {"index"}
    assert pages == set(get_args(Verdict))


def test_every_page_shows_an_example_on_a_report() -> None:
    for folder, examples in (("warnings", WARNINGS), ("verdicts", VERDICTS)):
        pages = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "docs" / folder).glob("*.md") if path.stem != "index"}
        assert set(examples) == set(pages), "python -m website.pictures makes what website/examples.py has"
        for name, text in pages.items():
            picture = ROOT / "docs" / folder / f"{name}.svg"
            assert re.search(rf"^!\[.+\]\({name}\.svg\)$", text, re.MULTILINE), picture
            assert picture.stat().st_size < 60_000, picture
            said = "".join(ET.fromstring(picture.read_bytes()).itertext())
            assert (f"[{name}]" if folder == "warnings" else name.replace("_", " ")) in said, picture


def test_a_picture_is_the_warning_above_the_panels_that_show_it() -> None:
    image = picture("noise-floor", WARNINGS["noise-floor"], verdict=False)
    assert "imu.gyro_noise_rad_s is stated as 0" in image
    drawn = ET.fromstring(image)
    panels = [group for group in drawn.iter("{http://www.w3.org/2000/svg}g") if (group.get("id") or "").startswith("axes-rate_")]
    assert len(panels) == 3
    with pytest.raises(ValueError, match="gyro-units is not said"):
        picture("gyro-units", WARNINGS["noise-floor"], verdict=False)
