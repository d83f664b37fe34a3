"""The delay found in logs whose delay is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from massprop_cli import flow
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis import delay
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.result import build
from massprop_cli.testbed import scenario, simulate
from tests import faulty
from tests.flight import resolved

SHORT = ["duration_s=20.0", "vehicle.cycle.command_delay_cycles=auto"]
PLAN = 'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=20.0}]'


def flown(true: float, seed: int, *more: str) -> simulate.Flight:
    return simulate.fly(scenario.load("free-flyer", [*SHORT, PLAN, f"actuators.delay_cycles={true}", *more]), [seed])


@pytest.mark.parametrize("true", [0.0, 0.4, pytest.param(2.0, marks=pytest.mark.slow), 3.25, pytest.param(9.7, marks=pytest.mark.slow)])
def test_an_unknown_delay_is_found_to_a_tenth_of_a_cycle_with_an_honest_sigma(true: float) -> None:
    flight = flown(true, 4)
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", ""))
    assert found.detected is not None
    assert found.timing.delay == found.detected.at.delay
    assert abs(found.timing.delay - true) < 0.002
    assert abs(found.timing.delay - true) < 4.5 * found.detected.sigma.delay + 1e-3 * (true == 0)
    for name, estimate in found.conclusions[0].estimates.items():
        assert estimate.value is not None
        assert estimate.sigma is not None
        assert abs(estimate.value - flight.truth[0, 0, list(found.conclusions[0].estimates).index(name)]) < 4.5 * estimate.sigma


@pytest.mark.parametrize("seeds", [pytest.param(3, marks=pytest.mark.thorough), pytest.param(8, marks=pytest.mark.slow)])
def test_the_found_delays_scatter_as_their_sigma_says(seeds: int) -> None:
    z = []
    for seed in range(seeds):
        flight = flown(1.6, seed)
        found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", "")).detected
        assert found is not None
        z.append((found.at.delay - 1.6) / found.sigma.delay)
    assert np.sum(np.square(z)) < chi2.ppf(0.999, seeds)


@pytest.mark.numerical
@pytest.mark.parametrize("off", [-1.5, 1.5])
def test_a_delay_is_found_together_with_a_lag_that_is_stated_with_a_sigma(off: float) -> None:
    """Beside the lag as stated, a sigma and a half off, the delay had made up for it, and the log fitted no cause."""
    keys = "actuators.lag_s=0.05", f"vehicle.thrust.lag_s={0.05 + 0.005 * off}", "vehicle.thrust.lag_sigma_s=0.005"
    flight = flown(1.6, 1, *keys)
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", ""))
    assert found.notices == ()
    assert found.detected is not None
    assert 0 < found.detected.sigma.lag < 0.1  # cycles: the log tells more than was stated
    assert abs(found.timing.delay - 1.6) < 4 * found.detected.sigma.delay
    assert abs(found.timing.lag - 1.0) < 4 * found.detected.sigma.lag


@pytest.mark.numerical
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_delay_is_found_beside_jets_that_are_as_uncertain_as_is_stated(seed: int) -> None:
    """Taken as exact they move it by many of its sigmas; of seed 2 the log had contradicted all that followed."""
    flight, rng = flown(1.6, seed), np.random.default_rng(seed)
    other = faulty.pushing(flight.vehicle, {jet.name: 1 + 0.01 * rng.standard_normal() for jet in flight.vehicle.jets})
    stated = other.model_copy(update={"jets": tuple(jet.model_copy(update={"thrust_sigma": 0.01}) for jet in other.jets)})
    found = flow.examine(flight.log(0), VehicleSource(stated, "t", ""))
    assert found.notices == ()
    assert found.detected is not None
    assert abs(found.timing.delay - 1.6) < 4 * found.detected.sigma.delay


@pytest.mark.parametrize(
    ("stated", "warned"),
    [(2.0, False), pytest.param(2.05, True, marks=pytest.mark.slow), (1.0, True), pytest.param(4.0, True, marks=pytest.mark.slow)],
)
def test_a_stated_delay_is_contradicted_only_where_it_is_wrong(stated: float, warned: bool) -> None:
    flight = flown(2.0, 1, f"vehicle.cycle.command_delay_cycles={stated}")
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", ""))
    codes = [notice.code for notice in found.notices]
    assert ("delay-mismatch" in codes) is warned
    assert found.timing.delay == stated
    assert found.detected is not None
    assert abs(found.detected.at.delay - 2.0) < 0.01
    if warned:
        message = next(notice.message for notice in found.notices if notice.code == "delay-mismatch")
        assert f"command_delay_cycles = {stated:g}" in message
        assert "log shows 2 ±" in message


def test_a_log_that_cannot_tell_its_delay_is_refused() -> None:
    flight = simulate.fly(scenario.load("free-flyer", [*SHORT, "actuators.delay_cycles=2.0", "plan=[]"]), [1])
    with pytest.raises(InputError, match="the command delay can't be told from this log"):
        flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", ""))


def test_the_search_alone_finds_the_whole_cycle() -> None:
    flight = flown(7.0, 2)
    assert delay.search(flight.log(0), flight.vehicle, [0.0]) == (7.0, 0.0)


@pytest.mark.parametrize(
    ("true_s", "unknown"), [(0.03, ["lag"]), (0.0, ["lag"]), pytest.param(0.08, ["lag", "delay"], marks=pytest.mark.slow)]
)
def test_an_unknown_lag_is_found_alone_and_with_the_delay(true_s: float, unknown: list[str]) -> None:
    keys = ["vehicle.thrust.lag_s=auto", f"actuators.lag_s={true_s}"]
    keys += [f"vehicle.cycle.command_delay_cycles={'auto' if 'delay' in unknown else 1.3}"]
    flight = flown(1.3, 3, *keys)
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", ""))
    assert found.detected is not None
    period = flight.vehicle.cycle.period_s
    assert abs(found.timing.lag * period - true_s) < max(4.5 * found.detected.sigma.lag * period, 1e-6)
    assert found.detected.sigma.lag * period < 1e-4
    assert build.result(found).lag.lag_s == found.timing.lag * period
    assert abs(found.timing.delay - 1.3) <= 4.5 * found.detected.sigma.delay
    assert (found.detected.sigma.delay > 0) is ("delay" in unknown)
    errors = found.conclusions[0].values - flight.truth[0, 0]
    assert np.abs(errors / np.sqrt(found.conclusions[0].covariance.diagonal())).max() < 4.5
    assert found.notices == ()


def test_a_lag_that_is_not_stated_is_pointed_at() -> None:
    flight = flown(2.0, 1, "vehicle.cycle.command_delay_cycles=2.0", "actuators.lag_s=0.04")
    notices = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", "")).notices
    (said,) = [notice.message for notice in notices if notice.code == "thrust-lag"]
    assert "a lag of 0.0399" in said or "a lag of 0.04" in said
    assert "thrust.lag_s" in said


@pytest.mark.slow
def test_a_real_flight_that_cannot_tell_delay_from_lag_is_refused() -> None:
    flight = Path(__file__).parents[2] / "sample_logs" / "crazyflie" / "yaw.parquet"
    with pytest.raises(InputError, match="the command delay and the thrust lag can't be told from this log"):
        flow.analyse(flight, None, ['thrust.lag_s="auto"', 'cycle.command_delay_cycles="auto"'])


@pytest.mark.parametrize("size", [1e3, 1e60, 1e150])
def test_a_response_that_runs_away_tells_no_delay(size: float) -> None:
    flight = flown(2.0, 1, "vehicle.cycle.command_delay_cycles=2.0")
    log = flight.log(0)
    found = flow.examine(log, VehicleSource(flight.vehicle, "t", ""))
    history = found.histories[0]
    assert history.reference is not None
    wild = replace(log, delta_theta_imu_rad=size * log.delta_theta_imu_rad)
    with np.errstate(all="ignore"):  # as the command does
        assert delay.detect(wild, resolved(found.vehicle), [history.cycles], found.timing, ["delay"]) is None
