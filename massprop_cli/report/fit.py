"""Tables on terminals of any width: columns go, digits don't."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

_ENDLESS = 10_000


def fitted(table: Table, console: Console, spare: Sequence[str] = ()) -> None:
    """Print a table as the terminal has room for it.

    Columns headed as in ``spare`` go first, one after another, and a line names them; then the table's lines; then it runs over the edge.
    """
    terminal, gone = console.width, list[str]()
    for heading in spare:
        if width(table, console) <= terminal:
            break
        slimmer = without(table, heading)
        gone += [heading] if len(slimmer.columns) < len(table.columns) else []
        table = slimmer
    if width(table, console) > terminal:
        table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
    console.width = max(terminal, _least(table, console))
    console.print(table)
    console.width = terminal
    if gone:
        console.print(f"not shown for want of width: {', '.join(heading.replace(chr(10), ' ') for heading in gone)}", style="dim")


def width(table: Table, console: Console) -> int:
    """Characters that a table takes where nothing is wrapped."""
    return Measurement.get(console, console.options.update(width=_ENDLESS), table).maximum


def _least(table: Table, console: Console) -> int:
    """Characters below which something would be cut short: nothing of a table without columns that wrap may be."""
    if all(column.no_wrap for column in table.columns):
        return width(table, console)
    return Measurement.get(console, console.options.update(width=_ENDLESS), table).minimum


def without(table: Table, heading: str) -> Table:
    """The same table less the column with this heading, if it has it."""
    kept = [column for column in table.columns if column.header != heading]
    slimmer = Table(title=table.title, title_justify=table.title_justify, title_style=table.title_style)
    for column in kept:
        slimmer.add_column(column.header, justify=column.justify, no_wrap=column.no_wrap, overflow=column.overflow)
    for cells in zip(*(column.cells for column in kept), strict=True):
        slimmer.add_row(*cells)
    return slimmer
