"""A sensor that saturates is told where no range is stated; twenty shapes that look like it are not."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.clipped import at_extremes, stuck, with_unstated
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import faulty

RNG = np.random.default_rng(5)
COUNT = 600
COAST = np.zeros(COUNT, dtype=bool)
NOISE = 1e-3 * RNG.standard_normal((COUNT, 3))
SLOW = np.cumsum(np.where(RNG.random((COUNT, 3)) < 0.5, 1, -1), 0) * 0.005
WAVES = 0.1 * np.sin(np.outer(np.arange(COUNT), [0.02, 0.03, 0.05]))
PULSES = 0.1 * (RNG.random((COUNT, 3)) < 0.3)
SPIN = np.tile([0.0, 0.0, 0.3], (COUNT, 1))
STEPS = np.repeat(RNG.standard_normal((COUNT // 50, 3)), 50, 0)


def counts(values: Array, size: float) -> Array:
    return np.round(values / size) * size


CLEAN = {
    "noise": NOISE,
    "a walk": SLOW + NOISE,
    "a walk without noise": SLOW,
    "waves": WAVES + NOISE,
    "waves without noise": WAVES,
    "pulses": PULSES + NOISE,
    "pulses without noise": PULSES,
    "a spin": SPIN + NOISE,
    "a spin without noise": SPIN,
    "gravity that stands still but for rounding": np.column_stack(
        [WAVES[:, :2] + NOISE[:, :2], 9.80665 * (1 + 2e-16 * RNG.integers(-2, 2, COUNT))]
    ),
    "steps": STEPS + NOISE,
    "steps without noise": STEPS,
    "nothing": np.zeros((COUNT, 3)),
    "one axis alone": NOISE * [1, 0, 0],
    "fine counts": counts(WAVES + NOISE, 1e-3),
    "counts of twice the noise": counts(WAVES + NOISE, 2e-3),
    "coarse counts": counts(WAVES + NOISE, 0.02),
    "very coarse counts": counts(WAVES + NOISE, 0.1),
    "noise in coarse counts": counts(NOISE, 2e-3),
    "a spin in fine counts": counts(SPIN + NOISE, 1e-3),
    "pulses in fine counts": counts(PULSES + NOISE, 1e-3),
    "pulses in coarse counts": counts(PULSES + NOISE, 0.01),
    "each reading twice": np.repeat((WAVES + NOISE)[: COUNT // 2], 2, 0),
    "a spin that ends": np.where(np.arange(COUNT)[:, None] < 300, SPIN, 0.0) + NOISE,
    "single precision": (WAVES + NOISE).astype(np.float32).astype(float),
    "one side of rest": np.minimum(WAVES, 0.0) + NOISE,
    "rest without noise below": np.minimum(WAVES, 0.0),
}


@pytest.mark.parametrize("name", CLEAN)
def test_what_does_not_saturate_is_not_told(name: str) -> None:
    assert not at_extremes(CLEAN[name], np.ones(COUNT)).any()


@pytest.mark.parametrize("name", ["a walk", "waves", "a spin that ends", "fine counts", "single precision"])
@pytest.mark.parametrize("part", [0.6, 0.8])
def test_what_saturates_is_told_row_by_row(name: str, part: float) -> None:
    values = CLEAN[name]
    limit = part * np.abs(values).max()
    if "counts" in name:
        limit = round(limit / 1e-3) * 1e-3
    clipped = np.clip(values, -limit, limit)
    sides = [(np.abs(values) >= limit) & (sign * values > 0) for sign in (1, -1)]
    expected = sum(side & (side.sum(0) >= 8) for side in sides) > 0
    np.testing.assert_array_equal(at_extremes(clipped, np.ones(len(clipped))) & expected, expected)
    assert not at_extremes(clipped, np.ones(len(clipped)))[np.abs(values) < limit].any()


def test_a_pause_at_the_fastest_in_counts_as_coarse_as_the_noise_is_no_saturation() -> None:
    """A fourth of the readings repeat elsewhere, so that five in six at the extreme are chance; fifty are not."""
    rng = np.random.default_rng(3)
    rate = np.repeat(rng.uniform(-1, 1, (COUNT // 6, 3)), 6, 0)
    seen = counts(rate + 1e-2 * rng.standard_normal(rate.shape), 1e-2)
    at = slice(294, 300)
    seen[at, 0] = np.abs(seen).max() + 0.3 + 1e-2 * np.array([0, 0, 0, 0, -1, 0])
    assert not at_extremes(seen, np.ones(COUNT)).any()
    limit = 0.6
    clipped = at_extremes(np.clip(seen, -limit, limit), np.ones(COUNT))
    np.testing.assert_array_equal(clipped, np.abs(seen) >= limit)


@pytest.mark.parametrize("name", CLEAN)
def test_what_measures_does_not_stand_still(name: str) -> None:
    assert not stuck(CLEAN[name], NOISE, np.ones(COUNT), COAST, 20).any()


@pytest.mark.parametrize("first", [0, 200])
def test_a_sensor_that_stands_still_is_told_row_by_row(first: int) -> None:
    values = WAVES + NOISE
    values[first : first + 30] = values[first + 30]
    told = np.flatnonzero(stuck(values, NOISE, np.ones(COUNT), COAST, 20))
    np.testing.assert_array_equal(told, np.arange(first, first + 31))
    still = partial(stuck, values, np.zeros((COUNT, 3)), np.ones(COUNT))
    assert not still(COAST, 20).any()  # nothing moves: a rest without noise
    commanded = np.isin(np.arange(COUNT), told[3])
    assert not still(commanded, len(told)).any()
    np.testing.assert_array_equal(np.flatnonzero(still(commanded, len(told) - 8)), told)


@pytest.mark.parametrize("first", [0, 200])
def test_an_axis_that_stands_still_is_told_row_by_row_but_at_its_extreme(first: int) -> None:
    values = WAVES + NOISE
    values[first : first + 30, 1] = values[first + 30, 1]
    told = np.flatnonzero(stuck(values, NOISE, np.ones(COUNT), COAST, 20))
    np.testing.assert_array_equal(told, np.arange(first, first + 31))
    values[:, 1] = np.clip(values[:, 1], *np.sort([values[first, 1], -np.inf if values[first, 1] > 0 else np.inf]))
    assert not stuck(values, NOISE, np.ones(COUNT), COAST, 20).any()


@pytest.mark.parametrize("first", [0, 150])
def test_a_sensor_that_stands_still_leaves_nothing_converged(first: int) -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    velocity = log.delta_v_imu_m_s.copy()
    velocity[first : first + 30] = velocity[first + 30]
    found = flow.examine(replace(log, delta_v_imu_m_s=velocity), VehicleSource(used, "", ""))
    (said,) = [notice.message for notice in found.notices if notice.code == "sensor-frozen"]
    assert said.startswith(f"the accelerometer repeats one reading in 31 record(s), rows (from 0) {first} to {first + 30}")
    assert "gyro-saturated" not in [notice.code for notice in found.notices]
    assert set(faulty.verdicts(found).values()) == {"contradicted"}


@pytest.mark.parametrize("reading", [0.0, 3e-4])
def test_a_gyro_axis_that_never_changes_leaves_nothing_converged(reading: float) -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    theta = log.delta_theta_imu_rad * [1, 1, 0] + [0, 0, reading]
    found = flow.examine(replace(log, delta_theta_imu_rad=theta), VehicleSource(used, "", ""))
    assert [n.code for n in found.notices if n.code in ("sensor-frozen", "cause-unknown")] == ["sensor-frozen"]
    assert "converged" not in set(faulty.verdicts(found).values())
    absent = replace(log, delta_theta_imu_rad=theta, axes=(True, True, False, True, True, True), notices=())
    assert not with_unstated(absent).notices


def test_a_sensor_that_saturates_leaves_nothing_converged() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    top = 0.5 * np.abs(log.delta_theta_imu_rad).max()
    clipped = replace(log, delta_theta_imu_rad=np.clip(log.delta_theta_imu_rad, -top, top))
    found = flow.examine(clipped, VehicleSource(used, "t", ""))
    (notice,) = [notice for notice in found.notices if notice.code == "gyro-saturated"]
    assert "imu.gyro_range_rad_s" in notice.message
    assert "converged" not in {estimate.verdict for estimate in found.conclusions[0].estimates.values()}


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_a_body_that_coasts_at_its_fastest_does_not_saturate(noise: float) -> None:
    """Of a log without noise all axes of both sensors repeat then; of a sensor that saturates its own do, beside noise."""
    log, _ = faulty.sample("free-flyer", 20.0)
    pushed = np.cumsum(np.random.default_rng(1).uniform(0.0, 1e-3, (log.rows, 3)), 0)
    pushed[-40:] = pushed[-41]
    other = noise * np.random.default_rng(2).normal(size=(log.rows, 3))
    command = log.command * (np.arange(log.cycles) < log.cycles - 40)[:, None]
    fast = replace(
        log,
        command=command,
        delta_theta_imu_rad=pushed,
        delta_v_imu_m_s=np.where(np.arange(log.rows)[:, None] < log.rows - 40, pushed, 0) + other,
    )
    told = [notice.code for notice in with_unstated(replace(fast, notices=())).notices]
    assert told == ([] if noise == 0 else ["sensor-frozen"])
