"""Tables as loggers, spreadsheets and pandas write them: the log that comes of them is that of the plain recording."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import listing, propose, reading, units
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.tablefile import Table
from tests.streams import motion

MAP = """
schema = 1
[gyro]
paths = ["wx", "wy", "wz"]
unit = "rad/s"
values = "mean"
clock = { path = "t"UNIT }
[accelerometer]
paths = ["ax", "ay", "az"]
unit = "m/s^2"
values = "mean"
clock = { path = "t"UNIT }
[torque]
paths = ["tx", "ty", "tz"]
unit = "N m"
clock = { path = "tc"UNIT }
[force]
paths = ["fx", "fy", "fz"]
unit = "N"
clock = { path = "tc"UNIT }
[records]
interval_s = 0.01
per_cycle = 5
zero = "start"
"""
BEGUN = pd.Timestamp("2024-05-01T23:59:55.25")


def frames() -> tuple[pd.DataFrame, pd.DataFrame]:
    """An IMU at 200 Hz, of means of sines over its records, and commands at 20 Hz, each with its own times in s."""
    streams = motion()
    t, issued = (np.asarray(streams[path][0]) for path in ("imu/t", "cmd/t"))
    step = t[1] - t[0]
    turned = {f"w{a}": (np.cos((n + 1) * (t - step)) - np.cos((n + 1) * t)) / ((n + 1) * step) for n, a in enumerate("xyz")}
    imu = {"t": t} | turned | {f"a{a}": np.cos((n + 1) * t) for n, a in enumerate("xyz")}
    commands = {"tc": issued} | {path[4:]: np.asarray(said[0]) for path, said in streams.items() if re.fullmatch("cmd/[tf][xyz]", path)}
    return pd.DataFrame(imu), pd.DataFrame(commands)


def mapped(path: Path, unit: str = ', unit = "s"', *changes: tuple[str, str]) -> Table:
    text = MAP.replace("UNIT", unit)
    for old, new in changes:
        text = text.replace(old, new)
    path.with_name("map.toml").write_text(text)
    return read_table(path)


def numbers(table: Table) -> dict[str, np.ndarray]:
    return {name: cells.numbers() for name, cells in table.columns.items()}


def issued(found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Commands and their times, of the rows that have them."""
    rows = np.isfinite(found["command_time_s"])
    return {name: found[name][rows] for name in ("command_time_s", *columns.WRENCH)}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Side by side in one table, whose shorter half ends in empty cells."""
    path = tmp_path_factory.mktemp("plain") / "log.csv"
    pd.concat(frames(), axis=1).to_csv(path, index=False)
    return numbers(mapped(path))


def same(table: Table, plain: dict[str, np.ndarray], atol: float = 1e-9) -> None:
    found = numbers(table)
    for name, values in plain.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-7, atol=atol, err_msg=name)


def test_two_streams_side_by_side_are_what_was_recorded(plain: dict[str, np.ndarray]) -> None:
    imu, commands = frames()
    told, begun = issued(plain), commands["tc"][0]
    count = len(told["command_time_s"])
    np.testing.assert_allclose(told["command_time_s"], commands["tc"].to_numpy()[:count] - begun, atol=1e-9)
    for name, own in zip(columns.WRENCH, ("tx", "ty", "tz", "fx", "fy", "fz"), strict=True):
        np.testing.assert_array_equal(told[name], commands[own].to_numpy()[:count])
    # records are the IMU's own, from the one in which the first command was issued on
    first = int(np.searchsorted(imu["t"], begun))
    np.testing.assert_allclose(plain["time_s"], imu["t"].to_numpy()[first : first + len(plain["time_s"])] - begun, atol=1e-9)
    np.testing.assert_array_equal(plain["gyro_x_rad_s"], imu["wx"].to_numpy()[first : first + len(plain["time_s"])])


def test_streams_merged_on_their_times_are_the_same(plain: dict[str, np.ndarray], tmp_path: Path) -> None:
    imu, commands = frames()
    merged = imu.merge(commands.rename(columns={"tc": "t"}), on="t", how="outer").sort_values("t")
    path = tmp_path / "log.parquet"
    merged.to_parquet(path)
    table = mapped(path, ', unit = "s"', ('"tc"', '"t"'))
    same(table, plain)
    assert table.made is not None
    assert any("torque" in line and "rows of the file hold none of its samples" in line for line in table.made.conversions)


def test_the_draft_of_merged_streams_puts_them_on_records_and_can_be_followed(tmp_path: Path) -> None:
    imu, commands = frames()
    commands["tc"] = commands["tc"] - 0.0007  # the stamps of some IMU samples
    beside, path = tmp_path / "beside.csv", tmp_path / "log.csv"
    pd.concat((imu, commands), axis=1).to_csv(beside, index=False)
    plain = numbers(mapped(beside))
    own = commands.rename(columns={"tc": "t"})
    outer, rows = imu.merge(own, on="t", how="outer").sort_values("t"), pd.concat([imu, own]).sort_values("t", kind="stable")
    assert len(outer) < len(rows) == len(imu) + len(own)
    for merged in (outer, rows):
        merged.rename(columns={axis: f"gyro_{axis[1]} [rad/s]" for axis in ("wx", "wy", "wz")}).to_csv(path, index=False)
        draft = propose.draft(reading.load(path))
        assert "# 4000 samples, rad/s" in draft
        assert "# 400 samples" in draft
        interval = 'interval_s = "?"   # in s: 0.005 in the clock\'s own unit; commands come every 0.05, the slower sensor every 0.005'
        assert (
            f"[records]   # the streams have clocks of their own, and are put on records of one length and on control cycles\n{interval}"
            in draft
        )
        assert draft.count('clock = { path = "t", unit = "?" }') == 1
        answered = (
            draft.replace('values = "?"', 'values = "mean"')
            .replace('frame = "?"', 'frame = "body"')
            .replace("per_cycle = 10", "per_cycle = 5")
        )
        answered = answered.replace('interval_s = "?"', 'interval_s = 0.01\nzero = "start"').replace(
            'path = "t", unit = "?"', 'path = "t", unit = "s"'
        )
        for unit in ("m/s^2", "N m", "N"):
            answered = answered.replace('unit = "?"', f'unit = "{unit}"', 1)
        path.with_name("map.toml").write_text(answered)
        same(read_table(path), plain)
    told = {one.path: one for one in listing.listed(reading.load(path))}
    assert (told["tx"].samples, told["tx"].note) == (400, "4000 rows empty")


def test_numbers_that_are_often_missing_beside_others_are_refused_with_a_line(tmp_path: Path) -> None:
    imu, commands = frames()
    imu.loc[100::10, "wy"] = np.nan
    path = tmp_path / "log.csv"
    pd.concat((imu, commands), axis=1).to_csv(path, index=False)
    with pytest.raises(InputError, match=r"log.csv, 'wx': a number is missing at line 102, beside other axes'; correct the row \(\[gyro\]"):
        mapped(path)


def _iso(seconds: pd.Series) -> pd.Series:
    return (BEGUN + pd.to_timedelta(seconds, unit="s")).dt.strftime("%Y-%m-%dT%H:%M:%S.%f")


DATES: dict[str, Callable[[pd.Series], pd.Series]] = {
    "ISO 8601": _iso,
    "with an offset and a comma": lambda s: _iso(s).str.replace(".", ",") + "+02:00",
    "with Z": lambda s: _iso(s) + "Z",
    "with UTC behind a space": lambda s: _iso(s) + " UTC",
    "with slashes": lambda s: _iso(s).str.replace("-", "/").str.replace("T", " "),
    "without marks": lambda s: _iso(s).str.replace("-", "").str.replace(":", ""),
    "of the day of the year": lambda s: (BEGUN + pd.to_timedelta(s, unit="s")).dt.strftime("%Y-%jT%H:%M:%S.%fZ"),
    "of the day alone": lambda s: (pd.Timestamp("2024-05-01 12:00") + pd.to_timedelta(s, unit="s")).dt.strftime("%H:%M:%S.%f"),
}


@pytest.mark.parametrize("form", DATES)
def test_dates_and_times_are_clocks(form: str, plain: dict[str, np.ndarray], tmp_path: Path) -> None:
    imu, commands = (frame.assign(**{frame.columns[0]: DATES[form](frame[frame.columns[0]])}) for frame in frames())
    path = tmp_path / "log.csv"
    pd.concat((imu, commands), axis=1).to_csv(path, index=False, sep=";" if "comma" in form else ",")
    same(mapped(path, ""), plain, atol=2e-6)  # microseconds were written


@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
def test_timestamps_of_parquet_are_clocks_with_a_unit(unit: str, plain: dict[str, np.ndarray], tmp_path: Path) -> None:
    stamped = []
    for frame in frames():
        name = frame.columns[0]
        at = BEGUN + pd.to_timedelta((frame[name] * 1e9).round().astype("int64"), unit="ns")
        stamped.append(frame.assign(**{name: at.astype(f"datetime64[{unit}]")}))
    path = tmp_path / "log.parquet"
    pd.concat(stamped, axis=1).to_parquet(path)
    if unit == "ms":  # commands are stamped with samples of the IMU then, on whose records cycles begin
        found, count = numbers(mapped(path, "")), len(issued(plain)["cmd_force_x_n"]) - 1
        np.testing.assert_allclose(found["cmd_force_x_n"][::5][:count], issued(plain)["cmd_force_x_n"][:count], atol=1e-12)
    else:
        same(mapped(path, ""), plain, atol={"ns": 2e-6, "us": 4e-6}[unit])
    with pytest.raises(InputError, match="the map says unit 's', the file"):
        mapped(path, ', unit = "s"')


def test_a_cell_that_is_no_date_is_named_by_its_line(tmp_path: Path) -> None:
    imu, commands = (frame.assign(**{frame.columns[0]: _iso(frame[frame.columns[0]])}) for frame in frames())
    imu.loc[7, "t"] = "yesterday"
    path = tmp_path / "log.csv"
    pd.concat((imu, commands), axis=1).to_csv(path, index=False)
    with pytest.raises(InputError, match=r"log.csv, line 9, column t: 'yesterday' is not a date and time; correct the cell"):
        mapped(path, "")


@pytest.mark.parametrize("cell", ["05/01/2024 12:00:00.05", "1/0700000000.00655", "24.12.2024 14:23:07", "12:00:00:050"])
def test_times_that_are_not_read_are_shown_with_the_forms_that_are(cell: str, tmp_path: Path) -> None:
    imu, commands = frames()
    path = tmp_path / "log.csv"
    pd.concat((imu.assign(t=cell), commands), axis=1).to_csv(path, index=False)
    with pytest.raises(
        InputError, match=rf"log.csv, line 2, column t: '{re.escape(cell)}' is not a number.*2024-122; with Z, UTC or an offset"
    ):
        mapped(path, "")


def test_a_day_that_its_year_has_not_is_none(tmp_path: Path) -> None:
    imu, commands = frames()
    path = tmp_path / "log.csv"
    pd.concat((imu.assign(t=DATES["of the day of the year"](imu["t"]).str.replace("2024-122", "2023-366")), commands), axis=1).to_csv(path)
    with pytest.raises(InputError, match=r"log.csv, column t: dates in different formats, or not dates; write all in one format"):
        mapped(path, "")


def test_comments_units_and_empty_rows_around_a_table_are_none_of_its_rows(plain: dict[str, np.ndarray], tmp_path: Path) -> None:
    both = pd.concat(frames(), axis=1)
    header, *rows = both.to_csv(index=False).splitlines()
    units = "s," + ",".join(["rad/s"] * 3 + ["m/s2"] * 3) + ",s," + ",".join(["Nm"] * 3 + ["N"] * 3)
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["# logger 3", "# of a bench", header, units, *rows, "," * 13, "," * 13]) + "\n")
    bare = [(f'unit = "{unit}"\n', "") for unit in ("rad/s", "m/s^2", "N m", "N")]
    same(mapped(path, "", *bare), plain)
    path.with_name("map.toml").unlink()
    with pytest.raises(InputError, match="the row below the header names units, 's' of column t"):
        read_table(path)
    cut = path.read_text().replace("\n0.02,", "\nten,", 1)
    path.write_text(cut)
    line = next(n for n, text in enumerate(cut.splitlines(), 1) if text.startswith("ten,"))
    with pytest.raises(InputError, match=f"log.csv, line {line}, column t: 'ten' is not a number"):
        mapped(path, "", *bare)


def test_a_row_of_units_may_hold_some_that_are_no_quantitys_here(plain: dict[str, np.ndarray], tmp_path: Path) -> None:
    both = pd.concat(frames(), axis=1).assign(temperature=20.0, Bx=30.0, counter=0, state="flying")
    header, *rows = both.to_csv(index=False).splitlines()
    units = ["UTC", *["rad/s"] * 3, *["m/s2"] * 3, "s", *["Nm"] * 3, *["N"] * 3, "degC", "uT", "-", ""]
    path = tmp_path / "log.csv"
    bare = [(f'unit = "{unit}"\n', "") for unit in ("rad/s", "m/s^2", "N m", "N")]
    path.write_text("\n".join([header, ",".join(units), *rows]))
    seconds = ('clock = { path = "t"', 'clock = { path = "t", unit = "s"')
    same(mapped(path, "", seconds, *bare), plain)
    assert reading.load(path).streams["temperature"].unit == "degC"
    # a row with a number is a row of the log, and words are no units
    for first in (["0.0", *units[1:]], ["UTC", *["?"] * 13, "degC", "uT", "-", ""]):
        path.write_text("\n".join([header, ",".join(first), *rows]))
        with pytest.raises(InputError, match=r"log.csv, line 2, column"):
            mapped(path, ', unit = "s"')


def test_a_header_that_is_a_comment_is_the_header(plain: dict[str, np.ndarray], tmp_path: Path) -> None:
    header, *rows = pd.concat(frames(), axis=1).to_csv(index=False).splitlines()
    path = tmp_path / "log.csv"
    for above in (["# " + header], ["# logger 3", "#" + header]):  # as numpy.savetxt writes it
        path.write_text("\n".join([*above, *rows]) + "\n")
        same(mapped(path), plain)


@pytest.mark.parametrize("jitter_s", [2e-4, 1e-3, 4e-3])
def test_stamps_of_commands_that_scatter_move_no_impulse(jitter_s: float, plain: dict[str, np.ndarray], tmp_path: Path) -> None:
    imu, commands = frames()
    scattered = commands["tc"] + jitter_s * np.random.default_rng(1).uniform(-1, 1, len(commands))
    scattered.iloc[0] = commands["tc"][0]
    path = tmp_path / "log.csv"
    pd.concat((imu, commands.assign(tc=scattered)), axis=1).to_csv(path, index=False)
    table = mapped(path)
    found, exact = issued(numbers(table)), issued(plain)
    # times count from the first cycle, which may begin before or after the first stamp
    first = int(np.argmin(np.abs(exact["cmd_force_x_n"][:2] - found["cmd_force_x_n"][0])))
    count = min(len(found["command_time_s"]), len(exact["command_time_s"]) - first)
    for name in columns.WRENCH:
        np.testing.assert_array_equal(found[name][:count], exact[name][first : first + count], err_msg=name)
    np.testing.assert_allclose(np.diff(found["command_time_s"]), 0.05, atol=1e-2 * jitter_s)
    assert count >= len(exact["command_time_s"]) - 2
    assert table.made is not None
    assert any("stamps scatter by up to" in line for line in table.made.conversions)


def test_commands_that_are_stamped_a_little_into_each_cycle_act_from_there_on(tmp_path: Path) -> None:
    imu, commands = frames()
    late = commands.drop(columns="tc").loc[:, ["fx", "fy", "fz"]].assign(tl=commands["tc"] + 0.006)
    path = tmp_path / "log.csv"
    pd.concat((imu, commands[["tc", "tx", "ty", "tz"]], late), axis=1).to_csv(path, index=False)
    force = 'unit = "N"\nclock = { path = "tc"'
    found = numbers(mapped(path, ', unit = "s"', (force, force.replace("tc", "tl"))))
    begun = found["time_s"][0] - 0.01
    cycles = found["cmd_force_x_n"][::5]
    x = commands["fx"].to_numpy()
    # the first cycle that is whole begins with the second torque: 6 ms of it belong to the force before
    np.testing.assert_allclose(cycles, 0.12 * x[: len(cycles)] + 0.88 * x[1 : len(cycles) + 1], atol=1e-9)
    assert begun == pytest.approx(0.0, abs=1e-9)


def test_times_rounded_to_milliseconds_give_records_as_long_as_samples(tmp_path: Path) -> None:
    imu, commands = frames()
    fine = imu.assign(t=(imu["t"] * 0.5).round(3))  # 400 Hz: steps of 2 and 3 ms
    path = tmp_path / "log.csv"
    pd.concat((fine, commands.assign(tc=(commands["tc"] * 0.5).round(3))), axis=1).to_csv(path, index=False)
    table = mapped(path, ', unit = "s"', ("interval_s = 0.01", "interval_s = 0.0025"), ("per_cycle = 5", "per_cycle = 10"))
    assert table.columns["time_s"].numbers()[9] == pytest.approx(0.025)


def test_an_index_in_a_columns_name_is_no_unit(tmp_path: Path) -> None:
    imu, commands = frames()
    named = {f"w{a}": f"gyro[{n}]" for n, a in enumerate("xyz")} | {f"a{a}": f"acc[{n}] (m/s^2)" for n, a in enumerate("xyz")}
    path = tmp_path / "log.csv"
    pd.concat((imu.rename(columns=named), commands), axis=1).to_csv(path, index=False)
    read = reading.load(path)
    assert read.streams["gyro[0]"].unit == ""
    assert read.streams["acc[0] (m/s^2)"].unit == "m/s^2"
    text = propose.draft(read)
    assert 'paths = ["gyro[0]", "gyro[1]", "gyro[2]"]' in text
    # each stream has the clock that ends where it does
    clocks = listing.Clocks(read)
    assert clocks.of(read.streams["gyro[1]"]) == ["t"]
    assert clocks.of(read.streams["fy"]) == ["tc"]
    assert "nan" not in text


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ([f"gyroADC[{n}] (deg/s)" for n in range(3)], "deg/s"),
        (["p (°/s)", "q (°/s)", "r (°/s)"], "deg/s"),
        ([f"omega {axis} / (rad/s)" for axis in "xyz"], "rad/s"),
        ([f"w{axis} / rad/s" for axis in "xyz"], "rad/s"),
        ([f"Gyr_{axis} [mrad/s]" for axis in "XYZ"], "mrad/s"),
    ],
)
def test_axes_are_found_before_the_unit_behind_them(names: list[str], unit: str, tmp_path: Path) -> None:
    imu, _ = frames()
    path = tmp_path / "log.csv"
    called = dict(zip(("wx", "wy", "wz"), names, strict=True)) | {"t": "t / s"} | {f"a{axis}": f"a{axis} / g" for axis in "xyz"}
    imu.rename(columns=called).to_csv(path, index=False)
    read = reading.load(path)
    assert [units.plain(read.streams[name].unit) for name in names] == [unit] * 3
    draft = propose.draft(read)
    for paths in (names, ["ax / g", "ay / g", "az / g"]):
        assert f"paths = {json.dumps(paths, ensure_ascii=False)}   # 4000 samples, 200 Hz" in draft
    assert 'clock = { path = "t / s" }' in draft


def test_units_of_a_turn_and_names_without_any() -> None:
    assert [units.factor(text, units.SPIN) for text in ("1/min", "min^-1", "RPM")] == [pytest.approx(np.pi / 30)] * 3
    assert units.without_suffix_unit("speed / limit") == ("speed / limit", "")
    assert units.without_suffix_unit("xyz[0]") == ("xyz[0]", "")
    assert units.factor("mG", units.ACCELERATION) is None
    assert units.factor("G", units.ACCELERATION) == units.G


def test_nanoseconds_since_1970_keep_their_digits(tmp_path: Path) -> None:
    """Float64 has steps of 256 ns there; a Parquet column of them was refused, and one of a CSV file rounded."""
    at = 1709164785010000000 + 10_000_123 * np.arange(50)
    frame = pd.DataFrame({"t_ns": at, "gx": np.arange(50.0)})
    frame.to_parquet(tmp_path / "log.parquet")
    frame.to_csv(tmp_path / "log.csv", index=False)
    for name in ("log.parquet", "log.csv"):
        stream = reading.load(tmp_path / name).streams["t_ns"]
        np.testing.assert_array_equal(stream.values, at)


def test_array_fields_of_an_hdf5_table_are_a_stream_for_each_component(tmp_path: Path) -> None:
    """NumPy's structured arrays and tables of pandas have them; they had been left out without a word."""
    import h5py

    rows = np.zeros(40, dtype=[("t", "f8"), ("gyro", "f4", (3,)), ("name", "S4"), ("cov", "f8", (3, 3))])
    rows["gyro"] = np.random.default_rng(1).normal(size=(40, 3))
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["log"] = rows
    streams = reading.load(tmp_path / "run.h5").streams
    assert list(streams) == ["log/t", "log/gyro[0]", "log/gyro[1]", "log/gyro[2]"]
    np.testing.assert_array_equal(streams["log/gyro[2]"].values, rows["gyro"][:, 2])
