"""When within a record the torque on wheels or rotors steps, by independent simulators whose torques act after any delay."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline, interp1d

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import IntArray
from massprop_cli.flow import Analysis
from massprop_cli.inputs.tablefile import at_hand
from massprop_cli.inputs.telemetry import read
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anyimu, anypedestal, anyrotors

PERIOD_S = 0.05


def estimated(seed: int, part: float, jets: bool = False, noise: float = 1.0, records: int = 1) -> tuple[Analysis, float]:
    """A vehicle whose wheels' torques step after so much of a cycle of some records; the largest deviation of a value, in sigmas."""
    rng, imu = np.random.default_rng(seed), anyimu.Imu(measures="increment", rate_hz=records / PERIOD_S, gyro_noise=1e-4, accel_noise=3e-3)
    own = anyimu.wheeled(rng, anyimu.bodies(rng, 1), jets=jets)
    delay_s = (2 + part) * PERIOD_S
    flown = anyimu.fly(rng, own, imu, PERIOD_S, 20.0, delay_s, noise=noise)
    used = anyimu.vehicle_of(own, 0, flown, imu, PERIOD_S, delay_s, stated=True, wheels="speed")
    answer = flow.examine(anyimu.log_of(flown, 0, imu, used), VehicleSource(used, "", ""))
    told = answer.conclusions[0].estimates
    off = [
        (told[name].value - true) / told[name].sigma
        for name, true in zip(QUANTITIES, anyimu.truth_of(own, 0), strict=True)
        if told[name].sigma
    ]
    return answer, float(np.abs(off).max())


@pytest.mark.parametrize(
    ("part", "jets"),
    [(0.3, False), (0.5, False), *(pytest.param(*one, marks=pytest.mark.thorough) for one in ((0.8, False), (0.25, True), (0.6, True)))],
)
def test_it_is_found_and_values_are_within_their_sigmas(part: float, jets: bool) -> None:
    """With speeds that are linear from end to end of records the log was contradicted, or the gyro's noise widened."""
    answer, off = estimated(3, part, jets)
    assert [notice.code for notice in answer.notices] == ["noise-estimated"]
    for wheel in answer.vehicle.wheels:
        assert wheel.torque_steps_s == pytest.approx(part * PERIOD_S, abs=0.02 * PERIOD_S)
    assert {answer.conclusions[0].estimates[name].verdict for name in QUANTITIES[:6]} == {"converged"}
    assert off < 4


@pytest.mark.thorough
def test_nothing_is_found_where_it_steps_as_records_end() -> None:
    answer, off = estimated(4, 0.0)
    assert not answer.notices
    assert {wheel.torque_steps_s for wheel in answer.vehicle.wheels} == {None}
    assert off < 4


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_of_two_records_in_a_cycle_one_bends(noise: float) -> None:
    """It was looked for in logs of one record a cycle alone, and six of seven clean logs of two had a misfit."""
    answer, off = estimated(3, 0.75, noise=noise, records=2)
    assert [notice.code for notice in answer.notices] == ["noise-estimated"]
    assert off < (4 if noise else 0.1)
    if not noise:  # beside it, a second time explains nearly as much
        assert [wheel.torque_steps_s for wheel in answer.vehicle.wheels] == pytest.approx([0.25 * PERIOD_S] * 3, abs=1e-4)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("late", [0, 3, pytest.param(5, marks=pytest.mark.thorough)])
def test_rotors_that_are_told_within_a_cycle_give_values_within_their_sigmas(late: int) -> None:
    """With speeds that change evenly from cycle to cycle inertia was up to 0.4 % too small, 15 of its sigmas, and converged."""
    rng, period_s = np.random.default_rng([7, late]), 0.005
    own = anyrotors.multicopters(rng, 1)
    own.noise[:] = 1e-3, 2e-2
    flown = anyrotors.fly(rng, own, period_s, 1200, measured=True, late=late)
    used = anyrotors.vehicle_of(own, 0, flown)
    answer = flow.examine(anypedestal.log_of(rng, own, 0, flown, used), VehicleSource(used, "", ""))
    assert [notice.code for notice in answer.notices] == ["noise-estimated"] * (late > 0)
    assert {rotor.torque_steps_s is None for rotor in answer.vehicle.rotors} == {late == 0}
    (conclusion,) = answer.conclusions
    assert np.abs((conclusion.values - own.ten[0]) / conclusion.sigmas).max() < 4
    assert {one.verdict for one in conclusion.estimates.values()} == {"converged"}


