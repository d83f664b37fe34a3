"""``massprop init``."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from massprop_cli.base.errors import InputError
from massprop_cli.cli import options
from massprop_cli.cli.guard import check_utf8, guarded
from massprop_cli.cli.terminal import put


@guarded
def init(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A log, or another recording with its map.", show_default=False)],
    map_file: options.MapFile = None,
    out: Annotated[Path | None, options.option("Write to this new file (default or -: stdout).", options.OUTPUT, metavar="FILE")] = None,
) -> None:
    """Draft a vehicle file from a log.

    Cycle, records, command channels, noise, gravity and biases come from the log; each line states its source. Values that no log can give
    are comments that say how to measure them.

    Examples:
        massprop init log.parquet
        massprop init log.parquet --out drafted.toml
    """
    check_utf8("--out", out)
    from massprop_cli.base import files
    from massprop_cli.inputs.formats import draft, reading, recording, traits
    from massprop_cli.inputs.logfile import read_table

    table = read_table(file, map_file)
    parameters = {} if recording.is_plain(file) else reading.load(file).parameters
    text = draft.draft(table.path.name.partition(".")[0], traits.traits(table), parameters, table.made.conversions if table.made else ())
    if out is None or str(out) == "-":
        sys.stdout.write(text)
        return
    with files.writing(out, "file"), files.held(out.parent):
        if out.exists():
            raise InputError(f"{out}: exists already; name a new file, or move it")
        files.text(out, text)
    put(str(out))
