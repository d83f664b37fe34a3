from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.rigidbody import elements
from massprop_cli.estimate.initial import first_reference
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