SPINS = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]])
GIMBALS = np.array([[0, 1.0, 1.0], [0, 1.0, -2.0], [1.0, 0, 2.0], [1.0, 0, -1.0]])
INERTIA = np.array([[9.0, 0.3, -0.5], [0.3, 11.0, 0.4], [-0.5, 0.4, 7.0]])


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("course", ["bends 0.4 of a record later", "is smooth", "is smooth, two records a cycle", "bends as records end"])
def test_gimbals_that_turn_within_a_record_give_values_within_their_sigmas(course: str) -> None:
    """A body that began at rest, with gyros whose momenta cancel: I w = -sum of h s(gimbal), in closed form.

    With angles straight from record to record eight of eight such logs were refused.
    """
    rng, record_s, count, fine = np.random.default_rng(5), 0.1, 400, 60
    part, bends = 0.4 if "later" in course else 0.0, np.cumsum(rng.normal(0, 0.04, (count + 2, 4)), 0)
    bends -= bends[0]
    at = np.arange(count * fine + 1) / fine - part
    angle = CubicSpline(np.arange(count + 2), bends)(at) if "smooth" in course else interp1d(np.arange(-1, count + 1), bends, axis=0)(at)
    angle = angle - angle[0]
    across = np.cross(GIMBALS / np.linalg.norm(GIMBALS, axis=1)[:, None], SPINS)
    held = 5.0 * np.einsum("kn,ni->ki", np.cos(angle), SPINS) + 5.0 * np.einsum("kn,ni->ki", np.sin(angle), across)
    rate = -held @ np.linalg.inv(INERTIA)
    turned = simpson(rate[: count * fine + 1].reshape(-1, 3)[index(count, fine)], dx=record_s / fine, axis=1)
    gyros = [
        {"name": f"c{n}", "gimbal_axis": GIMBALS[n].tolist(), "spin_axis": SPINS[n].tolist(), "h_n_m_s": 5.0, "locked_in_inertia": True}
        for n in range(4)
    ]
    noise = 5e-5
    used = Vehicle.model_validate(
        {
            "schema": 1,
            "cycle": {"period_s": (2 if "two" in course else 1) * record_s},
            "imu": {"gyro_noise_rad_s": noise, "accel_noise_m_s2": 0.1},
            "control_moment_gyros": gyros,
        }
    )
    columns = {"time_s": record_s * np.arange(1, count + 1)}
    columns |= {f"delta_theta_{a}_rad": turned[:, i] + noise * record_s * rng.normal(size=count) for i, a in enumerate("xyz")}
    columns |= {f"cmg_c{n}_gimbal_rad": angle[fine::fine, n] for n in range(4)}
    answer = flow.examine(read(at_hand(Path("log.csv"), columns), used), VehicleSource(used, "", ""))
    assert [notice.code for notice in answer.notices] == ["noise-estimated"] * ("records end" not in course)
    assert {gyro.gimbal_smooth for gyro in answer.vehicle.control_moment_gyros} == {"smooth" in course}
    told = answer.conclusions[0]
    off = (told.values[:6] - INERTIA[np.triu_indices(3)]) / told.sigmas[:6]
    assert np.abs(off).max() < 4
    assert {told.estimates[name].verdict for name in QUANTITIES[:6]} == {"converged"}


def index(count: int, fine: int) -> IntArray:
    """(count, fine + 1) the samples of each record, both ends among them."""
    found: IntArray = np.arange(count)[:, None] * fine + np.arange(fine + 1)
    return found
