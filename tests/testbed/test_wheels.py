"""Reaction wheels of the simulator against what is conserved, and against the spin-down that can be written down."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight

SHORT = ("duration_s=8", 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0, end_s=8}]')


def in_world(attitude_wxyz: Array, v: Array) -> Array:
    """(n, 3) vectors turned from body axes, by the rotation matrix written out."""
    w, x, y, z = attitude_wxyz.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    turned: Array = np.einsum("ijn,nj->ni", np.array(rows), v)
    return turned


def stored(flight: SimulatedFlight) -> Array:
    """(K, 3) momentum of the wheels at the end of each cycle that the body's inertia excludes, body axes."""
    rate, held = flight.rate_rad_s[0, 1:], np.zeros_like(flight.rate_rad_s[0, 1:])
    for wheel in flight.vehicle.wheels:
        axis = np.array(wheel.axis) / np.linalg.norm(wheel.axis)
        speed = flight.turning[f"wheel_{wheel.name}_rad_s"][0] + (0.0 if wheel.locked_in_inertia else rate @ axis)
        held = held + wheel.spin_inertia_kg_m2 * speed[:, None] * axis
    return held


def momentum(flight: SimulatedFlight) -> Array:
    """(K, 3) of body and wheels in world axes at the end of each cycle, wheels counted once."""
    body = np.array([[0.6, 0.05, -0.06], [0.05, 2.7, 0.1], [-0.06, 0.1, 2.4]])
    return in_world(flight.attitude_wxyz[0, 1:], flight.rate_rad_s[0, 1:] @ body.T + stored(flight))


@pytest.mark.parametrize("friction", [(), ("vehicle.wheels.0.viscous_friction_n_m_s=1e-3", "vehicle.wheels.2.coulomb_friction_n_m=0.02")])
def test_what_wheels_take_the_body_gives(friction: tuple[str, ...]) -> None:
    """Angular momentum of the whole stands still in the world while a third of it goes to and fro: to 1e-8 of it."""
    total = momentum(simulate.fly(scenario.load("wheels", (*SHORT, *friction)), [1]))
    assert np.abs(total - total[0]).max() < 1e-8 * np.linalg.norm(total[0])


@pytest.mark.thorough
def test_docking_keeps_the_momentum_of_both_and_of_the_wheels() -> None:
    """About the common CG: ``I₁ ω + a h + I₂ ω₂ + μ (c₂ − c₁) × v`` before, body and wheels from then on; wheels take no blow, to 1e-8."""
    docked = "docked={ixx=0.5, iyy=0.8, izz=0.6, cg_x=0.7, cg_y=0.05, cg_z=-0.1, mass=8.0}"
    event = 'events=[{kind="dock", at_s=4, docked_rate_rad_s=[0.1, -0.05, 0.08], docked_velocity_m_s=[-0.05, 0.01, 0.02]}]'
    alone = simulate.fly(scenario.load("wheels", SHORT), [1])
    flight = simulate.fly(scenario.load("wheels", (*SHORT, docked, event)), [1])
    body = np.array([[0.6, 0.05, -0.06], [0.05, 2.7, 0.1], [-0.06, 0.1, 2.4]])
    first, second = np.array([-0.02, 0.025, 0.01]), np.array([0.7, 0.05, -0.1])
    reduced, arm = 22.0 * 8.0 / 30.0, second - first
    combined = body + np.diag([0.5, 0.8, 0.6]) + reduced * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    at, rate = 80, alone.rate_rad_s[0, 80]
    met = np.diag([0.5, 0.8, 0.6]) @ [0.1, -0.05, 0.08] + reduced * np.cross(arm, [-0.05, 0.01, 0.02])
    before = in_world(alone.attitude_wxyz[0, [at]], (body @ rate + stored(alone)[at - 1] + met)[None])[0]
    assert np.abs(flight.rate_rad_s[0, at] - rate).max() > 0.01
    after = in_world(flight.attitude_wxyz[0, at + 1 :], flight.rate_rad_s[0, at + 1 :] @ combined.T + stored(flight)[at:])
    assert np.abs(after - before).max() < 1e-8 * np.linalg.norm(before)


@pytest.mark.thorough
def test_a_wheel_runs_down_by_its_friction() -> None:
    """By ``J h' = −b h``; the body hardly turns, and what it does is in the wheel's own speed."""
    heavy = ("truth.ixx=600.0", "truth.iyy=2000.0", "truth.izz=2400.0")
    coasting = ("duration_s=20", "plan=[]", "vehicle.wheels.1.viscous_friction_n_m_s=2e-4", *heavy)
    flown = simulate.fly(scenario.load("wheels", coasting), [1])
    expected = -150 * np.exp(-2e-4 / 2e-3 * np.maximum(flown.time_s - 0.1, 0))  # nothing acts before the first command
    assert np.abs(flown.turning["wheel_y_rad_s"][0] / expected - 1).max() < 2e-3  # friction is held over 2.5 ms at a time


def test_a_turn_by_wheels_needs_wheels_that_span_it() -> None:
    flat = "vehicle.wheels.2.axis=[0.3, 0.2, 0.0]"
    with pytest.raises(InputError, match=r"cannot drive yaw .* add jets or wheels"):
        simulate.fly(scenario.load("wheels", (flat,)), [1])
    by_wheels = "plan=[{motion='random', axes=['roll'], start_s=0, end_s=5, by_wheels=true}]"
    with pytest.raises(InputError, match="the vehicle has nothing that stores momentum"):
        scenario.load("free-flyer", (by_wheels,))
    one = "vehicle.wheels=[{name='x', axis=[1, 0, 0], spin_inertia_kg_m2=1e-3, locked_in_inertia=true}]"
    with pytest.raises(InputError, match="max_wheel_torque_n_m"):
        scenario.load("free-flyer", (by_wheels, one))
    with pytest.raises(InputError, match="less inertia than the wheels"):
        scenario.load("wheels", ("vehicle.wheels.0.spin_inertia_kg_m2=0.7",))
