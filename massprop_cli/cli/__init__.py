"""Commands, one room each. Heavy rooms are imported inside the commands, so that ``--help`` stays fast."""

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
from massprop_cli.cli.help import Command, DocstringGroup, epilog, told
from massprop_cli.cli.terminal import say

onethread.prefer()
_Misread: Any = typer.BadParameter.__mro__[1]
"""What typer raises of a command line; older ones have it from click, newer ones of their own."""

NAME = "massprop"
_PANELS = {
    "One log": ("estimate", "report", "compare", "predict"),
    "On board and live": ("export-flight", "live"),
    "Many logs": ("batch", "combine"),
    "Another program's recording": ("columns", "init"),
    "Before and after a test": ("plan", "simulate", "check", "balance"),
    "Files": ("schema",),
}
"""Commands by their names; each is a function of its name in a module of its own."""


def _version(value: bool) -> None:
    if value:
        typer.echo(f"massprop {__version__}")
        raise typer.Exit


def _main(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False) -> None:
    """Mass properties of a vehicle, with honest sigmas, from recorded commands and IMU data."""


def application(only: str | None = None) -> typer.Typer:
    """All commands; or one alone, by the name that a shell gives it, where there is such a one: what isn't asked for isn't imported."""
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
            said = told(command)
            found.command(name, cls=Command, help=said.text, epilog=epilog(said), rich_help_panel=panel)(command)
    return found


app: typer.Typer


def __getattr__(name: str) -> Any:
    """``app`` is :func:`application` with all commands, made when it is asked for."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()["app"] = whole = application()
    return whole


def main() -> None:
    """Entry point."""
    _open_streams()
    # an exception in the middle of a library's callback may be swallowed; ended at once, a command leaves what the next run clears
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        code = _run()
        sys.stdout.flush()
        sys.stderr.flush()
    except BrokenPipeError:
        code = exits.PIPE
    except OSError as error:
        code = _told(f"the output cannot be written ({error.strerror or error}); is the disk full?", exits.INPUT)
    _leave(code)


def _run() -> int:
    """The exit code of the command; what can't be understood of a command line is told on one line, as everything else."""
    try:
        code: Any = application(next(iter(sys.argv[1:]), None))(standalone_mode=False)
        return int(code or 0)
    except KeyboardInterrupt:
        return _told("interrupted", exits.INTERRUPTED)
    except SystemExit as left:
        # typer and rich leave with 1 over a closed pipe; massprop itself leaves by typer.Exit
        return exits.PIPE if left.code == exits.BUG else int(left.code or 0)
    except _Misread as error:
        command = error.ctx.command_path if error.ctx is not None else NAME
        said = error.format_message()
        # without any argument the help has been shown already
        return _told(f"{said} See {command} --help", exits.USAGE) if said else exits.USAGE


def _told(message: str, code: int) -> int:
    with suppress(OSError):
        say(message)
    return code


def _open_streams() -> None:
    """A stream that was closed by whoever started us goes nowhere; else the next file that is opened would take its place."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, open(descriptor, "w" if descriptor else "r", encoding="utf-8", closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks ² or ± still gets its table


def _leave(code: int) -> None:
    """End with this code; what is left in a stream that nobody reads is dropped, as Python would end with 120 over it."""
    for descriptor, stream in ((1, sys.stdout), (2, sys.stderr)):
        try:
            stream.flush()
        except (OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, descriptor)
            os.close(nowhere)
    gc.freeze()  # all goes with the process: to look through it for rubbish a last time would take a tenth of a short run
    sys.exit(code)
