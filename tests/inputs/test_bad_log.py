"""Unusable logs: exit 3, one line on stderr that says where and what to do, nothing on stdout, nothing written."""

import os
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.telemetry import Log, read
from tests.refusal import (
    INF,
    NAN,
    Edit,
    added,
    both,
    cell,
    cells,
    flight,
    refused,
    renamed,
    replaced,
    save,
    save_vehicle,
    text_cell,
    times,
    vehicle_text,
    without,
)


@dataclass(frozen=True)
class BadLog:
    """An edit that spoils a good log, the row it spoils, and what the message must name beside file and row."""

    edit: Edit
    row: int | None
    names: tuple[str, ...]
    sample: str = "free-flyer"


QUATERNION = added(quat_w=1.0, quat_x=0.0, quat_y=0.0, quat_z=0.0)
BAD_LOGS = {
    "has no rows": BadLog(lambda table: table.slice(0, 0), None, ("no rows", "record the log again")),
    "has one row": BadLog(lambda table: table.slice(0, 1), None, ("one row", "two control cycles")),
    "misses an IMU column": BadLog(
        renamed("delta_v_y_m_s", "delta_v_y_ms"),
        None,
        ("'delta_v_y_m_s' is missing", "nearest", "'delta_v_y_ms'", "rename it", "[columns]"),
    ),
    "misses the time": BadLog(renamed("time_s", "time"), None, ("'time_s' is missing", "nearest", "'time'", "rename it", "[columns]")),
    "misses the column of a jet": BadLog(without("jet_yaw_p2_s"), None, ("'jet_yaw_p2_s' is missing", "add it", "never fired")),
    "misses a component of its wrench": BadLog(
        both(
            lambda table: table.select([name for name in table.column_names if not name.startswith("jet_")]),
            added(cmd_torque_x_n_m=0.0, cmd_torque_y_n_m=0.0, cmd_torque_z_n_m=0.0, cmd_force_x_n=0.0, cmd_force_y_n=0.0),
        ),
        None,
        ("'cmd_force_z_n' is missing", "add it"),
    ),
    "has a column for a jet that the vehicle lacks": BadLog(
        added(jet_roll_p3_s=0.0), None, ("'jet_roll_p3_s'", "vehicle file lacks", "nearest", "Add it to the vehicle file")
    ),
    "has jets and a wrench": BadLog(added(cmd_torque_x_n_m=0.0), None, ("jet_*", "cmd_*", "keep the kind")),
    "holds NaN in an IMU column": BadLog(
        cells("delta_theta_y_rad", 42, NAN), 42, ("column delta_theta_y_rad", "nan", "not a finite number", "correct or cut")
    ),
    "holds an empty IMU cell": BadLog(cells("delta_v_z_m_s", 42, None), 42, ("column delta_v_z_m_s", "correct or cut")),
    "holds infinity in an IMU column": BadLog(
        cell("delta_v_x_m_s", 17, -INF), 17, ("column delta_v_x_m_s", "-inf", "not a finite number", "correct or cut")
    ),
    "has two records of one moment": BadLog(
        lambda table: cell("time_s", 42, table.column("time_s")[41].as_py() + 1e-9)(table),
        42,
        ("column time_s", "comes 1e-09 s after the record before", "Is a record there twice?"),
    ),
    "holds NaN in its time": BadLog(cell("time_s", 42, NAN), 42, ("column time_s", "nan", "not a finite number", "correct or cut")),
    "counts time from too far away": BadLog(
        times(lambda _, time: time + 1e12), None, ("column time_s", "steps of 0.00012 s", "subtract the start time from all times")
    ),
    "holds text in an IMU column": BadLog(
        text_cell("delta_theta_z_rad", 42, "abc"), 42, ("column delta_theta_z_rad", "'abc'", "not a number", "correct the cell")
    ),
    "holds text in a jet column": BadLog(
        text_cell("jet_roll_n2_s", 7, "off"), 7, ("column jet_roll_n2_s", "'off'", "not a number", "correct the cell")
    ),
    "holds text in its time": BadLog(
        text_cell("time_s", 3, "12:30:05"), 3, ("column time_s", "'12:30:05'", "not a number", "correct the cell")
    ),
    "has time that stands still": BadLog(
        times(lambda row, time: 2.1 if row == 42 else time), 42, ("column time_s", "time repeats", "2.1 s", "cut the log")
    ),
    "has time that goes back": BadLog(
        times(lambda row, time: 1.99 if row == 42 else time), 42, ("column time_s", "goes back", "1.99 s", "2.1 s", "sort or cut")
    ),
    "has a gap in time": BadLog(
        times(lambda row, time: time + 0.4 if row >= 42 else time),
        42,
        ("column time_s", "gap of 0.45 s", "after 2.1 s", "median interval 0.05 s", "split the log there"),
    ),
    "has time in milliseconds": BadLog(
        times(lambda _, time: 1e3 * time),
        None,
        ("column time_s", "interval of 50 s", "0.05 s", "in seconds", "[columns]", "cycle.period_s"),
    ),
    "feels no gravity on an air bearing": BadLog(
        both(
            without("delta_v_x_m_s", "delta_v_y_m_s", "delta_v_z_m_s"),
            added(delta_v_x_m_s=0.0005, delta_v_y_m_s=0.0001, delta_v_z_m_s=0.0001),
        ),
        None,
        (
            "reads 0.0104 m/s^2 (median)",
            "gravity, 9.807 m/s^2",
            'environment.kind = "free" instead of "air_bearing"',
            "specific force that includes gravity",
        ),
        "air-bearing",
    ),
    "has a negative on-time": BadLog(cell("jet_pitch_p1_s", 42, -0.01), 42, ("column jet_pitch_p1_s", "-0.01 s", "negative", "0 or more")),
    "has an on-time longer than the cycle": BadLog(
        cell("jet_pitch_p1_s", 42, 0.06), 42, ("column jet_pitch_p1_s", "0.06 s", "longer than the control cycle of 0.05 s", "in seconds")
    ),
    "has an infinite on-time": BadLog(
        cell("jet_pitch_p1_s", 42, INF), 42, ("column jet_pitch_p1_s", "inf", "not a finite number", "correct or cut")
    ),
    "misses a command": BadLog(cell("jet_yaw_n1_s", 42, None), 42, ("column jet_yaw_n1_s", "no command", "first row", "write one")),
    "misses a command in the first row of a cycle": BadLog(
        cell("jet_yaw_n1_s", 60, None), 60, ("column jet_yaw_n1_s", "no command", "first row", "write one"), "high-rate"
    ),
    "has a command that differs within its cycle": BadLog(
        both(cell("jet_yaw_n1_s", 60, 0.02), cell("jet_yaw_n1_s", 65, 0.01)),
        65,
        ("column jet_yaw_n1_s", "0.01", "differs from 0.02", "first row", "check cycle.period_s"),
        "high-rate",
    ),
    "has a quaternion that is not unit": BadLog(
        both(QUATERNION, cell("quat_w", 42, 0.5)), 42, ("column quat_w", "norm is 0.5", "not 1", "wxyz, world from body")
    ),
    "misses a part of its quaternion": BadLog(both(QUATERNION, renamed("quat_y", "quat_j")), None, ("'quat_y' is missing", "nearest")),
}


