import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from massprop_cli import CG, INERTIA, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError, UsageError
from massprop_cli.report import figures, html, vocabulary
from massprop_cli.report.figures import (
    canvas,
    comparison,
    excitation,
    innovations,
    palette,
    series,
)
from massprop_cli.result.read import Recorded
from tests.recording import SVG, changed, drawn, follows, precision
from tests.report.conftest import Drawing, blank

FAMILY = {**dict.fromkeys(INERTIA, "inertia"), **dict.fromkeys(CG, "cg"), "mass": "mass"}


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_drawn_estimate_is_the_history(flyer: Recorded, flyer_drawing: Drawing, quantity: str) -> None:
    svg = flyer_drawing(FAMILY[quantity])
    columns = flyer.history["all"]
    points = drawn(svg, f"{quantity}-1", f"{quantity}-value-1")
    assert follows(points, columns["time_s"], columns[quantity], precision(svg, f"{quantity}-1"))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_last_value_its_band_and_the_final_moment_are_drawn_exactly(flyer: Recorded, flyer_drawing: Drawing, quantity: str) -> None:
    svg = flyer_drawing(FAMILY[quantity])
    item, columns, within = flyer.result.phases[0].estimates[quantity], flyer.history["all"], precision(svg, f"{quantity}-1")
    value, sigma, end = columns[quantity][-1], columns[f"{quantity}_sigma"][-1], columns["time_s"][-1]
    points = drawn(svg, f"{quantity}-1", f"{quantity}-value-1")
    assert points[-1] == pytest.approx([end, value], abs=max(within))
    assert abs(points[-1, 1] - value) <= within[1]
    band = drawn(svg, f"{quantity}-1", f"{quantity}-band-1")
    last = np.sort(band[np.abs(band[:, 0] - end) <= within[0], 1])
    assert last[0] == pytest.approx(value - sigma, abs=within[1])
    assert last[-1] == pytest.approx(value + sigma, abs=within[1])
    final = drawn(svg, f"{quantity}-1", f"{quantity}-final-1")
    assert item.final_at_s is not None
    assert final[:, 0] == pytest.approx(item.final_at_s, abs=within[0])


def test_a_sigma_at_the_end_can_be_told_from_a_line(flyer: Recorded, docking: Recorded) -> None:
    """The range fits the settled part: a band of two sigmas is more than a line's width high, of 100 points."""
    for recorded in (flyer, docking):
        for phase, columns in recorded.history.items():
            item = next(p for p in recorded.result.phases if p.name == phase)
            for name in QUANTITIES:
                limits = series.settled(columns[name], columns[f"{name}_sigma"])
                sigma = item.estimates[name].sigma
                assert limits is not None
                assert sigma is not None
                assert 2 * sigma / (limits.high - limits.low) > 0.025


def test_what_runs_out_of_the_picture_is_named(flyer: Recorded, flyer_drawing: Drawing) -> None:
    picture, svg = figures.picture("inertia", flyer), flyer_drawing("inertia")
    columns = flyer.history["all"]
    for panel, name in zip(picture.panels, INERTIA, strict=True):
        points = drawn(svg, f"{name}-1", f"{name}-value-1")
        told = np.isfinite(columns[name])
        top = points[:, 1].max() + np.ptp(points[:, 1])
        assert columns[name][told].max() > top
        assert "runs out of the picture" in panel.alt_text
        assert vocabulary.SYMBOLS[name] in picture.caption.split("is outside the figure: ")[1]


@pytest.mark.parametrize(("kind", "unit"), [("rate", "rad_s"), ("acceleration", "m_s2")])
def test_drawn_signals_are_the_history_with_their_extremes(flyer: Recorded, flyer_drawing: Drawing, kind: str, unit: str) -> None:
    svg, columns = flyer_drawing(kind), flyer.history["all"]
    for letter in "xyz":
        values, within = columns[f"{kind}_{letter}_{unit}"], precision(svg, f"{kind}_{letter}")
        points = drawn(svg, f"{kind}_{letter}", f"{kind}_{letter}-value-1")
        assert follows(points, columns["time_s"], values, within)
        assert points[:, 1].max() == pytest.approx(values.max(), abs=within[1])
        assert points[:, 1].min() == pytest.approx(values.min(), abs=within[1])
        assert len(points) <= 2 * series.BUCKETS + 2


