"""Products of mass properties: against the plants' own physics and against differences."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor, times
from massprop_cli.model.gyroscopic import gamma, products, products_by_rate
from massprop_cli.model.parameters import parameters
from massprop_cli.model.plant import BearingBody, FreeBody, Plant, Reference
from massprop_cli.model.plant.plant import MOMENT, MU, J
from massprop_cli.model.responsemap import ResponseMap, Tangent
from tests.model.test_plant import BODY, moment_about_cg, motion

pytestmark = pytest.mark.numerical

PLANTS: list[Plant] = [FreeBody(), BearingBody(np.array([0.005, 0.01, -0.004]), 5.0, 9.80665)]
BOTH = pytest.mark.parametrize("plant", PLANTS, ids=["free", "air_bearing"])


def difference(function: object, theta: Array) -> Array:
    """(..., 10) by central differences."""
    assert callable(function)
    steps = np.diag(1e-6 * np.maximum(np.abs(theta), 1e-2))
    return np.stack([(function(theta + h) - function(theta - h)) / (2 * h.sum()) for h in steps], -1)


def test_gyroscopic_torque_is_linear_in_products_of_rates() -> None:
    rate = np.random.default_rng(1).normal(0, 1, (7, 3))
    np.testing.assert_allclose(products(rate) @ gamma(BODY.inertia).T, np.cross(rate, rate @ BODY.inertia), atol=1e-14)
    step = np.array([0.3, -0.2, 0.1])
    difference = (products(rate + 1e-6 * step) - products(rate - 1e-6 * step)) / 2e-6
    np.testing.assert_allclose(times(products_by_rate(rate), np.broadcast_to(step, rate.shape)), difference, atol=1e-9)


@BOTH
def test_angular_acceleration_is_linear_in_the_coefficients(plant: FreeBody | BearingBody) -> None:
    """ω̇ from the moments about the CG, solved for by iteration, against Φ z about O or the bearing."""
    moving = motion()
    for _ in range(60):
        moment = moment_about_cg(plant, moving) - np.cross(moving.rate, times(BODY.inertia, moving.rate))
        moving = motion(np.linalg.solve(BODY.inertia, moment[..., None])[..., 0])
    phi_map = ResponseMap(plant)
    theta = phi_map.plant.theta(BODY)
    phi, _ = phi_map.coefficients(theta)
    torque, force = moving.wrench[..., :3], moving.wrench[..., 3:]
    known = np.zeros_like(torque)
    if isinstance(plant, BearingBody):
        level = np.eye(3) - moving.up[..., :, None] * moving.up[..., None, :]
        channels = [torque - np.cross(plant.bearing, force), moving.up, times(level, force)]
        kappa = theta[MOMENT]
        swung = theta[MU] * np.cross(kappa, times(level, times(moving.rotation, kappa)))
        known = times(tensor(theta[J]), swung)
    else:
        channels = [torque, force]
    z = np.concatenate([*channels, products(moving.rate)], -1)
    np.testing.assert_allclose(times(phi[: 3 * phi_map.plant.channels].reshape(3, -1), z) + known, moving.rate_dot, rtol=1e-9)


@BOTH
def test_there_and_back(plant: Plant) -> None:
    phi_map = ResponseMap(plant)
    theta = phi_map.plant.theta(BODY)
    np.testing.assert_allclose(phi_map.plant.parameters(theta), parameters(BODY), rtol=1e-12)
    back = phi_map.reference(theta)
    np.testing.assert_allclose(back.inertia, BODY.inertia, rtol=1e-12)
    np.testing.assert_allclose(phi_map.plant.parameters(np.stack([theta, 1.1 * theta]))[0], parameters(BODY), rtol=1e-12)


@BOTH
def test_slopes_are_those_of_differences(plant: Plant) -> None:
    phi_map = ResponseMap(plant)
    theta = phi_map.plant.theta(BODY)
    slopes = difference(phi_map.plant.parameters, theta)
    np.testing.assert_allclose(phi_map.plant.slopes(theta), slopes, atol=1e-7 * np.abs(slopes).max())
    np.testing.assert_allclose(phi_map.plant.slopes(np.stack([theta, theta]))[1], phi_map.plant.slopes(theta), rtol=1e-14)
    by_theta = difference(lambda t: phi_map.coefficients(t)[0], theta)
    np.testing.assert_allclose(phi_map.coefficients(theta)[1], by_theta, atol=1e-7 * np.abs(by_theta).max())


@BOTH
def test_a_step_to_what_is_no_body_is_halved_until_it_is_one(plant: Plant) -> None:
    phi_map = ResponseMap(plant)
    theta = phi_map.plant.theta(BODY)
    step = np.zeros(10)
    step[0] = -3 * theta[0]
    found = phi_map.stepped(theta, step)
    assert 0 < found[0] < theta[0]
    assert np.linalg.eigvalsh(phi_map.reference(found).inertia)[0] > 0
    many = phi_map.nearest(theta, np.stack([step, 0 * step]))
    assert np.linalg.eigvalsh(tensor(many[0, :6]))[0] > 0
    np.testing.assert_array_equal(many[1], theta)


def test_the_bearings_first_moment_is_of_the_rotating_mass_alone() -> None:
    plant = BearingBody(np.zeros(3), 5.0, 9.80665)
    theta = ResponseMap(plant).plant.theta(Reference(BODY.inertia, np.array([1e-3, 0, 0]), 1 / 25.0))
    np.testing.assert_allclose(theta[MOMENT], [0.02, 0, 0])  # 20 kg, 1 mm


@BOTH
def test_the_tangent_has_the_coefficients_where_it_touches_and_their_slopes_everywhere(plant: FreeBody | BearingBody) -> None:
    phi_map = ResponseMap(plant)
    theta = phi_map.plant.theta(BODY)
    tangent, moved = Tangent(plant, theta), theta + 0.1 * np.random.default_rng(6).normal(size=10)
    phi, slopes = phi_map.coefficients(theta)
    found, by_theta = tangent.coefficients(moved)
    assert found.shape == (tangent.size,)
    np.testing.assert_allclose(tangent.onto @ found, phi + slopes @ (moved - theta), rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(tangent.onto @ by_theta, slopes)
