"""What is counted as noise must be white and normal: what swings, and commands that were not executed, are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.conclude import estimated, judge, whiteness
from massprop_cli.conclude.reason import NOT_WHITE
from massprop_cli.estimate.residualtest import DOUBTFUL, deviate, share, threshold
from massprop_cli.flow import Analysis
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.resolved import Resolved
from tests import faulty
from tests.flown import RANDOM, fly

TRUTH = np.array([0.6, 0.05, -0.06, 2.7, 0.1, 2.4, -0.02, 0.025, 0.01, 22.0])


def rows(seed: int, count: int = 500) -> Array:
    return np.random.default_rng(seed).normal(size=(count, 6))


def test_both_statistics_are_those_of_the_books() -> None:
    z = rows(1)
    z[5, 2] = np.nan
    along, tail, count = whiteness.autocorrelation_and_kurtosis(z)
    held = z[np.isfinite(z).all(1)]
    np.testing.assert_allclose(tail, stats.kurtosis(held - 0, axis=0), atol=0.05)  # about zero, not about the mean
    clipped = np.clip(held, -4, 4)
    for i in range(6):
        whole = np.correlate(clipped[:, i], clipped[:, i], "full")[len(held) - 1 :]
        np.testing.assert_allclose(along[1:, i], whole[2:12] / whole[0], rtol=0, atol=1e-14)
        assert along[0, i] == pytest.approx(0.0 if i < 3 else whole[1] / whole[0], abs=1e-14)
    assert count == len(held) == 499


@pytest.mark.numerical
def test_noise_is_hardly_ever_found_to_be_none() -> None:
    """3,000 channels: Q is a chi-square of ten or eleven degrees of freedom, and its 99.9 % point is passed by a few."""
    found = [whiteness.autocorrelation_and_kurtosis(rows(seed)) for seed in range(500)]
    power = np.array([count * (along**2).sum(0) for along, _, count in found])
    tail = np.array([one for _, one, _ in found])
    limit = threshold(DOUBTFUL, 2)
    assert (deviate(power.reshape(-1, 2, 3).sum(2) / whiteness.FREEDOM, whiteness.FREEDOM) > limit).mean() < 3 * share(DOUBTFUL, 2)
    assert tail.max() < whiteness.HEAVY / 2
    assert 9 < power.mean() < 11
    assert (power[:, 3:] > stats.chi2.isf(1e-3, 11)).sum() < 9


def test_what_swings_and_what_stands_in_a_few_cycles_is_found() -> None:
    z = rows(3)
    wave = 0.8 * np.sin(0.1 * np.arange(len(z)))[:, None]
    assert ((whiteness.autocorrelation_and_kurtosis(z + wave)[0] ** 2).sum(0) > whiteness.COLOURED).all()
    few = z.copy()
    few[::100] = 7.0
    assert (whiteness.autocorrelation_and_kurtosis(few)[1] > whiteness.HEAVY).all()


TURNS = ", ".join(
    f'{{motion="random", axes=["{axis}"], every_cycles=5, max_cycles=4, start_cycle={60 * i}, end_cycle={60 * i + 60}}}'
    for i, axis in enumerate(("roll", "pitch", "yaw"))
)
PUSHES = '{motion="random", axes=["x", "y", "z"], every_cycles=5, max_cycles=4, start_cycle=180, end_cycle=500}'
ALL = '{motion="random", axes=["roll", "pitch", "yaw"], every_cycles=5, max_cycles=4, start_cycle=380, end_cycle=500}'


def flown(seed: int) -> tuple[Log, Vehicle]:
    plan = f'plan=[{TURNS}, {{motion="hold", start_cycle=180, end_cycle=380}}, {PUSHES}, {ALL}]'
    found = fly("free-flyer", "duration_s=25.0", plan, seeds=(seed,))
    return found.log(0), found.vehicle


def wrong(found: Analysis) -> dict[str, float]:
    """How many of their sigmas converged values are off by that are off by more than four."""
    estimates = found.conclusions[0].estimates
    off = {
        name: abs(one.value - true) / one.sigma
        for (name, one), true in zip(estimates.items(), TRUTH, strict=True)
        if one.value and one.sigma and one.verdict == "converged"
    }
    return {name: sigmas for name, sigmas in off.items() if sigmas > 4}


def examined(log: Log, vehicle: Vehicle) -> Analysis:
    return flow.examine(log, VehicleSource(vehicle, "", ""))


def believed(log: Log, vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch) -> Analysis:
    """What would be said of a log if every disturbance counted as noise."""
    for test in ("whiteness_test", "oscillation_test"):
        monkeypatch.setattr(judge, test, lambda *_: {})
    monkeypatch.setattr(estimated, "_correlated_disturbance", lambda *_: "")
    monkeypatch.setattr(estimated, "_doubts", lambda *_: [])
    return examined(log, vehicle)


def swinging(log: Log, part: float, hz: float) -> Log:
    """A log whose vehicle carries a part of its inertia on a spring, damped by 1 %: by what that swings the body swings back.

    ``q'' = −a − 2 ζ ω q' − ω² q`` beside the rigid body's angular acceleration a, and the rate is the rigid one's less ``part`` q'.
    """
    rate, step = log.delta_theta_imu_rad / log.interval_s[:, None], float(log.interval_s[0]) / 50
    frequency = 2 * np.pi * hz
    angle, speed, shown = np.zeros(3), np.zeros(3), []
    for change in np.diff(rate, axis=0, prepend=rate[:1]):
        mean = np.zeros(3)
        for _ in range(50):
            speed = speed + step * (-change / (50 * step) - 0.02 * frequency * speed - frequency**2 * angle)
            angle = angle + step * speed
            mean += speed / 50
        shown.append(mean)
    return replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad - part * np.array(shown) * log.interval_s[:, None])


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_part_that_swings_leaves_no_value_wrong_and_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted as a torque that walks, it had left inertias converged and 8 to 20 sigma off."""
    log, vehicle = flown(5)
    assert not wrong(examined(swinging(log, 0.01, 0.3), vehicle))
    assert max(wrong(believed(swinging(log, 0.01, 0.3), vehicle, monkeypatch)).values()) > 8


