"""What goes to the terminal besides the data: progress, tables, warnings."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from massprop_cli.base import escape

if TYPE_CHECKING:
    from rich.console import Console

    from massprop_cli.inputs.tablefile import Made
    from massprop_cli.inputs.telemetry import Notice
    from massprop_cli.result.schema import Result
    from massprop_cli.result.store import Stored


def say(message: str) -> None:
    """One line on stderr. With :func:`put` the only way of foreign text to the terminal beside rich's tables."""
    typer.echo(f"massprop: {escape.message(message)}", err=True)


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
        yield lambda stage, done: bar.update(task, description=stage, completed=done)


def console(no_color: bool) -> Console:
    """On stdout; as wide as the widest table where that is no terminal."""
    from rich.console import Console

    return Console(no_color=no_color or None, width=None if sys.stdout.isatty() else 132, highlight=False)


def show(found: Result, no_color: bool) -> None:
    """The tables on stdout."""
    from massprop_cli.report import terminal

    terminal.show(found, console(no_color))


def warn(notices: Iterable[Notice], quiet: bool) -> None:
    """Warnings on stderr, one a line."""
    for notice in [] if quiet else notices:
        say(f"warning: {notice.message} [{notice.code}]")


def told_map(made: Made | None, quiet: bool) -> None:
    """What a map did to make the log, one a line on stderr."""
    for said in () if quiet or made is None else made.said:
        say(f"map: {said}")


def told_of(stored: Stored, expected: Path | None, quiet: bool) -> None:
    """On stderr, where a result went if not where it was ``expected``, and what became of an earlier result's pages."""
    said = [f"{expected} is taken; the result is in {stored.folder}"] if expected not in (None, stored.folder) else []
    pages = stored.pages
    if pages.removed:
        said.append(f"removed {', '.join(pages.removed)} of the earlier result; make them again with massprop report {stored.folder}")
    if pages.left:
        said.append(f"warning: {', '.join(pages.left)} in {stored.folder} may tell of another result than result.json beside it")
    for line in [] if quiet else said:
        say(line)