def kinds(name: str, bad: BadLog) -> list[Any]:
    """Of both kinds of file; by default of that whose reader has more to do with it."""
    first, second = (".parquet", ".csv") if bad.row is None else (".csv", ".parquet")
    return [
        pytest.param(bad, first, id=f"{name}-{first}"),
        pytest.param(bad, second, id=f"{name}-{second}", marks=pytest.mark.thorough),
    ]


@pytest.mark.parametrize(("bad", "suffix"), [case for name, bad in BAD_LOGS.items() for case in kinds(name, bad)])
def test_a_log_is_refused_that(bad: BadLog, suffix: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path, vehicle_text(bad.sample))
    log = save(bad.edit(flight(bad.sample)), tmp_path / f"log{suffix}")
    place = [] if bad.row is None else [f"line {bad.row + 2}" if suffix == ".csv" else f"row {bad.row}"]
    refused(tmp_path, log, names=[log, *place, *bad.names])


def taken(log: Path) -> Log:
    """A log that is not refused, read beside its vehicle file."""
    return read(read_table(log), vehiclefile.load(log.parent / "vehicle.toml").vehicle)


@pytest.mark.parametrize("tick", [True, False])
@pytest.mark.parametrize("factor", [0.01, 0.02])
def test_on_times_a_hundredth_as_long_are_refused_by_their_longest(factor: float, tick: bool, tmp_path: Path) -> None:
    """Mass and inertia would be as small, and the motion fits."""
    text = vehicle_text()
    save_vehicle(tmp_path, text if tick else text.replace("pwm_tick_s = 0.0025\n", ""))
    table = flight(rows=200)
    for name in [name for name in table.column_names if name.startswith("jet_")]:
        table = replaced(table, name, [factor * on for on in table.column(name).to_pylist()], pa.float64())
    log = save(table, tmp_path / "log.parquet")
    if tick or factor < 0.015:
        why = "below cycle.pwm_tick_s = 0.0025 s" if tick else "1 % of the control cycle of 0.05 s"
        refused(tmp_path, log, names=[log, "is the longest on-time of the log", why, "is it in seconds?"])
    else:  # a valve may open for 1 ms at most
        assert taken(log).rows == 200


