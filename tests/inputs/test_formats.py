"""A file of each format, written by its own library, gives what the Parquet log gives."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import job
from massprop_cli.base import escape
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import reading
from massprop_cli.inputs.logfile import read_table
from tests.inputs.everyformat import (
    EXACT,
    FORMATS,
    SAMPLE,
    by_parquet,
    found,
    sample,
    save_mat,
    written,
)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_result_of_the_parquet_log(name: str, tmp_path: Path) -> None:
    path, map_file = written(name, tmp_path)
    told = found(path, map_file)
    if name in EXACT:
        assert told == by_parquet()
        return
    # times in whole nanoseconds, made seconds by a factor, are not the same floats
    table, plain = read_table(path, map_file), sample()
    for column, values in plain.items():
        np.testing.assert_allclose(table.columns[column].numbers(), values, rtol=1e-13, atol=1e-15)
    for phase, stated in zip(told["phases"], by_parquet()["phases"], strict=True):
        for quantity, item in phase["estimates"].items():
            assert item["verdict"] == stated["estimates"][quantity]["verdict"]
            for key in ("value", "sigma"):
                assert (item[key] or 0.0) == pytest.approx(stated["estimates"][quantity][key] or 0.0, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", FORMATS)
def test_a_damaged_file_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    path, map_file = written(name, tmp_path)
    whole = path.read_bytes()
    rng = np.random.default_rng(5)
    # a ULog's beginning is one: a vehicle that loses its power leaves that
    begun = [] if name == "ulog" else [whole[: len(whole) // 2]]
    for damaged in (*begun, whole[:40], b"no such format\n", bytes(rng.integers(0, 256, 3000, np.uint8))):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=rf"^{path}(,|:)[^\n]*$"):
            read_table(path, map_file)


@pytest.mark.apart
@pytest.mark.parametrize("name", ["hdf5", "matlab 5", "mdf4", "mcap of JSON", "ulog", "ROS 1 bag"])
def test_a_format_asks_for_its_extra_by_name(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, map_file = written(name, tmp_path)
    without = tmp_path / "without"
    without.mkdir()
    for library in ("h5py", "matio", "mcap", "rosbags", "asammdf", "pyulog"):
        (without / f"{library}.py").write_text(f"raise ModuleNotFoundError(name={library!r})")
    monkeypatch.syspath_prepend(without)
    with pytest.raises(InputError, match=rf"needs the package .*; pip install 'massprop\[{FORMATS[name][2]}\]'"):
        read_table(path, map_file)


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in ("tabs in UTF-16",)])
def test_more_numbers_than_the_limit_are_refused(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, map_file = written(name, tmp_path)
    monkeypatch.setenv("MASSPROP_MAX_NUMBERS", "1000")
    with pytest.raises(InputError, match=r"the limit is 1000 \(MASSPROP_MAX_NUMBERS\)\. Is it the right file"):
        read_table(path, map_file)


def test_what_a_gzip_file_would_become_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"0" * 3_000_000))
    monkeypatch.setenv("MASSPROP_MAX_LOG_BYTES", "1000000")
    with pytest.raises(InputError, match=r"log.csv.gz, unpacked: \d+ bytes of a log; the limit is 1000000"):
        read_table(path)


def test_a_matlab_file_that_unpacks_to_more_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import scipy.io

    scipy.io.savemat(tmp_path / "log.mat", {"s": {"x": np.zeros(200_000)}}, do_compression=True)
    assert (tmp_path / "log.mat").stat().st_size < 5000
    monkeypatch.setenv("MASSPROP_MAX_NUMBERS", "100000")
    with pytest.raises(InputError, match="the limit is 100000"):
        read_table(tmp_path / "log.mat")


def test_points_and_commas_in_one_file_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time_s;delta_theta_x_rad;event\n0,1;1.5;dock, hard\n0,2;2.5;\n")
    with pytest.raises(InputError, match="line 2, column time_s, has a decimal comma, line 2, column delta_theta_x_rad, a point"):
        read_table(path)


def test_without_a_map_names_of_the_contract_are_taken(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, values in sample().items():
            file[f"run/{name}"] = values
        file["run/more"] = np.zeros((3, 2))
    assert found(tmp_path / "log.h5") == by_parquet()
    with h5py.File(tmp_path / "log.h5", "a") as file:
        file["other/time_s"] = [1.0, 2.0]
    with pytest.raises(InputError, match="both 'other/time_s' and 'run/time_s' are called time_s; say which is meant in a map file"):
        read_table(tmp_path / "log.h5")


def test_a_log_that_broke_off_is_as_long_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, _ = written("ulog", tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    streams = reading.read(path, path.read_bytes()).streams
    assert 70 < streams["imu/timestamp"].rows < 90
    assert reading.read(path, whole).parameters == {"CA_ROTOR_COUNT": 1.0, "CA_ROTOR0_CT": 1.5}
    assert capsys.readouterr().out == ""


def test_a_timetable_has_its_own_clock(tmp_path: Path) -> None:
    import pandas as pd

    table = pd.DataFrame({"a": [1.0, 2.0, 3.0]}, index=pd.to_timedelta(np.array([0.0, 0.5, 1.0]), unit="s").as_unit("ns"))
    save_mat(tmp_path / "log.mat", {"tt": table})
    read = reading.read(tmp_path / "log.mat", (tmp_path / "log.mat").read_bytes())
    assert list(read.streams) == ["tt.Time", "tt.a"]
    assert read.streams["tt.a"].clock == "tt.Time"
    np.testing.assert_array_equal(read.streams["tt.Time"].values, [0, 500_000_000, 1_000_000_000])


def test_results_name_their_map(tmp_path: Path) -> None:
    path, map_file = written("hdf5", tmp_path)
    judged = job.of_file(path, SAMPLE / "vehicle.toml", map_file=map_file)
    assert judged.result.provenance.map_sha256 is not None
    assert '"map_sha256": "' in escape.document(judged.result)
