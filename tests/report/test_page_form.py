"""What a page is made of: nothing from elsewhere, colours that can be read, text that stays text, the same bytes."""

import base64
import hashlib
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massprop_cli.report import digits, figures, html
from massprop_cli.report.figures import palette
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import WarningItem
from tests import recorded
from tests.report.page import Page

HOSTILE = (
    ' style="x" /* drawings */</style></title></svg><script>alert(1)</script><img src=x onerror=alert(1)>"\'&{{7*7}}\x00\x1b\u202e\ud800'
)


def restless(docking: Recorded, phases: int) -> Recorded:
    """Two thousand cycles in which every column is as restless as can be, of a vehicle, a log and phases with hostile names."""
    rng, old = np.random.default_rng(3), docking.result
    rows, names = 2000 // phases, [f"{HOSTILE}{number}" for number in range(phases)]
    history = {}
    for number, name in enumerate(names):
        columns = {column: 1 + 0.5 * rng.standard_normal(rows) for column in docking.history[old.phases[0].name]}
        history[name] = columns | {"time_s": 0.05 * (np.arange(1, rows + 1) + number * rows)}
    changes = {
        "phases": [old.phases[number % 2].model_copy(update={"name": name}) for number, name in enumerate(names)],
        "vehicle": old.vehicle.model_copy(update={"name": HOSTILE}),
        "log": old.log.model_copy(update={"path": HOSTILE}),
        "warnings": [WarningItem(code=HOSTILE, message=HOSTILE)],
        "provenance": old.provenance.model_copy(
            update={"input_sha256": HOSTILE, "settings": {HOSTILE: HOSTILE}, "versions": {HOSTILE: HOSTILE}}
        ),
    }
    return replace(docking, result=old.model_copy(update=changes), history=history)


@pytest.fixture(scope="module")
def page(docking: Recorded) -> Page:
    """A whole page, figures and all, of the worst log: what holds here holds of others."""
    return Page(html.page([restless(docking, 2)]))


def test_every_figure_is_there_with_text_for_those_who_dont_see_it(page: Page) -> None:
    pictures = [found for tag, found in page.tags if tag == "svg"]
    told = [found["aria-label"] or "" for found in pictures]
    assert len(pictures) == 2 * (20 + 1 + 1 + 4) + 1 + 5 * 6 + 1 + 4 * 3
    assert all(found["role"] == "img" for found in pictures)
    assert all(len(text) > 30 for text in told)
    assert len(set(told)) == len(told)
    anchors = {re.sub(r"\d$", "", name) for name in page.ids if name.startswith("figure-")}
    assert anchors == {f"figure-{name}" for name in figures.NAMES} - {"figure-expectations"} | {"figure-correlation-docked"}
    assert sum(tag == "figcaption" for tag, _ in page.tags) == sum(tag == "figure" for tag, _ in page.tags)


def test_ids_are_unique_and_every_reference_meets_one(page: Page) -> None:
    assert len(set(page.ids)) == len(page.ids)
    inner = [link[1:] for link in page.links if link.startswith("#")] + re.findall(r"url\(#([^)]*)\)", page.text)
    assert set(inner) <= set(page.ids)


def test_figures_in_the_page_are_whole_and_take_the_pages_colours(page: Page) -> None:
    svgs = re.findall(r"<svg.*?</svg>", page.text, re.DOTALL)
    for svg in svgs:
        ET.fromstring(svg)
        assert "DejaVu" not in svg
    rules = dict(re.findall(r"^\.(d\d+) \{ (.*) \}$", page.text, re.MULTILINE))
    assert set(re.findall(r'class="(d\d+)"', "".join(svgs))) == set(rules)
    assert not [found for _, found in page.tags if "style" in found]
    assert not re.findall(r"#[0-9a-f]{6}\b", "".join([*svgs, *rules.values()]))
    tones = set(re.findall(r"var\(--(\w+)\)", "".join(rules.values())))
    assert {"ink", "paper", "blue"} <= tones <= {*palette.NAMES.values(), "font"}