def test_on_times_of_whole_records_in_each_of_a_cycle_are_refused(tmp_path: Path) -> None:
    """Counted once a cycle they make a vehicle of half the mass; where the cells of the other records are empty, one was executed."""
    save_vehicle(tmp_path, vehicle_text().replace("period_s = 0.05", "period_s = 0.1"))
    table = flight(rows=200)
    for name in [name for name in table.column_names if name.startswith("jet_")]:
        held = np.repeat(table.column(name).to_numpy()[::2], 2)
        table = replaced(table, name, held.tolist(), pa.float64())
    log = save(table, tmp_path / "log.parquet")
    once = ("exactly one record", "each of the 2 records", "state cycle.period_s = 0.05", "leave the other cells empty")
    refused(tmp_path, log, names=[log, "0.05 s is the longest on-time", *once])
    for name in [name for name in table.column_names if name.startswith("jet_")]:
        table = replaced(table, name, [on if i % 2 == 0 else None for i, on in enumerate(table.column(name).to_pylist())], pa.float64())
    assert taken(save(table, log)).records_per_cycle == 2


def test_a_command_out_of_place_is_traced_to_the_record_that_was_lost(tmp_path: Path) -> None:
    """Where the clock is said to be right, and what is missing is no whole record."""
    save_vehicle(tmp_path, vehicle_text("high-rate").replace("[imu]", "[imu]\nclock_even = false"))
    table = flight("high-rate", 1600)
    later = times(lambda row, time: time - 0.001 if row >= 1205 else time)(pa.concat_tables([table.slice(0, 1205), table.slice(1206)]))
    log = save(later, tmp_path / "log.parquet")
    lost = "or a record was lost before row 1205, 0.004 s after the one above it: split the log there"
    refused(tmp_path, log, names=[log, lost])


def test_a_jet_without_a_column_takes_no_other_jets(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight().drop_columns(["jet_divert_zn_s"]), tmp_path / "log.parquet")
    refused(
        tmp_path,
        log,
        names=["'jet_divert_zn_s' is missing; add it, with 0 in each row if that jet never fired"],
    )


