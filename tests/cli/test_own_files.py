"""No command writes over what is someone's own: its inputs, and files that massprop did not write."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from massprop_cli.kernel import kernel
from tests.cli.test_kill import PLAN, SETTINGS, contents
from tests.commandline import massprop, succeeded
from tests.hostile import flight, vehicle
from tests.refusal import save

GUESS = "[body]\nixx = 0.6\niyy = 2.7\nizz = 2.4\nmass = 22.0\n"


def _mine(*names: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("mine", encoding="utf-8")

    return make


def _folder(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).mkdir(parents=True)


def _log_called_history(folder: Path) -> None:
    (folder / "own").mkdir()
    shutil.copy(folder / "log.parquet", folder / "own" / "history.parquet")


def _nothing(folder: Path) -> None:
    del folder


BATCH = ("batch", "log.parquet", "-q", "--jobs", "1", "--out", "own")
ESTIMATE = ("estimate", "log.parquet", "-q", "--out", "own")
OWN: dict[str, tuple[Callable[[Path], None], tuple[str, ...], int, str]] = {
    "check: the log": (_nothing, ("check", "log.parquet", "--junit", "log.parquet"), 2, "log.parquet: exists already and is not JUnit"),
    "check: the vehicle": (_nothing, ("check", "log.parquet", "--junit", "vehicle.toml"), 2, "is not JUnit XML; name another file"),
    "check: a device": (_nothing, ("check", "log.parquet", "--junit", "/dev/null"), 2, "/dev/null: exists already"),
    "batch: the log": (_nothing, (*BATCH, "--junit", "log.parquet"), 2, "log.parquet: exists already and is not JUnit XML"),
    "batch: a result": (
        lambda folder: _mine(f"own/results/{folder.name}/notes")(folder),
        BATCH,
        3,
        "exists already, and massprop did not write it",
    ),
    "batch: a page": (_folder("own/campaign.html"), BATCH, 3, "own/campaign.html: is a folder; move it"),
    "batch: its lock": (_folder("own/.lock"), BATCH, 3, "own: cannot be written"),
    "batch: another page": (_mine("own/campaign.html"), BATCH, 3, "own/campaign.html: exists already, and massprop did not write it"),
    "estimate: another history": (_mine("own/history.parquet"), ESTIMATE, 3, "own/history.parquet: exists already, and massprop did not"),
    "estimate: the log": (
        _log_called_history,
        ("estimate", "own/history.parquet", "-q", "--vehicle", "vehicle.toml", "--out", "own"),
        3,
        "own/history.parquet: is the log itself; nothing was written",
    ),
    "simulate: a log": (_mine("own/log.parquet"), ("simulate", "free-flyer", "--out", "own"), 3, "own/log.parquet: exists already"),
    "simulate: a vehicle": (_mine("own/vehicle.toml"), ("simulate", "free-flyer", "--out", "own"), 3, "own/vehicle.toml: exists already"),
    "export-flight: a Makefile": (
        _mine("own/Makefile"),
        ("export-flight", "--vehicle", "vehicle.toml", "--out", "own"),
        3,
        "own/Makefile: exists already, and massprop did not write it",
    ),
    "plan: a scenario": (
        _mine("own/scenario.toml"),
        ("plan", "--vehicle", "vehicle.toml", "--guess", "guess.toml", *PLAN, "--out", "own"),
        3,
        "own/scenario.toml: exists already, and massprop did not write it",
    ),
    "report: a link that loops": (lambda folder: (folder / "own").symlink_to("own"), ("report", "own"), 3, "Too many levels of symbolic"),
}


@pytest.fixture
def here(tmp_path: Path) -> Path:
    vehicle(tmp_path)
    save(flight(100), tmp_path / "log.parquet")
    (tmp_path / "guess.toml").write_text(GUESS, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("case", OWN)
def test_what_is_someones_own_stays(case: str, here: Path) -> None:
    prepare, arguments, code, message = OWN[case]
    prepare(here)
    before = set(here.rglob("*")), contents(here)
    done = massprop(here, *arguments)
    assert done.returncode == code, done.stderr
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert (set(here.rglob("*")), contents(here)) == before


@pytest.mark.parametrize("again", [("simulate", "free-flyer", *SETTINGS), ("export-flight", "--vehicle", "vehicle.toml")])
def test_what_massprop_wrote_it_writes_again(again: tuple[str, ...], here: Path) -> None:
    for _ in range(2):
        succeeded(here, *again, "--out", "out")
    # as after a process that was killed before the last file was in place
    (here / "out" / ".massprop.lock").touch()
    for mark in ("truth.json", "table.h"):
        (here / "out" / mark).unlink(missing_ok=True)
    assert massprop(here, *again, "--out", "out").returncode == 0


@pytest.mark.parametrize("there", ["pipe", "device"])
def test_a_result_that_never_ends_is_not_read_before_it_is_replaced(there: str, here: Path) -> None:
    (here / "own").mkdir()
    if there == "pipe":
        os.mkfifo(here / "own" / "result.json")
    else:
        (here / "own" / "result.json").symlink_to("/dev/zero")
    assert massprop(here, *ESTIMATE).returncode == 0
    assert (here / "own" / "result.json").read_bytes().startswith(b"{")


@pytest.mark.skipif(kernel().library is None, reason="no compiled kernel")
def test_a_kernel_of_another_version_leaves_it_to_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("massprop_cli.kernel.INTERFACE", -1)
    found = kernel.__wrapped__()
    assert found.library is None
    assert "is of another version; install massprop anew" in found.name


def test_a_kernel_that_is_none_is_told(here: Path) -> None:
    done = massprop(here, *ESTIMATE, MASSPROP_KERNEL="Numpy")
    assert (done.returncode, done.stderr) == (3, "massprop: MASSPROP_KERNEL=Numpy: no such kernel; set numpy, or unset it\n")


@pytest.mark.parametrize(
    "line",
    [
        ("estimate", "log.parquet", "--out", "\udcff"),
        ("init", "log.parquet", "--out", "\udcff"),
        ("check", "log.parquet", "--junit", "\udcff"),
        ("batch", "log.parquet", "--out", "\udcff"),
        ("simulate", "free-flyer", "--out", "\udcff"),
    ],
)
def test_a_name_that_is_not_utf_8_is_refused(line: tuple[str, ...], here: Path) -> None:
    before = contents(here)
    done = massprop(here, *line)
    assert done.returncode == 2, done.stderr
    assert f"{line[2]} '\\udcff': is not UTF-8; choose another name" in done.stderr
    assert contents(here) == before
