"""Unusable input: exit 3, one line on stderr that says where and what to do, nothing on stdout, nothing written."""

from __future__ import annotations

import json
import os
import random
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow import csv

from tests.commandline import massprop

SAMPLES = Path(__file__).parents[2] / "sample_logs"
NAN, INF = float("nan"), float("inf")
Edit = Callable[[Any], Any]


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def refused(folder: Path, *arguments: str | Path, names: Iterable[str | Path], out: Path | None = None) -> str:
    """Run ``massprop estimate``, check that it refuses as it should and that its message names all of ``names``; the message."""
    before = contents(folder)
    done = massprop(folder, "estimate", *arguments, "--out", out or folder / "out")
    assert "Traceback" not in done.stderr
    assert done.returncode == 3, f"exit {done.returncode}, stderr: {done.stderr}"
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1, f"{len(lines)} lines: {done.stderr}"
    assert lines[0].startswith("massprop: ")
    for name in names:
        assert re.search(rf"(?<!\w){re.escape(str(name))}(?!\w)", lines[0]), f"{str(name)!r} is not in: {lines[0]}"
    assert contents(folder) == before, "something was written"
    return lines[0]


def flight(sample: str = "free-flyer", rows: int = 100) -> Any:
    return pq.read_table(SAMPLES / sample / "log.parquet").slice(0, rows).replace_schema_metadata()


def save(table: Any, path: Path) -> Path:
    if path.suffix == ".csv":
        csv.write_csv(table, path, csv.WriteOptions(quoting_style="none"))
    else:
        pq.write_table(table, path)
    return path


def vehicle_text(sample: str = "free-flyer") -> str:
    return (SAMPLES / sample / "vehicle.toml").read_text(encoding="utf-8")


def save_vehicle(folder: Path, text: str | None = None) -> Path:
    path = folder / "vehicle.toml"
    path.write_text(vehicle_text() if text is None else text, encoding="utf-8")
    return path


def replaced(table: Any, column: str, values: list[Any], kind: Any) -> Any:
    return table.set_column(table.column_names.index(column), column, pa.array(values, kind))


def cell(column: str, row: int, value: float | None) -> Edit:
    def edit(table: Any) -> Any:
        values = table.column(column).to_pylist()
        values[row] = value
        return replaced(table, column, values, pa.float64())

    return edit


def text_cell(column: str, row: int, text: str) -> Edit:
    def edit(table: Any) -> Any:
        values = [str(value) for value in table.column(column).to_pylist()]
        values[row] = text
        return replaced(table, column, values, pa.string())

    return edit


def times(change: Callable[[int, float], float]) -> Edit:
    def edit(table: Any) -> Any:
        values = [change(row, value) for row, value in enumerate(table.column("time_s").to_pylist())]
        return replaced(table, "time_s", values, pa.float64())

    return edit


def renamed(old: str, new: str) -> Edit:
    return lambda table: table.rename_columns([new if name == old else name for name in table.column_names])


def without(*columns: str) -> Edit:
    return lambda table: table.drop_columns(list(columns))


def added(**columns: float) -> Edit:
    def edit(table: Any) -> Any:
        for name, value in columns.items():
            table = table.append_column(name, pa.array([value] * table.num_rows, pa.float64()))
        return table

    return edit


