"""A phase that holds some cycles of something else is named, with where it should begin or end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.diagnosis.phaseboundary import phase_boundary
from massprop_cli.diagnosis.screening import screened
from tests import faulty
from tests.diagnosis.test_screening import look_at, otherwise, thrust
from tests.flown import PLAN, fly

DOCKING = (
    "duration_cycles=500",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw", "y"], start_cycle=0, end_cycle=500}]',
    'events=[{kind="dock", cycle=250, motion="rates_kept", phase="combined"}]',
)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("cycles", [-18, 30])
def test_docking_that_is_stated_early_or_late_is_named_and_mended(cycles: int) -> None:
    flown = fly("docking", *DOCKING, seeds=(4,))
    log, used = flown.log(0), flown.vehicle
    first, second = used.phases
    period = used.cycle.period_s
    wrong = faulty.stated(used, f"phases.0.end_s={first.end_s + cycles * period}", f"phases.1.start_s={first.end_s + cycles * period}")
    found = faulty.examined(log, wrong)
    (said,) = [notice.message for notice in found.notices if notice.code == "phase-border"]
    which, phase = ("last", first) if cycles > 0 else ("first", second)
    assert f"{which} " in said
    assert f"of phase {phase.name}, that is" in said
    (mended,) = found.mended
    (setting,) = mended.settings
    key, value = setting.split("=")
    assert key == ("phases.0.end_s" if cycles > 0 else "phases.1.start_s")
    # nothing tells it while nothing is commanded
    assert float(value) == pytest.approx(first.end_s, abs=10 * period)
    number = 0 if cycles > 0 else 1
    for one, expected in zip(mended.conclusions[number].estimates.values(), flown.truth[0, number], strict=True):
        assert abs((one.value or 0.0) - expected) < 4.5 * (one.sigma or 0.0)


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_vehicle_that_is_held_as_its_log_begins_is_named() -> None:
    """Nothing moves for the first 22 cycles though jets fire: somebody has it in his hands. The clock counts from 1970."""
    origin_s = 1763000000.0
    flown = fly("free-flyer", *PLAN)
    held = replace(flown.log(0), time_s=flown.log(0).time_s + origin_s)
    turned, felt = held.delta_theta_imu_rad.copy(), held.delta_v_imu_m_s.copy()
    rng = np.random.default_rng(6)
    noise = flown.vehicle.imu.gyro_noise_rad_s or 0.0, flown.vehicle.imu.accel_noise_m_s2 or 0.0
    for column, level in zip((turned, felt), noise, strict=True):
        column[:22] = level * held.interval_s[:22, None] * rng.standard_normal((22, 3))
    found = faulty.examined(faulty.with_increments(held, turned, felt), flown.vehicle)
    (said,) = [notice.message for notice in found.notices if notice.code == "phase-border"]
    assert "the log fits without the first " in said
    (mended,) = found.mended
    (setting,) = mended.settings
    start_s = float(setting.split("start_s = ")[1].split(",")[0])
    assert 0.9 < start_s - origin_s < 1.5
    for name, expected in zip(QUANTITIES, flown.truth[0, 0], strict=True):
        one = mended.conclusions[0].estimates[name]
        assert abs((one.value or 0.0) - expected) < 4.5 * (one.sigma or 0.0)


@pytest.mark.parametrize("key", ["", thrust("yaw_p1", 0.8), "cycle.command_delay_cycles=1.5"])
def test_what_is_wrong_all_along_or_not_at_all_has_no_border(key: str) -> None:
    assert phase_boundary(otherwise(*([key] if key else [])), 20.0) is None


@pytest.mark.thorough
def test_of_a_long_log_nothing_is_left_out_that_was_not_looked_at() -> None:
    """The stretch that is looked at ends amid the log, in somebody's hands; what comes then is good."""
    screening = look_at("free-flyer", *PLAN)
    log = screening.case.log
    turned = log.delta_theta_imu_rad.copy()
    turned[-25:] = 0.0
    case = screening.case._replace(log=faulty.with_increments(log, turned, log.delta_v_imu_m_s), designs=None)
    held = screened(case, screening.piece)
    assert held is not None
    assert phase_boundary(held, float(log.time_s[-1])) is not None
    assert phase_boundary(held, float(log.time_s[-1]) + 60.0) is None
