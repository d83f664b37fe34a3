"""The page of a campaign, as text and in a headless Chromium."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rich.console import Console

from massprop_cli import QUANTITIES
from massprop_cli.campaign import figures, terminal
from massprop_cli.campaign import markdown as campaign_markdown
from massprop_cli.campaign import page as campaign_page
from massprop_cli.campaign.outcome import CampaignRow, Value, contradicted, state
from massprop_cli.campaign.parquet import columns, csv_rows
from massprop_cli.campaign.pooled import grouped
from massprop_cli.campaign.summary import Summary, summary, to_json
from massprop_cli.report.figures import canvas
from tests.campaign.test_ci import failed
from tests.campaign.test_pool import row
from tests.recording import drawn, precision
from tests.report.test_browser import CHROMIUM, browser

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

__all__ = ["browser"]
HOSTILE = '"><script>alert(1)</script>\u202e'


def campaign(logs: int = 12) -> Summary:
    """Logs 2, 4, 6 ... are lighter the higher their number; two failed; one told its mass no better than before."""
    rows: list[CampaignRow] = [row(n, 30.0 - n, files=["result.json"]) for n in range(1, logs + 1)]
    dim = rows[4].outcome
    assert dim is not None
    estimates = dim.bodies[0].estimates | {"mass": Value(value=None, sigma=None, verdict="not_excited")}
    body = dim.bodies[0].model_copy(update={"estimates": estimates})
    rows[4] = rows[4].model_copy(update={"outcome": dim.model_copy(update={"bodies": [body], "warnings": ["gyro-units"]})})
    return summary("night", [*rows, failed(1), failed(2, HOSTILE).model_copy(update={"name": "x&y #1", "log": HOSTILE})])


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "campaign.html"
    file.write_text("".join(campaign_page.page(campaign())), encoding="utf-8")
    for n in range(1, 13):
        result = file.parent / "results" / f"log-{n}" / "result.json"
        result.parent.mkdir(parents=True)
        result.write_text(f'{{"n": {n}}}')
    return file


def test_a_page_is_the_same_bytes_again_and_escapes_what_is_hostile() -> None:
    text = "".join(campaign_page.page(campaign()))
    assert text == "".join(campaign_page.page(Summary.model_validate_json("".join(to_json(campaign())))))
    assert text.count("<script>") == 2
    assert "\u202e" not in text
    assert "&lt;script&gt;alert(1)" in text
    assert re.search(r"script-src 'sha256-[A-Za-z0-9+/]{43}='", text)


def test_logs_that_are_done_with_warnings_are_counted_by_code_wherever_the_campaign_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    codes = [["jet-sign", "jet-sign"], ["jet-sign"], ["delay-mismatch", "jet-sign"], []]
    found = summary("night", [row(n, 22.0, warnings=said) for n, said in enumerate(codes, 1)] + [failed(5)])
    assert (found.exit_codes, found.warned, found.contradicted) == ({"0": 4, "3": 1}, 3, 0)
    assert found.warnings == {"jet-sign": 3, "delay-mismatch": 1}
    said = "1 unusable, 4 done; 3 with warnings (jet-sign 3, delay-mismatch 1)"
    assert f'<p class="headline">{said}</p>' in "".join(campaign_page.page(found))
    assert f"{said}." in campaign_markdown.text(found, 100_000).replace("\\", "")
    terminal.show(found, Console(width=200))
    assert capsys.readouterr().out.splitlines()[-1] == f"5 logs: {said}"
    assert Summary.model_validate_json("".join(to_json(found))).warnings == found.warnings
    assert campaign_markdown.text(summary("n", [row(1, 22.0, warnings=["x"])]), 100_000).startswith("## ⚠ n: 1 logs")


def test_a_log_that_is_done_with_warnings_does_not_look_like_one_without() -> None:
    states = [entry["state"] for entry in campaign_page._entries(summary("n", [row(1, 22.0), row(2, 22.0, warnings=["gyro-units"])]), ())]
    assert states == ["done", "done, with warnings"]
    text = "".join(campaign_page.page(summary("n", [row(1, 22.0, warnings=["gyro-units"])])))
    assert '<span class="sign" aria-hidden="true">⚠</span> done, with warnings' in text
    assert "<option>done, with warnings</option>" in text


def test_logs_that_their_vehicle_file_contradicts_are_counted_apart() -> None:
    fine = row(1, 22.0, warnings=[]).outcome
    assert fine is not None
    body = fine.bodies[0]
    value = body.estimates["ixx"].model_copy(update={"verdict": "contradicted"})
    body = body.model_copy(update={"estimates": body.estimates | {"ixx": value}})
    one = fine.model_copy(update={"bodies": [body], "warnings": ["jet-sign"]})
    assert (contradicted(one), state(one)) == (True, "done, contradicted")
    assert (contradicted(fine), state(fine), contradicted(None), state(None)) == (False, "done", False, "not tried")
    found = summary("night", [row(1, 22.0), failed(2)]).model_copy(update={"contradicted": 1, "warned": 1, "warnings": {"jet-sign": 1}})
    assert campaign_page.counts(found) == "1 unusable, 1 done; 1 contradicted by the vehicle file; 1 with warnings (jet-sign 1)"


def test_logs_that_contradict_each_other_are_said_to_wherever_their_mean_is_shown() -> None:
    found = summary("night", [row(n, mass) for n, mass in enumerate((22.0, 22.0, 24.0, 24.0), 1)])
    (doubt,) = campaign_page.doubts(found.pooled[0])
    told = io.StringIO()
    terminal.show(found, Console(file=told, width=400))
    for text in ("".join(campaign_page.page(found)), campaign_markdown.text(found, 100_000), told.getvalue()):
        assert doubt in text
    assert doubt.startswith("mass: the logs contradict each other")
    ratio = found.pooled[0].estimates["mass"].scatter_ratio
    assert ratio is not None
    assert f"up to {ratio:.2f} times" in doubt or f"up to {ratio:.0f} times" in doubt
    assert not campaign_page.doubts(summary("night", [row(n, 22.0) for n in range(4)]).pooled[0])


def test_a_log_with_contradicted_quantities_is_marked_in_its_row_and_counted() -> None:
    good, bad = row(1, 22.0), row(2, 22.0)
    assert bad.outcome is not None
    wrong = Value(value=-825.1234567, sigma=4.0, shared=0.0, verdict="contradicted")
    body = bad.outcome.bodies[0].model_copy(update={"estimates": bad.outcome.bodies[0].estimates | {"ixx": wrong, "izz": wrong}})
    outcome = bad.outcome.model_copy(update={"bodies": [body], "warnings": ["jet-sign"]})
    found = summary("night", [good, bad.model_copy(update={"outcome": outcome})])
    text = "".join(campaign_page.page(found))
    first, second = re.findall(r"<tr[^>]*data-state.*?</tr>", text, re.DOTALL)
    assert 'class="alarmed"' not in first
    assert second.startswith('<tr class="alarmed"')
    assert "‼ 2 contradicted" in second
    assert (
        '<td class="verdict contradicted" data-key="done, contradicted"><span class="sign" aria-hidden="true">‼</span> done, contradicted'
        in second
    )
    assert '<p class="headline red">2 done; 1 contradicted by the vehicle file; 1 with warnings (jet-sign 1)</p>' in text
    assert 'aria-label="contradicted">‼</span>−830 ' in second
    markdown = campaign_markdown.text(found, 100_000)
    assert markdown.startswith("## ‼ night: 2 logs")
    assert "| log-2 | done, contradicted | 2 quantities are contradicted (jet-sign) |" in markdown.replace("\\", "")
    told = io.StringIO()
    terminal.show(found, Console(file=told, width=400, force_terminal=True, color_system="standard", highlight=False))
    assert "\x1b[1;31m2 logs: 2 done; 1 contradicted by the vehicle file; 1 with warnings (jet-sign 1)\x1b[0m" in told.getvalue()
    assert campaign_page.counts(found) == "2 done; 1 contradicted by the vehicle file; 1 with warnings (jet-sign 1)"


def pools(found: Summary) -> dict[str, figures.Spread]:
    (group,) = grouped(found.logs).values()
    return figures.spreads(group)


def scattered(logs: int, seed: int = 5) -> Summary:
    rng = np.random.default_rng(seed)
    return summary("night", [row(n, 22.0 + 0.25 * float(rng.standard_normal())) for n in range(1, logs + 1)])


def test_each_logs_value_and_sigma_and_the_mean_are_drawn_where_they_are() -> None:
    found = scattered(12)
    picture = figures.picture(pools(found), found.pooled[0])
    (panel,) = [panel for panel in picture.panels if panel.key == "mass"]
    svg = canvas.render([panel], "svg")
    outcomes = [one.outcome for one in found.logs]
    masses = np.array([one.bodies[0].estimates["mass"].value for one in outcomes if one is not None], dtype=float)
    within = precision(svg, "mass")
    bars = drawn(svg, "mass", "mass-bars")
    assert bars[::2] == pytest.approx(np.column_stack([np.arange(1, 13), masses - 0.25]), abs=max(within))
    assert bars[1::2] == pytest.approx(np.column_stack([np.arange(1, 13), masses + 0.25]), abs=max(within))
    assert drawn(svg, "mass", "mass-mean")[:, 1] == pytest.approx(found.pooled[0].estimates["mass"].value, abs=within[1])
    slope = np.diff(drawn(svg, "mass", "mass-trend"), axis=0)[0]
    assert slope[1] / slope[0] == pytest.approx(np.polyfit(np.arange(1, 13), masses, 1)[0], rel=0.02)


def test_distances_in_sigmas_are_those_from_the_mean_of_all_other_logs() -> None:
    """x − x̄ over its own sigma is x − x̄_without over that one's: both numerator and sigma shrink alike."""
    spread = pools(scattered(9))["mass"]
    value, own = spread.samples.value, spread.samples.unshared
    others = [np.delete(value, i).mean() for i in range(9)]
    assert spread.z == pytest.approx((value - others) / (own * np.sqrt(1 + 1 / 8)))
    assert spread.within == int((np.abs(spread.z) <= 2).sum())