@pytest.mark.seeds
@pytest.mark.thorough
def test_commands_that_were_not_executed_leave_no_value_wrong_and_converged() -> None:
    """A twentieth of the cycles hold commands of others that no jet ever got: steps as large as theirs, and no white torque."""
    log, vehicle = flown(2)
    found = examined(faulty.losing(log, 25, 2), vehicle)
    estimates = found.conclusions[0].estimates
    assert not wrong(found)
    assert sum(estimates[name].verdict != "converged" for name in QUANTITIES[:6]) >= 4


@pytest.mark.thorough
@pytest.mark.seeds
def test_counts_that_are_coarser_than_the_noise_leave_no_mass_converged() -> None:
    """An accelerometer that counts in steps of five times its noise shows what it feels in a few cycles; nothing need be widened."""
    log, vehicle = flown(5)
    step = 0.1 * log.interval_s[:, None]
    coarse = replace(log, delta_v_imu_m_s=step * np.round(log.delta_v_imu_m_s / step))
    found = examined(coarse, vehicle)
    assert found.conclusions[0].estimates["mass"].verdict != "converged"
    assert isinstance(found.vehicle, Resolved)
    assert whiteness.whiteness_test(found.settled[0], found.vehicle)["mass"].code in NOT_WHITE
    assert not whiteness.whiteness_test(examined(log, vehicle).settled[0], found.vehicle)


@pytest.mark.parametrize("kind", ["torque_n_m=0.02", pytest.param("walk_n_m=0.001", marks=pytest.mark.thorough)])
def test_a_disturbance_that_is_noise_leaves_values_converged(kind: str) -> None:
    disturbed = fly("free-flyer", *RANDOM, f"disturbance.{kind}", seeds=(4,))
    found = examined(disturbed.log(0), disturbed.vehicle)
    assert [notice.code for notice in found.notices] == ["disturbance-torque"]
    assert not wrong(found)
    assert sum(one.verdict == "converged" for one in found.conclusions[0].estimates.values()) >= 9


@pytest.mark.thorough
def test_on_times_at_half_beside_a_delay_to_be_found_leave_no_mass_converged() -> None:
    """As milliseconds read as per cent of 50: each pulse goes on when it should have ended. Rates told it, and the mass had stood alone."""
    log, vehicle = faulty.sample("high-rate")
    open_ = faulty.stated(vehicle, 'cycle.command_delay_cycles="auto"')
    found = examined(replace(log, command=0.5 * log.command), open_)
    mass = found.conclusions[0].estimates["mass"]
    assert mass.value is not None
    assert mass.sigma is not None
    assert abs(mass.value - 19) > 10 * mass.sigma
    assert not any(one.verdict == "converged" for one in found.conclusions[0].estimates.values())


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_log_without_noise_converges_with_the_noise_that_is_stated() -> None:
    """What is left of it is no noise, but moves no value by a sigma: all had been held back, some contradicted by a change of mass."""
    flight = fly("testbed", "sensors.gyro_noise_rad_s=0", "sensors.accel_noise_m_s2=0", seeds=(1,))
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, "", ""))
    assert not found.notices
    told = [one for one in found.conclusions[0].estimates.values() if one.verdict != "unobservable"]
    assert {one.verdict for one in told} == {"converged"}
    z = (found.conclusions[0].values - flight.truth[0, 0]) / found.conclusions[0].sigmas
    assert np.nanmax(np.abs(z)) < 0.3
