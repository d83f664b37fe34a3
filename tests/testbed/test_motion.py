"""The simulator's motion against conservation laws, closed forms and another integration of the same equations."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.testbed.environment.bearing import Bearing, OnBearing
from massprop_cli.testbed.motion import (
    Bodies,
    CycleMotion,
    Dynamics,
    Wrench,
    compose,
    compose_all,
    quaternions,
    rotation_vectors,
    to_world,
    vertical,
)

PERIOD, BINS = 0.05, 20
WIDTH = PERIOD / BINS
FINE = 80
"""Bins where a test multiplies bin means itself."""
INERTIA = np.array([[0.62, 0.04, -0.07], [0.04, 2.8, 0.11], [-0.07, 0.11, 2.5]])


def bodies(inertia: Array = INERTIA, cg: tuple[float, float, float] = (0.0, 0.0, 0.0), mass: float = 22.0) -> Bodies:
    return Bodies(inertia[..., None], np.array(cg)[:, None], np.array([mass]))


def coast(
    dynamics: Dynamics, rate: Array, cycles: int, wrench: Array | None = None, bins: int = BINS
) -> tuple[Array, Array, list[CycleMotion]]:
    """Rates (cycles + 1, 3) and attitudes (cycles + 1, 4) under a constant wrench (6,)."""
    width = PERIOD / bins
    constant = np.zeros(6) if wrench is None else wrench
    mean = np.tile(constant[:, None, None], (1, 1, bins))
    attitude, rates, attitudes, motions = np.array([[1.0], [0], [0], [0]]), [rate], [np.array([1.0, 0, 0, 0])], []
    for _ in range(cycles):
        motion = dynamics.advance(rates[-1][:, None], vertical(attitude), Wrench(mean, mean * width / 2), width)
        attitude = compose(attitude, compose_all(quaternions(rotation_vectors(motion, width))))
        rates.append(motion.rate_end[:, 0])
        attitudes.append(attitude[:, 0])
        motions.append(motion)
    return np.array(rates), np.array(attitudes), motions


def test_a_tumbling_free_body_keeps_angular_momentum_and_energy() -> None:
    rates, attitudes, _ = coast(Dynamics(bodies()), np.array([1.2, 0.9, -0.7]), 400)
    momentum = to_world(attitudes.T, INERTIA @ rates.T)
    energy = np.einsum("ki,ij,kj->k", rates, INERTIA, rates) / 2
    assert np.abs(momentum - momentum[:, :1]).max() < 2e-7 * np.linalg.norm(momentum[:, 0])
    assert np.abs(energy / energy[0] - 1).max() < 2e-7
    assert np.abs(rates - rates[0]).max() > 0.5  # it does tumble


def test_half_the_bin_width_leaves_a_sixteenth_of_the_error_or_less() -> None:
    def end(bins: int) -> Array:
        rates, _, _ = coast(Dynamics(bodies()), np.array([1.2, 0.9, -0.7]), 100, np.array([0.3, -0.5, 0.4, 0, 0, 0]), bins)
        last: Array = rates[-1]
        return last

    exact = end(160)
    errors = [float(np.abs(end(bins) - exact).max()) for bins in (5, 10, 20)]
    assert errors[0] > 12 * errors[1] > 144 * errors[2]
    assert errors[2] < 1e-8


def test_constant_torque_about_a_principal_axis_turns_as_the_closed_form() -> None:
    inertia = np.diag([0.5, 2.0, 2.2])
    rates, attitudes, _ = coast(Dynamics(bodies(inertia)), np.zeros(3), 60, np.array([0.2, 0, 0, 0, 0, 0]))
    time = PERIOD * np.arange(61)
    assert np.allclose(rates[:, 0], 0.4 * time, rtol=0, atol=1e-12)
    assert np.allclose(2 * np.arctan2(attitudes[:, 1], attitudes[:, 0]), 0.2 * time**2, rtol=0, atol=1e-11)
    assert np.abs(rates[:, 1:]).max() == 0


def test_bin_means_of_a_turn_by_more_than_a_radian_about_one_axis_are_those_of_its_rate() -> None:
    """Where nothing but the first iteration moves a rate, it counts in every bin: 30 rad/s through 0.05 s, 0.1 N m about 0.62 kg m²."""
    wrench = np.zeros((6, 1, BINS))
    wrench[0] = 0.1
    body = Dynamics(bodies(np.diag([0.62, 2.8, 2.5])))
    motion = body.advance(np.array([[30.0], [0.0], [0.0]]), np.zeros((3, 1)), Wrench(wrench, wrench * WIDTH / 2), WIDTH)
    np.testing.assert_allclose(motion.rate[0, 0], 30 + 0.1 / 0.62 * WIDTH * (np.arange(BINS) + 0.5), rtol=1e-12)
    np.testing.assert_allclose(motion.ends[0, 0], 30 + 0.1 / 0.62 * WIDTH * np.arange(1, BINS + 1), rtol=1e-12)


def test_a_divert_through_the_cg_turns_nothing_and_pushes_by_force_over_mass() -> None:
    cg = (0.02, -0.03, 0.01)
    force = np.array([1.0, -2.0, 0.5])
    dynamics = Dynamics(bodies(cg=cg, mass=8.0))
    rates, _, motions = coast(dynamics, np.zeros(3), 20, np.concatenate([np.cross(cg, force), force]))
    assert np.abs(rates).max() < 1e-15
    felt = dynamics.specific_force(motions[-1], np.tile(force[:, None, None], (1, 1, BINS)), np.array([0.1, 0.2, -0.1]), WIDTH)
    assert np.allclose(felt, force[:, None, None] / 8.0, rtol=0, atol=1e-14)


def test_a_torque_free_axisymmetric_body_precesses_at_the_known_rate() -> None:
    inertia = np.diag([2.0, 2.0, 3.0])
    spin, cone = 1.5, 0.4
    rates, _, _ = coast(Dynamics(bodies(inertia)), np.array([cone, 0.0, spin]), 200)
    phase = (3.0 - 2.0) / 2.0 * spin * PERIOD * np.arange(201)
    expected = np.stack([cone * np.cos(phase), cone * np.sin(phase), np.full(201, spin)], 1)
    assert np.abs(rates - expected).max() < 1e-8


BEARING = Bearing(np.array([0.01, -0.02, 0.03]), 5.0, 9.80665)


def hanging() -> OnBearing:
    """Ten millimetres off the bearing, fast enough for every term to matter."""
    return OnBearing(bodies(cg=(0.016, -0.013, 0.021), mass=25.0), BEARING)


def test_a_body_swinging_on_the_bearing_keeps_its_energy() -> None:
    dynamics = hanging()
    rates, attitudes, _ = coast(dynamics, np.array([0.8, -0.5, 0.6]), 200)
    arm = dynamics.arm[:, 0]
    up = vertical(attitudes.T).T
    # total horizontal momentum is nought, so the base moves against the body's CG; the bearing stays level
    swing = np.cross(rates, arm)
    vertical_part = np.einsum("ki,ki->k", swing, up)
    level = np.einsum("ki,ki->k", swing, swing) - vertical_part**2
    kinetic = np.einsum("ki,ij,kj->k", rates, INERTIA, rates) / 2 + 20.0 * vertical_part**2 / 2 + 20.0 * 5.0 / 25.0 * level / 2
    potential = 20.0 * BEARING.gravity * (up @ arm)
    energy = kinetic + potential
    assert np.ptp(potential) > 0.1 * kinetic.max()
    assert np.abs(energy - energy[0]).max() < 3e-7 * kinetic.max()


def test_angular_momentum_about_the_vertical_through_the_system_is_kept_on_the_bearing() -> None:
    dynamics = hanging()
    rates, attitudes, _ = coast(dynamics, np.array([0.8, -0.5, 0.6]), 200)
    arm = dynamics.arm[:, 0]
    world_arm = to_world(attitudes.T, np.tile(arm[:, None], (1, len(rates))))
    spin = to_world(attitudes.T, INERTIA @ rates.T)
    velocity = to_world(attitudes.T, np.cross(rates, arm).T)
    # two masses about their common CG: reduced mass times relative position and velocity
    about = spin[2] + 20.0 * 5.0 / 25.0 * (world_arm[0] * velocity[1] - world_arm[1] * velocity[0])
    assert np.abs(about - about[0]).max() < 3e-7 * np.abs(about[0])


def test_the_bearings_vertical_reaction_is_the_weight_and_the_inertial_part() -> None:
    dynamics = hanging()
    push = np.array([0.0, 0, 0, 1.5, -1.0, 0.7])
    rates, attitudes, motions = coast(dynamics, np.array([0.8, -0.5, 0.6]), 40, push, FINE)
    force = np.tile(push[3:, None, None], (1, 1, FINE))
    arm = dynamics.arm[:, 0]
    impulse = 0.0
    pushed = 0.0
    for motion in motions:
        felt = dynamics.specific_force(motion, force, dynamics.bodies.cg[:, 0], PERIOD / FINE)
        impulse += PERIOD / FINE * float(((20.0 * felt - force) * motion.fixed).sum())
        pushed += PERIOD / FINE * float((force * motion.fixed).sum())
    climb = np.einsum("ki,ki->k", np.cross(rates, arm), vertical(attitudes.T).T)
    expected = 20.0 * BEARING.gravity * 40 * PERIOD + 20.0 * (climb[-1] - climb[0]) - pushed
    assert impulse == pytest.approx(expected, rel=1e-7)
    assert abs(20.0 * (climb[-1] - climb[0])) > 1e3 * 1e-7 * expected  # what is tested is well above the tolerance


def test_level_momentum_of_body_and_base_changes_by_the_jets_alone() -> None:
    dynamics = hanging()
    push = np.array([0.1, -0.2, 0.1, 1.5, -1.0, 0.7])
    _, attitudes, motions = coast(dynamics, np.array([0.8, -0.5, 0.6]), 40, push, FINE)
    force = np.tile(push[3:, None, None], (1, 1, FINE))
    gained, given = np.zeros(3), np.zeros(3)
    for motion, start in zip(motions, attitudes[:-1], strict=True):
        turn = quaternions(rotation_vectors(motion, PERIOD / FINE))
        half_turn = quaternions(rotation_vectors(motion, PERIOD / FINE) / 2)
        own = dynamics.specific_force(motion, force, dynamics.bodies.cg[:, 0], PERIOD / FINE)
        base = dynamics.centre_force(motion, force, PERIOD / FINE)
        attitude = np.tile(start[:, None, None], (1, 1, 1))
        for bin_ in range(FINE):
            half = compose(attitude[..., 0], half_turn[..., bin_])
            gained += PERIOD / FINE * to_world(half, 20.0 * own[..., bin_] + 5.0 * base[..., bin_])[:, 0]
            given += PERIOD / FINE * to_world(half, force[..., bin_])[:, 0]
            attitude = compose(attitude[..., 0], turn[..., bin_])[..., None]
    assert np.allclose(gained[:2], given[:2], rtol=0, atol=1e-5 * np.abs(given).max())


def test_a_members_bytes_do_not_depend_on_who_flies_beside_it() -> None:
    rng = np.random.default_rng(5)
    rate = rng.normal(0, 1.0, (3, 7))
    mean = rng.normal(0, 0.5, (6, 7, BINS))
    many = Bodies(np.repeat(INERTIA[..., None], 7, -1), np.full((3, 7), 0.01), np.full(7, 25.0))
    up = vertical(quaternions(rng.normal(0, 0.3, (3, 7))))
    together = OnBearing(many, BEARING).advance(rate, up, Wrench(mean, mean * WIDTH / 2), WIDTH)
    for member in range(7):
        one = slice(member, member + 1)
        single = Bodies(many.inertia[..., one], many.cg[:, one], many.mass[one])
        alone = OnBearing(single, BEARING).advance(rate[:, one], up[:, one], Wrench(mean[:, one], mean[:, one] * WIDTH / 2), WIDTH)
        assert np.array_equal(alone.rate, together.rate[:, one])
        assert np.array_equal(alone.rate_end, together.rate_end[:, one])
