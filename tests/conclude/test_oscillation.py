from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array, frozen
from massprop_cli.conclude import judge, oscillation
from massprop_cli.conclude.oscillation import INPUTS, PERIODS, correlations, explained_by, oscillation_test, significance
from massprop_cli.estimate.history import History
from massprop_cli.flow import Analysis
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.actuators import channel_wrench
from massprop_cli.prepare.compensate import Source
from massprop_cli.report import vocabulary
from tests.flown import fly

PERIOD_S = 0.05
PLAN = (
    "duration_s=25.0",
    "plan=["
    + ", ".join(
        f'{{motion="random", axes=["{axis}"], every_cycles=5, max_cycles=4, start_cycle={60 * i}, end_cycle={60 * i + 60}}}'
        for i, axis in enumerate(("roll", "pitch", "yaw", "x", "y", "z"))
    )
    + ', {motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], every_cycles=5, max_cycles=4, start_cycle=360, end_cycle=500}]',
)
RANDOM = (
    "duration_s=40.0",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0.0, end_s=40.0}]',
)
INERTIA, CG, MASS = np.array([0.6, 2.7, 2.4]), np.array([-0.02, 0.025, 0.01]), 22.0


@cache
def rigid() -> Analysis:
    """The flight as it was flown."""
    flight = fly("free-flyer", *PLAN, seeds=(3001,))
    return flow.examine(flight.log(0), VehicleSource(flight.vehicle, "", ""))


def swung(part: float, hertz: float, turning: bool = False, arm: tuple[float, float, float] | None = None) -> Analysis:
    """The flight of a body of which ``part`` hangs on a spring: at its CG, or, ``turning``, about each of its axes.

    With an ``arm`` it hangs there, and turns the body by what it pulls; what the accelerometer feels of it is left out.
    """
    flight = fly("free-flyer", *PLAN, seeds=(3001,))
    log, samples = flight.log(0), rigid().samples
    executed = samples.part(slice(0, len(samples))).executed
    pushed = executed.channels.whole @ channel_wrench(log, rigid().vehicle) / PERIOD_S
    mounting, found = np.array(flight.vehicle.imu.body_from_imu), log
    if turning:
        torque = pushed[:, :3] - np.cross(CG, pushed[:, 3:])
        gained = np.cumsum(_beyond_rigid(torque / INERTIA, part, hertz), axis=0)
        mean = (gained + np.vstack([np.zeros((1, 3)), gained[:-1]])) / 2
        found = replace(log, delta_theta_imu_rad=frozen(log.delta_theta_imu_rad + mean * PERIOD_S @ mounting))
    elif arm is not None:
        pull = MASS * _beyond_rigid(pushed[:, 3:] / MASS, part, hertz, damping=0.3)
        gained = np.cumsum(np.cross(arm, pull) / INERTIA, axis=0)
        mean = (gained + np.vstack([np.zeros((1, 3)), gained[:-1]])) / 2
        found = replace(log, delta_theta_imu_rad=frozen(log.delta_theta_imu_rad + mean * PERIOD_S @ mounting))
    else:
        gained = _beyond_rigid(pushed[:, 3:] / MASS, part, hertz)
        found = replace(log, delta_v_imu_m_s=frozen(log.delta_v_imu_m_s + gained @ mounting))
    return flow.examine(found, VehicleSource(flight.vehicle, "", ""))


def _beyond_rigid(drive: Array, part: float, hertz: float, damping: float = 0.02, steps: int = 40) -> Array:
    """(K, 3) what a spring adds to the increments of a rigid body's speed, which ``drive`` (K, 3) accelerates: m₁ẍ₁ = F + k x + c ẋ."""
    rate, step = 2 * np.pi * hertz, PERIOD_S / steps
    # one step of [away, moving, gained, push], linear in all of them
    pull = np.array([rate**2, 2 * damping * rate, 0.0, 0.0])
    base = (part * pull + [0.0, 0.0, 0.0, 1.0]) / (1 - part)
    one = np.eye(4)
    one[1] -= step * (base + pull)
    one[0] += step * one[1]
    one[2] += step * (base - [0.0, 0.0, 0.0, 1.0])
    cycle = np.linalg.matrix_power(one, steps)
    found, state = np.zeros_like(drive), np.zeros((4, 3))
    for gained, push in zip(found, drive, strict=True):
        state[2], state[3] = 0.0, push
        state = cycle @ state
        gained[:] = state[2]
    return found


