"""Records as they arrive: the estimate of each cycle is the replay's, and the recording's result is that of any log."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.errors import InputError
from massprop_cli.kernel import kernel
from massprop_cli.live import records
from tests.analysed import SAMPLES, analysed
from tests.commandline import massprop
from tests.live.streams import as_objects, followed, recorded

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")


@pytest.mark.parametrize("name", ["free-flyer", "docking", "air-bearing", pytest.param("high-rate", marks=pytest.mark.thorough)])
def test_each_cycle_says_what_the_replay_says(name: str) -> None:
    said, _, warned = followed(name, recorded(name))
    found = analysed(name)
    assert not warned
    assert len(said) == sum(len(history.time_s) for history in found.histories)
    for history in found.histories:
        own = [line for line in said if line["phase"] == history.phase.name]
        assert [line["time_s"] for line in own] == pytest.approx(history.time_s)
        for k in (40, len(own) // 2, len(own) - 1):
            estimates = own[k]["estimates"]
            assert isinstance(estimates, dict)
            for i, quantity in enumerate(QUANTITIES):
                value, sigma = history.values[k, i], history.sigmas[k, i]
                one = estimates[quantity]
                assert (one["value"] is None) == bool(np.isnan(value))
                if one["value"] is not None:
                    assert abs(one["value"] - value) < 1e-6 * sigma
                    assert one["sigma"] == pytest.approx(sigma, rel=1e-6)
    assert not any(e["verdict"] == "contradicted" for line in said if isinstance(each := line["estimates"], dict) for e in each.values())


def test_objects_say_what_lines_of_csv_say() -> None:
    lines = recorded("high-rate")[: 1 + 20 * 60]
    assert followed("high-rate", as_objects(lines))[0] == followed("high-rate", lines)[0]


def test_an_object_may_name_an_event_where_it_was() -> None:
    lines = as_objects(recorded("free-flyer")[:201])
    named = [*lines[:100], lines[100].replace("{", '{"event": "thruster test", ', 1), *lines[101:]]
    said, kept, warned = followed("free-flyer", named)
    assert (said, warned) == (followed("free-flyer", lines)[0], [])
    assert [row.rpartition(",")[2] for row in kept.splitlines()[99:103]] == ["", "", "thruster test", ""]


def in_column(line: str, name: str, value: str) -> str:
    """A line with another cell."""
    cells = line.rstrip("\n").split(",")
    cells[recorded("free-flyer")[0].replace('"', "").split(",").index(name)] = value
    return ",".join(cells) + "\n"


BAD = {
    "no record": "hello\n",
    "too few fields": "1.0,2.0\n",
    "no number": None,
    "time that stands still": None,
    "a clock set back": None,
    "decimal commas": None,
    "a digit separator": None,
    "another script's digits": None,
    "no motion of a vehicle": None,
    "no command": None,
    "a line without an end": "x" * (records.LONGEST + 2),
}
CELLS = {
    "no number": ("delta_theta_x_rad", "nan"),
    "a clock set back": ("time_s", "-3600.0"),
    "decimal commas": ("delta_theta_x_rad", "0,001"),
    "a digit separator": ("delta_theta_x_rad", "1_0"),
    "another script's digits": ("delta_theta_x_rad", "١"),
    "no motion of a vehicle": ("delta_theta_x_rad", "1e6"),
    "no command": ("jet_roll_p1_s", ""),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_record_is_told_and_left_out(kind: str) -> None:
    lines = recorded("free-flyer")[:301]
    if kind in CELLS:
        bad = in_column(lines[100], *CELLS[kind])
    elif kind == "time that stands still":
        bad = lines[99]
    else:
        bad = BAD[kind] or ""
    said, kept, warned = followed("free-flyer", [*lines[:100], bad, *lines[100:]])
    assert len(warned) == 1
    assert warned[0].startswith("standard input, line 101: left out: ")
    assert kept.count("\n") == 301
    assert said == followed("free-flyer", lines)[0]


@pytest.mark.parametrize("name", ["free-flyer", "high-rate"])
def test_a_recording_begins_with_its_first_command(name: str) -> None:
    """Records that come before, in the middle of a cycle or of a second in which nobody commands, are left out."""
    lines = recorded(name)[:301]
    first = next(i for i, column in enumerate(lines[0].replace('"', "").split(",")) if column.startswith("jet_"))
    cells = [line.rstrip("\n").split(",") for line in lines[1:41]]
    before = [",".join([*row[:first], *["" for _ in row[first:]]]) + "\n" for row in cells]
    said, kept, warned = followed(name, [lines[0], *before, *lines[41:]])
    assert len(warned) == 40
    assert warned[-1].startswith("standard input, line 41: left out: no jet_")
    assert (said, kept) == followed(name, [lines[0], *lines[41:]])[:2]


@pytest.mark.parametrize("seed", range(4))
def test_times_that_scatter_at_the_beginning_do_not_miscount_the_records(seed: int) -> None:
    """By 4 % of an interval; by the first one alone six of eight such recordings had been refused."""
    lines = recorded("high-rate")[: 1 + 20 * 40]
    rng = np.random.default_rng(seed)
    shifted = [f"{float(time) + 1e-4 * rng.normal():.9f},{rest}" for time, rest in (line.split(",", 1) for line in lines[1:])]
    # the first cycle's commands may be known a record later
    assert abs(len(followed("high-rate", [lines[0], *shifted])[0]) - len(followed("high-rate", lines)[0])) <= 1


def test_a_record_that_is_lost_takes_its_command_with_it() -> None:
    """Values had stayed converged for a third of a second, up to 450 sigma off; a stamp that comes late or early loses nothing."""
    lines = recorded("free-flyer")
    said, _, warned = followed("free-flyer", [*lines[:638], *lines[639:700]])
    (warning,) = warned
    assert "a record before 32 s is missing" in warning

    def verdicts(line: dict[str, object]) -> set[str]:
        estimates = line["estimates"]
        assert isinstance(estimates, dict)
        return {one["verdict"] for one in estimates.values() if one["value"] is not None}

    assert all(verdicts(line) <= {"contradicted"} for line in said if float(str(line["time_s"])) > 31.975)
    assert all("contradicted" not in verdicts(line) for line in said if float(str(line["time_s"])) < 31.975)
    for by in (-0.025, 0.025):
        time, rest = lines[638].split(",", 1)
        stamped = [*lines[:638], f"{float(time) + by:.6f},{rest}", *lines[639:660]]
        assert not followed("free-flyer", stamped)[2]


def test_the_second_record_may_be_lost_or_stamped_late() -> None:
    lines = recorded("free-flyer")[:100]
    assert len(followed("free-flyer", [*lines[:2], *lines[3:]])[0]) == len(followed("free-flyer", lines)[0]) - 1
    time, rest = lines[2].split(",", 1)
    late = [*lines[:2], f"{float(time) - 0.025:.6f},{rest}", *lines[3:]]
    assert abs(len(followed("free-flyer", late)[0]) - len(followed("free-flyer", lines)[0])) <= 1


def test_a_lost_record_ends_what_cannot_do_without_and_the_recording_goes_on() -> None:
    """Of twenty records a cycle one is missing; of one a cycle the rest goes on."""
    lines = recorded("high-rate")[:1001]
    said, kept, warned = followed("high-rate", [*lines[:500], *lines[501:]])
    assert (said, kept.count("\n")) == (followed("high-rate", lines)[0][: len(said)], 1000)
    assert len(said) == 500 // 20 - 2
    assert len(warned) == 1
    assert "a cycle of 20 records would lack one); massprop gives no values from here on, but records all data" in warned[0]
    lines = recorded("free-flyer")[:301]
    said, kept, _ = followed("free-flyer", [*lines[:100], *lines[101:]])
    assert (len(said), kept.count("\n")) == (300 - 2 - 1, 300)
    said, kept, warned = followed("free-flyer", [*lines[:100], *lines[103:]])
    assert (len(said), kept.count("\n")) == (99 - 2, 298)
    assert "0.2 s without a record before 5.15 s" in warned[0]


@pytest.mark.parametrize(
    ("lines", "assignments", "said"),
    [
        ([], (), "no data"),
        (["time_s,gyro_x_rad_s\n"], (), "the first line lacks"),
        (["[1, 2]\n"], (), "the first line lacks"),
        (["time_s,command_time_s\n"], (), "live estimation does not support commands with their own times"),
        (["{broken\n"], (), "is not JSON"),
        (None, ("imu.gyro_noise_rad_s=0",), "imu.gyro_noise_rad_s must be stated"),
        (None, ("cycle.period_s=0.01",), "does not divide the control cycle"),
    ],
)
def test_what_cannot_begin_is_refused(lines: list[str] | None, assignments: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        followed("free-flyer", recorded("free-flyer")[:10] if lines is None else lines, *assignments)


def with_columns(lines: Sequence[str], **cells: str) -> list[str]:
    """Lines with more columns, of one content each."""
    return [f"{line.rstrip()},{','.join(cells.values() if number else cells)}\n" for number, line in enumerate(lines)]


@pytest.mark.parametrize(
    ("added", "assignments"),
    [
        ({"delta_theta_x_rad": "0"}, ()),
        ({"jet_none_s": "0"}, ()),
        ({"wheel_none_n_m": "0"}, ()),
        ({"cmd_torque_x_n_m": "0"}, ()),
        ({"qw": "1"}, ("columns.quat_w={from='w'}",)),
    ],
)
def test_columns_that_a_log_may_not_have_are_refused_before_anything_is_said(
    added: dict[str, str], assignments: tuple[str, ...], tmp_path: Path
) -> None:
    """Else numbers would be said of a column that is another's, and the recording refused in the end."""
    lines = with_columns(recorded("free-flyer")[:101], **added)
    (tmp_path / "log.csv").write_text("".join(lines), encoding="utf-8")
    vehicle = ("--vehicle", str(SAMPLES / "free-flyer" / "vehicle.toml"), *(word for one in assignments for word in ("--set", one)))
    refused = massprop(tmp_path, "estimate", "log.csv", *vehicle, "--out", "out")
    assert refused.returncode == 3
    with pytest.raises(InputError) as said:
        followed("free-flyer", lines, *assignments)
    assert str(said.value).split(": ", 1)[1] == refused.stderr.rstrip().split(": ", 2)[2]
    with pytest.raises(InputError):
        followed("free-flyer", as_objects(lines) if len(added) == 1 and "delta_theta_x_rad" not in added else lines, *assignments)


