"""The batch fit against the filter's own last row: the same data, another way."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor
from massprop_cli.diagnosis.fit import Extra, fit, response
from massprop_cli.estimate import engine, offline
from massprop_cli.estimate.initial import first_reference
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.linearise import linearise
from massprop_cli.model.parameters import parameters
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.align import align
from massprop_cli.prepare.compensate import Samples, compensate
from tests import flight

pytestmark = pytest.mark.numerical

CYCLES = slice(2, 320)
PHASE = Phase(name="all", start_s=0.0, end_s=16.0)


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_the_batch_fit_ends_where_the_filter_ends(kind: str) -> None:
    flown = flight.standard(kind)
    samples = flown.samples(np.random.default_rng(3))
    causal = engine.replay(samples, CYCLES, PHASE, flown.resolved)
    assert causal.reference is not None
    history = offline.fit(samples, CYCLES, PHASE, causal.reference, flown.resolved).history
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    rough = Reference(1.3 * tensor(truth[:6]), truth[6:9] + 0.0005, 0.8 / truth[9])
    found = fit(samples, CYCLES, rough, flown.resolved)
    assert found is not None
    values = parameters(found.reference)
    values[9] = 1 / values[9]
    assert np.abs((values - history.values[-1]) / history.sigmas[-1]).max() < 0.1
    assert abs(found.chi_square - 1) < 4 * np.sqrt(2 / (6 * 318))


def test_a_factor_on_the_thrust_comes_out_of_the_fit() -> None:
    """The forces are 10 % stronger than stated along x; what one unit of that does is the response less the response without them."""
    flown = flight.standard("free")
    samples = flown.samples(np.random.default_rng(3))
    reference = Reference(tensor(flight.TRUTH[:6]), flight.TRUTH[6:9], 1 / flight.TRUTH[9])
    weaker = [dict(jet) for jet in flight.jets()]
    for jet in weaker:
        if str(jet["name"]).startswith("divert_x"):
            jet["force_n"] = (0.9 * np.array(jet["force_n"])).tolist()
    stated = flight.Flight(flight.vehicle(jets=weaker), flown.on, flown.delta_theta, flown.delta_v).samples(np.random.default_rng(3))
    (with_all, push_all), (without, push_without) = (response(s, CYCLES, reference, flown.used) for s in (samples, stated))
    extra = Extra((with_all - without)[..., None] / 0.1, (push_all - push_without)[..., None] / 0.1, np.ones(1))
    found = fit(stated, CYCLES, reference, flown.resolved, extra)
    assert found is not None
    assert found.extra[0] == pytest.approx(0.1, abs=4.5 * float(np.sqrt(found.extra_covariance[0, 0])))
    assert found.extra_covariance[0, 0] < 0.03**2


def test_the_response_is_what_the_linear_system_expects_of_its_reference() -> None:
    flown = flight.standard("free")
    samples = flown.samples()
    reference = Reference(tensor(flight.TRUTH[:6]), flight.TRUTH[6:9], 1 / flight.TRUTH[9])
    steps, force = response(samples, CYCLES, reference, flown.used)
    np.testing.assert_array_equal(steps, linearise(samples, CYCLES, reference, flown.used).steps)
    np.testing.assert_allclose(steps, np.diff(samples.rate_rad_s[CYCLES], axis=0), rtol=0, atol=3e-7)
    np.testing.assert_allclose(force, samples.specific_force_m_s2[CYCLES], rtol=0, atol=1e-4)


def test_a_standing_reference_is_judged_as_it_is_not_as_a_linear_fit_would_mend_it() -> None:
    """With half the mass the forces, and nothing else, are twice too large; a linear fit about it finds the mass none the less."""
    flown = flight.standard("free")
    right, light = (Reference(tensor(flight.TRUTH[:6]), flight.TRUTH[6:9], 1 / (f * flight.TRUTH[9])) for f in (1.0, 0.5))
    (_, force), (_, too_large) = (response(flown.samples(), CYCLES, reference, flown.used) for reference in (right, light))
    at_light = fit(flown.samples(), CYCLES, light, flown.resolved, passes=0)
    assert at_light is not None
    assert at_light.chi_square_at_reference == pytest.approx((((too_large - force) / 0.02) ** 2).sum() / (6 * 318), rel=1e-3)
    assert at_light.chi_square < 1e-3 * at_light.chi_square_at_reference


def mistaken(gyro: float, mounting: Array) -> Samples:
    """The standard flight's samples as a wrong unit of the gyro and a wrong mounting of the IMU make them."""
    flown = flight.standard("free")
    log = flown.log(np.random.default_rng(3))
    turned = flown.used.model_copy(update={"imu": flown.used.imu.model_copy(update={"body_from_imu": mounting.tolist()})})
    return compensate(align(replace(log, delta_theta_imu_rad=gyro * log.delta_theta_imu_rad), turned, 2.0, 0.0), turned)


@pytest.mark.parametrize("cyclic", [False, True])
@pytest.mark.parametrize("gyro", [1 / 57.3, 8.0, 57.3])
def test_no_fit_runs_away(gyro: float, cyclic: bool) -> None:
    """However wrong the hypothesis, no step leaves the reference worse than it was, and it stays a body of the testbed's scale."""
    mounting = np.roll(np.eye(3), 1, axis=0) if cyclic else np.eye(3)
    samples, used = mistaken(gyro, mounting), flight.standard("free").used
    first = first_reference(samples, CYCLES, used) or Reference(np.eye(3), np.zeros(3), 0.05)
    fits = [fit(samples, CYCLES, first, flight.resolved(used), passes=passes) for passes in (0, 1, 3, 8)]
    stood = [found.chi_square_at_reference if found is not None else np.inf for found in fits]
    assert all(after <= before * (1 + 1e-4) for before, after in itertools.pairwise(stood))
    for found in fits:
        if found is not None:
            assert found.chi_square <= found.chi_square_at_reference * (1 + 1e-9)
            moments = np.linalg.eigvalsh(found.reference.inertia) / np.trace(first.inertia)
            assert 1e-3 < moments[0] <= moments[2] < 1e3
            assert 1e-3 < found.reference.mu / first.mu < 1e3
            assert np.linalg.norm(found.reference.cg) < 10  # m


def test_a_response_whose_growth_drowns_in_rounding_is_no_fit() -> None:
    """About its middle axis a body tumbles: an error of the rate grows as exp(λ t), λ = ω √((I₂ − I₁)(I₃ − I₂) / (I₁ I₃)), eq. of Euler.

    At 4 rad/s with moments 1, 2, 3 that is 2.3 per second, and 1 / 2.2e-16 is reached after 15.6 s, 312 cycles.
    """
    spun = flight.Flight(flight.vehicle(), np.zeros((340, 18)), np.tile([0.0, 4.0 * 0.05, 0.0], (340, 1)), np.zeros((340, 3)))
    middle = Reference(np.diag([1.0, 2.0, 3.0]), np.zeros(3), 0.05)
    assert fit(spun.samples(), slice(2, 302), middle, spun.resolved, passes=0) is not None
    assert fit(spun.samples(), slice(2, 332), middle, spun.resolved, passes=0) is None
