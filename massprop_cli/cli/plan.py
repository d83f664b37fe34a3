"""``massprop plan``."""

from pathlib import Path
from typing import Annotated, Literal

from massprop_cli.base import exits, foldername
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import printed, progress, put

_LIMITS = "Limits of the motion"


@guarded
def plan(
    vehicle: options.RequiredVehicle,
    want: Annotated[str, options.option("Wanted precision.", options.DEMANDS, metavar='"ixx 1 %, mass 2 %"')],
    guess: Annotated[
        Path | None,
        options.option("Guess of the mass properties (TOML; default: the vehicle file's \\[nominal]).", options.INPUT, metavar="FILE"),
    ] = None,
    max_time: Annotated[float, options.option("Longest plan, s.", _LIMITS, min=1e-3, max=1e5, metavar="S")] = 60.0,
    max_impulse: Annotated[
        float | None, options.option("Largest total impulse of the jets, N s.", _LIMITS, min=1e-9, metavar="N_S")
    ] = None,
    max_rate: Annotated[float | None, options.option("Largest body rate, rad/s.", _LIMITS, min=1e-9, metavar="RAD_S")] = None,
    max_tilt: Annotated[
        float | None, options.option("Largest tilt from the vertical at the start, rad.", _LIMITS, min=1e-9, metavar="RAD")
    ] = None,
    max_travel: Annotated[float | None, options.option("Largest distance from the start, m.", _LIMITS, min=1e-9, metavar="M")] = None,
    max_wheel_speed: Annotated[float | None, options.option("Largest wheel speed, rad/s.", _LIMITS, min=1e-9, metavar="RAD_S")] = None,
    without: Annotated[str | None, options.option("Jets not to use.", _LIMITS, metavar="JET,...")] = None,
    criterion: Annotated[
        Literal["worst", "a", "d"],
        options.option("Minimise the worst ratio, the mean square (a), or the volume of the ellipsoid (d).", options.SETTINGS),
    ] = "worst",
    out: Annotated[
        Path | None,
        options.out("Folder (default: massprop-out/FOLDER-STEM-plan)."),
    ] = None,
    assign: options.Assign = None,
    as_json: Annotated[bool, options.as_json("plan.json")] = False,
    quiet: Annotated[bool, options.quiet("No table.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Design motions that reach a wanted precision in the shortest time and within limits.

    Writes scenario.toml (for massprop simulate), plan.json and plan.html. Exit 0: every precision is reached for every body that the
    vehicle may be; 3: there is nothing to plan with, or no motion keeps the limits; 4: a precision is not reached, and the best plan is
    written.

    Examples:
        massprop plan --vehicle vehicle.toml --want "ixx 1 %, mass 2 %" --guess guess.toml
        massprop plan --vehicle vehicle.toml --want "cg_z 0.5 mm" --guess guess.toml --max-time 20 --max-rate 0.5
    """
    from massprop_cli.inputs.require import precise

    wants = precise(want)
    folder_of_its_own(out)
    import numpy as np

    from massprop_cli.base import files
    from massprop_cli.plan import flow, page, table

    folder = out or Path("massprop-out") / foldername.safe(f"{vehicle.parent.resolve().name}-{vehicle.stem}-plan")
    files.check_own(folder, ("scenario.toml",), "plan.json")
    off = tuple(name.strip() for name in without.split(",")) if without else ()
    limits = {
        "impulse_n_s": max_impulse,
        "rate_rad_s": max_rate,
        "tilt_rad": max_tilt,
        "travel_m": max_travel,
        "wheel_rad_s": max_wheel_speed,
    }
    asked = flow.PlanRequest(wants, max_time, criterion, {key: value for key, value in limits.items() if value is not None}, off)
    with progress(quiet or as_json) as report, np.errstate(all="ignore"):
        made = flow.make(vehicle, guess, asked, report or (lambda *_: None), tuple(assign or []))
    flow.write(made, folder, {"plan.html": page.text(made.plan)})
    printed(made.plan, table.show, as_json, quiet, no_color)
    if not (as_json or quiet):
        put(str(folder / "scenario.toml"))
    if made.exit_code:
        fail(f"not reached: {made.plan.limited_by}", exits.NOT_CONVERGED)
