"""Clocks that count, scatter, wrap or are two sensors', and valves in bits, pulses and percents: the plain recording comes of them."""

from itertools import permutations, product
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import resample
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.tablefile import Table
from massprop_cli.inputs.telemetry import read
from massprop_cli.inputs.vehicle import Vehicle
from tests import flight

MAP = """
schema = 1
clock = { path = "t", unit = "s" }
[gyro]
paths = ["wx", "wy", "wz"]
unit = "rad/s"
values = "mean"
[accelerometer]
paths = ["ax", "ay", "az"]
unit = "m/s^2"
values = "mean"
[jets.left]
path = "left"
unit = "s"
[jets.right]
path = "right"
unit = "s"
[records]
interval_s = 0.01
per_cycle = 5
"""
CYCLES, ROWS, STEP = 80, 20, 0.0025
ON = np.random.default_rng(5).integers(0, 21, (CYCLES, 2)) * STEP
"""(K, 2) s: of each cycle of 50 ms."""
ON[3] = 0.05, 0.0


def recorded(lead: int = 0) -> pd.DataFrame:
    """400 Hz of sines, stamped at each record's end; on-times beside them in every row. The first cycle lacks so many rows."""
    t = STEP * np.arange(1, CYCLES * ROWS + 1)
    frame = pd.DataFrame({"t": t} | {f"w{a}": np.sin((n + 1) * t) for n, a in enumerate("xyz")})
    for n, axis in enumerate("xyz"):
        frame[f"a{axis}"] = np.cos((n + 1) * t)
    frame["left"], frame["right"] = np.repeat(ON, ROWS, 0).T
    return frame.iloc[lead:].reset_index(drop=True)


def open_by_record(share_of: float = STEP) -> np.ndarray:
    """(n, 2) whether each valve is open in a record: from its cycle's beginning on, as long as it is on."""
    into = STEP * np.tile(np.arange(ROWS), CYCLES)
    return (into[:, None] < np.repeat(ON, ROWS, 0) - share_of / 2).astype(float)


def mapped(path: Path, frame: pd.DataFrame, *changes: tuple[str, str]) -> Table:
    frame.to_csv(path, index=False)
    text = MAP
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.with_name("map.toml").write_text(text)
    return read_table(path)


def on_times(table: Table) -> np.ndarray:
    """(K, 2)"""
    return np.stack([table.columns[columns.jet(name)].numbers()[::5] for name in ("left", "right")], 1)


def said(table: Table) -> str:
    assert table.made is not None
    return "\n".join(table.made.conversions)


UNTIL_THEN = ('path = "left"', 'path = "left"\nholds = "since_last"'), ('path = "right"', 'path = "right"\nholds = "since_last"')
OPEN = ('path = "left"\nunit = "s"', 'path = "left"\nunit = "open"'), ('path = "right"\nunit = "s"', 'path = "right"\nunit = "open"')


@pytest.mark.parametrize("lead", [0, 7, 13])
def test_on_times_that_stand_in_every_row_are_taken_once_a_cycle_wherever_the_log_begins(lead: int, tmp_path: Path) -> None:
    table = mapped(tmp_path / "log.csv", recorded(lead), *UNTIL_THEN)
    found = on_times(table)
    whole = ON[1 if lead else 0 :]
    np.testing.assert_allclose(found, whole[: len(found)], atol=1e-12)
    assert len(found) >= len(whole) - 1
    assert "up to 20 alike in each control cycle" in said(table)
    assert "control cycles begin where commands change" in said(table)
    begun = table.columns["time_s"].numbers()[0] - 0.01
    assert begun == pytest.approx(0.05 if lead else 0.0, abs=1e-9)


@pytest.mark.parametrize("lead", [0, 9])
def test_states_of_valves_are_summed_over_the_cycles_that_their_pulses_begin(lead: int, tmp_path: Path) -> None:
    frame = recorded()
    frame[["left", "right"]] = open_by_record()
    table = mapped(tmp_path / "log.csv", frame.iloc[lead:], *(change for pair in zip(OPEN, UNTIL_THEN, strict=True) for change in pair))
    found = on_times(table)
    whole = ON[1 if lead else 0 :]
    np.testing.assert_allclose(found, whole[: len(found)], atol=1e-9)
    assert len(found) >= len(whole) - 1


