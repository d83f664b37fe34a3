"""Tables for terminals of any width: a narrow one omits columns, and never digits."""

from collections.abc import Sequence

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

_ENDLESS = 10_000


def titled(title: str, columns: Sequence[str], words: Sequence[str], style: str = "bold") -> Table:
    """A table whose columns do not wrap; columns other than ``words`` are numbers and right-aligned."""
    table = Table(title=title, title_justify="left", title_style=style)
    for name in columns:
        table.add_column(name, justify="left" if name in words else "right", no_wrap=True)
    return table


def fitted(table: Table, console: Console, optional: Sequence[str] = ()) -> None:
    """Print a table in the terminal's width.

    If it is too wide, the function wraps headings, then omits ``optional`` columns in their order, then the borders. After that, it exceeds
    the width.
    """
    terminal, omitted = console.width, list[str]()
    needed = _needed(table, console)
    if needed.maximum > terminal:
        for column in table.columns:
            if column.no_wrap:  # the explanation in parentheses gets its own line
                column.header = str(column.header).replace(" (", "\n(")
        needed = _needed(table, console)
    for heading in optional:
        if needed.maximum <= terminal:
            break
        narrower = without(table, heading)
        if len(narrower.columns) < len(table.columns):
            omitted.append(heading)
            table, needed = narrower, _needed(narrower, console)
    if needed.maximum > terminal:
        table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
        needed = _needed(table, console)
    # rich truncates cells below the minimum, and in a table without wrapping columns below the maximum
    wraps = any(not column.no_wrap for column in table.columns)
    console.width = max(terminal, needed.minimum if wraps else needed.maximum)
    console.print(table)
    console.width = terminal
    if omitted:
        console.print(f"not shown for want of width: {', '.join(heading.replace(chr(10), ' ') for heading in omitted)}", style="dim")


def _needed(table: Table, console: Console) -> Measurement:
    """Width of a table in characters: the minimum with all wrapping, and the maximum without."""
    return Measurement.get(console, console.options.update(width=_ENDLESS), table)


def without(table: Table, heading: str) -> Table:
    """The table without the column of this heading."""
    kept = [column for column in table.columns if column.header != heading]
    narrower = Table(title=table.title, title_justify=table.title_justify, title_style=table.title_style)
    for column in kept:
        narrower.add_column(column.header, justify=column.justify, no_wrap=column.no_wrap, overflow=column.overflow)
    for cells in zip(*(column.cells for column in kept), strict=True):
        narrower.add_row(*cells)
    return narrower
