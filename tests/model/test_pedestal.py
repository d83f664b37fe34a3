"""The response on a fixed pedestal against its equations of motion, and slopes against differences."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.rigidbody import lever_arm, times
from massprop_cli.model.gyroscopic import products
from massprop_cli.model.plant import PedestalBody, Reference
from massprop_cli.model.plant.plant import MU, MeanMotion
from massprop_cli.model.responsemap import ResponseMap
from tests.model.test_plant import BODY, motion
from tests.model.test_responsemap import difference

pytestmark = pytest.mark.numerical
GRAVITY = 9.80665
PIVOT = np.array([0.005, 0.01, -0.004])
PLANT = PedestalBody(PIVOT, 0.0, GRAVITY)


def test_torque_about_the_pivot_and_weight_turn_the_body() -> None:
    """I_p ω̇ + ω × I_p ω = τ_p − κ × g u, and the IMU feels g u and its lever arm."""
    moving, phi_map = motion(), ResponseMap(PLANT)
    torque = moving.wrench[..., :3] - np.cross(PIVOT, moving.wrench[..., 3:])
    moment = (BODY.cg - PIVOT) / BODY.mu
    turning = torque - np.cross(moment, GRAVITY * moving.up) - np.cross(moving.rate, times(BODY.inertia, moving.rate))
    turned = np.linalg.solve(BODY.inertia, turning[..., None])[..., 0]
    z = np.concatenate([PLANT.inputs(moving.wrench, moving.up, moving.up), products(moving.rate)], -1)
    phi = phi_map.coefficients(phi_map.plant.theta(BODY))[0][: 3 * phi_map.plant.channels].reshape(3, -1)
    np.testing.assert_allclose(times(phi, z), turned, rtol=1e-9)
    np.testing.assert_allclose(phi, phi_map.plant.response(phi_map.plant.theta(BODY)), rtol=1e-12)
    position, still = np.array([0.1, -0.05, 0.2]), motion(turned)
    rotation, square = still.rotation[:, 0], np.zeros((len(turned), 3, 3))
    square[:] = rotation - np.cross(np.eye(3), -turned[:, 0][:, None]).transpose(0, 2, 1)
    felt = PLANT.specific_force(BODY, still, MeanMotion(z[:, 0], turned[:, 0], square, rotation), position)
    expected = GRAVITY * still.up[:, 0] + lever_arm(still.rate[:, 0], turned[:, 0], position - PIVOT)
    np.testing.assert_allclose(times(felt.by_rate_dot, turned[:, 0]) + felt.offset, expected, rtol=1e-9)
    assert not felt.by_phi.any()


def test_no_mass_moves_the_coefficients() -> None:
    phi_map = ResponseMap(PLANT)
    theta = phi_map.plant.theta(BODY)
    slopes = phi_map.coefficients(theta)[1]
    np.testing.assert_allclose(slopes, difference(lambda t: phi_map.coefficients(t)[0], theta), atol=1e-6 * np.abs(slopes).max())
    assert not slopes[: 3 * phi_map.plant.channels, MU].any()


def test_parameters_are_there_and_back_and_their_slopes_leave_the_mass_as_it_is() -> None:
    phi_map = ResponseMap(PLANT)
    theta = phi_map.plant.theta(BODY)
    found = phi_map.plant.parameters(theta)
    np.testing.assert_allclose(phi_map.plant.theta(Reference(BODY.inertia, found[6:9], float(found[9]))), theta, rtol=1e-12)
    slopes = phi_map.plant.slopes(theta)[:, :MU]
    np.testing.assert_allclose(slopes, difference(phi_map.plant.parameters, theta)[:, :MU], rtol=1e-6, atol=1e-6)
