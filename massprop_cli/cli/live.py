"""``massprop live``."""

from __future__ import annotations

import io
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from massprop_cli.base import escape, exits
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import say, say_stored, show, warn

if TYPE_CHECKING:
    from massprop_cli.job import Judged


@guarded
def live(
    vehicle: options.RequiredVehicle,
    out: Annotated[Path, options.out("Folder for the recording and its result.")],
    assign: options.Assign = None,
    allow_contradicted: options.AllowContradicted = False,
    quiet: Annotated[bool, options.quiet("No table, no warnings.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Estimate while records arrive on standard input (CSV, or one JSON object per line); print one JSON line per control cycle.

    Stores the records in record.csv and finally estimates it like `massprop estimate`: result.json, history.parquet, run.json. Ctrl-C or
    SIGTERM ends the recording and still writes the result. The recording continues if the reader of standard output closes. A rejected
    record, or a gap after which no values are possible, is one line on stderr; the recording continues. On a pedestal each line has inertia
    and first moment about the pivot. Exit 3: unusable input; 6: the recording contradicts the vehicle file.

    Examples:
        massprop live --vehicle vehicle.toml --out flight < log.csv
    """
    folder_of_its_own(out)
    from massprop_cli.inputs import vehiclefile
    from massprop_cli.live import records, run
    from massprop_cli.live.run import RECORDED, recording

    if isinstance(sys.stdin, io.TextIOWrapper):
        # bytes that are not text make a bad record and do not end the recording
        sys.stdin.reconfigure(encoding="utf-8-sig", errors="replace")
    source = vehiclefile.load(vehicle, assign or [])
    answers = _Answers()
    with _until_interrupted(records.lines_of(sys.stdin)) as (lines, interrupted), recording(out) as keep:
        for line in run.follow(lines, source, keep, say):
            answers.put(line)
    judged = _conclude(out / RECORDED, vehicle, assign or [], allow_contradicted, quiet, no_color)
    if number := interrupted():
        fail("interrupted; the result uses the data until then", exits.SIGNALLED + number)
    answers.check()
    if judged.exit_code:
        fail(judged.message, judged.exit_code)


class _Answers:
    """Writer of lines on standard output that continues silently after the reader closes."""

    def __init__(self) -> None:
        self.failed: OSError | None = None

    def put(self, line: str) -> None:
        """Write one line and flush."""
        if self.failed is None:
            try:
                sys.stdout.write(f"{line}\n")
                sys.stdout.flush()
            except OSError as error:
                self.failed = error

    def check(self) -> None:
        """Raise the error of a line that could not be written."""
        if self.failed is not None:
            raise self.failed


class _Interrupt(Exception):  # noqa: N818
    """Signal during a wait for a line."""


@contextmanager
def _until_interrupted(lines: Iterable[str]) -> Iterator[tuple[Iterator[str], Callable[[], int]]]:
    """Iterator of lines until a signal, and a function that returns the signal's number (0: none).

    A signal takes effect between two lines. A second one ends the command at once.
    """
    reading, caught = False, 0

    def interrupt(number: int, *_: object) -> None:
        nonlocal caught
        caught = number
        signal.signal(number, signal.SIG_DFL)
        if reading:
            raise _Interrupt

    def until_signal() -> Iterator[str]:
        nonlocal reading
        source = iter(lines)
        with suppress(_Interrupt):
            while not caught:
                try:
                    reading = True
                    line = next(source, None)
                finally:
                    reading = False
                if line is None:
                    return
                yield line

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield until_signal(), lambda: caught
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


def _conclude(record: Path, vehicle: Path, assign: Sequence[str], allow_contradicted: bool, quiet: bool, no_color: bool) -> Judged:
    """Estimate and store the recording. Prints the table only on a terminal, because stdout belongs to another program."""
    from massprop_cli import job
    from massprop_cli.result import store

    judged = job.of_file(record, vehicle, assign, job.Demands(allow_contradicted=allow_contradicted))
    stored = store.write(record.parent, judged.analysis, escape.document(judged.result))
    say_stored(stored, None, quiet)
    warn(judged.analysis.notices, quiet)
    if not quiet and sys.stdout.isatty():
        show(judged.result, record.parent, no_color)
    return judged
