from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor
from massprop_cli.diagnosis.lackoffit import hidden_error, innovation_test
from massprop_cli.estimate import offline
from massprop_cli.estimate.history import History, phase_cycles
from massprop_cli.estimate.historyrecorder import with_observability
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.timing import Timing
from tests import faulty
from tests.flight import resolved
from tests.flown import fly

CYCLES = slice(2, 400)
PHASE = Phase(name="all", start_s=0.0, end_s=99.0)


def settled(samples: Samples, used: Vehicle, cycles: slice = CYCLES) -> History:
    true = faulty.truth("free-flyer")
    inertia = true[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
    return settled_about(samples, cycles, PHASE, Reference(inertia, true[6:9], 1 / true[9]), used)


def settled_about(samples: Samples, cycles: slice, phase: Phase, about: Reference, used: Vehicle) -> History:
    fit = offline.fit(samples, cycles, phase, about, resolved(used)).history
    return with_observability([fit], samples, resolved(used))[0]


@pytest.fixture(scope="module")
def clean() -> tuple[Samples, History]:
    log, used = faulty.sample("free-flyer", 20.0)
    samples = Timing(2.0, 0.0).of(log, used)
    return samples, settled(samples, used)


def with_innovations(history: History, normalised: Array) -> History:
    return replace(history, normalised=normalised)


def test_white_innovations_pass_whatever_the_seed(clean: tuple[Samples, History]) -> None:
    samples, history = clean
    for seed in range(100):
        white = np.random.default_rng(seed).standard_normal((398, 6))
        np.testing.assert_array_equal(innovation_test(with_innovations(history, white), samples), np.ones(6))


def test_the_factor_is_the_mean_square_that_each_direction_of_the_probes_holds(clean: tuple[Samples, History]) -> None:
    samples, history = clean
    late = np.roll(samples.executed.channels.whole[:, 0], 1)[CYCLES]  # what a late jet leaves
    signal = 20 * late / np.linalg.norm(late)
    factors = []
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal((398, 6))
        noise[:, 4] += signal
        factors.append(innovation_test(with_innovations(history, noise), samples))
    found = np.array(factors)
    np.testing.assert_array_equal(np.delete(found, 4, axis=1), 1.0)
    probes = _count(samples)
    expected = np.sqrt(1 + 20.0**2 / probes)
    assert found[:, 4].mean() == pytest.approx(expected, rel=0.15)


def _count(samples: Samples) -> int:
    """Directions that commands at three lags, rates, their products and a constant span."""
    rate = samples.rate_rad_s
    columns = [np.roll(samples.executed.channels.whole, lag, axis=0) for lag in (0, 1, 2)] + [
        rate,
        rate[:, :, None].repeat(3, 2).reshape(-1, 9) * np.tile(rate, 3),
    ]
    joined = np.hstack([*columns, np.ones((len(rate), 1))])[CYCLES]
    size = np.linalg.norm(joined, axis=0)
    return int(np.linalg.matrix_rank(joined[:, size > 0] / size[size > 0], tol=1e-6 * np.sqrt(len(size))))


def test_nothing_is_hidden_in_a_clean_log(clean: tuple[Samples, History]) -> None:
    samples, history = clean
    np.testing.assert_array_equal(hidden_error(history, samples, resolved(faulty.sample("free-flyer")[1])), 0.0)


@pytest.mark.parametrize(("jet", "quantity"), [("roll_p1", 0), ("pitch_p1", 3), ("yaw_p1", 5)])
def test_a_jet_of_another_thrust_hides_about_the_error_that_it_makes(jet: str, quantity: int) -> None:
    log, used = faulty.sample("free-flyer")
    # disturbances as large as would be sized, so that innovations fit
    said = faulty.stated(faulty.pushing(used, {jet: 1.25}), "environment.disturbance_torque_n_m=0.005")
    samples = Timing(2.0, 0.0).of(log, said)
    history = settled(samples, said, slice(2, 1200))
    hidden = hidden_error(history, samples, resolved(said))[quantity]
    error = abs(history.values[-1, quantity] - faulty.truth("free-flyer")[quantity])
    assert error > 4 * history.sigmas[-1, quantity]  # the sigma does not hold ...
    assert 0.3 * error < hidden < 5 * error  # ... and the hidden error is of its size
    assert hidden > 5 * history.sigmas[-1, quantity]


@pytest.mark.thorough
def test_stated_pulse_errors_are_noise_and_hide_nothing() -> None:
    flown = fly("refined", "vehicle.thrust.pulse_sigma=0.1", seeds=(1, 2))
    for member in range(2):
        found = faulty.examined(flown.log(member), flown.vehicle)
        assert found.vehicle.thrust.pulse_sigma == 0.1
        assert [c.contradiction for c in found.conclusions] == [""]


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.numerical
def test_noise_in_the_rate_of_a_steady_spin_of_the_sample_is_no_misfit() -> None:
    fits(*faulty.sample("docking"), faulty.truth("docking", 1))


@pytest.mark.numerical
@pytest.mark.thorough
def test_noise_in_the_rate_of_a_steady_spin_is_no_misfit() -> None:
    flown = fly("docking", seeds=(7008, 7028))
    for member in range(2):
        fits(flown.log(member), flown.vehicle, flown.truth[member, 1])


def fits(log: Log, used: Vehicle, true: Array) -> None:
    """After docking the body spins: beside the constant, hardly more than noise is left of its rate, which is in the residual as well."""
    samples = Timing(float(used.cycle.command_delay_cycles), 0.0).of(log, used)
    phase = used.phases[1]
    cycles = phase_cycles(phase, samples.executed.end_s, samples.executed.usable)
    history = settled_about(samples, cycles, phase, Reference(tensor(true[:6]), true[6:9], 1 / true[9]), used)
    np.testing.assert_array_equal(innovation_test(history, samples), np.ones(6))
    np.testing.assert_array_equal(hidden_error(history, samples, resolved(used)), np.zeros(10))
