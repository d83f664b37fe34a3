import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns, vehiclefile
from massprop_cli.inputs.formats import draft, reading, traits
from massprop_cli.inputs.logfile import read_table
from tests.commandline import massprop, succeeded
from tests.inputs import everyformat as written

SAMPLES = Path(__file__).parents[2] / "sample_logs"
GYRO, ACCEL, RECORDS, CYCLES = 2e-3, 0.05, 5, 800


def log(tmp_path: Path, gravity: float = 0.0, quiet: int = 500, jets: bool = False, records: int = RECORDS) -> Path:
    """A vehicle at rest for some cycles, then driven; noise is of a cycle's mean."""
    rng = np.random.default_rng(11)
    n = CYCLES * records
    time_s = np.cumsum(np.full(n, 0.01) + rng.normal(0, 1e-5, n))
    rate = 0.003 + GYRO * np.sqrt(records) * rng.normal(size=(n, 3))
    force = ACCEL * np.sqrt(records) * rng.normal(size=(n, 3)) + [0.0, 0.0, gravity]
    held: dict[str, Any] = {"time_s": time_s}
    held |= dict(zip((*columns.GYRO, *columns.ACCEL), np.hstack([rate, force]).T, strict=True))
    driven = np.arange(CYCLES) >= quiet
    if jets:
        on = np.where(driven, rng.integers(0, 12, CYCLES) * 0.004, 0.0)
        held |= {"jet_a_s": np.repeat(on, records), "jet_b_s": np.zeros(n)}
    else:
        held |= {name: np.repeat(np.where(driven, rng.normal(size=CYCLES), 0.0), records) for name in columns.WRENCH}
    pq.write_table(pa.table(held), tmp_path / "own.parquet")
    return tmp_path / "own.parquet"


def test_cycle_noise_and_bias_are_those_the_log_was_made_with(tmp_path: Path) -> None:
    found = traits.traits(read_table(log(tmp_path)))
    assert found.records == RECORDS
    assert found.period_s == pytest.approx(0.05, rel=1e-4)
    assert found.quiet == 500 - traits.SETTLE
    assert found.gyro_noise is not None
    assert found.accel_noise is not None
    # 0.57 / √500 is 2.5 % of all axes, 4.4 % of one
    np.testing.assert_allclose(found.gyro_noise, GYRO, rtol=0.13)
    np.testing.assert_allclose(found.accel_noise, ACCEL, rtol=0.13)
    assert np.sqrt((found.gyro_noise**2).mean()) == pytest.approx(GYRO, rel=0.08)
    assert found.gyro_mean is not None
    np.testing.assert_allclose(found.gyro_mean, 0.003, atol=4 * GYRO / np.sqrt(496))
    assert np.std(found.interval_s) == pytest.approx(1e-5, rel=0.1)


def test_a_cycle_is_as_long_as_commands_with_times_of_their_own_are_apart(tmp_path: Path) -> None:
    """In rows that tell nothing of it: 10, 9, 10, ... of a sensor that is not in step with them, the first one late."""
    rng, issued_s = np.random.default_rng(4), 0.0937 + 0.0333 * np.arange(400)
    time_s = np.arange(1, 4500) / 300
    held: dict[str, Any] = {"time_s": time_s}
    held |= {name: rng.normal(size=len(time_s)) for name in (*columns.GYRO, *columns.ACCEL)}
    for name, values in ((columns.COMMAND_TIME, issued_s), ("jet_a_s", 0.004 * rng.integers(0, 8, 400))):
        held[name] = np.full(len(time_s), np.nan)
        held[name][np.searchsorted(time_s, issued_s)] = values
    pq.write_table(pa.table(held), tmp_path / "own.parquet")
    found = traits.traits(read_table(tmp_path / "own.parquet"))
    assert found.period_s == pytest.approx(0.0333)
    assert found.choices == (10,)
    assert len(found.commands["jet_a_s"]) == 400
    assert "period_s = 0.0333   # from command to command" in draft.draft("x", found, {})


def test_a_few_empty_cells_of_a_sensor_change_nothing_and_many_are_refused(tmp_path: Path) -> None:
    """An estimate takes a part of a sensor's cells as lost, so a draft does, too."""
    table = pq.read_table(log(tmp_path))
    gyro = table.column(columns.GYRO[0]).to_numpy().copy()

    def emptied(count: int) -> traits.Traits:
        cells = gyro.copy()
        cells[100 : 100 + count] = np.nan
        place = table.schema.get_field_index(columns.GYRO[0])
        pq.write_table(table.set_column(place, columns.GYRO[0], pa.array(cells)), tmp_path / "own.parquet")
        return traits.traits(read_table(tmp_path / "own.parquet"))

    whole, found = emptied(0), emptied(150)
    assert found.quiet == whole.quiet - 150 // RECORDS
    assert found.gyro_noise == pytest.approx(whole.gyro_noise, rel=0.05)
    assert found.force_always_m_s2 == pytest.approx(whole.force_always_m_s2, rel=0.05)
    with pytest.raises(InputError, match=f"column {columns.GYRO[0]}: not a finite number"):
        emptied(int(0.06 * len(gyro)))


