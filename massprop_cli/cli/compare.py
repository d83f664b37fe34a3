"""``massprop compare``."""

from pathlib import Path
from typing import Annotated

import typer

from massprop_cli.base import exits
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, guarded
from massprop_cli.cli.terminal import printed, say


@guarded
def compare(
    result: options.ResultPath,
    baseline: Annotated[Path, typer.Argument(metavar="BASELINE", help="Result to compare with.", show_default=False)],
    max_sigma: Annotated[float, options.option("Allowed difference, in sigmas.", options.DEMANDS, min=0, metavar="SIGMAS")] = 4.0,
    tolerance: Annotated[
        Path | None, options.option("Allowed difference by quantity (TOML or JSON).", options.DEMANDS, metavar="FILE")
    ] = None,
    as_json: Annotated[bool, options.as_json("the comparison as JSON")] = False,
    quiet: Annotated[bool, options.quiet("No table.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Compare a result with a baseline: differences in units and sigmas, for regression tests.

    Writes nothing. Exit 0: every difference is within --max-sigma or the tolerance file; 3: the results cannot be compared; 5: a difference
    is beyond the limit, a value of the baseline is missing, or no quantity has a value in both.

    Examples:
        massprop compare massprop-out/log baseline/log
        massprop compare massprop-out/log baseline/log --max-sigma 3
    """
    options.check_sigmas(max_sigma)
    from massprop_cli.inputs import tolerancefile
    from massprop_cli.report import difference
    from massprop_cli.result import compare as comparison
    from massprop_cli.result import read

    allowed = tolerancefile.load(tolerance, max_sigma)
    found = comparison.compare(read.read(result), read.read(baseline), allowed)
    printed(found, difference.show, as_json, quiet, no_color)
    failure = comparison.failure(found)
    for warning in [] if quiet or not found.compared else found.warnings:
        say(f"warning: {warning}")
    if failure:
        fail(failure, exits.NOT_EXPECTED)
