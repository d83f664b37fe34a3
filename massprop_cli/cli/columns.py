"""``massprop columns``."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from massprop_cli.base import foldername
from massprop_cli.cli import options
from massprop_cli.cli.guard import guarded
from massprop_cli.cli.terminal import console, say

if TYPE_CHECKING:
    from massprop_cli.inputs.formats.listing import Listed


@guarded
def columns(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording in any format that massprop reads.", show_default=False)],
    as_map: Annotated[bool, options.option("Print the drafted map file (TOML) and nothing else.", options.OUTPUT, "--as-map")] = False,
    as_json: Annotated[bool, options.as_json("the streams and the draft as JSON")] = False,
    no_color: options.NoColor = False,
) -> None:
    """List the streams of a recording with rate, range and unit, and draft its map file.

    Writes nothing. The draft has "?" where names, recorded units and clocks do not decide.

    Examples:
        massprop columns log.parquet
        massprop columns log.parquet --as-map > log.map.toml
    """
    from massprop_cli.inputs.formats import listing, propose, reading

    read = reading.load(file)
    text = propose.draft(read)
    if as_map:
        sys.stdout.write(text)
    elif as_json:
        document = {"file": file.name, "kind": read.kind, "streams": [asdict(one) for one in listing.listed(read)], "map": text}
        sys.stdout.write(json.dumps(document, indent=1, ensure_ascii=True) + "\n")
        return
    else:
        _show(listing.listed(read), read.kind, no_color)
        sys.stdout.write("\n" + text)
    count = propose.questions(text)
    if count:
        draft = f"{foldername.stem(file.name)}.map.toml"
        say(f'{count} lines of the draft have a "?" to be answered: massprop columns {file} --as-map > {draft}')


def _show(streams: list[Listed], kind: str, no_color: bool) -> None:
    from rich.table import Table

    from massprop_cli.base import escape
    from massprop_cli.report import digits

    table = Table(title=f"{len(streams)} streams of a {kind}", title_justify="left")
    for name in ("path", "samples", "rate [Hz]", "least", "most", "unit", "clock", "note"):
        table.add_column(name, justify="right" if name in ("samples", "rate [Hz]", "least", "most") else "left", overflow="fold")
    for one in streams:
        numbers = ["" if value is None else digits.stated(value, 6) for value in (one.rate_hz, one.least, one.most)]
        table.add_row(escape.rich(one.path), str(one.samples), *numbers, *(escape.rich(text) for text in (one.unit, one.clock, one.note)))
    console(no_color).print(table)
