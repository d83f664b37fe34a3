"""Executed thrust against the estimator's own alignment and against thrust drawn point by point."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.prepare.align import align
from massprop_cli.testbed.actuators import Actuators, Ramp
from massprop_cli.testbed.scenario import Scenario
from tests import flight

CYCLES, BINS = 60, 20


def scenario(delay: float = 0.0, rise_s: float = 0.0, lag_s: float = 0.0, pulse_at: str = "begin", **actuators: Any) -> Scenario:
    used = flight.vehicle("free", delay, jets=flight.jets(rise_s=rise_s), thrust={"lag_s": lag_s})
    parts = {"estimator": used.estimator.model_copy(update={"bins_per_cycle": BINS})}
    used = used.model_copy(update=parts | {"cycle": used.cycle.model_copy(update={"pulse_at": pulse_at})})
    body = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "mass": 10.0}
    return Scenario.model_validate({"schema": 1, "duration_cycles": CYCLES, "vehicle": used, "truth": body, "actuators": actuators})


def executed(flown: Scenario, issued: Array) -> Array:
    """(K, B, 6) impulse of every bin, cycle by cycle, as where each cycle's commands depend on the motion in the one before."""
    width = flight.CYCLE / BINS
    actuators = Actuators(flown, flown.vehicle.jet_wrench, np.ones((1, *issued.shape)), width * np.arange(BINS + 1))
    found = []
    for k in range(CYCLES):
        actuators.issued[0, k] = issued[k]
        found.append(actuators.execute(k, k + 1)[0][:, 0, 0].T * width)
    return np.array(found)


def executed_at_once(flown: Scenario, issued: Array) -> Array:
    """The same of all cycles together."""
    width = flight.CYCLE / BINS
    actuators = Actuators(flown, flown.vehicle.jet_wrench, np.ones((1, *issued.shape)), width * np.arange(BINS + 1))
    actuators.issued[0] = issued
    mean, _, _ = actuators.execute(0, CYCLES)
    return np.moveaxis(mean[:, 0] * width, 0, -1)


FEW = [(0.0, 0.0, 0.0), (1.37, 0.003, 0.0), (2.0, 0.02, 0.03), (1.37, 0.02, 0.03)]
ALL = [(delay, rise_s, lag_s) for delay in (0.0, 2.0, 1.37) for rise_s in (0.0, 0.003, 0.02) for lag_s in (0.0, 0.03)]


@pytest.mark.parametrize("pulse_at", ["begin", "centre", "end"])
@pytest.mark.parametrize(
    ("delay", "rise_s", "lag_s"), [case if case in FEW else pytest.param(*case, marks=pytest.mark.thorough) for case in ALL]
)
def test_executed_impulse_is_what_alignment_makes_of_the_same_commands(delay: float, rise_s: float, lag_s: float, pulse_at: str) -> None:
    flown = scenario(delay, rise_s, lag_s, pulse_at)
    issued = flight.pulses(CYCLES, seed=4)
    issued[30:33, 0] = 0.05  # touching pulses
    issued[[29, 33], 0] = 0.02
    log = flight.Flight(flown.vehicle, issued, np.zeros((CYCLES, 3)), np.zeros((CYCLES, 3))).log()
    aligned = align(log, flown.vehicle, delay, lag_s)
    for found in (executed(flown, issued), executed_at_once(flown, issued)):
        assert np.allclose(found, aligned.impulse_bins, rtol=0, atol=1e-15 + 1e-12 * np.abs(aligned.impulse_bins).max())


@pytest.mark.parametrize(("pulse_at", "middle"), [("begin", 0.01), ("centre", 0.025), ("end", 0.04)])
def test_a_pulse_is_where_it_is_said_to_be_in_its_cycle(pulse_at: str, middle: float) -> None:
    """Of 20 ms in 50: when the middle of its impulse acts."""
    issued = np.zeros((CYCLES, len(flight.jets())))
    issued[3, 0] = 0.02
    found = executed_at_once(scenario(1.0, pulse_at=pulse_at), issued)[4, :, 5]
    at = flight.CYCLE / BINS * (np.arange(BINS) + 0.5)
    assert (found * at).sum() / found.sum() == pytest.approx(middle, abs=1e-9)


