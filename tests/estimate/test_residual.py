"""What the final values predict of a log, tested against the motion integrated by hand."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor
from massprop_cli.estimate.residual import Residual
from massprop_cli.flow import Analysis
from tests.analysed import analysed
from tests.faulty import examined, pushing, sample

WITH_TRUTH = ("free-flyer", "air-bearing", "docking", "high-rate")


def left(found: Analysis, phase: int = 0) -> Residual:
    told = found.settled[phase].residual
    assert told is not None
    return told


@pytest.mark.parametrize("name", WITH_TRUTH)
def test_what_is_left_of_a_good_log_is_the_noise_that_is_stated(name: str) -> None:
    """Mean square over the stated sigma within 4.5 of its own sampling scatter, √(2/N), in each of the six channels."""
    found = analysed(name)
    imu = found.vehicle.imu
    noise = np.repeat([imu.gyro_noise_rad_s or 0.0, imu.accel_noise_m_s2 or 0.0], 3)
    for phase in range(len(found.settled)):
        told = left(found, phase)
        value, sigma = told.value[1:], told.sigma[1:]
        assert np.isnan(told.value[0]).all(), "nothing is expected of a phase's first cycle"
        assert np.abs((value / noise) ** 2).mean(0) == pytest.approx(np.ones(6), abs=4.5 * np.sqrt(2 / len(value)))
        assert np.median(sigma, 0) == pytest.approx(noise, rel=0.01)


def integrated(found: Analysis, first_rate: Array, cycles: int) -> Array:
    """(K, 3) mean rates from a rate at the start: Euler's equations about O by fourth-order Runge–Kutta, torque constant over a bin."""
    history, values = found.histories[0], found.histories[0].values[-1]
    inertia, cg = tensor(values[:6]), values[6:9]
    executed = found.samples.part(slice(history.cycles.start, history.cycles.start + cycles)).executed
    bins = executed.impulse_bins.shape[1]
    step = (executed.duration_s / bins)[:, None, None]
    wrench = (executed.impulse_bins / step).reshape(-1, 6)
    inverse = np.linalg.inv(inertia)

    def grow(rate: Array, at: Array) -> Array:
        return np.asarray(inverse @ (at[:3] - np.cross(cg, at[3:]) - np.cross(rate, inertia @ rate)))

    rate, edges = first_rate, [first_rate]
    for at, h in zip(wrench, np.repeat(step.ravel(), bins), strict=True):
        a = grow(rate, at)
        b = grow(rate + h / 2 * a, at)
        c = grow(rate + h / 2 * b, at)
        rate = rate + h / 6 * (a + 2 * b + 2 * c + grow(rate + h * c, at))
        edges.append(rate)
    middle = np.array([(one + two) / 2 for one, two in pairwise(edges)])
    return np.asarray(middle.reshape(-1, bins, 3).mean(1))


@pytest.mark.thorough
def test_the_prediction_is_the_motion_that_the_commands_cause_from_the_first_moment_on() -> None:
    """Integrated from the first rate that fits it best; cycles 50 to 400 lie within 1.5 sigma of the gyro. Before, too little is told of
    the first rate."""
    found, count = analysed("free-flyer"), 400
    predicted = found.samples.part(found.histories[0].cycles).rate_rad_s - left(found).value[:, :3]
    first: Array = np.zeros(3)
    for _ in range(3):
        away = integrated(found, first, count)[50:] - predicted[50:count]
        first = first - away.mean(0)
    assert np.abs(away).max() < 1.5e-4
    assert np.ptp(predicted[1:count], axis=0).min() > 0.1


@cache
def reversed_jet() -> Analysis:
    log, used = sample("free-flyer")
    return examined(log, pushing(used, {"roll_p1": -1.0}))


@pytest.mark.thorough
def test_a_reversed_jet_leaves_a_gap_that_grows_to_hundreds_of_sigma() -> None:
    told = left(reversed_jet())
    size = np.abs(told.value[:, 0]) / told.sigma[:, 0]
    assert np.nanmax(size) > 300
    assert np.nanmax(np.abs(told.value[:, :3])) > 0.05


def test_a_reading_that_is_not_used_has_no_residual() -> None:
    log, used = sample("free-flyer", 20.0)
    flags = np.zeros((log.cycles, 2), dtype=bool)
    flags[200, 0] = flags[210, 1] = True
    found = examined(replace(log, ignored=flags), used)
    missing, first = np.isnan(left(found).value), found.histories[0].cycles.start
    assert np.argwhere(missing[1:, 0]).ravel().tolist() == [200 - first - 1]
    assert np.argwhere(missing[1:, 5]).ravel().tolist() == [210 - first - 1]
