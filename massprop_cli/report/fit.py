"""Tables on terminals of any width: columns go, digits don't."""

from collections.abc import Sequence

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

_ENDLESS = 10_000


def titled(title: str, columns: Sequence[str], words: Sequence[str], style: str = "bold") -> Table:
    """A table whose columns don't wrap; of those that are no ``words`` numbers stand below each other."""
    table = Table(title=title, title_justify="left", title_style=style)
    for name in columns:
        table.add_column(name, justify="left" if name in words else "right", no_wrap=True)
    return table


def fitted(table: Table, console: Console, spare: Sequence[str] = ()) -> None:
    """Print a table in the terminal's width: headings wrap, then ``spare`` columns go, then the lines, then it runs over the edge."""
    terminal, gone = console.width, list[str]()
    needed = _needed(table, console)
    if needed.maximum > terminal:
        for column in table.columns:
            if column.no_wrap:  # the explanation in its heading goes on a line of its own
                column.header = str(column.header).replace(" (", "\n(")
        needed = _needed(table, console)
    for heading in spare:
        if needed.maximum <= terminal:
            break
        slimmer = without(table, heading)
        if len(slimmer.columns) < len(table.columns):
            gone.append(heading)
            table, needed = slimmer, _needed(slimmer, console)
    if needed.maximum > terminal:
        table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
        needed = _needed(table, console)
    # below that something would be cut short: of a table without columns that wrap, anything
    wraps = any(not column.no_wrap for column in table.columns)
    console.width = max(terminal, needed.minimum if wraps else needed.maximum)
    console.print(table)
    console.width = terminal
    if gone:
        console.print(f"not shown for want of width: {', '.join(heading.replace(chr(10), ' ') for heading in gone)}", style="dim")


def _needed(table: Table, console: Console) -> Measurement:
    """Characters that a table takes: where whatever may is wrapped, and where nothing is."""
    return Measurement.get(console, console.options.update(width=_ENDLESS), table)


def without(table: Table, heading: str) -> Table:
    """The table without the column of this heading."""
    kept = [column for column in table.columns if column.header != heading]
    slimmer = Table(title=table.title, title_justify=table.title_justify, title_style=table.title_style)
    for column in kept:
        slimmer.add_column(column.header, justify=column.justify, no_wrap=column.no_wrap, overflow=column.overflow)
    for cells in zip(*(column.cells for column in kept), strict=True):
        slimmer.add_row(*cells)
    return slimmer
