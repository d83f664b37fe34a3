"""Where fits of hypotheses begin and end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.diagnosis.channelwise import Free, free_response
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import _descended, _Rows
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.prepare.timing import Timing
from tests import flight

pytestmark = pytest.mark.numerical
PIECE = slice(2, 320)
NOISE = np.repeat([1e-4, 0.02], 3) ** 2


def reduced(kind: str) -> tuple[Model, Free]:
    flown = flight.standard(kind)
    free = free_response(flown.log(np.random.default_rng(0)), flown.resolved, Timing(2.0, 0.0), PIECE)
    return Model.of(free, flown.used, 0.3, True), free


def test_a_sum_that_cancels_but_for_rounding_begins_no_body() -> None:
    """Two jets that always fire together and push against each other say nothing of a force along their line."""
    model, free = reduced("free")
    place, opposed = model.places["channels"], replace(model, force=np.zeros_like(model.force))
    opposed.force[:2] = [[0.0, 0.0, 1.1], [0.0, 0.0, -1.1]]
    same = free.gyro.triangle[:, place.start].copy(), free.accelerometer.triangle[:, place.start].copy()
    free.gyro.triangle[:, place.start + 1], free.accelerometer.triangle[:, place.start + 1] = (part * (1 + 1e-16) for part in same)
    free.accelerometer.triangle[1, place.start + 1] += 1e-13
    x, _ = _Rows.of_all(opposed, free, NOISE, [model.without(5)]).begun([Hypothesis("", (), np.zeros((len(model.stated), 0)))])
    assert x[0, 9] < 1e-3  # 1/m: nothing, and not what rounding makes of it


def test_a_fit_without_a_next_step_is_told() -> None:
    model, free = reduced("free")
    rows = _Rows.of_all(model, free, NOISE, [Hypothesis("", (), np.zeros((len(model.stated), 0)))])
    x = model.stated[None].copy()
    x[0, :10] = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.05]
    with pytest.raises(np.linalg.LinAlgError):
        _descended(rows, np.zeros((1, x.shape[1], 10)), np.zeros(10), x, 1e-3)
