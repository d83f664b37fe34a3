"""A time in which something held the vehicle, or nothing was executed, is named; a change or a fault all along has none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.configfile import literal
from massprop_cli.diagnosis.undisturbed import undisturbed
from massprop_cli.flow import Analysis
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from tests import faulty
from tests.diagnosis.test_screening import look_at, otherwise, thrust
from tests.flown import RANDOM, fly

LATE_S = 20.0
"""When these flights end."""


def held(log: Log, used: Vehicle, *pieces: slice) -> Log:
    """In which cycles nothing moves, whatever is commanded: somebody has the vehicle in his hands."""
    turned, felt = log.delta_theta_imu_rad.copy(), log.delta_v_imu_m_s.copy()
    rng = np.random.default_rng(6)
    for column, level in zip((turned, felt), (used.imu.gyro_noise_rad_s or 0.0, used.imu.accel_noise_m_s2 or 0.0), strict=True):
        for piece in pieces:
            column[piece] = level * log.interval_s[piece, None] * rng.standard_normal(column[piece].shape)
    return faulty.with_increments(log, turned, felt)


def shut(begin_s: float, end_s: float, part: float = 0.0, names: Sequence[str] = ()) -> str:
    """A setting of a scenario whose jets all give no thrust for a time, or a part of it."""
    names = names or [jet.name for jet in fly("free-flyer", *RANDOM).vehicle.jets]
    each = ", ".join(f'{{jet="{name}", thrust={part}, start_s={begin_s}, end_s={end_s}}}' for name in names)
    return f"actuators.failures=[{each}]"


def kept_s(found: Analysis) -> list[tuple[float, float]]:
    """Begin and end of the phases of the corrected estimate."""
    (corrected,) = found.mended
    stated = next(setting for setting in corrected.settings if setting.startswith("phases="))
    phases = literal(stated.removeprefix("phases="))
    assert isinstance(phases, list)
    return [(one["start_s"], one["end_s"]) for one in phases]


def assert_right(found: Analysis, truth: np.ndarray) -> None:
    """Each body of the corrected estimate is the one that flew."""
    (corrected,) = found.mended
    for conclusion in corrected.conclusions:
        for name, expected in zip(QUANTITIES, truth, strict=True):
            one = conclusion.estimates[name]
            assert abs((one.value or 0.0) - expected) < 4.5 * (one.sigma or 0.0), name


@pytest.mark.thorough
@pytest.mark.seeds
def test_valves_that_are_shut_for_a_time_are_named_and_corrected() -> None:
    flown = fly("free-flyer", *RANDOM, shut(8.0, 11.0))
    found = faulty.examined(flown.log(0), fly("free-flyer", *RANDOM).vehicle)
    (said,) = [notice.message for notice in found.notices if notice.code == "phase-border"]
    assert "commands were not executed; state" in said
    assert "mass properties" not in said
    (_, end_s), (begin_s, _) = kept_s(found)
    assert 7.5 < end_s < 8.2
    assert 11.0 < begin_s < 11.7
    assert_right(found, flown.truth[0, 0])


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_vehicle_that_is_held_at_both_ends_is_named_and_corrected() -> None:
    flown = fly("free-flyer", *RANDOM)
    log = held(flown.log(0), flown.vehicle, slice(0, 60), slice(320, None))
    found = faulty.examined(log, flown.vehicle)
    (said,) = [notice.message for notice in found.notices if notice.code == "phase-border"]
    assert "before and after that" in said
    ((begin_s, end_s),) = kept_s(found)
    assert 2.9 < begin_s < 4.0
    assert 15.0 < end_s < 16.2
    assert_right(found, flown.truth[0, 0])


@pytest.mark.seeds
@pytest.mark.thorough
def test_jets_that_are_armed_late_are_no_change_of_the_body() -> None:
    """For a quarter of the log, longer than any time that is left out at one end alone."""
    flown = fly("free-flyer", *RANDOM, shut(0.0, 4.8))
    found = faulty.examined(flown.log(0), fly("free-flyer", *RANDOM).vehicle)
    assert "mass-change" not in {notice.code for notice in found.notices}
    ((begin_s, _),) = kept_s(found)
    assert 4.7 < begin_s < 5.6
    assert_right(found, flown.truth[0, 0])


@pytest.mark.parametrize("key", ["", thrust("yaw_p1", 0.8), "cycle.command_delay_cycles=1.5"])
def test_what_is_wrong_all_along_or_not_at_all_leaves_no_such_time(key: str) -> None:
    assert undisturbed(otherwise(*([key] if key else [])), LATE_S) is None


@pytest.mark.seeds
@pytest.mark.thorough
def test_of_a_long_log_nothing_is_cut_off_that_was_not_looked_at() -> None:
    """The stretch that is looked at ends amid the log, in somebody's hands; what comes then is good."""
    screening = look_at("free-flyer", *RANDOM)
    case = screening.case
    log = held(case.log, case.vehicle, slice(330, None))
    there = replace(screening, case=case._replace(log=log, designs=None))
    end_s = float(log.time_s[-1])
    assert undisturbed(there, end_s) is not None
    assert undisturbed(there, end_s + 60.0) is None


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_change_of_all_thrust_is_said_beside_a_change_of_the_body() -> None:
    """Nothing tells them apart; another body seldom answers in one proportion."""
    used = fly("planar").vehicle
    flown = fly("planar", shut(44.0, 60.0, 0.8, [jet.name for jet in used.jets]))
    found = faulty.examined(flown.log(0), used)
    (said,) = [notice.message for notice in found.notices if notice.code == "mass-change"]
    assert re.search(r"or if all thrust is 0\.(79|8|80)\d* of its former value from then on", said)
