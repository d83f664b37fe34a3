"""``massprop estimate``."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from massprop_cli.base import escape
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import progress, say_map, say_stored, show, warn


@guarded
def estimate(
    context: typer.Context,
    log: options.Log,
    vehicle: options.Vehicle = None,
    map_file: options.MapFile = None,
    out: Annotated[Path | None, options.out("Result folder (default: massprop-out/LOGSTEM, or FOLDER-LOGSTEM if it exists).")] = None,
    method: options.Method = None,
    delay: options.Delay = None,
    refine: Annotated[
        bool, options.option("Report the off-line maximum-likelihood fit instead of the last causal row.", options.SETTINGS, "--refine")
    ] = False,
    cross_validate: Annotated[
        float | None,
        options.option(
            "Confidence level, such as 0.95: exit 5 unless the other segments predict each segment of a phase.",
            options.DEMANDS,
            metavar="LEVEL",
        ),
    ] = None,
    assign: options.Assign = None,
    require: options.Require = None,
    expect: options.Expect = None,
    allow_contradicted: options.AllowContradicted = False,
    as_json: Annotated[bool, options.as_json("result.json")] = False,
    quiet: Annotated[bool, options.quiet("No table, no warnings.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Estimate ten mass properties with sigmas and verdicts from a log.

    Writes result.json, history.parquet and run.json into the result folder. Exit 0: done; 3: unusable input; 4: a required quantity is not
    converged or not precise enough; 5: a value is missing or outside its expectation, or the other segments of the log do not predict a
    segment; 6: log and vehicle file contradict each other.

    Examples:
        massprop estimate log.parquet
        massprop estimate log.parquet --require "mass<2%, Ixx"
        massprop estimate log.parquet --delay auto --set imu.gyro_noise_rad_s=1e-4
        massprop estimate log.parquet --expect truth.json --json
        massprop estimate log.parquet --cross-validate 0.95
    """
    from massprop_cli.inputs.require import requirements

    required = requirements(require)
    folder_of_its_own(out)
    from massprop_cli import job
    from massprop_cli.inputs import expect as expectations
    from massprop_cli.result import store

    expected = None if expect is None else expectations.load(expect)
    demands = job.Demands(required, expected, allow_contradicted)
    assignments = options.assignments(
        context, {"method": method, "refine": refine, "delay": delay, "cross_validate": cross_validate}, assign
    )
    with progress(quiet or as_json) as report:
        judged = job.of_file(log, vehicle, assignments, demands, report, map_file)
    text = escape.document(judged.result)
    stored = store.write(out, judged.analysis, text)
    say_stored(stored, None if out is not None else store.plain(log), quiet)
    say_map(judged.analysis.log.made, quiet)
    warn(judged.analysis.notices, quiet, no_color)
    if as_json:
        sys.stdout.write(text)
    elif not quiet:
        show(judged.result, stored.folder, no_color)
    if judged.exit_code:
        fail(judged.message, judged.exit_code)
