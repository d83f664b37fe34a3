"""``massprop simulate``."""

from pathlib import Path
from typing import Annotated

import typer

from massprop_cli.base.errors import UsageError
from massprop_cli.cli import options
from massprop_cli.cli.guard import folder_of_its_own, guarded
from massprop_cli.cli.terminal import progress, put, say, warn


@guarded
def simulate(
    scenario: Annotated[
        str | None, typer.Argument(metavar="SCENARIO", help="Scenario file (TOML) or a packaged scenario.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None,
        options.out("Folder (default: massprop-out/NAME-seed-N, or massprop-out/NAME)."),
    ] = None,
    seed: Annotated[int | None, options.option("Seed (default: seed of the scenario).", options.SETTINGS, min=0, metavar="N")] = None,
    seeds: Annotated[
        int | None,
        options.option(
            "Simulate this many seeds from --seed on, into a campaign folder.", options.SETTINGS, min=1, max=100_000, metavar="N"
        ),
    ] = None,
    csv: Annotated[bool, options.option("Write log.csv instead of log.parquet.", options.OUTPUT, "--csv")] = False,
    assign: Annotated[
        list[str] | None, options.option("Override a dotted scenario-file key.", options.SETTINGS, "--set", metavar="KEY=VALUE")
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="List the packaged scenarios.")] = False,
    quiet: Annotated[bool, options.quiet("Say nothing.")] = False,
) -> None:
    """Simulate a scenario: a log with known truth.

    Writes log.parquet (with embedded vehicle file), vehicle.toml and truth.json; with --seeds a folder of such folders. Equal seeds give
    equal bytes.

    Examples:
        massprop simulate --list
        massprop simulate refined --seed 3
        massprop simulate free-flyer --seeds 3 --out flights
    """
    import numpy as np

    from massprop_cli.live.estimator import OnboardEstimator
    from massprop_cli.testbed import output
    from massprop_cli.testbed import scenario as scenarios

    if list_:
        for name in scenarios.packaged():
            put(f"{name:22s}{scenarios.load(name).scenario.description}")
        return
    if scenario is None:
        raise UsageError("name a scenario file or a packaged scenario; massprop simulate --list names those")
    folder_of_its_own(out)
    source = scenarios.load(scenario, assign or [])
    first = source.scenario.seed if seed is None else seed
    with np.errstate(all="ignore"):
        notices = output.warnings(source)
    warn(notices, quiet)
    name = source.scenario.name
    folder = out or Path("massprop-out") / (f"{name}-seed-{first}" if seeds is None else name)
    with progress(quiet) as report, np.errstate(all="ignore"):
        written = output.simulate(source, folder, first, seeds, "csv" if csv else "parquet", report, OnboardEstimator)
    if not quiet:
        say(f"{written} written to {folder}")
