"""A check says nothing of clean logs, names what is wrong with others and where, and gives the sigmas that an estimate gives."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from massprop_cli import estimate_log
from massprop_cli.base.arrays import Array
from massprop_cli.base.quaternion import rotation_vector, turns_between
from massprop_cli.check import flow
from massprop_cli.check.finding import Check, rows
from massprop_cli.check.signals import UNLIKELY, improbable_runs, sampling
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.require import requirements
from massprop_cli.testbed import output, scenario
from tests.campaigns import simulate
from tests.commandline import massprop

SAMPLES = Path(__file__).parents[2] / "sample_logs"
Columns = dict[str, Array]


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = simulate(tmp_path_factory.mktemp("check") / "flights", 1, "sensors.log_attitude=true")
    return folder / "seed-0001" / "log.parquet"


def spoiled(clean: Path, folder: Path, change: Callable[[Columns], None], **settings: float) -> Check:
    """The check of a log in which something was changed."""
    table = pq.read_table(clean)
    columns = {name: np.array(table.column(name), dtype=float).copy() for name in table.column_names}
    change(columns)
    found = pa.table(columns).replace_schema_metadata(table.schema.metadata)
    pq.write_table(found, folder / "log.parquet")
    return flow.check(folder / "log.parquet", None, (), [f"{key}={value}" for key, value in settings.items()])


def codes(found: Check) -> dict[str, str]:
    return {one.code: one.where for one in found.findings}


@pytest.mark.parametrize("name", ["free-flyer", "air-bearing", "scenarios/testbed"])
def test_nothing_is_said_of_a_clean_log(name: str) -> None:
    found = flow.check(SAMPLES / name / "log.parquet", None, (), ())
    assert (found.findings, found.fit, found.exit_code) == ([], True, 0)


def pulses(axes: str, start_s: float, end_s: float, more: str = "") -> str:
    driven = ", ".join(f'"{axis}"' for axis in axes.split())
    return f'{{motion="random", axes=[{driven}], every_cycles=5, max_cycles=4, start_s={start_s}, end_s={end_s}{more}}}'


def checked(name: str, settings: Sequence[str], seed: int, folder: Path) -> Check:
    output.simulate(scenario.load(name, settings), folder / "flight", seed, None)
    return flow.check(folder / "flight" / "log.parquet", None, (), ())


SHORT = {
    "planar": (pulses("yaw", 0, 3), pulses("x", 3, 6), pulses("y", 6, 8)),
    "wheels": (pulses("roll pitch yaw", 0, 8),),
    "wheels-and-jets": (pulses("roll pitch yaw", 0, 4), pulses("x y z", 4, 8)),
    "testbed-joined": (pulses("roll pitch yaw x y z", 0, 8),),
}


@pytest.mark.parametrize(
    ("name", "whole"), [*((name, False) for name in SHORT), pytest.param("wheels-and-jets", True, marks=pytest.mark.thorough)]
)
def test_nothing_is_said_of_other_clean_vehicles(name: str, whole: bool, tmp_path: Path) -> None:
    short = ("duration_s=8.0", f"plan=[{', '.join(SHORT[name])}]")
    found = checked(name, () if whole else short, 2, tmp_path)
    assert (found.findings, found.fit, found.exit_code) == ([], True, 0)


HOLD_THEN_DRIVE = (
    "duration_s=14.0",
    f"""plan=[{{motion="hold", start_s=0.0, end_s=7.0}}, {pulses("roll pitch yaw", 7, 14, ", closed_loop=true, level=0.6")},
    {pulses("x y z", 7, 14, ", force_n=0.6")}]""",
)


@pytest.mark.parametrize(("settings", "seed"), [(HOLD_THEN_DRIVE, 1), pytest.param((), 2, marks=pytest.mark.thorough)])
def test_nothing_is_said_of_a_phase_in_which_nothing_is_commanded(settings: Sequence[str], seed: int, tmp_path: Path) -> None:
    """Its columns are the noise that they should explain; before, that was a misfit whose cause nobody knew."""
    found = checked("docked-hold", ("control.model=truth", *settings), seed, tmp_path)
    assert {one.verdict for one in found.expected if one.phase == "single"} == {"not_excited"}
    assert [one.code for one in found.findings] == []


@pytest.mark.parametrize(
    ("name", "axes"), [("testbed", "x y z"), ("free-flyer", "yaw"), pytest.param("testbed", "roll", marks=pytest.mark.thorough)]
)
def test_nothing_is_said_of_a_log_in_which_some_axes_alone_are_driven(name: str, axes: str, tmp_path: Path) -> None:
    """What such a log does not tell is no misfit of it."""
    driven = ", ".join(f'"{axis}"' for axis in axes.split())
    found = checked(name, ["duration_s=6.0", f'plan=[{{motion="random", axes=[{driven}], start_s=0.0, end_s=6.0}}]'], 3, tmp_path)
    assert [one.code for one in found.findings] == []
    assert {one.verdict for one in found.expected} >= {"not_excited"}


def test_the_sigmas_are_those_of_an_estimate(clean: Path) -> None:
    found = flow.check(clean, None, requirements("mass<5%,ixx<1e-9 kg m^2"), ())
    told = estimate_log(clean).result.phases[0].estimates
    assert [one.sigma for one in found.expected] == [item.sigma for item in told.values()]
    reached = {one.quantity: one.reached for one in found.expected if one.reached is not None}
    assert reached == {
        "ixx": False,
        "mass": told["mass"].verdict == "converged" and (told["mass"].sigma or 9) < 0.05 * (told["mass"].value or 0),
    }
    assert found.exit_code == 4
    assert "ixx<1e-9 kg m^2 requires 1e-09 kg m^2 at most" in flow.message(found)


def test_all_faults_of_the_clock_are_told_with_their_rows(clean: Path, tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        time = columns["time_s"]
        time[10] = time[9]
        time[40:] -= 0.2
        time[80:] += 1.0

    found = spoiled(clean, tmp_path, change)
    assert codes(found) == {"duplicate-time": "row 10", "time-back": "row 40", "gap": "row 80"}
    assert (found.usable, found.exit_code, found.expected) == (False, 3, [])
    done = massprop(tmp_path, "check", "log.parquet", "--junit", "j.xml")
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    assert "records with the same time as the one before" in done.stderr
    assert "(row 10); remove the copies" in done.stderr
    suite = ET.parse(tmp_path / "j.xml").getroot()
    assert (suite.get("errors"), suite.get("failures")) == ("1", "0")
    assert len(suite.findall(".//testcase[@name='sampling']/error")) == 3


def test_a_cell_that_can_not_be_read_is_no_fault_of_the_clock(clean: Path, tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        columns["delta_v_y_m_s"][30::10] = np.nan

    (one,) = spoiled(clean, tmp_path, change).findings
    assert (one.subject, one.code, one.grade) == ("reading", "unusable", "unusable")
    assert "row 30, column delta_v_y_m_s" in one.what


def slow(columns: Columns) -> None:
    columns["time_s"] *= 1.01


@pytest.mark.thorough
def test_cycles_that_last_otherwise_than_stated_leave_nothing_converged(clean: Path, tmp_path: Path) -> None:
    """A time column that is 1 % off makes inertia 1 % off, and nothing else in the log shows it."""
    found = spoiled(clean, tmp_path, slow)
    (one,) = [one for one in found.findings if one.code == "cycle-period"]
    assert (one.subject, one.grade) == ("timing", "fault")
    assert "last 0.0505 s by the log's times, 1 % longer than cycle.period_s = 0.05 s" in one.what
    assert "state cycle.period_s = 0.0505, else scale them by 0.990099" in one.what
    assert {item.verdict for item in found.expected} == {"contradicted"}
    assert found.exit_code == 6
    assert flow.message(found).startswith(f"{found.log}: the log contradicts the vehicle file: cycles last 0.0505 s")
    assert {item.verdict for item in spoiled(clean, tmp_path, slow, **{"cycle.period_s": 0.0505}).expected} != {"contradicted"}


def test_scatter_of_the_clock_is_measured() -> None:
    rng = np.random.default_rng(1)
    steady = np.cumsum(np.full(2000, 0.05))
    assert sampling(steady, str) == []
    (found,) = sampling(np.cumsum(0.05 * (1 + 0.1 * rng.standard_normal(2000).clip(-3, 3))), str)
    assert found.code == "jitter"
    assert float(found.what.split("scatter by ")[1].split(" %")[0]) == pytest.approx(10, rel=0.1)


def test_rows_are_named_as_a_person_finds_them() -> None:
    where = np.zeros(20, dtype=bool)
    assert rows(where, str) == ""
    where[[3, 4, 5, 9, 15]] = True
    assert rows(where, lambda row: f"line {row + 2}") == "line 5 to 7, and 2 more places"


@pytest.mark.parametrize("counts", [0.7, 2.0, 20.0])
def test_a_run_is_told_where_chance_does_not_make_it_of_a_channel_that_counts_coarsely(counts: float) -> None:
    """Oracle: every run by itself, against how often the channel repeats itself outside it. Few counts make thousands of runs."""
    values = np.round(counts * np.random.default_rng(3).standard_normal(20000))
    values[400:460] = values[400]
    values[9000:9010] = values[9000]
    same = np.concatenate([[False], values[1:] == values[:-1]])
    expected = np.zeros(len(values), dtype=bool)
    for start in np.flatnonzero(same & ~np.concatenate([[False], same[:-1]])):
        end = start + int(np.argmin(np.append(same[start:], False)))
        elsewhere = (same.sum() - (end - start) + 1) / (len(values) - (end - start) + 1)
        if end - start >= 5 and len(values) * elsewhere ** (end - start) < UNLIKELY:
            expected[start - 1 : end] = True
    found = improbable_runs(values, np.zeros(len(values), dtype=bool))
    np.testing.assert_array_equal(found, expected)
    assert found[400:460].all()
    assert bool(found[9000]) is (counts > 10)


def stuck(columns: Columns) -> None:
    columns["delta_theta_y_rad"][50:60] = columns["delta_theta_y_rad"][50]


def dead(columns: Columns) -> None:
    columns["delta_v_z_m_s"][:] = 0.0


def held(columns: Columns) -> None:
    for name in columns:
        if name.startswith("delta"):
            columns[name][1::2] = columns[name][::2]


def clipped(columns: Columns) -> None:
    values = columns["delta_theta_x_rad"]
    columns["delta_theta_x_rad"] = np.minimum(values, np.quantile(values, 0.85))


def coarse(columns: Columns) -> None:
    for axis in "xyz":
        columns[f"delta_v_{axis}_m_s"] = np.round(columns[f"delta_v_{axis}_m_s"] / 0.005) * 0.005


def always(columns: Columns) -> None:
    columns["jet_roll_p1_s"][:] = 0.05


def opposed(columns: Columns) -> None:
    columns["jet_yaw_p1_s"][20:60] = columns["jet_yaw_n1_s"][20:60] = 0.02


def silent(columns: Columns) -> None:
    for name in columns:
        if name.startswith("jet"):
            columns[name][:] = 0.0


def conjugate(columns: Columns) -> None:
    for axis in "xyz":
        columns[f"quat_{axis}"] *= -1


def mirrored(columns: Columns) -> None:
    for axis in "xyz":
        columns[f"delta_theta_{axis}_rad"] *= -1


WRONG: dict[str, tuple[Callable[[Columns], None], str, str | None]] = {
    "stuck": (stuck, "stuck", "row 50 to 59"),
    "dead": (dead, "dead-axis", ""),
    "held": (held, "repeated-record", "row 1, and 59 more places"),
    "clipped": (clipped, "gyro-saturated", None),
    "coarse": (coarse, "quantised", ""),
    "always": (always, "jet-always-on", ""),
    "opposed": (opposed, "opposed-jets", "row 20 to 59"),
    "silent": (silent, "nothing-commanded", ""),
    "conjugate": (conjugate, "attitude-gyro", ""),
    "mirrored": (mirrored, "attitude-gyro", ""),
}
"""What is done to a log, what it is called, and where it is."""


@pytest.mark.parametrize(
    "faults",
    [
        "stuck clipped coarse opposed conjugate",
        "held silent mirrored",
        pytest.param("dead always", marks=pytest.mark.thorough),
    ],
)
def test_what_is_wrong_is_named_with_its_place(faults: str, clean: Path, tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        for fault in faults.split():
            WRONG[fault][0](columns)

    found = spoiled(clean, tmp_path, change)
    for _, code, where in map(WRONG.__getitem__, faults.split()):
        assert code in codes(found)
        assert where is None or codes(found)[code] == where
        (one,) = [one for one in found.findings if one.code == code][:1]
        assert one.remedy
        assert one.sure
        assert found.fit is False or one.grade == "note"


@pytest.mark.thorough
def test_a_clipped_channel_is_told_once_and_nothing_mends_it(clean: Path, tmp_path: Path) -> None:
    """It was said three times, as standing still and as saturated, the last with "the log passes its test once it is corrected"."""

    def cut(columns: Columns) -> None:
        values = columns["delta_theta_x_rad"]
        most = np.quantile(np.abs(values), 0.9)
        columns["delta_theta_x_rad"] = np.clip(values, -most, most)

    found = spoiled(clean, tmp_path, cut)
    assert "stuck" not in codes(found)
    (one,) = [one for one in found.findings if one.code == "gyro-saturated"]
    assert one.sure == "certain"
    assert "never larger: clipped" in one.what
    stated = spoiled(clean, tmp_path, cut, **{"imu.accel_range_m_s2": 1e-3})
    assert "accelerometer-saturated" in codes(stated)
    assert all("once it is corrected" not in one.sure for one in stated.findings)


def test_a_stated_range_is_told_with_its_rows(clean: Path, tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        columns["delta_theta_x_rad"][30:33] = 0.05 * 0.5

    found = spoiled(clean, tmp_path, change, **{"imu.gyro_range_rad_s": 0.5})
    assert [one.where for one in found.findings if one.code == "gyro-saturated"] == ["row 30 to 32"]


@pytest.mark.thorough
def test_a_fault_of_the_vehicle_file_is_named_as_an_estimate_names_it(clean: Path) -> None:
    settings = ("jets.0.force_n=[0.0, 0.0, -1.112055404]",)
    found = flow.check(clean, None, (), settings)
    told = estimate_log(clean, settings={"jets.0.force_n": [0.0, 0.0, -1.112055404]}).result.warnings
    assert {warning.code for warning in told} <= {one.code for one in found.findings}
    assert not found.fit
    assert any(one.code in ("jet-sign", "thrust-scale") for one in found.findings)


def test_a_step_of_attitude_is_the_turn_between() -> None:
    """Against quaternions that are built from known rotation vectors."""
    rng = np.random.default_rng(2)
    turn = rng.standard_normal((50, 3)) * 0.2
    angle = np.linalg.norm(turn, axis=1)
    step = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * turn / angle[:, None]])
    attitude = [np.array([0.6, 0.0, 0.8, 0.0])]
    for s in step:
        w, v = attitude[-1][0], attitude[-1][1:]
        attitude.append(np.concatenate([[w * s[0] - v @ s[1:]], w * s[1:] + s[0] * v + np.cross(v, s[1:])]))
    signs = np.where(rng.random(51) < 0.5, -1.0, 1.0)[:, None]  # q and -q are one attitude
    np.testing.assert_allclose(rotation_vector(turns_between(np.array(attitude) * signs)), turn, atol=1e-12)


@pytest.mark.thorough
def test_gravity_off_the_vertical_is_told(tmp_path: Path) -> None:
    hold = 'plan=[{motion="random",axes=["roll","pitch","yaw"],start_s=0.0,end_s=4.0,closed_loop=true}]'
    source = scenario.load("testbed", ["duration_s=4.0", hold, "sensors.log_attitude=true"])
    output.simulate(source, tmp_path / "flight", 1, None)
    log = tmp_path / "flight" / "log.parquet"
    assert not [one for one in flow.check(log, None, (), ()).findings if one.subject == "attitude"]
    tilted = tmp_path / "vehicle.toml"
    c, s = np.cos(0.1), np.sin(0.1)
    text = (tmp_path / "flight" / "vehicle.toml").read_text().replace("[imu]", f"[imu]\nbody_from_imu = [[1,0,0],[0,{c},{-s}],[0,{s},{c}]]")
    tilted.write_text(text)
    vehiclefile.load(tilted)
    assert "attitude-gravity" in codes(flow.check(log, tilted, (), ()))


def test_the_command_prints_json_alone_and_writes_nothing(clean: Path, tmp_path: Path) -> None:
    done = massprop(tmp_path, "check", clean, "--json", "--want", "ixx")
    assert done.returncode == 0
    assert json.loads(done.stdout)["schema"] == "massprop/check/1"
    assert list(tmp_path.iterdir()) == []
    shown = massprop(tmp_path, "check", clean)
    assert "no findings" in shown.stdout
    for arguments, code, said in (
        (["--want", "mass<"], 2, "is not a precision"),
        (["--want", "mass<1 m"], 3, "'m' is not a unit of mass"),
        (["--junit", "no/j.xml"], 2, "name a file in a folder that exists"),
        (["--vehicle", "none.toml"], 3, "no such vehicle file"),
    ):
        done = massprop(tmp_path, "check", clean, *arguments)
        assert (done.returncode, done.stdout) == (code, "")
        assert said in done.stderr
