"""Control cycles far shorter than a period: no pulse of theirs is lost, and none stops the flight."""

from functools import cache

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.estimate.kernelflight import VERDICTS, Flight, Reported
from massprop_cli.export import resolve
from massprop_cli.inputs import vehiclefile
from massprop_cli.kernel import PENDING, kernel
from massprop_cli.testbed import output, scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
PERIOD_S, PARTS, CYCLES, FIRST, COUNT = 0.05, 10, 400, 200, 6
"""Ordinary cycles, each of so many short ones; from which on so many come as short ones."""
SHORT_S, DELAY_S = PERIOD_S / PARTS, 0.15
SETTINGS = (
    f"duration_s={CYCLES * PERIOD_S}",
    f"vehicle.cycle.period_s={SHORT_S}",
    f"vehicle.cycle.pwm_tick_s={SHORT_S / 20}",
    f"vehicle.cycle.command_delay_cycles={DELAY_S / SHORT_S}",
    "sensors.records_per_cycle=1",
    'plan=[{motion="hold", start_s=0.0, end_s=0.1}]',
)
BY_WRENCH = "vehicle.jets=[]", "actuators.max_torque_n_m=[9, 9, 9]", "actuators.max_force_n=[9, 9, 9]"


def commanded(jets: bool, channels: int) -> Array:
    """(K, C) of each short cycle: in an ordinary one one pulse of a jet, or a wrench that stays; in short ones each has its own."""
    random = np.random.default_rng(5)
    ordinary = np.zeros((CYCLES, PARTS, channels))
    for g in range(0, CYCLES, 2):
        if jets:
            on = random.choice(channels, 3, replace=False)
            ordinary[g, : random.integers(2, PARTS), on] = SHORT_S
        else:
            ordinary[g : g + 2] = random.normal(0.0, [0.3, 0.5, 0.5, 1.0, 1.0, 1.0])
    issued = ordinary.reshape(-1, channels)
    burst = issued[FIRST * PARTS : (FIRST + COUNT) * PARTS]
    burst[:] = random.uniform(0.2, 0.8, burst.shape) * SHORT_S if jets else random.normal(0.4, 1.0, burst.shape)
    return issued


@cache
def flight(jets: bool, noise: float) -> SimulatedFlight:
    """With so much of the scenario's noise."""
    noises = f"vehicle.imu.gyro_noise_rad_s={1e-4 * noise}", f"vehicle.imu.accel_noise_m_s2={0.02 * noise}"
    source = scenario.load("free-flyer", [*SETTINGS, *noises, *(() if jets else BY_WRENCH)])
    return simulate.fly(source, [3], commanded(jets, len(source.scenario.vehicle.jets) or 6))


def cycles(found: SimulatedFlight) -> Array:
    """As they are flown, the short ones one by one."""
    each, at = [], 0
    while at < CYCLES * PARTS:
        count = 1 if FIRST * PARTS <= at < (FIRST + COUNT) * PARTS else PARTS
        part = slice(at, at + count)
        command = found.issued[0, part].sum(0) if found.vehicle.jets else found.issued[0, part].mean(0)
        sums = found.delta_theta_rad[0, part].sum(0), found.delta_v_m_s[0, part].sum(0)
        each.append([found.time_s[part][-1], count * SHORT_S, *np.concatenate(sums), 0.0, 0.0, 0.0, *command])
        at += count
    return np.array(each)


def flown(found: SimulatedFlight, latency_s: float) -> Reported:
    """By a vehicle file that says so much of the delay to be the sensors' latency."""
    late = [f"imu.{name}_filter={{order=0, latency_s={latency_s}}}" for name in ("gyro", "accel") if latency_s]
    settings = [f"cycle.period_s={PERIOD_S}", f"cycle.command_delay_cycles={(DELAY_S - latency_s) / PERIOD_S}", *late]
    constants = resolve.stated(vehiclefile.parse(output.vehicle_toml(found.vehicle), "vehicle.toml", settings))
    phase = constants.phases[0]
    return Flight(constants.commands, phase.vehicle, phase.rule).step(cycles(found), last=True)


def innovations(said: Reported) -> Array:
    """(K, 2) sigmas of gyro and of accelerometer, NaN where they are not used."""
    far: Array = np.linalg.norm(said.rows.normalised.reshape(-1, 2, 3), axis=2)
    return far


@pytest.mark.parametrize("latency_s", [0.0, 0.1, 0.15])
@pytest.mark.parametrize("jets", [True, False])
def test_the_impulse_of_pulses_without_room_is_kept(jets: bool, latency_s: float) -> None:
    """They come every 5 ms and act 150 ms later: 30 at a time, more than there is room for.

    Some cycles are not read, and the innovations of the next ones are within chance, as all others: the rate is the one that was expected.
    """
    assert DELAY_S / SHORT_S > PENDING
    found = flight(jets, 0.3)
    said = flown(found, latency_s)
    far = innovations(said)
    unread = np.flatnonzero(np.isnan(far).any(1))
    unread = unread[unread >= FIRST]
    assert 15 < len(unread) < COUNT * PARTS
    assert unread.max() < FIRST + COUNT * PARTS + 4
    assert np.nanmax(far[100:]) < 5.0
    assert len(said.values) == len(cycles(found)) - round(DELAY_S / PERIOD_S)
    assert (np.abs(said.values[-1] - found.truth[0, -1]) < 4.0 * said.sigmas[-1]).all()
    assert (said.verdicts[-1] == VERDICTS.index("converged")).all()
