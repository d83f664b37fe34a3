"""What fuzzers feed: bytes in, and nothing out but a value or :class:`InputError`. Anything else that is raised is a finding."""

import faulthandler
import io
import json
import os
import re
import signal
import sys
import tempfile
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from rich.console import Console

from massprop_cli.base import escape
from massprop_cli.base.errors import InputError, UsageError
from massprop_cli.campaign import campaignfile
from massprop_cli.export import folder, resolve
from massprop_cli.inputs import expect, logfile, require, telemetry, tolerancefile, vehicle, vehiclefile
from massprop_cli.inputs.formats import draft, isolated, listing, mapfile, mapped, propose, reading, recording, traits
from massprop_cli.live import records, run
from massprop_cli.plan import guess
from massprop_cli.report import markdown, spreadsheet, terminal
from massprop_cli.result import read
from massprop_cli.testbed import scenario

CORPUS = Path(__file__).parent / "corpus"
SAMPLE = Path(__file__).parent.parent / "sample_logs" / "free-flyer" / "vehicle.toml"


@cache
def flyer() -> vehicle.Vehicle:
    return vehiclefile.load(SAMPLE).vehicle


def log(name: str, data: bytes) -> None:
    with suppress(InputError), np.errstate(all="ignore"):
        telemetry.read(logfile.parse(Path(name), data), flyer())


def csv(data: bytes) -> None:
    log("log.csv", data)


def parquet(data: bytes) -> None:
    log("log.parquet", data)


RECORDINGS = (".mat", ".h5", ".ulg", ".bag", ".db3", ".mcap", ".mf4", ".csv", ".tsv", ".csv.gz")


def recorded(data: bytes) -> None:
    """The first byte says how the file is called. Read as the program reads it, but for a process that is forked, which is quicker."""
    path = Path(f"log{RECORDINGS[data[0] % len(RECORDINGS)]}" if data else "log.mat")
    with patch.object(isolated, "run_reader", forked), suppress(InputError), np.errstate(all="ignore"):
        used(reading.read(path, data[1:]), None)


def used(read: recording.Recording, source: mapfile.MapSource | None) -> None:
    """All that is done with a recording: the list of what is in it, the drafts of its map and vehicle file, and a log."""
    listing.listed(read)
    assert propose.questions(propose.draft(read)) >= 0
    table = mapped.of(read, source)
    draft.draft("log", traits.traits(table), read.parameters)
    log = telemetry.read(table, flyer())
    assert np.isfinite(log.delta_theta_imu_rad).all()


def forked(arguments: list[str], data: bytes) -> int:
    """What :func:`isolated.run_reader` does, with the reader's library imported once for all."""
    path, module, folder, seconds, memory = arguments
    begun = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024  # what it inherits, kB
    with recording.unremarked():
        import_module(f"massprop_cli.inputs.formats.{module}")
        child = os.fork()
    if child == 0:
        try:
            faulthandler.disable()
            for number in (signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGFPE, signal.SIGXCPU):
                signal.signal(number, signal.SIG_DFL)  # a fuzzer has its own
            tempfile.tempdir = folder
            sys.stdin = io.TextIOWrapper(io.BytesIO(data))
            for stream in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
            held = int(Path("/proc/self/statm").read_text().split()[5]) * os.sysconf("SC_PAGE_SIZE")
            isolated.main(Path(path), module, Path(folder), int(seconds), int(memory) + held)
        except BaseException:
            os._exit(1)
        os._exit(0)
    _, status, used = os.wait4(child, 0)
    assert used.ru_maxrss < 2**20 + begun, "more than a gigabyte"
    assert used.ru_utime + used.ru_stime < 10, "more than ten seconds"
    return os.waitstatus_to_exitcode(status)


TYPES = ("<f8", "<f4", "<i8", "<u8", "<i4", "<u4", "<i2", "<u2", "<i1", "<u1", ">f8", "<f2")
UNITS = ("", "s", "ms", "us", "ns", "rad/s", "deg/s", "m/s^2", "g", "rad", "m/s", "N m", "N", "%", "furlong")


def streams(data: bytes) -> None:
    """A map up to the first zero byte, then streams: lengths of name and numbers, type, unit, clock in five bytes, then both of them."""
    text, _, rest = data.partition(b"\0")
    found: list[recording.RecordedStream] = []
    while len(rest) >= 5:
        name, rows, kind, unit, clock = rest[:5]
        form = np.dtype(TYPES[kind % len(TYPES)])
        values = np.frombuffer(rest[5 + name : 5 + name + rows * form.itemsize].ljust(rows * form.itemsize, b"\0"), form)
        of = found[(clock - 1) % len(found)].path if found and clock else ""
        path = rest[5 : 5 + name].decode("utf-8", "replace")
        found.append(recording.stream(path, values, of, UNITS[unit % len(UNITS)]))
        rest = rest[5 + name + rows * form.itemsize :]
    read = recording.Recording(Path("log.h5"), "", "HDF5 file", {one.path: one for one in found})
    with suppress(InputError), np.errstate(all="ignore"):
        used(read, mapfile.parse(text.decode("utf-8", "replace"), "map.toml") if text else None)


