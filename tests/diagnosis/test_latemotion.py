"""What makes motion late is named with its size: valves, clocks, low-passes, and the delay of commands."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.testbed import scenario, simulate
from tests import faulty
from tests.diagnosis.test_diagnose import examined, later, low_passed
from tests.flown import PLAN, fly

SLOWER = {"rise_s": 0.004, "fall_s": 0.006}
"""Of all valves, beyond what the free flyer's are."""


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("ramp", "by_s", "words"),
    [
        ("rise_s", 0.004, "longer to rise than rise_s states, like a valve that opens 2 ms later: each pulse gives less impulse"),
        ("fall_s", 0.006, "longer to fall than fall_s states, like a valve that closes 3 ms later: each pulse gives more impulse"),
    ],
)
def test_valves_that_open_or_close_late_are_named_and_mended(ramp: str, by_s: float, words: str) -> None:
    """Each pulse gives so much less or more whatever its length: as stated, inertias are hundreds of sigmas off."""
    jets = scenario.load("free-flyer").scenario.vehicle.jets
    slow = [f"vehicle.jets.{i}.{key}={getattr(jet, key) + more}" for i, jet in enumerate(jets) for key, more in SLOWER.items()]
    flown = fly("free-flyer", *PLAN, *slow)
    quick = tuple(jet.model_copy(update={ramp: getattr(jet, ramp) - by_s}) for jet in flown.vehicle.jets)
    found = faulty.examined(flown.log(0), flown.vehicle.model_copy(update={"jets": quick}))
    (said,) = [notice.message for notice in found.notices if notice.code == "thrust-rise"]
    assert words in re.sub(r"(\d)\.0\d* ms", r"\1 ms", re.sub("(1.9|2.9)\\d* ms", lambda one: f"{round(float(one[1]))} ms", said))
    (answer,) = found.mended
    for (name, item), true in zip(answer.conclusions[0].estimates.items(), flown.truth[0][0], strict=True):
        assert item.value is not None, name
        assert item.sigma is not None, name
        assert abs(item.value - true) < 4 * item.sigma, name


@pytest.mark.thorough
def test_a_delay_is_as_certain_as_it_is_said_to_be() -> None:
    """With a delay above 4 a log holds a cycle less of which the commands are known, whose likelihood was missed: 7 sigma below 4."""
    found = examined(later, seed=3).detected
    assert found is not None
    assert abs(found.at.delay - 4.0) < 4 * found.sigma.delay < 0.002


@pytest.mark.thorough
def test_a_drifting_clock_is_named_with_its_rate_and_mended() -> None:
    """The IMU's clock is 2,500 ppm fast: its cycles begin up to one earlier than the commands'. Sampled from a flight in fine records."""
    fine = fly("free-flyer", *PLAN, "sensors.records_per_cycle=20", "sensors.gyro_noise_rad_s=0.0", "sensors.accel_noise_m_s2=0.0")
    flown = fly("free-flyer", *PLAN)
    truth, log = fine.log(0), flown.log(0).part(0, flown.log(0).cycles - 3)
    rng = np.random.default_rng(1)

    def seen(increments: Array, sigma: float) -> Array:
        total = np.vstack([np.zeros(3), np.cumsum(increments, 0)])
        at = np.concatenate([[0.0], log.time_s]) * (1 - 2.5e-3)
        sampled = np.stack([np.interp(at, np.concatenate([[0.0], truth.time_s]), column) for column in total.T], 1)
        white = sigma * np.sqrt(log.records_per_cycle) * log.interval_s[:, None]
        found: Array = np.diff(sampled, axis=0) + white * rng.standard_normal((len(at) - 1, 3))
        return found

    imu = flown.vehicle.imu
    drifted = replace(
        log,
        began_s=None,
        delta_theta_imu_rad=seen(truth.delta_theta_imu_rad, imu.gyro_noise_rad_s or 0.0),
        delta_v_imu_m_s=seen(truth.delta_v_imu_m_s, imu.accel_noise_m_s2 or 0.0),
    )
    found = faulty.examined(drifted, flown.vehicle)
    (answer,) = found.mended
    assert answer.fault.notice.code == "clock-drift"
    ((_, ppm),) = [setting.split("=") for setting in answer.settings if setting.startswith("imu.clock_drift_ppm")]
    assert float(ppm) == pytest.approx(2500, abs=25)
    for true, e in zip(flown.truth[0, 0], answer.conclusions[0].estimates.values(), strict=True):
        assert abs((e.value or 0.0) - true) < 4.5 * (e.sigma or 0.0)


@pytest.mark.parametrize(("sensor", "lag_s"), [("accel", 0.1), pytest.param("gyro", 0.075, marks=pytest.mark.thorough)])
def test_a_low_passed_sensor_is_named_with_its_time_constant_and_mended(sensor: Literal["gyro", "accel"], lag_s: float) -> None:
    """Of two cycles or one and a half, stated by none: the time constant within its sigma, and the values that it gives within theirs."""
    found = examined(low_passed(sensor, lag_s))
    (answer,) = found.mended
    assert answer.fault.notice.code == f"{sensor}-filter"
    said = {key: float(value) for key, _, value in (setting.partition("=") for setting in answer.settings)}
    assert abs(said[f"imu.{sensor}_lag_s"] - lag_s) < 4 * said[f"imu.{sensor}_lag_sigma_s"] < 0.1 * lag_s
    for true, e in zip(fly("free-flyer", *PLAN).truth[0, 0], answer.conclusions[0].estimates.values(), strict=True):
        assert abs((e.value or 0.0) - true) < 4.5 * (e.sigma or 0.0)


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_jet_that_fires_at_the_end_alone_and_not_under_the_right_delay_hides_it_not() -> None:
    """Its column is there under the stated delay of one cycle, and not under that of two."""
    command = fly("free-flyer", *PLAN).log(0).command.copy()
    command[:, -1], command[-3, -1] = 0.0, 0.05
    flown = simulate.fly(scenario.load("free-flyer", PLAN), [3], issued=command)
    found = faulty.examined(flown.log(0), faulty.stated(flown.vehicle, "cycle.command_delay_cycles=1"))
    assert [notice.code for notice in found.notices] == ["delay-mismatch"]
    (mended,) = found.mended
    assert np.abs((mended.conclusions[0].values - flown.truth[0][-1]) / mended.conclusions[0].sigmas).max() < 4.5
