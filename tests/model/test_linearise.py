from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor, times
from massprop_cli.model.layout import PARAMETERS, RATE
from massprop_cli.model.linearise import linearise
from massprop_cli.model.parameters import parameters, stepped
from massprop_cli.model.plant import Reference
from tests import flight

pytestmark = pytest.mark.numerical

KINDS = ("free", "air_bearing")


def truth(kind: str) -> Array:
    return flight.TRUTH if kind == "free" else flight.ON_BEARING


def reference(values: Array) -> Reference:
    return Reference(tensor(values[:6]), values[6:9].copy(), 1 / values[9])


@cache
def flown(kind: str, rise_s: float = 0.0) -> flight.Flight:
    rate = np.array([0.2, -0.1, 0.15]) if kind == "free" else None
    used = flight.vehicle(kind, jets=flight.jets(rise_s=rise_s))
    return flight.fly(used, flight.pulses(80), truth(kind), rate=rate, step_s=0.0025 if rise_s else flight.STEP)


@pytest.mark.parametrize("rise_s", [0.0, 0.0025])
@pytest.mark.parametrize("kind", KINDS)
def test_about_the_truth_the_model_reproduces_an_exact_flight(kind: str, rise_s: float) -> None:
    """Noise-free cycle means from RK4 against the model: 0.05 % of the IMU's noise in rate, 0.5 % in force."""
    samples = flown(kind, rise_s).samples()
    system = linearise(samples, slice(2, 80), reference(truth(kind)), flown(kind).used)
    growth = np.diff(samples.rate_rad_s[2:80], axis=0)
    np.testing.assert_allclose(system.steps, growth, atol=5e-8)
    expected = times(system.observation[:, 3:, PARAMETERS], parameters(reference(truth(kind))))
    np.testing.assert_allclose(system.specific_force, expected, atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_agree_with_finite_differences(kind: str) -> None:
    """The response of rate and force to each parameter, against the model's own change when the reference is moved."""
    samples, used, base = flown(kind).samples(), flown(kind).used, truth(kind)
    system = linearise(samples, slice(2, 80), reference(base), used)
    theta = parameters(reference(base))
    sizes = np.array([1e-4] * 6 + [1e-6] * 3 + [1e-6])
    for i, size in enumerate(sizes):
        moved = []
        for sign in (1, -1):
            values = theta.copy()
            values[i] += sign * size
            shifted = Reference(tensor(values[:6]), values[6:9], float(values[9]))
            other = linearise(samples, slice(2, 80), shifted, used)
            force = samples.specific_force_m_s2[2:80] - other.specific_force + times(other.observation[:, 3:, PARAMETERS], values)
            moved.append((other.steps, force))
        # the implicit step's (1 − A) is solved in the transition: undo it to compare with the plain growth
        solve = system.moment_to_rate @ reference(base).inertia
        rate_slope = times(solve, (moved[0][0] - moved[1][0]) / (2 * size))
        force_slope = (moved[0][1] - moved[1][1]) / (2 * size)
        scale_rate = np.abs(system.transition[:, RATE, i]).max() + 1e-12
        scale_force = np.abs(system.observation[:, 3:, i]).max() + 1e-12
        np.testing.assert_allclose(rate_slope / scale_rate, system.transition[:, RATE, i] / scale_rate, atol=0.03)
        np.testing.assert_allclose(force_slope / scale_force, system.observation[:, 3:, i] / scale_force, atol=0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_the_force_of_an_error_of_the_rate_agrees_with_finite_differences(kind: str) -> None:
    """The lever arm's own acceleration and the gyroscopic coupling, against the model's own change when the measured rates are moved."""
    samples, used, about = flown(kind).samples(), flown(kind).used, reference(truth(kind))
    system = linearise(samples, slice(2, 80), about, used)
    size, largest = 1e-5, np.abs(system.observation[:, 3:, RATE]).max()
    assert largest > 0.04
    for i in range(3):
        forces = []
        for sign in (1, -1):
            rate = samples.rate_rad_s + sign * size * np.eye(3)[i]
            other = linearise(replace(samples, rate_rad_s=rate), slice(2, 80), about, used)
            forces.append(times(other.observation[:, 3:, PARAMETERS], parameters(about)) - other.specific_force)
        slope = (forces[0] - forces[1]) / (2 * size)
        np.testing.assert_allclose(slope, system.observation[:, 3:, RATE.start + i], atol=0.004 * largest)


def test_rows_do_not_depend_on_later_cycles() -> None:
    samples, used = flown("free").samples(), flown("free").used
    whole = linearise(samples, slice(2, 80), reference(flight.TRUTH), used)
    part = linearise(samples, slice(2, 40), reference(flight.TRUTH), used)
    np.testing.assert_array_equal(whole.transition[:37], part.transition)
    np.testing.assert_array_equal(whole.measured[:38], part.measured)


@pytest.mark.parametrize("factor", [0.1, 1.0, 30.0])
def test_a_step_lands_right_from_an_inertia_far_off(factor: float) -> None:
    """The true response J / k, linear about I, is what I (2 − 1/k) would give there: the step leads to I k."""
    base = reference(flight.TRUTH)
    target = parameters(base)
    target[:6] *= 2 - 1 / factor
    moved = stepped(base, target)
    assert moved is not None
    np.testing.assert_allclose(moved.inertia, factor * base.inertia, rtol=1e-9)


@pytest.mark.parametrize(
    ("entries", "value"),
    [
        (slice(0, 10), np.nan),
        (9, np.inf),
        (9, -0.01),
        (9, 6e66),  # 1/kg
        (9, 1e-6),
        (slice(6, 9), -2e3),  # m
        (slice(0, 6), flight.TRUTH[:6] * (2 - 1e-4)),
        (slice(0, 6), flight.TRUTH[:6] * -1e4),
        (0, 1.3),  # more than twice the reference's: its response would be negative
    ],
)
def test_a_step_to_what_is_no_body_is_not_taken(entries: int | slice, value: float | Array) -> None:
    target = parameters(reference(flight.TRUTH))
    target[entries] = value
    assert stepped(reference(flight.TRUTH), target) is None


def test_a_reference_of_no_body_s_kind_makes_no_motion_run_away() -> None:
    """Principal moments a thousand to one, at rates of a wrong unit: the coupling would square the rate in each pass."""
    flown_ = flown("free")
    samples = flown_.samples()
    fast = replace(samples, rate_rad_s=60 * samples.rate_rad_s)
    absurd = Reference(np.diag([1e3, 1.0, 1e3]), np.zeros(3), 0.05)
    system = linearise(fast, slice(2, 80), absurd, flown_.used)
    rate = np.linalg.norm(fast.rate_rad_s[2:80], axis=1)
    assert np.isfinite(system.steps).all()
    # products of what is within a cycle are no more than a few times those of its mean
    assert (np.linalg.norm(system.steps, axis=1) < 1e3 * flight.CYCLE * 4 * rate[1:] ** 2 + 1).all()
    assert np.linalg.norm(system.transition[:, 10:13, 10:13], axis=(1, 2)).max() < 10


def test_four_bins_of_a_cycle_give_what_forty_give() -> None:
    """To a fiftieth of what the gyro's noise leaves of one step; the second order that was left out made half of it at six bins."""
    found = []
    for bins in (4, 40):
        used = flown("free", 0.0025).used
        used = used.model_copy(update={"estimator": used.estimator.model_copy(update={"bins_per_cycle": bins})})
        samples = replace(flown("free", 0.0025), used=used).samples()
        found.append(linearise(samples, slice(2, 80), reference(truth("free")), used).steps)
    np.testing.assert_allclose(found[0], found[1], atol=5e-8)