@pytest.mark.parametrize(("kind", "unit"), [("torque", "n_m"), ("force", "n")])
def test_drawn_commands_are_means_within_what_the_history_spans(flyer: Recorded, flyer_drawing: Drawing, kind: str, unit: str) -> None:
    svg, columns = flyer_drawing(kind), flyer.history["all"]
    for letter in "xyz":
        values, within = columns[f"{kind}_{letter}_{unit}"], precision(svg, f"{kind}_{letter}")
        points = drawn(svg, f"{kind}_{letter}", f"{kind}_{letter}-value-1")
        band = drawn(svg, f"{kind}_{letter}", f"{kind}_{letter}-band-1")
        assert len(points) == series.BUCKETS
        # a point stands for seven or eight cycles of 0.05 s around it
        means = [values[np.abs(columns["time_s"] - at) < 0.18].mean() for at in points[:, 0]]
        assert points[:, 1] == pytest.approx(means, abs=within[1])
        assert (band[:, 1].min(), band[:, 1].max()) == pytest.approx((values.min(), values.max()), abs=within[1])


def test_innovations_stand_between_two_sigmas_as_the_filter_expected(flyer: Recorded, flyer_drawing: Drawing) -> None:
    svg, columns = flyer_drawing("innovations"), flyer.history["all"]
    for kind in ("torque", "force"):
        for letter in "xyz":
            column = f"innovation_{kind}_{letter}"
            within, sigma = precision(svg, column), columns[f"{column}_sigma"]
            assert follows(drawn(svg, column, f"{column}-value-1"), columns["time_s"], columns[column], within)
            assert follows(drawn(svg, column, f"{column}-upper-1"), columns["time_s"], 2 * sigma, within)
            assert follows(drawn(svg, column, f"{column}-lower-1"), columns["time_s"], -2 * sigma, within)
            inside = innovations.share_inside(columns[column], sigma)
            assert inside is not None
            assert 0.9 < inside < 0.99
    for panel in figures.picture("innovations", flyer).panels:
        assert "lie within ± 2 sigma; 95 % are expected" in panel.alt_text


def test_where_sigma_exceeds_the_picture_nothing_is_drawn(flyer: Recorded, flyer_drawing: Drawing) -> None:
    svg, columns = flyer_drawing("inertia"), flyer.history["all"]
    limits = series.settled(columns["iyz"], columns["iyz_sigma"])
    assert limits is not None
    wide = columns["iyz_sigma"] > 1.1 * (limits.high - limits.low)
    assert wide.sum() > 100
    assert drawn(svg, "iyz-1", "iyz-value-1")[:, 0].min() > columns["time_s"][wide].max()
    assert "where sigma exceeds it, nothing is shown" in figures.picture("inertia", flyer).caption
    assert series.broken(np.array([0, 1, 4, 6]), np.array([0, 0, 1, 0, 0, 0, 0], dtype=bool)).tolist() == [0, 1, -1, 4, 6]


def test_a_history_of_an_earlier_version_still_makes_the_figures_that_it_can(flyer: Recorded, flyer_drawing: Drawing) -> None:
    new = ("predicted_", "whitened_", "executed_", "specific_force_")
    old = replace(flyer, history={"all": {n: v for n, v in flyer.history["all"].items() if not n.startswith(new)}})
    assert figures.draw("inertia", old, "svg") == flyer_drawing("inertia")
    for name in ("rate-fit", "force-fit", "command-fit", "whiteness", "firing"):
        with pytest.raises(InputError, match=r"lacks .*; make the result again"):
            figures.picture(name, old)
    with blank():
        assert html.page([old]).count("This figure needs history.parquet") == 5


