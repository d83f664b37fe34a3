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
from massprop_cli.cli.terminal import say, show, told_of, warn

if TYPE_CHECKING:
    from massprop_cli.job import Judged


@guarded
def live(
    vehicle: options.NeededVehicle,
    out: Annotated[Path, options.out("Folder for the recording and its result.")],
    assign: options.Assign = None,
    allow_contradicted: options.AllowContradicted = False,
    quiet: Annotated[bool, options.quiet("No table, no warnings.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Estimate while records arrive on standard input (CSV or a JSON object on each line): a JSON line on standard output for each cycle.

    What comes is kept in record.csv, and in the end estimated as `massprop estimate` would: result.json, history.parquet, run.json.
    An interrupt (Ctrl-C, or SIGTERM) ends the recording, and where nobody reads the answers any more it goes on, so the result is there,
    too. A record that must be left out is told on one line of stderr, and so is a gap after which no values can come; the recording goes
    on. On a pedestal each line has inertia and first moment about it. Exit 3 where what comes can't be used, 6 where the recording
    contradicts the vehicle file.

    Examples:
        massprop live --vehicle vehicle.toml --out flight < log.csv
    """
    folder_of_its_own(out)
    from massprop_cli.inputs import vehiclefile
    from massprop_cli.live import records, run
    from massprop_cli.live.run import RECORDED, recording

    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(encoding="utf-8-sig", errors="replace")  # what is not text makes a bad record, not an end
    source = vehiclefile.load(vehicle, assign or [])
    answers = _Answers()
    with _until_interrupted(records.lines_of(sys.stdin)) as (lines, interrupted), recording(out) as keep:
        for line in run.follow(lines, source, keep, say):
            answers.put(line)
    judged = _concluded(out / RECORDED, vehicle, assign or [], allow_contradicted, quiet, no_color)
    if number := interrupted():
        fail("interrupted; the result uses the data until then", exits.SIGNALLED + number)
    answers.check()
    if judged.exit_code:
        fail(judged.message, judged.exit_code)


class _Answers:
    """Lines on standard output, as long as somebody takes them: a recording goes on without."""

    def __init__(self) -> None:
        self.failed: OSError | None = None

    def put(self, line: str) -> None:
        """Write one line at once."""
        if self.failed is None:
            try:
                sys.stdout.write(f"{line}\n")
                sys.stdout.flush()
            except OSError as error:
                self.failed = error

    def check(self) -> None:
        """Raise what kept a line from being written."""
        if self.failed is not None:
            raise self.failed


class _Interrupt(Exception):  # noqa: N818
    """A signal while a line is waited for."""


@contextmanager
def _until_interrupted(lines: Iterable[str]) -> Iterator[tuple[Iterator[str], Callable[[], int]]]:
    """Lines until an interrupt, which comes between two of them, and the number of the signal that came, or 0.

    A second one ends the command at once.
    """
    reading, asked = False, 0

    def interrupt(number: int, *_: object) -> None:
        nonlocal asked
        asked = number
        signal.signal(number, signal.SIG_DFL)
        if reading:
            raise _Interrupt

    def each() -> Iterator[str]:
        nonlocal reading
        source = iter(lines)
        with suppress(_Interrupt):
            while not asked:
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
        yield each(), lambda: asked
    finally:
        for number, own in before.items():
            signal.signal(number, own)


def _concluded(record: Path, vehicle: Path, assign: Sequence[str], allow_contradicted: bool, quiet: bool, no_color: bool) -> Judged:
    """The recording's result; its table is for a terminal alone, since stdout is another program's."""
    from massprop_cli import job
    from massprop_cli.result import store

    judged = job.of_file(record, vehicle, assign, job.Demands(allow_contradicted=allow_contradicted))
    stored = store.write(record.parent, judged.analysis, escape.document(judged.result))
    told_of(stored, None, quiet)
    warn(judged.analysis.notices, quiet)
    if not quiet and sys.stdout.isatty():
        show(judged.result, record.parent, no_color)
    return judged