@pytest.mark.thorough
def test_coverage_counts_95_of_100_logs_whose_sigmas_hold() -> None:
    """Of 2,000 logs 95.4 % lie within two sigmas, ± 1.9 % at four sigma of the count."""
    told = [pools(scattered(100, seed))["mass"] for seed in range(20)]
    assert sum(one.within for one in told) / 2000 == pytest.approx(0.954, abs=0.019)
    assert re.search(r">Within 2 σ</th>", "".join(campaign_page.page(scattered(3))))


def test_what_all_logs_expect_alike_is_drawn() -> None:
    def expecting(number: int, mass: float) -> CampaignRow:
        one = row(number, 22.0 + 0.1 * number)
        assert one.outcome is not None
        body = one.outcome.bodies[0]
        item = body.estimates["mass"].model_copy(update={"expected": mass, "met": True})
        body = body.model_copy(update={"estimates": body.estimates | {"mass": item}})
        return one.model_copy(update={"outcome": one.outcome.model_copy(update={"bodies": [body]})})

    assert pools(summary("n", [expecting(n, 22.5) for n in range(3)]))["mass"].expected == 22.5
    assert pools(summary("n", [expecting(n, 22.5 + n) for n in range(3)]))["mass"].expected is None
    assert pools(summary("n", [row(1, 22.0), expecting(2, 22.5)]))["ixx"].expected is None


