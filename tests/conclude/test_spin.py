"""A body that turns about one axis, and is driven about that one alone."""

from __future__ import annotations

import numpy as np
import pytest

from tests import faulty
from tests.flown import fly

pytestmark = pytest.mark.numerical
PLAN = 'plan = [{motion = "random", axes = ["yaw"], every_cycles = 5, max_cycles = 4, start_cycle = 0, end_cycle = 200}]'


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in (2, 3, 4))])
def test_it_contradicts_nothing(seed: int) -> None:
    """The inertias across stay free in the fit; assumptions that are tested about a body whose they are not found 1e6 sigma of nothing."""
    turning = "initial.rate_rad_s = [0.0, 0.0, 2.0]"
    flight = fly("free-flyer", PLAN, turning, "duration_s = 10.0", seeds=(seed,))
    found = faulty.examined(flight.log(0), flight.vehicle)
    assert [conclusion.contradiction for conclusion in found.conclusions] == [""]
    assert {notice.code for notice in found.notices} <= {"unphysical-inertia", "outliers"}
    z = faulty.z_scores(found, flight.truth[0, 0])
    assert np.nanmax(np.abs(list(z.values()))) < 4
    assert all(doubt.sigmas < 5 for doubt in found.doubts)
