"""Rotors of the simulator against their lag, thrust and momentum, stepped by hand."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.testbed import scenario, simulate

FLIES = "actuators={max_rotor_command=1000.0, hover_force_n=[0, 0, 12.0], lag_s=0.03, supply_v=[12.0, 9.0], delay_cycles=1.35}"
HEAVY = ("truth.ixx=2e4", "truth.iyy=2e4", "truth.izz=4e4", "truth.mass=1.6e4", "truth.cg_x=0", "truth.cg_y=0", "truth.cg_z=0")
PERFECT = ("sensors.gyro_noise_rad_s=0", "sensors.accel_noise_m_s2=0", "vehicle.imu.position_m=[0, 0, 0]")
PLAN = 'plan=[{motion="random", axes=["roll", "pitch", "yaw", "z"], level=0.5, every_cycles=3, max_cycles=2, start_s=0, end_s=2}]'
AROUND = ([0.2, -0.1, 0.0], [-0.1, -0.2, 0.02], [-0.2, 0.1, 0.0], [0.1, 0.2, 0.02])


def rotors(**keys: str) -> str:
    """Four of them, each the other way round than the one before."""
    stated = {"thrust_n": "[0.0, 1e-3, 8e-6]", "torque_ratio_m": "0.016", **keys}
    more = ", ".join(f"{key}={value}" for key, value in stated.items())
    alike = [f'{{name="r{i}", position_m={place}, axis=[0, 0, 2], spin={1 - 2 * (i % 2)}, {more}}}' for i, place in enumerate(AROUND)]
    return f"vehicle.rotors=[{', '.join(alike)}]"


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize(
    "of",
    [
        {"lag_up_s": "0.03", "lag_down_s": "0.06", "nominal_v": "12.0"},
        pytest.param({"column": '"speed"', "spin_inertia_kg_m2": "4e-5", "locked_in_inertia": "false"}, marks=pytest.mark.thorough),
    ],
    ids=["commands and a supply that sags", "speeds and their momentum"],
)
def test_a_heavy_body_gains_what_rotors_give(of: dict[str, str]) -> None:
    """Lag, polynomial, drag and spin-up in steps of 5 µs, on a body so heavy that it hardly turns: to 1e-4 of the most."""
    flies = FLIES if "nominal_v" in of else FLIES.replace("supply_v=[12.0, 9.0], ", "")
    source = scenario.load("multicopter", (flies, rotors(**of), "duration_s=2", PLAN, *HEAVY, *PERFECT))
    flight = simulate.fly(source, [1])
    step, period, delay = 5e-6, 0.02, 1.35
    up, down = (0.03, 0.06) if "nominal_v" in of else (0.03, 0.03)
    time = step * (np.arange(round(2 / step)) + 0.5)
    acting = np.maximum(np.floor(time / period - delay).astype(int), 0)
    volts = 12 - 3 * (acting + 0.5 + delay) * period / 2 if "nominal_v" in of else np.full_like(time, 12.0)
    asked = flight.issued[0][acting] * volts[:, None] / 12
    x = np.empty_like(asked)
    now = asked[0]
    for i, to in enumerate(asked):
        now = to + (now - to) * np.exp(-step / np.where(to > now, up, down))
        x[i] = now
    thrust = 1e-3 * x + 8e-6 * x**2
    spin, place = np.array([1.0, -1.0, 1.0, -1.0]), np.array(AROUND)
    torque = np.stack([thrust @ place[:, 1], -thrust @ place[:, 0], -0.016 * thrust @ spin], 1)
    stored = np.zeros((len(time), 3))
    stored[:, 2] = (4e-5 if "spin_inertia_kg_m2" in of else 0.0) * (x - asked[0]) @ spin
    gained = (np.cumsum(torque, 0) * step - stored)[round(period / step) - 1 :: round(period / step)]
    body = np.array([[2e4, 6e-4, -8e-4], [6e-4, 2e4, 5e-4], [-8e-4, 5e-4, 4e4]])
    assert np.abs(flight.rate_rad_s[0, 1:] @ body - gained).max() < 1e-4 * np.abs(gained).max()
    pushed = np.cumsum(thrust.sum(1))[round(period / step) - 1 :: round(period / step)] * step
    assert np.abs(np.cumsum(flight.delta_v_m_s[0, :, 2]) * 1.6e4 - pushed).max() < 1e-4 * pushed.max()
    if "column" in of:
        ends = x[round(period / step) - 1 :: round(period / step)]
        assert np.abs(np.stack([flight.columns[f"rotor_r{i}_rad_s"][0] for i in range(4)], 1) - ends).max() < 1e-4 * ends.max()
    else:
        assert flight.columns["supply_v"][0, [0, -1]] == pytest.approx([12 - 3 * 0.005, 9 + 3 * 0.005])
        assert flight.log(0).command == pytest.approx(flight.issued[0], abs=1e-9)


def test_what_rotors_spin_up_by_the_body_loses() -> None:
    """A rotor without drag that pushes through the CG: the momentum of both about its axis stands still, to 1e-9."""
    one = 'name="r", position_m=[0, 0, 0], axis=[0, 0, 1], spin=1, thrust_n=[0, 1e-3, 8e-6], column="speed", spin_inertia_kg_m2=4e-5'
    source = scenario.load(
        "multicopter",
        (
            f"vehicle.rotors=[{{{one}}}]",
            "actuators={max_rotor_command=1000.0, hover_force_n=[0, 0, 4.0], lag_s=0.05}",
            "duration_s=4",
            'plan=[{motion="random", axes=["z"], start_s=0, end_s=4}]',
            *(f"truth.{key}=0" for key in ("ixy", "ixz", "iyz", "cg_x", "cg_y")),
        ),
    )
    flight = simulate.fly(source, [1])
    speed = flight.columns["rotor_r_rad_s"][0]
    assert np.ptp(speed) > 300
    total = 0.041 * flight.rate_rad_s[0, 1:, 2] + 4e-5 * speed
    assert np.abs(total - total[0]).max() < 1e-9 * 4e-5 * np.ptp(speed)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["actuators={max_rotor_command=1.0}"], "give actuators.max_rotor_command, and actuators.hover_force_n"),
        (["actuators.max_rotor_command=0.4"], "cannot give actuators.hover_force_n without torque about O"),
        (["actuators.hover_force_n=[0, 3, 15]"], "cannot give actuators.hover_force_n without torque about O"),
        (["vehicle.rotors.1.thrust_n=[0.0, 9.0, -6.0]"], "thrust_n of rotor 'm2' does not rise all the way"),
        ([rotors(column='"speed"')], "rotor 'r0' logs its speed: give actuators.lag_s"),
        (["actuators.max_force_n=[1, 1, 1]"], "of rotors, or of jets or a wrench: drop one kind"),
        (["actuators.supply_v=[12, 11]"], "needs nominal_v of"),
        (['plan=[{motion="random", axes=["x"], start_s=0, end_s=4}]'], "cannot drive x in both directions without disturbing other axes"),
    ],
)
def test_rotors_that_can_not_be_flown_are_refused(settings: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said.replace("(", r"\(")):
        simulate.fly(scenario.load("multicopter", tuple(settings)), [1])
    with pytest.raises(InputError, match="max_rotor_command and hover_force_n need"):
        scenario.load("free-flyer", ("actuators.max_rotor_command=1.0",))
