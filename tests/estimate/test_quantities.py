from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.rows import Parameters
from tests import flight

MEAN = np.append(flight.TRUTH[:9], 1 / flight.TRUTH[9])[None]


def covariance() -> np.ndarray:
    root = np.diag(np.append(1e-3 * np.ones(9), 1e-3 / 22)) + 1e-5 * np.random.default_rng(0).standard_normal((10, 10))
    full: np.ndarray = (root @ root.T)[None]
    return full


def test_mass_and_its_sigma_follow_from_the_reciprocal() -> None:
    values, full = quantities(Parameters.of(MEAN, covariance()), flight.vehicle())
    np.testing.assert_allclose(values[0], flight.TRUTH)
    assert abs(np.sqrt(full[0, 9, 9]) - 22**2 * np.sqrt(covariance()[0, 9, 9])) < 1e-12


def test_a_reciprocal_that_is_not_known_gives_no_mass() -> None:
    wide = covariance()
    wide[0, 9, 9] = (0.5 / 22) ** 2
    values, _ = quantities(Parameters.of(MEAN, wide), flight.vehicle())
    assert np.isnan(values[0, 9])
    assert np.isfinite(values[0, :9]).all()


def test_thrust_scale_widens_inertia_and_mass_in_proportion_and_leaves_the_cg() -> None:
    _, plain = quantities(Parameters.of(MEAN, covariance()), flight.vehicle())
    _, scaled = quantities(Parameters.of(MEAN, covariance()), flight.vehicle(thrust={"scale_sigma": 0.05}))
    added = scaled[0] - plain[0]
    theta = np.concatenate([flight.TRUTH[:6], np.zeros(3), flight.TRUTH[9:]])
    np.testing.assert_allclose(added, 0.05**2 * np.outer(theta, theta), atol=1e-12)


def test_a_weighed_mass_tells_the_cg_of_what_turns_where_a_part_does_not() -> None:
    """The first moment is what the log tells in terms of the thrust; by hand, of thrust that is 1 % weaker than stated, and weighed."""
    bearing, part, true = np.array([0.02, -0.01, 0.03]), 3.0, flight.TRUTH
    environment = {"bearing_position_m": bearing.tolist(), "bearing_mass_kg": part}
    stated = flight.vehicle("air_bearing", environment=environment, thrust={"scale_sigma": 0.02})
    weighed = flight.vehicle(
        "air_bearing", environment=environment, thrust={"scale_sigma": 0.02}, known={"mass": {"value": true[9], "sigma": 1e-6}}
    )
    moment, mass = (true[9] - part) * (true[6:9] - bearing) / 0.99, true[9] / 0.99
    found = np.concatenate([true[:6] / 0.99, bearing + moment / (mass - part), [1 / mass]])[None]
    exact = 1e-12 * covariance()
    values, full = quantities(Parameters.of(found, exact), weighed)
    np.testing.assert_allclose(values[0, 6:9] - bearing, true[6:9] - bearing, rtol=1e-6)
    np.testing.assert_allclose(values[0, :6], true[:6], rtol=1e-6, atol=1e-9)
    _, wide = quantities(Parameters.of(found, exact), stated)
    off = np.abs(found[0, 6:9] - true[6:9])
    np.testing.assert_allclose(np.sqrt(np.diag(wide[0])[6:9]), 2 * off, rtol=0.05)
    assert (np.sqrt(np.diag(full[0])[6:9]) < 1e-2 * off).all()


