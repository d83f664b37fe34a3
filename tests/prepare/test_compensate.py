from __future__ import annotations

import numpy as np

from massprop_cli.prepare.attitude import integrate_attitude, world_up_b
from massprop_cli.prepare.compensate import acceleration
from tests import flight


def test_attitude_of_a_coning_motion_is_integrated_closely() -> None:
    """A rotation about an axis that itself turns: against 400 times finer steps."""
    t = np.linspace(0, 4, 81)
    fine = np.linspace(0, 4, 32_001)

    def rate(time: np.ndarray) -> np.ndarray:
        return np.stack([0.8 * np.cos(3 * time), 0.8 * np.sin(3 * time), 0.2 + 0 * time], 1)

    middle = rate((fine[1:] + fine[:-1]) / 2) * np.diff(fine)[:, None]
    turns = middle.reshape(80, 400, 3).sum(1)
    start = np.array([1.0, 0, 0, 0])
    exact = integrate_attitude(start, middle)[::400]
    assert np.abs(integrate_attitude(start, turns) - exact).max() < 2e-5
    assert len(t) == len(exact)


def test_up_is_the_third_row_of_the_rotation() -> None:
    half = np.array([np.cos(0.3), np.sin(0.3), 0.0, 0.0])  # 0.6 rad about X
    np.testing.assert_allclose(world_up_b(half), [0.0, np.sin(0.6), np.cos(0.6)], atol=1e-15)


def test_an_imu_at_rest_on_a_tilted_bearing_shows_no_acceleration_once_gravity_is_out() -> None:
    attitude = [float(np.cos(0.1)), 0.0, float(np.sin(0.1)), 0.0]
    used = flight.vehicle("air_bearing", environment={"initial_attitude_wxyz": attitude})
    felt = 9.80665 * world_up_b(np.array(attitude)) * flight.CYCLE
    still = flight.Flight(used, np.zeros((30, 18)), np.zeros((30, 3)), np.tile(felt, (30, 1)))
    np.testing.assert_allclose(acceleration(still.samples(), used), 0, atol=1e-12)


def test_a_turned_imu_gives_the_same_body_rates() -> None:
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    plain = flight.standard("free")
    used = flight.vehicle(imu={"body_from_imu": turn.tolist()})
    turned = flight.Flight(used, plain.on, plain.delta_theta @ turn, plain.delta_v @ turn)
    np.testing.assert_allclose(turned.samples().rate_rad_s, plain.samples().rate_rad_s, atol=1e-15)
    np.testing.assert_allclose(turned.samples().specific_force_m_s2, plain.samples().specific_force_m_s2, atol=1e-13)
