from __future__ import annotations

import base64
import hashlib
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.report import checks, figures, html, limiting, view, vocabulary
from massprop_cli.report.figures import palette
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import Delay, Innovations, Mended, PhaseItem, WarningItem
from tests import recorded
from tests.recording import changed, record
from tests.report.page import Page


@pytest.fixture(scope="module")
def refined(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("refined"), "scenarios/refined/log.parquet")


@pytest.fixture(scope="module")
def bearing(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("bearing"), "air-bearing/log.parquet")


@pytest.fixture(scope="module")
def flyer_page(flyer: Recorded) -> Page:
    return Page(html.page([flyer]))


@pytest.fixture(scope="module")
def docking_page(docking: Recorded) -> Page:
    return Page(html.page([docking]))


def test_the_first_table_holds_every_value_with_sigma_unit_and_verdict(flyer: Recorded, flyer_page: Page) -> None:
    header, *rows = flyer_page.table("Whole log, 0 to 60 s")
    assert header == ["Quantity", "Value", "± sigma (thrust taken as exact)", "in %", "Unit", "Verdict", "Final at", "Limited by"]
    assert len(rows) == 10
    for row, (name, item) in zip(rows, flyer.result.phases[0].estimates.items(), strict=True):
        value, sigma, final = float(row[1].replace("−", "-")), float(row[2].lstrip("± ")), float(row[6].rstrip(" s"))
        assert row[0] == vocabulary.SYMBOLS[name]
        assert item.value is not None
        assert item.sigma is not None
        assert value == pytest.approx(item.value, abs=0.06 * item.sigma)
        assert sigma == pytest.approx(item.sigma, rel=0.06)
        assert float(row[3].rstrip(" %")) == pytest.approx(100 * item.sigma / abs(item.value), rel=0.06)
        assert row[4].replace("²", "^2") == item.unit
        assert row[5] == "✓ converged"
        assert final == pytest.approx(item.final_at_s, abs=0.006)


def test_vehicle_verdicts_and_warnings_come_before_the_figures(refined: Recorded) -> None:
    text = html.page([refined])
    first = text.index("<svg")
    for said in (refined.result.vehicle.name, "9 of 10 quantities converged", 'class="glance"', "unphysical-inertia", "± sigma"):
        assert text.index(said, text.index("<body")) < first


def test_what_is_not_converged_is_explained_with_its_cure(flyer: Recorded) -> None:
    lost = changed(flyer, "izz", {"verdict": "not_excited", "reason": "the motion in this phase hardly informed it"})
    lost = changed(lost, "cg_x", {"verdict": "unobservable", "value": None, "sigma": None, "final_at_s": None})
    page = Page(html.page([lost]))
    _, izz, cg_x = page.table("Quantities that are not converged")
    assert izz == ["Izz", "○ not excited", "the motion in this phase hardly informed it", "torque about Z"]
    assert cg_x[:2] == ["CG x", "✕ unobservable"]
    assert cg_x[3].startswith("force across X (along Y or Z), or fast turns about Y or Z")
    assert page.table("Whole log")[7][1:3] == ["–", "± –"]
    assert "8 of 10 quantities converged" in page.said()
    assert vocabulary.VERDICTS["unobservable"] in page.said()


def test_a_contradiction_stands_in_red_before_anything_else_and_no_motion_cures_it(flyer: Recorded) -> None:
    phase = PhaseItem.model_validate(recorded.contradicted())
    text = html.page([replace(flyer, result=flyer.result.model_copy(update={"phases": [phase]}))])
    page = Page(text)
    summary = text[text.index('<section id="summary"') :]
    assert summary.index('class="alarm"') < summary.index(recorded.CAUSE) < summary.index("0 of 10 quantities converged, 7 contradicted")
    assert "7 of 10 quantities contradicted" in page.said()
    assert re.search(r"\.alarm .*var\(--red\)", text)
    assert page.table("Whole log")[1][:6] == ["Ixx", "−830", "± 4.0", "", "kg m²", "‼ contradicted"]
    cures = {row[0]: row[1:] for row in page.table("Quantities that are not converged")[1:]}
    assert cures["Ixx, Ixy, Ixz, Iyy, Iyz, CG z, Mass"] == ["‼ contradicted", recorded.CAUSE, "mend the cause; no motion cures it"]
    assert cures["Izz"] == ["○ not excited", "the motion in this phase hardly informed it", "mend what contradicts this phase first"]
    assert cures["CG x"][2] == "mend what contradicts this phase first"
    assert "can't give it" in cures["CG y"][2]
    assert vocabulary.VERDICTS["contradicted"] in page.said()
    fine = html.page([flyer])
    assert 'class="alarm"' not in fine


