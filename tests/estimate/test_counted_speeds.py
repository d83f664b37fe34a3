"""Wheels whose tachometers count slowly: what stands between two counts, and what an estimate is worth by it.

A body that starts at rest with its wheels at rest has no momentum, so its rate is ``ω = −I⁻¹ A J Ω`` by the speeds Ω (Sidi, Spacecraft
Dynamics and Control, 1997, chapter 7), and nothing is integrated.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from massprop_cli import CG, INERTIA, flow
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.export import resolve
from massprop_cli.inputs import columns
from massprop_cli.inputs.actuators.wheel import dequantised
from massprop_cli.inputs.tablefile import at_hand
from massprop_cli.inputs.telemetry import read
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource

RPM = np.pi / 30
RECORD_S, PERIOD_S, FINE = 0.005, 0.025, 10
BODY = np.array([[0.23, 0.001, 0.012], [0.001, 0.24, -0.004], [0.012, -0.004, 0.14]])
TRUE = dict(zip(INERTIA, BODY[np.triu_indices(3)], strict=True)) | dict(zip(CG, (0.005, 0.009, -0.007), strict=True))
IMU, SPIN, NOISE = np.array([0.08, 0.05, -0.13]), 1e-3, (1e-4, 5e-3)


@pytest.mark.parametrize("slope", [0.0671, 0.1371, 0.3141, 0.4633])
def test_what_goes_evenly_is_told_between_counts(slope: float) -> None:
    """To the variance that is said, a quarter at most of a count's, between the first and the last change of the count."""
    exact = 3.2 + slope * np.arange(2000)
    value, variance, length = dequantised(np.round(exact))
    inner = slice(round(2 / slope), -round(2 / slope))
    error = (value - exact)[inner]
    assert 0.3 < np.mean(error**2) / np.mean(variance[inner]) < 1.2
    assert np.mean(error**2) < 1 / 48
    assert set(np.unique(length[inner])) == {int(1 / slope), int(np.ceil(1 / slope))}


def test_what_turns_back_lies_beyond_the_change_and_what_jumps_is_the_count() -> None:
    """A speed that rises over a count and falls again by the same moments was, in between, above their middle."""
    counts = np.array([0.0, 0, 1, 1, 1, 1, 0, 0, 5, 5, 0])
    value, variance, _ = dequantised(counts)
    np.testing.assert_allclose(value[2:6], [0.5 + 0.5 * (1 - (2 * u - 1) ** 2) for u in (0.125, 0.375, 0.625, 0.875)])
    np.testing.assert_array_equal(value[7:], counts[7:])
    np.testing.assert_allclose(variance[[3, 9]], [1 / 24, 1 / 12])


@cache
def flown(seed: int) -> tuple[Array, Array, Array]:
    """(n, 3) speeds at the records' ends, and increments without noise."""
    rng, fine = np.random.default_rng(seed), RECORD_S / FINE
    at = fine * np.arange(round(60 / fine) + 1)
    speeds = np.zeros((len(at), 3))
    for wheel in range(3):
        for period in rng.uniform(5, 20, 4):
            speeds[:, wheel] += rng.uniform(3, 8) * (1 - np.cos(2 * np.pi * at / period)) * rng.choice([-1, 1])
    rate = -SPIN * speeds @ np.linalg.inv(BODY)
    arm = IMU - np.array([TRUE[name] for name in CG])
    felt = np.cross(np.gradient(rate, fine, axis=0, edge_order=2), arm) + np.cross(rate, np.cross(rate, arm))

    def increments(values: Array) -> Array:
        sums = np.concatenate([np.zeros((1, 3)), np.cumsum((values[1:] + values[:-1]) * fine / 2, 0)])
        return np.diff(sums[::FINE], axis=0)

    return speeds[FINE::FINE], increments(rate), increments(felt)


def recorded(seed: int, step: float) -> tuple[dict[str, Array], VehicleSource]:
    """The columns of a log with speeds in whole steps, or exact ones, and its vehicle file."""
    speeds, turned, pushed = flown(seed)
    rng, made = np.random.default_rng(seed), {columns.TIME: RECORD_S * np.arange(1, len(speeds) + 1)}
    for names, values, noise in ((columns.DELTA_THETA, turned, NOISE[0]), (columns.DELTA_V, pushed, NOISE[1])):
        white = noise * np.sqrt(PERIOD_S / RECORD_S) * RECORD_S * rng.normal(size=values.shape)
        made |= dict(zip(names, (values + white).T, strict=True))
    shown = np.round(speeds / step) * step if step else speeds
    made |= {f"wheel_w{n}_rad_s": values for n, values in enumerate(shown.T)}
    spin = {"spin_inertia_kg_m2": SPIN, "locked_in_inertia": True}
    imu = {"position_m": IMU.tolist(), "gyro_noise_rad_s": NOISE[0], "accel_noise_m_s2": NOISE[1]}
    wheels = [{"name": f"w{n}", "axis": axis, **spin} for n, axis in enumerate(np.eye(3).tolist())]
    used = Vehicle.model_validate({"schema": 1, "cycle": {"period_s": PERIOD_S}, "imu": imu, "wheels": wheels})
    return made, VehicleSource(used, "counted", "")


def estimated(seed: int, step: float) -> Analysis:
    """The estimate of such a log."""
    made, source = recorded(seed, step)
    return flow.examine(read(at_hand(Path("counted"), made), source.vehicle), source)


@pytest.mark.parametrize("seed", [1, *(pytest.param(n, marks=[pytest.mark.thorough, pytest.mark.seeds]) for n in range(2, 13))])
def test_slow_wheels_in_whole_rpm_tell_nearly_what_exact_ones_do(seed: int) -> None:
    """As counts of which each is off by 0.29 rpm by itself they told of a model discrepancy, and inertia 5 to 270 times as badly."""
    counted, exact = (estimated(seed, step) for step in (RPM, 0.0))
    assert all(notice.code.startswith("noise-") for notice in counted.notices)
    for name, truth in TRUE.items():
        one, best = (answer.conclusions[0].estimates[name] for answer in (counted, exact))
        assert one.value is not None
        assert one.sigma is not None
        assert best.sigma is not None
        assert one.verdict == "converged"
        assert abs(one.value - truth) < 4 * one.sigma
        assert one.sigma < 4 * best.sigma


def test_on_board_a_count_is_all_that_is_known_yet(tmp_path: Path) -> None:
    """The noise with which a flight of the same vehicle starts is that of counts: an estimate on board waits for no later change."""
    made, source = recorded(1, RPM)
    pd.DataFrame(made).to_parquet(tmp_path / "log.parquet")
    on_board = resolve.from_log(source, tmp_path / "log.parquet").vehicle.imu.gyro_noise_rad_s
    on_ground = estimated(1, RPM).vehicle.imu.gyro_noise_rad_s
    assert on_board is not None
    assert on_ground is not None
    by_counts = RPM * SPIN / np.linalg.eigvalsh(BODY)[0] / np.sqrt(12 * PERIOD_S / RECORD_S)
    assert on_board**2 - NOISE[0] ** 2 > by_counts**2
    assert on_board > 1.5 * on_ground
