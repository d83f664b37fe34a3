"""Figures of the fit, of how estimates settled, of expectations and of what jets did, read back from their SVG."""

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.report import figures
from massprop_cli.report.figures import command, firing, palette, whiteness
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import PhaseItem, WarningItem
from tests import recorded as made
from tests.recording import changed, drawn, follows, precision
from tests.report.conftest import Drawing


@pytest.mark.parametrize(("name", "kind", "unit"), [("rate-fit", "rate", "rad_s"), ("force-fit", "specific_force", "m_s2")])
def test_measured_predicted_and_what_is_left_are_the_history(
    flyer: Recorded, flyer_drawing: Drawing, name: str, kind: str, unit: str
) -> None:
    picture, columns, svg = figures.picture(name, flyer), flyer.history["all"], flyer_drawing(name)
    for letter, panel in zip("xyz", picture.panels[1::2], strict=True):
        measured, predicted = columns[f"{kind}_{letter}_{unit}"], columns[f"predicted_{kind}_{letter}_{unit}"]
        sigma = columns[f"predicted_{kind}_{letter}_sigma_{unit}"]
        axes = f"{kind}_{letter}"
        for told, values in (("measured", measured), ("predicted", predicted)):
            assert follows(drawn(svg, axes, f"{axes}-{told}-1"), columns["time_s"], values, precision(svg, axes))
        within = precision(svg, f"{axes}_residual")
        points = drawn(svg, f"{axes}_residual", f"{axes}_residual-residual-1")
        assert follows(points, columns["time_s"], measured - predicted, within)
        assert points[:, 1].max() == pytest.approx(np.nanmax(measured - predicted), abs=within[1]), "no outlier is cut off"
        assert follows(drawn(svg, f"{axes}_residual", f"{axes}_residual-upper-1"), columns["time_s"], 2 * sigma, within)
        assert 0.93 < float(panel.alt_text.split("; ")[1].split("%")[0]) / 100 < 0.97
    assert "minimum and maximum of 8 cycles" in picture.caption


def test_what_is_left_against_the_command_has_the_slope_of_a_thrust_that_is_off() -> None:
    """A mass a tenth too large leaves a tenth of the force's acceleration: slope 0.1 / 22 per kg, found within 3 of its sigmas."""
    rng, count = np.random.default_rng(4), 3000
    force = rng.choice([-2.0, 0.0, 2.0], count)
    columns = {"time_s": 0.05 * np.arange(1, count + 1), "force_x_n": force}
    columns |= {"specific_force_x_m_s2": force / 20 + 0.02 * rng.standard_normal(count), "predicted_specific_force_x_m_s2": force / 22}
    columns["predicted_specific_force_x_sigma_m_s2"] = np.full(count, 0.02)
    item = PhaseItem.model_validate(made.phase())
    found = command.means(command.against([(1, item, columns)], "specific_force", "x"))
    assert [mean.command for mean in found] == pytest.approx([-2.0, 0.0, 2.0])
    for mean in found:
        assert mean.residual == pytest.approx(mean.command * (1 / 20 - 1 / 22), abs=4 * mean.sigma)
        assert mean.sigma == pytest.approx(0.02 / np.sqrt(count / 3), rel=0.1)


def test_means_against_the_command_are_drawn_where_they_are(flyer: Recorded, flyer_drawing: Drawing) -> None:
    svg = flyer_drawing("command-fit")
    parts = [(1, flyer.result.phases[0], flyer.history["all"])]
    for kind in command.KINDS:
        found = command.means(command.against(parts, kind, "y"))
        points, within = drawn(svg, f"{kind}_y", f"{kind}_y-mean"), precision(svg, f"{kind}_y")
        assert points[:, 0] == pytest.approx([mean.command for mean in found], abs=within[0])
        assert points[:, 1] == pytest.approx([mean.residual for mean in found], abs=within[1])
        assert all(abs(mean.residual) < 4.5 * mean.sigma for mean in found), "this log is without fault"


def test_whiteness_figures_are_those_of_the_whitened_innovations(flyer: Recorded, flyer_drawing: Drawing) -> None:
    svg, columns = flyer_drawing("whiteness"), flyer.history["all"]
    z = np.column_stack([columns[f"whitened_rate_{letter}"] for letter in "xyz"])
    z = z[np.isfinite(z).all(1)]
    bars = drawn(svg, "histogram_rate", "rate_y-histogram")
    width = whiteness.EDGES[1] - whiteness.EDGES[0]
    density = np.array([((z[:, 1] >= low) & (z[:, 1] < low + width)).mean() / width for low in whiteness.EDGES[:-1]])
    assert bars[1::2, 1][:-1] == pytest.approx(density, abs=2 * precision(svg, "histogram_rate")[1])
    lagged = drawn(svg, "autocorrelation_rate", "rate_z-correlation")
    assert lagged[:, 0] == pytest.approx(np.arange(1, whiteness.LAGS + 1), abs=0.01)
    by_hand = [np.dot(z[lag:, 2], z[:-lag, 2]) / np.dot(z[:, 2], z[:, 2]) for lag in range(1, whiteness.LAGS + 1)]
    assert lagged[:, 1] == pytest.approx(by_hand, abs=precision(svg, "autocorrelation_rate")[1])
    points, within = drawn(svg, "running_rate", "rate-running-1"), precision(svg, "running_rate")
    mean = np.array([(z[k : k + whiteness.WINDOW] ** 2).sum() / whiteness.WINDOW for k in range(len(z) - whiteness.WINDOW + 1)])
    assert follows(points, columns["time_s"][np.isfinite(columns["whitened_rate_x"])][whiteness.WINDOW - 1 :], mean, within)