def test_a_contradicted_docked_object_is_named_though_its_phases_are_fine(docking: Recorded) -> None:
    assert docking.result.docked_object is not None
    docked = docking.result.docked_object.model_copy(update={"contradiction": "phase single is contradicted"})
    page = Page(html.page([replace(docking, result=docking.result.model_copy(update={"docked_object": docked}))]))
    assert "Docked object: combined less single: 0 of 10 quantities contradicted phase single is contradicted" in page.said()


def test_a_comparison_marks_the_result_that_is_contradicted(flyer: Recorded) -> None:
    bad = replace(flyer, result=recorded.result([recorded.contradicted()]))
    text = html.page([flyer, bad])
    _, good, wrong = Page(text).table("All results")
    assert "contradicted" not in "".join(good)
    assert "‼ contradicted" in wrong[1]
    assert wrong[2].startswith("‼contradicted, −830")
    assert text.count('<tr class="alarmed">') == 1
    assert text.count('class="alarm"') == 1


def test_the_mended_answer_stands_apart_with_the_settings_to_give(flyer: Recorded) -> None:
    found = recorded.result([recorded.contradicted()], mended=[recorded.mended()], assumptions=recorded.assumptions())
    page = Page(html.page([replace(flyer, result=found)]))
    assert page.table("Mended")[1] == ["Ixx", "0.620", "± 0.010", "kg m²", "✓ converged"]
    assert page.table("Whole log")[1][1] == "−830"
    assert "--set 'jets.roll_p1.force_n=[0.0, 0.0, -1.112]' --set cycle.command_delay_cycles=2.0" in page.said()
    assert {"#mended", "#assumptions"} <= set(page.links)
    assert {"mended", "assumptions"} <= set(page.ids)
    assert "What the log gives if it is mended" in page.said()
    assert "still contradicted" not in page.said()
    odd = found.model_copy(update={"mended": [Mended.model_validate(recorded.mended("the rates don't add up"))]})
    assert "still contradicted: the rates don't add up" in Page(html.page([replace(flyer, result=odd)])).said()


def test_assumptions_are_part_of_the_page_with_what_one_step_changes(flyer: Recorded) -> None:
    scale = {"by": "known.mass", "value": 1.034, "sigma": 0.0021}
    phase = recorded.phase() | {"implied_thrust_scale": scale}
    page = Page(html.page([replace(flyer, result=recorded.result([phase], assumptions=recorded.assumptions()))]))
    rows = page.table("What one step changes")
    assert rows[0] == ["Quantity", "Unit", "thrust-scale1 %", "imu-position1 mm", "pulse-shape1 ms"]
    assert rows[3] == ["Ixz", "kg m²", "−0.00070", "–", "–"]
    assert rows[-1] == ["the log would notice", "no", "hardly, 2.1 σ", "yes, 12 σ"]
    assert "Thrust rises at once [pulse-shape, a default]" in page.said()
    assert page.table("Whole log")[0][2] == "± sigma (thrust taken as exact)"
    assert "The known mass implies 1.0340 ± 0.0021 of the stated thrust." in page.said()


def test_nominal_and_expected_values_stand_beside_the_estimate(flyer: Recorded) -> None:
    wanted = {"value": 0.63, "tolerance": 0.001, "stated": "0.001", "met": False, "difference": -0.01, "sigmas": -2968.2}
    page = Page(html.page([changed(flyer, "ixx", {"nominal": 0.615, "expected": wanted})]))
    header, ixx, ixy, *_ = page.table("Whole log")
    assert header[-4:] == ["Nominal", "Expected", "Off by (in %, in σ)", "Limited by"]
    assert ixx[-4:-1] == ["0.615", "0.63 ± 0.001 ✕ missed", "−0.0100000 (−1.6 %, −2968.2 σ)"]
    assert ixy[-4:-1] == ["", "", ""]
    assert "outside its expectation: Ixx" in page.said()


def cells(rows: list[list[str]]) -> np.ndarray:
    return np.array([[float(cell.replace("−", "-")) for cell in row[1:]] for row in rows[1:]])


