"""Uneven stamps are told from uneven records by the increments, and put right; true gaps stay."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from massprop_cli import job
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.check.signals import sampling
from massprop_cli.flow import Analysis
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.formats.clocks import outlying
from massprop_cli.inputs.formats.traits import traits
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.telemetry import read

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "free-flyer"
ROWS, STEP_S = 600, 0.05
Change = Callable[[Array], Array]


def examined(tmp_path: Path, change: Change, keep: slice | Array = slice(None)) -> Analysis:
    """What is found in the first 30 s of the free flyer's log with other stamps, or without some rows."""
    table = pq.read_table(SAMPLE / "log.parquet")[:ROWS]
    columns = {name: table.column(name).to_numpy()[keep] for name in table.column_names}
    columns["time_s"] = change(np.asarray(table.column("time_s"), float))[keep]
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns), path)
    return job.of_file(path, SAMPLE / "vehicle.toml").analysis


def packets(time_s: Array) -> Array:
    """Two in each: 98, 2, 98, 2 ms."""
    stamps = time_s.copy()
    stamps[::2] = time_s[1::2] - 0.002
    return stamps


def arrival(time_s: Array) -> Array:
    late: Array = np.maximum.accumulate(time_s + np.random.default_rng(1).exponential(0.01, len(time_s)))
    return late + 1e-9 * np.arange(len(time_s))


def last_one_later(time_s: Array) -> Array:
    """The last record comes a record late, no later than others before it."""
    late = arrival(time_s)
    late[300] = late[299] + 1.5 * STEP_S
    late[301:330] = np.maximum(late[301:330], late[300] + 1e-3 * np.arange(1, 30))
    late[-1] = time_s[-1] + STEP_S
    return late


def steps(time_s: Array) -> Array:
    stamps, rng = time_s.copy(), np.random.default_rng(2)
    for at in rng.integers(20, ROWS - 20, 12):
        stamps[at:] += rng.choice([-1, 1]) * 0.4 * STEP_S
    return stamps


def in_float32(time_s: Array) -> Array:
    return np.asarray(np.asarray(time_s + 500.0, np.float32), float)


def wraps(time_s: Array) -> Array:
    wrapped: Array = np.mod(time_s + 2.0**32 * 1e-6 - 12.3, 2.0**32 * 1e-6)
    return wrapped


def jitters(time_s: Array) -> Array:
    """By 0.2 of 50 ms, as stamps of a computer do that reads a sensor on a clock of its own."""
    return np.asarray(time_s + np.random.default_rng(3).normal(0, 2e-4, len(time_s)))


def begins_again(time_s: Array) -> Array:
    stamps = time_s.copy()
    stamps[250:] -= time_s[250] - 0.04
    return stamps


@pytest.mark.parametrize("change", [packets, arrival, last_one_later, steps, in_float32, wraps, jitters, begins_again])
def test_a_clock_that_is_at_fault_is_put_right_and_said(change: Change, tmp_path: Path) -> None:
    right = examined(tmp_path, lambda time_s: time_s)
    found = examined(tmp_path, change)
    assert [notice.code for notice in found.notices] == ["clock-rebuilt"]
    apart = (found.histories[0].values[-1] - right.histories[0].values[-1]) / right.histories[0].sigmas[-1]
    assert np.abs(apart[:9]).max() < 0.3


@pytest.mark.parametrize("restarts", [False, True])
def test_a_gap_stays_one(restarts: bool, tmp_path: Path) -> None:
    """Fifty records are missing, whatever the clock says of it."""
    keep = np.r_[:200, 250:ROWS]
    change = (lambda time_s: np.where(np.arange(ROWS) < 250, time_s, time_s - time_s[250] + 0.02)) if restarts else (lambda time_s: time_s)
    with pytest.raises(InputError, match=r"split the log there|sort or cut the log, or if no record is missing"):
        examined(tmp_path, change, keep)


