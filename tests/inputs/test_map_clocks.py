"""Clocks of a map's streams: their own, the map's, of the epoch, with a gap; and what an increment covers."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns, telemetry
from massprop_cli.inputs.actuators.wheel import WheelLog
from massprop_cli.inputs.formats import clocks
from massprop_cli.inputs.formats.recording import Numbers
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource, load
from tests.flown import fly
from tests.streams import RECORDS, WRENCH_MAP, made, motion, values

SAMPLES = Path(__file__).parents[2] / "sample_logs"


def test_clocks_of_the_epoch_keep_their_nanoseconds() -> None:
    plain, epoch = motion(), motion()
    for path in ("imu/t", "acc/t", "cmd/t"):
        whole = np.round(plain[path][0] * 1e9).astype(np.int64) + 1_760_000_000_123_456_789
        epoch[path] = (whole, "", "ns")
    text = WRENCH_MAP + RECORDS + 'zero = "start"\n'
    first, second = made(plain, text), made(epoch, text)
    assert first.rows == second.rows
    for name in first.columns:
        np.testing.assert_allclose(second.columns[name].numbers(), first.columns[name].numbers(), atol=3e-9)
    assert second.made is not None
    assert "time_s counts from 1760000000" in "\n".join(second.made.conversions)


def _as_streams(log: Log, vehicle: Vehicle) -> dict[str, tuple[Numbers, str, str]]:
    """A log as three streams: each sensor and the commands with a clock of its own."""
    streams: dict[str, tuple[Numbers, str, str]] = {"g/t": (log.time_s, "", "s"), "a/t": (log.time_s * 1e3 + 250, "", "ms")}
    streams |= {f"g/{a}": (log.delta_theta_imu_rad[:, n], "g/t", "rad") for n, a in enumerate("xyz")}
    streams |= {f"a/{a}": (log.delta_v_imu_m_s[:, n], "a/t", "m/s") for n, a in enumerate("xyz")}
    begin = log.time_s[:: log.records_per_cycle] - log.interval_s[:: log.records_per_cycle]
    streams |= {"c/t": (begin, "", "s")}
    return streams | {f"c/{jet.name}": (log.command[:, n], "c/t", "s") for n, jet in enumerate(vehicle.jets)}


def test_streams_with_clocks_of_their_own_give_the_log_they_are_of() -> None:
    vehicle = load(SAMPLES / "high-rate" / "vehicle.toml").vehicle
    log = telemetry.read(read_table(SAMPLES / "high-rate" / "log.parquet"), vehicle).part(0, 60)
    jets = "".join(f'[jets.{jet.name}]\npath = "c/{jet.name}"\n' for jet in vehicle.jets)
    text = (
        'schema = 1\n[gyro]\npaths = ["g/x", "g/y", "g/z"]\nvalues = "increment"\n[accelerometer]\npaths = "a/[xyz]"\n'
        f'values = "increment"\nclock = {{ path = "a/t", offset_s = -0.25 }}\n{jets}[records]\nsamples = 1\nper_cycle = 20\n'
    ).replace('"a/[xyz]"', '["a/x", "a/y", "a/z"]')
    again = telemetry.read(made(_as_streams(log, vehicle), text), vehicle)
    assert again.cycles == 60
    for one in fields(Log):
        stated, found = getattr(log, one.name), getattr(again, one.name)
        if isinstance(stated, np.ndarray):
            np.testing.assert_allclose(found, stated, atol=1e-12, err_msg=one.name)


def test_a_cell_that_is_empty_is_a_lost_reading() -> None:
    """In a table with one clock its row stays, and telemetry takes it as unknown; in streams that are summed it is a lost sample."""
    streams = motion()
    t = streams["imu/t"][0]
    one: dict[str, tuple[Numbers, str, str]] = {"t": (t, "", "s")}
    one |= {f"w{axis}": (np.sin((n + 1) * t), "t", "rad/s") for n, axis in enumerate("xyz")}
    one |= {f"a{axis}": (np.cos((n + 1) * t), "t", "m/s^2") for n, axis in enumerate("xyz")}
    empty = np.sin(2 * t)
    empty[500] = np.nan
    one |= {"f": (np.zeros(len(t)), "t", "s")}
    text = 'schema = 1\n[gyro]\npaths = "w?"\nvalues = "mean"\n[accelerometer]\npaths = "a?"\nvalues = "mean"\n[jets.f]\npath = "f"\n'
    found = values(made(one | {"wy": (empty, "t", "rad/s")}, text), columns.GYRO)
    assert np.flatnonzero(np.isnan(found).any(1)).tolist() == [500]
    lost = streams["imu/wy"][0].copy()
    lost[500] = np.nan
    bridged = made(streams | {"imu/wy": (lost, "imu/t", "rad/s")}, WRENCH_MAP + RECORDS)
    assert bridged.made is not None
    assert "gyro: 1 of 4000 rows of the file hold none of its samples" in bridged.made.conversions


def test_the_maps_own_clock_is_of_the_streams_that_have_none() -> None:
    streams = motion()
    plain = made(streams, WRENCH_MAP + RECORDS)
    # of all, where the gyro alone has none: the commands' is their own, though it is as long
    bare = streams | {path: (streams[path][0], "", "rad/s") for path in ("imu/wx", "imu/wy", "imu/wz")}
    common = WRENCH_MAP.replace("schema = 1", 'schema = 1\nclock = { path = "imu/t", unit = "s" }') + RECORDS
    late = {"cmd/t": (streams["cmd/t"][0] * 1e3, "", "ms"), "other/t": (streams["cmd/t"][0] + 0.3, "", "s")}
    for found in (made(bare | late, common), made(streams, common), made(streams, common.replace("imu/t", "cmd/t"))):
        for name in columns.WRENCH + columns.DELTA_THETA:
            np.testing.assert_allclose(found.columns[name].numbers(), plain.columns[name].numbers(), atol=1e-12)
    with pytest.raises(InputError, match=r"its clock 'imu/t'|clock 'other/t' 400|has 4000 samples and its clock 'other/t' 400"):
        made(bare | late, common.replace("imu/t", "other/t"))


INCREMENTS = WRENCH_MAP.replace('paths = "imu/w?"\nvalues = "sample"', 'paths = "imu/w?"\nvalues = "increment"')


@pytest.mark.parametrize(("unit", "factor"), [("", 1e6), ("us", 1e6), ("", 1.0), ("ms", 1e3)])
def test_increments_must_cover_their_interval_where_the_file_says_what_they_cover(unit: str, factor: float) -> None:
    streams = motion()
    streams |= {path: (streams[path][0] * 0.005, "imu/t", "rad") for path in ("imu/wx", "imu/wy", "imu/wz")}
    scatter = 1 + 0.01 * np.random.default_rng(1).normal(size=4000)
    whole = made(streams | {"imu/w_dt": (0.005 * factor * scatter, "imu/t", unit)}, INCREMENTS + RECORDS)
    np.testing.assert_array_equal(
        whole.columns["delta_theta_x_rad"].numbers(), made(streams, INCREMENTS + RECORDS).columns["delta_theta_x_rad"].numbers()
    )
    # every second one was logged
    half = {"imu/w_dt": (np.full(4000, 0.0025 * factor), "imu/t", unit)}
    said = rf"'imu/wx': an increment covers {0.0025 * factor:g} by 'imu/w_dt', and they come every 0.005 s.*\[gyro\] of m.toml"
    with pytest.raises(InputError, match=said):
        made(streams | half, INCREMENTS + RECORDS)
    # of another length it is no companion of theirs
    made(streams | {"imu/w_dt": (np.full(40, 0.0025 * factor), "", unit)}, INCREMENTS + RECORDS)


def test_a_gap_within_a_record_is_bridged_and_told_of() -> None:
    streams = motion()
    kept = np.delete(np.arange(4000), [1000, 1001])
    streams |= {path: (streams[path][0][kept], *streams[path][1:]) for path in streams if path.startswith("imu/w") or path == "imu/t"}
    text = WRENCH_MAP + RECORDS.replace("0.01", "0.025").replace("5\n", "2\n")
    whole, bridged = made(motion(), text), made(streams, text)
    np.testing.assert_allclose(values(bridged, columns.DELTA_THETA), values(whole, columns.DELTA_THETA), atol=2e-5)
    assert bridged.made is not None
    assert "gyro: 1 gap(s) of up to 0.015 s, shorter than a record, are interpolated; the first after 4.995 s" in bridged.made.conversions


def test_samples_beside_speeds_alone_are_handed_on_as_samples() -> None:
    """Nothing is commanded then, so nothing needs another clock; an integral of samples would hide a low-pass."""
    streams = {path: said for path, said in motion().items() if path.startswith("imu/w") or path == "imu/t"}
    slow = 0.003 + 0.1 * np.arange(199)
    streams |= {"tach/t": (slow, "", "s"), "tach/x": (300 * np.sin(slow), "tach/t", "rpm")}
    text = 'schema = 1\n[gyro]\npaths = "imu/w?"\nvalues = "sample"\n[wheels.x]\npath = "tach/x"\n[records]\nsamples = 1\nper_cycle = 20\n'
    table = made(streams, text)
    time_s = table.columns[columns.TIME].numbers()
    np.testing.assert_allclose(values(table, columns.GYRO), np.sin(np.outer(time_s, [1, 2, 3])), atol=1e-12)
    np.testing.assert_allclose(table.columns["wheel_x_rad_s"].numbers(), 10 * np.pi * np.sin(time_s), atol=0.05)
    assert columns.COMMAND_TIME not in table.columns
    assert table.made is not None
    assert table.made.sampled[0]
    # a record of two samples is still their integral
    assert columns.DELTA_THETA[0] in made(streams, text.replace("samples = 1", "samples = 2").replace("= 20", "= 10")).columns


SPEEDS_MAP = 'schema = 1\n[gyro]\npaths = "imu/w?"\nvalues = "sample"\n[wheels.x]\npath = "tach/x"\n[records]\nper_cycle = 20\n'


@pytest.mark.parametrize("records", ["samples = 1\n", "interval_s = 0.005\n"])
def test_samples_whose_stamps_scatter_and_of_which_some_are_lost_stay_samples(records: str) -> None:
    """Their mean interval is longer than the usual one by the lost part, which is not the length of a record."""
    rng, streams = np.random.default_rng(1), motion()
    kept = np.delete(np.arange(4000), rng.choice(np.arange(1, 3999, 7), 12, replace=False))
    streams = {path: (said[0][kept], *said[1:]) for path, said in streams.items() if path.startswith("imu/w") or path == "imu/t"}
    streams["imu/t"] = (streams["imu/t"][0] + rng.normal(0, 5e-4, len(kept)), "", "s")
    slow = 0.003 + 0.1 * np.arange(199)
    streams |= {"tach/t": (slow, "", "s"), "tach/x": (300 * np.sin(slow), "tach/t", "rpm")}
    table = made(streams, SPEEDS_MAP + records)
    assert table.made is not None
    assert table.made.sampled[0]
    assert np.isin(values(table, columns.GYRO[:1]), streams["imu/wx"][0]).all()


@pytest.mark.parametrize("lost", [(), (500, 1200, 1201, 3000)])
def test_samples_with_a_command_each_on_one_clock_stay_samples(lost: tuple[int, ...]) -> None:
    """Commands act from the sample with their stamp on; where samples were lost their records are put back, empty, for the commands."""
    streams = motion(command_hz=200.0)
    time_s = streams["imu/t"][0]
    streams |= {path: (np.round(time_s / 0.005), "cmd/t", said[2]) for path, said in streams.items() if path.startswith("cmd/")}
    streams["cmd/t"] = (time_s, "", "s")
    streams |= {path: (np.delete(said[0], lost), *said[1:]) for path, said in streams.items() if path.startswith(("imu/w", "imu/t"))}
    text = WRENCH_MAP.replace('[accelerometer]\npaths = "imu/a?"\nvalues = "sample"\n', "")
    table = made(streams, text + "[records]\nsamples = 1\nper_cycle = 1\n")
    assert table.made is not None
    assert table.made.sampled == (True, True)
    issued_s = table.columns[columns.COMMAND_TIME].numbers()
    end_s = table.columns[columns.TIME].numbers()
    np.testing.assert_allclose(issued_s, end_s - 0.005, atol=1e-9)
    none = np.isnan(values(table, columns.GYRO)).all(1)
    np.testing.assert_allclose(end_s[none], np.array(lost) * 0.005, atol=1e-9)
    np.testing.assert_allclose(values(table, columns.WRENCH[:1])[:, 0], np.round(issued_s / 0.005), atol=1e-6)


def test_a_map_that_makes_no_samples_is_named_where_the_vehicle_file_states_them() -> None:
    table = made(motion(), WRENCH_MAP + RECORDS)
    vehicle = Vehicle.model_validate({"schema": 1, "cycle": {"period_s": 0.05}, "imu": {"measures": "sample"}})
    with pytest.raises(
        InputError, match=r"m.toml makes no record a sample \(gyro.*\); leave imu.measures out, or keep samples in the map"
    ) as said:
        telemetry.read(table, vehicle)
    assert "delta_theta" not in str(said.value)


def test_a_seldom_attitude_with_a_gap_is_in_the_records_that_are_nearest_to_its_samples() -> None:
    """Each sample is used once, and what lies in a gap is not made up."""
    streams = motion()
    at = 0.0021 + np.arange(600) / 30
    at = at[(at < 8) | (at > 11)]
    half = 0.2 * np.sin(0.5 * at)
    streams |= {"att/t": (at, "", "s")} | {
        f"att/q{n}": (part, "att/t", "") for n, part in enumerate((np.sin(half), 0 * at, 0 * at, np.cos(half)))
    }
    text = WRENCH_MAP + RECORDS + '[attitude]\npaths = "att/q?"\norder = "xyzw"\n'
    table = made(streams, text)
    time_s, quaternion = table.columns[columns.TIME].numbers(), values(table, columns.QUATERNION)
    logged = np.isfinite(quaternion[:, 0])
    within = (at > time_s[0]) & (at < time_s[-1])
    assert 0 <= within.sum() - logged.sum() <= 3
    assert not logged[(time_s > 8.01) & (time_s < 10.99)].any()
    np.testing.assert_allclose(2 * np.arcsin(quaternion[logged, 1]), 0.4 * np.sin(0.5 * time_s[logged]), atol=2e-5)
    assert table.made is not None
    assert f"interpolated to the ends of the {logged.sum()} of {len(time_s)} records that are nearest to a sample" in "\n".join(
        table.made.conversions
    )
    # commands in the world are turned with it at any time
    with pytest.raises(InputError, match=r"'att/q0': a gap of 3\.\d* s after 7\.\d* s"):
        made(streams, text.replace('paths = "cmd/f?"', 'paths = "cmd/f?"\nframe = "world"'))


EVEN = 0.005 * np.arange(4000)


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (np.repeat(EVEN, np.where(np.arange(4000) == 3000, 2, 1)), "remove the repeated row, or name another clock"),
        (np.round(EVEN, 2), "must have a column for each signal first"),
        (np.full(4000, 1.71456e9), "all its times are the same: write them with more digits, or name another clock"),
        (np.where(EVEN < 10, 604790.0 + EVEN, EVEN - 10.0), "a week of GPS time ends: add 604800 s to all that follows"),
        ((1e6 * EVEN[::4] % 2**24) * 1e-6, "its counter wraps: add 2^24 us to all that follows"),
        (np.where(EVEN < 10, EVEN, EVEN + 600.0), ""),
        (EVEN, ""),
    ],
)
def test_times_that_are_none_have_a_cure_each_and_a_pause_is_no_second_sensor(times: Array, said: str) -> None:
    told = clocks.problem(times, lambda row: f"line {row}", 0.0, True)
    assert told.endswith(said)
    assert bool(told) == bool(said)


@pytest.mark.seeds
@pytest.mark.thorough
def test_speeds_of_wheels_on_a_clock_of_their_own_give_what_those_at_the_records_ends_give() -> None:
    """97 readings a second by a clock that is 4.2 s and 50 ppm off, beside an IMU at 100 Hz: within a sigma."""
    flown = fly("wheels", "sensors.records_per_cycle=20")
    fine, wheels = flown.log(0), flown.vehicle.wheels
    edges = np.append(fine.time_s[0] - fine.interval_s[0], fine.time_s)
    said = [one.speed_rad_s for one in fine.spinning if isinstance(one, WheelLog) and one.speed_rad_s is not None]
    speeds = [np.append([one.start_rad_s], speed).astype(float) for one, speed in zip(wheels, said, strict=True)]
    ends, at = edges[::4], np.arange(0.0037, edges[-1], 1 / 97)
    streams: dict[str, tuple[Numbers, str, str]] = {"t": (ends[1:], "", "s"), "rw/t": (4.2 + at * (1 + 5e-5), "", "s")}
    for name, increments in (("w", fine.delta_theta_imu_rad), ("a", fine.delta_v_imu_m_s)):
        summed = increments.reshape(-1, 4, 3).sum(1)
        streams |= {f"{name}{axis}": (summed[:, n], "t", "rad" if name == "w" else "m/s") for n, axis in enumerate("xyz")}
    text = "schema = 1\n" + "".join(
        f'[{key}]\npaths = "{name}?"\nvalues = "increment"\n' for key, name in (("gyro", "w"), ("accelerometer", "a"))
    )
    text += "[records]\nsamples = 1\nper_cycle = 5\n"
    own = f'clock = {{ path = "rw/t", scale = {1 / (1 + 5e-5)!r}, offset_s = {-4.2 / (1 + 5e-5)!r} }}\n'
    together = 'clock = { path = "t" }\n'
    found = []
    for clock, wanted, path in ((own, at, "rw/t"), (together, ends[1:], "t")):
        tables = "".join(f'[wheels.{one.name}]\npath = "n/{one.name}"\n{clock}' for one in wheels)
        spun = {f"n/{one.name}": (np.interp(wanted, edges, speed), path, "rad/s") for one, speed in zip(wheels, speeds, strict=True)}
        log = telemetry.read(made(streams | spun, text + tables), flown.vehicle)
        found.append(flow.examine(log, VehicleSource(flown.vehicle, "t", "")))
    assert all(not one.notices for one in found)
    by_own, at_ends = (one.conclusions[0].estimates for one in found)
    for name, item in by_own.items():
        if item.value is not None and item.sigma:
            assert abs(item.value - (at_ends[name].value or 0.0)) < item.sigma


@pytest.mark.parametrize("records", ["samples = 1\nper_cycle = 10", "interval_s = 0.005\nper_cycle = 10", "samples = 5\nper_cycle = 2"])
def test_commands_repeated_in_each_row_are_those_that_stand_once_in_a_cycle(records: str) -> None:
    """One table of samples, whose loop writes what it commands into every row: a pulse is one, not ten."""
    t = np.arange(4000) / 200
    issued = t[3::10]
    on_times = 1e-3 * np.random.default_rng(5).integers(0, 50, (len(issued), 2))
    at = np.maximum(np.searchsorted(issued, t, side="right") - 1, 0)
    map_ = 'schema = 1\n[gyro]\npaths = "w?"\nvalues = "sample"\n[accelerometer]\npaths = "a?"\nvalues = "sample"\n'
    map_ += f'[jets.one]\npath = "one"\n[jets.two]\npath = "two"\n[records]\n{records}\n'
    imu: dict[str, tuple[Numbers, str, str]] = {"t": (t, "", "s")}
    imu |= {f"w{axis}": (np.sin((n + 1) * t), "t", "rad/s") for n, axis in enumerate("xyz")}
    imu |= {f"a{axis}": (np.cos((n + 1) * t), "t", "m/s^2") for n, axis in enumerate("xyz")}
    once: dict[str, tuple[Numbers, str, str]] = {"c/t": (issued, "", "s")}
    once |= {name: (on_times[:, n], "c/t", "s") for n, name in enumerate(("one", "two"))}
    each: dict[str, tuple[Numbers, str, str]] = {name: (on_times[at, n], "t", "s") for n, name in enumerate(("one", "two"))}
    stated, found = made(imu | once, map_), made(imu | each, map_)
    names = (columns.COMMAND_TIME, "jet_one_s", "jet_two_s")
    whole, again = ({round(float(row[0]), 9): row for row in values(table, names) if np.isfinite(row[0])} for table in (stated, found))
    assert len(again) >= len(issued) - 3
    for at_s, row in again.items():
        np.testing.assert_allclose(row, whole[at_s], atol=1e-12)
    fewer: dict[str, tuple[Numbers, str, str]] = {path: (np.delete(once[path][0], 100), *once[path][1:]) for path in once}
    said = made(imu | fewer, map_).made
    assert said is not None
    assert re.search(
        r"commands: \d+ every 0.05 s.*; 1 gap\(s\), the first after 4.9\d* s: a command that was lost there", "\n".join(said.conversions)
    )


def test_actuators_that_are_numbered_on_and_not_mapped_are_named() -> None:
    t = np.arange(400) / 20
    streams = motion() | {"rcs/t": (t, "", "s")}
    streams |= {f"rcs/on{n}_ms": (10.0 * (np.arange(400) % 5 == n % 5), "rcs/t", "ms") for n in range(1, 5)}
    streams |= {"rcs/on5_ms": (np.zeros(400), "rcs/t", "ms"), "rcs/heat1_ms": (t, "rcs/t", "")}
    table = made(streams, WRENCH_MAP.split("[torque]", maxsplit=1)[0] + jets("") + RECORDS)
    assert table.made is not None
    assert "'rcs/on3_ms', 'rcs/on4_ms': numbered like commands that are mapped, and not mapped. Map each that acted on the vehicle" in (
        table.made.conversions
    )


def jets(clock: str) -> str:
    """Tables of two jets."""
    return "".join(f'[jets.j{n}]\npath = "rcs/on{n}_ms"\n{clock}' for n in (1, 2))


@pytest.mark.parametrize(
    ("clock", "said"),
    [
        ("", "'rcs/on1_ms': the file doesn't say which stream has its times; state clock.path: 'rcs/t' by its rows"),
        ('clock = { path = "imu/late" }\n', "or its times are in 'rcs/t': state clock.path under [jets.j1], which is by 'imu/late' now"),
    ],
)
def test_commands_by_the_wrong_clock_or_none_are_refused_with_the_one_that_has_their_rows(clock: str, said: str) -> None:
    """A table in which the commands, on stamps of their own, stand beside the first rows of the IMU's."""
    t, full = np.arange(200) / 10, np.full(4000, np.nan)
    streams = motion() | {"imu/late": (0.5 + np.arange(4000) / 200, "", "s"), "rcs/t": (full.copy(), "", "s")}
    streams |= {f"rcs/on{n}_ms": (full.copy(), "", "ms") for n in (1, 2)}
    for path, numbers in (("rcs/t", t), ("rcs/on1_ms", np.arange(200.0) % 50), ("rcs/on2_ms", np.arange(200.0) % 30)):
        streams[path][0][:200] = numbers
    with pytest.raises(InputError, match=re.escape(said)):
        made(streams, WRENCH_MAP.split("[torque]", maxsplit=1)[0] + jets(clock) + RECORDS)
