"""Moments of a signal in parts, against numpy's of all of it."""

import numpy as np
import pytest

from massprop_cli.base.moments import Moments

SIGNAL = np.random.default_rng(1).normal([0.0, 3.0, -9.8], [1.0, 0.1, 1e-3], (500, 3))


@pytest.mark.parametrize("edges", [[], [1], [200], [1, 2, 3, 499], [0, 0, 250, 250]])
def test_in_whatever_parts_it_comes(edges: list[int]) -> None:
    about_zero, about_mean = Moments(3), Moments(3, centred=True)
    for part in np.split(SIGNAL, edges):
        about_zero.add(part)
        about_mean.add(part)
    centred = SIGNAL - SIGNAL.mean(0)
    assert about_zero.count == about_mean.count == 500
    for found, signal in ((about_zero, SIGNAL), (about_mean, centred)):
        assert found.variance == pytest.approx((signal**2).mean(0), rel=1e-12)
        assert found.lagged == pytest.approx((signal[1:] * signal[:-1]).mean(0), rel=1e-10, abs=1e-12 * float((signal**2).mean()))


def test_of_nothing_the_variance_is_zero() -> None:
    assert (Moments(2).variance == 0).all()
