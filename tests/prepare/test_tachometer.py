"""What tachometers show of wheels' speeds, undone; against sums over a fine grid and least squares, written apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.actuators.wheel import WheelLog
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import recorded, tachometer
from tests import anypedestal

PERIOD_S, FINE, BEFORE = 0.05, 200, 4


def shown(speeds: Array, latency_s: float, window_s: float) -> Array:
    """(n,) readings, of speeds that go evenly from each record's end to the next; the first holds before."""
    at = np.arange(-BEFORE * FINE, (len(speeds) - 1) * FINE + 1) / FINE
    fine = np.interp(at, np.arange(len(speeds)), speeds)
    late, wide = round(latency_s / PERIOD_S * FINE), round(window_s / PERIOD_S * FINE)
    found = []
    for end in (BEFORE + np.arange(1, len(speeds))) * FINE - late:
        part = fine[end - wide : end + 1]
        found.append((part[1:] + part[:-1]).mean() / 2 if wide else part[0])
    return np.array(found)


@pytest.mark.parametrize(("latency_s", "window_s"), [(0.005, 0.0), (0.02, 0.0), (0.07, 0.0), (0.0, 0.02), (0.01, 0.05), (0.0, 0.1)])
def test_a_late_mean_becomes_the_speed_at_each_time(latency_s: float, window_s: float) -> None:
    """To a thousandth of its steps, but in the last cycles, which later readings would tell of, and the first, which earlier ones would."""
    rng = np.random.default_rng(1)
    speeds = np.append(np.full(8, 3.0), 3.0 + np.cumsum(rng.uniform(-2, 2, 300)))
    time_s = PERIOD_S * np.arange(len(speeds))
    found = tachometer.at_times(time_s, shown(speeds, latency_s, window_s), latency_s, window_s, 1e-10)
    told = slice(20, len(speeds) - 1 - int(np.ceil((latency_s + window_s) / PERIOD_S)))
    error = found[told] - speeds[told]
    if window_s >= PERIOD_S:  # speeds that alternate between two values have the same means
        error = (error[1:] + error[:-1]) / 2
    assert np.abs(error).max() < 2e-3
    assert np.abs(shown(speeds, latency_s, window_s)[told] - speeds[1:][told]).max() > 0.1


def drawn() -> tuple[Log, Vehicle]:
    rng = np.random.default_rng(5)
    own = anypedestal.tables(rng, 1)
    own = replace(own, pivot=own.cg)
    flown = anypedestal.fly(rng, own, "wheels", PERIOD_S, 40.0, 0.0)
    data = anypedestal.vehicle_of(own, 0, flown).model_dump(by_alias=True, exclude_unset=True, mode="json")
    used = Vehicle.model_validate(data | {"environment": {"kind": "free"}})
    return anypedestal.log_of(rng, own, 0, flown, used, 0.0), used


@pytest.mark.thorough
def test_what_is_left_of_rounding_errors_does_not_follow_the_speeds() -> None:
    """By the loop that holds the vehicle still rates by net momentum are small, and their regression on rounded speeds is attenuated."""
    log, _ = drawn()
    exact = np.stack([np.asarray(one.speed_rad_s) for one in log.spinning if isinstance(one, WheelLog)], 1)
    step, axes = 4 * anypedestal.RPM, anypedestal.TETRAHEDRON
    momentum = exact @ axes
    slopes = {}
    for name in ("rounded", "calibrated"):
        trials = []
        for offset in np.linspace(0.0, 1.0, 12, endpoint=False):  # where between two counts the speeds lie is chance
            speeds = (np.round(exact / step + offset) - offset) * step
            if name == "calibrated":
                speeds = np.stack(tachometer.calibrated(list(speeds.T), [step**2 / 12 * np.eye(1, 40)[0]] * 4), 1)
            change, true = (np.diff(one[20:], axis=0).ravel() for one in (speeds @ axes, momentum))
            trials.append(change @ true / (change @ change))
        slopes[name] = np.mean(trials)
    # errors of two readings over the change's own size: 2 e² 4/3 J² about each axis
    usual = float(np.mean(np.diff(momentum[20:], axis=0) ** 2))
    expected = 2 * step**2 / 12 * (4 / 3) / usual
    assert expected > 0.015
    assert slopes["rounded"] == pytest.approx(1 - expected, abs=0.3 * expected)
    assert abs(slopes["calibrated"] - 1) < 0.2 * expected


@pytest.mark.thorough
def test_exact_speeds_stay_as_they_are_and_none_is_corrected_twice() -> None:
    log, used = drawn()
    assert recorded.corrected_log(log, used) is log
    late = used.model_copy(update={"wheels": tuple(one.model_copy(update={"speed_latency_s": 0.02}) for one in used.wheels)})
    late = Vehicle.model_validate(late.model_dump(by_alias=True, exclude_unset=True, mode="json"))
    once = recorded.corrected_log(log, late)
    assert recorded.corrected_log(once, late) is once


def test_ten_records_to_a_cycle_are_calibrated_by_their_means() -> None:
    """White errors of single records weigh a tenth as much, and every record of a cycle is corrected alike."""
    rng = np.random.default_rng(3)
    true = np.repeat(rng.normal(0, 1.0, 4000), 10)  # a loop that changes the speed once a cycle, about one value
    noisy = true + rng.normal(0, 1.5, len(true))
    (found,) = tachometer.calibrated([noisy], [1.5**2 * np.eye(1, 400)[0]], 10)
    means = [one.reshape(-1, 10).mean(1) for one in (true, noisy, found)]
    change, before, after = (np.diff(one)[10:-10] for one in means)
    assert before @ change / (before @ before) == pytest.approx(1 / 1.225, abs=0.05)
    assert after @ change / (after @ after) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("cycles", [60, 400])
def test_a_motion_as_nowhere_else_in_the_log_is_no_error_of_the_tachometers(cycles: int) -> None:
    """Speeds of smooth torques that begin at once: what the log's middle never showed was taken for errors of a thousand sigma."""
    rng, sigma = np.random.default_rng(3), 3e-5
    time = np.arange(cycles)
    true = [100 + 5 * np.sin(0.05 * time + n) + np.cumsum(np.where(time < 6, rng.normal(size=cycles), 0)) for n in range(3)]
    read = [one + sigma * rng.normal(size=cycles) for one in true]
    found = tachometer.calibrated(read, [np.eye(1, 40)[0] * sigma**2] * 3)
    assert max(np.abs(one - other).max() for one, other in zip(found, read, strict=True)) < 5 * sigma