def test_jets_that_are_never_off_are_refused_with_what_they_idle_at(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    table = flight(rows=200)
    for name in [name for name in table.column_names if name.startswith("jet_")]:
        table = replaced(table, name, [0.01 + 0.5 * on for on in table.column(name).to_pylist()], pa.float64())
    log = save(table, tmp_path / "log.parquet")
    refused(
        tmp_path, log, names=[log, "0.01 s is the on-time of most jets in most cycles", "an idle jet must have 0", "offset under its table"]
    )


def test_a_missing_log_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    refused(tmp_path, tmp_path / "nowhere.parquet", names=[tmp_path / "nowhere.parquet", "no such file", "check the path"])
    refused(tmp_path, "s3://store/nowhere.parquet", names=["nowhere.parquet", "no such file", "massprop batch reads URLs"])


@pytest.mark.parametrize("name", ["log", "log.parquet"])
def test_a_folder_instead_of_a_log_is_refused(name: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = tmp_path / name
    log.mkdir()
    refused(tmp_path, log, names=[log, "is a folder", "name the log file itself", f"massprop batch {log}"])


def test_a_log_whose_name_no_result_could_hold_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet").rename(tmp_path / os.fsdecode(b"l\xff.parquet"))
    refused(tmp_path, log, names=["the file's name is not UTF-8; rename it"])


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_an_empty_file_is_refused(suffix: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = tmp_path / f"log{suffix}"
    log.touch()
    refused(tmp_path, log, names=[log, "empty", "record the log again"])


def test_a_csv_file_with_nothing_but_a_header_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = tmp_path / "log.csv"
    log.write_text(",".join(flight().column_names), encoding="utf-8")
    refused(tmp_path, log, names=[log, "a header but no rows", "record the log again"])


def test_a_truncated_parquet_file_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    data = log.read_bytes()
    log.write_bytes(data[: len(data) // 2])
    refused(tmp_path, log, names=[log, "not a readable Parquet file", "copy it again"])


def test_a_parquet_file_damaged_in_the_middle_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    data = log.read_bytes()
    log.write_bytes(data[:4] + b"\xff" * (len(data) // 2) + data[4 + len(data) // 2 :])
    refused(tmp_path, log, names=[log, "not a readable Parquet file", "copy it again"])


def test_random_bytes_as_a_parquet_file_are_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = tmp_path / "log.parquet"
    log.write_bytes(random.Random(1).randbytes(5000))
    refused(tmp_path, log, names=[log, "not a readable Parquet file", "copy it again"])


def test_random_bytes_as_a_csv_file_are_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = tmp_path / "log.csv"
    log.write_bytes(random.Random(1).randbytes(5000))
    refused(tmp_path, log, names=[log, "not a readable CSV file"])


def test_a_csv_line_with_a_cell_too_few_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.csv")
    lines = log.read_text(encoding="utf-8").splitlines()
    lines[43] = lines[43].rpartition(",")[0]
    log.write_text("\n".join(lines) + "\n", encoding="utf-8")
    refused(tmp_path, log, names=[log, "line 44", "25", "24"])


def test_blank_lines_of_a_csv_file_count_in_the_line_that_is_named(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(cell("delta_theta_y_rad", 42, INF)(flight()), tmp_path / "log.csv")
    lines = log.read_text(encoding="utf-8").splitlines()
    log.write_text("\n".join([*lines[:20], "", *lines[20:]]) + "\n", encoding="utf-8")
    refused(tmp_path, log, names=[log, "line 45", "column delta_theta_y_rad", "inf"])


@pytest.mark.parametrize("name", ["log.txt", "log.json", "log"])
def test_a_log_of_an_unknown_kind_is_refused(name: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = tmp_path / name
    save(flight(), tmp_path / "log.csv").rename(log)
    refused(tmp_path, log, names=[log, f"'{log.suffix}'", ".parquet or .csv"])


def test_a_csv_column_that_stands_twice_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(renamed("delta_v_z_m_s", "delta_v_y_m_s")(flight()), tmp_path / "log.csv")
    refused(tmp_path, log, names=[log, "line 1", "'delta_v_y_m_s'", "twice", "rename one"])


def test_a_parquet_column_that_stands_twice_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    table = flight()
    log = save(table.append_column("delta_v_y_m_s", table.column("delta_v_z_m_s")), tmp_path / "log.parquet")
    refused(tmp_path, log, names=[log, "'delta_v_y_m_s'", "twice", "rename one"])


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_a_reading_to_be_left_out_that_is_none_of_the_log_is_refused(sensor: str, tmp_path: Path) -> None:
    """It had been passed over, and what was meant stayed in use."""
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    first, last = flight()["time_s"][0].as_py(), flight()["time_s"][-1].as_py()
    key = f"imu.{sensor}_outliers_s"
    refused(tmp_path, log, "--set", f"{key}=[{first}, 1000]", names=[log, f"{key} has 1000 s", f"the nearest is at {last:.9g} s"])
    refused(tmp_path, log, "--set", f"{key}=[-3.5]", names=[log, f"{key} has -3.5 s", f"the nearest is at {first:.9g} s"])


def test_a_log_with_an_unusable_cell_is_refused_in_the_same_words_with_json_and_quiet(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(cells("delta_theta_y_rad", 42, NAN)(flight()), tmp_path / "log.parquet")
    plain = refused(tmp_path, log, names=[log])
    assert refused(tmp_path, log, "--json", "-q", names=[log]) == plain