def test_gathered_impulse_is_the_mean_of_the_running_integral() -> None:
    flown = scenario(0.37, 0.003)
    issued = flight.pulses(CYCLES, seed=2)
    width = flight.CYCLE / BINS
    actuators = Actuators(flown, flown.vehicle.jet_wrench, np.ones((1, *issued.shape)), width * np.arange(BINS + 1))
    actuators.issued[0] = issued
    fine = 80
    for k in (10, 14, 19):
        _, partial_impulse, _ = actuators.execute(k, k + 1)
        time = flight.CYCLE * k + width * (np.arange(BINS * fine) + 0.5) / fine
        thrust = np.array([flight.thrust_fraction(issued, 0.37, 0.003, t) for t in time]) @ flown.vehicle.jet_wrench
        steps = thrust.reshape(BINS, fine, 6)
        running = (np.cumsum(steps, 1) - steps / 2) * width / fine
        assert np.allclose(partial_impulse[:, 0, 0].T, running.mean(1), rtol=0, atol=3e-3 * width)


def test_a_ramps_integrals_are_those_of_its_drawn_line() -> None:
    ramp = Ramp(np.array([-0.01, 0.004, 0.02, 0.03]), np.array([0.01, 0.004, 0.025, 0.07]), np.array([1.0, -2.0, 0.5, 3.0]))
    time = np.linspace(0, 0.05, 50001)
    width = (ramp.end - ramp.start)[:, None]
    line = np.where(width > 0, np.clip((time - ramp.start[:, None]) / np.where(width > 0, width, 1), 0, 1), time > ramp.start[:, None])
    drawn = ramp.height[:, None] * line
    first = np.concatenate([np.zeros((4, 1)), np.cumsum((drawn[:, 1:] + drawn[:, :-1]) / 2, 1) * 1e-6], 1)
    second = np.concatenate([np.zeros((4, 1)), np.cumsum((first[:, 1:] + first[:, :-1]) / 2, 1) * 1e-6], 1)
    found = ramp.integrals(time)
    assert np.allclose(found[0], first, rtol=0, atol=3e-6)
    assert np.allclose(found[1], second, rtol=0, atol=2e-7)
    assert np.allclose(ramp.value_at_zero(), [0.5, 0, 0, 0])


def test_on_times_are_ticks_and_too_short_pulses_are_dropped() -> None:
    flown = scenario(pwm_tick_s=0.0025, minimum_pulse_s=0.004)
    actuators = Actuators(flown, flown.vehicle.jet_wrench, np.ones((1, CYCLES, 18)), flight.CYCLE / BINS * np.arange(BINS + 1))
    share = np.zeros((1, 18))
    share[0, :5] = [0.07, 0.11, 0.52, 0.98, 1.3]
    actuators.issue(0, share)
    assert np.allclose(actuators.issued[0, 0, :5], [0.0, 0.005, 0.025, 0.05, 0.05])


def test_joined_pulses_of_different_strength_keep_their_own() -> None:
    flown = scenario(0.5)
    strength = np.ones((1, CYCLES, 18))
    strength[0, 1, 12] = 1.1
    actuators = Actuators(flown, flown.vehicle.jet_wrench, strength, flight.CYCLE / BINS * np.arange(BINS + 1))
    actuators.issued[0, :2, 12] = 0.05
    mean, _, burnt = actuators.execute(0, 2)
    assert np.allclose(mean[3, 0, 1], 2.224 * np.repeat([1.0, 1.1], 10))
    assert burnt[0, 1, 12] == pytest.approx(0.5 * 0.05 * 2.1)
