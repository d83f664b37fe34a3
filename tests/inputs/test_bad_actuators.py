"""Wheels and rotors that the vehicle file or the log says too little of: exit 3, one line that says what to write where."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.refusal import NAN, Edit, added, both, cell, flight, refused, save, save_vehicle, vehicle_text

WHEEL = """
[[wheels]]
name = "w1"
axis = [0.0, 0.0, 1.0]
spin_inertia_kg_m2 = 1e-3
locked_in_inertia = true
"""
BY_TORQUE = WHEEL + 'column = "torque"\n'


@dataclass(frozen=True)
class Bad:
    """Tables of a vehicle file, an edit of a good log, and what the message must name."""

    wheels: str
    edit: Edit
    names: tuple[str, ...]


SPEED, TORQUE = added(wheel_w1_rad_s=10.0), added(wheel_w1_n_m=0.0)
BAD = {
    "column of no wheel": Bad(
        WHEEL, added(wheel_w1_rad_s=1.0, wheel_w2_rad_s=1.0), ("'wheel_w2_rad_s'", "the nearest wheel is 'w1'", "Add it")
    ),
    "wheels in the log alone": Bad("", SPEED, ("'wheel_w1_rad_s'", "it has no [[wheels]]", "Add it to the vehicle file")),
    "no column": Bad(WHEEL, added(), ("'wheel_w1_rad_s' is missing", "add it")),
    "speed stated, torque there": Bad(WHEEL, TORQUE, ("'wheel_w1_n_m'", 'state column = "torque"')),
    "torque stated, speed there": Bad(BY_TORQUE, SPEED, ("'wheel_w1_rad_s'", 'state column = "speed"')),
    "speed in rpm": Bad(WHEEL + "start_rad_s = 1.0472\n", SPEED, ("9.549 times the start_rad_s", "it is in rpm", "correct the speeds")),
    "speed the other way round": Bad(WHEEL + "start_rad_s = -10.0\n", SPEED, ("-1 times the start_rad_s", "it has the other sign")),
    "torque without a start": Bad(BY_TORQUE, TORQUE, ("'w1'", "start_rad_s", "first cell of column 'wheel_w1_rad_s'")),
    "empty cell of a speed": Bad(
        WHEEL, lambda table: cell("wheel_w1_rad_s", 7, NAN)(SPEED(table)), ("row 7", "wheel_w1_rad_s", "correct or cut")
    ),
    "torque within a cycle of which there is none": Bad(
        BY_TORQUE + "start_rad_s = 0.0\n",
        lambda table: cell("wheel_w1_n_m", 7, NAN)(TORQUE(table)),
        ("row 7", "wheel_w1_n_m", "write one (0 for none)"),
    ),
    "no spin inertia": Bad(WHEEL.replace("spin_inertia_kg_m2 = 1e-3\n", ""), SPEED, ("'wheels.0.spin_inertia_kg_m2' is missing; add it",)),
    "nothing on the locked wheel": Bad(
        WHEEL.replace("locked_in_inertia = true\n", ""),
        SPEED,
        ("'wheels.0.locked_in_inertia' is missing; add it: whether the body's inertia",),
    ),
    "axis of no length": Bad(WHEEL.replace("0.0, 1.0]", "0.0, 0.0]"), SPEED, ("wheels.0.axis", "has length 0")),
    "one name twice": Bad(2 * WHEEL, SPEED, ("wheel name 'w1' is used twice",)),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_with_a_wheel_is_refused_with_what_to_do(name: str, tmp_path: Path) -> None:
    bad = BAD[name]
    save_vehicle(tmp_path, vehicle_text() + bad.wheels)
    log = save(bad.edit(flight()), tmp_path / "log.parquet")
    refused(tmp_path, log, names=bad.names)


ROTOR = """
[[rotors]]
name = "r1"
position_m = [0.1, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
spin = 1
thrust_n = [0.0, 1.0]
"""
NO_JETS: Edit = lambda table: table.select([name for name in table.column_names if not name.startswith("jet_")])  # noqa: E731
TOLD = both(NO_JETS, added(rotor_r1_command=0.5))
BAD_ROTORS = {
    "column of no rotor": Bad(
        ROTOR, both(TOLD, added(rotor_r2_command=0.5)), ("'rotor_r2_command'", "the nearest rotor is 'r1'", "Add it")
    ),
    "jets beside rotors": Bad(ROTOR, added(rotor_r1_command=0.5), ("[[rotors]]", "'jet_roll_p1_s'", "keep the one kind that acted")),
    "command stated, speed there": Bad(ROTOR, both(NO_JETS, added(rotor_r1_rad_s=9.0)), ("'rotor_r1_rad_s'", 'state column = "speed"')),
    "no column": Bad(ROTOR, NO_JETS, ("'rotor_r1_command' is missing", "add it")),
    "voltage that is not logged": Bad(ROTOR + "nominal_v = 11.1\n", TOLD, ("'supply_v' is missing",)),
    "momentum without a speed": Bad(
        ROTOR + "spin_inertia_kg_m2 = 1e-5\n", TOLD, ("rotors.0", "needs the rotor's speed", 'column = "speed"')
    ),
    "a speed that lags": Bad(ROTOR + 'column = "speed"\nlag_up_s = 0.1\n', TOLD, ("rotors.0", "has no lag", "drop lag_up_s")),
    "no sense of turning": Bad(
        ROTOR.replace("spin = 1\n", ""), TOLD, ("'rotors.0.spin' is missing; add it: 1: right-handed rotation about the axis",)
    ),
}


@pytest.mark.parametrize("name", BAD_ROTORS)
def test_what_is_wrong_with_a_rotor_is_refused_with_what_to_do(name: str, tmp_path: Path) -> None:
    bad = BAD_ROTORS[name]
    save_vehicle(tmp_path, vehicle_text().partition("[[jets]]")[0] + bad.wheels)
    log = save(bad.edit(flight()), tmp_path / "log.parquet")
    refused(tmp_path, log, names=bad.names)


GYRO = """
[[control_moment_gyros]]
name = "g1"
gimbal_axis = [0.0, 0.0, 1.0]
spin_axis = [2.0, 0.0, 0.0]
h_n_m_s = 0.4
locked_in_inertia = true
"""
BY_SPEED = GYRO.replace("h_n_m_s = 0.4", "spin_inertia_kg_m2 = 8e-4")
GIMBAL = added(cmg_g1_gimbal_rad=0.25)
BAD_GYROS = {
    "column of no gyro": Bad(
        GYRO, both(GIMBAL, added(cmg_g2_gimbal_rad=0.0)), ("'cmg_g2_gimbal_rad'", "the nearest control moment gyro is 'g1'", "Add it")
    ),
    "gyros in the log alone": Bad("", GIMBAL, ("'cmg_g1_gimbal_rad'", "it has no [[control_moment_gyros]]", "Add it")),
    "no column": Bad(GYRO, added(), ("'cmg_g1_gimbal_rad' is missing", "add it")),
    "no speed where the momentum is not stated": Bad(BY_SPEED, GIMBAL, ("'cmg_g1_rad_s' is missing", "add it")),
    "empty cell": Bad(
        GYRO, lambda table: cell("cmg_g1_gimbal_rad", 7, NAN)(GIMBAL(table)), ("row 7", "cmg_g1_gimbal_rad", "correct or cut")
    ),
    "a gimbal that leaps": Bad(
        GYRO,
        lambda table: cell("cmg_g1_gimbal_rad", 7, 3.0)(GIMBAL(table)),
        ("row 7", "cmg_g1_gimbal_rad", "3 rad, after 0.25 rad", "is it in radians"),
    ),
    "a gimbal in degrees that goes round": Bad(
        GYRO,
        lambda table: cell("cmg_g1_gimbal_rad", 7, 360.25)(GIMBAL(table)),
        ("row 7", "cmg_g1_gimbal_rad", "360.25 rad", "is it in radians"),
    ),
    "angles in degrees": Bad(
        GYRO + "start_gimbal_rad = 0.0043633\n",
        GIMBAL,
        ("57.3 times the start_gimbal_rad", "it is in degrees", "correct the gimbal angles"),
    ),
    "the other way round": Bad(GYRO + "start_gimbal_rad = -0.25\n", GIMBAL, ("-1 times the start_gimbal_rad", "it has the other sign")),
    "speed in rpm": Bad(
        BY_SPEED + "start_rad_s = 1.0472\n", both(GIMBAL, added(cmg_g1_rad_s=10.0)), ("9.549 times the start_rad_s", "it is in rpm")
    ),
    "axes that are not orthogonal": Bad(
        GYRO.replace("[2.0, 0.0, 0.0]", "[1.0, 0.0, 1.0]"), GIMBAL, ("control_moment_gyros.0", "45 degrees from gimbal_axis, not 90")
    ),
    "no momentum": Bad(
        GYRO.replace("h_n_m_s = 0.4\n", ""), GIMBAL, ("control_moment_gyros.0", "state h_n_m_s, or state spin_inertia_kg_m2")
    ),
    "left out of the inertia by nobody knows how much": Bad(
        GYRO.replace("= true", "= false"), GIMBAL, ("control_moment_gyros.0", "locked_in_inertia = false needs spin_inertia_kg_m2")
    ),
    "nothing on the locked rotor": Bad(
        GYRO.replace("locked_in_inertia = true\n", ""), GIMBAL, ("'control_moment_gyros.0.locked_in_inertia' is missing; add it",)
    ),
    "axis of no length": Bad(GYRO.replace("[0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0]"), GIMBAL, ("gimbal_axis", "has length 0")),
    "one name twice": Bad(2 * GYRO, GIMBAL, ("control moment gyro name 'g1' is used twice",)),
}


@pytest.mark.parametrize("name", BAD_GYROS)
def test_what_is_wrong_with_a_control_moment_gyro_is_refused_with_what_to_do(name: str, tmp_path: Path) -> None:
    bad = BAD_GYROS[name]
    save_vehicle(tmp_path, vehicle_text() + bad.wheels)
    refused(tmp_path, save(bad.edit(flight()), tmp_path / "log.parquet"), names=bad.names)
