"""The documentation builds as a site: without warnings, with links that hold, loading nothing, with all that the code has."""

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

from massprop_cli import QUANTITIES, schemas
from massprop_cli.cli import app
from tests.extras import needed
from website.__main__ import build
from website.stage import ROOT, stage

needed("zensical")
needed("latex2mathml")

DOCS = ROOT / "docs"


class Page(HTMLParser):
    """What a page links to, what it loads, and where it can be jumped to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.text = text
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        self.anchors |= {given["id"]} if "id" in given else set()
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") not in ("canonical", "prev", "next"):
            self.loads.append(given.get("href", ""))
        elif "src" in given:
            self.loads.append(given["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Page]:
    folder = tmp_path_factory.mktemp("site") / "built"
    assert build(folder) == 0
    return {path.relative_to(folder).as_posix(): Page(path.read_text(encoding="utf-8")) for path in folder.rglob("*.html")} | {
        path.relative_to(folder).as_posix(): Page("") for path in folder.rglob("*") if path.suffix not in (".html", "") and path.is_file()
    }


@pytest.mark.seeds
@pytest.mark.thorough
def test_every_link_leads_to_a_page_and_a_place_on_it(site: dict[str, Page]) -> None:
    followed = 0
    for name, page in site.items():
        # the page of an address that isn't there names its links from the top of whatever serves the site
        for link in page.links if name != "404.html" else []:
            address, _, anchor = unquote(link).partition("#")
            if re.match(r"[a-z]+:", address):
                continue
            there = name if not address else (Path("/") / Path(name).parent / address).resolve().relative_to("/").as_posix()
            there = "index.html" if there == "." else there
            assert there in site, f"{name}: {link}"
            assert not anchor or anchor in site[there].anchors, f"{name}: {link}"
            followed += 1
    assert followed > 1000


@pytest.mark.thorough
def test_no_page_loads_anything_from_elsewhere(site: dict[str, Page]) -> None:
    loads = {load for page in site.values() for load in page.loads}
    assert loads
    assert not [load for load in loads if re.match(r"([a-z]+:)?//", load)]
    assert "<math" in site["theory.html"].text
    assert "```" not in site["theory.html"].text


@pytest.mark.thorough
def test_every_written_page_is_in_the_navigation(site: dict[str, Page]) -> None:
    linked = {(Path("/") / link.partition("#")[0]).resolve().relative_to("/").as_posix() for link in site["index.html"].links}
    for path in DOCS.rglob("*.md"):
        name = path.relative_to(DOCS).with_suffix(".html").as_posix()
        assert name in linked, name


def test_the_reference_has_every_command_option_and_key(tmp_path: Path) -> None:
    stage(tmp_path)
    pages = {path.stem: path.read_text(encoding="utf-8") for path in (tmp_path / "docs" / "reference").glob("*.md")}
    for command in app.registered_commands:
        assert command.callback is not None
        section = pages["commands"].split(f"## massprop {command.name}\n")[1].split("\n## ")[0]
        for option in re.findall(r"--[a-z-]+", str(command.callback.__annotations__)):
            assert f"`{option}" in section, option
    for name in schemas.NAMES:
        for part in [schemas.schema(name), *schemas.schema(name).get("$defs", {}).values()]:
            for key in part.get("properties", {}):
                assert f"| `{key}` |" in pages[name], (name, key)
    for name in ("estimate_log", "run_campaign", "LogEstimate", "Campaign", "InputError"):
        assert f"## {name}\n" in pages["python"]
    assert all(f"`{name}`" in pages["python"] for name in QUANTITIES)