def test_the_matrix_is_printed_about_cg_and_o_in_both_conventions(flyer: Recorded, flyer_page: Page) -> None:
    about_cg, other = cells(flyer_page.table("About the CG, tensor")), cells(flyer_page.table("About the CG, positive integral"))
    about_o = cells(flyer_page.table("About O, tensor"))
    assert about_cg == pytest.approx(about_cg.T)
    assert about_cg[0] == pytest.approx([0.62, 0.04, -0.07], abs=2e-5)
    assert np.diag(other) == pytest.approx(np.diag(about_cg))
    assert other[0, 1:] == pytest.approx(-about_cg[0, 1:])
    stored = np.array(flyer.result.phases[0].inertia_about_origin, dtype=float)
    assert about_o == pytest.approx(stored, rel=2e-4)
    c = np.array([-0.018, 0.027, 0.012])
    assert about_o - about_cg == pytest.approx(22 * (c @ c * np.eye(3) - np.outer(c, c)), rel=0.1, abs=1e-4)
    assert "products are the tensor's own elements, ixy = −Σ m x y" in flyer_page.said()


def test_values_without_a_usable_verdict_are_dimmed_and_have_two_figures_in_every_matrix(flyer: Recorded) -> None:
    lost = changed(flyer, "ixy", {"verdict": "contradicted"})
    text = html.page([lost])
    page = Page(text)
    assert page.table("Whole log")[2][1] == "0.040"
    for caption in ("About the CG, tensor", "About O, tensor"):
        assert page.table(caption)[1][2] == page.table(caption)[2][1]
        assert len(page.table(caption)[1][2]) == len("0.040") < len(page.table(caption)[1][1])
    assert text.count('<td class="rough">') == 2 * 4
    moments = [row[1] for row in page.table("Principal moments and axes")[1:]]
    assert moments == ["0.62", "2.5", "2.8"]
    whole = Page(html.page([changed(flyer, "cg_x", {"verdict": "contradicted"})]))
    assert len(whole.table("About O, tensor")[1][1]) == len("0.64") < len(whole.table("About the CG, tensor")[1][1])


def test_principal_moments_and_axes_rebuild_the_inertia(flyer_page: Page) -> None:
    rows = flyer_page.table("Principal moments and axes")[1:]
    numbers = np.array([[float(cell.replace("−", "-").lstrip("± ")) for cell in row[1:6]] for row in rows])
    moments, axes = numbers[:, 0], numbers[:, 2:].T
    assert axes @ np.diag(moments) @ axes.T == pytest.approx(cells(flyer_page.table("About the CG, tensor")), abs=1e-4)


def test_an_unphysical_inertia_stands_beside_the_nearest_that_a_body_could_have(refined: Recorded) -> None:
    page = Page(html.page([refined]))
    nearest = cells(page.table("Nearest consistent, about the CG, tensor"))
    low, middle, high = np.linalg.eigvalsh(nearest)
    assert low + middle >= high * 0.999
    assert nearest == pytest.approx(np.array(refined.result.phases[0].physical.nearest_consistent, dtype=float), rel=1e-3)
    assert page.captions.count("About the CG, tensor") == 2
    assert "No real body has this inertia: the inertia breaks the triangle inequality" in page.said()


def test_the_docked_object_has_its_own_table(docking: Recorded, docking_page: Page) -> None:
    found = docking.result.docked_object
    assert found is not None
    mass = docking_page.table("Docked object: combined less single")[10]
    assert float(mass[1]) == pytest.approx(found.estimates["mass"].value, abs=0.01)
    assert float(docking_page.table("Phase combined")[10][1]) - float(docking_page.table("Phase single")[10][1]) == pytest.approx(
        float(mass[1]), abs=0.01
    )


def test_on_a_bearing_the_page_says_whose_mass_and_inertia_these_are(bearing: Recorded) -> None:
    said = Page(html.page([bearing])).said()
    assert "Inertia is the rotating body's about its CG" in said
    assert "Mass includes the bearing's 5 kg, which does not rotate" in said
    assert "air bearing" in said


