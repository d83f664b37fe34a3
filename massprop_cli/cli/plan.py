"""``massprop plan``."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from massprop_cli.base import escape, exits
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import console, progress, put

_LIMITS = "Limits of the motion"


class _Criterion(StrEnum):
    worst = "worst"
    a = "a"
    d = "d"


@guarded
def plan(
    vehicle: Annotated[
        Path,
        typer.Option(
            help="Vehicle file (TOML).", envvar="MASSPROP_VEHICLE", show_default=False, metavar="FILE", rich_help_panel=options.INPUT
        ),
    ],
    want: Annotated[
        str,
        typer.Option(metavar='"ixx 1 %, mass 2 %"', help="Sigmas that are wanted.", show_default=False, rich_help_panel=options.DEMANDS),
    ],
    guess: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What the vehicle may be (TOML; default: the vehicle file's \\[nominal]).",
            show_default=False,
            rich_help_panel=options.INPUT,
        ),
    ] = None,
    max_time: Annotated[float, typer.Option(min=1e-3, max=1e5, help="Longest plan, s.", metavar="S", rich_help_panel=_LIMITS)] = 60.0,
    max_impulse: Annotated[
        float | None,
        typer.Option(min=1e-9, help="Most that all jets may give, N s.", show_default=False, metavar="N_S", rich_help_panel=_LIMITS),
    ] = None,
    max_rate: Annotated[
        float | None, typer.Option(min=1e-9, help="Fastest body rate, rad/s.", show_default=False, metavar="RAD_S", rich_help_panel=_LIMITS)
    ] = None,
    max_tilt: Annotated[
        float | None,
        typer.Option(
            min=1e-9, help="Farthest from the vertical at the start, rad.", show_default=False, metavar="RAD", rich_help_panel=_LIMITS
        ),
    ] = None,
    max_travel: Annotated[
        float | None,
        typer.Option(min=1e-9, help="Farthest from the place at the start, m.", show_default=False, metavar="M", rich_help_panel=_LIMITS),
    ] = None,
    without: Annotated[
        str | None, typer.Option(metavar="JET,...", help="Jets that are off.", show_default=False, rich_help_panel=_LIMITS)
    ] = None,
    criterion: Annotated[
        _Criterion,
        typer.Option(
            help="Make the worst ratio small, the mean square (a), or the volume of the ellipsoid (d).", rich_help_panel=options.SETTINGS
        ),
    ] = _Criterion.worst,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder (default: massprop-out/FOLDER-STEM-plan).",
            envvar="MASSPROP_OUT",
            show_default=False,
            metavar="FOLDER",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    assign: options.Assign = None,
    as_json: Annotated[bool, options.as_json("plan.json")] = False,
    quiet: Annotated[bool, options.quiet("No table.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Choose the motions that tell what is wanted, in the shortest time and within the limits.

    Writes scenario.toml, which massprop simulate flies, plan.json and plan.html. Exit 0 if every precision is reached with every body that
    the vehicle may be, 3 where there is nothing to plan with or no motion keeps the limits, 4 where one isn't reached: the best is written.

    Examples:
        massprop plan --vehicle vehicle.toml --want "ixx 1 %, mass 2 %" --guess guess.toml
        massprop plan --vehicle vehicle.toml --want "cg_z 0.5 mm" --guess guess.toml --max-time 20 --max-rate 0.5
    """
    from massprop_cli.inputs.require import precise

    wants = precise(want)
    folder_of_its_own(out)
    import numpy as np

    from massprop_cli.base import files
    from massprop_cli.plan import flow, page
    from massprop_cli.plan.choose import Criterion

    folder = out or flow.default_folder(vehicle)
    files.check_own(folder, ("scenario.toml",), "plan.json")
    off = tuple(name.strip() for name in without.split(",")) if without else ()
    asked = flow.Asked(wants, max_time, Criterion(criterion.value), max_impulse, max_rate, max_tilt, max_travel, off)
    with progress(quiet or as_json) as told, np.errstate(all="ignore"):
        made = flow.make(vehicle, guess, asked, told or (lambda *_: None), tuple(assign or []))
    flow.write(made, folder, {"plan.html": page.text(made.plan)})
    if as_json:
        sys.stdout.write(escape.document(made.plan))
    elif not quiet:
        from massprop_cli.plan import table

        table.show(made.plan, console(no_color))
        put(str(folder / "scenario.toml"))
    if made.exit_code:
        fail(f"not reached: {made.plan.limited_by}", exits.NOT_CONVERGED)