def test_every_cycle_of_a_long_phase_counts_once() -> None:
    """Against the sums over all 3,000 at once; the cycles between two blocks had counted twice, 7.56 for 6.54."""
    rng = np.random.default_rng(0)
    whole, rest = (rng.random((3000, 6)) < 0.1) * rng.standard_normal((3000, 6)), rng.standard_normal((3000, 6))

    class Flown:
        def part(self, cycles: slice) -> SimpleNamespace:
            channels = SimpleNamespace(whole=whole[cycles], wrench=np.eye(6))
            return SimpleNamespace(executed=SimpleNamespace(channels=channels, duration_s=np.full(cycles.stop - cycles.start, 0.1)))

    history = SimpleNamespace(reference=SimpleNamespace(cg=np.zeros(3)), cycles=slice(0, 3000), normalised=rest)
    one = correlations(cast(History, history), cast(Source, Flown()))
    for lag in (0, 1, 7, 500):
        pushed = whole[: 3000 - lag]
        for answer, left in zip(INPUTS, one.residual, strict=True):
            np.testing.assert_allclose(left[:, lag], (rest[lag:] * pushed[:, answer]).sum(0), atol=1e-9)
        np.testing.assert_allclose(one.command[:, lag], (whole[lag:] * pushed).sum(0), atol=1e-9)
    np.testing.assert_allclose(one.scatter, (rest**2).mean(0))
    assert one.cycle_s == pytest.approx(0.1)


def test_sums_of_products_explain_what_the_oscillators_themselves_do() -> None:
    found = rigid()
    history, one = found.settled[0], correlations(found.settled[0], found.samples)
    channels = found.samples.part(history.cycles).executed.channels
    pushed = channels.whole @ channels.wrench
    assert history.reference is not None
    pushed[:, :3] -= np.cross(history.reference.cg, pushed[:, 3:])
    left = np.nan_to_num(history.normalised)
    for period in (4.0, 16.0, 45.25):
        # a push goes on beyond the end: its oscillators' squares count whole
        beyond = np.vstack([pushed, np.zeros((int(3 * period) + 1, 6))])
        square = np.zeros((len(INPUTS), 6))
        steps = np.arange(1, int(3 * period) + 1)
        answers = np.exp(-steps / period) * np.array([np.cos(2 * np.pi * steps / period), np.sin(2 * np.pi * steps / period)])
        for axis, driving in np.ndindex(6, 6):
            rows = np.column_stack([np.convolve(beyond[:, driving], np.append(0.0, answer))[: len(beyond)] for answer in answers])
            along = rows[: len(left)].T @ left[:, axis]
            square[INPUTS[:, axis] == driving, axis] = along @ np.linalg.solve(rows.T @ rows, along)
        expected = square.reshape(-1, 2, 3).sum(2) / (left**2).sum(0).reshape(2, 3).mean(1) * np.isfinite(history.normalised).all(1).sum()
        np.testing.assert_allclose(explained_by(one, period)[..., 0], expected, rtol=1e-6)
        np.testing.assert_array_equal(explained_by(one, period)[..., 1], 6)


def test_noise_follows_no_oscillator_by_more_than_chance() -> None:
    found = rigid()
    history, rng = found.settled[0], np.random.default_rng(1)
    periods, drawn = PERIODS[:13], []
    for _ in range(60):
        one = correlations(replace(history, normalised=rng.standard_normal(history.normalised.shape)), found.samples)
        drawn.append([explained_by(one, float(period))[..., 0] for period in periods])
    # chi-square of six degrees of freedom: mean 6, variance 12; of 60 draws of two sensors. What rings on beyond the end explains nothing
    mean = np.mean(drawn, axis=(0, 3))
    assert mean[:5] == pytest.approx(np.full((5, len(INPUTS)), 6.0), abs=4 * np.sqrt(12 / 120))
    assert (mean < 6 + 4 * np.sqrt(12 / 120)).all()
    assert significance(one, periods, np.ones(2))[0].max() < 3.5


def test_a_mass_beside_sloshing_fuel_is_not_called_converged() -> None:
    found = swung(0.1, 0.3).conclusions[0].estimates
    assert found["mass"].verdict == "not_converged"
    reason = found["mass"].reason
    assert reason.code == "oscillation"
    assert dict(reason.data)["period_s"] == pytest.approx(1 / 0.3, rel=0.45)
    assert vocabulary.remedy("mass", "not_converged", "", reason.code).startswith("fix or drain")
    # rates tell inertia by themselves
    assert all(found[name].verdict == "converged" for name in ("ixx", "iyy", "izz"))


