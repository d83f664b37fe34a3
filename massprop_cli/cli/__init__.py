"""Commands, one room each. Heavy rooms are imported inside the commands, so that ``--help`` stays fast."""

from __future__ import annotations

import io
import sys
from typing import Annotated

import typer

from massprop_cli import __version__, onethread
from massprop_cli.cli.batch import batch
from massprop_cli.cli.compare import compare
from massprop_cli.cli.estimate import estimate
from massprop_cli.cli.report import report
from massprop_cli.cli.schema import schema
from massprop_cli.cli.simulate import simulate

onethread.prefer()

app = typer.Typer(
    name="massprop",
    help="Mass properties of a vehicle, with honest sigmas, from recorded commands and IMU data.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for _command in (estimate, batch, report, compare, simulate, schema):
    app.command()(_command)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"massprop {__version__}")
        raise typer.Exit


@app.callback()
def _main(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False) -> None:
    """Mass properties of a vehicle, with honest sigmas, from recorded commands and IMU data."""


def main() -> None:
    """Entry point."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks ² or ± still gets its table
    app()
