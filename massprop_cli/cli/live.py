"""``massprop live``."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from massprop_cli.cli.guard import folder_of_its_own, guarded
from massprop_cli.cli.terminal import say, show, told_of, warn


@guarded
def live(
    vehicle: Annotated[Path, typer.Option(help="Vehicle file (TOML).", envvar="MASSPROP_VEHICLE", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder for the recording and its result.", envvar="MASSPROP_OUT", show_default=False)],
    assign: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a dotted vehicle-file key.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No table, no warnings.")] = False,
    no_color: Annotated[bool, typer.Option("--no-color", help="No colour (NO_COLOR works too).")] = False,
) -> None:
    """Estimate while records arrive on standard input (CSV or a JSON object on each line): a JSON line on standard output for each cycle.

    What comes is kept in record.csv, and in the end estimated as `massprop estimate` would: result.json, history.parquet, run.json.
    A record that must be left out is told on one line of stderr. Exit 3 where what comes can't be used, or no more of it.

    Examples:
        massprop live --vehicle vehicle.toml --out flight < log.csv
    """
    folder_of_its_own(out)
    from massprop_cli.inputs import vehiclefile
    from massprop_cli.live import records, run
    from massprop_cli.live.recording import RECORDED, recording

    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(encoding="utf-8-sig", errors="replace")  # what is not text makes a bad record, not an end
    source = vehiclefile.load(vehicle, assign or [])
    with recording(out) as keep:
        for line in run.follow(records.lines_of(sys.stdin), source, keep, say):
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()
    _concluded(out / RECORDED, vehicle, assign or [], quiet, no_color)


def _concluded(record: Path, vehicle: Path, assign: Sequence[str], quiet: bool, no_color: bool) -> None:
    """The recording's result; its table is for a terminal alone, since stdout is another program's."""
    from massprop_cli import job
    from massprop_cli.result import schema, store

    judged = job.of_file(record, vehicle, assign)
    stored = store.write(record.parent, judged.analysis, schema.to_json(judged.result))
    told_of(stored, None, quiet)
    warn(judged.analysis.notices, quiet)
    if not quiet and sys.stdout.isatty():
        show(judged.result, record.parent, no_color)
