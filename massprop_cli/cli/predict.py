"""``massprop predict``."""

from typing import Annotated

from massprop_cli.base import exits
from massprop_cli.base.errors import UsageError
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, guarded
from massprop_cli.cli.terminal import printed, progress, warn


@guarded
def predict(
    result: options.ResultPath,
    log: options.Log,
    vehicle: options.Vehicle = None,
    map_file: options.MapFile = None,
    phase: Annotated[str | None, options.option("Phase of result and log (default: the only one).", options.INPUT, metavar="NAME")] = None,
    assign: options.Assign = None,
    limit: Annotated[
        float, options.option("Confidence level of the test; a result passes if p is above 1 - LEVEL.", options.DEMANDS, metavar="LEVEL")
    ] = 0.95,
    allow_contradicted: options.AllowContradicted = False,
    as_json: Annotated[bool, options.as_json("all of it as JSON")] = False,
    quiet: Annotated[bool, options.quiet("No table, no warnings.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Test whether a result predicts another log, and how much of that log's motion its values explain.

    Writes nothing. Exit 0: it predicts the log; 3: no test is possible; 5: the motion differs from the prediction by more than the
    uncertainty of both; 6: a value of either is contradicted.

    Examples:
        massprop predict massprop-out/monday friday.parquet
        massprop predict massprop-out/monday friday.parquet --vehicle friday/vehicle.toml --limit 0.99 --json
    """
    if not 0 < limit < 1:
        raise UsageError(f"--limit {limit}: give a confidence level between 0 and 1, such as 0.95")
    from massprop_cli import job
    from massprop_cli.predict import flow, table
    from massprop_cli.result import read

    recorded = read.read(result)
    with progress(quiet or as_json) as report:
        judged = job.of_file(log, vehicle, assign or [], None, report, map_file)
    found = flow.predict(recorded, log, judged, phase, limit)
    warn(judged.analysis.notices, quiet, no_color)
    printed(found, table.show, as_json, quiet, no_color)
    used = (recorded.path, flow.chosen(recorded.path, recorded.result, phase)), (log, flow.chosen(log, judged.result, phase))
    bad = [] if allow_contradicted else [message for one in used if (message := flow.contradicted(*one))]
    if bad:
        fail("; ".join(bad), exits.CONTRADICTED)
    if missed := flow.failure(found):
        fail(missed, exits.NOT_EXPECTED)
