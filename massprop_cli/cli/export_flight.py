"""``massprop export-flight``."""

from pathlib import Path
from typing import Annotated

from massprop_cli.cli import options
from massprop_cli.cli.guard import folder_of_its_own, guarded
from massprop_cli.cli.terminal import say


@guarded
def export_flight(
    vehicle: options.RequiredVehicle,
    out: Annotated[Path, options.out("Folder for the sources.")],
    log: Annotated[Path | None, options.option("Log for noise levels and a test vector.", options.INPUT, metavar="LOG")] = None,
    assign: options.Assign = None,
    quiet: Annotated[bool, options.quiet("Say nothing.")] = False,
) -> None:
    """Write the causal estimator as C99 for a flight computer: sources, tables of this vehicle, test vector, Makefile and README.

    `make test` in the folder runs the test vector and compares every bit with massprop's result. Exit 3: the kernel cannot represent the
    vehicle.

    Examples:
        massprop export-flight --vehicle vehicle.toml --out flight
        massprop export-flight --vehicle vehicle.toml --log log.parquet --out flight
    """
    folder_of_its_own(out)
    from massprop_cli.export import folder, resolve
    from massprop_cli.inputs import vehiclefile

    source = vehiclefile.load(vehicle, assign or [])
    resolved = resolve.stated(source) if log is None else resolve.from_log(source, log)
    names = folder.write(resolved, out)
    if not quiet:
        say(f"{len(names)} files written to {out}; make test there{'' if log is not None else ' builds them (no log, so no vector)'}")
