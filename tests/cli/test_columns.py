import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import listing, mapfile, propose
from massprop_cli.inputs.formats.recording import Numbers, Recording, stream
from massprop_cli.inputs.logfile import read_table
from tests.commandline import massprop, succeeded

SAMPLES = Path(__file__).parents[2] / "sample_logs"


def recording(**streams: tuple[Numbers, str, str]) -> Recording:
    return Recording(Path("own.h5"), "0", "HDF5 file", {path: stream(path, *said) for path, said in streams.items()})


def flight(**more: tuple[Numbers, str, str]) -> Recording:
    """Gyro and accelerometer at 200 Hz, a commanded wrench at 50 Hz, all that is needed recorded with them."""
    fast, slow = np.arange(2000) / 200, np.arange(500) / 50
    streams: dict[str, tuple[Numbers, str, str]] = {"imu/t": (fast, "", "s"), "cmd/t": (slow, "", "s")}
    for n, axis in enumerate("xyz"):
        streams[f"imu/gyro_{axis}"] = (np.sin((n + 1) * fast), "imu/t", "rad/s")
        streams[f"imu/acc_{axis}"] = (np.where(n == 2, 9.8, 0.0) + np.sin(fast) / 9, "imu/t", "")
        streams[f"cmd/torque_{axis}"] = (np.sin(slow), "cmd/t", "N m")
        streams[f"cmd/force_{axis}"] = (np.cos(slow), "cmd/t", "N")
    return recording(**(streams | more))


@pytest.mark.parametrize("name", ["free-flyer", "high-rate", "crazyflie"])
def test_the_draft_of_a_log_is_the_map_that_changes_nothing(name: str, tmp_path: Path) -> None:
    log = SAMPLES / name / ("yaw.parquet" if name == "crazyflie" else "log.parquet")
    run = massprop(tmp_path, "columns", log, "--as-map")
    assert (run.returncode, run.stderr) == (0, "")
    (tmp_path / "map.toml").write_text(run.stdout)
    plain, mapped = read_table(log), read_table(log, tmp_path / "map.toml")
    for column in plain.columns:
        np.testing.assert_array_equal(mapped.columns[column].numbers(), plain.columns[column].numbers())


def test_what_names_units_and_clocks_settle_is_filled_in() -> None:
    text = propose.draft(flight())
    for said in (
        'paths = ["imu/gyro_x", "imu/gyro_y", "imu/gyro_z"]   # 2000 samples, 200 Hz, rad/s',
        'unit = "m/s^2"   # its median size is 9.8',
        'paths = ["cmd/torque_x", "cmd/torque_y", "cmd/torque_z"]',
        "interval_s = 0.005   # commands come at 50 Hz, the slower sensor at 200 Hz",
        "per_cycle = 4",
    ):
        assert said in text
    # what no file says: what a number is, and in which frame commands are
    assert [line.partition("#")[0].strip() for line in text.splitlines() if '"?"' in line.partition("#")[0]] == [
        'values = "?"',
        'values = "?"',
        'frame = "?"',
        'frame = "?"',
    ]
    assert propose.questions(text) == 4
    with pytest.raises(InputError, match=r'm.toml, line 6: gyro.values is still "\?"; so are lines 11, 15, 19; answer each'):
        mapfile.parse(text, "m.toml")
    answered = text.replace('values = "?"', 'values = "sample"').replace('frame = "?"', 'frame = "body"')
    assert mapfile.parse(answered, "m.toml").map.records is not None


def test_names_of_one_letter_an_axis_and_more_are_found_and_a_unit_that_is_none_is_quoted() -> None:
    fast, slow = np.arange(2000) / 200, np.arange(500) / 50
    streams: dict[str, tuple[Numbers, str, str]] = {"imu/t": (fast, "", "s"), "cmd/t": (slow, "", "s")}
    for n, axis in enumerate("xyz"):
        streams[f"imu/dTheta_{axis}"] = (np.sin((n + 1) * fast), "imu/t", "rad")
        streams[f"imu/a{axis}_ftps2"] = (np.cos((n + 1) * fast), "imu/t", "ft/s^2")
        streams[f"cmd/M{axis}_cmd"] = (np.sin(slow), "cmd/t", "N m")
        streams[f"cmd/F{axis}_cmd"] = (np.cos(slow), "cmd/t", "N")
    text = propose.draft(recording(**streams))
    for said in ("imu/dTheta_x", "imu/ax_ftps2", "cmd/Mx_cmd", "cmd/Fx_cmd"):
        assert f'paths = ["{said}"' in text
    assert 'recorded as "ft/s^2", which is none of these: state scale beside it' in text


