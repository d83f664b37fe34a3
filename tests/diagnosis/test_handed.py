"""The kernel holds hypotheses against triangles as NumPy does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.diagnosis import comparison, hypotheses
from massprop_cli.diagnosis.channelwise import FreeResponse, free_response
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import _LeastSquares, fitted
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.kernel import kernel
from massprop_cli.prepare.timing import Timing
from tests import flight

pytestmark = [pytest.mark.numerical, pytest.mark.skipif(kernel().library is None, reason="no compiled kernel was built")]
PIECE = slice(2, 320)
NOISE = np.repeat([1e-4, 0.02], 3) ** 2
RULED_OUT = 1e6
"""Of chi-square, where all as stated has 482 and 616: nothing hangs on where such a fit ends, which is a matter of rounding."""


def reduced(kind: str) -> tuple[Model, FreeResponse]:
    flown = flight.standard(kind)
    free = free_response(Case(flown.log(np.random.default_rng(0)), flown.resolved, Timing(2.0, 0.0)), PIECE)
    return Model.of(free, flown.used, 0.3, "jets"), free


def anything(model: Model, rng: np.random.Generator) -> Array:
    """x with every entry off."""
    x = model.stated + rng.normal(0.0, 0.05, len(model.stated))
    x[:10] = [*rng.uniform(1.0, 2.0, 6) * [1, 0.1, 0.1, 1, 0.1, 1], *rng.normal(0.0, 0.1, 3), 0.05]
    return x


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_what_is_left_of_anything_is_what_numpy_says(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model, free = reduced(kind)
    rng = np.random.default_rng(1)
    supposed = [
        Hypothesis("", (), np.eye(len(model.stated)), gyro=gyro, accelerometer=accelerometer, free_channel=freed)
        for gyro, accelerometer, freed in (
            (np.eye(3), np.eye(3), None),
            (rotation(np.array([0.3, 0.1, -0.2])), np.diag([1.0, -1.0, 1.0]), None),
            (57.3 * np.eye(3), np.eye(3), 3),
        )
    ]
    rows = _LeastSquares.of_all(model, free, NOISE, supposed)
    x = np.stack([anything(model, rng) for _ in supposed])
    x[0, 10:22] = 0.0  # an IMU as it is stated to be
    found = rows.residuals(x)
    monkeypatch.setattr(comparison, "compiled", lambda: False)
    np.testing.assert_allclose(found, rows.residuals(x), rtol=1e-9, atol=1e-9 * np.abs(found).max())


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_fits_begin_where_numpy_begins(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model, free = reduced(kind)
    names = [f"jet {i}" for i in range(len(model.force))]
    supposed = [*hypotheses.listed(model, names), *hypotheses.units(model, 0.05, True), *map(model.without, range(len(names)))]
    alone = [Hypothesis("", (), np.zeros((len(model.stated), 0)), suspects=tuple(range(1, len(names))))]  # hardly any are left to go by
    rows = _LeastSquares.of_all(model, free, NOISE, [*supposed, *alone])
    x, sizes = rows.initial([*supposed, *alone])
    monkeypatch.setattr(comparison, "compiled", lambda: False)
    by_numpy, its_sizes = replace(rows, regressions={}).initial([*supposed, *alone])
    assert np.isfinite(x).all()
    np.testing.assert_allclose(sizes, its_sizes, rtol=1e-6)
    assert np.abs((x - by_numpy)[:, :10] / its_sizes).max() < 1e-6
    np.testing.assert_array_equal(x[:, 10:], by_numpy[:, 10:])


def test_a_sum_that_cancels_but_for_rounding_begins_no_body() -> None:
    """Two jets that always fire together and push against each other say nothing of a force along their line."""
    model, free = reduced("free")
    place, opposed = model.places["channels"], replace(model, force=np.zeros_like(model.force))
    opposed.force[:2] = [[0.0, 0.0, 1.1], [0.0, 0.0, -1.1]]
    same = free.gyro.triangle[:, place.start].copy(), free.accelerometer.triangle[:, place.start].copy()
    free.gyro.triangle[:, place.start + 1], free.accelerometer.triangle[:, place.start + 1] = (part * (1 + 1e-16) for part in same)
    free.accelerometer.triangle[1, place.start + 1] += 1e-13
    x, _ = _LeastSquares.of_all(opposed, free, NOISE, [model.without(5)]).initial([Hypothesis("", (), np.zeros((len(model.stated), 0)))])
    assert x[0, 9] < 1e-3  # 1/m: nothing, and not what rounding makes of it


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_every_supposition_ends_where_numpy_ends(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model, free = reduced(kind)
    names = [f"jet {i}" for i in range(len(model.force))]
    supposed = [*hypotheses.listed(model, names), *hypotheses.units(model, 0.05, True), model.without(2)]
    own = fitted(model, free, NOISE, supposed)
    monkeypatch.setattr(comparison, "compiled", lambda: False)
    for one, other in zip(own, fitted(model, free, NOISE, supposed), strict=True):
        ruled_out = min(one.chi_square.sum(), other.chi_square.sum()) > RULED_OUT
        near = np.abs(one.chi_square - other.chi_square).max() < 1e-4 * (10 + other.chi_square.sum())
        assert near or ruled_out, (one.hypothesis.code, one.hypothesis.subject, one.chi_square, other.chi_square)
        np.testing.assert_allclose(one.spread, other.spread, rtol=1e-3)


def test_a_fit_without_a_next_step_is_told() -> None:
    model, free = reduced("free")
    rows = _LeastSquares.of_all(model, free, NOISE, [Hypothesis("", (), np.zeros((len(model.stated), 0)))])
    x = model.stated[None].copy()
    x[0, :10] = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.05]
    with pytest.raises(np.linalg.LinAlgError):
        rows.packed.fitted(x, np.zeros((1, x.shape[1], 10)), np.zeros(10), (1e-3, 100.0, 8))