@pytest.mark.parametrize("part", [1 / 4, 1 / 50])
def test_records_that_are_as_long_as_their_stamps_say_are_left_as_they_are(part: float, tmp_path: Path) -> None:
    """Of a log whose increments follow: every tenth record is longer by a quarter or a little, and the next one shorter."""
    table = pq.read_table(SAMPLE / "log.parquet")[:ROWS]
    time_s = np.asarray(table.column("time_s"), float)
    uneven = time_s + np.where(np.arange(ROWS) % 10, 0.0, part * STEP_S)
    share = np.diff(uneven, prepend=0.0) / STEP_S
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    for name in columns:
        if name.startswith("delta"):
            columns[name] = columns[name] * share
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns | {"time_s": uneven}), path)
    found = read(read_table(path), vehiclefile.load(SAMPLE / "vehicle.toml").vehicle)
    assert "clock-rebuilt" not in [notice.code for notice in found.notices]


def test_records_that_came_with_the_next_are_not_used(tmp_path: Path) -> None:
    table = pq.read_table(SAMPLE / "log.parquet")[:ROWS]
    columns = {name: table.column(name).to_numpy().copy() for name in table.column_names}
    rows = np.array([100, 222, 311, 450])
    for name, values in columns.items():
        if name.startswith("delta"):
            values[rows + 1] += values[rows]
            values[rows] = 0.0
            columns[name] = values
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns), path)
    found = job.of_file(path, SAMPLE / "vehicle.toml").analysis
    (said,) = found.notices
    assert (said.code, "4 record(s), the first at row 100" in said.message) == ("records-doubled", True)
    right = examined(tmp_path, lambda time_s: time_s)
    apart = (found.histories[0].values[-1] - right.histories[0].values[-1]) / right.histories[0].sigmas[-1]
    assert np.abs(apart[:9]).max() < 1.5


@pytest.mark.parametrize(("change", "within"), [(packets, 1e-3), (arrival, 1e-3), (steps, STEP_S / 2)])
def test_records_that_come_late_are_dated_by_those_that_do_not(change: Change, within: float, tmp_path: Path) -> None:
    """The middle of their stamps had made commands on a clock of their own early, by half a packet."""
    table = pq.read_table(SAMPLE / "log.parquet")[:ROWS]
    true = np.asarray(table.column("time_s"), float)
    columns = {name: table.column(name).to_numpy() for name in table.column_names} | {"time_s": change(true)}
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    log = read(read_table(tmp_path / "log.parquet"), vehiclefile.load(SAMPLE / "vehicle.toml").vehicle)
    assert abs(float(np.median(log.time_s - true))) < within


@pytest.mark.parametrize("value", [1e308, -1e308, 1e300, 1e20, 1e16])
@pytest.mark.parametrize("row", [0, 300, ROWS - 1])
def test_a_time_where_numbers_are_farther_apart_than_records_is_refused(value: float, row: int, tmp_path: Path) -> None:
    """Doubles are 2 s apart at 1e16 s. It had ended in an overflow, or in a gap or a step back of other times than the cell's."""
    table = pq.read_table(SAMPLE / "log.parquet")[:ROWS]
    time_s = table.column("time_s").to_numpy().copy()
    time_s[row] = value
    path = tmp_path / "log.parquet"
    pq.write_table(table.set_column(0, "time_s", pa.array(time_s)), path)
    said = f"row {row}, column time_s: {value:.9g} s is not a time of this log (usual interval 0.05 s); correct or cut the record"
    for look in (lambda: read(read_table(path), vehiclefile.load(SAMPLE / "vehicle.toml").vehicle), lambda: traits(read_table(path))):
        with np.errstate(all="raise"), pytest.raises(InputError) as refused:
            look()
        assert str(refused.value) == f"{path}, {said}"
    assert sampling(time_s, str) == []  # nothing of gaps, whose remedy would be another


def test_times_since_an_epoch_are_times() -> None:
    """Of 2026 in nanoseconds, which are 256 apart, each 50 ms."""
    assert not outlying(1.79e18 + 5e7 * np.arange(100))[0].any()
    assert not outlying(np.repeat(1.79e9, 100))[0].any()  # rounded, as a spreadsheet has them: told by what follows