def test_an_object_that_names_a_column_twice_is_left_out() -> None:
    lines = as_objects(recorded("free-flyer")[:201])
    bad = lines[100].replace("{", '{"delta_theta_x_rad": 0.0, ', 1)
    said, _, warned = followed("free-flyer", [*lines[:100], bad, *lines[100:]])
    assert warned == ["standard input, line 101: left out: names 'delta_theta_x_rad' twice"]
    assert said == followed("free-flyer", lines)[0]


def test_logged_attitudes_are_not_used() -> None:
    """Empty cells and what is no quaternion are as good: the gyro carries the attitude from the vehicle file's on."""
    plain = recorded("air-bearing")[:301]
    lines = with_columns(plain, quat_w="1", quat_x="0", quat_y="0", quat_z="0")
    lines[100] = lines[100].replace(",1,0,0,0", ",,,,")
    lines[101] = lines[101].replace(",1,0,0,0", ",0,0,0,0")
    said, _, warned = followed("air-bearing", lines)
    assert warned == []
    assert said == followed("air-bearing", plain)[0]


def test_a_line_of_a_gigabyte_is_never_held() -> None:
    class Endless(io.StringIO):
        left = 1000

        def readline(self, size: int | None = -1, /) -> str:  # type: ignore[override]
            assert size is not None
            assert 0 < size <= records.LONGEST + 1
            self.left -= 1
            return "x" * size if self.left else "\n"

    stream = Endless()
    assert len(next(records.lines_of(stream))) == records.LONGEST + 1
    assert stream.left == 0
