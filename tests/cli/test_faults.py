"""Streams, disks and folders that fail while a command runs, two processes on one folder, terminals that lack letters."""

import os
import py_compile
import resource
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from massprop_cli.base import files
from tests import commandline, filesteps
from tests.cli.test_kill import COMMANDS, PLAN, SETTINGS, THERE, contents
from tests.commandline import STDIN, massprop, succeeded
from tests.hostile import flight, vehicle
from tests.refusal import save

TOOL = f"{sys.executable} -m massprop_cli"
WRITING = [command for command in COMMANDS if command != "estimate"]


def shell(folder: Path, line: str, **settings: str) -> subprocess.CompletedProcess[bytes]:
    settings = {"PYTHONPATH": str(Path(__file__).parents[2]), **settings}
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {line}"], cwd=folder, env=os.environ | settings, capture_output=True, timeout=60, check=False
    )


@pytest.fixture
def log(tmp_path: Path) -> Path:
    vehicle(tmp_path)
    return save(flight(100), tmp_path / "log.parquet")


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (f"{TOOL} estimate log.parquet --out out | head -1", 141),
        (f"{TOOL} schema log | true", 141),
        (f"{TOOL} estimate log.parquet --out out <&- >&- 2>&-", 0),
        (f"{TOOL} estimate log.parquet --out out >/dev/full", 3),
        (f"{TOOL} estimate none.parquet 2>/dev/full", 3),
        *(
            pytest.param(*one, marks=pytest.mark.thorough)
            for one in (
                (f"{TOOL} estimate log.parquet --out out --json >&-", 0),
                (f"{TOOL} estimate none.parquet 2>&-", 3),
                (f"{TOOL} --help | true", 141),
                (f"{TOOL} estimate none.parquet 2>&1 >/dev/null | true", 141),
                (f"{TOOL} estimate log.parquet --out out >&-", 0),
                (f"{TOOL} estimate log.parquet --out out 2>&-", 0),
                (f"{TOOL} estimate log.parquet --out out --json >/dev/full", 3),
            )
        ),
    ],
)
def test_a_stream_that_fails_is_no_bug(line: str, code: int, log: Path) -> None:
    done = shell(log.parent, line)
    assert done.returncode in ({code, 0} if code == 141 else {code}), done.stderr
    assert b"Traceback" not in done.stderr
    assert b"Exception ignored" not in done.stderr
    assert b"internal error" not in done.stderr
    if "log.parquet" in line:
        assert sorted(path.name for path in (log.parent / "out").iterdir()) == ["history.parquet", "result.json", "run.json"]


@pytest.mark.parametrize(
    "encoding", ["ascii", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("latin-1", "cp437", "utf-16"))]
)
def test_a_terminal_of_any_encoding_gets_its_table(encoding: str, log: Path) -> None:
    done = shell(log.parent, f"{TOOL} estimate log.parquet --out out", PYTHONIOENCODING=encoding, PYTHONUTF8="0", LC_ALL="C")
    assert done.returncode == 0, done.stderr
    assert "converged" in done.stdout.decode(encoding)


def _limited(size: int) -> None:
    sys.dont_write_bytecode = True  # what Python compiles would be cut by the limit, too, and stay so
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.thorough
@pytest.mark.parametrize("command", WRITING[::2])
def test_a_quota_that_is_reached_leaves_what_was_there(command: str, tmp_path: Path) -> None:
    """No file may become larger than 300 bytes, as on a disk that is full after these."""
    prepare, arguments = COMMANDS[command]
    prepare(tmp_path)
    before = contents(tmp_path)
    done = commandline.ended(tmp_path, arguments, {}, partial(_limited, 300))
    assert done.returncode == 3, done.stderr
    assert done.stderr.count("\n") == 1
    assert "cannot be written" in done.stderr
    left = {file for file in contents(tmp_path) if not file.startswith("out/results/")}
    assert left == set(before), "something half-written, or hidden, is left"
    assert command == "batch" or not (tmp_path / "out").exists(), "an empty folder is left"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 16 kB; skipped where none may be mounted."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", disk], capture_output=True, check=False).returncode:
        pytest.skip("no file system may be mounted here")
    yield disk
    subprocess.run(["umount", disk], check=True)


@pytest.mark.thorough
def test_a_full_disk_leaves_the_earlier_result(small_disk: Path, log: Path) -> None:
    out = small_disk / "out"
    out.mkdir()
    (out / "result.json").write_text("the earlier one", encoding="utf-8")
    done = shell(log.parent, f"{TOOL} estimate log.parquet -q --out {out}")
    assert done.returncode == 3, done.stderr
    assert b"No space left on device" in done.stderr
    assert contents(out) == {"result.json": b"the earlier one"}


VANISHING = ("estimate --out", "report", "simulate", "export-flight", "combine")


