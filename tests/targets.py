"""What fuzzers feed: bytes in, and nothing out but a value or :class:`InputError`. Anything else that is raised is a finding."""

from __future__ import annotations

import io
import tempfile
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
from rich.console import Console

from massprop_cli.base.errors import InputError
from massprop_cli.campaign import campaignfile
from massprop_cli.inputs import expect, tablefile, telemetry, tolerancefile, vehicle, vehiclefile
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
        telemetry.read(tablefile.parse(Path(name), data), flyer())


def csv(data: bytes) -> None:
    log("log.csv", data)


def parquet(data: bytes) -> None:
    log("log.parquet", data)


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


READERS: tuple[Callable[[str], object], ...] = (
    lambda text: vehiclefile.parse(text, "vehicle.toml"),
    lambda text: scenario.parse(text, "scenario.toml"),
    lambda text: expect.parse(text, Path("expect.toml")),
    lambda text: expect.parse(text, Path("expect.json")),
    _campaign,
    _tolerance,
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


TARGETS: dict[str, Callable[[bytes], None]] = {"csv": csv, "parquet": parquet, "toml": toml, "result": result}
