"""Unusable vehicle files, and logs that don't fit theirs: exit 3, one line, nothing written."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from massprop_cli.inputs.equipment import Environment, Imu
from tests.refusal import (
    flight,
    refused,
    save,
    save_vehicle,
    vehicle_text,
)


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
    "has phases that overlap": BadVehicle(
        END,
        END + '[[phases]]\nname = "one"\nstart_s = 0.0\nend_s = 3.0\n[[phases]]\nname = "two"\nstart_s = 2.9\nend_s = 5.0\n',
        None,
        ("'one' (0 to 3 s)", "'two' (2.9 to 5 s)", "overlap", "end one where the other starts"),
    ),
    "has an air bearing without gravity": BadVehicle(
        'kind = "free"', 'kind = "air_bearing"\ngravity_m_s2 = 0.0', "[environment]", ("gravity_m_s2 = 0", 'kind = "free"')
    ),
    "has a failing jet that it doesn't have": BadVehicle(
        END, END + '[[thrust.failures]]\njet = "roll_p9"\n', None, ("thrust.failures", "'roll_p9'", "the nearest is 'roll_p2'")
    ),
    "has a failure that never happens": BadVehicle(
        END,
        END + '[[thrust.failures]]\njet = "roll_p1"\nstart_s = 2.0\nend_s = 1.0\n',
        "[[thrust.failures]]",
        ("the failure of jet 'roll_p1' from 2 to 1 s has no duration", "correct start_s or end_s"),
    ),
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
    "has a cycle of no length": BadVehicle(
        "period_s = 0.05", "period_s = 0", "period_s = 0", ("cycle.period_s = 0: must be greater than 1e-30",)
    ),
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


def test_rotations_of_few_digits_are_the_nearest_ones() -> None:
    environment = Environment(initial_attitude_wxyz=(0.9659, 0.1, 0.2, 0.13))
    assert np.linalg.norm(environment.initial_attitude_wxyz) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(environment.initial_attitude_wxyz, np.array([0.9659, 0.1, 0.2, 0.13]) / np.sqrt(0.99986281), rtol=1e-12)
    imu = Imu(body_from_imu=((0.707, -0.707, 0), (0.707, 0.707, 0), (0, 0, 1)))
    turn = np.array(imu.body_from_imu)
    assert Imu.model_validate(imu.model_dump()) == imu
    np.testing.assert_allclose(turn, np.array([[1, -1, 0], [1, 1, 0], [0, 0, 2**0.5]]) / 2**0.5, atol=1e-15)
    with pytest.raises(ValidationError, match=r"has norm 1\.414, not 1"):
        Environment(initial_attitude_wxyz=(1, 0, 0, 1))
