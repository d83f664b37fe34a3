"""Sums over cycles, against loops over single numbers, in either layout."""

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest

from massprop_cli.prepare import sums

CYCLES, BINS, CHANNELS = 7, 3, 4


def as_it_is(each: np.ndarray) -> np.ndarray:
    return each


def channels_first(each: np.ndarray) -> np.ndarray:
    """The same numbers, those of one channel beside each other, as pulses are summed."""
    flat = np.ascontiguousarray(each.reshape(-1, each.shape[-1]).T)
    return flat.T.reshape(each.shape)


@pytest.mark.parametrize("layout", [as_it_is, channels_first])
def test_the_rising_half_weights_each_bin_by_when_it_comes(layout: Callable[[np.ndarray], np.ndarray]) -> None:
    rng = np.random.default_rng(1)
    integral, moment = layout(rng.normal(size=(CYCLES, BINS, CHANNELS))), layout(rng.normal(size=(CYCLES, BINS, CHANNELS)))
    duration = rng.uniform(0.5, 2.0, CYCLES)
    rising, whole = sums.windows(integral, moment, duration)
    for k, c in product(range(CYCLES), range(CHANNELS)):
        # a bin begins b / BINS through its cycle, where the window has risen as far; within it goes on rising
        risen = sum(integral[k, b, c] * b / BINS + moment[k, b, c] / duration[k] for b in range(BINS))
        assert rising[k, c] == pytest.approx(risen, rel=1e-14, abs=1e-14)
        assert whole[k, c] == pytest.approx(sum(integral[k, :, c]), rel=1e-14, abs=1e-14)


@pytest.mark.parametrize("layout", [as_it_is, channels_first])
def test_channels_add_up_to_a_wrench_and_to_nothing_where_they_cancel(layout: Callable[[np.ndarray], np.ndarray]) -> None:
    rng = np.random.default_rng(2)
    part, wrench = rng.normal(size=(CYCLES, BINS, CHANNELS)), rng.normal(size=(CHANNELS, 6))
    part[2] = 0.0
    # the first two push against each other with 0.1 and 0.3 thirds of it: equal but for rounding, along z alone
    wrench[:2], part[4] = [[0, 0, 0, 0, 0, 0.1 * 3], [0, 0, 0, 0, 0, -0.3]], [1.0, 1.0, 0.0, 0.0]
    made = sums.net(layout(part), wrench)
    assert 0.1 * 3 - 0.3 != 0.0
    assert np.array_equal(made[[2, 4]], np.zeros((2, BINS, 6)))
    for k, b, i in product((0, 1, 3, 5, 6), range(BINS), range(6)):
        expected = sum(part[k, b, c] * wrench[c, i] for c in range(CHANNELS))
        assert made[k, b, i] == pytest.approx(expected, rel=1e-13, abs=1e-14)


def test_no_channel_makes_no_wrench() -> None:
    assert np.array_equal(sums.net(np.zeros((CYCLES, BINS, 0)), np.zeros((0, 6))), np.zeros((CYCLES, BINS, 6)))


def test_records_add_up_to_cycles() -> None:
    each = np.arange(36.0).reshape(12, 3)
    assert np.array_equal(sums.of_records(each, 4), [[18, 22, 26], [66, 70, 74], [114, 118, 122]])


@pytest.mark.parametrize("layout", [as_it_is, channels_first])
def test_wrenches_of_bins_and_halves_are_sums_over_channels(layout: Callable[[np.ndarray], np.ndarray]) -> None:
    rng = np.random.default_rng(7)
    integral, moment = rng.normal(size=(2, CYCLES, BINS, CHANNELS))
    duration, wrench = rng.uniform(0.5, 2.0, CYCLES), rng.normal(size=(CHANNELS, 6))
    integral[1::2, :, 1:], moment[1::2, :, 1:] = 0.0, 0.0  # most channels do nothing in most cycles
    wrench[:2, 0], integral[2], moment[2] = [0.1 * 3, -0.3], 0.0, 0.0
    integral[2, 1, :2] = 1.0  # these cancel but for rounding
    rising, whole = sums.windows(integral, moment, duration)
    each = rising, whole - rising, whole
    made = sums.wrenches(layout(integral), layout(moment), duration, each, wrench)
    assert made.impulse_bins[2, 1, 0] == 0.0
    for k, i in product(range(CYCLES), range(6)):
        by_channel = [wrench[c, i] for c in range(CHANNELS)]
        for b in range(BINS):
            late = [moment[k, b, c] / (duration[k] / BINS) - integral[k, b, c] / 2 for c in range(CHANNELS)]
            assert made.impulse_bins[k, b, i] == pytest.approx(float(np.dot(integral[k, b], by_channel)), rel=1e-12, abs=1e-14)
            assert made.skew_bins[k, b, i] == pytest.approx(float(np.dot(late, by_channel)), rel=1e-12, abs=1e-14)
        for part, channels in zip((made.rising, made.falling, made.whole), each, strict=True):
            assert part[k, i] == pytest.approx(float(np.dot(channels[k], by_channel)), rel=1e-12, abs=1e-14)
