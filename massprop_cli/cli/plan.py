"""``massprop plan``."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from massprop_cli.base import exits
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import console, progress, put


class _Criterion(StrEnum):
    worst = "worst"
    a = "a"
    d = "d"


@guarded
def plan(
    vehicle: Annotated[Path, typer.Option(help="Vehicle file (TOML).", envvar="MASSPROP_VEHICLE", show_default=False)],
    want: Annotated[str, typer.Option(metavar='"ixx 1 %, mass 2 %"', help="Sigmas that are wanted.", show_default=False)],
    guess: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="What the vehicle may be (TOML; default: the vehicle file's [nominal]).", show_default=False),
    ] = None,
    max_time: Annotated[float, typer.Option(min=1e-3, max=1e5, help="Longest plan, s.")] = 60.0,
    max_impulse: Annotated[float | None, typer.Option(min=1e-9, help="Most that all jets may give, N s.", show_default=False)] = None,
    max_rate: Annotated[float | None, typer.Option(min=1e-9, help="Fastest body rate, rad/s.", show_default=False)] = None,
    max_tilt: Annotated[
        float | None, typer.Option(min=1e-9, help="Farthest from the vertical at the start, rad.", show_default=False)
    ] = None,
    max_travel: Annotated[float | None, typer.Option(min=1e-9, help="Farthest from the place at the start, m.", show_default=False)] = None,
    without: Annotated[str | None, typer.Option(metavar="JET,...", help="Jets that are off.", show_default=False)] = None,
    criterion: Annotated[
        _Criterion, typer.Option(help="Make the worst ratio small, the mean square (a), or the volume of the ellipsoid (d).")
    ] = _Criterion.worst,
    out: Annotated[
        Path | None, typer.Option(help="Folder (default: massprop-out/FOLDER-STEM-plan).", envvar="MASSPROP_OUT", show_default=False)
    ] = None,
    assign: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a dotted vehicle-file key.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print plan.json on stdout and nothing else.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No table.")] = False,
    no_color: Annotated[bool, typer.Option("--no-color", help="No colour (NO_COLOR works too).")] = False,
) -> None:
    """Choose the motions that tell what is wanted, in the shortest time and within the limits.

    Writes scenario.toml, which massprop simulate flies, plan.json and plan.html. Exit 0 if every precision is reached with every body that
    the vehicle may be, 3 where there is nothing to plan with or no motion keeps the limits, 4 where one isn't reached: the best is written.
    """
    from massprop_cli.inputs.require import precise

    wants = precise(want)
    folder_of_its_own(out)
    import numpy as np

    from massprop_cli.plan import document, flow, page
    from massprop_cli.plan.choose import Criterion

    off = tuple(name.strip() for name in without.split(",")) if without else ()
    asked = flow.Asked(wants, max_time, Criterion(criterion.value), max_impulse, max_rate, max_tilt, max_travel, off)
    with progress(quiet or as_json) as told, np.errstate(all="ignore"):
        made = flow.make(vehicle, guess, asked, told or (lambda *_: None), tuple(assign or []))
    folder = out or flow.default_folder(vehicle)
    flow.write(made, folder, {"plan.html": page.text(made.plan)})
    if as_json:
        sys.stdout.write(document.to_json(made.plan))
    elif not quiet:
        from massprop_cli.plan import table

        table.show(made.plan, console(no_color))
        put(str(folder / "scenario.toml"))
    if made.exit_code:
        fail(f"not reached: {made.plan.limited_by}", exits.NOT_CONVERGED)