def test_a_drafted_file_is_one_and_its_log_can_be_read_with_it(tmp_path: Path) -> None:
    path = log(tmp_path)
    run = massprop(tmp_path, "init", path, "--out", "own.vehicle.toml")
    assert (run.returncode, run.stdout) == (0, "own.vehicle.toml\n"), run.stderr
    text = (tmp_path / "own.vehicle.toml").read_text()
    stated = vehiclefile.parse(text, "own").vehicle
    assert stated.cycle.period_s == pytest.approx(0.05, rel=1e-4)
    assert stated.cycle.command_delay_cycles == "auto"
    assert stated.imu.gyro_noise_rad_s == pytest.approx(GYRO, rel=0.08)
    assert stated.environment.kind == "free"
    # every line that states something says where it is from, and what none can know is a comment
    for line in text.splitlines():
        if " = " in line and not line.startswith("#"):
            assert " # " in line or line == "schema = 1"
    for part in ("# position_m = [x, y, z]", "# body_from_imu", "# gyro_range_rad_s", "# gyro_bias_sigma_rad_s = 0.003", "# scale_sigma"):
        assert part in text
    again = massprop(tmp_path, "init", path, "--out", "own.vehicle.toml")
    assert again.returncode == 3
    assert "own.vehicle.toml: exists already" in again.stderr


def test_gravity_is_told_from_none_and_from_neither(tmp_path: Path) -> None:
    def kind(gravity: float, quiet: int = 500) -> str:
        text = draft.draft("own", traits.traits(read_table(log(tmp_path, gravity, quiet))), {})
        return next(line for line in text.splitlines() if "kind = " in line)

    # a bearing and a table hold a vehicle alike
    assert kind(9.79).startswith('# kind = "air_bearing"   # it turns about a fixed point')
    text = draft.draft("own", traits.traits(read_table(log(tmp_path, 9.79))), {})
    assert '# kind = "planar"        # it slides and yaws on a table' in text
    assert "# in 496 quiet cycles the accelerometer feels 9.79" in text
    assert tomllib.loads(text)["environment"] == {}
    assert kind(0.0).startswith('kind = "free"')
    assert kind(3.0).startswith('# kind = "free"   # or "air_bearing": in 496 quiet cycles the accelerometer feels 3')
    # a vehicle that never stops pushing may hover
    assert "under commands, which gravity and thrust do alike" in kind(9.8, quiet=0)


def test_jets_are_listed_and_want_their_geometry(tmp_path: Path) -> None:
    found = traits.traits(read_table(log(tmp_path, jets=True)))
    text = draft.draft("own", found, {})
    assert [jet["name"] for jet in tomllib.loads(text)["jets"]] == ["a", "b"]
    assert "pwm_tick_s = 0.004   # all on-times are multiples of it" in text
    assert "column jet_b_s: never on in this log" in text
    with pytest.raises(InputError, match=r"jets.0.position_m.* is missing"):
        vehiclefile.parse(text, "own")


def test_wheels_are_listed_as_comments_since_each_needs_what_no_log_tells(tmp_path: Path) -> None:
    path = log(tmp_path, jets=True)
    table = pq.read_table(path)
    still = pa.array(np.zeros(len(table)))
    for column in ("wheel_x_rad_s", "wheel_x_n_m", "wheel_y_n_m"):
        table = table.append_column(column, still)
    pq.write_table(table, path)
    text = draft.draft("own", traits.traits(read_table(path)), {})
    assert text.count("# [[wheels]]") == 2
    assert '# name = "x"\n# column = "speed"' in text
    assert '# name = "y"\n# column = "torque"' in text
    assert "wheels" not in tomllib.loads(text)


def test_rotors_are_listed_and_want_their_geometry_and_thrust(tmp_path: Path) -> None:
    path = log(tmp_path)
    table = pq.read_table(path)
    command = np.abs(table.column(columns.WRENCH[0]).to_numpy())
    table = table.drop_columns(list(columns.WRENCH))
    for column in ("rotor_m1_command", "rotor_m2_command", "rotor_m2_rad_s", "rotor_m3_rad_s"):
        table = table.append_column(column, pa.array(command))
    pq.write_table(table, path)
    found = traits.traits(read_table(path))
    assert (found.records, found.quiet) == (RECORDS, 500 - traits.SETTLE)
    text = draft.draft("own", found, {})
    assert [(rotor["name"], rotor.get("column")) for rotor in tomllib.loads(text)["rotors"]] == [
        ("m1", None),
        ("m2", None),
        ("m3", "speed"),
    ]
    assert f'name = "m1"   # column rotor_m1_command: 0 to {command.max():.4g}, 301 different values in 800 cycles' in text
    for part in ("# position_m = [x, y, z]    #", "# axis", "# spin", "# thrust_n", "# torque_ratio_m"):
        assert text.count(part) == 3
    assert "no column of commands" not in text
    with pytest.raises(InputError, match=r"rotors.0.position_m.* is missing"):
        vehiclefile.parse(text, "own")


