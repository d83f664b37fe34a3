"""Commands as a table of events, against the same commands in rows of their own."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs import logfile, telemetry
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.align import align

VEHICLE = Vehicle.model_validate(
    {
        "schema": 1,
        "cycle": {"period_s": 0.05, "command_delay_cycles": 1.0},
        "imu": {"gyro_noise_rad_s": 1e-4, "accel_noise_m_s2": 0.01},
        "jets": [
            {"name": "a", "position_m": [0, 0.1, 0], "force_n": [0, 0, 1.0], "rise_s": 0.002},
            {"name": "b", "position_m": [0.1, 0, 0], "force_n": [0, 1.0, 0]},
        ],
    }
)
PULSES = [("b", 0.5132, 0.013), ("a", 0.212, 0.03), ("a", 0.7, 0.18), ("b", 0.7404, 0.02)]


def log_of(tmp_path: Path, pulses: Sequence[tuple[object, ...]], header: str = "pulse_jet,pulse_start_s,pulse_duration_s") -> Path:
    names = [f"delta_theta_{a}_rad" for a in "xyz"] + [f"delta_v_{a}_m_s" for a in "xyz"]
    lines = [",".join(["time_s", *names, header])]
    for row in range(max(150, len(pulses))):
        own = pulses[row] if row < len(pulses) else ("", "", "")
        imu = [f"{0.01 * (row + 1):.2f}", *["1e-5"] * 6] if row < 150 else [""] * 7
        lines.append(",".join([*imu, *map(str, own)]))
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def read(path: Path, vehicle: Vehicle = VEHICLE) -> telemetry.Log:
    return telemetry.read(logfile.read_table(path), vehicle)


def test_pulses_act_when_and_as_long_as_they_are_stated(tmp_path: Path) -> None:
    """Thrust of each, a cycle of delay later; one of 0.18 s lasts over four cycles and is one pulse with one rise."""
    log = read(log_of(tmp_path, PULSES))
    assert log.command_kind == "jets"
    np.testing.assert_allclose(log.command.sum(0), [0.21, 0.033], atol=1e-12)
    aligned = align(log, VEHICLE, 1.0, 0.0)
    done = aligned.channels.whole.sum(0)  # s of full thrust; a rise and a fall of 0 lose half of the rise
    np.testing.assert_allclose(done, [0.21 - 2 * 0.001, 0.033], atol=1e-9)
    middle = (aligned.start_s + aligned.duration_s / 2) @ aligned.channels.whole[:, 1] / done[1]
    assert abs(middle - (0.013 * (0.5632 + 0.0065) + 0.02 * (0.7904 + 0.01)) / 0.033) < 0.01
    # from the log's beginning on, all is known
    assert aligned.usable[2:].all()
    assert log.notices == ()


def test_there_may_be_more_pulses_than_records(tmp_path: Path) -> None:
    many = [("a", round(0.005 * n, 6), 0.001) for n in range(200)]
    log = read(log_of(tmp_path, many))
    assert len(log.time_s) == 150
    np.testing.assert_allclose(log.command.sum(0), [0.2, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        (("c", 0.4, 0.02), r"line 4, column pulse_jet: 'c' is not a jet of the vehicle file.*add it to \[\[jets\]\], or rename it"),
        (("a", "", 0.02), r"line 4, column pulse_start_s: the cell is empty, but other cells of the pulse are not; fill in all three"),
        (("a", 0.4, -0.02), r"line 4, column pulse_duration_s: -0.02: a duration must be 0 or more, in s; correct or remove the row"),
        (("a", "inf", 0.02), r"line 4, column pulse_start_s: inf: it must be a finite number of s"),
        (("a", 0.23, 0.02), r"line 4, column pulse_start_s: 0.23 s is within a pulse of the same jet, which lasts until 0.242 s; correct"),
        (("a", 0.4, 20), r"line 4, column pulse_duration_s: 20 s is longer than the log of 1.5 s; is it in seconds\?"),
    ],
)
def test_a_pulse_that_cannot_be_is_named(tmp_path: Path, row: tuple[object, object, object], problem: str) -> None:
    path = log_of(tmp_path, [*PULSES[:2], row])
    with pytest.raises(InputError, match=problem):
        read(path)


def test_columns_that_contradict_pulses_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="column 'pulse_duration_s' is missing, but 'pulse_jet' is present"):
        read(log_of(tmp_path, PULSES, "pulse_jet,pulse_start_s,lasting"))
    with pytest.raises(InputError, match="no pulse is within the IMU's time; bring both clocks to one epoch"):
        read(log_of(tmp_path, [("a", 1e3, 0.02)]))
    late = VEHICLE.model_copy(update={"cycle": VEHICLE.cycle.model_copy(update={"pulse_at": "end"})})
    with pytest.raises(InputError, match=r'pulse_at is "end"; leave cycle\.pulse_at out'):
        read(log_of(tmp_path, PULSES), late)
    wheel = {"name": "w", "axis": [1, 0, 0], "spin_inertia_kg_m2": 1e-3, "locked_in_inertia": False, "column": "torque", "start_rad_s": 0.0}
    turned = Vehicle.model_validate(VEHICLE.model_dump(by_alias=True, exclude_unset=True) | {"wheels": [wheel]})
    every = [(*one, 1e-3) for one in [*PULSES, *[("", "", "")] * 146]]
    with pytest.raises(InputError, match=r"the speed of wheel 'w' follows from its torque at all times.*log its speed instead"):
        read(log_of(tmp_path, every, "pulse_jet,pulse_start_s,pulse_duration_s,wheel_w_n_m"), turned)