def test_the_worst_warning_and_the_mass_stand_beside_the_outcome() -> None:
    assert campaign_page.worst(["long-interval", "jet-sign", "delay-mismatch"]) == "jet-sign"
    assert campaign_page.worst(["outliers"]) == "outliers"
    assert campaign_page.worst([]) == ""
    text = "".join(campaign_page.page(summary("n", [row(1, 22.0, warnings=["outliers", "jet-sign"])])))
    cells = re.findall(r"<t[dh].*?</t[dh]>", text[text.index("<tbody>") :], re.DOTALL)
    outcome, mass = cells[2:4]
    assert "⚠ jet-sign" in outcome
    assert "22.00" in mass
    assert "± 0.25</span>" in mass


def test_the_table_for_a_spreadsheet_has_every_value_and_no_formula() -> None:
    found = campaign()
    rows = list(csv.DictReader(io.StringIO("".join(csv_rows(found)), newline="")))
    assert tuple(rows[0]) == columns(QUANTITIES)
    assert [one["name"] for one in rows] == [one.name for one in found.logs]
    assert [one["mass_kg"] for one in rows[:5]] == ["29.0", "28.0", "27.0", "26.0", ""]
    assert (rows[0]["mass_sigma_kg"], rows[0]["mass_verdict"], rows[0]["outcome"]) == ("0.25", "converged", "done")
    assert (rows[-1]["exit_code"], rows[-1]["mass_kg"]) == ("3", "")
    tricky = summary("n", [row(1, 22.0).model_copy(update={"name": "=1+1"})])
    assert not list(csv.reader("".join(csv_rows(tricky)).splitlines()))[1][1].startswith("=")


@pytest.mark.thorough
def test_a_page_takes_three_kilobytes_for_each_of_many_logs_at_most() -> None:
    """So that a browser takes one of a thousand logs easily."""
    assert len("".join(campaign_page.page(campaign(300))).encode()) < 300 * 3000


def shown(page: Page) -> list[str]:
    names: list[str] = page.evaluate(
        "[...document.querySelectorAll('#logs tbody tr')].filter(r => !r.hidden).map(r => r.cells[1].dataset.key)"
    )
    return names


