"""Ended at any moment by any signal, a command that writes leaves nothing half-written, and the next run clears what is left.

``pytest -m slow tests/cli/test_kill.py --kills 100 -k plan -s`` ends one command so many times: half of them at any moment of the time
that it takes, half before a step with files (a file opened to write, renamed or removed, a folder made), since these take a hundredth of
that time. It says how many came before anything was written, among the writing, behind it, and when the command had ended.
"""

import atexit
import json
import os
import random
import shutil
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import cast

import pytest

from tests import filesteps
from tests.commandline import STDIN, begun, massprop
from tests.hostile import flight, vehicle
from tests.refusal import save

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
SETTINGS = ("--set", "duration_s=3.0", "--set", 'plan=[{motion="random",axes=["roll","yaw","x"],start_s=0.0,end_s=3.0}]')
OFF = [f"{axis}_{end}" for axis in ("roll", "pitch") for end in ("p1", "p2", "n1", "n2")] + [
    f"divert_{axis}{sign}" for axis in "xyz" for sign in "pn"
]
PLAN = ("--want", "izz 50 %", "--max-time", "0.5", *(part for jet in OFF for part in ("--without", jet)))
"""By the yaw jets alone: few motions are tried."""
THERE = ("drafted.toml: exists already", "record.csv: exists already", "record.csv: cannot be written (File exists)")
"""What ``init`` and ``live`` say, which write over no file."""
Prepare = Callable[[Path], None]


@cache
def _once(make: Prepare) -> Path:
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    make(folder)
    return folder


def shared(make: Prepare) -> Prepare:
    """Files that commands took time to make are made once and copied."""
    return lambda folder: cast(None, shutil.copytree(_once(make), folder, dirs_exist_ok=True))


def _log(folder: Path) -> None:
    vehicle(folder)
    save(flight(100), folder / "log.parquet")


@shared
def _result(folder: Path) -> None:
    _log(folder)
    assert massprop(folder, "estimate", "log.parquet", "-q", "--out", "result").returncode == 0


@shared
def _logs(folder: Path) -> None:
    assert massprop(folder, "simulate", "free-flyer", *SETTINGS, "--seeds", "3", "-q", "--out", "logs").returncode == 0


def _vehicle(folder: Path) -> None:
    vehicle(folder)
    (folder / "guess.toml").write_text("[body]\nixx = 0.6\niyy = 2.7\nizz = 2.4\nmass = 22.0\n", encoding="utf-8")


@shared
def _results(folder: Path) -> None:
    _log(folder)
    save(flight(90), folder / "other.parquet")
    for name in ("log", "other"):
        assert massprop(folder, "estimate", f"{name}.parquet", "-q", "--out", name).returncode == 0


def _records(folder: Path) -> None:
    vehicle(folder)
    save(flight(100), folder / STDIN)


COMMANDS: dict[str, tuple[Prepare, tuple[str, ...]]] = {
    "estimate": (_log, ("estimate", "log.parquet", "-q")),
    "estimate --out": (_log, ("estimate", "log.parquet", "-q", "--out", "out")),
    "report": (_result, ("report", "result", "--format", "md,csv,junit", "-q", "--out", "out")),
    "simulate": (lambda _: None, ("simulate", "free-flyer", *SETTINGS, "-q", "--out", "out")),
    "simulate --seeds": (lambda _: None, ("simulate", "free-flyer", *SETTINGS, "--seeds", "3", "-q", "--out", "out")),
    "plan": (_vehicle, ("plan", "--vehicle", "vehicle.toml", "--guess", "guess.toml", *PLAN, "-q", "--out", "out")),
    "check --junit": (_log, ("check", "log.parquet", "-q", "--junit", "junit.xml")),
    "combine": (_results, ("combine", "log", "other", "-q", "--out", "out")),
    "init --out": (_log, ("init", "log.parquet", "--out", "drafted.toml")),
    "export-flight": (_log, ("export-flight", "--vehicle", "vehicle.toml", "--log", "log.parquet", "-q", "--out", "out")),
    "live": (_records, ("live", "--vehicle", "vehicle.toml", "-q", "--out", "out")),
    "batch": (_logs, ("batch", "logs", "-q", "--jobs", "1", "--junit", "junit.xml", "--out", "out")),
}


def contents(folder: Path) -> dict[str, bytes]:
    """Of all files but for the time of the run that is in some."""
    return {file: _timeless(file, content) for file, content in _raw(folder).items()}


