"""Commands that were lost on their way leave steps that are missing, and values that are too large by the part that was lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import INERTIA
from massprop_cli.conclude import executed
from massprop_cli.flow import Analysis
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.testbed import scenario, simulate
from tests.conclude.test_white import examined

PLAN = 'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], every_cycles=3, max_cycles=2, start_cycle=0, end_cycle=1200}]'


def flown(seed: int, noise: float, *settings: str) -> tuple[Log, Vehicle]:
    """A minute of which two cycles in three hold commands; ``noise`` of the gyro in rad/s, of which a cycle's command makes 0.02."""
    noises = f"vehicle.imu.gyro_noise_rad_s={noise}", f"vehicle.imu.accel_noise_m_s2={75 * noise}"
    flight = simulate.fly(scenario.load("free-flyer", ("duration_s=60.0", PLAN, *noises, *settings)), [seed])
    return flight.log(0), flight.vehicle


def losing(log: Log, part: float, seed: int) -> Log:
    """With commands in cycles that had none, which no jet ever got: so many of all that moved it."""
    rng = np.random.default_rng(seed)
    idle, busy = np.flatnonzero(~log.command.any(1)), np.flatnonzero(log.command.any(1))
    command = log.command.copy()
    count = round(part * len(busy))
    command[rng.choice(idle, count, replace=False)] = log.command[rng.choice(busy, count)]
    return replace(log, command=command)


def told(found: Analysis) -> dict[str, str]:
    assert isinstance(found.vehicle, Resolved)
    return executed.unexecuted(found.settled[0], found.samples, found.vehicle)


@pytest.mark.numerical
@pytest.mark.parametrize("noise", [0.002, 0.008])
@pytest.mark.parametrize("seed", [2, 3])
def test_lost_commands_are_told_of_beside_a_disturbance_that_stands_for_them(noise: float, seed: int) -> None:
    """Three in 200: of another vehicle's as many, all moments of inertia had been converged and six sigma too large."""
    log, vehicle = flown(seed, noise)
    whole = examined(log, vehicle)
    assert whole.notices == ()
    assert not told(whole)
    lost = examined(losing(log, 0.015, seed), vehicle)
    found = told(lost)
    assert set(found) == {*INERTIA, "mass"}
    assert "of the commands seem not to have been executed" in found["mass"]
    assert all(lost.conclusions[0].estimates[name].verdict != "converged" for name in found)


@pytest.mark.numerical
@pytest.mark.parametrize("seed", [2, 3])
def test_pulses_that_scatter_are_not_lost(seed: int) -> None:
    """They leave squares that grow with the command as well, and no bias."""
    log, vehicle = flown(seed, 0.004, "vehicle.thrust.pulse_sigma=0.25")
    exact = vehicle.model_copy(update={"thrust": vehicle.thrust.model_copy(update={"pulse_sigma": 0.0})})
    found = examined(log, exact)
    assert [notice.code for notice in found.notices] == ["disturbance-torque"]
    assert not told(found)