def test_the_page_loads_nothing_and_turns_dark_on_a_screen_only(page: Page) -> None:
    assert "http" not in page.text.replace("http-equiv", "")
    assert "default-src 'none'" in page.text
    assert not [tag for tag, _ in page.tags if tag in ("img", "iframe", "object", "base")]
    assert [found for tag, found in page.tags if tag == "script"] == [{}, {}, {}]
    assert foreign(page) == []
    assert all(link.startswith("#") or link == "data:," for link in page.links)
    assert page.text.count("url(") == page.text.count("url(#")
    dark = re.search(r"@media screen and \(prefers-color-scheme: dark\) \{ :root \{(.*?)\}", page.text)
    assert dark
    assert "--paper: #14181d" in dark[1]
    assert "@media print" in page.text
    assert 'name="viewport" content="width=device-width' in page.text


def foreign(page: Page) -> list[str]:
    """Scripts that the page's policy does not allow by their digest."""
    policy = next(found["content"] or "" for tag, found in page.tags if found.get("http-equiv") == "Content-Security-Policy")
    texts = re.findall(r"<script>(.*?)</script>", page.text, re.DOTALL)
    assert page.text.count("<script") == len(texts)
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts]
    return [text for text, digest in zip(texts, digests, strict=True) if f"'sha256-{digest}'" not in policy]


def contrast(colour: str, ground: str) -> float:
    """Ratio of WCAG 2."""

    def luminance(code: str) -> float:
        parts = np.array([int(code[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        linear = np.where(parts <= 0.03928, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    low, high = sorted([luminance(colour), luminance(ground)])
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("colour", [palette.INK, palette.MUTED, palette.BLUE, palette.ORANGE, palette.GREEN, palette.PURPLE, palette.RED])
def test_text_and_lines_stand_out_from_their_ground_in_light_and_dark(colour: str) -> None:
    least = 4.5 if colour in (palette.INK, palette.MUTED, palette.RED) else 3.0
    for ground in (palette.PAPER, palette.SHADE):
        assert contrast(colour, ground) >= least
        assert contrast(palette.DARK[colour], palette.DARK[ground]) >= least


@pytest.mark.usefixtures("blank_figures")
def test_the_same_result_gives_the_same_bytes_without_where_and_when(flyer: Recorded, flyer_page: Page, tmp_path: Path) -> None:
    assert html.page([replace(flyer, path=tmp_path / "elsewhere" / "result.json")]) == flyer_page.text
    assert str(flyer.path.parent) not in flyer_page.text


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("name", ["bearing", "thesis"])
def test_every_figure_of_any_log_can_be_drawn(name: str, request: pytest.FixtureRequest) -> None:
    found = Page(html.page([request.getfixturevalue(name)]))
    assert sum(tag == "svg" for tag, _ in found.tags) == 69
    assert foreign(found) == []


def test_a_page_of_two_thousand_cycles_is_below_one_and_a_half_megabytes(page: Page) -> None:
    assert len(page.text.encode()) < 1.5e6


def harmless(page: Page) -> None:
    """What is hostile is only text."""
    assert not [tag for tag, _ in page.tags if tag == "img"]
    assert foreign(page) == []
    assert not [found for _, found in page.tags if "onerror" in found]
    assert "{{7*7}}" in page.said()
    assert not set(page.text) & set("\x00\x1b\u202e\ud800")
    page.text.encode()
    for svg in re.findall(r"<svg.*?</svg>", page.text, re.DOTALL):
        ET.fromstring(svg)


def test_hostile_names_are_only_text(page: Page) -> None:
    harmless(page)


@pytest.mark.thorough
def test_hostile_names_are_only_text_beside_another_result(docking: Recorded) -> None:
    harmless(Page(html.page([restless(docking, 2), docking])))


@pytest.mark.usefixtures("blank_figures")
def test_hostile_causes_settings_and_assumptions_are_only_text(flyer: Recorded) -> None:
    mended = recorded.mended(HOSTILE) | {"code": HOSTILE, "message": HOSTILE, "settings": [HOSTILE]}
    hostile = [one | {"code": HOSTILE, "message": HOSTILE, "step": HOSTILE} for one in recorded.assumptions(HOSTILE)]
    found = recorded.result([recorded.contradicted(contradiction=HOSTILE)], mended=[mended], assumptions=hostile)
    for several in ([replace(flyer, result=found)], [flyer, replace(flyer, result=found)]):
        harmless(Page(html.page(several)))


@pytest.mark.parametrize(("text", "shown"), [("-0.00", "0.00"), ("-1e-05", "−1e−05"), ("-0.10", "−0.10"), ("0", "0")])
def test_minus_signs_are_real_and_zero_has_none(text: str, shown: str) -> None:
    assert digits.minus(text) == shown