@pytest.mark.parametrize("records", [True, False])
def test_a_jet_that_was_not_logged_since_it_never_fired_is_stated_as_0(records: bool, tmp_path: Path) -> None:
    never = ('path = "right"\nunit = "s"', "path = 0")
    changes = (*UNTIL_THEN[:1], never) if records else (never, (MAP[MAP.index("[records]") :], ""))
    table = mapped(tmp_path / "log.csv", recorded().drop(columns="right"), *changes)
    fired, still = (table.columns[columns.jet(name)].numbers() for name in ("left", "right"))
    np.testing.assert_array_equal(still, np.zeros(len(fired)))
    step = 5 if records else ROWS
    np.testing.assert_allclose(fired[::step], ON[: len(fired) // step, 0], atol=1e-12)
    if records:
        assert "jets.right: taken as 0 throughout, as the map states" in said(table)
        assert "control cycles begin where commands change" in said(table)
    with pytest.raises(InputError, match=r"jets.right.path"):
        mapped(tmp_path / "log.csv", recorded(), (never[0], "path = 1"))


def test_on_times_that_differ_within_a_cycle_are_named_with_both(tmp_path: Path) -> None:
    frame = recorded()
    frame.loc[45, "left"] = 0.0421
    with pytest.raises(InputError, match=r"20 on-times \(.* s and .* s\) in the control cycle of 0.05 s at 0.1 s; each cycle needs one"):
        mapped(tmp_path / "log.csv", frame, *UNTIL_THEN)


def test_an_on_time_once_a_cycle_is_of_its_stamp_whatever_holds_says(tmp_path: Path) -> None:
    """It was taken so in silence, stamped a cycle late."""
    frame = recorded()
    once = frame.copy()
    once.loc[np.arange(len(frame)) % ROWS != 0, ["left", "right"]] = np.nan
    assert np.isfinite(on_times(mapped(tmp_path / "log.csv", once))).all()
    with pytest.raises(InputError, match=r"so holds has no effect; drop holds, .* clock.offset_s = -0.05"):
        mapped(tmp_path / "log.csv", once, *UNTIL_THEN)


@pytest.mark.parametrize(
    ("fault", "said"), [("lost", "no on-time in .* logged only when it changes, log it in each"), ("twice", "if the clock drifts")]
)
def test_a_cycle_without_its_on_time_says_what_else_it_may_be(fault: str, said: str, tmp_path: Path) -> None:
    once = recorded()
    once.loc[np.arange(len(once)) % ROWS != 0, ["left", "right"]] = np.nan
    if fault == "lost":
        once.loc[5 * ROWS, ["left", "right"]] = np.nan
    else:
        once.loc[5 * ROWS + 7, ["left", "right"]] = [0.0211, 0.0123]
    with pytest.raises(InputError, match=said):
        mapped(tmp_path / "log.csv", once)


def test_a_valve_in_each_bit_of_a_number(tmp_path: Path) -> None:
    frame = recorded()
    states = open_by_record().astype(int)
    frame["valves"] = (states[:, 0] << 3 | states[:, 1] << 11 | 1).astype(float)
    changes = [
        (f'path = "{name}"\nunit = "s"', f'path = "valves"\nbit = {bit}\nholds = "since_last"')
        for name, bit in (("left", 3), ("right", 11))
    ]
    np.testing.assert_allclose(on_times(mapped(tmp_path / "log.csv", frame, *changes))[:-1], ON[: CYCLES - 1], atol=1e-9)
    # a table of two rates, merged: the number of valves stands in rows of its own
    apart = pd.concat([frame.drop(columns="valves"), frame[["t", "valves"]].assign(t=frame["t"] - 1e-4)]).sort_values("t")
    merged = mapped(tmp_path / "log.csv", apart, *changes)
    np.testing.assert_allclose(on_times(merged), ON[1:], atol=1e-9)  # the gyro is there after the first has begun
    assert "jets.left, jets.right: 1600 of 3200 rows of the file hold none of its samples" in said(merged)
    frame.loc[30, "valves"] = 2.5
    with pytest.raises(InputError, match=r"2\.5 at line 32 is not an integer of bits"):
        mapped(tmp_path / "log.csv", frame, *changes)
    with pytest.raises(InputError, match="bit is a valve that is open or shut; drop unit and offset"):
        mapped(tmp_path / "log.csv", frame, (changes[0][0], changes[0][1] + '\nunit = "ms"'))


def test_pulses_of_a_servo_are_mapped_with_an_offset(tmp_path: Path) -> None:
    frame = recorded()
    frame[["left", "right"]] = 1000 + 1000 * frame[["left", "right"]] / 0.05
    changes = [(f'path = "{name}"\nunit = "s"', f'path = "{name}"\nunit = "s"\noffset = -1000\nscale = 5e-5') for name in ("left", "right")]
    np.testing.assert_allclose(on_times(mapped(tmp_path / "log.csv", frame, *changes, *UNTIL_THEN))[:-1], ON[: CYCLES - 1], atol=1e-9)


@pytest.mark.parametrize(("unit", "most"), [("open", "0.05 (5 %)"), ("%", "0.0005 (0.05 %)")])
def test_on_times_taken_for_openings_are_refused(unit: str, most: str, tmp_path: Path) -> None:
    """They would make every mass and inertia 20 or 2,000 times too small, and nothing in the motion tells."""
    changes = [(f'path = "{name}"\nunit = "s"', f'path = "{name}"\nunit = "{unit}"') for name in ("left", "right")]
    with pytest.raises(InputError) as refused:
        mapped(tmp_path / "log.csv", recorded(), *changes)
    assert f"no valve is open by more than {most}" in str(refused.value)
    assert 'state unit = "s", "ms" or "us"' in str(refused.value)


def plain(tmp_path: Path) -> dict[str, np.ndarray]:
    table = mapped(tmp_path / "plain.csv", recorded(), *UNTIL_THEN)
    return {name: table.columns[name].numbers() for name in ("time_s", *columns.DELTA_THETA, *columns.DELTA_V)}


def same(table: Table, wanted: dict[str, np.ndarray], atol: float) -> None:
    for name, values in wanted.items():
        found = table.columns[name].numbers()
        np.testing.assert_allclose(found, values[: len(found)], rtol=0, atol=atol, err_msg=name)
        assert len(found) >= len(values) - 5


def test_a_counter_with_its_interval_is_a_clock(tmp_path: Path) -> None:
    wanted = plain(tmp_path)
    frame = recorded()
    frame["t"] = np.arange(1, len(frame) + 1)
    same(mapped(tmp_path / "log.csv", frame, ('unit = "s" }', 'unit = "s", scale = 0.0025 }'), *UNTIL_THEN), wanted, 1e-9)
    frame["t"] *= 25  # ticks of 0.1 ms
    same(mapped(tmp_path / "log.csv", frame, ('unit = "s" }', 'unit = "ms", scale = 0.1 }'), *UNTIL_THEN), wanted, 1e-9)


def test_seconds_and_nanoseconds_in_two_columns_are_one_clock(tmp_path: Path) -> None:
    wanted = plain(tmp_path)
    whole = 1_714_557_600 * 10**9 + (recorded()["t"].to_numpy() * 1e9).round().astype(np.int64)
    frame = recorded().assign(t=whole // 10**9, ns=whole % 10**9)
    changes = ('unit = "s" }', 'unit = "s", nanoseconds = "ns" }'), ("per_cycle = 5", 'per_cycle = 5\nzero = "start"')
    same(mapped(tmp_path / "log.csv", frame, *changes, *UNTIL_THEN), wanted, 1e-9)
    with pytest.raises(InputError, match="it holds the part of a second: name the whole seconds as path, and nanoseconds = this one"):
        mapped(tmp_path / "log.csv", frame, ('path = "t", unit = "s"', 'path = "ns", unit = "ns"'))


EVEN = ('unit = "s" }', 'unit = "s", even = true }')


@pytest.mark.parametrize("kind", ["arrival", "milliseconds", "bursts"])
def test_stamps_that_scatter_about_even_samples(kind: str, tmp_path: Path) -> None:
    wanted = plain(tmp_path)
    frame = recorded()
    t = frame["t"].to_numpy()
    scattered = {
        "arrival": t + np.abs(np.random.default_rng(2).normal(0, 4e-4, len(t))),
        "milliseconds": t.round(3),
        "bursts": np.repeat(t[3::4], 4) + 1e-5 * np.tile(np.arange(4), len(t) // 4),
    }[kind]
    table = mapped(tmp_path / "log.csv", frame.assign(t=scattered), EVEN, *UNTIL_THEN)
    late = float((scattered - t).mean())
    # all of it is as late as its stamps on the mean, to a tenth of a record
    np.testing.assert_allclose(np.diff(table.columns["time_s"].numbers()), 0.01, atol=1e-9)
    for name in (*columns.DELTA_THETA, *columns.DELTA_V):
        found = table.columns[name].numbers()
        assert np.abs(found[5:-5] - wanted[name][5 : len(found) - 5]).max() < 0.01 * (3 * (late + 2.5e-4) + 1e-3)
    assert "its samples are taken as coming every 0.002" in said(table)


def test_a_lost_sample_makes_no_even_clock(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"its stamps wander by [\d.]+ samples from even intervals of .*: samples were lost"):
        mapped(tmp_path / "log.csv", recorded().drop(index=range(700, 706)), EVEN)


@pytest.mark.parametrize(("gap_s", "part"), [(7e-6, "50 %"), (1e-4, "50 %")])
def test_two_sensors_in_one_table_are_none(gap_s: float, part: str, tmp_path: Path) -> None:
    frame = recorded()
    other = (frame * (1 + 1e-6)).assign(t=frame["t"] + gap_s)
    both = pd.concat([frame, other]).sort_values("t")
    with pytest.raises(
        InputError, match=rf"{part} of its samples come right after another .* two sensors in one table, keep the rows of one"
    ):
        mapped(tmp_path / "log.csv", both)


@pytest.mark.parametrize(
    ("least", "said"),
    [(2**32 * 1e-6, r"add 2\^32 us"), (2**16 * 1e-3, r"add 2\^16 ms"), (86400.0, "it passes midnight")],
)
def test_a_counter_that_wraps_is_told_what_by(least: float, said: str, tmp_path: Path) -> None:
    frame = recorded()
    frame["t"] = (frame["t"] + least - 2.0) % least
    with pytest.raises(InputError, match=rf"goes back at line 80[01], from .*{said}"):
        mapped(tmp_path / "log.csv", frame)


def test_units_with_a_slash_part_no_levels(tmp_path: Path) -> None:
    frame = recorded().rename(columns={f"w{a}": f"Gyr_{a} [rad/s]" for a in "xyz"})
    same(mapped(tmp_path / "log.csv", frame, ('["wx", "wy", "wz"]\nunit = "rad/s"', '"Gyr_? *"'), *UNTIL_THEN), plain(tmp_path), 1e-12)


def test_groups_above_the_names_and_numbers_in_their_place_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    header, *rows = recorded().to_csv(index=False).splitlines()
    path.write_text("\n".join(["," + ",".join(["imu"] * 6 + ["jets"] * 2), header, *rows]))
    with pytest.raises(InputError, match=r"log.csv, line 1: column 'imu' occurs 6 times; .* names groups of columns, delete it"):
        read_table(path)
    path.write_text("\n".join(rows))
    with pytest.raises(InputError, match=r"log\.csv, line 1: numbers instead of names"):
        read_table(path)
    path.write_text("\n".join([header, *rows[:50], header, *rows[:50]]))
    path.with_name("map.toml").write_text(MAP)
    with pytest.raises(InputError, match="line 52, column wx: the header repeats here"):
        read_table(path)
    path.write_text("\n".join([header, "05/01/2024 12:00:00.05 PM" + rows[0][rows[0].index(",") :], *rows[1:]]))
    with pytest.raises(InputError, match="is not a number; correct the cell; a date and time is ISO 8601's"):
        read_table(path)


def test_a_column_of_lists_is_refused_as_such(tmp_path: Path) -> None:
    """No cell of it can be corrected."""
    rates = pa.array([[0.0, 0.1, 0.2]] * 4)
    pq.write_table(pa.table({"time_s": 0.05 * np.arange(4), "w": rates}), tmp_path / "log.parquet")
    with pytest.raises(InputError, match=r"log\.parquet, column w: each cell has 3 values; write a column for each of them"):
        read_table(tmp_path / "log.parquet").columns["w"].numbers()


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("2024-05-01T12:00:00.05", r"name the column as a clock in a map file \(massprop columns with --as-map drafts it\)"),
        ("٣", "'٣' is not a number; correct the cell"),
        ("1_0", "'1_0' is not a number; correct the cell"),
    ],
)
def test_a_cell_that_is_no_number_is_named_with_what_to_do(cell: str, said: str, tmp_path: Path) -> None:
    vehicle = Vehicle.model_validate(flight.vehicle("free", 2.0))
    names = ["time_s", *columns.DELTA_THETA, *columns.DELTA_V, *(columns.jet(jet.name) for jet in vehicle.jets)]
    rows = [[f"{0.05 * k:.2f}", *["0"] * (len(names) - 1)] for k in range(1, 6)]
    first = 0 if "T" in cell else 2
    for row in rows[first:]:
        row[0] = cell
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(row) for row in [names, *rows]), encoding="utf-8")
    with pytest.raises(InputError, match=rf"log\.csv, line {first + 2}, column time_s: .*{said}"):
        read(read_table(path), vehicle)


def test_a_body_with_other_axes_turns_as_the_vectors_in_it_do() -> None:
    """All 24 right-angled turns, by scipy's rotations."""
    random = Rotation.random(4, random_state=1)
    quaternions, vectors = random.as_quat(scalar_first=True), np.random.default_rng(1).normal(size=(4, 3))
    seen = 0
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = np.zeros((3, 3))
        turn[range(3), order] = signs
        if np.linalg.det(turn) < 0:
            continue
        axes = [("-" if sign < 0 else "") + "xyz"[axis] for axis, sign in zip(order, signs, strict=True)]
        found = Rotation.from_quat(resample.about_axes(quaternions, axes), scalar_first=True)
        np.testing.assert_allclose(found.inv().apply(vectors), random.inv().apply(vectors) @ turn.T, atol=1e-12)
        seen += 1
    assert seen == 24
