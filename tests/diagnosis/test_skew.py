"""A gyro whose axes are out of square: it looks turned, and no value that a shear moves is called good."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import frozen
from massprop_cli.diagnosis import explanation
from massprop_cli.diagnosis.channelwise import free_response
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import Correction, skew_corrections
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.prepare.timing import Timing
from tests import faulty, flight
from tests.flown import fly

TURNS = ", ".join(
    f'{{motion="random", axes=["{axis}"], every_cycles=5, max_cycles=4, start_cycle={60 * i}, end_cycle={60 * i + 60}}}'
    for i, axis in enumerate(("roll", "pitch", "yaw", "x", "y", "z"))
)
ALL = '{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], every_cycles=5, max_cycles=4, start_cycle=360, end_cycle=500}'
STEERED = (
    '{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], every_cycles=5, max_cycles=3, closed_loop=true, start_cycle=0, '
    "end_cycle=600}"
)
LEANING = np.array([[1.0, 0.01, 0.0], [0.0, 1.0, 0.01], [0.01, 0.0, 1.0]])
"""What each axis measures of the rates about the three."""


@pytest.mark.thorough
@pytest.mark.numerical
@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.seeds)])
def test_what_a_shear_moves_is_not_called_good(seed: int) -> None:
    """Before, moments had been converged 45 sigma off on other vehicles, stated and corrected alike."""
    flown = fly("free-flyer", "duration_s=25.0", f"plan=[{TURNS}, {ALL}]", seeds=(1, 3))
    log = flown.log(flown.seeds.index(seed))
    leaning = replace(log, delta_theta_imu_rad=frozen(log.delta_theta_imu_rad @ LEANING.T))
    found = faulty.examined(leaning, flown.vehicle)
    assert found.faults or found.unknown
    for conclusions in (found.conclusions, *(answer.conclusions for answer in found.mended)):
        for item, true in zip(conclusions[0].estimates.values(), flown.truth[0][0], strict=True):
            if item.verdict == "converged":
                assert item.value is not None
                assert item.sigma is not None
                assert abs(item.value - true) < 4 * item.sigma


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.numerical
@pytest.mark.parametrize("seed", [1, 2])
def test_where_a_turn_is_named_the_mended_values_hold_a_shear(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it a moment is many sigma off once corrected, whatever is made of it."""
    flown = fly("free-flyer", "duration_s=30.0", f"plan=[{STEERED}]", seeds=(1, 2))
    log = flown.log(flown.seeds.index(seed))
    little = np.eye(3) + 0.3 * (LEANING - np.eye(3))
    leaning = replace(log, delta_theta_imu_rad=frozen(log.delta_theta_imu_rad @ little.T))

    def farthest() -> float:
        found = faulty.examined(leaning, flown.vehicle)
        assert [fault.notice.code for fault in found.faults] == ["imu-mounting"]
        estimates = zip(found.mended[0].conclusions[0].estimates.values(), flown.truth[0][0], strict=True)
        return float(max(abs((one.value or 0.0) - true) / (one.sigma or 1e-300) for one, true in estimates))

    assert farthest() < 4
    monkeypatch.setattr(explanation, "skew_corrections", lambda *_: ())
    assert farthest() > 8


def test_a_small_turn_may_be_a_shear_of_the_same_size_and_a_large_one_is_none() -> None:
    """An axis that leans by ε towards another turns both by ε/2 and shears them by ε/2."""
    flown = flight.standard()
    model = Model.of(free_response(Case(flown.log(), flown.resolved, Timing(2.0, 0.0)), slice(2, 320)), flown.used, 0.0, "jets")
    cure = Correction(settings=("imu.body_from_imu=[[1, 0, 0], [0, 1, 0], [0, 0, 1]]",))

    def found(angle: float) -> Fitted:
        x = model.stated.copy()
        x[model.place("gyro_turn")] = angle * np.array([0.6, 0.0, 0.8])
        return Fitted(Hypothesis("imu-mounting", (), np.zeros((len(x), 0))), model, x, np.zeros(6), np.zeros(0))

    shears = [np.array(one.gyro) - np.eye(3) for one in skew_corrections(cure, found(0.01))]
    assert [one.settings for one in skew_corrections(cure, found(0.01))] == [cure.settings] * 3
    assert all(np.array_equal(shear, shear.T) for shear in shears)
    np.testing.assert_allclose(np.sum(shears, 0), 0.01 * (1 - np.eye(3)))
    assert skew_corrections(cure, found(0.03)) == skew_corrections(cure, found(0.0)) == skew_corrections(None, found(0.01)) == ()
