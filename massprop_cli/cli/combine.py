"""``massprop combine``."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from massprop_cli.base import escape
from massprop_cli.base.errors import UsageError
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import show, warn


@guarded
def combine(
    results: Annotated[
        list[Path] | None, typer.Argument(metavar="RESULT...", help="Result folders or their result.json.", show_default=False)
    ] = None,
    before: Annotated[
        list[Path] | None, options.option("Result of the vehicle alone; may be repeated.", options.INPUT, metavar="RESULT")
    ] = None,
    after: Annotated[
        list[Path] | None, options.option("Result of the vehicle with the docked object; may be repeated.", options.INPUT, metavar="RESULT")
    ] = None,
    added: Annotated[
        str | None,
        options.option(
            "Mass and position of the object (kg, m from O): sets the scale of all values.",
            options.INPUT,
            metavar='"mass=KG position=X,Y,Z"',
        ),
    ] = None,
    out: Annotated[Path | None, options.out("Folder (default: massprop-out/combined).")] = None,
    require: options.Require = None,
    allow_contradicted: options.AllowContradicted = False,
    as_json: Annotated[bool, options.as_json("result.json")] = False,
    quiet: Annotated[bool, options.quiet("No table, no warnings.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Combine results of several logs of one vehicle into a joint estimate, or estimate an object from logs before and after docking.

    The information of all logs adds up. The thrust scale and known values count once. massprop reports contradictions. Writes result.json
    and run.json. With --added, the object's known mass sets the scale of all values, whatever the stated thrust or wheels. Exit 3: the
    results are not of one vehicle; 4: a required quantity is not converged or not precise enough; 6: a quantity is contradicted.

    Examples:
        massprop combine run-1 run-2 --out joint
        massprop combine --before alone --after docked --out object
        massprop combine --before empty --after loaded --added "mass=0.5+-0.001 position=0.1,0,0.2+-0.001"
    """
    from massprop_cli.inputs.require import requirements

    required = requirements(require)
    folder_of_its_own(out)
    docked = bool(before or after)
    if docked and (results or not (before and after)):
        raise UsageError("name results alone, or those --before and those --after docking")
    if not docked and len(results or []) < 2:
        raise UsageError("name two results or more, or those --before and those --after docking")
    if added is not None and not docked:
        raise UsageError("--added: names the object between two logs; name those without it by --before and those with it by --after")
    import numpy as np

    from massprop_cli import job
    from massprop_cli.combine import flow
    from massprop_cli.result import read

    with np.errstate(all="ignore"):
        alone, joined, several = ([read.read(path) for path in paths or []] for paths in (before, after, results))
        found = flow.together_docked(alone, joined, added=added) if docked else flow.together(several)
    folder = out or Path("massprop-out") / "combined"
    flow.write(folder, found, [*(results or []), *(before or []), *(after or [])])
    warn(found.warnings, quiet, no_color)
    if as_json:
        sys.stdout.write(escape.document(found))
    elif not quiet:
        show(found, folder, no_color)
    unmet = job.unmet(found, job.Demands(required, allow_contradicted=allow_contradicted))
    if unmet.exit_code:
        fail(unmet.message, unmet.exit_code)
