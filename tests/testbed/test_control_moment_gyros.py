"""Control moment gyros of the simulator against what is conserved, and against the torque that can be written down."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight
from tests.testbed.test_wheels import in_world

SHORT = ("duration_s=20", 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0, end_s=20}]')
BODY = np.array([[0.6, 0.05, -0.06], [0.05, 2.7, 0.1], [-0.06, 0.1, 2.4]])


def spun(flight: SimulatedFlight) -> Array:
    """(K, 3) momentum of the rotors relative to the body, 0.4 N m s each as they begin; body axes, by Rodrigues' formula."""
    held = np.zeros((len(flight.time_s), 3))
    for gyro in flight.vehicle.control_moment_gyros:
        axis, spin = np.array(gyro.gimbal_axis), np.array(gyro.spin_axis)
        angle = flight.turning[f"cmg_{gyro.name}_gimbal_rad"][0][:, None]
        speed = flight.turning.get(f"cmg_{gyro.name}_rad_s", np.full((1, len(angle)), 500.0))[0][:, None]
        axis = axis / np.linalg.norm(axis)
        held += 8e-4 * speed * (spin * np.cos(angle) + np.cross(axis, spin) * np.sin(angle) + axis * (axis @ spin) * (1 - np.cos(angle)))
    return held


@pytest.mark.parametrize("settings", [(), ("actuators.gyro_run_down_s=40",)])
def test_what_the_rotors_take_the_body_gives(settings: tuple[str, ...]) -> None:
    """Angular momentum of the whole stands still in the world, to 2e-5 of what goes to and fro, also while all rotors run down."""
    source = scenario.load("control-moment-gyros", (*SHORT, *settings))
    gyros = source.scenario.vehicle.control_moment_gyros
    logged = {"h_n_m_s": None, "spin_inertia_kg_m2": 8e-4, "start_rad_s": 500.0}
    vehicle = source.scenario.vehicle.model_copy(
        update={"control_moment_gyros": tuple(gyro.model_copy(update=logged) for gyro in gyros)} if settings else {}
    )
    flight = simulate.fly(replace(source, scenario=source.scenario.model_copy(update={"vehicle": vehicle})), [1])
    bare = 8e-4 * np.outer([1.0, 0.0, 0.0], [1.0, 0.0, 0.0])  # the last one's rotor, which the body is stated to be without
    held = spun(flight)
    total = in_world(flight.attitude_wxyz[0, 1:], flight.rate_rad_s[0, 1:] @ (BODY + bare).T + held)
    exchanged = np.ptp(held, axis=0).max()
    assert exchanged > 0.1
    assert np.abs(total - total[0]).max() < 2e-5 * exchanged


def test_a_gimbal_that_turns_evenly_gives_the_torque_of_momentum_times_rate() -> None:
    """On a body so heavy that it stands: −h g × s δ̇ about it, from the command's delay on, and −ω × h of its turning is as nothing."""
    heavy = ("truth.ixx=6e5", "truth.iyy=2e6", "truth.izz=2.4e6", "vehicle.imu.gyro_noise_rad_s=0")
    steady = ("duration_s=2", 'plan=[{motion="steady", axes=["yaw"], start_s=0, end_s=2, torque_n_m=0.01}]')
    flight = simulate.fly(scenario.load("control-moment-gyros", (*steady, *heavy)), [1])
    assert np.abs(flight.rate_rad_s[0, 2]).max() == 0.0
    inertia = np.array([[6e5, 0.05, -0.06], [0.05, 2e6, 0.1], [-0.06, 0.1, 2.4e6]])
    gained = flight.rate_rad_s[0, 3:] @ inertia.T
    np.testing.assert_allclose(gained, -(spun(flight)[2:] - spun(flight)[1]), atol=1e-9)
    assert gained[-1, 2] == pytest.approx(0.01 * (2.0 - 2 * 0.05), rel=0.05)  # steering loses a little


def test_gyros_that_can_not_be_flown_are_refused() -> None:
    with pytest.raises(InputError, match="give start_rad_s, how fast its rotor turns, or h_n_m_s"):
        scenario.load("control-moment-gyros", ("vehicle.control_moment_gyros.2.start_rad_s=0",))
    one = 'vehicle.control_moment_gyros=[{name="x", gimbal_axis=[1, 0, 0], spin_axis=[0, 1, 0], h_n_m_s=0.4, locked_in_inertia=true}]'
    by_gyros = "plan=[{motion='random', axes=['roll'], start_s=0, end_s=5, by_wheels=true}]"
    with pytest.raises(InputError, match="max_gimbal_rate_rad_s"):
        scenario.load("free-flyer", (one, by_gyros))
    with pytest.raises(InputError, match="cannot drive roll"):
        simulate.fly(scenario.load("free-flyer", (one, by_gyros, "actuators.max_gimbal_rate_rad_s=0.1")), [1])
