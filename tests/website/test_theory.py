"""The theory's page sends nobody to a file or a function that isn't there, and gives every equation one."""

import re

from website.stage import ROOT

TEXT = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
NAMED = re.compile(r"`(?P<file>[a-z]+/[a-z_/]+\.py)`(?P<names>(?:,\s+`[A-Za-z_]+`)*)")


def test_each_named_function_is_in_its_file() -> None:
    told = 0
    for named in NAMED.finditer(TEXT):
        code = (ROOT / "massprop_cli" / named["file"]).read_text(encoding="utf-8")
        for name in re.findall(r"`(\w+)`", named["names"]):
            told += 1
            assert re.search(rf"^(def|class) {name}\b", code, re.MULTILINE), (named["file"], name)
    assert told >= 25


def test_each_equation_stands_under_a_heading_that_names_a_function() -> None:
    sections = TEXT.split("\n## ")[1:]
    with_formulas = [section for section in sections if "```math" in section]
    assert len(with_formulas) >= 9
    for section in with_formulas:
        assert NAMED.search(section), section.splitlines()[0]


def test_each_module_of_the_flow_is_there() -> None:
    for module in re.findall(r"`([a-z]+\.[a-z]+)`", TEXT.split("\n## How it flows")[1]):
        path = ROOT / "massprop_cli" / module.replace(".", "/")
        assert path.with_suffix(".py").is_file() or path.is_dir(), module


def test_each_file_that_a_page_names_is_there() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    named = {
        (page.name, file)
        for page in pages
        for file in re.findall(r"`((?:massprop_cli|tests|benchmarks|website)/[\w/.-]+)`", page.read_text(encoding="utf-8"))
    }
    assert len(named) > 40
    assert not [(page, file) for page, file in named if not (ROOT / file).exists()]
