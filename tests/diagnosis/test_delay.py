"""The delay found in logs whose delay is known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from massprop_cli import job
from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis import delay
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.flow import Analysis
from massprop_cli.prepare.timing import Timing
from massprop_cli.result import build
from massprop_cli.testbed.simulate import SimulatedFlight
from tests import faulty
from tests.diagnosis import test_diagnose
from tests.diagnosis.test_diagnose import LAG
from tests.flight import resolved
from tests.flown import PLAN, fly

AUTO = 'cycle.command_delay_cycles="auto"'
LATE = "actuators.delay_cycles=1.6"
"""Of the vehicle that is flown, whose file says two."""


def late() -> SimulatedFlight:
    return fly("free-flyer", *PLAN, LATE, seeds=tuple(range(8)))


@cache
def examined(*assignments: str, key: str = "", earlier: int = 0) -> Analysis:
    """A log whose commands are logged so many cycles before they were issued, under assignments to its vehicle file."""
    flown = late() if key == LATE else fly("free-flyer", *PLAN, *([key] if key else []))
    log = flown.log(flown.seeds.index(3))
    moved = np.roll(log.command, -earlier, axis=0)
    moved[slice(log.cycles - earlier, None) if earlier > 0 else slice(-earlier)] = 0.0
    return faulty.examined(replace(log, command=moved), faulty.stated(flown.vehicle, *assignments))


def off(found: Analysis) -> Array:
    """(10,) sigmas that each value is off."""
    return np.abs(list(faulty.z_scores(found, fly("free-flyer", *PLAN).truth[0, 0]).values()))


@pytest.mark.parametrize(
    ("true", "key", "earlier"),
    [
        (0.0, "", -2),
        (1.6, LATE, 0),
        (3.6, LATE, 2),
        *(pytest.param(*case, marks=pytest.mark.thorough) for case in ((2.0, "", 0), (9.6, LATE, 8))),
    ],
)
def test_an_unknown_delay_is_found_to_a_tenth_of_a_cycle_with_an_honest_sigma(true: float, key: str, earlier: int) -> None:
    found = examined(AUTO, key=key, earlier=earlier)
    assert found.detected is not None
    assert found.timing.delay == found.detected.at.delay
    assert abs(found.timing.delay - true) < 0.002
    assert abs(found.timing.delay - true) < 4.5 * found.detected.sigma.delay + 1e-3 * (true == 0)
    assert len(off(found)) == 10
    assert off(found).max() < 4.5


def test_commands_alone_tell_the_delay_with_its_sigma_where_no_fit_of_a_body_stands() -> None:
    """Eight logs, 1.6 cycles: within 2 % of a cycle, and what they are off by is their sigma's size, by chi-square at 99.9 %."""
    flown = late()
    every = [delay.by_free_response(flown.log(i), flown.vehicle, Timing(2.0, 0.0)) for i in range(len(flown.seeds))]
    found = [one for one in every if one is not None]
    assert len(found) == len(every)
    away = np.array([one.at.delay - 1.6 for one in found])
    assert np.abs(away).max() < 0.02
    assert chi2.ppf(5e-4, 8) < ((away / [one.sigma.delay for one in found]) ** 2).sum() < chi2.ppf(1 - 5e-4, 8)


@pytest.mark.seeds
@pytest.mark.thorough
def test_the_found_delays_scatter_as_their_sigma_says() -> None:
    z = []
    for seed in late().seeds:
        found = faulty.examined(late().log(seed), faulty.stated(late().vehicle, AUTO)).detected
        assert found is not None
        z.append((found.at.delay - 1.6) / found.sigma.delay)
    assert np.sum(np.square(z)) < chi2.ppf(0.999, len(z))


@pytest.mark.numerical
@pytest.mark.parametrize("off", [-1.5, pytest.param(1.5, marks=pytest.mark.thorough)])
def test_a_delay_is_found_together_with_a_lag_that_is_stated_with_a_sigma(off: float) -> None:
    """Beside the lag as stated, a sigma and a half off, the delay had made up for it, and the log fitted no cause."""
    found = examined(AUTO, f"thrust.lag_s={0.03 + 0.005 * off}", "thrust.lag_sigma_s=0.005", key=LAG)
    assert found.notices == ()
    assert found.detected is not None
    assert 0 < found.detected.sigma.lag < 0.1  # cycles: the log tells more than was stated
    assert abs(found.timing.delay - 2.0) < 4 * found.detected.sigma.delay
    assert abs(found.timing.lag - 0.6) < 4 * found.detected.sigma.lag


@pytest.mark.numerical
@pytest.mark.parametrize("seeds", [(2,), pytest.param((1, 3), marks=pytest.mark.thorough)])
def test_a_delay_is_found_beside_jets_that_are_as_uncertain_as_is_stated(seeds: tuple[int, ...]) -> None:
    """Taken as exact they move it by many of its sigmas; of seed 2 the log had contradicted all that followed."""
    for seed in seeds:
        flown, rng = late(), np.random.default_rng(seed)
        other = faulty.pushing(flown.vehicle, {jet.name: 1 + 0.01 * rng.standard_normal() for jet in flown.vehicle.jets})
        stated = other.model_copy(update={"jets": tuple(jet.model_copy(update={"thrust_sigma": 0.01}) for jet in other.jets)})
        found = faulty.examined(flown.log(seed), faulty.stated(stated, AUTO))
        assert found.notices == ()
        assert found.detected is not None
        assert abs(found.timing.delay - 1.6) < 4 * found.detected.sigma.delay


