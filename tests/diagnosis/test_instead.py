"""What a single cause may stand for is looked for too, a delay of cycles or another body; and fits that come to no number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import frozen
from massprop_cli.base.rigidbody import rotation
from massprop_cli.diagnosis.comparison import _LeastSquares
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.kernel import kernel
from tests import faulty
from tests.diagnosis.test_handed import NOISE, reduced
from tests.flown import fly

NOISY = ("duration_s = 25.0", "vehicle.imu.gyro_noise_rad_s = 1e-3", "vehicle.imu.accel_noise_m_s2 = 0.2")


def segment(axes: str, start: int, end: int, more: str = "") -> str:
    named = ", ".join(f'"{axis}"' for axis in axes.split())
    return f'{{motion = "random", axes = [{named}], every_cycles = 5, max_cycles = 4, {more}start_cycle = {start}, end_cycle = {end}}}'


EACH_THEN_ALL = ", ".join(
    [
        *(segment(axis, 60 * i, 60 * i + 60) for i, axis in enumerate(("roll", "pitch", "yaw"))),
        '{motion = "hold", start_cycle = 180, end_cycle = 370}',
        *(segment(axis, 220 + 50 * i, 270 + 50 * i) for i, axis in enumerate("xyz")),
        segment("roll pitch yaw", 370, 500, "closed_loop = true, "),
        segment("x y z", 370, 500),
    ]
)


@pytest.mark.seeds
@pytest.mark.thorough
def test_of_a_noisy_log_a_delay_of_cycles_is_no_turned_gyro() -> None:
    """Beside a torque that nobody stated a gyro that is mounted the other way round leaves little more; the delay alone leaves nothing."""
    flown = fly("free-flyer", *NOISY, f"plan = [{EACH_THEN_ALL}]", seeds=(1052,))
    found = faulty.examined(flown.log(0), faulty.stated(flown.vehicle, "cycle.command_delay_cycles=4.0"))
    assert [notice.code for notice in found.notices if notice.code != "unphysical-inertia"] == ["delay-mismatch"]


JOINING = "docked={ixx=0.072, iyy=0.48, izz=0.44, mass=5.0, cg_x=-0.0015, cg_y=0.001, cg_z=-0.0025}"
"""A fifth of the vehicle, nearly balanced on its bearing."""


@pytest.mark.seeds
@pytest.mark.thorough
def test_an_object_that_docks_is_no_fuel_that_burns() -> None:
    """A body that changes all along the log leaves little more of it than one that changes at once; two bodies leave nothing."""
    event = 'events=[{kind="dock", cycle=280, motion="rates_kept"}]'
    flown = fly("testbed", JOINING, event, seeds=(1,))
    unaware = flown.vehicle.model_copy(update={"phases": (), "docking": None})
    found = faulty.examined(flown.log(0), unaware)
    (said,) = [notice for notice in found.notices if notice.code != "unphysical-inertia"]
    assert said.code == "mass-change"
    assert float(said.message.split("suddenly at ")[1].split(" s")[0]) == pytest.approx(280 * 0.05, abs=0.5)


@pytest.mark.skipif(kernel().library is None, reason="no compiled kernel was built")
def test_a_fit_that_comes_to_no_number_leads_nowhere_and_refuses_nothing() -> None:
    model, free = reduced("free")
    rows = _LeastSquares.of_all(model, free, NOISE, [Hypothesis("", (), np.eye(len(model.stated)))])
    x = model.stated[None].copy()
    x[0, :10] = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.05]
    x[0, model.place("gyro_scale")] = 800.0  # whose exponential is no number
    moves = np.eye(x.shape[1], 10)[None]
    found = rows.packed.fitted(x, moves, np.ones(10), (1e-3, 100.0, 8))
    np.testing.assert_array_equal(found.x, x)
    assert not np.isfinite(found.spread).all()


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("raised_m", [0.0, 0.2])
def test_on_a_table_it_does_not_matter_how_high_jets_are(raised_m: float) -> None:
    """They turn the vehicle about Z alone; an accelerometer's bias of 0.12 degrees of weight is named as one."""
    flown = fly("planar")
    places = [(*jet.position_m[:2], jet.position_m[2] + raised_m) for jet in flown.vehicle.jets]
    used = faulty.stated(flown.vehicle, *(f"jets.{i}.position_m={list(place)}" for i, place in enumerate(places)))
    log = flown.log(0)
    assert not [notice.code for notice in faulty.examined(log, used).notices]
    biased = log.delta_v_imu_m_s + log.interval_s[:, None] * np.array([0.02, -0.015, 0.0])
    found = faulty.examined(replace(log, delta_v_imu_m_s=frozen(biased)), used)
    assert {fault.notice.code for fault in found.faults} == {"accel-bias"}


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("raised_n", [0.0, 0.3])
def test_on_a_table_it_does_not_matter_how_hard_jets_push_up(raised_n: float) -> None:
    """The table takes it up; an IMU that leans feels a part of the weight along X and Y, and is named as one."""
    flown = fly("planar")
    forces = [(*jet.force_n[:2], raised_n) for jet in flown.vehicle.jets]
    used = faulty.stated(flown.vehicle, *(f"jets.{i}.force_n={list(force)}" for i, force in enumerate(forces)))
    log = flown.log(0)
    assert not [notice.code for notice in faulty.examined(log, used).notices]
    leans = rotation(np.radians([1.2, -0.8, 0.0]))
    turned = replace(log, delta_theta_imu_rad=frozen(log.delta_theta_imu_rad @ leans), delta_v_imu_m_s=frozen(log.delta_v_imu_m_s @ leans))
    found = faulty.examined(turned, used)
    (fault,) = found.faults
    assert fault.notice.code == "imu-mounting"
    assert "1.4" in fault.notice.message.split("degrees")[0]
