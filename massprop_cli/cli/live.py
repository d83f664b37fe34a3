"""``massprop live``."""

import io
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated

from massprop_cli.base import escape, exits
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import say, show, told_of, warn


@guarded
def live(
    vehicle: options.NeededVehicle,
    out: Annotated[Path, options.out("Folder for the recording and its result.")],
    assign: options.Assign = None,
    quiet: Annotated[bool, options.quiet("No table, no warnings.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Estimate while records arrive on standard input (CSV or a JSON object on each line): a JSON line on standard output for each cycle.

    What comes is kept in record.csv, and in the end estimated as `massprop estimate` would: result.json, history.parquet, run.json.
    An interrupt (Ctrl-C) ends the recording, and where nobody reads the answers any more it goes on, so the result is there, too. A record
    that must be left out is told on one line of stderr. On a pedestal each line has inertia and first moment about it. Exit 3 where what
    comes can't be used, or no more of it.

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
    _concluded(out / RECORDED, vehicle, assign or [], quiet, no_color)
    if interrupted():
        fail("interrupted; the result is that of what had come", exits.INTERRUPTED)
    answers.check()


class _Answers:
    """Lines on standard output, as long as somebody takes them: a recording goes on without."""

    def __init__(self) -> None:
        self.failed: OSError | None = None

    def put(self, line: str) -> None:
        """One line, at once."""
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
    """SIGINT while a line is waited for."""


@contextmanager
def _until_interrupted(lines: Iterable[str]) -> Iterator[tuple[Iterator[str], Callable[[], bool]]]:
    """Lines until an interrupt, which comes between two of them, and whether one came; a second one ends the command at once."""
    reading = asked = False

    def interrupt(*_: object) -> None:
        nonlocal asked
        asked = True
        signal.signal(signal.SIGINT, signal.SIG_DFL)
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

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield each(), lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)


def _concluded(record: Path, vehicle: Path, assign: Sequence[str], quiet: bool, no_color: bool) -> None:
    """The recording's result; its table is for a terminal alone, since stdout is another program's."""
    from massprop_cli import job
    from massprop_cli.result import store

    judged = job.of_file(record, vehicle, assign)
    stored = store.write(record.parent, judged.analysis, escape.document(judged.result))
    told_of(stored, None, quiet)
    warn(judged.analysis.notices, quiet)
    if not quiet and sys.stdout.isatty():
        show(judged.result, record.parent, no_color)
