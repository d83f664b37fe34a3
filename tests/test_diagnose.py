"""Faults are named by logs that have them, and by no others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import analysis
from massprop_cli.telemetry import Log
from massprop_cli.testbed import scenario, simulate, truth
from massprop_cli.vehicle import Vehicle, VehicleSource

PLAN = [
    "duration_s=20.0",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=20.0}]',
]
Mistake = Callable[[Log, Vehicle], tuple[Log, Vehicle]]


def degrees(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return replace(log, delta_theta_imu_rad=np.degrees(log.delta_theta_imu_rad)), used


def in_g(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return replace(log, delta_v_imu_m_s=log.delta_v_imu_m_s / 9.80665), used


def transposed(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    rows = tuple(tuple(float(x) for x in row) for row in np.array(used.imu.body_from_imu).T)
    return log, used.model_copy(update={"imu": used.imu.model_copy(update={"body_from_imu": rows})})


def nothing(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return log, used


def failure(jets: list[str], thrust: float) -> list[str]:
    return ["actuators.failures=[" + ", ".join(f'{{jet="{jet}", thrust={thrust}}}' for jet in jets) + "]"]


@pytest.mark.parametrize(
    ("keys", "mistake", "code", "words"),
    [
        ([], degrees, "gyro-units", "degrees"),
        pytest.param([], in_g, "accel-units", "in g", marks=pytest.mark.slow),
        ([], transposed, "imu-mounting", "the transpose of what is stated"),
        (failure(["pitch_p1"], -1.0), nothing, "jet-sign", "pitch_p1"),
        pytest.param(failure(["divert_zn"], -1.0), nothing, "jet-sign", "divert_zn", marks=pytest.mark.slow),
        pytest.param(failure(["yaw_n2"], 0.0), nothing, "jet-dead", "yaw_n2", marks=pytest.mark.slow),
        pytest.param(failure(["divert_xp", "divert_xn"], 0.8), nothing, "thrust-scale", "divert_xp (+0.8", marks=pytest.mark.slow),
        (["actuators.delay_cycles=4.0"], nothing, "delay-mismatch", "shows 4"),
    ],
)
def test_a_fault_is_named(keys: list[str], mistake: Mistake, code: str, words: str) -> None:
    flown = simulate.fly(scenario.load("free-flyer", [*PLAN, *keys]), [3])
    log, used = mistake(flown.log(0), flown.vehicle)
    notices = analysis.examine(log, VehicleSource(used, "t", "")).notices
    said = [notice.message for notice in notices if notice.code == code]
    assert said, [notice.code for notice in notices]
    assert words in said[0].replace("+0.79", "+0.8")
    # the other suppositions stay unsaid
    named = {"gyro-units", "accel-units", "imu-mounting", "jet-sign", "jet-dead", "thrust-scale", "delay-mismatch"}
    assert {notice.code for notice in notices} & named == {code}


@pytest.mark.parametrize("logs", [1, pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["free-flyer", "testbed"])
def test_clean_logs_raise_no_warning(name: str, logs: int) -> None:
    flown = simulate.fly(scenario.load(name), range(10, 10 + logs))
    for member in range(logs):
        assert analysis.examine(flown.log(member), VehicleSource(flown.vehicle, "t", "")).notices == ()


@pytest.mark.thorough
def test_a_misfit_that_nothing_supposed_explains_is_not_given_a_name() -> None:
    flown = simulate.fly(scenario.load("free-flyer", [*PLAN, "disturbance.walk_n_m=0.01"]), [3])
    codes = {notice.code for notice in analysis.examine(flown.log(0), VehicleSource(flown.vehicle, "t", "")).notices}
    assert codes == {"disturbance-torque"}


@pytest.mark.thorough
def test_an_undeclared_docking_is_reported_with_its_time() -> None:
    docked = [
        "docked={ixx=0.2, iyy=0.3, izz=0.3, mass=4.0, cg_x=0.4, cg_y=0.1}",
        'events=[{kind="dock", cycle=173, motion="momentum_conserved"}]',
        'vehicle.phases=[{name="all", start_s=0.0, end_s=20.0}]',
    ]
    flown = simulate.fly(scenario.load("free-flyer", [*PLAN, *docked]), [3])
    notices = analysis.examine(flown.log(0), VehicleSource(flown.vehicle, "t", "")).notices
    (said,) = [notice.message for notice in notices if notice.code == "mass-change"]
    time = float(said.split("at once at ")[1].split(" s")[0])
    assert abs(time - 173 * 0.05) <= 0.1
    cut = flown.vehicle.model_copy(update={"estimator": flown.vehicle.estimator.model_copy(update={"split_on_change": True})})
    found = analysis.examine(flown.log(0), VehicleSource(cut, "t", ""))
    assert [conclusion.phase.name for conclusion in found.conclusions] == ["all-1", "all-2"]
    assert [notice.code for notice in found.notices] == ["mass-change"]
    before = truth.values(truth.bodies(scenario.load("free-flyer").scenario.truth, 1))[0]
    for conclusion, true in zip(found.conclusions, (before, flown.truth[0, 0]), strict=True):
        for value, estimate in zip(true, conclusion.estimates.values(), strict=True):
            assert estimate.value is not None
            assert estimate.sigma is not None
            assert abs(estimate.value - value) < 4.5 * estimate.sigma
