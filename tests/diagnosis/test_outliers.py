"""Readings that are none of the motion are left out, told, and move no value; nothing else is taken for one."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.diagnosis import outliers
from massprop_cli.estimate.history import phase_cycles
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.inputs.vehiclefile import changed
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from tests import faulty
from tests.diagnosis.test_diagnose import LAG, dead
from tests.diagnosis.test_screening import thrust
from tests.flown import PLAN, fly

ROWS = [61, 62, 150, 233, 399]
"""Two in a row, and the last."""


@pytest.fixture(scope="module")
def flight() -> tuple[Log, Vehicle]:
    return faulty.sample("free-flyer", 20.0)


def spiked(log: Log, sensor: str, rows: list[int], size: float) -> Log:
    name = {"gyro": "delta_theta_imu_rad", "accel": "delta_v_imu_m_s"}[sensor]
    increments = getattr(log, name).copy()
    signs = np.where(np.arange(len(rows)) % 2 == 0, size, -size)
    increments[rows, np.arange(len(rows)) % 3] += signs * log.interval_s[rows]
    return replace(log, **{name: increments})


@pytest.mark.parametrize(("sensor", "size"), [("gyro", 0.01), ("accel", 2.0)])
def test_spikes_are_told_and_each_value_is_that_of_the_log_without_them(flight: tuple[Log, Vehicle], sensor: str, size: float) -> None:
    log, used = flight
    clean, found = faulty.examined(log, used), faulty.examined(spiked(log, sensor, ROWS, size), used)
    assert clean.notices == ()
    (notice,) = found.notices
    assert notice.code == "outliers"
    assert all(f"{row} (" in notice.message for row in ROWS)
    assert getattr(found.vehicle.imu, f"{sensor}_outliers_s") == tuple(round(float(log.time_s[row]), 9) for row in ROWS)
    for name in QUANTITIES:
        before, after = clean.conclusions[0].estimates[name], found.conclusions[0].estimates[name]
        assert after.verdict == before.verdict
        if before.value is not None and before.sigma is not None:
            assert after.value == pytest.approx(before.value, rel=0, abs=0.6 * before.sigma)
            assert after.sigma == pytest.approx(before.sigma, rel=0.05)


def test_no_value_depends_on_how_far_out_a_reading_is(flight: tuple[Log, Vehicle]) -> None:
    log, used = flight
    found = [faulty.examined(spiked(log, "gyro", ROWS[:4], size), used) for size in (0.01, 0.1)]
    assert found[0].vehicle.imu == found[1].vehicle.imu
    one, other = (analysis.histories[0] for analysis in found)
    np.testing.assert_array_equal(one.values, other.values)
    np.testing.assert_array_equal(one.sigmas, other.sigmas)


def test_a_cut_at_a_later_cycle_changes_no_row(flight: tuple[Log, Vehicle]) -> None:
    log, used = flight
    log = spiked(log, "accel", ROWS[:3], 2.0)
    whole = faulty.examined(log, used).histories[0]
    part = faulty.examined(log.part(0, 260), used).histories[0]
    np.testing.assert_array_equal(part.values, whole.values[:258])
    assert np.isnan(whole.innovation[148, 3:]).all()
    assert np.isfinite(whole.innovation[148, :3]).all()


@pytest.mark.thorough
def test_times_that_are_given_back_give_the_same_and_none_uses_all(flight: tuple[Log, Vehicle]) -> None:
    log, used = flight
    log = spiked(log, "gyro", ROWS, 0.01)
    found = faulty.examined(log, used)
    times = json.dumps(list(found.vehicle.imu.gyro_outliers_s or ()))
    again = faulty.examined(log, changed(used, [f"imu.gyro_outliers_s={times}"]))
    np.testing.assert_array_equal(again.histories[0].values, found.histories[0].values)
    assert [n.code for n in again.notices] == []
    everything = faulty.examined(log, changed(used, ["imu.gyro_outliers_s=[]"]))
    assert "outliers" not in {n.code for n in everything.notices}
    assert "gyro-misfit" in {n.code for n in everything.notices}


@pytest.mark.thorough
def test_many_are_a_misfit(flight: tuple[Log, Vehicle]) -> None:
    log, used = flight
    rows = list(range(20, 390, 30))
    assert "outliers" not in {n.code for n in faulty.examined(spiked(log, "gyro", rows, 0.01), used).notices}


@pytest.mark.parametrize(
    ("key", "stated"),
    [
        (dead("roll_p1"), ""),
        ("", thrust("divert_zn", 0.5)),
        ("", "cycle.command_delay_cycles=0.5"),
        (LAG, ""),
    ],
)
def test_a_wrong_model_has_no_outliers(key: str, stated: str) -> None:
    flown = fly("free-flyer", *PLAN, *([key] if key else []))
    assert not searched(flown.log(0), changed(flown.vehicle, [stated] if stated else []))


@pytest.mark.parametrize("name", ["free-flyer", "air-bearing", "docking", "high-rate"])
def test_clean_samples_have_none(name: str) -> None:
    assert not searched(*faulty.sample(name))


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("name", ["free-flyer", "testbed", "docking"])
def test_logs_without_fault_have_none(name: str) -> None:
    flown = fly(name, seeds=tuple(range(1, 11)))
    assert not any(searched(flown.log(member), flown.vehicle) for member in range(10))


def test_a_log_that_is_driven_without_a_pause_has_none() -> None:
    """Commands that never end say nothing of rows before the first: these are nothing to hold the first ones against."""
    every = {"roll": 10, "pitch": 14, "yaw": 18, "x": 12, "y": 16, "z": 20}
    pulses = ", ".join(
        f'{{motion="alternating", axes=["{axis}"], start_s=0.0, end_s=10.0, every_cycles={cycles}, '
        f"closed_loop={str(axis in ('roll', 'pitch', 'yaw')).lower()}}}"
        for axis, cycles in every.items()
    )
    flown = fly("free-flyer", "duration_s=10.0", f"plan=[{pulses}]", seeds=tuple(range(20, 28)))
    assert not any(searched(flown.log(member), flown.vehicle) for member in range(8))


def searched(log: Log, used: Vehicle) -> bool:
    """Whether anything in a log is taken for an outlier."""
    samples = Stream.of(log, used, Timing(float(used.cycle.command_delay_cycles), 0.0))
    phases = used.phases or (Phase(name="all", start_s=0.0, end_s=1e9),)
    pieces = [phase_cycles(phase, log.cycle_end_s, log.cycle_end_s > samples.usable_s + 0.01) for phase in phases]
    return bool(outliers.with_outliers(log, used, samples, pieces)[1])


def test_at_its_ends_a_fast_spin_is_as_usual_as_its_own_curvature_and_a_spike_is_not() -> None:
    """The rate before had stood for the last, off by all that a nutating body's rate changes by in a cycle; that looked like an outlier."""
    angle = 0.2 * np.arange(100)
    rate = np.stack([np.full(100, 6.3), 1.5 * np.cos(angle), 1.5 * np.sin(angle)], 1)
    step, curvature = 1.5 * 0.2, 1.5 * 0.2**2
    for end in (0, -1):
        assert np.abs(outliers._median_rate(rate) - rate)[end].max() < 1.05 * curvature
        for spike in (-2.0, 2.0):
            spiked = rate.copy()
            spiked[end] += spike
            assert np.abs(outliers._median_rate(spiked) - rate)[end].max() < 1.05 * step


def test_counts_of_coarse_sensors_at_rest_are_no_records_that_came_late() -> None:
    """One in 700 is 0 in all six, and twelve times as many are in all but one."""
    log, _ = faulty.sample("free-flyer")
    counts = 1e-4 * np.random.default_rng(1).integers(-1, 2, (len(log.time_s), 6))
    none = (counts == 0).all(1)
    assert none.any()
    assert not (none[1:] & none[:-1]).any()
    assert not len(outliers._doubled(replace(log, delta_theta_imu_rad=counts[:, :3], delta_v_imu_m_s=counts[:, 3:])))