def test_the_docked_object_has_matrices_axes_and_correlations_as_a_phase_has(docking: Recorded, docking_page: Page) -> None:
    found = docking.result.docked_object
    assert found is not None
    values = {name: item.value or 0.0 for name, item in found.estimates.items()}
    text = docking_page.text[docking_page.text.index('<section id="body-docked"') :]
    page = Page(text[: text.index("</section>") + len("</section>")])
    about_cg, about_o = cells(page.table("About the CG, tensor")), cells(page.table("About O, tensor"))
    c = np.array([values[f"cg_{axis}"] for axis in "xyz"])
    assert about_cg[1, 1] == pytest.approx(values["iyy"], rel=1e-3)
    assert about_o - about_cg == pytest.approx(values["mass"] * (c @ c * np.eye(3) - np.outer(c, c)), rel=0.01, abs=0.01)
    moments = [float(row[1]) for row in page.table("Principal moments and axes")[1:]]
    assert moments == pytest.approx(list(np.linalg.eigvalsh(about_cg)), rel=1e-3)
    told = page.table("Correlations of the ten estimates")
    covariance = np.array(found.covariance, dtype=float)
    assert float(told[1][4].replace("−", "-")) == pytest.approx(covariance[0, 3] / np.sqrt(covariance[0, 0] * covariance[3, 3]), abs=0.006)
    assert sum(tag == "svg" for tag, _ in page.tags) == 1


def test_each_value_says_what_limits_it() -> None:
    """One percent of thrust moves the inertia by far more than its noise, a wrong place the CG; nothing but noise the mass."""
    scale, place, *_ = recorded.assumptions()
    made = [scale | {"effects": [{"phase": "all", "change": {"ixx": 0.0062, "mass": 0.22}, "seen_sigma": None}]}]
    made += [place | {"effects": [{"phase": "all", "change": {"cg_x": 0.001}, "seen_sigma": seen}]} for seen in (2.0, 300.0)]
    items: dict[str, Any] = {"ixx": {"sigma": 3e-6}, "cg_x": {"sigma": 3e-6}, "cg_y": {"verdict": "not_excited"}, "mass": {"sigma": 0.3}}
    (table,) = view.tables(recorded.result([recorded.phase(**items)], assumptions=made))
    limits = {row.symbol: row.limit for row in table.rows}
    assert limits["Ixx"] == "thrust scale, 1 %: 0.0062"
    assert limits["CG x"] == "geometry: IMU position, 1 mm: 0.0010"
    assert limits["Mass"] == limits["Iyy"] == "noise"
    assert limits["CG y"] == ""
    (noticed,) = view.tables(recorded.result([recorded.phase(**items)], assumptions=made[2:]))
    assert noticed.rows[6].limit == "noise"


def test_a_stated_thrust_scale_is_the_limit_where_it_is_most_of_the_sigma() -> None:
    made = [recorded.assumptions()[0] | {"effects": [{"phase": "all", "change": {"mass": 0.22, "ixx": 0.0062}, "seen_sigma": None}]}]
    found = recorded.result([recorded.phase(mass={"sigma": 0.48}, ixx={"sigma": 0.1})], assumptions=made)
    found = found.model_copy(update={"vehicle": found.vehicle.model_copy(update={"thrust_scale_sigma": 0.02})})
    said = {name: limiting.limit(name, found.phases[0], found) for name in ("mass", "ixx")}
    assert [one.said for one in said.values() if one is not None] == ["thrust scale", "noise"]


def test_every_figure_is_there_with_text_for_those_who_dont_see_it(docking_page: Page) -> None:
    pictures = [found for tag, found in docking_page.tags if tag == "svg"]
    told = [found["aria-label"] or "" for found in pictures]
    assert len(pictures) == 2 * (20 + 1 + 1 + 4) + 1 + 5 * 6 + 1 + 4 * 3
    assert all(found["role"] == "img" for found in pictures)
    assert all(len(text) > 30 for text in told)
    assert len(set(told)) == len(told)
    anchors = {re.sub(r"\d$", "", name) for name in docking_page.ids if name.startswith("figure-")}
    assert anchors == {f"figure-{name}" for name in figures.NAMES} - {"figure-expectations"} | {"figure-correlation-docked"}
    assert sum(tag == "figcaption" for tag, _ in docking_page.tags) == sum(tag == "figure" for tag, _ in docking_page.tags)


def test_ids_are_unique_and_every_reference_meets_one(docking_page: Page) -> None:
    assert len(set(docking_page.ids)) == len(docking_page.ids)
    inner = [link[1:] for link in docking_page.links if link.startswith("#")] + re.findall(r"url\(#([^)]*)\)", docking_page.text)
    assert set(inner) <= set(docking_page.ids)


