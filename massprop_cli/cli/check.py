"""``massprop check``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from massprop_cli.base import escape
from massprop_cli.base.errors import InputError
from massprop_cli.cli import options
from massprop_cli.cli.guard import check_junit, fail, guarded
from massprop_cli.cli.terminal import console, progress

if TYPE_CHECKING:
    from massprop_cli.check.finding import Check


@guarded
def check(
    context: typer.Context,
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="Telemetry log, .parquet or .csv, or another recording with a map.", show_default=False)
    ],
    vehicle: options.Vehicle = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", help="Map file (TOML) of another recording.", envvar="MASSPROP_MAP", show_default=False),
    ] = None,
    want: Annotated[
        str | None,
        typer.Option(
            "--want",
            "--require",
            metavar='"ixx 1 %, mass"',
            help="Exit 4 unless these converge, and that precisely.",
            show_default=False,
            rich_help_panel=options.DEMANDS,
        ),
    ] = None,
    allow_contradicted: options.AllowContradicted = False,
    delay: options.Delay = None,
    assign: options.Assign = None,
    junit: options.Junit = None,
    as_json: Annotated[bool, options.as_json("the check as JSON")] = False,
    quiet: Annotated[bool, options.quiet("No table.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Say whether a recording is good: sampling, IMU, commands, delay, attitude, the vehicle file, and what the motion tells.

    Each finding says what, where, how sure and what to do. Exit 0 done, 3 where no estimate can be made of it, 6 where log and
    vehicle file contradict each other, 4 where a wanted quantity is not reached.

    Examples:
        massprop check log.parquet
        massprop check log.parquet --want "mass<2%, ixx" --junit check.xml
    """
    from massprop_cli.inputs.require import requirements

    wants = requirements(want, "--want")
    check_junit(junit)
    assignments = options.assignments(context, {"delay": delay}, assign)
    from massprop_cli.check import flow

    with progress(quiet or as_json) as told:
        found = flow.check(log, vehicle, wants, assignments, told, map_file, allow_contradicted=allow_contradicted)
    if junit is not None:
        _write(junit, found)
    if as_json:
        sys.stdout.write(escape.document(found))
    elif not quiet:
        from massprop_cli.check import table

        table.show(found, console(no_color))
    if found.exit_code:
        fail(flow.message(found), found.exit_code)


def _write(file: Path, found: Check) -> None:
    from massprop_cli.base import files
    from massprop_cli.check import junit as suites

    try:
        with files.held(file.parent):
            files.text(file, suites.text(found))
    except OSError as error:
        raise InputError(f"{file}: cannot be written ({error.strerror or error}); choose another file with --junit") from None
