"""Motion on a table against closed forms, and what its accelerometer feels of a slope."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.environment.table import OnTable, TablePlant
from massprop_cli.testbed.motion import Bodies, Wrench
from massprop_cli.testbed.scenario import ScenarioSource

G, PERIOD, BINS = 9.80665, 0.05, 20
WIDTH = PERIOD / BINS
INERTIA = np.array([[0.62, 0.04, -0.07], [0.04, 2.8, 0.11], [-0.07, 0.11, 2.5]])
CG, MASS = np.array([0.03, -0.02, 0.4]), 22.0


def on_table(held: tuple[float, float] = (0.0, 0.0)) -> OnTable:
    return OnTable(Bodies(INERTIA[..., None], CG[:, None], np.array([MASS])), TablePlant(G, np.array([*held, 0.0])))


def constant(wrench: list[float]) -> Wrench:
    mean = np.tile(np.array(wrench)[:, None, None], (1, 1, BINS))
    return Wrench(mean, mean * WIDTH / 2)


def test_a_body_on_a_table_yaws_by_the_moment_about_its_cg_and_by_nothing_else() -> None:
    wrench = [3.0, -2.0, 0.5, 1.2, -0.7, 9.0]
    motion = on_table().advance(np.array([[0.0], [0.0], [0.8]]), np.zeros((3, 1)), constant(wrench), WIDTH)
    moment = 0.5 - (CG[0] * -0.7 - CG[1] * 1.2)
    np.testing.assert_allclose(motion.rate_end[:, 0], [0.0, 0.0, 0.8 + PERIOD * moment / 2.5], rtol=1e-12)
    np.testing.assert_allclose(motion.rate_dot[:2], 0.0, atol=0.0)


def test_the_accelerometer_feels_the_push_along_the_table_and_gravity_across_it() -> None:
    dynamics, spin, push = on_table(), 0.8, np.array([1.2, -0.7])
    wrench = constant([0.0, 0.0, CG[0] * push[1] - CG[1] * push[0], *push, 9.0])  # no moment about the CG
    motion = dynamics.advance(np.array([[0.0], [0.0], [spin]]), np.zeros((3, 1)), wrench, WIDTH)
    position = np.array([0.2, 0.1, -0.3])
    felt = dynamics.specific_force(motion, wrench.mean[3:], position, WIDTH)[:, 0]
    expected = np.append(push / MASS - spin**2 * (position - CG)[:2], G)
    np.testing.assert_allclose(felt, np.tile(expected[:, None], BINS), rtol=1e-12)


def test_what_is_held_of_the_slope_stands_still_in_the_world() -> None:
    dynamics, spin = on_table((0.05, -0.02)), 1.5
    angle = 0.7
    attitude = np.array([[np.cos(angle / 2)], [0.0], [0.0], [np.sin(angle / 2)]])
    motion = dynamics.advance(np.array([[0.0], [0.0], [spin]]), dynamics.fixed(attitude), constant([0.0] * 6), WIDTH)
    felt = dynamics.specific_force(motion, np.zeros((3, 1, BINS)), CG, WIDTH)[:, 0]
    turned = angle + spin * WIDTH * (np.arange(BINS) + 0.5)
    world = np.array([np.cos(turned) * felt[0] - np.sin(turned) * felt[1], np.sin(turned) * felt[0] + np.cos(turned) * felt[1]])
    np.testing.assert_allclose(world, np.tile([[0.05], [-0.02]], BINS), atol=1e-7)


SHORT = ("duration_s=12", 'plan=[{motion="random", axes=["x", "y", "yaw"], every_cycles=5, max_cycles=4, start_s=0, end_s=10}]')


def flown(hold: float) -> Array:
    source = scenario.load("planar", SHORT)
    disturbance = source.scenario.disturbance.model_copy(update={"table_hold": hold})
    changed = source.scenario.model_copy(update={"disturbance": disturbance})
    felt: Array = simulate.fly(ScenarioSource(changed, source.source), [1]).delta_v_m_s[0] / PERIOD
    return felt


def test_a_vehicle_that_slides_freely_feels_no_slope_and_one_that_is_held_feels_gravity_times_it() -> None:
    felt = flown(1.0) - flown(0.0)
    tilt = scenario.load("planar").scenario.disturbance.table_tilt_rad
    size = np.linalg.norm(felt, axis=1)
    np.testing.assert_allclose(size, G * np.hypot(*tilt), rtol=1e-3)  # a cycle's mean of what turns is a little less
    np.testing.assert_allclose(felt[0], G * np.array([-tilt[1], tilt[0], 0.0]), rtol=0.03, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"initial": {"rate_rad_s": [0.1, 0.0, 0.0]}}, "turns about Z alone"),
        (
            {"vehicle": {"environment": {"kind": "planar", "initial_attitude_wxyz": [0.0, 1.0, 0.0, 0.0]}}},
            "on the table; give a rotation about Z",
        ),
    ],
)
def test_a_motion_out_of_the_table_is_refused(change: dict[str, dict[str, object]], said: str) -> None:
    stated = scenario.load("planar").scenario.model_dump(by_alias=True)
    for section, values in change.items():
        stated[section] = {**stated[section], **values}
    with pytest.raises((InputError, ValueError), match=said):
        scenario.Scenario.model_validate(stated)