def test_neighbouring_panels_have_one_unit(flyer: Recorded) -> None:
    history = flyer.history["all"] | {"rate_x_rad_s": 1e-9 * flyer.history["all"]["rate_x_rad_s"]}
    headings = [
        re.findall(r">Rate, body [XYZ] \[(.*?)\]<", canvas.render([panel], "svg").decode())
        for panel in figures.picture("rate", replace(flyer, history={"all": history})).panels
    ]
    assert headings == [["rad/s"], ["rad/s"], ["rad/s"]]


def test_every_phase_is_drawn_and_named(docking: Recorded) -> None:
    svg, svg_inertia = figures.draw("rate", docking, "svg"), figures.draw("inertia", docking, "svg")
    texts = ["".join(text.itertext()) for text in ET.fromstring(svg).iter(f"{SVG}text")]
    assert texts.count("single") == texts.count("combined") == 3
    for number, phase in enumerate(("single", "combined"), 1):
        columns = docking.history[phase]
        points = drawn(svg, "rate_x", f"rate_x-value-{number}")
        assert follows(points, columns["time_s"], columns["rate_x_rad_s"], precision(svg, "rate_x"))
        assert follows(
            drawn(svg_inertia, f"iyy-{number}", f"iyy-value-{number}"),
            columns["time_s"],
            columns["iyy"],
            precision(svg_inertia, f"iyy-{number}"),
        )
    alone = figures.canvas.render(figures.picture("mass", docking, "combined").panels, "svg")
    assert drawn(alone, "mass-1", "mass-value-1")[-1, 1] == pytest.approx(docking.history["combined"]["mass"][-1], rel=1e-3)


def test_the_thesis_is_drawn_with_its_reported_value_apart_from_the_running_one(thesis: Recorded) -> None:
    svg = figures.draw("mass", thesis, "svg")
    item, columns = thesis.result.phases[0].estimates["mass"], thesis.history["all"]
    assert item.value is not None
    assert abs(item.value - columns["mass"][-1]) > 0.1
    assert follows(drawn(svg, "mass-1", "mass-value-1"), columns["time_s"], columns["mass"], precision(svg, "mass-1"))
    assert "precision" in figures.picture("mass", thesis).caption


def expected(value: float, met: bool = True) -> dict[str, object]:
    return {"value": value, "tolerance": 0.01, "stated": "0.01", "met": met, "difference": 0.0, "sigmas": 0.0}


@pytest.fixture(scope="module")
def held(flyer: Recorded) -> bytes:
    """The inertia, Ixx as expected and Iyy far from it."""
    near = changed(flyer, "ixx", {"expected": expected(0.62), "nominal": 0.62001})
    return figures.draw("inertia", changed(near, "iyy", {"expected": expected(3.1, met=False)}), "svg")


def test_expectation_and_nominal_value_are_drawn_where_they_are(held: bytes) -> None:
    within = precision(held, "ixx-1")[1]
    assert drawn(held, "ixx-1", "ixx-expected-1")[:, 1] == pytest.approx(0.62, abs=within)
    assert drawn(held, "ixx-1", "ixx-nominal-1")[:, 1] == pytest.approx(0.62001, abs=within)
    assert "expected 0.62 ✓" in held.decode()


def test_an_expectation_far_off_is_named_at_the_edge_and_does_not_flatten_the_picture(held: bytes, flyer_drawing: Drawing) -> None:
    assert "expected 3.1 ✕, above this picture" in held.decode()
    assert not len(drawn(held, "iyy-1", "iyy-expected-1"))
    assert precision(held, "iyy-1") == precision(flyer_drawing("inertia"), "iyy-1")


def test_a_quantity_without_any_estimate_says_why(flyer: Recorded) -> None:
    blank = np.full_like(flyer.history["all"]["mass"], np.nan)
    history = {"all": flyer.history["all"] | {"mass": blank, "mass_sigma": blank}}
    blind = changed(flyer, "mass", {"value": None, "sigma": None, "verdict": "unobservable", "final_at_s": None})
    picture = figures.picture("mass", replace(blind, history=history))
    assert "no estimate at any time, unobservable" in picture.panels[0].alt_text
    assert b"nothing can be said" in figures.canvas.render(picture.panels, "svg")


