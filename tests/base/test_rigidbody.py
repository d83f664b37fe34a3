import numpy as np
import pytest

from massprop_cli.base import rigidbody
from massprop_cli.base.arrays import Array

RNG = np.random.default_rng(5)
INERTIA = np.array([[0.62, 0.04, -0.07], [0.04, 2.8, 0.11], [-0.07, 0.11, 2.5]])
CG = np.array([-0.018, 0.027, 0.012])


def test_torque_regressor_times_parameters_is_the_torque_balance() -> None:
    rate, rate_dot, force = RNG.standard_normal((3, 50, 3))
    expected = rate_dot @ INERTIA + np.cross(rate, rate @ INERTIA) + np.cross(CG, force)
    theta = np.concatenate([rigidbody.elements(INERTIA), CG])
    np.testing.assert_allclose(rigidbody.torque_regressor(rate, rate_dot, force) @ theta, expected, atol=1e-13)


def test_torque_regressor_row_x_is_as_published() -> None:
    (wx, wy, wz), (ax, ay, az), (_, fy, fz) = RNG.standard_normal((3, 3))
    row = rigidbody.torque_regressor(np.array([wx, wy, wz]), np.array([ax, ay, az]), np.array([0.3, fy, fz]))[0]
    published = [ax, ay - wx * wz, az + wx * wy, -wy * wz, wy**2 - wz**2, wy * wz, 0, fz, -fy]
    np.testing.assert_allclose(row, published, atol=1e-14)


def test_regressor_agrees_with_finite_differences_of_the_equations_of_motion() -> None:
    """Vary each parameter: the torque that keeps the same motion changes by the regressor's column."""
    rate, rate_dot, force = RNG.standard_normal((3, 3))
    theta = np.concatenate([rigidbody.elements(INERTIA), CG])

    def torque(parameters: Array) -> Array:
        inertia, cg = rigidbody.tensor(parameters[:6]), parameters[6:]
        # the torque at which angular_acceleration returns rate_dot, found from its own affine dependence on torque
        at_zero = rigidbody.angular_acceleration(inertia, cg, rate, np.zeros(3), force)
        unit = np.stack([rigidbody.angular_acceleration(inertia, cg, rate, e, force) - at_zero for e in np.eye(3)], 1)
        return np.linalg.solve(unit, rate_dot - at_zero)

    columns = [(torque(theta + h) - torque(theta - h)) / 2e-6 for h in 1e-6 * np.eye(9)]
    np.testing.assert_allclose(np.stack(columns, 1), rigidbody.torque_regressor(rate, rate_dot, force), atol=1e-7)


def test_torque_free_motion_keeps_momentum_and_energy() -> None:
    rate = np.array([0.4, -1.1, 0.7])
    world, h = np.eye(3), 1e-3
    momentum, energy = INERTIA @ rate, rate @ INERTIA @ rate
    for _ in range(2000):

        def slope(w: Array) -> Array:
            return rigidbody.angular_acceleration(INERTIA, CG, w, np.zeros(3), np.zeros(3))

        k1 = slope(rate)
        k2 = slope(rate + h / 2 * k1)
        k3 = slope(rate + h / 2 * k2)
        k4 = slope(rate + h * k3)
        middle = rate + h / 4 * (k1 + k2)
        turn = rigidbody.cross_matrix(middle * h)
        angle = np.linalg.norm(middle * h)
        world = world @ (np.eye(3) + np.sin(angle) / angle * turn + (1 - np.cos(angle)) / angle**2 * turn @ turn)
        rate = rate + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    assert rate @ INERTIA @ rate == pytest.approx(energy, rel=1e-10)
    np.testing.assert_allclose(world @ INERTIA @ rate, momentum, atol=1e-5)


def test_elements_and_tensor_are_inverse() -> None:
    six = RNG.standard_normal((4, 6))
    np.testing.assert_array_equal(rigidbody.elements(rigidbody.tensor(six)), six)


def test_an_inertia_about_another_point_is_that_of_the_points_of_mass() -> None:
    """Against the definition, Σ m (r·r 1 − r rᵀ), summed over a cloud of points about its own CG and about a point away from it."""
    weights, points, away = RNG.uniform(0.1, 1.0, 50), RNG.standard_normal((50, 3)), RNG.standard_normal(3)

    def about(origin: Array) -> Array:
        r = points - origin
        inertia: Array = np.einsum("n,ij->ij", weights * (r**2).sum(1), np.eye(3)) - np.einsum("n,ni,nj->ij", weights, r, r)
        return inertia

    cg = weights @ points / weights.sum()
    np.testing.assert_allclose(about(cg) + rigidbody.parallel_axis(float(weights.sum()), cg - away), about(away), rtol=1e-12)


@pytest.mark.parametrize("size", [1e-6, 0.05, 0.0999, 0.1001, 2.0])
def test_a_mean_rotation_is_the_mean_of_rotations(size: float) -> None:
    """Against Gauss's rule of 20 points, on both sides of where the series ends."""
    vector = size * np.array([0.6, -0.48, 0.64])
    at, weight = np.polynomial.legendre.leggauss(20)
    parts = rigidbody.rotation((at[:, None] + 1) / 2 * vector)
    np.testing.assert_allclose(rigidbody.mean_rotation(vector), np.einsum("k,kij->ij", weight / 2, parts), atol=2e-14)
