from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, norm

from massprop_cli.base.arrays import Array
from massprop_cli.estimate import disturbances, unexplained
from massprop_cli.estimate.initial import early_reference
from massprop_cli.estimate.phases import Estimates, as_stated, estimates
from massprop_cli.flow import examine
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.linearise import Linear, linearise
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Samples
from massprop_cli.testbed import scenario, simulate
from tests import flight
from tests.flight import resolved

CYCLES = [slice(2, 300)]
PHASES = [(Phase(name="all", start_s=0, end_s=99), CYCLES[0])]


def sized(samples: Samples, used: Vehicle) -> Estimates[Resolved]:
    plain = as_stated(samples, PHASES, used, Consider())
    return estimates(samples, PHASES, plain, Consider(), lambda *_: None, size=True, noisier=False)


def test_clean_logs_gain_no_disturbance() -> None:
    used = flight.vehicle()
    flown = flight.standard("free")
    for seed in range(10):
        found, _, _, notices = sized(flown.samples(np.random.default_rng(seed)), used)
        assert found.environment == used.environment
        assert notices == []


def test_a_body_beside_which_the_motion_runs_away_explains_no_more_than_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table that topples and tumbles by 0.3 rad a cycle was refused: a step led to a body without a finite response."""
    samples, used = flight.standard("free").samples(np.random.default_rng(0)), resolved(flight.vehicle())
    reference = early_reference(samples, CYCLES[0], used)
    assert reference is not None
    whole, systems = unexplained.residual_growth(samples, CYCLES[0], reference, used), list[Linear]()

    def once(*given: Any) -> Linear:
        systems.append(linearise(*given))
        return systems[0] if len(systems) == 1 else replace(systems[0], transition=np.full_like(systems[0].transition, np.nan))

    monkeypatch.setattr(unexplained, "linearise", once)
    found = unexplained.residual_growth(samples, CYCLES[0], reference, used)
    assert len(systems) == 2
    np.testing.assert_allclose(found.variance, whole.variance, rtol=0.05)


@pytest.mark.thorough
def test_a_long_run_variance_is_in_excess_as_rarely_as_a_normal_deviate_is_beyond_six_sigma() -> None:
    """In 200 cycles a normal tail's bound, 1 + 6 sigma, is passed 5 times in 100,000 by white noise."""
    for freedom in (20.0, 50.0, 200.0):
        chance = chi2.sf(disturbances._chi_square_bound(freedom) * freedom, freedom)
        assert 0.4 < chance / norm.sf(disturbances.FAR) < 1.1
    white = np.random.default_rng(1).standard_normal((200, 60_000))
    long_run = np.concatenate([disturbances._long_run([six], 14) for six in np.split(white, 10_000, axis=1)]) / 200
    assert long_run.var() == pytest.approx(2 / (1.5 * 200 / 14), rel=0.1)
    assert 0 < (long_run > 1 + disturbances.FAR * np.sqrt(4 * 14 / 3 / 200)).sum() < 10
    assert long_run.max() < disturbances._chi_square_bound(1.5 * 200 / 14)


def test_a_long_run_variance_is_that_of_its_lags_under_bartletts_window_in_whatever_parts_it_comes() -> None:
    left = np.cumsum(np.random.default_rng(4).standard_normal((500, 6)), axis=0)
    expected = (left**2).sum(0) + 2 * np.sum([(1 - lag / 31) * (left[lag:] * left[:-lag]).sum(0) for lag in range(1, 31)], axis=0)
    for edges in ([], [1], [10, 11, 480]):
        assert disturbances._long_run(np.split(left, edges), 30) == pytest.approx(expected, rel=1e-10)


def test_stated_noise_of_the_accelerometer_is_believed_beside_a_torque_that_was_sized() -> None:
    """Five sigma of chance in each channel's variance: the torque, which nobody stated, is too small; the accelerometer's noise stands."""
    used, flown = flight.vehicle(), flight.standard("free")
    history = sized(flown.samples(np.random.default_rng(1)), used).histories[0]
    white = np.random.default_rng(2).standard_normal(history.normalised.shape)
    count = len(white)
    white *= np.sqrt((1 + 5 * np.sqrt(2 / count)) / (white**2).mean(0))
    odd = replace(history, normalised=white)
    torque = resolved(used.model_copy(update={"environment": used.environment.model_copy(update={"disturbance_walk_n_m": 0.001})}))
    assert np.isnan(disturbances.misfit([odd], resolved(used))).all()
    np.testing.assert_array_equal(np.isnan(disturbances.misfit([odd], torque, sized=True)), [False] * 3 + [True] * 3)


@pytest.mark.parametrize("seeds", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_an_unstated_slow_torque_is_found_and_kept_out_of_the_inertia(seeds: int) -> None:
    """A torque that wanders by 0.004 N m a cycle: without it the inertia would be many sigmas off; with it sigmas hold."""
    used = flight.vehicle()
    z = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        wander = 0.004 * np.cumsum(rng.standard_normal((300, 3)), 0)

        def push(t: float, wander: Array = wander) -> Array:
            moment: Array = wander[min(int(t / flight.CYCLE + 1e-9), 299)]
            return moment

        flown = flight.fly(used, flight.pulses(300), flight.TRUTH, torque=push, step_s=2 * flight.STEP)
        found, histories, _, notices = sized(flown.samples(rng), used)
        assert "disturbance-torque" in [n.code for n in notices]
        assert 0.002 < found.environment.disturbance_walk_n_m < 0.012
        z.append((histories[0].values[-1] - flight.TRUTH)[[0, 3, 5]] / histories[0].sigmas[-1, [0, 3, 5]])
    assert np.abs(z).max() < 4.5
    # chi-square, 3 for each seed, 1 in 1000: a root mean square of 1.9 for two, of 1.66 for four
    assert np.sum(np.square(z)) < chi2.ppf(0.999, 3 * seeds)


@pytest.mark.seeds
@pytest.mark.thorough
def test_an_unstated_white_torque_is_found_at_its_size() -> None:
    plan = 'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=20.0}]'
    flown = simulate.fly(scenario.load("free-flyer", ["duration_s=20.0", plan, "disturbance.torque_n_m=0.01"]), [1, 2, 3])
    for member in range(3):
        found = examine(flown.log(member), VehicleSource(flown.vehicle, "t", ""))
        assert found.vehicle.environment.disturbance_torque_n_m == pytest.approx(0.01, rel=0.12)
        errors = found.conclusions[0].values - flown.truth[member, 0]
        assert np.abs(errors / np.sqrt(found.conclusions[0].covariance.diagonal())).max() < 4.5
