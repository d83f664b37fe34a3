"""What a reader sees: pages opened in a headless Chromium."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from massprop_cli.report import html
from massprop_cli.report.figures import whiteness
from massprop_cli.report.figures.command import against
from massprop_cli.report.figures.command import means as means_of
from massprop_cli.result.read import Recorded
from tests.extras import needed
from tests.recording import changed, record

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

CHROMIUM = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
ARGUMENTS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
pytestmark = [pytest.mark.thorough, pytest.mark.browser, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    playwright = needed("playwright.sync_api")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("one") / "refined", "scenarios/refined/log.parquet")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory, recorded: Recorded) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    docking, refined = record(folder / "docking", "docking/log.parquet"), recorded
    written = {}
    for name, shown in {"docking": [docking], "refined": [refined], "comparison": [docking, refined]}.items():
        written[name] = folder / f"{name}.html"
        written[name].write_text(html.page(shown), encoding="utf-8")
    return written


FIGURES = {"docking": 2 * 26 + 1 + 43, "refined": 26 + 43, "comparison": 20}


@pytest.mark.seeds
@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (1280, "dark")])
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


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The free flyer with one jet that the vehicle file has the wrong way round."""
    folder = tmp_path_factory.mktemp("faulty")
    wrong = record(folder / "result", "free-flyer/log.parquet", "jets.0.force_n=[0.0, 0.0, -1.112]")
    file = folder / "faulty.html"
    file.write_text(html.page([wrong]), encoding="utf-8")
    return file


@pytest.mark.parametrize("width", [390, 1280])
def test_the_first_screen_of_a_faulty_log_says_not_to_believe_it_and_which_jet(browser: Browser, faulty: Path, width: int) -> None:
    context = browser.new_context(viewport={"width": width, "height": 844})
    page = context.new_page()
    page.goto(faulty.as_uri())
    for said in (
        "all ten quantities contradicted",
        "jet roll_p1 pushes opposite to",
        "do not use them",
        "The model does not fit the log: 0 of 19",
    ):
        box = page.get_by_text(said).first.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < 844, said
    red = page.get_by_text("all ten quantities contradicted").evaluate("e => getComputedStyle(e).color")
    assert red == "rgb(179, 0, 27)"
    raster = page.locator("#figure-firing text", has_text="roll_p1")
    assert raster.evaluate("e => getComputedStyle(e).fill") == "rgb(179, 0, 27)"
    context.close()


def opened(browser: Browser, file: Path) -> Page:
    page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    page.goto(file.as_uri())
    return page


def over(page: Page, figure: str, right: float, down: float = 0.5, panel: int = 0) -> Locator:
    """The pointer in one of a figure's panels, that part of its width and height from its upper left corner."""
    found = page.locator(f"#figure-{figure} .panel").nth(panel)
    found.scroll_into_view_if_needed()
    box = found.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + right * box["width"], box["y"] + down * box["height"])
    return found


def told(panel: Locator) -> dict[str, float]:
    """What the panel says under the pointer: "34.10 s: measured 0.4246; predicted 0.4756 rad/s"."""
    moment, _, rest = panel.locator("output").inner_text().replace("−", "-").partition(" s: ")
    return {"time_s": float(moment)} | {words.split()[0]: float(words.split()[1]) for words in rest.split("; ")}


def test_values_under_the_pointer_are_those_of_the_history(browser: Browser, pages: dict[str, Path], recorded: Recorded) -> None:
    page, columns = opened(browser, pages["refined"]), recorded.history["all"]
    reach = np.ptp(columns["rate_x_rad_s"])
    for part in (0.35, 0.6, 0.85):
        panel = over(page, "rate-fit", part)
        said = told(panel)
        near = np.abs(columns["time_s"] - said["time_s"]) < 0.3
        assert np.abs(columns["rate_x_rad_s"][near] - said["measured"]).min() < 1e-3 * reach
        assert np.abs(columns["predicted_rate_x_rad_s"][near] - said["predicted"]).min() < 1e-3 * reach
        assert panel.locator("output").inner_text().endswith("rad/s")
    said = told(over(page, "inertia1", 0.9))
    last = np.abs(columns["time_s"] - said["time_s"]) < 0.3
    assert np.abs(columns["ixx"][last] - said["value"]).min() < 0.2 * columns["ixx_sigma"][last].max()
    assert np.abs(columns["ixx_sigma"][last] - said["±"]).min() < 0.2 * columns["ixx_sigma"][last].max()
    said = told(over(page, "settling1", 0.7))
    near = np.abs(columns["time_s"] - said["time_s"]) < 0.3
    assert np.abs(np.log10(columns["ixx_sigma"][near] / said["sigma"])).min() < 0.02
    page.mouse.move(0, 0)
    assert page.locator(".live").count() == 0, "the drawing is back when the pointer has gone"


