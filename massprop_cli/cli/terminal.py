"""What goes to the terminal besides the data: progress (of a campaign a line per log), tables, warnings."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from massprop_cli.base import escape

if TYPE_CHECKING:
    from pydantic import BaseModel
    from rich.console import Console

    from massprop_cli.campaign.plan import Job
    from massprop_cli.campaign.run import LogDone, Told
    from massprop_cli.inputs.notice import Notice
    from massprop_cli.inputs.tablefile import Made
    from massprop_cli.result.schema import Result, WarningItem
    from massprop_cli.result.store import StoredResult


def say(message: str, colour: str | None = None) -> None:
    """Write one line to stderr. Only this, :func:`put` and rich's tables write foreign text to the terminal."""
    text = f"massprop: {escape.message(message)}"
    typer.echo(typer.style(text, fg=colour) if colour and _coloured() else text, err=True)


def _coloured() -> bool:
    """Whether stderr is a terminal that has colours and is to have them."""
    return sys.stderr.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def put(text: str) -> None:
    """A path, or a line for another program, on stdout."""
    typer.echo(escape.name(text))


@contextmanager
def progress(silent: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A bar on stderr while the block runs, on a terminal only; it goes away when done."""
    if silent or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, done: bar.update(task, description=escape.rich(stage), completed=done)


def console(no_color: bool) -> Console:
    """On stdout; as wide as the widest table where that is no terminal."""
    from rich.console import Console

    return Console(no_color=no_color or None, width=None if sys.stdout.isatty() else 132, highlight=False, emoji=False)


def printed(found: BaseModel, table: Callable[[Any, Console], None], as_json: bool, quiet: bool, no_color: bool) -> None:
    """Print a command's result on stdout: as JSON, or as its table."""
    if as_json:
        sys.stdout.write(escape.document(found))
    elif not quiet:
        table(found, console(no_color))


def show(found: Result, folder: Path, no_color: bool) -> None:
    """The tables on stdout, where all of it was written, and what to do next."""
    from massprop_cli.report import terminal

    terminal.show(found, console(no_color))
    typer.echo()
    put(f"Written to {folder}. To see it: massprop report {shlex.quote(str(folder))} --open")


def warn(notices: Iterable[Notice | WarningItem], quiet: bool, no_color: bool = False) -> None:
    """Warnings on stderr, one a line."""
    for notice in [] if quiet else notices:
        say(f"warning: {notice.message} [{notice.code}]", None if no_color else "yellow")


def told_map(made: Made | None, quiet: bool) -> None:
    """Print what a map did to make the log, one line each, on stderr."""
    for said in () if quiet or made is None else made.said:
        say(f"map: {said}")


def told_of(stored: StoredResult, expected: Path | None, quiet: bool) -> None:
    """On stderr, where a result went if not where it was ``expected``, and what became of an earlier result's pages."""
    said = [f"{expected} is taken; the result is in {stored.folder}"] if expected not in (None, stored.folder) else []
    pages = stored.pages
    if pages.removed:
        said.append(f"removed {', '.join(pages.removed)} of the earlier result; make them again with massprop report {stored.folder}")
    if pages.left:
        said.append(f"warning: {', '.join(pages.left)} in {stored.folder} may belong to another result than result.json there")
    for line in [] if quiet else said:
        say(line)


@contextmanager
def steps(jobs: Sequence[Job], quiet: bool) -> Iterator[Told | None]:
    """Hears of each log; silent if ``quiet``."""
    if quiet:
        yield None
        return
    lines = _Lines(jobs)
    if not sys.stderr.isatty():
        yield lines.told
        lines.rest()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(compact=True))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("logs", total=len(jobs))
        failed = 0

        def told(step: LogDone) -> None:
            nonlocal failed
            failed += bool(step.outcome.exit_code)
            bar.update(task, advance=1, description=f"logs, {failed} failed" if failed else "logs")
            if step.outcome.exit_code:
                lines.say(step)

        yield told


class _Lines:
    """One line per log, in the order of the logs: a log that is done early waits for those before it."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._jobs = jobs
        self._next = 0
        self._waiting: dict[int, LogDone] = {}

    def told(self, step: LogDone) -> None:
        self._waiting[step.index] = step
        while self._next in self._waiting:
            self.say(self._waiting.pop(self._next))
            self._next += 1

    def rest(self) -> None:
        """Print logs that still wait, after --fail-fast."""
        for _, step in sorted(self._waiting.items()):
            self.say(step)

    def say(self, step: LogDone) -> None:
        from massprop_cli.campaign.outcome import state

        job, found = self._jobs[step.index], step.outcome
        doubts = f" ({', '.join(dict.fromkeys(found.warnings))})" if found.warnings else ""
        what = f"exit {found.exit_code}: {found.message}" if found.exit_code else f"{state(found)}{doubts}"
        kept = ", unchanged" if step.kept else ""
        say(f"[{step.index + 1}/{len(self._jobs)}] {job.name}{kept}: {what}")