def test_a_weighed_mass_leaves_the_first_moment_as_the_log_tells_it() -> None:
    """By hand: a moment told to a part in a million, and a mass to 2.5 %, which is two sigmas off the weighed one."""
    bearing, part, true = np.array([0.02, -0.01, 0.03]), 12.0, flight.TRUTH
    environment = {"bearing_position_m": bearing.tolist(), "bearing_mass_kg": part}
    used = flight.vehicle("air_bearing", environment=environment, known={"mass": {"value": true[9], "sigma": 1e-3}})
    moment, mass = (true[9] - part) * (true[6:9] - bearing), 1.05 * true[9]
    found = np.concatenate([true[:6], bearing + moment / (mass - part), [1 / mass]])[None]
    moment_sigma, mass_sigma = 1e-6 * np.linalg.norm(moment), 0.025 * mass
    slope = moment / (mass - part) ** 2 * mass**2  # of c by 1/m
    spread = 1e-12 * np.eye(10)[None]
    spread[0, 6:9, 6:9] = np.eye(3) * (moment_sigma / (mass - part)) ** 2 + np.outer(slope, slope) * (mass_sigma / mass**2) ** 2
    spread[0, 9, 6:9] = spread[0, 6:9, 9] = slope * (mass_sigma / mass**2) ** 2
    spread[0, 9, 9] = (mass_sigma / mass**2) ** 2
    values, full = quantities(Parameters.of(found, spread), used)
    assert abs(values[0, 9] - true[9]) < 1e-4
    away = values[0, 6:9] - true[6:9]
    sigma = np.hypot(moment_sigma / (true[9] - part), 1e-3 * (true[6:9] - bearing) / (true[9] - part))
    np.testing.assert_allclose(np.sqrt(np.diag(full[0])[6:9]), sigma, rtol=1e-2)
    assert (np.abs(away) < 0.1 * sigma).all()


def test_a_weighed_mass_is_a_measurement_of_the_whole_set() -> None:
    """Against conditioning a joint Gaussian by sampling its regression: inertia follows the mass by its covariance."""
    used = flight.vehicle(thrust={"scale_sigma": 0.05}, known={"mass": {"value": 21.0, "sigma": 0.01}})
    prior_values, prior = quantities(Parameters.of(MEAN, covariance()), flight.vehicle(thrust={"scale_sigma": 0.05}))
    values, full = quantities(Parameters.of(MEAN, covariance()), used)
    gain = prior[0, :, 9] / (prior[0, 9, 9] + 1e-4)
    np.testing.assert_allclose(values[0], prior_values[0] + gain * (21.0 - prior_values[0, 9]), rtol=1e-12)
    information = np.linalg.inv(prior[0])
    information[9, 9] += 1e4
    np.testing.assert_allclose(full[0], np.linalg.inv(information), rtol=1e-6, atol=1e-12)


def test_a_known_quantity_that_the_log_can_not_tell_is_taken_as_known() -> None:
    wide = covariance()
    wide[0, 9, 9] = (0.5 / 22) ** 2
    values, full = quantities(Parameters.of(MEAN, wide), flight.vehicle(known={"mass": {"value": 21.0, "sigma": 0.01}}))
    assert values[0, 9] == 21.0
    assert np.sqrt(full[0, 9, 9]) == 0.01


def test_an_axis_that_is_known_is_no_more_curved_than_what_is_known_leaves_it() -> None:
    """What the log tells of an axis only together with another: by conditioning a Gaussian, wider by what is left of its sigma alone."""
    used = flight.vehicle(known={"izz": {"value": 2.4, "sigma": 0.0024}})
    inertia, loose = MEAN[0, [0, 3, 5]], np.diag(covariance()[0]).copy()
    joint = np.diag(loose)
    joint[np.ix_([0, 5], [0, 5])] = np.outer([0.3, 1.0], [0.3, 1.0]) * (2.0 * inertia[2]) ** 2 + np.diag([1e-8, 0.0])
    relative = np.sqrt(np.diag(joint)[[0, 3, 5]]) / inertia
    values, full = quantities(Parameters(MEAN, joint[None], relative[None]), used)
    assert values[0, 0] - MEAN[0, 0] == pytest.approx(0.3 * (2.4 - MEAN[0, 5]), rel=1e-3)
    assert np.sqrt(full[0, 5, 5]) == pytest.approx(0.0024, rel=3e-3)
    left = np.hypot(0.3 * 0.0024, 1e-4)
    assert np.sqrt(full[0, 0, 0]) == pytest.approx(left / (1 - 2 * left / MEAN[0, 0]), rel=3e-3)