@pytest.mark.thorough
@pytest.mark.seeds
def test_figures_of_the_fit_say_what_the_history_gives(browser: Browser, pages: dict[str, Path], recorded: Recorded) -> None:
    page, columns = opened(browser, pages["refined"]), recorded.history["all"]
    z = np.column_stack([columns[f"whitened_rate_{letter}"] for letter in "xyz"])
    z = z[np.isfinite(z).all(1)]
    at, shares = named(over(page, "whiteness", 0.55))
    bins = whiteness.EDGES[:-1], whiteness.EDGES[1:]
    touched = [(low, high) for low, high in zip(*bins, strict=True) if low - 0.01 <= at <= high + 0.01]  # two, where it is on an edge
    found = [[((z[:, i] >= low) & (z[:, i] < high)).mean() / (high - low) for i in range(3)] for low, high in touched]
    assert any(shares == pytest.approx(one, abs=0.01) for one in found)
    lag, correlations = named(over(page, "whiteness", 0.5, panel=1))
    lagged = [np.dot(z[int(lag) :, i], z[: -int(lag), i]) / np.dot(z[:, i], z[:, i]) for i in range(3)]
    assert correlations == pytest.approx(lagged, abs=0.005)
    panel = over(page, "command-fit", 0.9)
    command, (left, *_) = named(panel)
    assert panel.locator("output").inner_text().endswith("rad/s²")
    parts = [(1, recorded.result.phases[0], columns)]
    means = means_of(against(parts, "rate", "x"))
    nearest = min(means, key=lambda mean: abs(mean.command - command))
    assert left == pytest.approx(nearest.residual, abs=0.3 * nearest.sigma)


@pytest.mark.thorough
@pytest.mark.seeds
def test_expectations_and_the_raster_stand_where_their_values_are(browser: Browser, tmp_path: Path, recorded: Recorded) -> None:
    wanted = {"value": 1.0, "tolerance": 0.5, "stated": "0.5", "met": True, "difference": 0.2, "sigmas": 3.0}
    file = tmp_path / "expected.html"
    file.write_text(html.page([changed(recorded, "ixx", {"expected": wanted})]), encoding="utf-8")
    page, columns = opened(browser, file), recorded.history["all"]
    low, high = across(page, "figure-expectations", "ixx-ratio-1")
    assert (low + high) / 2 == pytest.approx(0.2 / 0.5, abs=0.02)
    jet = recorded.result.vehicle.jets[0]
    busy = columns["time_s"][columns[f"executed_{jet}_s"] > 0]
    assert across(page, "figure-firing", "jet1-firing") == pytest.approx(
        (busy.min(), busy.max()), abs=float(np.ptp(columns["time_s"])) / 120
    )


def across(page: Page, figure: str, series: str) -> tuple[float, float]:
    """From where to where a series is drawn, in the units of its panel."""
    left, right = page.locator(f"#{figure} [id$={series}]").first.evaluate(
        """e => {
            const svg = e.closest("svg"), frame = svg.querySelector("[data-x]"), [a, b] = frame.dataset.x.split(" ").map(Number);
            const all = svg.getBoundingClientRect(), own = e.getBoundingClientRect();
            return [own.left, own.right].map(x => a + b * (x - all.left) / all.width * svg.viewBox.baseVal.width);
        }"""
    )
    return float(left), float(right)


def named(panel: Locator) -> tuple[float, list[float]]:
    """What a panel that isn't against time says under the pointer: "0.5: histogram 0.39, 0.37, 0.40 share per σ"."""
    at, _, rest = panel.locator("output").inner_text().replace("−", "-").partition(": ")
    return float(at), [float(number) for number in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", rest)]


def test_a_stretch_is_zoomed_into_and_a_double_click_leads_back(browser: Browser, pages: dict[str, Path], recorded: Recorded) -> None:
    page, columns = opened(browser, pages["refined"]), recorded.history["all"]
    scales = "e => [e.live.chart.scales.x.min, e.live.chart.scales.x.max, e.live.chart.scales.y.max - e.live.chart.scales.y.min]"
    panel = over(page, "rate-fit", 0.4)
    whole = panel.evaluate(scales)
    page.mouse.down()
    over(page, "rate-fit", 0.5)
    over(page, "rate-fit", 0.6)
    page.mouse.up()
    near = panel.evaluate(scales)
    assert near[1] - near[0] == pytest.approx(0.2 / 0.81 * (whole[1] - whole[0]), rel=0.05)
    assert whole[0] < near[0] < near[1] < whole[1]
    seen = columns["rate_x_rad_s"][(columns["time_s"] > near[0]) & (columns["time_s"] < near[1])]
    assert np.ptp(seen) <= near[2] <= whole[2]
    if np.ptp(seen) < 0.5 * np.ptp(columns["rate_x_rad_s"]):
        assert near[2] < 0.8 * whole[2]
    page.mouse.move(0, 0)
    assert panel.locator(".live").count() == 1, "what is zoomed into stays"
    over(page, "rate-fit", 0.5)
    panel.locator(".live .u-over").dblclick()
    assert panel.evaluate(scales) == pytest.approx(whole)


def test_without_scripts_and_on_paper_the_drawings_are_there(browser: Browser, pages: dict[str, Path]) -> None:
    page = browser.new_context(java_script_enabled=False).new_page()
    page.goto(pages["refined"].as_uri())
    assert page.get_by_role("img").count() == FIGURES["refined"]
    page = opened(browser, pages["refined"])
    over(page, "rate-fit", 0.5)
    assert page.locator(".live").count() == 1
    pdf = page.pdf(prefer_css_page_size=True)
    assert page.locator(".live").count() == 0
    assert re.fullmatch(r"Printed on \d{4}-\d\d-\d\d\.", page.locator("#printed").text_content() or "")
    assert len(re.findall(rb"/Type ?/Page\b", pdf)) <= 12


def test_links_lead_to_what_they_name(browser: Browser, pages: dict[str, Path]) -> None:
    context = browser.new_context(viewport={"width": 1280, "height": 844})
    page = context.new_page()
    page.goto(pages["comparison"].as_uri())
    page.get_by_role("link", name="refined").first.click()
    assert page.url.endswith("#result-2")
    assert page.get_by_role("heading", name="refined").bounding_box()["y"] < 844  # type: ignore[index]
    context.close()
