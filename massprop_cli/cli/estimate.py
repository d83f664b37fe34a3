"""``massprop estimate``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import progress, show, told_map, told_of, warn

if TYPE_CHECKING:
    from massprop_cli.inputs.expect import Expectations


@guarded
def estimate(
    context: typer.Context,
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="Telemetry log, .parquet or .csv, or another recording with a map.", show_default=False)
    ],
    vehicle: Annotated[Path | None, typer.Option(help="Vehicle file (TOML).", envvar="MASSPROP_VEHICLE", show_default=False)] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", help="Map file (TOML) of another recording.", envvar="MASSPROP_MAP", show_default=False),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Result folder (default: massprop-out/LOGSTEM, or FOLDER-LOGSTEM where that is taken).",
            envvar="MASSPROP_OUT",
            show_default=False,
        ),
    ] = None,
    method: Annotated[options.Method | None, typer.Option(help="Estimator.", envvar="MASSPROP_METHOD", show_default=False)] = None,
    delay: Annotated[str | None, typer.Option(help="Command delay in cycles.", envvar="MASSPROP_DELAY", show_default=False)] = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Report the off-line maximum-likelihood fit instead of the last causal row.")
    ] = False,
    assign: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a dotted vehicle-file key.")] = None,
    require: Annotated[
        str | None, typer.Option(metavar="ixx,mass<2%,...", help="Exit 4 unless these converge in every phase ('all'), and that precisely.")
    ] = None,
    expect: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Expected values (TOML, JSON or a truth.json); exit 5 unless met.", show_default=False),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json on stdout and nothing else.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No table, no warnings.")] = False,
    no_color: Annotated[bool, typer.Option("--no-color", help="No colour (NO_COLOR works too).")] = False,
) -> None:
    """Replay the estimator through a log: ten mass properties with sigmas and verdicts.

    Writes result.json, history.parquet and run.json into the result folder. Exit 0 done, 3 unusable input, 4 a required quantity is
    not converged, or not that precise, 5 a value is missing or outside its expectation.
    """
    from massprop_cli.inputs.require import requirements

    required = requirements(require)
    folder_of_its_own(out)
    from massprop_cli import job
    from massprop_cli.result import schema, store

    demands = job.Demands(required, _expected(expect))
    assignments = options.assignments(context, {"method": method, "refine": refine, "delay": delay}, assign)
    with progress(quiet or as_json) as told:
        judged = job.of_file(log, vehicle, assignments, demands, told, map_file)
    text = schema.to_json(judged.result)
    stored = store.write(out, judged.analysis, text)
    told_of(stored, None if out is not None else store.plain(log), quiet)
    told_map(judged.analysis.log.made, quiet)
    warn(judged.analysis.notices, quiet)
    if as_json:
        sys.stdout.write(text)
    elif not quiet:
        show(judged.result, no_color)
    if judged.exit_code:
        fail(judged.message, judged.exit_code)


def _expected(file: Path | None) -> Expectations | None:
    if file is None:
        return None
    from massprop_cli.inputs import expect

    return expect.load(file)
