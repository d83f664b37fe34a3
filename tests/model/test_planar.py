"""A body on a table against a free one whose other motions are taken away, and against differences."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import lever_arm, tensor
from massprop_cli.model.gyroscopic import products
from massprop_cli.model.plant import Motion, PlanarBody, Reference
from massprop_cli.model.plant.planar import OBSERVABLE
from massprop_cli.model.plant.plant import MeanMotion
from massprop_cli.model.responsemap import ResponseMap

pytestmark = pytest.mark.numerical

PLANT = PlanarBody(0.05)
BODY = Reference(tensor(np.array([0.16, 0.01, -0.02, 0.18, 0.005, 0.26])), np.array([0.012, -0.018, 0.06]), 1 / 14)


def yawing() -> tuple[Array, Array, Array]:
    """(5, 6) wrenches as far as they move the body, (5, 3) rates, (5, 3) angular accelerations by the moment about the CG."""
    rng = np.random.default_rng(3)
    wrench, rate = rng.normal(0, 1, (5, 6)), np.zeros((5, 3))
    wrench[:, [0, 1, 5]] = 0.0
    rate[:, 2] = rng.normal(0, 1, 5)
    moment = wrench[:, 2] - (BODY.cg[0] * wrench[:, 4] - BODY.cg[1] * wrench[:, 3])
    return wrench, rate, np.outer(moment / BODY.inertia[2, 2], [0, 0, 1])


def test_angular_acceleration_is_linear_in_the_coefficients() -> None:
    wrench, rate, rate_dot = yawing()
    phi, _ = ResponseMap(PLANT).coefficients(PLANT.theta(BODY))
    z = np.concatenate([wrench, products(rate)], -1)
    np.testing.assert_allclose(z @ phi[:36].reshape(3, 12).T, rate_dot, rtol=1e-12)
    np.testing.assert_array_equal(PLANT.response(PLANT.theta(BODY)), phi[:36].reshape(3, 12))


def test_the_specific_force_along_the_table_is_that_of_the_cg_and_the_lever_arm() -> None:
    wrench, rate, rate_dot = yawing()
    position = np.array([0.09, -0.05, 0.12])
    spin = np.array([lever_arm(w[None], a[None], np.eye(3)).T for w, a in zip(rate, rate_dot, strict=True)])
    centripetal = np.array([lever_arm(w[None], 0 * a[None], np.eye(3)).T for w, a in zip(rate, rate_dot, strict=True)])
    bins = Motion(wrench[:, None], rate[:, None], rate_dot[:, None], 0 * rate[:, None], 0 * rate[:, None])
    whole = np.concatenate([wrench, products(rate)], -1)
    felt = PLANT.specific_force(BODY, bins, MeanMotion(whole, rate_dot, centripetal, spin), position)
    phi, _ = PLANT.coefficients(PLANT.theta(BODY))
    found = np.einsum("kij,kj->ki", felt.by_rate_dot, whole @ phi[:36].reshape(3, 12).T) + felt.by_phi @ phi[36:] + felt.offset
    expected = BODY.mu * wrench[:, 3:] + lever_arm(rate, rate_dot, position - BODY.cg)
    np.testing.assert_allclose(found[:, :2], expected[:, :2], rtol=1e-12)


def test_slopes_are_those_of_differences_in_what_is_told_and_nothing_in_the_rest() -> None:
    theta = PLANT.theta(BODY)
    steps = np.diag(1e-6 * np.maximum(np.abs(theta), 1e-2))
    by_theta = np.stack([(PLANT.coefficients(theta + h)[0] - PLANT.coefficients(theta - h)[0]) / (2 * h.sum()) for h in steps], -1)
    np.testing.assert_allclose(PLANT.coefficients(theta)[1], by_theta, atol=1e-8 * np.abs(by_theta).max())
    assert not PLANT.coefficients(theta)[1][:, ~OBSERVABLE].any()
    assert (np.abs(PLANT.coefficients(theta)[1]).sum(0)[OBSERVABLE] > 0).all()


def test_what_is_told_comes_back_and_the_rest_is_a_flat_body() -> None:
    back = ResponseMap(PLANT).reference(PLANT.theta(BODY))
    np.testing.assert_allclose([back.inertia[2, 2], *back.cg[:2], back.mu], [0.26, 0.012, -0.018, 1 / 14], rtol=1e-12)
    np.testing.assert_allclose(back.inertia, np.diag([0.13, 0.13, 0.26]), atol=1e-15)


def test_a_vector_of_the_world_is_carried_from_the_middle_of_a_cycle_to_the_middle_of_the_next() -> None:
    rate, duration = np.outer([0.5, -1.0, 2.0], [0, 0, 1]), np.array([0.05, 0.1, 0.05])
    steps, _ = PLANT.tilt_step(rate, duration)
    angle = np.cumsum(rate[:, 2] * duration) - rate[:, 2] * duration / 2
    world = np.array([0.3, -0.1])
    seen = [np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) @ world for a in angle]
    np.testing.assert_allclose(steps[0] @ seen[0], seen[1], rtol=1e-12)
    np.testing.assert_allclose(steps[1] @ seen[1], seen[2], rtol=1e-12)
    assert PlanarBody(0.0).tilt_count == 0
