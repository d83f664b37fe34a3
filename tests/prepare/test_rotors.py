"""Thrust of rotors in time, against the lag of jets and wrenches, a fine integration, and what another tool made of a recorded flight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.actuators.rotor import Held, thrust_integrals
from massprop_cli.inputs.columns import DELTA_THETA, DELTA_V, WRENCH
from massprop_cli.inputs.formats import mapfile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.tablefile import Table
from massprop_cli.inputs.telemetry import read
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import signal
from massprop_cli.prepare.actuators import held
from massprop_cli.prepare.align import align
from tests.refusal import flight, save

FLIGHTS = Path(__file__).parents[2] / "sample_logs" / "crazyflie"
ROTOR = {
    "name": "r",
    "position_m": (0.2, 0.1, 0.0),
    "axis": (0.0, 0.0, 2.0),
    "spin": 1,
    "thrust_n": (0.1, 0.0, 2.0),
    "torque_ratio_m": 0.05,
}


def commands(count: int = 40) -> tuple[Array, Array]:
    """Times, and thrusts of which the first is none."""
    thrust = np.abs(np.cumsum(np.random.default_rng(1).standard_normal(count)))
    thrust[0] = 0.0
    return 0.05 * np.arange(count) + 0.013, thrust


def test_with_one_lag_both_ways_a_rotor_lags_as_a_wrench_does() -> None:
    begin, thrust = commands()
    edges = np.linspace(0.0, 2.1, 169)
    found = thrust_integrals([Held(begin, thrust, 0.08, 0.08, (0.0, 1.0))], edges)
    expected = signal.window_integrals([held(begin, thrust)], edges, 0.08)
    for one, other in zip(found, expected, strict=True):
        assert np.abs(one - other).max() < 1e-13
    found = thrust_integrals([Held(begin, thrust, 0.0, 0.0, (0.0, 1.0))], edges)
    for one, other in zip(found, signal.window_integrals([held(begin, thrust)], edges), strict=True):
        assert np.abs(one - other).max() < 1e-13


def test_turning_up_and_down_have_lags_of_their_own_and_thrust_is_what_the_speed_makes() -> None:
    """Against steps of 20 µs: a rotor that began where its first command holds it."""
    begin, thrust = commands()
    thrust[0] = 1.5
    edges = np.linspace(0.1, 1.9, 37)
    step = 2e-5
    time = np.arange(0.0, 1.9, step)
    asked = thrust[np.maximum(np.searchsorted(begin, time, "right") - 1, 0)]
    y = np.empty_like(time)
    y[0] = 1.5
    for i in range(1, len(time)):
        y[i] = y[i - 1] + step * (asked[i - 1] - y[i - 1]) / (0.03 if asked[i - 1] > y[i - 1] else 0.12)
    y = 0.3 + 0.5 * y + 0.8 * y**2 + 0.1 * y**3
    number = np.searchsorted(edges, time, "right") - 1
    inside = (number >= 0) & (number < 36)
    integral, moment = thrust_integrals([Held(begin, thrust, 0.03, 0.12, (0.3, 0.5, 0.8, 0.1))], edges)
    assert np.abs(integral[:, 0] - np.bincount(number[inside], y[inside] * step, 36)).max() < 2e-4 * integral.max()
    late = (time[inside] - edges[number[inside]]) * y[inside] * step
    assert np.abs(moment[:, 0] - np.bincount(number[inside], late, 36)).max() < 4e-4 * moment.max()


def of_rotors(tmp_path: Path, columns: dict[str, Array], **rotor: object) -> tuple[Table, Vehicle]:
    """A log of one rotor, and its vehicle."""
    table = flight()
    table = table.select([name for name in table.column_names if not name.startswith("jet_")])
    for name, values in columns.items():
        table = table.append_column(name, [values])
    data = {"schema": 1, "cycle": {"period_s": 0.05, "command_delay_cycles": 2.0}, "rotors": [ROTOR | rotor]}
    return read_table(save(table, tmp_path / "log.parquet")), Vehicle.model_validate(data)


def test_thrust_is_the_polynomial_of_the_command_and_of_the_voltage_as_it_acts(tmp_path: Path) -> None:
    """And its wrench that of a force at its place with the drag torque against its turning."""
    x, volts = np.linspace(0.0, 1.0, 100), np.linspace(12.0, 10.0, 100)
    for columns, rotor, part in (({}, {}, 1.0), ({"supply_v": volts}, {"nominal_v": 11.0}, volts[2:, None] / 11)):
        table, vehicle = of_rotors(tmp_path, {"rotor_r_command": x, **columns}, **rotor)
        aligned = align(read(table, vehicle), vehicle, 2.0, 0.0)
        impulse = 0.05 * (0.1 + 2 * (part * x[:-2, None]) ** 2) * np.array([0.1, -0.2, -0.05, 0.0, 0.0, 1.0])
        assert np.abs(aligned.whole[2:] - impulse).max() < 1e-12


def test_a_measured_speed_acts_at_once_and_holds_momentum(tmp_path: Path) -> None:
    speed = 100 + 50 * np.sin(np.arange(100) / 7)
    table, vehicle = of_rotors(
        tmp_path, {"rotor_r_rad_s": speed}, column="speed", thrust_n=(0.0, 0.0, 1e-4), spin=-1, spin_inertia_kg_m2=3e-5
    )
    aligned = align(read(table, vehicle), vehicle, 2.0, 0.0)
    assert aligned.stored is not None
    square = (speed[1:] ** 2 + speed[1:] * speed[:-1] + speed[:-1] ** 2) / 3  # its mean while the speed changes evenly
    assert np.abs(aligned.whole[1:, 5] - 0.05e-4 * square).max() < 1e-12
    assert np.abs(aligned.stored.mean.mean(1)[1:, 0] - 3e-5 * (speed[1:] + speed[:-1]) / 2).max() < 1e-12
    assert aligned.stored.axis.tolist() == [[0.0, 0.0, -1.0]]
    drag = 0.05e-4 * square * (0.2 * 0.0 + 0.05)  # turning left-handed, it turns the vehicle right-handed, as its spinning up does
    assert np.abs(aligned.whole[1:, 2] - drag - 3e-5 * np.diff(speed)).max() < 1e-12


@pytest.mark.parametrize("held", [True, False], ids=["held", "empty between"])
def test_speeds_of_a_slower_recorder_are_on_a_curve_between_their_samples(tmp_path: Path, held: bool) -> None:
    """Straight lines would be off by 2 rad/s."""
    speed = 100 + 50 * np.sin(np.arange(100) / 7)
    since = (np.arange(100) - 2) % 4
    seldom = speed[np.maximum(np.arange(100) - since, 0)] if held else np.where(since == 0, speed, np.nan)
    log = read(*of_rotors(tmp_path, {"rotor_r_rad_s": seldom}, column="speed"))
    assert log.cycles_apart == (4,)
    assert np.abs(log.command[6:95, 0] - speed[6:95]).max() < 0.2
    assert read(*of_rotors(tmp_path, {"rotor_r_rad_s": speed}, column="speed")).cycles_apart == (1,)


@pytest.mark.parametrize(
    "name", ["yaw", pytest.param("thrust", marks=pytest.mark.thorough), pytest.param("roll-pitch", marks=pytest.mark.thorough)]
)
def test_a_recorded_flights_original_columns_give_what_another_tool_made_of_them(name: str) -> None:
    """Increments to float32, and the lagged wrench of the motor commands to 1 % of its range (rms) once the start is forgotten."""
    folder = FLIGHTS / "original"
    used = vehiclefile.load(folder / "vehicle.toml").vehicle
    table = read_table(folder / f"{name}.parquet", folder / "map.toml")
    known = read_table(FLIGHTS / f"{name}.parquet")
    log, expected = read(table, used), {c: known.columns[c].numbers() for c in (*DELTA_THETA, *DELTA_V, *WRENCH)}
    count = min(log.cycles, known.rows)
    assert count > 0.99 * known.rows
    for increments, columns, scale in ((log.delta_theta_imu_rad, DELTA_THETA, 1.0), (log.delta_v_imu_m_s, DELTA_V, 9.81 / 9.80665)):
        assert np.abs(scale * increments[1:count] - np.stack([expected[c] for c in columns], 1)[1:count]).max() < 1e-6
    aligned = align(log, used, 0.0, 0.0)
    mean = aligned.whole[:count] / aligned.duration_s[:count, None]
    made = np.stack([expected[c] for c in WRENCH], 1)[:count]
    settled = slice(60, None)
    for axis in (0, 1, 2, 5):
        assert np.sqrt(((mean - made)[settled, axis] ** 2).mean()) < 0.01 * np.ptp(made[settled, axis])


def test_a_map_names_rotors_by_command_or_speed() -> None:
    assert mapfile.load(FLIGHTS / "original" / "map.toml").map.rotors["m1"].path == "motor.m1"
