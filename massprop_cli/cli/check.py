"""``massprop check``."""

from typing import Annotated

import typer

from massprop_cli.cli import options
from massprop_cli.cli.guard import check_junit, fail, guarded, put_junit
from massprop_cli.cli.terminal import printed, progress


@guarded
def check(
    context: typer.Context,
    log: options.Log,
    vehicle: options.Vehicle = None,
    map_file: options.MapFile = None,
    want: Annotated[
        str | None,
        options.option(
            "Exit 4 unless these converge with this precision.", options.DEMANDS, "--want", "--require", metavar='"ixx 1 %, mass"'
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
    """Check a recording: sampling, IMU, commands, delay, attitude, vehicle file and excitation.

    Each finding has a place, a certainty and a remedy. Exit 0: done; 3: no estimate is possible; 4: a wanted precision is not reached; 6:
    log and vehicle file contradict each other.

    Examples:
        massprop check log.parquet
        massprop check log.parquet --want "mass<2%, ixx" --junit check.xml
    """
    from massprop_cli.inputs.require import requirements

    wants = requirements(want, "--want")
    check_junit(junit)
    assignments = options.assignments(context, {"delay": delay}, assign)
    from massprop_cli.check import flow, table

    with progress(quiet or as_json) as report:
        found = flow.check(log, vehicle, wants, assignments, report, map_file, allow_contradicted=allow_contradicted)
    if junit is not None:
        from massprop_cli.check import junit as suites

        put_junit(junit, suites.text(found))
    printed(found, table.show, as_json, quiet, no_color)
    if found.exit_code:
        fail(flow.message(found), found.exit_code)