def test_figures_in_the_page_are_whole_and_take_the_pages_colours(docking_page: Page) -> None:
    svgs = re.findall(r"<svg.*?</svg>", docking_page.text, re.DOTALL)
    for svg in svgs:
        ET.fromstring(svg)
        assert "DejaVu" not in svg
    rules = dict(re.findall(r"^\.(d\d+) \{ (.*) \}$", docking_page.text, re.MULTILINE))
    assert set(re.findall(r'class="(d\d+)"', "".join(svgs))) == set(rules)
    assert " style=" not in "".join(svgs)
    assert not re.findall(r"#[0-9a-f]{6}\b", "".join([*svgs, *rules.values()]))
    tones = set(re.findall(r"var\(--(\w+)\)", "".join(rules.values())))
    assert {"ink", "paper", "blue"} <= tones <= {*palette.NAMES.values(), "font"}


def test_the_page_loads_nothing_and_turns_dark_on_a_screen_only(docking_page: Page) -> None:
    assert "http" not in docking_page.text.replace("http-equiv", "")
    assert "default-src 'none'" in docking_page.text
    assert not [tag for tag, _ in docking_page.tags if tag in ("img", "iframe", "object", "base")]
    assert [found for tag, found in docking_page.tags if tag == "script"] == [{}, {}]
    assert foreign(docking_page) == []
    assert all(link.startswith("#") or link == "data:," for link in docking_page.links)
    assert docking_page.text.count("url(") == docking_page.text.count("url(#")
    dark = re.search(r"@media screen and \(prefers-color-scheme: dark\) \{ :root \{(.*?)\}", docking_page.text)
    assert dark
    assert "--paper: #14181d" in dark[1]
    assert "@media print" in docking_page.text
    assert 'name="viewport" content="width=device-width' in docking_page.text


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


def test_the_same_result_gives_the_same_bytes_without_where_and_when(flyer: Recorded, flyer_page: Page, tmp_path: Path) -> None:
    assert html.page([replace(flyer, path=tmp_path / "elsewhere" / "result.json")]) == flyer_page.text
    assert str(flyer.path.parent) not in flyer_page.text


@pytest.mark.parametrize("phases", [1, 2, pytest.param(6, marks=pytest.mark.slow)])
def test_a_log_of_two_thousand_cycles_makes_a_page_below_one_and_a_half_megabytes(docking: Recorded, phases: int) -> None:
    """Every column as restless as can be."""
    rng = np.random.default_rng(3)
    one, rows = docking.result.phases[0], 2000 // phases
    history = {}
    for number in range(phases):
        columns = {name: 1 + 0.5 * rng.standard_normal(rows) for name in docking.history[one.name]}
        history[f"part {number}"] = columns | {"time_s": 0.05 * (np.arange(1, rows + 1) + number * rows)}
    items = [one.model_copy(update={"name": name}) for name in history]
    assert len(html.page([replace(docking, result=docking.result.model_copy(update={"phases": items}), history=history)]).encode()) < 1.5e6


def test_without_a_history_the_rest_is_there_and_the_gap_is_named(flyer: Recorded) -> None:
    page = Page(html.page([replace(flyer, history={})]))
    assert page.said().count("This figure needs history.parquet") == 5 + 5 + 5
    assert sum(tag == "svg" for tag, _ in page.tags) == 4 + 1
    assert len(page.table("Whole log")) == 11


def test_a_thesis_result_says_that_its_sigmas_are_no_errors(tmp_path: Path) -> None:
    page = Page(html.page([record(tmp_path, "free-flyer/log.parquet", 'estimator.method="thesis"')]))
    assert "they shrink with noise alone and are no errors" in page.said()
    assert "± is one standard deviation" not in page.said()
    assert "--method thesis" in page.said()
    assert sum(tag == "svg" for tag, _ in page.tags) == 20 + 1 + 1 + 4 + 5 * 6 + 1 + 4 * 3


HOSTILE = (
    ' style="x" /* drawings */</style></title></svg><script>alert(1)</script><img src=x onerror=alert(1)>"\'&{{7*7}}\x00\x1b\u202e\ud800'
)


