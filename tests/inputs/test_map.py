import random
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns, telemetry
from massprop_cli.inputs.formats import mapfile, mapped, reading, recording, resample
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.vehiclefile import parse
from tests.streams import RECORDS, SIX, WRENCH_MAP, made, motion, values

SAMPLES = Path(__file__).parents[2] / "sample_logs"


def test_records_are_the_integrals_of_what_was_sampled() -> None:
    table = made(motion(), WRENCH_MAP + RECORDS)
    time_s = table.columns["time_s"].numbers()
    for n in range(3):
        integral = -np.cos((n + 1) * time_s) / (n + 1), np.sin((n + 1) * time_s) / (n + 1)
        found = values(table, columns.DELTA_THETA)[:, n], values(table, columns.DELTA_V)[:, n]
        for whole, part in zip(integral, found, strict=True):
            np.testing.assert_allclose(part[1:], np.diff(whole), atol=2e-6)
            # nothing is lost or counted twice from record to record
            assert part[1:].sum() == pytest.approx(whole[-1] - whole[0], abs=4e-5)


def test_cycles_begin_with_the_commands_and_hold_one_each() -> None:
    streams = motion()
    table = made(streams, WRENCH_MAP + RECORDS)
    assert table.rows % 5 == 0
    assert table.columns["time_s"].numbers()[0] == pytest.approx(0.0207 + 0.01)
    commands = values(table, columns.WRENCH)
    stated = np.stack([streams[f"cmd/{kind}{axis}"][0] for kind, axis, _ in SIX], 1)
    np.testing.assert_allclose(commands[::5], stated[: table.rows // 5], atol=1e-9)
    assert table.made is not None
    said = "\n".join(table.made.conversions)
    for part in (
        "gyro: 4000 values (sample)",
        "integrated over",
        "held until the next",
        "control cycles begin with the first command",
    ):
        assert part in said


ORIGINAL = f"""
schema = 1
clock = {{ path = "timestamp", unit = "us" }}
[gyro]
paths = "gyro.?"
unit = "deg/s"
values = "mean"
[accelerometer]
paths = "acc.?"
unit = "g"
scale = {9.81 / 9.80665} # it was brought in with 9.81 m/s^2
values = "mean"
[torque]
paths = [0, 0, 0]
[force]
paths = [0, 0, "motor.m1"]
unit = "N" # of no meaning here: a thrust curve lies in between
[records]
samples = 10
"""


def test_a_recorded_flights_original_columns_give_its_increments() -> None:
    path = Path(__file__).parents[1] / "data" / "crazyflie-original.csv.gz"
    table = mapped.of(reading.read(path, path.read_bytes()), mapfile.parse(ORIGINAL, "m.toml"))
    known = read_table(SAMPLES / "crazyflie" / "thrust.parquet")
    assert table.rows == 60
    for names in (columns.DELTA_THETA, columns.DELTA_V):
        np.testing.assert_allclose(values(table, names), values(known, names)[:60], rtol=1e-9, atol=1e-12)
    steps = np.diff(table.columns["time_s"].numbers())
    np.testing.assert_allclose(steps, np.diff(known.columns["time_s"].numbers())[:59], atol=1e-9)


def test_no_impulse_is_lost_where_commands_and_cycles_differ() -> None:
    streams = motion(command_hz=47.0)
    table = made(streams, WRENCH_MAP + RECORDS)
    edges = np.append(0.0207, table.columns["time_s"].numbers()[4::5])
    issued, torque = streams["cmd/t"][0], streams["cmd/tx"][0]
    fine = np.linspace(edges[0], edges[-1], 2_000_001)
    held = torque[np.searchsorted(issued, (fine[1:] + fine[:-1]) / 2, "right") - 1]
    assert (table.columns["cmd_torque_x_n_m"].numbers()[::5] * np.diff(edges)).sum() == pytest.approx(
        held.sum() * (fine[1] - fine[0]), rel=1e-4
    )


def test_axes_signs_scales_and_units_are_applied() -> None:
    text = WRENCH_MAP.replace('values = "sample"\n[acc', 'values = "sample"\naxes = ["y", "-x", "z"]\nscale = 2.0\n[acc')
    streams = motion()
    streams |= {path: (streams[path][0], "imu/t", "deg/s") for path in ("imu/wx", "imu/wy", "imu/wz")}
    plain, turned = made(motion(), WRENCH_MAP + RECORDS), made(streams, text + RECORDS)
    x, y, z = values(plain, columns.DELTA_THETA).T * 2 * np.pi / 180
    np.testing.assert_allclose(values(turned, columns.DELTA_THETA), np.stack([y, -x, z], 1), atol=1e-15)


def test_world_commands_are_turned_with_the_logged_attitude() -> None:
    streams = motion()
    t = streams["imu/t"][0][::4]
    turns = Rotation.from_rotvec(np.stack([0.3 * np.sin(t), 0.2 * t, 0.1 * np.cos(t)], 1))
    quaternion = turns.as_quat()  # xyzw
    streams |= {"att/t": (t, "", "s")} | {f"att/q{n}": (quaternion[:, n], "att/t", "") for n in range(4)}
    world = WRENCH_MAP.replace('paths = "cmd/f?"', 'paths = "cmd/f?"\nframe = "world"')
    text = world + RECORDS + '[attitude]\npaths = "att/q?"\norder = "xyzw"\n'
    # the gyro of the recording has nothing to do with this attitude, which the map's maker can't see, but the log's reader does
    table = made(streams, text)
    issued = streams["cmd/t"][0][: table.rows // 5]
    force = np.stack([streams[f"cmd/f{axis}"][0] for axis in "xyz"], 1)[: len(issued)]
    wanted = Slerp(t, turns)(issued).inv().apply(force)
    np.testing.assert_allclose(values(table, columns.WRENCH[3:])[::5], wanted, atol=1e-4)
    ends = Slerp(t, turns)(np.clip(table.columns["time_s"].numbers(), None, t[-1])).as_quat()[:, [3, 0, 1, 2]]
    same = np.abs((values(table, columns.QUATERNION) * ends).sum(1))
    logged = np.isfinite(same)  # attitudes come half as often as records end
    assert abs(logged.sum() - table.rows / 2) < 2
    np.testing.assert_allclose(same[logged], 1.0, atol=1e-8)
    # in a world whose z is down, commands are of that world too; the log's own is z up
    down = made(streams, text + 'world = "z_down"\n')
    np.testing.assert_allclose(values(down, columns.WRENCH), values(table, columns.WRENCH), atol=1e-15)
    half = (Rotation.from_euler("x", 180, degrees=True) * Rotation.from_quat(ends[:, [1, 2, 3, 0]])).as_quat()[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(np.abs((values(down, columns.QUATERNION) * half).sum(1))[logged], 1.0, atol=1e-8)
    with pytest.raises(InputError, match=r"m.toml.*attitude contradict each other.*\[attitude\]"):
        telemetry.read(table, parse("schema = 1\n[cycle]\nperiod_s = 0.05\n", "v").vehicle)


def test_a_valves_openings_become_on_times() -> None:
    streams = motion()
    t = 0.0007 + np.arange(20_000) / 1000
    opened = ((t * 7) % 1 < 0.3).astype(np.uint8)
    streams |= {"valve/t": (t, "", "s"), "valve/a": (opened, "valve/t", "")}
    text = WRENCH_MAP.split("[torque]", maxsplit=1)[0] + '[jets.a]\npath = "valve/a"\nunit = "open"\n' + RECORDS
    table = made(streams, text)
    on = table.columns["jet_a_s"].numbers()[::5]
    assert on.min() >= 0
    assert on.max() <= 0.05 + 1e-12
    assert on.sum() == pytest.approx(0.3 * table.rows * 0.01, rel=5e-3)


@pytest.mark.parametrize(
    ("hz", "began_s", "said"),
    [(97.0, 0.0, False), (47.0, 0.0, True), (40.0, 0.0037, True), (100.0, 0.0013, False)],
    ids=["often", "seldom", "between records' ends", "at records' ends"],
)
def test_speeds_on_a_clock_of_their_own_are_told_of_where_they_are_made_up(hz: float, began_s: float, said: bool) -> None:
    """With 2.35 readings in a control cycle clean logs didn't fit, and it was not said that speeds in between are made up."""
    streams = motion()
    t = began_s + np.arange(round(20 * hz)) / hz
    own = 4.2 + t * (1 + 5e-5)
    steps = 0.05 * np.arange(401)
    speed = np.interp(t, steps, np.cumsum(np.random.default_rng(4).normal(size=401)))  # torque steps in each control cycle
    streams |= {"rw/t": (own, "", "s"), "rw/n": (speed, "rw/t", "rad/s")}
    clock = f'clock = {{ path = "rw/t", scale = {1 / (1 + 5e-5)!r}, offset_s = {-4.2 / (1 + 5e-5)!r} }}\n'
    text = WRENCH_MAP.split("[torque]", maxsplit=1)[0] + '[wheels.x]\npath = "rw/n"\n' + clock + RECORDS
    table = made(streams, text)
    ends = table.columns["time_s"].numbers()
    np.testing.assert_allclose(table.columns["wheel_x_rad_s"].numbers(), np.interp(ends, t, speed), atol=1e-6)
    assert table.made is not None
    told = [line for line in table.made.conversions if "made up" in line]
    assert len(told) == said
    assert not said or f"where it was not read: {hz / 20:.3g} times in a control cycle of 0.05 s" in told[0]


@pytest.mark.parametrize(("hz", "slow"), [(40.0, False), (20.0, False), (10.0, True), (2.0, True)])
def test_speeds_of_wheels_that_come_slower_than_control_cycles_are_told_of(hz: float, slow: bool) -> None:
    streams = motion()
    t = np.arange(round(20 * hz)) / hz
    streams |= {"rw/t": (t, "", "s"), "rw/n": (100 * np.sin(t), "rw/t", "rad/s"), "bus/v": (12 + 0 * t, "rw/t", "V")}
    text = WRENCH_MAP.split("[torque]", maxsplit=1)[0] + '[wheels.x]\npath = "rw/n"\n[supply]\npath = "bus/v"\n' + RECORDS
    table = made(streams, text)
    ends = table.columns["time_s"].numbers()
    np.testing.assert_allclose(table.columns["wheel_x_rad_s"].numbers(), np.interp(ends, t, 100 * np.sin(t)), atol=1e-9)
    assert table.made is not None
    told = [line for line in table.made.conversions if "made up" in line]
    wanted = f"wheels.x: every {1 / hz:g} s, interpolated to the records' ends: slower than control cycles of 0.05 s, so that in between"
    assert len(told) == slow
    assert not slow or told[0].startswith(wanted)
    assert (table.columns["supply_v"].numbers() == 12).all()
    pressed = made(streams | {"bus/v": (20 + 0 * t, "rw/t", "bar")}, text)
    np.testing.assert_allclose(pressed.columns["supply_pa"].numbers(), 2e6)


def test_a_fill_value_is_none_before_its_unit_makes_it_another_number() -> None:
    """Of -9999 in deg/s nothing was left that looks like one, and the gyro was said to saturate at 174.5 rad/s."""
    streams = motion()
    for axis in "xyz":
        rate = np.degrees(streams[f"imu/w{axis}"][0])
        rate[[300, 900]] = -9999.0
        streams[f"imu/w{axis}"] = rate, "imu/t", "deg/s"
    found, wanted = (values(made(one, WRENCH_MAP + RECORDS), columns.DELTA_THETA) for one in (streams, motion()))
    np.testing.assert_allclose(found, wanted, atol=5e-5)


@pytest.mark.parametrize(
    ("recorded", "stated", "factor"), [("mN m", "", 1e-3), ("Nm", 'unit = "N m"', 1.0), ("A", 'unit = "N m"\nscale = 0.025', 0.025)]
)
def test_torques_on_wheels_are_columns_of_torque_in_any_unit_and_currents_with_their_scale(
    recorded: str, stated: str, factor: float
) -> None:
    streams = motion()
    t = 0.05 * np.arange(400)
    text = WRENCH_MAP.split("[torque]", maxsplit=1)[0] + '[wheels.x]\npath = "rw/i"\nholds = "until_next"\n'
    one, other = (
        made(streams | {"rw/t": (t, "", "s"), "rw/i": (np.sin(t), "rw/t", unit)}, text + said + "\n" + RECORDS)
        for unit, said in (("N m", ""), (recorded, stated))
    )
    torque = one.columns["wheel_x_n_m"].numbers()
    assert np.nanstd(torque) > 0.5
    np.testing.assert_allclose(other.columns["wheel_x_n_m"].numbers(), factor * torque, atol=1e-12)


REFUSED = {
    "no such path": (
        WRENCH_MAP.replace('"imu/w?"', '["imu/wx", "imu/wy", "imu/zz"]'),
        r"'imu/zz'.*no such path.*nearest is 'imu/wz'.*\[gyro\]",
    ),
    "a pattern that fits too much": (WRENCH_MAP.replace('"imu/w?"', '"imu/*"'), r"'imu/\*': the pattern fits 7 paths, not 3"),
    "a pattern that fits nothing": (WRENCH_MAP.replace('"imu/w?"', '"gyro/*"'), r"fits 0 paths, not 3: nothing; the nearest path is"),
    "another unit than recorded": (
        WRENCH_MAP.replace('"imu/w?"', '"imu/w?"\nunit = "deg/s"'),
        r"'imu/wx'.*map says unit 'deg/s', the file 'rad/s'",
    ),
    "a unit of something else": (
        WRENCH_MAP.replace('"imu/a?"', '"imu/a?"\nunit = "N"'),
        r"'N' is none of this quantity; it is one of m/s\^2, g",
    ),
    "an axis twice": (
        WRENCH_MAP.replace('"imu/w?"', '"imu/w?"\naxes = ["x", "x", "z"]'),
        r"m.toml, line 5: gyro.axes.*names an axis twice",
    ),
    "a mirror": (WRENCH_MAP.replace('"imu/w?"', '"imu/w?"\naxes = ["y", "x", "z"]'), r"gyro.axes.*is a mirror, not a turn"),
    "clocks apart": (
        WRENCH_MAP.replace('"cmd/t?"', '"cmd/t?"\nclock = { path = "cmd/t", offset_s = 1e4 }') + RECORDS,
        r"'cmd/t'.*two clocks don't overlap: torque is 10000.0207 to 10019.9707 s by 'cmd/t', .* state the clock.offset_s",
    ),
    "records not recorded": (
        WRENCH_MAP + RECORDS.replace("0.01", "0.004"),
        r"'imu/wx': comes every 0.005 s, so records of 0.004 s would be invented",
    ),
    "no records for two clocks": (WRENCH_MAP, r"'imu/ax': its clock 'acc/t' is not the gyro's, 'imu/t'; state \[records\]"),
    "no commands": (WRENCH_MAP.split("[torque]", maxsplit=1)[0], r"maps no command; add \[torque\]"),
    "half a wrench": (WRENCH_MAP.split("[force]", maxsplit=1)[0], r"\[force\] is missing.*paths = \[0, 0, 0\]"),
    "world without attitude": (WRENCH_MAP + 'frame = "world"\n', r'frame = "world" needs \[attitude\]'),
    "an unknown key": (WRENCH_MAP + "hold = 1\n", r"m.toml, line 13: unknown key 'force.hold'; the nearest known key is 'holds'"),
    "cut away": (WRENCH_MAP + RECORDS + "start_s = 19.97\n", r"'imu/t': from 19.97.* are fewer than two control cycles of 0.05 s"),
}


@pytest.mark.parametrize(("unit", "taken"), [("rev/s", False), ("ft/s", False), ("LSB", False), ("us", False), ("body", True), ("", True)])
def test_a_unit_that_none_here_is_wants_a_factor_beside_the_one_that_is_stated(unit: str, taken: bool) -> None:
    """A gyro in revolutions had been taken for one in rad/s since the map said so; a label says nothing of a unit."""
    streams = motion() | {f"imu/w{axis}": (motion()[f"imu/w{axis}"][0], "imu/t", unit) for axis in "xyz"}
    stated = WRENCH_MAP.replace('"imu/w?"', '"imu/w?"\nunit = "rad/s"')
    if taken:
        assert made(streams, stated + RECORDS).rows
        return
    with pytest.raises(InputError, match=f"map says unit 'rad/s', and the file '{unit}', which is none here: state scale beside it"):
        made(streams, stated + RECORDS)
    assert made(streams, stated.replace('unit = "rad/s"', 'unit = "rad/s"\nscale = 6.2831853') + RECORDS).rows


@pytest.mark.parametrize(("text", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_a_wrong_map_is_refused_with_file_path_and_remedy(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        made(motion(), text)


def test_streams_that_are_not_right_are_refused() -> None:
    text = WRENCH_MAP + RECORDS
    broken = motion()
    gap = np.delete(np.arange(4000), np.arange(2000, 2050))
    broken |= {path: (broken[path][0][gap], *broken[path][1:]) for path in broken if path.startswith("imu/w") or path == "imu/t"}
    with pytest.raises(InputError, match=r"'imu/wx': a gap of 0.255 s after 9.995 s.*records.start_s or end_s"):
        made(broken, text)
    broken = motion()
    broken["imu/t"] = (np.where(np.arange(4000) == 7, 0.0, broken["imu/t"][0]), "", "s")
    with pytest.raises(InputError, match="'imu/t': time repeats or goes back at sample 7"):
        made(broken, text)
    broken = motion()
    broken["imu/t"] = (np.where(np.arange(4000) == 0, np.nan, broken["imu/t"][0]), "", "s")
    with pytest.raises(InputError, match="'imu/t': nan at sample 0 is not a finite number"):
        made(broken, text + 'zero = "start"\n')
    broken = motion()
    broken["imu/t"] = (np.where(np.arange(4000) == 2, 3, 5 * np.arange(4000) + 7).astype(np.uint64), "", "ms")
    with pytest.raises(InputError, match="'imu/t': time repeats or goes back at sample 2"):
        made(broken, text + 'zero = "start"\n')
    broken = motion()
    broken["imu/wy"] = (np.where(np.arange(4000) % 10 == 9, np.nan, broken["imu/wy"][0]), "imu/t", "rad/s")
    with pytest.raises(InputError, match="'imu/wx': a number is missing at sample 9, beside other axes'; correct the row"):
        made(broken, text)
    broken = motion()
    broken |= {path: (said[0], said[1], "") for path, said in broken.items()}
    with pytest.raises(InputError, match="'imu/wx': the file records no unit; state unit = one of rad/s, deg/s"):
        made(broken, text)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ('axes = ["y", "z", "x"]', r"\[gyro\] of m.toml and the logged attitude contradict .* agrees with axes = \['z', 'x', 'y'\]"),
        ('axes = ["-x", "-y", "z"]', r"agrees with axes = \['-x', '-y', 'z'\]"),
        ('unit = "deg/s"', r"agrees with unit = 'rad'"),
    ],
)
def test_axes_and_units_that_the_logged_attitude_denies_are_named(wrong: str, message: str) -> None:
    streams = motion()
    t = streams["imu/t"][0]
    rate = np.stack([streams[f"imu/w{axis}"][0] for axis in "xyz"], 1)
    turn = Rotation.identity()
    quaternions = []
    for step in (rate[1:] + rate[:-1]) / 2 * np.diff(t)[:, None]:
        quaternions.append(turn.as_quat())
        turn = turn * Rotation.from_rotvec(step)
    quaternion = np.array([*quaternions, turn.as_quat()])
    streams |= {f"att/q{n}": (quaternion[:, n], "imu/t", "") for n in range(4)}
    streams |= {path: (streams[path][0], "imu/t", "") for path in ("imu/wx", "imu/wy", "imu/wz")}
    text = WRENCH_MAP + RECORDS + '[attitude]\npaths = "att/q?"\norder = "xyzw"\n'
    vehicle = parse("schema = 1\n[cycle]\nperiod_s = 0.05\n", "v").vehicle
    right = text.replace('"imu/w?"', '"imu/w?"\nunit = "rad/s"')
    assert telemetry.read(made(streams, right), vehicle).attitude_wxyz is not None
    said = wrong if "unit" in wrong else f'unit = "rad/s"\n{wrong}'
    with pytest.raises(InputError, match=message):
        telemetry.read(made(streams, text.replace('"imu/w?"', f'"imu/w?"\n{said}')), vehicle)


def test_integrals_between_edges_are_those_of_each_kind() -> None:
    times, edges = np.array([1.0, 2.0, 4.0, 5.0]), np.array([1.5, 3.0, 5.0])
    rate = np.array([[2.0], [4.0], [1.0], [3.0]])
    # by hand: trapezoids 3, 5, 2; means 4·1, 1·2, 3·1; increments as they are
    np.testing.assert_allclose(resample.increments(rate, times, "sample", edges), [[1.5 + 2.5], [2.5 + 2.0]])
    np.testing.assert_allclose(resample.increments(rate, times, "mean", edges), [[2.0 + 1.0], [1.0 + 3.0]])
    np.testing.assert_allclose(resample.increments(rate, times, "increment", edges), [[2.0 + 0.5], [0.5 + 3.0]])
    np.testing.assert_allclose(resample.means(rate, times, "until_next", edges), [[(1.0 + 4.0) / 1.5], [(4.0 + 1.0) / 2]])
    np.testing.assert_allclose(resample.means(rate, times, "since_last", edges), [[(2.0 + 1.0) / 1.5], [(1.0 + 3.0) / 2]])


def test_a_pattern_fits_what_the_regular_expression_for_it_fits() -> None:
    draw = random.Random(1)
    fitted = 0
    for _ in range(3000):
        path = "".join(draw.choices("ab/", k=draw.randrange(7)))
        pattern = "".join(draw.choices(["a", "b", "/", "*", "**", "?"], k=draw.randrange(1, 6)))
        parts = re.split(r"(\*\*|\*|\?)", pattern)
        expression = "".join({"**": ".*", "*": "[^/]*", "?": "[^/]"}.get(part, re.escape(part)) for part in parts)
        wanted = [path] if re.fullmatch(expression, path) else []
        assert recording.fitting(pattern, [path]) == wanted, f"{pattern} on {path}"
        fitted += bool(wanted)
    assert fitted > 300