def both(first: Edit, second: Edit) -> Edit:
    return lambda table: second(first(table))


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
    "misses the column of a jet": BadLog(without("jet_yaw_p2_s"), None, ("'jet_yaw_p2_s' is missing", "nearest", "[columns]")),
    "misses a component of its wrench": BadLog(
        both(
            lambda table: table.select([name for name in table.column_names if not name.startswith("jet_")]),
            added(cmd_torque_x_n_m=0.0, cmd_torque_y_n_m=0.0, cmd_torque_z_n_m=0.0, cmd_force_x_n=0.0, cmd_force_y_n=0.0),
        ),
        None,
        ("'cmd_force_z_n' is missing", "nearest"),
    ),
    "has a column for a jet that the vehicle lacks": BadLog(
        added(jet_roll_p3_s=0.0), None, ("'jet_roll_p3_s'", "vehicle file lacks", "nearest", "Add it to the vehicle file")
    ),
    "has jets and a wrench": BadLog(added(cmd_torque_x_n_m=0.0), None, ("jet_*", "cmd_*", "keep the one kind")),
    "holds NaN in an IMU column": BadLog(
        cell("delta_theta_y_rad", 42, NAN), 42, ("column delta_theta_y_rad", "nan", "not a finite number", "mend or cut")
    ),
    "holds an empty IMU cell": BadLog(cell("delta_v_z_m_s", 42, None), 42, ("column delta_v_z_m_s", "mend or cut")),
    "holds infinity in an IMU column": BadLog(
        cell("delta_v_x_m_s", 17, -INF), 17, ("column delta_v_x_m_s", "-inf", "not a finite number", "mend or cut")
    ),
    "holds NaN in its time": BadLog(cell("time_s", 42, NAN), 42, ("column time_s", "nan", "not a finite number", "mend or cut")),
    "holds text in an IMU column": BadLog(
        text_cell("delta_theta_z_rad", 42, "abc"), 42, ("column delta_theta_z_rad", "'abc'", "not a number", "mend the cell")
    ),
    "holds text in a jet column": BadLog(
        text_cell("jet_roll_n2_s", 7, "off"), 7, ("column jet_roll_n2_s", "'off'", "not a number", "mend the cell")
    ),
    "holds text in its time": BadLog(
        text_cell("time_s", 3, "12:30:05"), 3, ("column time_s", "'12:30:05'", "not a number", "mend the cell")
    ),
    "has time that stands still": BadLog(
        times(lambda row, time: 2.1 if row == 42 else time), 42, ("column time_s", "stands still", "2.1 s", "cut the log")
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
    "has a negative on-time": BadLog(cell("jet_pitch_p1_s", 42, -0.01), 42, ("column jet_pitch_p1_s", "-0.01 s", "negative", "0 or more")),
    "has an on-time longer than the cycle": BadLog(
        cell("jet_pitch_p1_s", 42, 0.06), 42, ("column jet_pitch_p1_s", "0.06 s", "longer than the control cycle of 0.05 s", "in seconds")
    ),
    "has an infinite on-time": BadLog(
        cell("jet_pitch_p1_s", 42, INF), 42, ("column jet_pitch_p1_s", "inf", "not a finite number", "mend or cut")
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


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
@pytest.mark.parametrize("bad", BAD_LOGS.values(), ids=BAD_LOGS.keys())
def test_a_log_is_refused_that(bad: BadLog, suffix: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path, vehicle_text(bad.sample))
    log = save(bad.edit(flight(bad.sample)), tmp_path / f"log{suffix}")
    place = [] if bad.row is None else [f"line {bad.row + 2}" if suffix == ".csv" else f"row {bad.row}"]
    refused(tmp_path, log, names=[log, *place, *bad.names])


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


def test_a_log_with_an_unusable_cell_is_refused_in_the_same_words_with_json_and_quiet(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(cell("delta_theta_y_rad", 42, NAN)(flight()), tmp_path / "log.parquet")
    plain = refused(tmp_path, log, names=[log])
    assert refused(tmp_path, log, "--json", "-q", names=[log]) == plain


# Vehicle files


def test_a_vehicle_file_that_is_named_but_missing_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    missing = tmp_path / "other.toml"
    refused(tmp_path, log, "--vehicle", missing, names=[missing, "no such vehicle file", "check the path"])


def test_a_log_without_a_vehicle_file_beside_it_is_refused(tmp_path: Path) -> None:
    log = save(flight(), tmp_path / "log.parquet")
    refused(tmp_path, log, names=[log, "no vehicle file", "log.vehicle.toml", "vehicle.toml", "--vehicle"])


def test_a_folder_instead_of_a_vehicle_file_is_refused(tmp_path: Path) -> None:
    log = save(flight(), tmp_path / "log.parquet")
    refused(tmp_path, log, "--vehicle", tmp_path, names=[tmp_path, "is a folder", "name the vehicle file itself"])


def test_a_vehicle_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    log = save(flight(), tmp_path / "log.parquet")
    refused(tmp_path, log, "--vehicle", log, names=[log, "not a text file", "UTF-8 TOML"])


def test_an_invalid_vehicle_inside_a_parquet_file_is_refused(tmp_path: Path) -> None:
    text = vehicle_text().replace("period_s = 0.05", "period_s = -0.05")
    log = save(flight().replace_schema_metadata({"massprop.vehicle": text}), tmp_path / "log.parquet")
    refused(tmp_path, log, names=[log, "embedded vehicle", "line 5", "cycle.period_s", "-0.05"])


@dataclass(frozen=True)
class BadVehicle:
    """A replacement that spoils a good vehicle file, a text on the line to name, and what else the message must name."""

    old: str
    new: str
    at: str | None
    names: tuple[str, ...]


END = "force_n = [0.0, 0.0, -2.22411080763025]\n"
ROLL_N1 = '[[jets]]\nname = "roll_n1"\nposition_m = [0.0, 0.1475, 0.0]\nforce_n = [0.0, 0.0, -1.112055403815125]\n'
ROTATION = "[[0.9393727128473789, 0.34289780745545134, 0.0], [-0.34289780745545134, 0.9393727128473789, 0.0], [0.0, 0.0, 1.0]]"
BAD_VEHICLES = {
    "is not TOML": BadVehicle("period_s = 0.05", "period_s = = 0.05", "period_s = = 0.05", ("not valid TOML",)),
    "sets a key twice": BadVehicle("period_s = 0.05", "period_s = 0.05\nperiod_s = 0.1", "period_s = 0.1", ("not valid TOML",)),
    "is empty": BadVehicle(vehicle_text(), "", None, ("'schema' is missing", "add it")),
    "has another schema": BadVehicle("schema = 1", "schema = 2", "schema = 2", ("schema = 2", "be 1")),
    "has an unknown key": BadVehicle(
        "command_delay_cycles",
        "command_delay_cylces",
        "command_delay_cylces",
        ("'cycle.command_delay_cylces'", "nearest", "'command_delay_cycles'"),
    ),
    "misspells a required key": BadVehicle("period_s", "perod_s", "perod_s", ("unknown key 'cycle.perod_s'", "nearest", "'period_s'")),
    "has an unknown key in one of its jets": BadVehicle(
        ROLL_N1, ROLL_N1 + "rise_ms = 3\n", "rise_ms = 3", ("unknown key", "rise_ms", "nearest", "'rise_s'")
    ),
    "has an unknown table": BadVehicle(
        END, END + "[estimater]\nbins_per_cycle = 10\n", "[estimater]", ("unknown key 'estimater'", "nearest", "'estimator'")
    ),
    "has an unknown key in a table within a table": BadVehicle(
        END, END + "[estimator.thesis]\np3 = 10.0\n", "p3 = 10.0", ("unknown key 'estimator.thesis.p3'", "nearest")
    ),
    "knows an unknown quantity": BadVehicle(
        END, END + "[known]\nmas = { value = 22.0, sigma = 0.01 }\n", "mas = {", ("known.mas", "nearest", "'mass'")
    ),
    "knows a negative mass": BadVehicle(
        END, END + "[known]\nmass = { value = -22.0, sigma = 0.01 }\n", "mass = {", ("known.mass", "-22.0", "greater than 0")
    ),
    "renames an unknown column": BadVehicle(
        END, END + '[columns]\ntiem_s = { from = "time_s" }\n', "tiem_s = {", ("columns.tiem_s", "nearest", "'time_s'")
    ),
    "has text for a number": BadVehicle(
        "period_s = 0.05", 'period_s = "fast"', 'period_s = "fast"', ("cycle.period_s", "'fast'", "number")
    ),
    "has a number for text": BadVehicle('name = "roll_n1"', "name = 7", "name = 7", ("name", "7", "string")),
    "has a number for a table": BadVehicle("schema = 1", "schema = 1\nthrust = 5", "thrust = 5", ("thrust = 5", "table")),
    "has two components in a position": BadVehicle(
        "position_m = [0.1, -0.06, 0.12]", "position_m = [0.1, -0.06]", "position_m = [0.1, -0.06]", ("imu.position_m", "missing")
    ),
    "has a cycle of no length": BadVehicle("period_s = 0.05", "period_s = 0", "period_s = 0", ("cycle.period_s = 0", "greater than 0")),
    "misses the length of its cycle": BadVehicle("period_s = 0.05\n", "", "[cycle]", ("'cycle.period_s' is missing", "add it")),
    "misses the force of a jet": BadVehicle(
        ROLL_N1,
        '[[jets]]\n# here\nname = "roll_n1"\nposition_m = [0.0, 0.1475, 0.0]\n',
        "[[jets]]\n# here",
        ("force_n", "is missing", "add it"),
    ),
    "holds NaN in a number": BadVehicle("period_s = 0.05", "period_s = nan", "period_s = nan", ("cycle.period_s = nan", "finite")),
    "holds infinity in a number": BadVehicle("period_s = 0.05", "period_s = inf", "period_s = inf", ("cycle.period_s = inf", "finite")),
    "holds NaN in a vector": BadVehicle(
        "position_m = [0.1, -0.06, 0.12]", "position_m = [0.1, nan, 0.12]", "position_m = [0.1, nan", ("imu.position_m", "nan", "finite")
    ),
    "has an IMU that is scaled instead of turned": BadVehicle(
        ROTATION,
        "[[1, 0, 0], [0, 1, 0], [0, 0, 2]]",
        "body_from_imu",
        ("body_from_imu", "not a rotation matrix", "orthonormal", "determinant +1"),
    ),
    "has an IMU that is mirrored": BadVehicle(
        ROTATION, "[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "body_from_imu", ("body_from_imu", "not a rotation matrix", "determinant +1")
    ),
    "has two jets of one name": BadVehicle(
        'name = "roll_p2"', 'name = "roll_p1"', None, ("jet", "'roll_p1'", "used twice", "give each its own")
    ),
    "has two phases of one name": BadVehicle(
        END,
        END + '[[phases]]\nname = "a"\nstart_s = 0\nend_s = 1\n[[phases]]\nname = "a"\nstart_s = 1\nend_s = 2\n',
        None,
        ("phase", "'a'", "used twice", "give each its own"),
    ),
    "has a phase that ends before its start": BadVehicle(
        END, END + '[[phases]]\nname = "late"\nstart_s = 3.0\nend_s = 2.0\n', "[[phases]]", ("'late'", "ends at 2.0 s", "start at 3.0 s")
    ),
    "docks between phases that it lacks": BadVehicle(
        END, END + '[docking]\nbefore = "single"\nafter = "combined"\n', None, ("docking", "'single'", "[[phases]]")
    ),
    "has a product of inertia without its convention": BadVehicle(
        END, END + "[nominal]\nixy = 0.04\n", "[nominal]", ("nominal", "poi_convention", '"tensor"', '"positive_integral"')
    ),
    "has a convention that is none": BadVehicle(
        END,
        END + '[nominal]\npoi_convention = "negative"\n',
        "poi_convention",
        ("nominal.poi_convention", "'negative'", "'tensor'", "'positive_integral'"),
    ),
}


@pytest.mark.parametrize("bad", BAD_VEHICLES.values(), ids=BAD_VEHICLES.keys())
def test_a_vehicle_file_is_refused_that(bad: BadVehicle, tmp_path: Path) -> None:
    good = vehicle_text()
    assert bad.old in good
    text = good.replace(bad.old, bad.new, 1)
    log, vehicle = save(flight(), tmp_path / "log.parquet"), save_vehicle(tmp_path, text)
    place = [] if bad.at is None else [f"line {text[: text.index(bad.at)].count(chr(10)) + 1}"]
    refused(tmp_path, log, names=[vehicle, *place, *bad.names])


def test_a_vehicle_file_that_renames_a_column_the_log_lacks_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path, vehicle_text() + '[columns]\ntime_s = { from = "t_ms", scale = 1e-3 }\n')
    log = save(flight(), tmp_path / "log.parquet")
    refused(tmp_path, log, names=[log, "'t_ms' is missing", "nearest", "[columns]"])


# A log and its vehicle that do not fit


@pytest.mark.parametrize(("start_s", "end_s"), [(100, 200), (-20, -10), (3.02, 3.08)], ids=["after the log", "before the log", "too short"])
def test_a_phase_that_holds_nothing_of_the_log_is_refused(start_s: float, end_s: float, tmp_path: Path) -> None:
    save_vehicle(tmp_path, vehicle_text() + f'[[phases]]\nname = "cruise"\nstart_s = {start_s}\nend_s = {end_s}\n')
    log = save(flight(), tmp_path / "log.parquet")
    refused(tmp_path, log, names=[log, "phase 'cruise'", f"{start_s} to {end_s} s", "from 0 to 5 s", "[[phases]]"])


def test_a_log_shorter_than_the_command_delay_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    refused(tmp_path, log, "--delay", "200", names=[log, "lasts 5 s", "too short", "delay of 10 s", "cycle.command_delay_cycles"])


def test_a_log_without_commands_is_refused(tmp_path: Path) -> None:
    save_vehicle(tmp_path, vehicle_text().partition("[[jets]]")[0])
    log = save(flight().select(range(7)), tmp_path / "log.parquet")
    refused(tmp_path, log, names=[log, "no commands", "jet_*_s", "cmd_torque_*", "[[jets]]"])


# Options


BAD_SETTINGS = [
    (["--vehicle", "vehicle.toml", "--set", "cycle.perod_s=1"], ["setting", "unknown key 'cycle.perod_s'", "nearest", "'period_s'"]),
    (["--set", "estimatr.method=thesis"], ["setting", "unknown key 'estimatr'", "nearest", "'estimator'"]),
    (["--set", "convergence.count"], ["setting convergence.count", "KEY=VALUE", "instance convergence.count=50"]),
    (["--set", "=5"], ["setting =5", "KEY=VALUE"]),
    (["--set", "convergence.count=many"], ["setting", "convergence.count", "'many'", "integer"]),
    (["--set", "convergence.count.x=1", "--set", "convergence.count=5"], ["setting", "convergence.count"]),
    (["--set", "name.x=1"], ["setting name.x=1", "'name'", "is a value, not a table"]),
    (["--set", "jets.99.rise_s=0.003"], ["setting jets.99.rise_s=0.003", "'99'", "a list of 18", "count from 0"]),
    (["--set", "cycle.period_s=nan"], ["setting", "cycle.period_s = nan", "finite"]),
    (["--delay", "soon"], ["--delay", "'soon'", "number"]),
    (["--delay", "-1"], ["--delay", "-1", "0"]),
]


@pytest.mark.parametrize(("settings", "names"), BAD_SETTINGS, ids=[" ".join(settings) for settings, _ in BAD_SETTINGS])
def test_a_setting_is_refused_that_can_not_be_used(settings: list[str], names: list[str], tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    refused(tmp_path, save(flight(), tmp_path / "log.parquet"), *settings, names=names)


@pytest.mark.parametrize("below", ["", "campaign/one"], ids=["in its place", "in the place of its parent"])
def test_a_result_folder_with_a_file_in_the_way_is_refused(below: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    (tmp_path / "taken").write_text("mine", encoding="utf-8")
    out = tmp_path / "taken" / below
    refused(tmp_path, log, "-q", out=out, names=[out, "cannot be written", "choose another folder (--out)"])


BAD_LINES = [
    (["estimate", "log.parquet", "--fast"], ["--fast"]),
    (["estimate", "log.parquet", "--method", "fancy"], ["--method", "fancy", "default", "thesis"]),
    (["estimate", "log.parquet", "--require"], ["--require"]),
    (["estimate", "log.parquet", "log.parquet"], ["log.parquet"]),
    (["estimate"], ["LOG"]),
    (["estimat", "log.parquet"], ["estimat"]),
    (["schema", "lgo"], ["lgo", "log"]),
]


@pytest.mark.parametrize(("arguments", "names"), BAD_LINES, ids=[" ".join(arguments) for arguments, _ in BAD_LINES])
def test_a_command_line_that_makes_no_sense_is_a_usage_error(arguments: list[str], names: list[str], tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    save(flight(), tmp_path / "log.parquet")
    before = contents(tmp_path)
    done = massprop(tmp_path, *arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    for name in names:
        assert name in done.stderr
    assert contents(tmp_path) == before, "something was written"


@pytest.mark.parametrize("required", ["ixx,inertia", "Masses", "mass;ixx", "ixx,"])
def test_requiring_an_unknown_quantity_is_a_usage_error(required: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    before = contents(tmp_path)
    done = massprop(tmp_path, "estimate", log, "--out", tmp_path / "out", "--require", required)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("massprop: --require ")
    for name in (required.rpartition(",")[2], "ixx, ixy, ixz", "mass or all"):
        assert name in done.stderr
    assert contents(tmp_path) == before, "something was written"


@pytest.mark.parametrize("required", ["mass", "all"])
def test_a_required_quantity_that_is_not_converged_fails_with_its_outputs_written(required: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log, out = save(flight(rows=60), tmp_path / "log.parquet"), tmp_path / "out"
    done = massprop(tmp_path, "estimate", log, "--out", out, "-q", "--require", required)
    assert done.returncode == 4
    assert done.stdout == ""
    assert sorted(path.name for path in out.iterdir()) == ["history.parquet", "result.json", "run.json"]
    lines = done.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("massprop: required but not converged: ")
    estimates = json.loads((out / "result.json").read_text(encoding="utf-8"))["phases"][0]["estimates"]
    missed = [name for name, found in estimates.items() if found["verdict"] != "converged" and required in (name, "all")]
    assert "mass" in missed
    for name in missed:
        assert f"{name} in phase all is {estimates[name]['verdict']} (" in lines[0]