def test_hostile_names_are_only_text(docking: Recorded) -> None:
    old = docking.result
    phases = [phase.model_copy(update={"name": HOSTILE + phase.name}) for phase in old.phases]
    changes = {
        "phases": phases,
        "vehicle": old.vehicle.model_copy(update={"name": HOSTILE}),
        "log": old.log.model_copy(update={"path": HOSTILE}),
        "warnings": [WarningItem(code=HOSTILE, message=HOSTILE)],
        "provenance": old.provenance.model_copy(
            update={"input_sha256": HOSTILE, "settings": {HOSTILE: HOSTILE}, "versions": {HOSTILE: HOSTILE}}
        ),
    }
    hostile = replace(
        docking, result=old.model_copy(update=changes), history={HOSTILE + name: columns for name, columns in docking.history.items()}
    )
    for text in (html.page([hostile]), html.page([hostile, docking])):
        page = Page(text)
        assert not [tag for tag, _ in page.tags if tag == "img"]
        assert foreign(page) == []
        assert not [found for _, found in page.tags if "onerror" in found]
        assert "{{7*7}}" in page.said()
        assert not set(text) & set("\x00\x1b\u202e\ud800")
        text.encode()
        for svg in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
            ET.fromstring(svg)


def test_hostile_causes_settings_and_assumptions_are_only_text(flyer: Recorded) -> None:
    mended = recorded.mended(HOSTILE) | {"code": HOSTILE, "message": HOSTILE, "settings": [HOSTILE]}
    hostile = [one | {"code": HOSTILE, "message": HOSTILE, "step": HOSTILE} for one in recorded.assumptions(HOSTILE)]
    found = recorded.result([recorded.contradicted(contradiction=HOSTILE)], mended=[mended], assumptions=hostile)
    for text in (html.page([replace(flyer, result=found)]), html.page([flyer, replace(flyer, result=found)])):
        page = Page(text)
        assert not [tag for tag, _ in page.tags if tag == "img"]
        assert foreign(page) == []
        assert not [attributes for _, attributes in page.tags if "onerror" in attributes]
        assert "{{7*7}}" in page.said()
        assert not set(text) & set("\x00\x1b\u202e\ud800")
        text.encode()


def test_provenance_names_hashes_versions_and_where_settings_came_from(flyer: Recorded, flyer_page: Page) -> None:
    provenance = flyer.result.provenance
    told = flyer_page.table("Provenance")
    assert [row[1] for row in told[1:3]] == [provenance.input_sha256, provenance.vehicle_sha256]
    assert all(version in told[3][1] for version in provenance.versions.values())
    settings = {row[0]: row[1:] for row in flyer_page.table("Settings")[1:]}
    assert set(settings) == set(provenance.settings)
    assert settings["imu.gyro_noise_rad_s"] == ["0.0001", "vehicle file"]
    assert settings["estimator.bins_per_cycle"][1] == "default"


def test_innovations_are_held_against_what_chance_leaves(flyer: Recorded, flyer_page: Page) -> None:
    rows = flyer_page.table("Whitened innovations")[1:]
    found = flyer.result.phases[0].innovations
    assert found is not None
    assert len(rows) == 19
    assert "The model fits the log: 19 of 19 checks hold" in flyer_page.said()
    assert float(rows[0][1]) == pytest.approx(found.nis, rel=1e-2)
    assert all(row[3] == "✓" for row in rows)
    wrong = Innovations(cycles=1000, nis=9.0, channel_variance=[1, 1, 1.4, 1, 1, 1], lag_one_correlation=[0, 0, 0, 0.3, 0, 0])
    assert [check.what for check in checks.innovations(wrong) if not check.inside] == [
        "normalised innovation squared, all six channels", "variance, rate Z", "correlation from cycle to cycle, specific force X",
    ]  # fmt: skip


def test_what_commands_explain_of_innovations_has_no_allowance() -> None:
    odd = Innovations(
        cycles=1000, nis=6.0, channel_variance=[1.0] * 6, lag_one_correlation=[0.0] * 6, lack_of_fit=[1.0, 1.0, 1.7, 1.0, 1.0, 1.0]
    )
    (outside,) = [check for check in checks.innovations(odd) if not check.inside]
    assert outside.cells == ("what commands and motion explain of its innovations, rate Z", "1.7", "1")