def toml(data: bytes) -> None:
    """The first byte says as which file the rest is read."""
    text = data[1:].decode("utf-8", "replace")
    reader = READERS[data[0] % len(READERS)] if data else READERS[0]
    with suppress(InputError), np.errstate(all="ignore"):
        reader(text)


def _campaign(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "campaign.toml"
        file.write_text(text, encoding="utf-8")
        campaignfile.load(str(file))


def _tolerance(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "tolerance.toml"
        file.write_text(text, encoding="utf-8")
        tolerancefile.load(file, 4.0)


def _guess(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "guess.toml"
        file.write_text(text, encoding="utf-8")
        found = guess.load(file, vehiclefile.load(SAMPLE))
    assert np.isfinite(found.bodies).all()


def _assigned(text: str) -> None:
    """What stands behind ``--set``, one on each line."""
    vehiclefile.load(SAMPLE, tuple(text.splitlines()))


def _required(text: str) -> None:
    """What stands behind ``--require``, ``--want``."""
    with suppress(UsageError):
        for item in require.requirements(text):
            assert item.precision is None or 0 < item.precision.sigma(1.0) < float("inf")


READERS: tuple[Callable[[str], object], ...] = (
    lambda text: vehiclefile.parse(text, "vehicle.toml"),
    lambda text: scenario.parse(text, "scenario.toml"),
    lambda text: expect.parse(text, Path("expect.toml")),
    lambda text: expect.parse(text, Path("expect.json")),
    _campaign,
    _tolerance,
    _guess,
    _assigned,
    _required,
)


def result(data: bytes) -> None:
    """Read back, and put into a table, Markdown and CSV, none of which may hold what a terminal obeys."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "result.json"
        file.write_bytes(data)
        try:
            found = read.read(file)
        except InputError:
            return
        shown = io.StringIO()
        terminal.show(found.result, Console(file=shown, no_color=True, width=132))
        for text in (shown.getvalue(), markdown.text([found]), spreadsheet.text([found])):
            assert not list(_obeyed(text))


def _obeyed(text: str) -> Iterator[str]:
    return (character for character in text if unicodedata.category(character) in ("Cc", "Cf") and character not in "\t\r\n")


def live(data: bytes) -> None:
    """Records on standard input, CSV or objects: what is said is finite, and of a recording that a log may be but for its intervals."""
    said, kept, told = 0, io.StringIO(), io.StringIO(data.decode("utf-8-sig", "replace"))
    with suppress(InputError), np.errstate(all="ignore"):
        for line in run.follow(records.lines_of(told), vehiclefile.load(SAMPLE), kept.write, _one_line):
            estimates = json.loads(line, parse_constant=pytest.fail)["estimates"].values()
            assert all((each["value"] is None) or each["sigma"] > 0 for each in estimates)
            said += 1
    if said:
        # which interval is the usual one the first tells here, all of them there
        refused = _refusal(kept.getvalue().encode("utf-8", "replace"))
        assert not refused or "interval" in refused or "record longer" in refused, refused


def _refusal(recording: bytes) -> str:
    try:
        with np.errstate(all="ignore"):
            telemetry.read(logfile.parse(Path("record.csv"), recording), flyer())
    except InputError as error:
        return str(error)
    return ""


def _one_line(message: str) -> None:
    assert not list(_obeyed(escape.message(message)))


def exported(data: bytes) -> None:
    """A vehicle file to C: every number is one, and no name ends the comment that it stands in."""
    text = data.decode("utf-8", "replace")
    with suppress(InputError), np.errstate(all="ignore"):
        written = folder.contents(resolve.stated(vehiclefile.parse(text, "vehicle.toml")))
        table = written["table.c"] + written["table.h"]
        assert table.count("/*") == table.count("*/")
        assert not {"inf", "nan"} & set(re.findall(r"R\(-?(\w+)", table))


TARGETS: dict[str, Callable[[bytes], None]] = {
    "csv": csv,
    "parquet": parquet,
    "recording": recorded,
    "streams": streams,
    "toml": toml,
    "result": result,
    "live": live,
    "export": exported,
}
