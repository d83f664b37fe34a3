"""What is recorded live, however it ends: record.csv, its result, and the exit code."""

import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.kernel import kernel
from massprop_cli.live.run import recording
from tests.analysed import SAMPLES
from tests.commandline import STDIN, Done, massprop
from tests.live.streams import recorded

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")


@pytest.mark.thorough
def test_the_recording_is_estimated_as_any_log(tmp_path: Path) -> None:
    """Answers come before more is sent; the result is the one of the recording."""
    vehicle = str(SAMPLES / "free-flyer" / "vehicle.toml")
    lines = recorded("free-flyer")
    command = [sys.executable, "-m", "massprop_cli", "live", "--vehicle", vehicle, "--out", "live"]
    process = subprocess.Popen(command, cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.writelines(lines[:101])
    process.stdin.flush()
    early = [json.loads(process.stdout.readline()) for _ in range(98)]  # two cycles of delay
    assert early[-1]["time_s"] == pytest.approx(5.0)
    late, said = process.communicate("".join(lines[101:]), timeout=60)
    assert process.returncode == 0, said
    assert len(late.splitlines()) == 1198 - 98
    again = massprop(tmp_path, "estimate", "live/record.csv", "--vehicle", vehicle, "--out", "again", "-q")
    assert again.returncode == 0
    assert (tmp_path / "live" / "result.json").read_bytes() == (tmp_path / "again" / "result.json").read_bytes()
    last = json.loads(late.splitlines()[-1])["estimates"]
    result = json.loads((tmp_path / "live" / "result.json").read_text())["phases"][0]["estimates"]
    assert {name: (e["value"], e["sigma"]) for name, e in last.items()} == {name: (e["value"], e["sigma"]) for name, e in result.items()}


@pytest.mark.parametrize("end", ["reader", "disk", "interrupt", "termination"])
def test_the_result_is_there_however_the_answers_end(end: str, tmp_path: Path) -> None:
    """Where nobody reads them, where they can't be written, and at Ctrl-C."""
    lines = recorded("free-flyer")[:400]
    vehicle = str(SAMPLES / "free-flyer" / "vehicle.toml")
    command = [sys.executable, "-m", "massprop_cli", "live", "--vehicle", vehicle, "--out", "live", "-q"]
    pipe = subprocess.PIPE
    with Path("/dev/full").open("w") as full:
        out = full if end == "disk" else pipe
        process = subprocess.Popen(command, cwd=tmp_path, stdin=pipe, stdout=out, stderr=pipe, text=True)
    assert process.stdin is not None
    process.stdin.writelines(lines[:300])
    process.stdin.flush()
    if process.stdout is not None:
        for _ in range(297):  # of 299 records, with a delay of two
            assert process.stdout.readline()
    if end == "reader" and process.stdout is not None:
        process.stdout.close()
    ended_by = {"interrupt": signal.SIGINT, "termination": signal.SIGTERM}.get(end)
    if ended_by is not None:
        process.send_signal(ended_by)
    else:
        process.stdin.writelines(lines[300:])
        process.stdin.close()
    process.wait(60)
    assert process.stderr is not None
    said = process.stderr.read()
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            stream.close()
    assert process.returncode == {"reader": 141, "disk": 3, "interrupt": 130, "termination": 143}[end], said
    assert len((tmp_path / "live" / "record.csv").read_text().splitlines()) == (400 if ended_by is None else 300)
    assert json.loads((tmp_path / "live" / "result.json").read_text())["phases"]
    assert ("interrupted; the result uses the data until then" in said) == (ended_by is not None)


def live(folder: Path, given: str, *arguments: str | Path) -> Done:
    """``massprop live`` of the free flyer, with this as its standard input."""
    (folder / STDIN).write_text(given, encoding="utf-8")
    return massprop(folder, "live", "--vehicle", SAMPLES / "free-flyer" / "vehicle.toml", *arguments)


def test_a_disk_that_is_full_keeps_whole_records_alone(tmp_path: Path) -> None:
    """No file may grow beyond 20 kB, as on a disk that is full then."""
    text = "".join(recorded("free-flyer")[:301])
    line = [sys.executable, "-m", "massprop_cli", "live", "--vehicle", str(SAMPLES / "free-flyer" / "vehicle.toml"), "--out", "live"]
    ended = subprocess.run(
        line,
        cwd=tmp_path,
        input=text,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
        check=False,
    )
    assert ended.returncode == 3
    assert (
        ended.stderr
        == "massprop: live/record.csv: cannot be written (File too large); it holds the data before. Free disk space, and start again\n"
    )
    kept = (tmp_path / "live" / "record.csv").read_text()
    assert kept.endswith("\n")
    assert len(kept.splitlines()) > 50
    assert text.replace('"', "").startswith(kept.replace('"', ""))


@pytest.mark.parametrize("given", ["", "time_s\n"])
def test_what_never_began_leaves_no_folder(given: str, tmp_path: Path) -> None:
    assert live(tmp_path, given, "--out", "a/live").returncode == 3
    assert [path.name for path in tmp_path.iterdir()] == [STDIN]


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_recording_that_contradicts_its_vehicle_file_exits_with_6(tmp_path: Path) -> None:
    """A gyro in degrees."""
    header, *rows = recorded("free-flyer")[:401]
    at = [i for i, name in enumerate(header.replace('"', "").split(",")) if name.startswith("delta_theta")]
    cells = [row.rstrip("\n").split(",") for row in rows]
    turned = [",".join(f"{np.rad2deg(float(cell)):.9g}" if i in at else cell for i, cell in enumerate(row)) + "\n" for row in cells]
    given = "".join([header, *turned])
    assert live(tmp_path, given, "--out", "live", "-q").returncode == 6
    assert live(tmp_path, given, "--out", "allowed", "-q", "--allow-contradicted").returncode == 0


def test_a_recording_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "record.csv").write_text("precious")
    with pytest.raises(InputError, match="does not overwrite"), recording(tmp_path):
        pass
    assert (tmp_path / "record.csv").read_text() == "precious"


def test_a_recording_that_no_estimate_is_made_of_is_whole_and_exits_with_3(tmp_path: Path) -> None:
    """Half a second without records."""
    lines = recorded("free-flyer")[:301]
    ended = live(tmp_path, "".join([*lines[:100], *lines[110:]]), "--out", "live")
    assert ended.returncode == 3
    end, refused = ended.stderr.splitlines()
    assert end.endswith("massprop gives no values from here on, but records all data and estimates at the end")
    assert "split the log there" in refused
    assert (tmp_path / "live" / "record.csv").read_text().count("\n") == 291
    assert not (tmp_path / "live" / "result.json").exists()