@pytest.mark.thorough
@pytest.mark.parametrize("command", VANISHING)
@pytest.mark.parametrize("step", [3, 8])
def test_a_folder_that_vanishes_while_files_are_written_is_told(command: str, step: int, tmp_path: Path) -> None:
    prepare, arguments = COMMANDS[command]
    here = tmp_path / "here"
    here.mkdir()
    prepare(here)
    before = contents(here)
    said = [tmp_path / name for name in ("stdout", "stderr", "peak")]
    process = commandline.begun(here, arguments, said, {}, partial(filesteps.vanish, here, step, "out"))
    process.join(60)
    told = said[1].read_text(encoding="utf-8")
    assert process.exitcode == 3, told
    assert told.startswith("massprop: out: cannot be written (No such file or directory); choose another folder")
    assert told.count("\n") == 1
    assert contents(here) == before


def test_compiled_files_that_a_full_disk_cut_are_told(tmp_path: Path) -> None:
    shutil.copytree(Path(__file__).parents[2] / "massprop_cli", tmp_path / "massprop_cli")
    compiled = Path(py_compile.compile(str(tmp_path / "massprop_cli" / "schemas.py"), doraise=True) or "")
    compiled.write_bytes(compiled.read_bytes()[:300])
    done = shell(tmp_path, f"{TOOL} schema vehicle", PYTHONPATH=str(tmp_path), PYTHONPYCACHEPREFIX="")
    assert done.returncode == 3, done.stderr
    assert b"compiled files are truncated, as by a full disk; remove __pycache__ below" in done.stderr


WRITTEN = ("out", "junit.xml", "drafted.toml")
"""What commands of :data:`COMMANDS` write."""


def _on(disk: Path, arguments: Sequence[str]) -> list[str]:
    return [str(disk / one) if one in WRITTEN else one for one in arguments]


def _refused(folder: Path, arguments: Sequence[str], words: str) -> None:
    done = massprop(folder, *arguments)
    assert done.returncode == 3, done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert words in done.stderr


@pytest.mark.thorough
@pytest.mark.parametrize("command", WRITING[1::2])
def test_a_disk_that_is_full_or_can_only_be_read_is_told(command: str, small_disk: Path, tmp_path: Path) -> None:
    prepare, arguments = COMMANDS[command]
    prepare(tmp_path)
    filling = small_disk / "filling"
    with suppress(OSError):
        filling.write_bytes(bytes(2**15))
    _refused(tmp_path, _on(small_disk, arguments), "No space left on device")
    assert {path.name for path in small_disk.iterdir()} - ({"out"} if command == "batch" else set()) == {"filling"}
    subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
    _refused(tmp_path, _on(small_disk, arguments), "Read-only file system")


def _vanish_here(folder: Path) -> None:
    """This process works in a folder that is gone."""
    (folder / "here").mkdir()
    os.chdir(folder / "here")
    (folder / "here").rmdir()


@pytest.mark.parametrize("command", [pytest.param(name, marks=[pytest.mark.thorough] * (n % 3 > 0)) for n, name in enumerate(WRITING)])
def test_a_folder_that_vanished_under_the_command_is_told(command: str, tmp_path: Path) -> None:
    prepare, arguments = COMMANDS[command]
    prepare(tmp_path)
    above = [f"../{one}" if (tmp_path / one).exists() else one for one in arguments]
    said = [tmp_path / name for name in ("stdout", "stderr", "peak")]
    process = commandline.begun(tmp_path, above, said, {}, partial(_vanish_here, tmp_path))
    process.join(60)
    told = said[1].read_text(encoding="utf-8")
    assert process.exitcode == 3, told
    assert told.count("\n") == 1


