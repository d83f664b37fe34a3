"""``massprop balance``."""

from pathlib import Path
from typing import Annotated

from massprop_cli.base import exits
from massprop_cli.base.errors import UsageError
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, guarded
from massprop_cli.cli.terminal import printed


@guarded
def balance(
    result: options.ResultPath,
    ballast: Annotated[
        Path | None,
        options.option("Ballast or vehicle file with [\\[ballast]] (default: ballast of RESULT).", options.INPUT, metavar="FILE"),
    ] = None,
    after: Annotated[Path | None, options.option("Result of a log after the moves, to test them.", options.INPUT, metavar="RESULT")] = None,
    moved: Annotated[
        list[str] | None,
        options.option("Changes between the logs: mm, or g added (default: as recommended).", options.INPUT, metavar="NAME=MM"),
    ] = None,
    phase: Annotated[str | None, options.option("Phase of the result.", options.INPUT, metavar="NAME")] = None,
    leave: Annotated[
        str | None, options.option("Wanted remaining first moment, with units.", options.DEMANDS, metavar="x=0,y=0,z=...")
    ] = None,
    allow_contradicted: options.AllowContradicted = False,
    as_json: Annotated[bool, options.as_json("all of it as JSON")] = False,
    quiet: Annotated[bool, options.quiet("No table.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Recommend moves or added weights that balance a table on a fixed pedestal; test whether earlier moves had the predicted effect.

    Writes nothing. Exit 0: the remaining first moment is reached and a check passes; 3: the result has no first moment about a pivot; 5:
    the ballast cannot reach it, or the first moment did not change as predicted; 6: a value is contradicted.

    Examples:
        massprop balance before --ballast ballast.toml
        massprop balance before --ballast ballast.toml --leave "z=-500 g cm"
        massprop balance before --ballast ballast.toml --after after --moved x=-8 --moved y=4
    """
    if moved and after is None:
        raise UsageError("--moved: states what was moved before a second log; name its result with --after")
    from massprop_cli.balance import flow, stated, table
    from massprop_cli.result import read

    first = read.read(result)
    weights = stated.ballast(ballast, first)
    later = read.read(after) if after is not None else None
    texts = [item for text in moved or [] for item in text.split(",")]
    found = flow.balance(first, weights, leave, phase, later, texts)
    printed(found, table.show, as_json, quiet, no_color)
    bad = (
        [] if allow_contradicted else [message for one in (first, later) if one is not None and (message := flow.contradicted(one, phase))]
    )
    if bad:
        fail("; ".join(bad), exits.CONTRADICTED)
    if missed := flow.failure(found):
        fail(missed, exits.NOT_EXPECTED)
