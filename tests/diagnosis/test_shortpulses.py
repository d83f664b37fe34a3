"""Valves that give no short pulses: each lasts as long as the shortest, or does not open."""

import numpy as np
import pytest

from tests import faulty
from tests.flown import fly

AXES = '"roll", "pitch", "yaw", "x", "y", "z"'
LEVELS = (0.08, 0.3, 0.12, 0.5, 0.16, 0.4)
SHORT = ", ".join(
    f'{{motion="random", axes=[{AXES}], level={level}, start_s={5 * n}, end_s={5 * n + 5}}}' for n, level in enumerate(LEVELS)
)
"""Half of the pulses are shorter than 8 ms, a third than 6 ms."""


@pytest.mark.parametrize(("key", "value_s", "within_s"), [("thrust.least_on_s", 0.008, 1e-4), ("thrust.dead_on_s", 0.006, 2.1e-3)])
def test_they_are_named_and_values_are_right_once_they_are_stated(key: str, value_s: float, within_s: float) -> None:
    """Of a dead time the log tells between which on-times it is."""
    flown = fly("free-flyer", "duration_s=30", f"plan=[{SHORT}]", f"vehicle.{key}={value_s}")
    stated = faulty.examined(flown.log(0), flown.vehicle)
    assert not stated.notices
    found = faulty.examined(flown.log(0), faulty.stated(flown.vehicle, f"{key}=0.0"))
    assert [notice.code for notice in found.notices] == ["short-pulses"]
    (answer,) = found.mended
    name, _, value = answer.settings[0].partition("=")
    assert name == key
    assert float(value) == pytest.approx(value_s, abs=within_s)
    for conclusion in (stated.conclusions[0], answer.conclusions[0]):
        assert {estimate.verdict for estimate in conclusion.estimates.values()} == {"converged"}
        assert (np.abs(conclusion.values - flown.truth[0, 0]) < 3.5 * conclusion.sigmas).all()
