"""Values that are not the same before and after some moment of a log."""

from __future__ import annotations

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from massprop_cli.base.rigidbody import cross
from massprop_cli.conclude.constancy import FIRST, LAST, changing, threshold
from massprop_cli.estimate.residualtest import DOUBTFUL, share
from tests import faulty
from tests.flown import fly, sound

RANDOM = (
    "duration_s=40.0",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0.0, end_s=40.0}]',
)


def test_the_threshold_is_that_of_a_bridge() -> None:
    """Running means of white noise against the last one: simulated, at a threshold that chance exceeds often enough to be counted."""
    rng, steps, runs = np.random.default_rng(1), 400, 20_000
    paths = np.cumsum(rng.normal(size=(runs, steps)), 1)
    told = np.arange(1, steps + 1) / steps
    inside = (told > FIRST) & (told < LAST)
    deviates = np.abs(paths / told - paths[:, -1:]) / steps / np.sqrt((1 / told - 1) / steps + 1e-12)
    largest = deviates[:, inside].max(1)
    normal, span, c = NormalDist(), np.log(LAST * (1 - FIRST) / (FIRST * (1 - LAST))), 3.0
    expected = c * normal.pdf(c) * ((1 - c**-2) * span + 4 * c**-2)
    assert 0.7 * expected < np.mean(largest > c) < 1.05 * expected  # a path in steps exceeds it less often
    c = threshold()
    assert c * normal.pdf(c) * ((1 - c**-2) * span + 4 * c**-2) == pytest.approx(share(DOUBTFUL, 10), rel=1e-6)


def test_another_imu_from_some_moment_on_takes_the_cg_its_verdict() -> None:
    """80 mm away from half the log on: the CG came out between the two, many sigmas off, and nothing else showed it."""
    flown = fly("free-flyer", *RANDOM, "vehicle.imu.accel_noise_m_s2=0.05")
    log, mounting = flown.log(0), np.array(flown.vehicle.imu.body_from_imu)
    late = np.arange(len(log.time_s)) >= len(log.time_s) // 2
    rate = log.delta_theta_imu_rad @ mounting.T / log.interval_s[:, None]
    arm = np.array([0.08, 0.0, -0.03])
    more = cross(np.gradient(rate, axis=0) / log.interval_s[:, None], arm[None]) + cross(rate, cross(rate, arm[None]))
    other = replace(log, delta_v_imu_m_s=log.delta_v_imu_m_s + (late * log.interval_s)[:, None] * (more @ mounting))
    found = faulty.examined(other, flown.vehicle)
    estimates = found.conclusions[0].estimates
    x = estimates["cg_x"]
    assert x.value is not None
    assert x.sigma is not None
    assert abs(x.value + 0.02) > 4 * x.sigma
    assert not any(estimates[name].verdict == "converged" for name in ("cg_x", "cg_y", "cg_z"))
    assert estimates["cg_x"].reason.code == "changed"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_body_that_stays_the_same_is_so_to_the_log(seed: int) -> None:
    assert changing(sound(seed).histories[0]) == {}
