from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import chi2

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.estimate import engine
from massprop_cli.estimate.history import History
from massprop_cli.inputs.vehicle import Phase
from tests import flight
from tests.analysed import SAMPLES, analysed

WITH_TRUTH = ("free-flyer", "air-bearing", "docking", "high-rate")


def z_scores(history: History, truth: Array) -> Array:
    z: Array = (history.values[-1] - truth) / history.sigmas[-1]
    return z


@pytest.mark.numerical
@pytest.mark.parametrize("name", WITH_TRUTH)
def test_logs_of_the_independent_engine_are_matched_at_their_bound(name: str) -> None:
    """Errors within 4.5 sigma and sigmas between 0.9 and 1.25 of the log's own Cramér–Rao bound, everything converged."""
    found = analysed(name)
    told = json.loads((SAMPLES / name / "truth.json").read_text())
    for history, conclusion, truth, bound in zip(found.histories, found.conclusions, told["phases"], told["bound"], strict=True):
        assert np.abs(z_scores(history, np.array([truth[q] for q in QUANTITIES]))).max() < 4.5
        ratio = history.sigmas[-1] / np.array([bound[q] for q in QUANTITIES])
        assert ratio.min() > 0.9
        assert ratio.max() < 1.25
        assert {e.verdict for e in conclusion.estimates.values()} == {"converged"}


@pytest.mark.parametrize("name", WITH_TRUTH)
def test_default_beats_the_thesis_on_every_log(name: str) -> None:
    """Root mean square error relative to the natural sizes, over inertia, CG and mass of every phase."""
    told = json.loads((SAMPLES / name / "truth.json").read_text())
    errors = {}
    for method, found in (("default", analysed(name)), ("thesis", analysed(name, "thesis"))):
        total = []
        for default, conclusion, truth in zip(analysed(name).histories, found.conclusions, told["phases"], strict=True):
            total.append((conclusion.values - np.array([truth[q] for q in QUANTITIES])) / default.natural_sizes)
        errors[method] = np.abs(np.array(total))
    assert np.nanmax(errors["default"], 0).max() < 0.05
    for part in (slice(0, 6), slice(6, 9), slice(9, 10)):
        assert np.sqrt((errors["default"][:, part] ** 2).mean()) < 0.5 * np.sqrt((errors["thesis"][:, part] ** 2).mean())


def seeds(kind: str, count: int) -> Array:
    """(count, 10) errors in sigmas over noise seeds of one flight of 16 s."""
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    flown = flight.standard(kind)
    phase, cycles = Phase(name="all", start_s=0, end_s=99), slice(2, 320)
    found = [engine.replay(flown.samples(np.random.default_rng(s)), cycles, phase, flown.resolved) for s in range(count)]
    return np.stack([z_scores(history, truth) for history in found])


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_sigmas_mean_what_they_say_over_noise_seeds(kind: str) -> None:
    """Each quantity's mean square z within the 99.9 % band of chi-square, pooled coverage of 95 % intervals within what chance leaves.

    Of 40 seeds that is 0.45 to 1.84, and 91 to 98.5 % of 400 intervals.
    """
    z = seeds(kind, 40)
    squares = (z**2).sum(0)
    low, high = chi2.ppf([0.0005, 0.9995], len(z))
    assert (squares > low).all()
    assert (squares < high).all()
    chance = np.sqrt(0.95 * 0.05 / z.size)
    assert 0.95 - 3.7 * chance < (np.abs(z) < 1.96).mean() < 0.95 + 3.2 * chance
    assert (np.abs(z.mean(0)) < 3.5 / np.sqrt(len(z))).all()


@pytest.mark.numerical
def test_estimates_depend_on_earlier_cycles_only() -> None:
    flown = flight.standard("free", 200)
    samples = flown.samples(np.random.default_rng(0))
    phase = Phase(name="all", start_s=0, end_s=99)
    whole = engine.replay(samples, slice(2, 200), phase, flown.resolved)
    for stop in (*range(10, 60), 101, 163):
        part = engine.replay(samples, slice(2, stop), phase, flown.resolved)
        np.testing.assert_array_equal(whole.values[: stop - 2], part.values)
        np.testing.assert_array_equal(whole.sigmas[: stop - 2], part.sigmas)


def test_an_unexcited_first_half_changes_nothing_but_the_wait() -> None:
    """Half a minute of noise before the same flight tells the starting rate better, and no more: the values move by what that explains.

    Data that shrink a variance from s² to t² move the estimate by a sigma of sqrt(s² − t²).
    """
    phase = Phase(name="all", start_s=0, end_s=999)
    flown = flight.standard("free", 200)
    on = flown.on
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((800, 2, 3)) * np.array([[[1e-4], [0.02]]]) * flight.CYCLE

    def final(quiet: int) -> History:
        pad = np.zeros((quiet, 3))
        moved = flight.Flight(
            flown.used,
            np.vstack([np.zeros((quiet, 18)), on]),
            np.vstack([pad, flown.delta_theta]) + noise[600 - quiet :, 0],
            np.vstack([pad, flown.delta_v]) + noise[600 - quiet :, 1],
        )
        return engine.replay(moved.samples(), slice(2, quiet + 200), phase, flown.resolved)

    late, early = final(600), final(100)
    assert np.isnan(late.values[:590]).all()
    np.testing.assert_allclose(late.sigmas[-1], early.sigmas[-1], rtol=0.15)
    explained = np.sqrt(np.maximum(early.sigmas[-1] ** 2 - late.sigmas[-1] ** 2, 0))
    assert (np.abs(late.values[-1] - early.values[-1]) < 3 * explained + 0.1 * early.sigmas[-1]).all()