@given(
    arrays(float, st.integers(1, 900), elements=st.floats(-1e6, 1e6) | st.just(float("nan"))),
    st.integers(0, 10**6),
    st.integers(1, 60),
)
def test_thinning_keeps_extremes_ends_and_what_it_is_told_to(values: Array, pick: int, buckets: int) -> None:
    keep = pick % len(values)
    rows = series.thin(values, [keep], buckets)
    finite = np.flatnonzero(np.isfinite(values))
    assert len(rows) <= 2 * buckets + 3
    assert (np.diff(rows) > 0).all()
    assert np.isfinite(values[rows]).all()
    if finite.size:
        assert {finite[0], finite[-1]} <= set(rows)
        assert values[rows].max() == values[finite].max()
        assert values[rows].min() == values[finite].min()
        assert np.isnan(values[keep]) or keep in rows


def test_a_log_of_a_hundred_thousand_cycles_is_thinned_to_what_can_be_seen() -> None:
    values = np.random.default_rng(1).standard_normal(100_000)
    assert len(series.thin(values)) <= 2 * series.BUCKETS + 2


def test_information_comes_when_sigma_shrinks() -> None:
    time_s = 0.1 * np.arange(1, 601)
    quiet = {f"{name}_sigma": np.full(600, 1.0) for name in QUANTITIES}
    sigma = np.where(time_s < 20, 1.0, np.where(time_s < 25, 1 / np.sqrt(1 + np.maximum(time_s - 20, 0) * 100), 1 / np.sqrt(501)))
    torque = np.where((time_s > 20) & (time_s <= 25), 2.0, 0.0)
    signals = {f"{kind}_{letter}_{unit}": np.zeros(600) for kind, unit in (("torque", "n_m"), ("force", "n")) for letter in "xyz"}
    found = excitation.strips({"time_s": time_s, **quiet, **signals, "ixx_sigma": sigma, "torque_x_n_m": torque})
    shares = found.information[0]
    middle = (found.edges_s[1:] + found.edges_s[:-1]) / 2
    burst = (middle > 20) & (middle < 25)
    assert shares.sum() == pytest.approx(1.0)
    assert shares[burst].sum() == pytest.approx(500 / 501, abs=1e-3)
    assert found.commands[0][burst] == pytest.approx(1.0)
    assert found.commands[0][~burst] == pytest.approx(0.0)
    half = excitation.half_information_s(found, 0)
    assert half is not None
    assert 22 < half < 24


def test_excitation_of_the_sample_says_that_force_told_the_mass(flyer: Recorded, flyer_drawing: Drawing) -> None:
    found = excitation.strips(flyer.history["all"])
    pushed = found.commands[3:].max(0) > 0.01
    assert found.information[9][pushed].sum() > 0.99
    assert found.information[0][~pushed].sum() > 0.2
    svg = flyer_drawing("excitation")
    heights = drawn(svg, "excitation-1", "mass-information-1")
    base = heights[:, 1].min()
    quiet = heights[heights[:, 0] < 30, 1]
    assert (quiet - base < 0.01).all()
    assert heights[:, 1].max() - base == pytest.approx(0.85, abs=0.02)


@pytest.mark.parametrize("name", figures.NAMES)
def test_a_figure_reaches_nowhere(flyer_drawing: Drawing, name: str) -> None:
    svg = flyer_drawing(name)
    text = svg.decode()
    for namespace in ("http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"):
        text = text.replace(f'"{namespace}"', "")
    assert "http" not in text
    assert "<!DOCTYPE" not in text
    assert text.count("url(") == text.count("url(#")
    assert all("".join(title.itertext()) for title in ET.fromstring(svg).iter(f"{SVG}title"))


FEW = ("mass", "ellipsoid", "correlation", "excitation")


