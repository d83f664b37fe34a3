"""Command line: one module per command. Commands import heavy packages themselves, so that ``--help`` is fast."""

import gc
import io
import os
import signal
import sys
from contextlib import suppress
from importlib import import_module
from typing import Annotated, Any

import typer

from massprop_cli import __version__
from massprop_cli.base import exits, onethread
from massprop_cli.cli.help import Command, DocstringGroup, docstring_of, epilog
from massprop_cli.cli.terminal import say

onethread.prefer()
_Misread: Any = typer.BadParameter.__mro__[1]
"""Exception that typer raises for a wrong command line; its base class depends on typer's version."""

NAME = "massprop"
_PANELS = {
    "One log": ("estimate", "report", "compare", "predict"),
    "On board and live": ("export-flight", "live"),
    "Many logs": ("batch", "combine"),
    "Another program's recording": ("columns", "init"),
    "Before and after a test": ("plan", "simulate", "check", "balance"),
    "Files": ("schema",),
}
"""Commands by help panel; each is a function with the command's name, in a module of that name."""


def _version(value: bool) -> None:
    if value:
        typer.echo(f"massprop {__version__}")
        raise typer.Exit


def _main(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False) -> None:
    """Mass properties of a vehicle, with honest sigmas, from recorded commands and IMU data."""


def application(only: str | None = None) -> typer.Typer:
    """Make the application: all commands, or only the command ``only`` if it exists, so that the others are not imported."""
    found = typer.Typer(
        name=NAME,
        help="Mass properties of a vehicle, with honest sigmas, from recorded commands and IMU data.",
        no_args_is_help=True,
        cls=DocstringGroup,
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
    )
    found.callback()(_main)
    panels = {name: panel for panel, names in _PANELS.items() for name in names}
    for name, panel in panels.items():
        if only in (None, name) or only not in panels:
            called = name.replace("-", "_")
            command = getattr(import_module(f"massprop_cli.cli.{called}"), called)
            docstring = docstring_of(command)
            found.command(name, cls=Command, help=docstring.text, epilog=epilog(docstring), rich_help_panel=panel)(command)
    return found


app: typer.Typer


def __getattr__(name: str) -> Any:
    """Make ``app`` (:func:`application` with all commands) on first access."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()["app"] = whole = application()
    return whole


def main() -> None:
    """Entry point."""
    _open_streams()
    # a library may swallow an exception inside its callback; the next run cleans up what an immediate end leaves
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        code = _run()
        sys.stdout.flush()
        sys.stderr.flush()
    except BrokenPipeError:
        code = exits.PIPE
    except OSError as error:
        code = _fail(f"the output cannot be written ({error.strerror or error}); is the disk full?", exits.INPUT)
    _leave(code)


def _run() -> int:
    """Run the command and return its exit code; a wrong command line prints one line."""
    try:
        code: Any = application(next(iter(sys.argv[1:]), None))(standalone_mode=False)
        return int(code or 0)
    except KeyboardInterrupt:
        return _fail("interrupted", exits.INTERRUPTED)
    except SystemExit as stop:
        # typer and rich exit with 1 on a closed pipe; massprop exits by typer.Exit
        return exits.PIPE if stop.code == exits.BUG else int(stop.code or 0)
    except _Misread as error:
        command = error.ctx.command_path if error.ctx is not None else NAME
        message = error.format_message()
        # without arguments typer has shown the help already
        return _fail(f"{message} See {command} --help", exits.USAGE) if message else exits.USAGE


def _fail(message: str, code: int) -> int:
    with suppress(OSError):
        say(message)
    return code


def _open_streams() -> None:
    """Open /dev/null for closed standard streams, because the next opened file would take their descriptors."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, open(descriptor, "w" if descriptor else "r", encoding="utf-8", closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ² or ± still shows the table


def _leave(code: int) -> None:
    """Exit with ``code``; discard output that nobody reads, because Python would exit with 120 for it."""
    for descriptor, stream in ((1, sys.stdout), (2, sys.stderr)):
        try:
            stream.flush()
        except (OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, descriptor)
            os.close(nowhere)
    gc.freeze()  # the process ends here, and a last garbage collection would take a tenth of a short run
    sys.exit(code)
