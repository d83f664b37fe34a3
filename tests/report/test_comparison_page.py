"""The page of several results."""

import re
from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.report import html, vocabulary
from massprop_cli.result.read import Recorded
from tests import recorded
from tests.recording import changed
from tests.report.page import Page


@pytest.mark.usefixtures("blank_figures")
def test_a_comparison_marks_the_result_that_is_contradicted(flyer: Recorded) -> None:
    bad = replace(flyer, result=recorded.result([recorded.contradicted()]))
    text = html.page([flyer, bad])
    _, good, wrong = Page(text).table("All results")
    assert "contradicted" not in "".join(good)
    assert "‼ contradicted" in wrong[1]
    assert wrong[2].startswith("‼contradicted, −830")
    assert text.count('<tr class="alarmed">') == 1
    assert text.count('class="alarm"') == 1


@pytest.mark.usefixtures("blank_figures")
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


@pytest.mark.thorough
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