def test_what_is_ambiguous_is_asked_with_all_that_it_may_be() -> None:
    second = {f"imu/gyro2_{axis}": (np.zeros(2000), "imu/t", "rad/s") for axis in "xyz"}
    text = propose.draft(flight(**second)).split("[accelerometer]", maxsplit=1)[0]
    assert "# 2 could be it; take one of" in text
    assert '#   ["imu/gyro2_x", "imu/gyro2_y", "imu/gyro2_z"]   # 2000 samples, 200 Hz, rad/s' in text
    assert 'paths = ["?", "?", "?"]' in text
    # a setpoint and a bias are no sensors
    other = {f"imu/gyro_{kind}_{axis}": (np.zeros(2000), "imu/t", "rad/s") for kind in ("bias", "setpoint") for axis in "xyz"}
    assert 'paths = ["imu/gyro_x"' in propose.draft(flight(**other))


def section(text: str, key: str) -> str:
    """What a draft says under one key."""
    return text.split(f"[{key}]\n", maxsplit=1)[1].split("\n\n", maxsplit=1)[0]


def three(stem: str, unit: str, clock: str = "imu/t") -> dict[str, tuple[Numbers, str, str]]:
    """A vector of noise called so, with * for its axis."""
    rows = 2000 if clock == "imu/t" else 500
    return {stem.replace("*", axis): (np.random.default_rng(2).normal(size=rows), clock, unit) for axis in "xyz"}


def without(*parts: str) -> dict[str, tuple[Numbers, str, str]]:
    """The flight's streams but those that are called so."""
    return {path: (one.values, one.clock, one.unit) for path, one in flight().streams.items() if not any(part in path for part in parts)}


@pytest.mark.parametrize(
    ("key", "own", "other", "unit"),
    [
        ("gyro", "gyro", "imu/euler_*", "deg"),
        ("gyro", "gyro", "imu/mocap_*", "deg/s"),
        ("gyro", "gyro", "imu/rate_ref_*", "rad/s"),
        ("gyro", "gyro", "imu/rw_speed_*", "rad/s"),
        ("accelerometer", "acc", "imu/vel_*", "m/s"),
        ("accelerometer", "acc", "imu/B_*", "mG"),
        ("accelerometer", "acc", "imu/ang_acc_*", ""),
        ("accelerometer", "acc", "imu/acc_setpoint_*", "m/s^2"),
        ("gyro", "gyro", "imu/omega_world_*", "rad/s"),
        ("gyro", "gyro", "imu/omega_hat_*", "rad/s"),
        ("gyro", "gyro", "imu/chief_angular_velocity_*", "rad/s"),
        ("accelerometer", "acc", "imu/FreeAcc_*", "m/s^2"),
    ],
)
def test_a_unit_beats_no_name_and_what_a_name_excludes_is_no_sensor(key: str, own: str, other: str, unit: str) -> None:
    plain = without()
    plain |= {path: (values, clock, "") for path, (values, clock, _) in plain.items() if f"/{own}_" in path}
    beside = section(propose.draft(recording(**plain, **three(other, unit))), key)
    assert f'paths = ["imu/{own}_x", "imu/{own}_y", "imu/{own}_z"]' in beside
    alone = section(propose.draft(recording(**without(f"/{own}_"), **three(other, unit))), key)
    taken = 'paths = ["imu/mocap_x"' if "mocap" in other else 'paths = ["?", "?", "?"]'
    assert taken in alone


@pytest.mark.parametrize(
    ("others", "taken"),
    [
        (["torque_setpoint_*", "torque_measured_*", "disturbance_torque_*"], "own/torque_setpoint_x"),
        (["torque_*", "unallocated_torque_*", "torque_est_*"], "own/torque_x"),
        (["allocated_torque_*", "torqueCmd_*"], "own/torqueCmd_x"),
        (["disturbance_torque_*", "gg_torque_*", "measuredTorque_*"], None),
        (["torque_*", "wheel_torque_*", "aero_torque_*", "gripper_ft_torque_*", "tauHat_*"], "own/torque_x"),
        (["torque_ref_*"], None),
        (["torque_1_*", "torque_2_*"], None),
    ],
)
def test_a_command_is_what_was_told_not_what_was_felt(others: list[str], taken: str | None) -> None:
    streams = without("torque")
    for name in others:
        streams |= three(f"own/{name}", "N m", "cmd/t")
    told = section(propose.draft(recording(**streams)), "torque")
    assert (f'paths = ["{taken}"' if taken else 'paths = ["?", "?", "?"]') in told
    assert ("could be it" in told) == (taken is None and "measuredTorque_*" not in others)


