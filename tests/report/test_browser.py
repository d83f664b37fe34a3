"""What a reader sees: pages opened in a headless Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from massprop_cli.report import html
from tests.recording import record

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHROMIUM = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
ARGUMENTS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
pytestmark = [pytest.mark.thorough, pytest.mark.browser, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (pip install -e '.[dev]')")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    docking = record(folder / "docking", "docking/log.parquet")
    refined = record(folder / "refined", "scenarios/refined/log.parquet")
    written = {}
    for name, recorded in {"docking": [docking], "refined": [refined], "comparison": [docking, refined]}.items():
        written[name] = folder / f"{name}.html"
        written[name].write_text(html.page(recorded), encoding="utf-8")
    return written


FIGURES = {"docking": 2 * 16 + 18, "refined": 16 + 18, "comparison": 10}


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_a_page_is_whole_quiet_and_as_wide_as_its_screen(
    browser: Browser, pages: dict[str, Path], name: str, scheme: str, width: int
) -> None:
    context = browser.new_context(viewport={"width": width, "height": 844}, color_scheme="dark" if scheme == "dark" else "light")
    page = context.new_page()
    requests: list[str] = []
    complaints: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(pages[name].as_uri())
    assert [url for url in requests if not url.startswith("data:")] == [pages[name].as_uri()]
    assert complaints == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.get_by_role("img").count() == FIGURES[name]
    seen = page.evaluate(
        "[...document.querySelectorAll('svg')].map(s => [s.getAttribute('aria-label').length, s.clientWidth, s.getBBox().height])"
    )
    assert all(text > 30 and wide > 120 and high > 50 for text, wide, high in seen)
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == ("rgb(20, 24, 29)" if scheme == "dark" else "rgb(255, 255, 255)")
    context.close()


def test_lines_take_the_tone_of_the_scheme(browser: Browser, pages: dict[str, Path]) -> None:
    tones = []
    for scheme in ("light", "dark"):
        context = browser.new_context(color_scheme="dark" if scheme == "dark" else "light")
        page = context.new_page()
        page.goto(pages["refined"].as_uri())
        tones.append(page.evaluate("getComputedStyle(document.querySelector('[id$=ixx-value-1] path')).stroke"))
        page.emulate_media(media="print")
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        context.close()
    assert tones == ["rgb(0, 114, 178)", "rgb(98, 189, 240)"]


def test_text_in_figures_can_be_read_on_a_phone(browser: Browser, pages: dict[str, Path]) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.goto(pages["refined"].as_uri())
    heights = page.evaluate("[...document.querySelectorAll('svg text')].map(t => t.getBoundingClientRect().height)")
    assert min(heights) > 6.0
    context.close()


def test_links_lead_to_what_they_name(browser: Browser, pages: dict[str, Path]) -> None:
    context = browser.new_context(viewport={"width": 1280, "height": 844})
    page = context.new_page()
    page.goto(pages["comparison"].as_uri())
    page.get_by_role("link", name="refined").first.click()
    assert page.url.endswith("#result-2")
    assert page.get_by_role("heading", name="refined").bounding_box()["y"] < 844  # type: ignore[index]
    context.close()
