"""Values that are not the same before and after some moment of a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.rigidbody import cross
from massprop_cli.conclude.constancy import FIRST, LAST, RATE, constancy_test, false_alarm_probability, threshold
from tests import faulty
from tests.flown import fly, sound

RANDOM = (
    "duration_s=40.0",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0.0, end_s=40.0}]',
)


def test_the_chance_is_that_of_a_bridge() -> None:
    """Running means of white noise against the last one: simulated, where chance exceeds it often enough to be counted."""
    rng, steps, runs, c = np.random.default_rng(1), 400, 20_000, 3.0
    told = np.arange(1, steps) / steps
    inside = (told > FIRST) & (told < LAST)
    paths = np.cumsum(rng.normal(size=(runs, steps)), 1)
    apart = np.abs(paths[:, :-1] / told - paths[:, -1:]) / steps
    largest = (apart / np.sqrt((1 / told - 1) / steps))[:, inside].max(1)
    assert (
        0.7 * false_alarm_probability(c) < np.mean(largest > c) < 1.05 * false_alarm_probability(c)
    )  # a path in steps exceeds it less often
    assert false_alarm_probability(threshold()) == pytest.approx(RATE / 10, rel=1e-6)


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

    settled, change = found.settled[0], estimates["cg_x"].reason.data
    apart = abs(float(dict(change)["after"]) - float(dict(change)["before"]))
    assert constancy_test(settled, found.samples.end_s, settled.values[-1], np.full(10, 0.9 * apart))["cg_x"] == estimates["cg_x"].reason
    # a sigma that includes both bodies is no reason to doubt the value
    assert "cg_x" not in constancy_test(settled, found.samples.end_s, settled.values[-1], np.full(10, 1.1 * apart))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_body_that_stays_the_same_is_so_to_the_log(seed: int) -> None:
    found = sound(seed)
    assert constancy_test(found.settled[0], found.samples.end_s, found.settled[0].values[-1], found.conclusions[0].sigmas) == {}


def test_stages_are_what_parts_of_the_log_give() -> None:
    """Held against fits of the first part alone, which are about another estimate by second orders."""
    found = sound(1)
    stages = found.settled[0].stages
    assert stages is not None
    ends, mean, variance = stages()
    assert np.abs(mean[-1] / np.sqrt(variance[-1])).max() < 0.01
    at = len(ends) // 2
    log = found.log.part(0, int(ends[at]))
    part = faulty.examined(log, found.source.vehicle).settled[0]
    last = found.settled[0].values[-1]
    sigmas, apart = np.sqrt(variance[at]), part.values[-1] - last
    np.testing.assert_allclose(mean[at][:9], apart[:9], atol=0.05 * sigmas[:9].max(), rtol=0.02)
    np.testing.assert_allclose(sigmas[:9], part.sigmas[-1][:9], rtol=0.03)


@pytest.mark.thorough
def test_a_log_by_larger_blocks_has_the_same_stages() -> None:
    """Of logs that are longer than is held, blocks end at the moments."""
    flown = fly("free-flyer", "duration_s=240.0", RANDOM[1].replace("40.0", "240.0"))
    settled = faulty.examined(flown.log(0), flown.vehicle).settled[0]
    assert settled.stages is not None
    ends, mean, variance = settled.stages()
    assert ends[-1] == settled.cycles.stop
    assert (np.diff(ends) > 0).all()
    assert (np.abs(mean / np.sqrt(variance)) < 6).all()
    assert (np.diff(variance, axis=0) < 1e-12 * variance[1:]).all()