@pytest.fixture
def page(browser: Browser, page_file: Path) -> Page:
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    opened = context.new_page()
    complaints: list[str] = []
    opened.on("console", lambda message: complaints.append(message.text))
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.goto(page_file.as_uri())
    assert complaints == []
    return opened


needs_browser = [pytest.mark.thorough, pytest.mark.browser, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")]
ORDER = [f"log-{n}" for n in range(1, 13)]


class TestInChromium:
    pytestmark = needs_browser

    def test_columns_sort_both_ways_by_number_and_by_name_and_gaps_stay_last(self, page: Page) -> None:
        assert shown(page) == [*ORDER, "bad-1", "x&y #1"]
        mass = page.get_by_role("columnheader", name=re.compile("^Mass"))
        mass.get_by_role("button").click()
        told = [name for name in reversed(ORDER) if name != "log-5"]
        assert shown(page) == [*told, "log-5", "bad-1", "x&y #1"]
        assert mass.get_attribute("aria-sort") == "ascending"
        mass.get_by_role("button").click()
        assert shown(page) == [*reversed(told), "log-5", "bad-1", "x&y #1"]
        assert mass.get_attribute("aria-sort") == "descending"
        page.get_by_role("button", name="Log", exact=True).click()
        assert shown(page) == ["bad-1", *ORDER, "x&y #1"], "log-2 goes before log-10"
        assert mass.get_attribute("aria-sort") is None
        page.get_by_role("button", name="No.").press("Enter")
        assert shown(page)[:2] == ["log-1", "log-2"]

    def test_rows_are_filtered_by_text_outcome_and_verdict(self, page: Page) -> None:
        page.get_by_label("Find").fill("log-1")
        assert shown(page) == ["log-1", "log-10", "log-11", "log-12"]
        assert page.locator("#shown").inner_text() == "4 of 14 logs"
        page.get_by_label("Find").fill("")
        page.get_by_label("Outcome").select_option("unusable")
        assert shown(page) == ["bad-1", "x&y #1"]
        page.get_by_label("Outcome").select_option("")
        page.get_by_label("Has a quantity").select_option("not_excited")
        assert shown(page) == ["log-5"]
        page.get_by_label("Find").fill("TUG gyro-units")
        assert shown(page) == ["log-5"]
        page.get_by_label("Find").fill("nothing like it")
        assert shown(page) == []

    def test_rows_are_filtered_by_warning_and_the_address_says_how(self, page: Page, browser: Browser) -> None:
        page.locator("#filter-warning").select_option("gyro-units")
        assert shown(page) == ["log-5"]
        page.locator("#filter-warning").select_option("")
        page.get_by_label("Find").fill("log-1")
        page.get_by_role("columnheader", name=re.compile("^Mass")).get_by_role("button").click()
        assert page.url.endswith("#text=log-1&sort=3%2B")
        again = browser.new_context().new_page()
        again.goto(page.url)
        assert shown(again) == ["log-12", "log-11", "log-10", "log-1"]
        assert again.locator("#shown").inner_text() == "4 of 14 logs"

    def test_on_paper_the_page_lies_on_its_side(self, page: Page) -> None:
        boxes = re.findall(rb"/MediaBox ?\[0 0 ([\d.]+) ([\d.]+)\]", page.pdf(prefer_css_page_size=True))
        assert boxes
        assert all(float(wide) > float(high) for wide, high in boxes)

    def test_links_lead_to_each_result(self, page: Page) -> None:
        page.get_by_role("link", name="log-7").click()
        assert json.loads(page.inner_text("body")) == {"n": 7}

    @pytest.mark.parametrize("scheme", ["light", "dark"])
    @pytest.mark.parametrize("width", [390, 1280])
    def test_the_page_loads_nothing_and_is_as_wide_as_its_screen(self, browser: Browser, page_file: Path, scheme: str, width: int) -> None:
        context = browser.new_context(viewport={"width": width, "height": 844}, color_scheme="dark" if scheme == "dark" else "light")
        opened = context.new_page()
        requests: list[str] = []
        opened.on("request", lambda request: requests.append(request.url))
        opened.goto(page_file.as_uri())
        assert [url for url in requests if not url.startswith("data:")] == [page_file.as_uri()]
        assert opened.evaluate("document.documentElement.scrollWidth") <= width
        context.close()

    def test_without_scripts_it_is_a_plain_table(self, browser: Browser, page_file: Path) -> None:
        context = browser.new_context(java_script_enabled=False)
        opened = context.new_page()
        opened.goto(page_file.as_uri())
        assert opened.locator("#logs tbody tr").count() == 14
        assert opened.locator("#logs button").count() == 0
        assert not opened.locator("#filters").is_visible()
        context.close()
