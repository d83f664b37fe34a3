from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.rigidbody import elements
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.regression import Regression
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.prepare.actuators import channel_wrench
from tests import flight

pytestmark = pytest.mark.numerical


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_first_reference_is_near_the_truth_from_nothing(kind: str) -> None:
    flown = flight.standard(kind)
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    found = first_reference(flown.samples(np.random.default_rng(0)), slice(2, 320), flown.used)
    assert found is not None
    trace = truth[0] + truth[3] + truth[5]
    assert np.abs(elements(found.inertia) - truth[:6]).max() < 0.05 * trace
    assert np.abs(found.cg - truth[6:9]).max() < (0.02 if kind == "free" else 5e-4)
    assert 1 / found.mu == pytest.approx(truth[9], rel=0.15)


def test_nothing_is_said_before_anything_has_moved() -> None:
    used = flight.vehicle()
    still = flight.Flight(used, np.zeros((60, 18)), np.zeros((60, 3)), np.zeros((60, 3)))
    assert first_reference(still.samples(np.random.default_rng(0)), slice(2, 60), used) is None


def test_a_fast_spin_does_not_hide_the_response_to_the_jets() -> None:
    used = flight.vehicle()
    flown = flight.fly(used, flight.pulses(160), flight.TRUTH, rate=np.array([2.0, -1.5, 2.5]))
    found = first_reference(flown.samples(np.random.default_rng(0)), slice(2, 160), used)
    assert found is not None
    np.testing.assert_allclose(np.linalg.eigvalsh(found.inertia), [0.61, 2.48, 2.83], rtol=0.1)


def test_forces_alone_give_a_mass_to_start_from() -> None:
    on = flight.pulses(160)
    on[:, :12] = 0
    flown = flight.fly(flight.vehicle(), on, flight.TRUTH)
    found = first_reference(flown.samples(np.random.default_rng(0)), slice(2, 160), flown.used)
    assert found is not None
    assert 1 / found.mu == pytest.approx(22, rel=0.2)


@pytest.mark.thorough
@pytest.mark.parametrize("size", [1e-9, 1e-15])
def test_what_rounding_leaves_of_a_couples_forces_tells_no_mass(size: float) -> None:
    """It goes with how O moves as the body turns about its CG, so that it told a mass about which nothing else was told any more."""
    stated = flight.vehicle(imu={"accel_noise_m_s2": 2e-3})
    on = flight.CYCLE * (flight.pulses(500, seed=4) > 0)
    on[:80, 12:] = 0.0
    log = flight.fly(stated, on, flight.TRUTH).log(np.random.default_rng(3), accel=2e-3)
    wrench = on / flight.CYCLE @ channel_wrench(log, stated)
    wrench[:80, 3:] = size * np.cross(wrench[:80, :3], flight.TRUTH[6:9])
    wrench[:80, 3:] *= -1 / flight.TRUTH[[0, 3, 5]]
    used = flight.vehicle(imu={"accel_noise_m_s2": 2e-3}, jets=[])
    found = flow.examine(replace(log, command_kind="wrench", command=wrench), VehicleSource(used, "t", "")).conclusions[0]
    assert {item.verdict for item in found.estimates.values()} == {"converged"}
    assert np.abs((found.values - flight.TRUTH) / found.sigmas).max() < 4


def test_information_that_is_rounding_frees_no_mass() -> None:
    """Divided by, it is without bound: the triangle was singular then, and of a clean log with wheels and jets nothing was told."""
    regression = Regression.__new__(Regression)
    regression.known_mu = None
    one, right, drawn = np.ones(10), np.array([1e-6]), np.full(10, -1e-9)
    for own in (1.0, 1.0 + 1e-15, 1.0 - 1e-15):
        factor, kept = regression._without_mass_prior(one, one, np.array(own), right, drawn, 0.3)
        assert (float(factor), float(kept[0])) == (1.0, 1e-6)
    factor, _ = regression._without_mass_prior(one, one, np.array(10.0), right, drawn, 0.3)
    assert factor == pytest.approx(np.sqrt(99.0) / 10.0)