def test_how_estimates_settled_is_the_history_on_a_logarithmic_scale(flyer: Recorded, flyer_drawing: Drawing) -> None:
    svg, columns = flyer_drawing("settling"), flyer.history["all"]
    for name, allowed in (("iyy", 0.01 * (0.62 + 2.8 + 2.5)), ("cg_x", 0.01 * np.sqrt(5.92 / 21.73)), ("mass", 0.2173)):
        axes = f"settling_{name}-1"
        within = precision(svg, axes)
        with np.errstate(divide="ignore"):
            away = np.log10(np.abs(columns[name] - columns[name][-1]))
        assert follows(drawn(svg, axes, f"{name}-away-1"), columns["time_s"], away, within)
        assert follows(drawn(svg, axes, f"{name}-sigma-1"), columns["time_s"], np.log10(columns[f"{name}_sigma"]), within)
        assert drawn(svg, axes, f"{name}-tolerance-1")[:, 1] == pytest.approx(np.log10(allowed), abs=0.01)
    assert b'id="axes-settling_mass-1" data-x' in svg
    assert svg.count(b'data-log=""') == 10
    # five beside each other on a page of 1200 px, 96 to the inch: text is as large as it is drawn
    assert {panel.size[0] * 96 for panel in figures.picture("settling", flyer).panels} == {1200 / 5}


def test_a_caption_names_the_mark_of_an_expectation_only_where_there_is_one(flyer: Recorded) -> None:
    wanted = {"value": 21.7, "tolerance": 0.5, "stated": "0.5", "met": True, "difference": 0.03, "sigmas": 0.1}
    held = changed(flyer, "mass", {"expected": wanted})
    assert "Green" not in figures.picture("mass", flyer).caption
    assert "Green on the right: the expected value" in figures.picture("mass", held).caption
    assert "Green" not in figures.picture("inertia", held).caption


def test_all_expectations_stand_in_one_figure_in_tolerances(flyer: Recorded) -> None:
    wanted = {"value": 0.61, "tolerance": 0.02, "stated": "0.02", "met": True, "difference": 0.01, "sigmas": 3000.0}
    far = wanted | {"value": 20.0, "tolerance": 0.1, "met": False, "difference": 1.73}
    held = changed(changed(flyer, "ixx", {"expected": wanted, "sigma": 0.005}), "mass", {"expected": far})
    svg = figures.draw("expectations", held, "svg")
    text = svg.decode()
    assert 'id="ixx-ratio-1"' in text
    assert 'id="mass-beyond-1"' in text
    assert "Ixx +0.5, Mass +17" in figures.picture("expectations", held).panels[0].alt_text
    assert "nothing was expected" in figures.picture("expectations", flyer).panels[0].alt_text


def test_the_raster_shows_each_jet_when_it_pushed_and_marks_the_one_a_warning_names(flyer: Recorded, flyer_drawing: Drawing) -> None:
    warning = WarningItem(code="jet-sign", message="the log fits if jet roll_p1 pushes opposite to the stated direction; not roll_p12")
    named = replace(flyer, result=flyer.result.model_copy(update={"warnings": [warning]}))
    assert firing.named(named.result) == ["roll_p1"]
    svg, jets = figures.draw("firing", named, "svg"), flyer.result.vehicle.jets
    columns = flyer.history["all"]
    for row in (0, 4):
        points = drawn(svg, "firing", f"jet{row + 1}-firing")
        busy = columns["time_s"][columns[f"executed_{jets[row]}_s"] > 0]
        assert points[:, 0].min() == pytest.approx(busy.min(), abs=0.31)
        assert points[:, 0].max() == pytest.approx(busy.max(), abs=0.31)
        assert points[:, 1].min() == pytest.approx(-row, abs=0.02)
    assert palette.RED in svg.decode()
    assert palette.RED not in flyer_drawing("firing").decode()
    edges = np.linspace(columns["time_s"][0] - 0.05, columns["time_s"][-1], 7)
    share = firing.shares([(1, flyer.result.phases[0], columns)], jets[0], edges)
    assert (share * np.diff(edges)).sum() == pytest.approx(columns[f"executed_{jets[0]}_s"].sum(), rel=0.01)
