"""Figures of a body: its ellipsoid, its principal axes, the correlations of its values."""

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements, tensor
from massprop_cli.report import body, figures
from massprop_cli.report.figures import (
    canvas,
    correlation,
    ellipsoid,
)
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import PhaseItem
from tests import recorded
from tests.recording import precision


def test_views_of_an_ellipsoid_have_one_scale(flyer: Recorded) -> None:
    scales = []
    for panel in figures.picture("ellipsoid", flyer).panels:
        svg = canvas.render([panel], "svg")
        scales += list(precision(svg, panel.key))
    assert scales == pytest.approx([scales[0]] * 8, rel=1e-6)


@pytest.mark.parametrize("view", ["top", "side", "front"])
def test_no_letter_of_a_body_axis_hides_the_number_of_a_principal_axis(view: str, flyer: Recorded) -> None:
    """A letter or number is 0.13 inches wide, on a circle of paper."""
    (panel,) = (panel for panel in figures.picture("ellipsoid", flyer).panels if panel.key.startswith(view))
    (axes,) = canvas._figure([panel], 1, "").axes
    at = {text.get_text(): axes.transData.transform(text.get_position()) / axes.figure.dpi for text in axes.texts}
    numbers = sorted(set(at) & {"1", "2", "3"})
    assert numbers == {"top": ["1", "3"], "side": ["1", "2"], "front": ["2", "3"]}[view]
    assert min(np.linalg.norm(at[one] - at[other]) for one in numbers for other in at if other != one) > 0.13


def test_correlation_is_covariance_over_sigmas() -> None:
    covariance: list[list[float | None]] = [[0.0] * 10 for _ in range(10)]
    for i in range(10):
        covariance[i][i] = float(i + 1)
    covariance[0][3] = covariance[3][0] = 1.0
    covariance[9][9] = None
    found = correlation.correlation(covariance)
    assert found[0, 3] == pytest.approx(1 / np.sqrt(1 * 4))
    assert found[0, 0] == 1.0
    assert np.isnan(found[9]).all()


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.0, "1"), (0.9999, ">.999"), (-0.9971, "−.997"), (-0.456, "−.46"), (0.004, "0"), (-0.004, "0"), (0.07, ".07"), (np.nan, "·")],
)
def test_correlations_are_written_short(value: float, text: str) -> None:
    assert correlation.short(value) == text


def phase(inertia: Array, cg: Array, mass: float | None, covariance: Array | None = None) -> PhaseItem:
    items = {name: {"value": value} for name, value in zip(QUANTITIES, [*elements(inertia), *cg, mass], strict=True)}
    matrix = np.eye(10) * 1e-4 if covariance is None else covariance
    return PhaseItem.model_validate(recorded.phase("all", **items) | {"covariance": matrix.tolist()})


def turned(seed: int) -> Array:
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return np.asarray(q)


@pytest.mark.parametrize("seed", range(5))
def test_the_ellipsoid_has_the_semi_axes_of_the_body_it_stands_for(seed: int) -> None:
    semi_axes, mass, axes = np.array([0.9, 0.5, 0.3]), 7.0, turned(seed)
    second = mass * semi_axes**2 / 5
    inertia = axes @ np.diag(second.sum() - second) @ axes.T
    found = body.ellipsoid(phase(inertia, np.array([0.1, 0.2, 0.3]), mass + 2.0), bearing_mass_kg=2.0)
    assert found is not None
    assert found.to_scale
    assert found.semi_axes == pytest.approx(semi_axes)
    assert np.abs((found.axes * axes).sum(0)) == pytest.approx(1.0)
    surface = axes * semi_axes @ np.random.default_rng(seed).standard_normal((3, 20000))
    surface /= np.sqrt((np.linalg.solve(axes * semi_axes, surface) ** 2).sum(0))
    for _, _, directions in ellipsoid.VIEWS.values():
        edge, seen = ellipsoid.outline(found, directions, 2001), (directions @ surface).T
        for angle in np.linspace(0, np.pi, 7):
            along = np.array([np.cos(angle), np.sin(angle)])
            assert (edge @ along).max() == pytest.approx((seen @ along).max(), rel=2e-2)


def test_an_ellipsoid_without_a_mass_shows_proportions_only() -> None:
    found = body.ellipsoid(phase(np.diag([1.0, 2.0, 2.5]), np.zeros(3), None), 0.0)
    assert found is not None
    assert not found.to_scale
    assert found.semi_axes.max() == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(4))
def test_sigmas_of_principal_moments_and_of_inertia_about_o_are_those_of_a_random_sample(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = turned(seed)
    inertia, cg, mass = axes @ np.diag([1.0, 2.0, 2.6]) @ axes.T, np.array([0.2, -0.1, 0.3]), 9.0
    root = 1e-3 * rng.standard_normal((10, 10))
    item = phase(inertia, cg, mass, root @ root.T)
    sample = np.array([*elements(inertia), *cg, mass]) + (root @ rng.standard_normal((10, 4000))).T
    moments = np.array([np.linalg.eigvalsh(tensor(row[:6])) for row in sample])
    found = body.principal(item)
    assert found is not None
    assert found.sigmas == pytest.approx(moments.std(0), rel=0.06)
    assert found.axes @ np.diag(found.moments) @ found.axes.T == pytest.approx(inertia)
    about = [tensor(v[:6]) + (v[9] - 2.0) * ((v[6:9] @ v[6:9]) * np.eye(3) - np.outer(v[6:9], v[6:9])) for v in sample]
    assert body.about_origin_sigmas(item, bearing_mass_kg=2.0) == pytest.approx(np.std(about, axis=0), rel=0.06)