@pytest.mark.parametrize(
    ("stated", "true", "warned"),
    [
        (2.0, 2.0, False),
        (2.0, 1.6, True),
        *(pytest.param(other, 2.0, True, marks=pytest.mark.thorough) for other in (1.0, 2.05, 4.0)),
    ],
)
def test_a_stated_delay_is_contradicted_only_where_it_is_wrong(stated: float, true: float, warned: bool) -> None:
    found = examined(f"cycle.command_delay_cycles={stated}", key=LATE if true == 1.6 else "")
    codes = {notice.code for notice in found.notices}
    assert codes == ({"delay-mismatch"} if warned else set())
    assert found.timing.delay == stated
    assert found.detected is not None
    assert abs(found.detected.at.delay - true) < 0.01
    if warned:
        message = next(notice.message for notice in found.notices if notice.code == "delay-mismatch")
        assert f"command_delay_cycles = {stated:g}" in message
        assert f"delay is {true:g} ±" in message


def test_nothing_converges_of_a_log_that_cannot_tell_its_delay() -> None:
    flown = fly("free-flyer", "duration_s=5.0", "plan=[]")
    found = faulty.examined(flown.log(0), faulty.stated(flown.vehicle, AUTO))
    assert "the command delay cannot be estimated from this log" in found.notices[0].message
    assert not any(one.verdict == "converged" for one in found.conclusions[0].estimates.values())


def test_the_search_alone_finds_the_whole_cycle() -> None:
    flown = fly("free-flyer", *PLAN)
    log = flown.log(0)
    early = replace(log, command=np.concatenate([log.command[5:], 0 * log.command[:5]]))
    assert delay.search(early, faulty.stated(flown.vehicle, AUTO), [0.0])[0].at == (7.0, 0.0)


@pytest.mark.parametrize(
    ("true_s", "unknown"), [(0.03, ["lag"]), (0.0, ["lag"]), pytest.param(0.08, ["lag", "delay"], marks=pytest.mark.thorough)]
)
def test_an_unknown_lag_is_found_alone_and_with_the_delay(true_s: float, unknown: list[str]) -> None:
    found = examined('thrust.lag_s="auto"', *([AUTO] if "delay" in unknown else []), key=f"actuators.lag_s={true_s}" if true_s else "")
    assert found.detected is not None
    period = found.vehicle.cycle.period_s
    assert abs(found.timing.lag * period - true_s) < max(4.5 * found.detected.sigma.lag * period, 1e-6)
    assert found.detected.sigma.lag * period < 1e-4
    assert build.result(found).lag.lag_s == found.timing.lag * period
    assert abs(found.timing.delay - 2.0) <= 4.5 * found.detected.sigma.delay
    assert (found.detected.sigma.delay > 0) is ("delay" in unknown)
    assert off(found).max() < 4.5
    assert found.notices == ()


def test_a_lag_that_is_not_stated_is_pointed_at() -> None:
    (said,) = [notice.message for notice in test_diagnose.examined(test_diagnose.nothing, LAG).notices if notice.code == "thrust-lag"]
    assert "a lag of 0.0299" in said or "a lag of 0.03" in said
    assert "thrust.lag_s" in said


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_real_flight_that_cannot_tell_delay_from_lag_has_a_mass_by_the_likeliest() -> None:
    """Of a vehicle whose type weighs 31.9 g."""
    flight = Path(__file__).parents[2] / "sample_logs" / "crazyflie" / "yaw.parquet"
    found = job.of_file(flight, None, ['thrust.lag_s="auto"', AUTO]).analysis
    mass = found.conclusions[0].estimates["mass"]
    assert found.notices[0].code == "timing-untold"
    assert mass.verdict == "not_converged"
    assert mass.value is not None
    assert mass.sigma is not None
    assert abs(mass.value - 0.0319) < 2 * mass.sigma < 0.25 * 0.0319


def test_a_response_that_runs_away_tells_no_delay() -> None:
    found = examined()
    history = found.histories[0]
    assert history.reference is not None
    for size in (1e3, 1e60, 1e150):
        wild = replace(found.log, delta_theta_imu_rad=size * found.log.delta_theta_imu_rad)
        with np.errstate(all="ignore"):  # as the command does
            assert delay.detect(Setup(wild, resolved(found.vehicle), found.timing), [history.cycles], ["delay"]) is None


def test_bounded_steps_are_the_likeliest_of_those_allowed() -> None:
    """Of what is free the gradient of the likelihood vanishes; what is alone is bounded by itself, and none beyond its bound."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        root = rng.normal(size=(3, 4))
        covariance, steps, most = root @ root.T, 3 * rng.normal(size=3), rng.uniform(0.2, 3, 3)
        found = delay.bounded_steps(steps, covariance, most)
        assert (np.abs(found) <= most * (1 + 1e-12)).all()
        slope = np.linalg.solve(covariance, found - steps)
        free = np.abs(found) < most * (1 - 1e-9)
        np.testing.assert_allclose(slope[free], 0.0, atol=1e-9 * np.abs(slope).max(initial=1.0))
        assert (delay.bounded_steps(steps[:1], covariance[:1, :1], most[:1]) == np.clip(steps[:1], -most[:1], most[:1])).all()
