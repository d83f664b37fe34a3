import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from massprop_cli.report import assumptions, checks, html, timing, view, vocabulary
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import Delay, Innovations, Mended, PhaseItem
from tests import recorded
from tests.recording import changed
from tests.report.page import Page

pytestmark = pytest.mark.usefixtures("blank_figures")


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
    lost = changed(flyer, "izz", {"verdict": "not_excited", "reason": "the motion in this phase gives too little information on it"})
    lost = changed(lost, "cg_x", {"verdict": "unobservable", "value": None, "sigma": None, "final_at_s": None})
    page = Page(html.page([lost]))
    _, izz, cg_x, *_ = page.table("Quantities that are not converged")
    assert izz == ["Izz", "○ not excited", "the motion in this phase gives too little information on it", "torque about Z"]
    assert cg_x[:2] == ["CG x", "✕ unobservable"]
    assert cg_x[3].startswith("force across X (along Y or Z), or fast rotation about Y or Z")
    assert page.table("Whole log")[7][1:3] == ["–", "–"]
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
    assert cures["Ixx, Ixy, Ixz, Iyy, Iyz, CG z, Mass"] == ["‼ contradicted", recorded.CAUSE, "correct the cause; no motion helps"]
    assert cures["Izz"] == [
        "○ not excited",
        "the motion in this phase gives too little information on it",
        "correct the contradiction of this phase first",
    ]
    assert cures["CG x"][2] == "correct the contradiction of this phase first"
    assert "cannot give it" in cures["CG y"][2]
    assert vocabulary.VERDICTS["contradicted"] in page.said()
    fine = html.page([flyer])
    assert 'class="alarm"' not in fine


def test_a_contradicted_docked_object_is_named_though_its_phases_are_fine(docking: Recorded) -> None:
    assert docking.result.docked_object is not None
    docked = docking.result.docked_object.model_copy(update={"contradiction": "phase single is contradicted"})
    page = Page(html.page([replace(docking, result=docking.result.model_copy(update={"docked_object": docked}))]))
    assert "Docked object: combined less single: 0 of 10 quantities contradicted phase single is contradicted" in page.said()


def test_the_mended_answer_stands_apart_with_the_settings_to_give(flyer: Recorded) -> None:
    found = recorded.result([recorded.contradicted()], mended=[recorded.mended()], assumptions=recorded.assumptions())
    page = Page(html.page([replace(flyer, result=found)]))
    assert page.table("Corrected")[1] == ["Ixx", "0.620", "± 0.010", "kg m²", "✓ converged"]
    assert page.table("Whole log")[1][1] == "−830"
    assert "--set 'jets.roll_p1.force_n=[0.0, 0.0, -1.112]' --set cycle.command_delay_cycles=2.0" in page.said()
    assert {"#mended", "#assumptions"} <= set(page.links)
    assert {"mended", "assumptions"} <= set(page.ids)
    assert "What the log gives if it is corrected" in page.said()
    assert "still contradicted" not in page.said()
    odd = found.model_copy(update={"mended": [Mended.model_validate(recorded.mended("the rates don't add up"))]})
    assert "still contradicted: the rates don't add up" in Page(html.page([replace(flyer, result=odd)])).said()


def test_assumptions_are_part_of_the_page_with_what_one_step_changes(flyer: Recorded) -> None:
    scale = {"by": "known.mass", "value": 1.034, "sigma": 0.0021}
    phase = recorded.phase() | {"implied_thrust_scale": scale}
    page = Page(html.page([replace(flyer, result=recorded.result([phase], assumptions=recorded.assumptions()))]))
    rows = page.table("Change of the values for one step")
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
    assert "Inertia is that of the rotating body about its CG" in said
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
    assert limits["Ixx"] == "thrust scale, 1 %: 0.0062 kg m²"
    assert limits["CG x"] == "geometry: IMU position, 1 mm: 0.0010 m"
    assert limits["Mass"] == limits["Iyy"] == "noise"
    assert limits["CG y"] == ""
    (noticed,) = view.tables(recorded.result([recorded.phase(**items)], assumptions=made[2:]))
    assert noticed.rows[6].limit == "noise"


def test_a_stated_thrust_scale_is_the_limit_where_it_is_most_of_the_sigma() -> None:
    made = [recorded.assumptions()[0] | {"effects": [{"phase": "all", "change": {"mass": 0.22, "ixx": 0.0062}, "seen_sigma": None}]}]
    found = recorded.result([recorded.phase(mass={"sigma": 0.48}, ixx={"sigma": 0.1})], assumptions=made)
    found = found.model_copy(update={"vehicle": found.vehicle.model_copy(update={"thrust_scale_sigma": 0.02})})
    said = {name: assumptions.limit(name, found.phases[0], found) for name in ("mass", "ixx")}
    assert [one.text for one in said.values() if one is not None] == ["thrust scale", "noise"]


def test_without_a_history_the_rest_is_there_and_the_gap_is_named(flyer: Recorded) -> None:
    page = Page(html.page([replace(flyer, history={})]))
    assert page.said().count("This figure needs history.parquet") == 5 + 5 + 5
    assert sum(tag == "svg" for tag, _ in page.tags) == 4 + 1
    assert len(page.table("Whole log")) == 11


def test_a_thesis_result_says_that_its_sigmas_are_no_errors(thesis: Recorded) -> None:
    page = Page(html.page([thesis]))
    assert "they depend on noise only and are not errors" in page.said()
    assert "± is one standard deviation" not in page.said()
    assert "--method thesis" in page.said()
    assert sum(tag == "svg" for tag, _ in page.tags) == 20 + 1 + 1 + 4 + 5 * 6 + 1 + 4 * 3


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
    assert outside.cells == ("ratio of innovations that commands and motion explain, rate Z", "1.7", "1")


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
    rows = dict(timing.delay(Delay(cycles=2.0, source="vehicle", detected_cycles=1.5, sigma_cycles=0.01)))
    assert rows["used"] == "2 cycles, stated by the vehicle file"
    assert rows["detected in the log"] == "1.5 ± 0.01 cycles"
    assert rows["detected less used"] == "−0.5 cycles, −50.0 sigma"
    assert dict(timing.delay(Delay(cycles=0.0, source="option")))["detected in the log"].startswith("not estimated")