def test_few_quiet_cycles_leave_noise_to_the_estimate(tmp_path: Path) -> None:
    text = draft.draft("own", traits.traits(read_table(log(tmp_path, quiet=60))), {})
    assert "# gyro_noise_rad_s = 0.00" in text
    assert "too few to state" in text
    assert "gyro_noise_rad_s" not in tomllib.loads(text)["imu"]


def test_a_range_that_was_reached_is_found(tmp_path: Path) -> None:
    path = log(tmp_path)
    table = pq.read_table(path)
    clipped = {
        name: np.clip(table.column(name).to_numpy(), -0.01, 0.01) if name in columns.GYRO else table.column(name)
        for name in table.column_names
    }
    pq.write_table(pa.table(clipped), path)
    found = traits.traits(read_table(path))
    assert found.gyro_clipped == 0.01
    assert found.accel_clipped is None


@pytest.mark.parametrize(("name", "records", "period"), [("high-rate", 20, 0.05), ("free-flyer", 1, 0.05), ("crazyflie", 1, 0.0099)])
def test_cycles_of_the_sample_logs_are_found(name: str, records: int, period: float) -> None:
    log = SAMPLES / name / ("thrust.parquet" if name == "crazyflie" else "log.parquet")
    found = traits.traits(read_table(log))
    assert found.records == records
    assert found.period_s == pytest.approx(period, rel=1e-3)


def test_ticks_are_only_found_where_there_are_some() -> None:
    assert traits.tick_s(np.array([0.01, 0.0175, 0.05])) == pytest.approx(0.0025)
    assert traits.tick_s(np.array([0.01, 0.01 * np.sqrt(2), 0.0457])) is None
    assert traits.tick_s(np.zeros(5)) is None


def alternating(tmp_path: Path, longest: float) -> Path:
    """50 ms records of on-times that change each second time only."""
    rng = np.random.default_rng(8)
    on = np.repeat(np.where(np.arange(200) < 150, rng.integers(0, 5, 200) * longest / 4, 0.0), 2)
    held = {"time_s": 0.05 * np.arange(1, 401), "jet_a_s": on, "jet_b_s": np.roll(on, 2)}
    held |= {name: 1e-3 * rng.standard_normal(400) for name in (*columns.GYRO, *columns.ACCEL)}
    pq.write_table(pa.table(held), tmp_path / "own.parquet")
    return tmp_path / "own.parquet"


def test_a_cycle_that_on_times_leave_open_is_asked_for(tmp_path: Path) -> None:
    """Each counts once a cycle: drafted as two records, mass and inertia came out at half, and converged."""
    found = traits.traits(read_table(alternating(tmp_path, 0.05)))
    assert (found.choices, found.records) == ((1, 2), 1)
    text = draft.draft("own", found, {})
    assert 'period_s = "?"   # 0.05 (1) or 0.1 (2) record(s), which the log can\'t show' in text
    assert "gyro_noise_rad_s" not in tomllib.loads(text)["imu"]
    with pytest.raises(InputError, match=r"cycle.period_s"):
        vehiclefile.parse(text, "own")


def test_an_on_time_longer_than_a_record_tells_the_cycle(tmp_path: Path) -> None:
    found = traits.traits(read_table(alternating(tmp_path, 0.08)))
    assert (found.choices, found.records) == ((2,), 2)
    assert "period_s = 0.1   # 2 record(s)" in draft.draft("own", found, {})


@pytest.mark.thorough
def test_px4_states_its_rotors_as_comments(tmp_path: Path) -> None:
    path, map_file = written.written("ulog", tmp_path)
    run = succeeded(tmp_path, "init", path, "--map", str(map_file))
    assert "# CA_ROTOR0: position_m = [0, 0, 0], force_n = [0, 0, -1.5] at full (CT = 1.5), torque ratio KM = 0.05 m" in run.stdout
    assert reading.load(path).parameters["CA_ROTOR_COUNT"] == 1
    refused = massprop(tmp_path, "init", path)
    assert refused.returncode == 3
    assert f"massprop columns {path} drafts one" in refused.stderr


def test_a_dash_is_standard_output_and_no_file(tmp_path: Path) -> None:
    path = log(tmp_path)
    plain, dashed = massprop(tmp_path, "init", path), massprop(tmp_path, "init", path, "--out", "-")
    assert (dashed.returncode, dashed.stdout) == (0, plain.stdout)
    assert tomllib.loads(dashed.stdout)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
