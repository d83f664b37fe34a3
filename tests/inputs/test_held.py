"""A sensor that is read more often than it measures: its readings count once, or the log is refused."""

import numpy as np
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs.held import moving_mean, periodic_repeats
from tests.streams import RECORDS, WRENCH_MAP, made, motion, values

RNG = np.random.default_rng(5)
NOISE = RNG.normal(size=(600, 3))
FORCE = np.repeat(RNG.normal(size=(150, 3)) * RNG.integers(0, 2, (150, 1)), 4, 0)
NOT_HELD = {
    "noise": NOISE,
    "counts": np.round(NOISE),
    "force by cycles, and none in half of them": FORCE,
    "one axis alone": np.repeat(NOISE[:150], 4, 0) * [1, 0, 0],
    "rows lost and repeated": np.where((np.arange(600) % 37 == 1)[:, None], np.roll(NOISE, 1, 0), NOISE),
    "rest": np.ones((600, 3)),
}


@pytest.mark.parametrize("name", NOT_HELD)
def test_what_repeats_off_a_beat_or_on_some_axes_is_not_held(name: str) -> None:
    assert not periodic_repeats(NOT_HELD[name]).any()


@pytest.mark.parametrize("times", [2, 2.5, 4, 10])
def test_readings_on_a_beat_of_their_own_are_found_row_by_row(times: float) -> None:
    at = (np.arange(600) / times).astype(int)
    np.testing.assert_array_equal(periodic_repeats(NOISE[at]), np.diff(at, prepend=-1) == 0)


def test_a_map_takes_each_reading_once_and_refuses_records_that_would_be_made_up() -> None:
    streams = motion()
    for axis in "xyz":
        force, clock, unit = streams[f"imu/a{axis}"]
        streams[f"imu/a{axis}"] = force[np.arange(len(force)) // 4 * 4], clock, unit
    with pytest.raises(InputError, match=r"'imu/ax': repeats each reading 4 times, so that it measures every 0.04 s, so records of 0.01 s"):
        made(streams, WRENCH_MAP + RECORDS)
    longer = "[records]\ninterval_s = 0.05\nper_cycle = 1\n"
    once, plain = (values(made(one, WRENCH_MAP + longer), ("delta_v_x_m_s",))[:, 0] for one in (streams, motion()))
    np.testing.assert_allclose(once, plain[: len(once)], atol=2e-4)


MANY = np.random.default_rng(8).normal(size=(4000, 3))
TURNING = np.sin(0.002 * np.arange(4000))[:, None] * [3.0, 1.0, -2.0]


@pytest.mark.parametrize("mean", [2, 3, 5, 9, 12])
def test_a_moving_mean_is_told_with_how_many_readings_it_is_over(mean: int) -> None:
    over = np.ones(mean) / mean
    smooth = np.stack([np.convolve(axis, over, "same") for axis in (MANY + 50 * TURNING).T], 1)
    assert moving_mean(smooth) == mean


def test_of_moving_means_beneath_a_motion_nearly_all_are_told_and_of_commands_none() -> None:
    """Of a hundred each: white noise and a motion in steps; and commands that last 1.2 to 6 readings, beneath noise."""
    told = false = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        mean, count, beat = int(rng.integers(2, 9)), int(rng.choice([1500, 3000, 6000])), float(rng.uniform(1.2, 6))
        steps = np.repeat(3 * rng.normal(size=(count // 25 + 2, 3)), 25, 0)[: count + mean - 1] * rng.random(3)
        readings = rng.normal(size=steps.shape) + steps * (np.sin(np.arange(len(steps)) / 400) > 0)[:, None]
        sums = np.cumsum(np.concatenate([np.zeros((1, 3)), readings]), 0)
        told += moving_mean((sums[mean:] - sums[:-mean]) / mean) == mean
        at = np.arange(count + 1) / beat
        commanded = np.cumsum(np.concatenate([np.zeros((1, 3)), rng.normal(size=(int(at[-1]) + 2, 3))]), 0)
        within = np.stack([np.interp(at, np.arange(len(axis)), axis) for axis in commanded.T], 1)
        false += moving_mean(beat * np.diff(within, axis=0) * rng.uniform(0.2, 4) + rng.normal(size=(count, 3))) > 0
    assert told >= 95
    assert false == 0


FILTERED = {
    "white": MANY,
    "in a turn": MANY + 50 * TURNING,
    "no noise": TURNING,
    "first order": np.stack([np.convolve(axis, 0.5 ** np.arange(20), "full")[:4000] for axis in MANY.T], 1),
    "means of pairs, once": MANY.reshape(-1, 2, 3).mean(1),
    "counts": np.round(MANY * 2),
    "hum": MANY + 10 * np.sin(2 * np.pi * np.arange(4000) / 8)[:, None],
    "few": MANY[:500],
    "commands drawn anew in each cycle": np.repeat(MANY[:1000], 4, 0) + 0.1 * MANY,
    "commands of another clock": MANY[(np.arange(4000) / 5.003).astype(int)] + 0.1 * MANY,
}


@pytest.mark.parametrize("name", FILTERED)
def test_what_a_sensor_does_itself_is_no_moving_mean(name: str) -> None:
    assert moving_mean(FILTERED[name]) == 0
