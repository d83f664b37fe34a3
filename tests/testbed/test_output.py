"""Logs of simulated flights, as files and in hand."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from massprop_cli.cli import app
from massprop_cli.inputs import columns, vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.telemetry import read
from massprop_cli.testbed import output, simulate
from massprop_cli.testbed.motion import to_world
from massprop_cli.testbed.scenario import Scenario
from tests.testbed.test_simulate import SMALL, quiet, source


@pytest.mark.seeds
@pytest.mark.thorough
def test_csv_and_parquet_hold_the_same_log(tmp_path: Path) -> None:
    runner = CliRunner()
    more = ["--set", "sensors.records_per_cycle=4", "--set", "sensors.log_attitude=true", "--set", "duration_cycles=1800"]
    for flag, name in (("--csv", "csv"), ("-q", "parquet")):
        result = runner.invoke(app, ["simulate", "docking", "--out", str(tmp_path / name), flag, *more])
        assert result.exit_code == 0, result.output
    used = vehiclefile.load(tmp_path / "csv" / "vehicle.toml").vehicle
    logs = [read(read_table(tmp_path / kind / f"log.{kind}"), used) for kind in ("csv", "parquet")]
    for name in ("time_s", "delta_theta_imu_rad", "delta_v_imu_m_s", "command", "attitude_wxyz"):
        assert np.array_equal(getattr(logs[0], name), getattr(logs[1], name))
    table = pq.ParquetFile(tmp_path / "parquet" / "log.parquet").read(use_threads=False)
    events = table.column(columns.EVENT).to_pylist()
    assert [(row, text) for row, text in enumerate(events) if text] == [(1800, "dock"), (2400, "reset")]
    assert b"massprop.vehicle" in table.schema.metadata
    assert tomllib.loads(table.schema.metadata[b"massprop.vehicle"].decode()) == tomllib.loads(
        (tmp_path / "csv" / "vehicle.toml").read_text()
    )


def test_a_flights_log_is_what_reading_its_file_gives(tmp_path: Path) -> None:
    flown = simulate.fly(source(sensors={"records_per_cycle": 4, "log_attitude": True}), [1])
    output.write(flown, 0, Scenario.model_validate(SMALL | {"sensors": {"records_per_cycle": 4, "log_attitude": True}}), tmp_path)
    kept, in_hand = read(read_table(tmp_path / "log.parquet"), flown.vehicle), flown.log(0)
    for name in ("time_s", "delta_theta_imu_rad", "delta_v_imu_m_s"):
        assert np.array_equal(getattr(kept, name), getattr(in_hand, name))
    for name in ("interval_s", "command", "attitude_wxyz"):
        assert np.allclose(getattr(kept, name), getattr(in_hand, name), rtol=0, atol=1e-12)
    assert (kept.rows, kept.records_per_cycle, kept.command_kind) == (in_hand.rows, in_hand.records_per_cycle, in_hand.command_kind)


def test_logged_attitude_turns_with_the_logged_increments() -> None:
    flown = simulate.fly(source(sensors=quiet(log_attitude=True, records_per_cycle=20)), [1])
    table = output.log_table(flown, 0, Scenario.model_validate(SMALL | {"sensors": quiet(log_attitude=True, records_per_cycle=20)}))
    attitude = np.stack([table.column(name).to_numpy() for name in columns.QUATERNION])
    # a world vector turned back: its change over a record is minus the increment's cross product
    x = to_world(attitude * np.array([1.0, -1, -1, -1])[:, None], np.tile([[1.0], [0], [0]], (1, attitude.shape[1])))
    turned = np.diff(x, axis=1)
    middle = (x[:, 1:] + x[:, :-1]) / 2
    expected = -np.cross(flown.delta_theta_rad[0, 1:], middle.T).T
    assert np.abs(turned - expected).max() < 1e-7