def test_the_allowance_of_a_check_is_that_of_a_random_sample() -> None:
    z = np.random.default_rng(5).standard_normal((2000, 300, 6))
    allowed = {
        check.what: check.allowance / checks.COUNT
        for check in checks.innovations(Innovations(cycles=300, nis=6.0, channel_variance=[1.0] * 6, lag_one_correlation=[0.0] * 6))
    }
    assert allowed["normalised innovation squared, all six channels"] == pytest.approx((z**2).sum(2).mean(1).std(), rel=0.06)
    assert allowed["variance, rate X"] == pytest.approx((z[..., 0] ** 2).mean(1).std(), rel=0.06)
    assert allowed["correlation from cycle to cycle, rate X"] == pytest.approx((z[:, 1:, 0] * z[:, :-1, 0]).mean(1).std(), rel=0.06)


def test_the_delay_is_shown_with_what_the_log_says_of_it() -> None:
    rows = dict(checks.delay(Delay(cycles=2.0, source="vehicle", detected_cycles=1.5, sigma_cycles=0.01)))
    assert rows["used"] == "2 cycles, stated by the vehicle file"
    assert rows["detected in the log"] == "1.5 ± 0.01 cycles"
    assert rows["detected less used"] == "−0.5 cycles, −50.0 sigma"
    assert dict(checks.delay(Delay(cycles=0.0, source="option")))["detected in the log"].startswith("not looked for")


def test_several_results_are_compared_and_linked(flyer: Recorded, docking: Recorded, refined: Recorded) -> None:
    page = Page(html.page([flyer, docking, refined]))
    header, *rows = page.table("All results")
    assert header[2:12] == [
        f"{vocabulary.SYMBOLS[name]} [{vocabulary.unit(flyer.result.phases[0].estimates[name].unit)}]" for name in QUANTITIES
    ]
    assert len(rows) == 1 + 3 + 1
    assert [row[0] for row in rows] == ["1", "2", "3", "4", "5"]
    value = flyer.result.phases[0].estimates["ixx"].value
    assert value is not None
    assert rows[0][2].startswith("✓converged, 0.62000")
    assert "not converged" in rows[4][11]
    assert rows[4][12] == "unphysical-inertia"
    assert {"#result-1", "#result-2", "#result-3"} <= set(page.links)
    assert {"result-1", "result-2", "result-3"} <= set(page.ids)
    assert len(set(page.ids)) == len(page.ids)
    pictures = [found["aria-label"] for tag, found in page.tags if tag == "svg"]
    assert len(pictures) == 3 * 10, "one axis for each vehicle"
    assert str(pictures[0]).startswith("Ixx of 1 results with error bars: 1 have a value")
    assert str(pictures[10]).startswith("Ixx of 3 results with error bars: 3 have a value")
    assert page.text == html.page([flyer, docking, refined])


def test_results_of_one_vehicle_are_named_on_the_axis_with_their_differences_from_the_first(flyer: Recorded, docking: Recorded) -> None:
    heavier = changed(flyer, "mass", {"value": 22.5, "sigma": 0.4})
    lost = changed(flyer, "mass", {"verdict": "not_excited"})
    several = [replace(one, path=flyer.path.parents[1] / name / "result.json") for one, name in ((flyer, "monday"), (heavier, "friday"))]
    page = Page(html.page([*several, replace(lost, path=flyer.path.parents[1] / "lost" / "result.json"), docking]))
    header, friday, without = page.table("Differences from monday")
    assert header[10] == "Mass [kg]"
    first, sigma = flyer.result.phases[0].estimates["mass"].value or 0.0, flyer.result.phases[0].estimates["mass"].sigma or 0.0
    off, sigmas = (22.5 - first), (22.5 - first) / np.hypot(sigma, 0.4)
    assert friday[0] == "friday"
    assert friday[10] == f"+{off:.2f}+{sigmas:.1f} σ"
    assert friday[1] == "0.00000000.0 σ"
    assert (without[0], without[10]) == ("lost", "–")
    svgs = re.findall(r"<svg.*?</svg>", page.text, re.DOTALL)
    assert len(svgs) == 20
    assert all(name in svgs[0] for name in ("monday", "friday", "lost"))
    assert "single" in svgs[10]


@pytest.mark.parametrize(("text", "shown"), [("-0.00", "0.00"), ("-1e-05", "−1e−05"), ("-0.10", "−0.10"), ("0", "0")])
def test_minus_signs_are_real_and_zero_has_none(text: str, shown: str) -> None:
    assert view.minus(text) == shown