@pytest.mark.parametrize("name", [*FEW, *(pytest.param(name, marks=pytest.mark.thorough) for name in figures.NAMES if name not in FEW)])
def test_a_figure_is_the_same_bytes_twice(flyer: Recorded, flyer_drawing: Drawing, name: str) -> None:
    assert figures.draw(name, flyer, "svg") == flyer_drawing(name)


@pytest.mark.parametrize("name", ["mass", "ellipsoid"])
def test_a_png_is_the_same_bytes_twice(flyer: Recorded, name: str) -> None:
    png = figures.draw(name, flyer, "png")
    assert png.startswith(b"\x89PNG\r\n")
    assert png == figures.draw(name, flyer, "png")


def test_an_unknown_figure_or_phase_is_refused_with_those_there_are(flyer: Recorded, flyer_drawing: Drawing) -> None:
    with pytest.raises(UsageError, match=r"no figure 'inertai'; did you mean inertia\? there are inertia, cg, mass"):
        flyer_drawing("inertai")
    with pytest.raises(UsageError, match=r"no phase 'docked' in .*; there are all"):
        figures.picture("inertia", flyer, "docked")


def test_without_a_history_only_figures_against_time_are_refused(flyer: Recorded) -> None:
    bare = replace(flyer, history={})
    for name in figures.NAMES:
        if name in ("correlation", "ellipsoid", "expectations"):
            assert figures.draw(name, bare, "svg")
        else:
            with pytest.raises(InputError, match=r"history\.parquet: missing.*massprop estimate"):
                figures.draw(name, bare, "svg")


@pytest.mark.seeds
@pytest.mark.slow
def test_names_with_markup_mathematics_or_control_signs_are_only_text(docking: Recorded) -> None:
    hostile = "<b>&\"'$x^2$\x1b\x00\ud800 ]]> 航"
    phases = [phase.model_copy(update={"name": hostile + phase.name}) for phase in docking.result.phases]
    vehicle = docking.result.vehicle.model_copy(update={"name": hostile})
    history = {hostile + name: columns for name, columns in docking.history.items()}
    renamed = replace(docking, result=docking.result.model_copy(update={"phases": phases, "vehicle": vehicle}), history=history)
    for name in ("torque", "mass", "ellipsoid", "correlation", "excitation"):
        svg = figures.draw(name, renamed, "svg")
        texts = "".join("".join(text.itertext()) for text in ET.fromstring(svg).iter(f"{SVG}text"))
        assert "<b>&\"'$x^2$\ufffd\ufffd\ufffd ]]> 航" in texts
        assert figures.draw(name, renamed, "png")


@pytest.mark.thorough
def test_figures_leave_pyplot_alone_and_matplotlib_until_one_is_drawn(tmp_path: Path, flyer: Recorded) -> None:
    code = (
        "import sys; from pathlib import Path\n"
        "from massprop_cli.report import figures, html; from massprop_cli.result import read\n"
        "assert 'matplotlib' not in sys.modules\n"
        f"figures.draw('correlation', read.read(Path({str(flyer.path)!r})), 'svg'); assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


def test_a_contradicted_estimate_is_red_with_a_cross_and_the_caption_says_so(flyer: Recorded, flyer_drawing: Drawing) -> None:
    wrong = changed(flyer, "mass", {"verdict": "contradicted"})
    assert palette.RED in figures.draw("mass", wrong, "svg").decode()
    assert palette.RED not in flyer_drawing("mass").decode()
    assert "Red with a cross: contradicted" in figures.picture("mass", wrong).caption
    assert "contradicted" not in figures.picture("mass", flyer).caption
    assert "It uses contradicted values." in figures.picture("ellipsoid", wrong).caption
    side_by_side = comparison.picture([flyer.result.phases[0].estimates, wrong.result.phases[0].estimates])
    svgs = {panel.key: canvas.render([panel], "svg").decode() for panel in side_by_side.panels}
    assert 'id="mass-contradicted"' in svgs["mass"]
    assert palette.RED in svgs["mass"]
    assert palette.RED not in svgs["ixx"]
