"""``massprop estimate``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from massprop_cli.cli import options
from massprop_cli.cli.guard import EXIT_NOT_CONVERGED, EXIT_NOT_EXPECTED, fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import progress, show, warn

if TYPE_CHECKING:
    from massprop_cli.analysis import Analysis


@guarded
def estimate(
    context: typer.Context,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Telemetry log, .parquet or .csv.", show_default=False)],
    vehicle: Annotated[Path | None, typer.Option(help="Vehicle file (TOML).", envvar="MASSPROP_VEHICLE", show_default=False)] = None,
    out: Annotated[
        Path | None, typer.Option(help="Result folder (default: massprop-out/LOGSTEM).", envvar="MASSPROP_OUT", show_default=False)
    ] = None,
    method: Annotated[options.Method | None, typer.Option(help="Estimator.", envvar="MASSPROP_METHOD", show_default=False)] = None,
    delay: Annotated[str | None, typer.Option(help="Command delay in cycles.", envvar="MASSPROP_DELAY", show_default=False)] = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Report the off-line maximum-likelihood fit instead of the last causal row.")
    ] = False,
    assign: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a dotted vehicle-file key.")] = None,
    require: Annotated[
        str | None, typer.Option(metavar="ixx,mass,...", help="Exit 4 unless these converge in every phase ('all').")
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
    not converged, 5 a value is missing or outside its expectation.
    """
    required = options.required(require)
    import numpy as np

    from massprop_cli import analysis, judge, store
    from massprop_cli import expect as expectations
    from massprop_cli.report import result

    folder_of_its_own(out)
    expected = expectations.load(expect) if expect is not None else None
    assignments = options.assignments(context, {"method": method, "refine": refine, "delay": delay}, assign)
    # what overflows or divides by zero ends as "nothing can be said", not as noise on stderr
    with progress(quiet or as_json) as told, np.errstate(all="ignore"):
        found = analysis.analyse(log, vehicle, assignments, told)
    judged = result.result(found)
    if expected is not None:
        judged = judge.judge(judged, expected)
    text = result.to_json(judged)
    store.write(out or Path("massprop-out") / log.stem, found, text)
    warn(found.notices, quiet)
    if as_json:
        sys.stdout.write(text)
    elif not quiet:
        show(judged, no_color)
    _check_required(found, required)
    missed = judge.missed(judged)
    if missed:
        fail(f"not as expected: {'; '.join(missed)}", EXIT_NOT_EXPECTED)


def _check_required(found: Analysis, required: list[str]) -> None:
    missed = [
        f"{name} in phase {conclusion.phase.name} is {conclusion.estimates[name].verdict} ({conclusion.estimates[name].reason})"
        for conclusion in found.conclusions
        for name in required
        if conclusion.estimates[name].verdict != "converged"
    ]
    if missed:
        fail(f"required but not converged: {'; '.join(missed)}", EXIT_NOT_CONVERGED)