SAYING = {
    "check": ("check", "log.parquet"),
    "columns": ("columns", "log.parquet"),
    "init": ("init", "log.parquet"),
    "export-flight": ("export-flight", "--vehicle", "vehicle.toml", "--out", "flight"),
    "live": ("live", "--vehicle", "vehicle.toml", "--out", "live"),
    "plan": ("plan", "--vehicle", "vehicle.toml", "--guess", "guess.toml", *PLAN, "--out", "plan"),
    "combine": ("combine", "log", "other", "--out", "joint"),
    "compare": ("compare", "log", "other"),
    "report": ("report", "log", "--format", "md", "--out", "page"),
    "simulate": ("simulate", "free-flyer", *SETTINGS, "--out", "flown"),
    "schema": ("schema", "vehicle"),
}
"""Commands that say something."""


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all that these are given."""
    folder = tmp_path_factory.mktemp("asked")
    COMMANDS["combine"][0](folder)
    COMMANDS["plan"][0](folder)
    COMMANDS["live"][0](folder)
    return folder


SILENT = ("export-flight", "simulate")
"""They write files and say so on stderr."""


FULL, GONE = (">/dev/full", (3,)), (("| true", (141, 0)), (">&-", (0,)), ("2>&-", (0,)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "end", "codes"),
    [
        *(pytest.param(command, *FULL, marks=[pytest.mark.seeds] * (command == "plan")) for command in SAYING),
        *((command, *GONE[n % 3]) for n, command in enumerate(SAYING) if command != "plan"),
    ],
)
def test_a_stream_that_fails_under_any_command_is_no_bug(
    command: str, end: str, codes: tuple[int, ...], asked: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "here"
    shutil.copytree(asked, folder)
    done = shell(folder, f"{TOOL} {shlex.join(SAYING[command])} < {STDIN} {end}")
    # nothing on stdout is nothing that may be lost
    assert done.returncode in codes or (command in SILENT and done.returncode == 0), done.stderr
    for words in (b"Traceback", b"Exception ignored", b"internal error"):
        assert words not in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("command", [pytest.param(command, marks=[pytest.mark.seeds] * (command == "plan")) for command in SAYING])
def test_any_command_speaks_to_a_terminal_of_any_encoding(command: str, asked: Path, tmp_path: Path) -> None:
    folder = tmp_path / "here"
    shutil.copytree(asked, folder)
    done = shell(folder, f"{TOOL} {shlex.join(SAYING[command])} < {STDIN}", PYTHONIOENCODING="ascii", PYTHONUTF8="0", LC_ALL="C")
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii() or command == "schema"  # JSON is UTF-8 wherever it goes
    assert done.stderr.isascii()


NAMES = ["two words", "new\nline", "-rf", 127 * "é" + "x", "\x1b[31m", "%s$(id)"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "name"),
    [
        (command, NAMES[(n + more) % len(NAMES)])
        for n, command in enumerate(("check", "export-flight", "live", "combine", "report"))
        for more in (0, 3)
    ],
)
def test_any_command_takes_files_and_folders_of_any_name(command: str, name: str, asked: Path, tmp_path: Path) -> None:
    folder, out = tmp_path / "here", tmp_path / "here" / name
    shutil.copytree(asked, folder)
    line = [word for word in SAYING[command] if word not in ("--vehicle", "vehicle.toml")]
    if "--out" in line:
        line[line.index("--out") :] = [f"--out={name}"]
    if command not in ("combine", "report"):
        source = f"{name[:120]}.toml"
        (folder / "vehicle.toml").rename(folder / source)
        line.append(f"--vehicle={source}")
    done = succeeded(folder, *line)
    assert "\x1b" not in done.stdout + done.stderr
    assert command == "check" or list(out.iterdir())


@pytest.mark.thorough
@pytest.mark.parametrize("command", [command for command in WRITING[::2] if command != "plan"])
def test_two_processes_on_one_folder_end_in_one_whole_result(command: str, tmp_path: Path) -> None:
    prepare, arguments = COMMANDS[command]
    prepare(tmp_path)
    paths = [[tmp_path.parent / f"{tmp_path.name}-{n}-{name}" for name in ("stdout", "stderr", "peak")] for n in range(2)]
    both = [commandline.begun(tmp_path, arguments, each, {}) for each in paths]
    for process in both:
        process.join(60)
    codes, said = sorted(process.exitcode or 0 for process in both), "".join(each[1].read_text(encoding="utf-8") for each in paths)
    assert codes in ([0, 0], [0, 3]), said
    if codes == [0, 3]:
        assert "another massprop is writing there" in said or any(words in said for words in THERE)
    together = contents(tmp_path)
    assert not [file for file in together if "/." in f"/{file}"]
    again = massprop(tmp_path, *arguments)
    assert again.returncode == 0 or any(words in again.stderr for words in THERE)
    assert contents(tmp_path) == together


def test_what_a_killed_process_left_is_cleared_and_its_folder_is_free(log: Path) -> None:
    folder = log.parent / "massprop-out" / "log"
    folder.mkdir(parents=True)
    (folder / ".massprop.lock").touch()
    (folder / ".massprop-abc.partial").write_text("half", encoding="utf-8")
    succeeded(log.parent, "estimate", "log.parquet", "-q")
    assert sorted(contents(log.parent / "massprop-out")) == ["log/history.parquet", "log/result.json", "log/run.json"]


def test_what_a_process_left_that_was_killed_as_it_named_a_folder_is_cleared(log: Path) -> None:
    assert massprop(log.parent, "estimate", "log.parquet", "-q").returncode == 0
    (log.parent / "massprop-out" / ".massprop.lock").touch()
    assert massprop(log.parent, "estimate", "log.parquet", "-q").returncode == 0
    assert sorted(contents(log.parent / "massprop-out")) == ["log/history.parquet", "log/result.json", "log/run.json"]


def test_a_folder_that_was_made_and_stays_empty_is_removed(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="full"), files.held(tmp_path / "a" / "b"):
        raise OSError("full")
    assert list(tmp_path.iterdir()) == []


def test_files_that_belong_together_lack_their_mark_until_all_are_there(tmp_path: Path) -> None:
    (tmp_path / "mark").write_text("old", encoding="utf-8")
    with files.staged(tmp_path) as stage:
        for name in ("first", "second", "mark"):
            stage.save(name, lambda path: path.write_text("new", encoding="utf-8"))
        (tmp_path / "second").mkdir()  # meanwhile; can't be replaced by a file
        with pytest.raises(OSError, match="directory"):
            stage.place()
    assert not (tmp_path / "mark").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first", "second"]
