"""One channel that does something else than stated shows in what is left, and chance does not."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.channelresiduals import _explained, channel_residual_test
from massprop_cli.diagnosis.lackoffit import CHANNELS
from massprop_cli.flow import Analysis
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.prepare.actuators import channel_names
from massprop_cli.prepare.compensate import Source
from tests.flown import RANDOM, fly, sound

SEED = 3


def told(found: Analysis) -> Array:
    source: Source = found.samples
    return _explained(found.settled[0], source)


def turned(used: Vehicle, jet: int, angle: float) -> Vehicle:
    """With a jet that is stated to point elsewhere by so many rad."""
    force = np.array(used.jets[jet].force_n)
    across = np.cross(force, [0.6, 0.0, 0.8])
    stated = np.cos(angle) * force + np.sin(angle) * np.linalg.norm(force) * across / np.linalg.norm(across)
    return changed(used, [f"jets.{jet}.force_n={[float(x) for x in stated]}"])


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.numerical
def test_what_chance_leaves_along_a_channel_is_six_squares() -> None:
    """Of twenty seeds and eighteen channels: on average six, within a quarter or a half, and none beyond one chance in a million."""
    flight = fly("free-flyer", *RANDOM, seeds=tuple(range(1, 21)))
    found = [flow.examine(flight.log(i), VehicleSource(flight.vehicle, "t", "")) for i in range(20)]
    explained = np.array([told(one) for one in found])
    assert 0.5 * CHANNELS < explained.mean() < 1.25 * CHANNELS
    assert explained.max() < 38.3
    names = channel_names(flight.log(0), flight.vehicle)
    assert not any(channel_residual_test(one.settled, one.samples, names, 1.0) for one in found)


@pytest.mark.parametrize("jet", [7, *(pytest.param(jet, marks=pytest.mark.thorough) for jet in (0, 13))])
def test_a_jet_that_points_elsewhere_is_followed_and_none_where_all_are_as_stated(jet: int) -> None:
    flight = fly("free-flyer", *RANDOM, seeds=(SEED,))
    found = flow.examine(flight.log(0), VehicleSource(turned(flight.vehicle, jet, 0.05), "t", ""))
    names = channel_names(flight.log(0), flight.vehicle)
    doubts = channel_residual_test(found.settled, found.samples, names, 1.0)
    assert doubts
    assert doubts[0].sigmas > 5.0
    assert any(doubt.assumption.startswith(f"response to {names[jet]} ") for doubt in doubts)
    right = sound(SEED)
    assert not channel_residual_test(right.settled, right.samples, names, 1.0)
    assert told(right).max() < 38.3


@pytest.mark.numerical
def test_a_log_taken_part_by_part_tells_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    found = sound(SEED)
    whole = told(found)
    monkeypatch.setattr("massprop_cli.conclude.channelresiduals.BLOCK", 37)
    np.testing.assert_allclose(told(found), whole, rtol=1e-9)