def _raw(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def _timeless(file: str, content: bytes) -> bytes:
    if not file.endswith("run.json"):
        return content
    return json.dumps({key: value for key, value in json.loads(content).items() if key != "time"}).encode()


def survives(command: str, tmp_path: Path, kills: int) -> None:
    prepare, arguments = COMMANDS[command]
    before, wanted = tmp_path / "before", tmp_path / "here"
    before.mkdir()
    prepare(before)
    shutil.copytree(before, wanted)
    began = time.monotonic()
    assert _ended(_start(wanted, arguments, tmp_path, partial(filesteps.count, wanted, tmp_path / "steps"))) == 0
    lasts, steps = time.monotonic() - began, len((tmp_path / "steps").read_text(encoding="utf-8").splitlines())
    whole = contents(wanted)
    moments, found = random.Random(command), Counter[str]()
    for kill in range(kills):
        shutil.rmtree(wanted)
        shutil.copytree(before, wanted)
        if kill % 8 in (6, 7) and command not in ("init --out", "live"):
            assert massprop(wanted, *arguments).returncode == 0
        number, earlier = SIGNALS[kill % 3], _raw(wanted)
        if kill % 2:
            code = _kill(wanted, arguments, number, moments.uniform(0.0, lasts), tmp_path)
        else:
            code = _ended(_start(wanted, arguments, tmp_path, partial(filesteps.end, wanted, moments.randint(1, steps), number)))
        said = (tmp_path / "stderr").read_text(encoding="utf-8")
        assert code in (0, -number, 130 if number == signal.SIGINT else 0), f"{number} ended it with {code}: {said}"
        found[_when(code, earlier, wanted, whole)] += 1
        assert "Traceback" not in said
        for file, content in _raw(wanted).items():
            assert _is_hidden(file) or file in whole, f"{file} was left in plain sight"
            assert _is_hidden(file) or _is_whole(file, content, whole[file]), f"{file} is half-written"
        again = massprop(wanted, *arguments)
        assert again.returncode == 0 or any(words in again.stderr for words in THERE)
        if command == "live" and again.returncode:
            _estimated(wanted, whole)
        else:
            assert contents(wanted) == whole, "something was left behind, or is missing"
    print(f"\n{command}: {kills} kills, {dict(sorted(found.items()))}; it takes {lasts:.2f} s and {steps} steps with files")
    assert found["writing"] > kills // 5, "hardly any signal came while files were written"


def _when(code: int, earlier: dict[str, bytes], folder: Path, whole: dict[str, bytes]) -> str:
    """Whether a signal came before anything was written, among the writing, behind it, or when the command had ended."""
    if code == 0:
        return "ended"
    left = _raw(folder)
    if any(_is_hidden(str(path.relative_to(folder))) for path in folder.rglob("*")):
        return "writing"
    return "before" if left == earlier else "behind" if contents(folder) == whole else "writing"


def _is_hidden(file: str) -> bool:
    return any(part.startswith(".") for part in Path(file).parts)


def _is_whole(file: str, content: bytes, whole: bytes) -> bool:
    """As in the end; of a recording whole records, and of a run the log that it is of."""
    begun_run = file.endswith("run.json") and b'"log"' in content
    begun_recording = file.endswith("record.csv") and whole.startswith(content) and content.endswith(b"\n")
    return whole == _timeless(file, content) or begun_run or begun_recording


def _estimated(folder: Path, whole: dict[str, bytes]) -> None:
    """A recording that was ended gives the result of a log; what was left half-written goes."""
    done = massprop(folder, "estimate", "out/record.csv", "--vehicle", "vehicle.toml", "-q", "--out", "out")
    found = contents(folder)
    assert done.returncode == 0 or found["out/record.csv"].count(b"\n") < 20, done.stderr
    assert not any(map(_is_hidden, found)) or done.returncode
    assert found == whole or found["out/record.csv"] != whole["out/record.csv"]


def _kill(folder: Path, arguments: tuple[str, ...], number: int, after_s: float, said: Path) -> int:
    """Send a signal after so many seconds; the exit code."""
    process = _start(folder, arguments, said)
    process.join(0.01 + after_s)  # after the first moments, in which Python's own handlers are replaced
    if process.is_alive() and process.pid is not None:
        with suppress(ProcessLookupError):  # it may end just now
            os.kill(process.pid, number)
    return _ended(process)


def _start(folder: Path, arguments: tuple[str, ...], said: Path, first: Callable[[], None] | None = None) -> ForkServerProcess:
    for name in ("stdout", "stderr"):
        (said / name).unlink(missing_ok=True)
    process = begun(folder, arguments, [said / name for name in ("stdout", "stderr", "peak")], {}, first)
    while not (said / "stderr").exists():
        time.sleep(0.001)
    return process


def _ended(process: ForkServerProcess) -> int:
    process.join(30)
    assert process.exitcode is not None, "it goes on after the signal"
    return process.exitcode


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_that_is_ended_at_any_moment_leaves_nothing(command: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    survives(command, tmp_path, request.config.getoption("--kills"))