def test_what_is_told_of_a_jet_beside_its_command_is_no_jet() -> None:
    told = {f"own/jet_{name}_s": (np.zeros(500), "cmd/t", "") for name in ("left", "temp", "enabled")}
    text = propose.draft(recording(**without("torque", "force"), **told))
    assert "[jets.left]" in text
    assert "[jets.temp]" not in text
    assert "[jets.enabled]" not in text
    asked = {"own/duty_3": (np.zeros(500), "cmd/t", ""), "own/thr0_ontime_ms": (np.zeros(500), "cmd/t", "")}
    text = propose.draft(recording(**without("torque", "force"), **asked))
    assert all(f'# path = "{path}"' in text for path in asked)


def test_a_draft_lists_every_stream_that_may_command_an_actuator() -> None:
    plain = without("torque", "force")
    many = {f"own/RCS{n}_OnTime": (np.ones(500), "cmd/t", "ms") for n in range(1, 17)}
    text = propose.draft(recording(**plain, **many))
    assert all(f'# path = "{path}"' in text for path in many)
    assert "more" not in text.partition("[jets.NAME]")[2].partition("unit =")[0]
    most = {f"own/RCS{n}_OnTime": (np.ones(500), "cmd/t", "ms") for n in range(100)}
    assert "# ... and 36 more, which massprop columns lists" in propose.draft(recording(**plain, **most))


@pytest.mark.parametrize("path", ["actuator_motors/control[2]", "own/fan2_pct", "own/motor2_pwm"])
def test_commands_of_rotors_are_no_valves(path: str) -> None:
    text = propose.draft(recording(**without("torque", "force"), **{path: (np.ones(500), "cmd/t", "")}))
    assert f'# [rotors.NAME]\n# path = "{path}"' in text
    assert "[jets.NAME]" not in text


def test_the_table_of_an_actuator_has_the_clock_that_the_file_does_not_name() -> None:
    told = {"stamp_s": (np.arange(500) / 50, "", "s"), "thr0_on_ms": (np.ones(500), "", "ms")}
    text = propose.draft(recording(**without("torque", "force", "cmd"), **told))
    assert '# path = "thr0_on_ms"\n# clock = { path = "stamp_s" }' in text


def test_tables_of_wheels_rotors_and_gimbals_are_shown_with_what_may_be_theirs() -> None:
    told = {f"own/{name}": (np.arange(500.0), "cmd/t", "") for name in ("rw1_rpm", "esc_2", "gimbal_3")} | {
        "own/m4": (np.ones(500), "cmd/t", "rpm")
    }
    text = propose.draft(recording(**without("torque", "force"), **told))
    speeds, _, angles = text.partition("# [control_moment_gyros.NAME]")
    assert "# [wheels.NAME]   # or [rotors.NAME]" in speeds
    assert [path for path in told if f'# path = "{path}"' in speeds] == ["own/rw1_rpm", "own/esc_2", "own/m4"]
    assert [path for path in told if f'# path = "{path}"' in angles] == ["own/gimbal_3"]
    assert "[wheels" not in propose.draft(flight())


def test_rates_called_by_a_letter_are_a_gyro() -> None:
    text = propose.draft(recording(**without("gyro"), **three("imu/g*", "")))
    assert 'paths = ["imu/gx", "imu/gy", "imu/gz"]' in section(text, "gyro")


def test_a_change_of_attitude_is_none() -> None:
    turned = {f"est/{name}[{n}]": (np.full(2000, 0.5), "imu/t", "") for name in ("q", "delta_q_reset") for n in range(4)}
    text = propose.draft(flight(**turned))
    assert 'paths = ["est/q[0]"' in text
    assert "delta_q_reset" not in text