@pytest.mark.numerical
def test_the_prior_does_not_pull() -> None:
    flown = flight.standard("free", 200)
    samples, phase = flown.samples(np.random.default_rng(7)), Phase(name="all", start_s=0, end_s=99)
    finals = []
    for scale in (10.0, 100.0, 1000.0):
        settings = flown.used.estimator.model_copy(update={"prior_scale": scale})
        finals.append(engine.replay(samples, slice(2, 200), phase, flown.resolved.model_copy(update={"estimator": settings})))
    for other in finals[1:]:
        assert (np.abs(other.values[-1] - finals[0].values[-1]) < 0.1 * finals[0].sigmas[-1]).all()


@pytest.mark.numerical
@pytest.mark.parametrize("factor", [1e-5, 1e4])
def test_nothing_assumes_a_vehicle_of_a_certain_size(factor: float) -> None:
    """All masses, forces and torques scaled together: the motion is the same, so the scaled estimates are too."""
    flown = flight.standard("free", 200)
    on = flown.on
    used = flight.vehicle(jets=flight.jets(scale=factor))
    scaled = flight.Flight(used, on, flown.delta_theta, flown.delta_v)
    phase, proportional = Phase(name="all", start_s=0, end_s=99), np.array([factor] * 6 + [1.0] * 3 + [factor])
    one = engine.replay(flown.samples(np.random.default_rng(1)), slice(2, 200), phase, flown.resolved)
    other = engine.replay(scaled.samples(np.random.default_rng(1)), slice(2, 200), phase, flight.resolved(used))
    np.testing.assert_allclose(other.values[-1] / proportional, one.values[-1], atol=1e-3 * one.sigmas[-1].min(), rtol=1e-6)
    np.testing.assert_allclose(other.sigmas[-1] / proportional, one.sigmas[-1], rtol=1e-4)


@pytest.mark.numerical
def test_gyro_and_accelerometer_bias_are_estimated_away_where_stated() -> None:
    used = flight.vehicle(imu={"gyro_bias_sigma_rad_s": 0.01, "accel_bias_sigma_m_s2": 0.1})
    flown = flight.standard("free")
    bias = np.array([0.008, -0.012, 0.005]), np.array([0.1, -0.06, 0.15])
    moved = flight.Flight(used, flown.on, flown.delta_theta + bias[0] * flight.CYCLE, flown.delta_v + bias[1] * flight.CYCLE)
    phase = Phase(name="all", start_s=0, end_s=99)
    z = [
        z_scores(engine.replay(moved.samples(np.random.default_rng(s)), slice(2, 320), phase, flight.resolved(used)), flight.TRUTH)
        for s in range(5)
    ]
    assert np.abs(z).max() < 4.5
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.numerical
def test_a_stated_disturbance_torque_widens_the_sigmas_to_fit() -> None:
    torque = 0.02
    used = flight.vehicle(environment={"disturbance_torque_n_m": torque})
    z = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        pushes = torque * rng.standard_normal((240, 3))

        def push(t: float, pushes: Array = pushes) -> Array:
            moment: Array = pushes[min(int(t / flight.CYCLE + 1e-9), len(pushes) - 1)]
            return moment

        flown = flight.fly(used, flight.pulses(240), flight.TRUTH, torque=push, step_s=2 * flight.STEP)
        z.append(
            z_scores(
                engine.replay(flown.samples(rng), slice(2, 240), Phase(name="all", start_s=0, end_s=99), flight.resolved(used)),
                flight.TRUTH,
            )
        )
    assert np.abs(z).max() < 4.5
    assert 0.65 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.thorough
@pytest.mark.numerical
def test_a_mass_that_is_said_to_drift_is_known_no_better_than_it_drifts() -> None:
    """The body of the flight is constant: its mass still holds, with a sigma that no averaging brings below the walk."""
    flown = flight.standard("free")
    drifting = flight.vehicle(drift={"mass": 2.0})
    for seed in range(5):
        samples = flown.samples(np.random.default_rng(seed))
        whole = slice(2, len(samples))
        phase = Phase(name="all", start_s=0.0, end_s=99.0)
        still, walked = (engine.replay(samples, whole, phase, flight.resolved(used)) for used in (flight.vehicle(), drifting))
        assert walked.sigmas[-1, 9] > 1.5 * still.sigmas[-1, 9]
        assert walked.sigmas[-1, 9] < 2.0 * np.sqrt(16.0)  # what it would have wandered from the start on
        assert np.abs((walked.values[-1] - flight.TRUTH) / walked.sigmas[-1]).max() < 4.5