@pytest.mark.thorough
def test_fuel_that_sloshes_within_few_cycles_is_in_the_mass_s_sigma() -> None:
    """At 2 Hz the specific force follows the commands of the cycles before."""
    mass = swung(0.1, 2.0).conclusions[0].estimates["mass"]
    assert mass.verdict != "converged"
    assert mass.value is not None
    assert mass.sigma is not None
    assert abs(mass.value - MASS) < 2 * mass.sigma < 0.1 * MASS


def test_the_log_looks_good_without_this_test_and_the_mass_is_ten_sigma_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judge, "oscillation_test", lambda *_: {})
    found = swung(0.1, 0.3)
    mass = found.conclusions[0].estimates["mass"]
    assert found.notices == ()
    assert mass.verdict == "converged"
    assert mass.value is not None
    assert mass.sigma is not None
    assert (mass.value - MASS) / mass.sigma < -10
    assert mass.value < 0.9 * MASS


@pytest.mark.thorough
def test_an_inertia_beside_a_part_that_swings_within_few_cycles_holds_with_its_sigma() -> None:
    found = swung(0.1, 2.0, turning=True).conclusions[0].estimates
    for name, true in zip(("ixx", "iyy", "izz"), INERTIA, strict=True):
        one = found[name]
        assert one.value is not None
        assert one.sigma is not None
        assert abs(one.value - true) < 2 * one.sigma


@pytest.mark.thorough
def test_no_inertia_beside_a_flexible_part_is_called_converged() -> None:
    found = swung(0.1, 0.8, turning=True).conclusions[0].estimates
    assert all(found[name].verdict != "converged" for name in ("ixx", "iyy", "izz"))


@pytest.mark.thorough
@pytest.mark.seeds
def test_what_swings_away_from_the_cg_leaves_nothing_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pushes along an axis turn the body about others: tested against torques alone that showed nothing."""
    found = swung(0.05, 0.4, arm=(0.0, 0.02, 0.06)).conclusions[0].estimates
    assert all(found[name].verdict != "converged" for name in QUANTITIES)
    assert {found[name].reason.code for name in ("cg_z", "mass")} == {"oscillation"}
    monkeypatch.setattr(oscillation, "INPUTS", INPUTS[:1])
    before = swung(0.05, 0.4, arm=(0.0, 0.02, 0.06)).conclusions[0].estimates["cg_z"]
    assert before.verdict == "converged"
    assert before.value is not None
    assert before.sigma is not None
    assert (before.value - CG[2]) / before.sigma < -30


def test_a_rigid_body_shows_no_swing() -> None:
    assert all(rigid().conclusions[0].estimates[name].verdict == "converged" for name in QUANTITIES)


def test_a_wave_in_the_bias_within_the_sigmas_leaves_the_inertia_its_verdict() -> None:
    """A bias that swings every 8 s correlates with delayed commands at eleven sigma, and moves the inertia by less than one."""
    flight = fly("free-flyer", *RANDOM, "vehicle.imu.accel_noise_m_s2=0.05", seeds=(3002,))
    log = flight.log(0)
    wave = 0.04 * np.sin(2 * np.pi * log.time_s / 8)[:, None] * np.array([1.0, 0.5, -0.7])
    other = replace(log, delta_v_imu_m_s=frozen(log.delta_v_imu_m_s + log.interval_s[:, None] * wave))
    found = flow.examine(other, VehicleSource(flight.vehicle, "", ""))
    noise, final = found.settled[0].sigmas[-1], found.conclusions[0].sigmas
    tested = found.settled[0], found.samples, cast(Resolved, found.vehicle), found.stated
    assert {"ixx", "iyy", "izz"} < oscillation_test(*tested, np.ones(10)).keys()
    assert not {"ixx", "iyy", "izz"} & oscillation_test(*tested, final / noise).keys()
    for name, true in zip(("ixx", "iyy", "izz"), INERTIA, strict=True):
        one = found.conclusions[0].estimates[name]
        assert one.verdict == "converged"
        assert one.value is not None
        assert one.sigma is not None
        assert abs(one.value - true) < 2 * one.sigma
