"""Terminal output besides data: progress, tables, warnings."""

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
    from massprop_cli.campaign.run import LogDone, OnLogDone
    from massprop_cli.inputs.notice import Notice
    from massprop_cli.inputs.tablefile import MapConversion
    from massprop_cli.result.schema import Result, WarningItem
    from massprop_cli.result.store import StoredResult


def say(message: str, colour: str | None = None) -> None:
    """Print one line on stderr. Only this function, :func:`put` and rich tables print text from files."""
    text = f"massprop: {escape.message(message)}"
    typer.echo(typer.style(text, fg=colour) if colour and _coloured() else text, err=True)


def _coloured() -> bool:
    """Whether stderr is a terminal with colours enabled."""
    return sys.stderr.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def put(text: str) -> None:
    """Print a path or a line for another program on stdout."""
    typer.echo(escape.name(text))


@contextmanager
def progress(silent: bool) -> Iterator[Callable[[str, float], None] | None]:
    """Show a progress bar on stderr during the block, on a terminal only."""
    if silent or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, done: bar.update(task, description=escape.rich(stage), completed=done)


def console(no_color: bool) -> Console:
    """Console on stdout; 132 columns if stdout is not a terminal."""
    from rich.console import Console

    return Console(no_color=no_color or None, width=None if sys.stdout.isatty() else 132, highlight=False, emoji=False)


def printed(result: BaseModel, table: Callable[[Any, Console], None], as_json: bool, quiet: bool, no_color: bool) -> None:
    """Print a result on stdout, as JSON or as a table."""
    if as_json:
        sys.stdout.write(escape.document(result))
    elif not quiet:
        table(result, console(no_color))


def show(result: Result, folder: Path, no_color: bool) -> None:
    """Print a result's tables on stdout, its folder and the next command."""
    from massprop_cli.report import terminal

    terminal.show(result, console(no_color))
    typer.echo()
    put(f"Written to {folder}. To see it: massprop report {shlex.quote(str(folder))} --open")


def warn(notices: Iterable[Notice | WarningItem], quiet: bool, no_color: bool = False) -> None:
    """Print warnings on stderr, one per line."""
    for notice in [] if quiet else notices:
        say(f"warning: {notice.message} [{notice.code}]", None if no_color else "yellow")


def say_map(made: MapConversion | None, quiet: bool) -> None:
    """Print the conversions by a map on stderr, one per line."""
    for line in () if quiet or made is None else made.conversions:
        say(f"map: {line}")


def say_stored(stored: StoredResult, expected: Path | None, quiet: bool) -> None:
    """Print on stderr the result's folder if it is not the ``expected`` one, and what happened to an earlier result's pages."""
    lines = [f"{expected} is taken; the result is in {stored.folder}"] if expected not in (None, stored.folder) else []
    pages = stored.pages
    if pages.removed:
        lines.append(f"removed {', '.join(pages.removed)} of the earlier result; make them again with massprop report {stored.folder}")
    if pages.left:
        lines.append(f"warning: {', '.join(pages.left)} in {stored.folder} may belong to another result than result.json there")
    for line in [] if quiet else lines:
        say(line)


@contextmanager
def steps(jobs: Sequence[Job], quiet: bool) -> Iterator[OnLogDone | None]:
    """Progress of a campaign: a function to call after each log; None if ``quiet``."""
    if quiet:
        yield None
        return
    lines = _Lines(jobs)
    if not sys.stderr.isatty():
        yield lines.on_done
        lines.rest()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(compact=True))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("logs", total=len(jobs))
        failed = 0

        def on_done(step: LogDone) -> None:
            nonlocal failed
            failed += bool(step.outcome.exit_code)
            bar.update(task, advance=1, description=f"logs, {failed} failed" if failed else "logs")
            if step.outcome.exit_code:
                lines.say(step)

        yield on_done


class _Lines:
    """Lines for the logs of a campaign, in their order: a log that finishes early waits for those before it."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._jobs = jobs
        self._next = 0
        self._waiting: dict[int, LogDone] = {}

    def on_done(self, step: LogDone) -> None:
        self._waiting[step.index] = step
        while self._next in self._waiting:
            self.say(self._waiting.pop(self._next))
            self._next += 1

    def rest(self) -> None:
        """Print the logs that still wait, after --fail-fast."""
        for _, step in sorted(self._waiting.items()):
            self.say(step)

    def say(self, step: LogDone) -> None:
        from massprop_cli.campaign.outcome import state

        job, result = self._jobs[step.index], step.outcome
        doubts = f" ({', '.join(dict.fromkeys(result.warnings))})" if result.warnings else ""
        what = f"exit {result.exit_code}: {result.message}" if result.exit_code else f"{state(result)}{doubts}"
        kept = ", unchanged" if step.kept else ""
        say(f"[{step.index + 1}/{len(self._jobs)}] {job.name}{kept}: {what}")