def test_increments_are_drafted_as_such_where_they_are_known_to_cover_their_time() -> None:
    streams = without("gyro") | three("imu/delta_angle_*", "rad")
    text = section(propose.draft(recording(**streams)), "gyro")
    assert 'values = "?"   # "increment", by its unit, if each covers all the time since the one before' in text
    whole = {"imu/delta_angle_dt": (np.full(2000, 5000), "imu/t", "")}
    text = section(propose.draft(recording(**streams, **whole)), "gyro")
    assert "values = \"increment\"   # by its unit; 'imu/delta_angle_dt' says that each covers the time since the one before" in text
    half = {"imu/delta_angle_dt": (np.full(2000, 2500), "imu/t", "")}
    text = section(propose.draft(recording(**streams, **half)), "gyro")
    assert "by 'imu/delta_angle_dt' each covers 2500, and they come every 0.005 by their clock" in text
    assert 'paths = ["?", "?", "?"]' in text
    # a stream of rates is then the only one
    assert 'paths = ["imu/gyro_x"' in propose.draft(flight(**three("imu/delta_angle_*", "rad"), **half))


def test_a_clock_that_nothing_names_is_asked_for() -> None:
    held = flight().streams
    clockless = {path: (one.values, "", one.unit) for path, one in held.items() if path.startswith("imu")}
    count = {"imu/n": (np.arange(2000), "", ""), "imu/m": (np.arange(2000) * 3, "", "")}
    named = propose.draft(flight(**clockless, **count))
    assert 'clock = { path = "imu/t" }' in named
    clockless["imu/t"] = (held["imu/t"].values[::-1].copy(), "", "")
    assert 'clock = { path = "?", unit = "?" }   # one of "imu/n", "imu/m"' in propose.draft(flight(**clockless, **count))
    clockless["imu/t"] = (held["imu/t"].values * 1e6, "", "")
    assert 'clock = { path = "imu/t", unit = "?" }   # s, ms, us or ns: not recorded; samples come every 5000' in propose.draft(
        flight(**clockless)
    )


@pytest.mark.parametrize(("step", "told"), [(0.01, "0.01"), (0.010002, "0.010002")])
def test_stamps_that_scatter_give_the_interval_that_samples_have(step: float, told: str) -> None:
    random, began = np.random.default_rng(0), 1_700_000_000_000_000_000
    streams = without()
    for clock, count, every in (("imu/t", 2000, step), ("cmd/t", 500, 5 * step)):
        stamps = np.arange(count) * every + random.uniform(0, 0.2 * step * ("2" not in told), count)
        streams[clock] = began + np.round(stamps * 1e9).astype(np.int64), "", "ns"
    read = recording(**streams)
    assert f"interval_s = {told}   # commands come at {0.2 / step:.6g} Hz, the slower sensor at {1 / step:.6g} Hz" in propose.draft(read)
    assert listing.Clocks(read).rate_hz(read.streams["imu/gyro_x"]) == pytest.approx(1 / step, rel=1e-9)


def test_streams_are_listed_with_rate_range_and_unit(tmp_path: Path) -> None:
    told: dict[str, Any] = {one.path: one for one in listing.listed(flight())}
    gyro = told["imu/gyro_y"]
    assert (gyro.samples, gyro.unit, gyro.clock) == (2000, "rad/s", "imu/t")
    assert gyro.rate_hz == pytest.approx(200)
    assert (gyro.least, gyro.most) == (pytest.approx(-1, abs=1e-4), pytest.approx(1, abs=1e-4))
    assert told["imu/t"].note == "increasing"
    pq.write_table(pa.table({"t_ms": [0.0, 10.0, 20.0], "w [deg/s]": [1.0, 2.0, 1.0], "event": ["a", "", "b"]}), tmp_path / "own.parquet")
    run = succeeded(tmp_path, "columns", "own.parquet", "--json")
    streams = {one["path"]: one for one in json.loads(run.stdout)["streams"]}
    assert streams["w [deg/s]"]["unit"] == "deg/s"
    assert streams["w [deg/s]"]["rate_hz"] == pytest.approx(100)
    assert streams["event"]["note"] == "no numbers"
    run = massprop(tmp_path, "columns", "own.parquet")
    assert run.returncode == 0
    assert "3 streams of a table" in run.stdout
    assert 'have a "?" to be answered: massprop columns own.parquet --as-map > own.map.toml' in run.stderr


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "own.txt").write_text("x")
    run = massprop(tmp_path, "columns", "own.txt")
    assert run.returncode == 3
    assert "unknown kind of file '.txt'" in run.stderr
    assert massprop(tmp_path, "columns", "none.csv").returncode == 3


def test_times_of_ros_and_px4_begin_the_log_at_zero() -> None:
    late = flight().streams
    shifted = {path: (one.values + 1.76e9, "", "s") for path, one in late.items() if path.endswith("/t")}
    assert 'zero = "start"' in propose.draft(flight(**shifted))
