"""campaign.csv: the rows of campaign.parquet for a spreadsheet, numbers in full precision, units in the names."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base.escape import cell
from massprop_cli.campaign.outcome import Body, Value, state
from massprop_cli.campaign.summary import Summary

_UNITS = {"kg m^2": "kg_m2", "m": "m", "kg": "kg"}
_PARTS = ("verdict", "expected", "met")
COLUMNS = (
    *("number", "name", "log", "tags", "outcome", "exit_code", "message", "vehicle", "part", "phase", "warnings"),
    *(
        column
        for name in QUANTITIES
        for column in (f"{name}_{_UNITS[UNITS[name]]}", f"{name}_sigma_{_UNITS[UNITS[name]]}", *(f"{name}_{part}" for part in _PARTS))
    ),
)
"""In their order."""


def csv_rows(found: Summary) -> Iterator[str]:
    """A row for each log's phases and docked object, one for each log without a result; RFC 4180, log by log."""
    yield _line(COLUMNS)
    for number, row in enumerate(found.logs, 1):
        one = row.outcome
        about = [
            str(number),
            cell(row.name),
            cell(row.log),
            cell("; ".join(row.tags)),
            state(one),
            "" if one is None else str(one.exit_code),
        ]
        about += ["not tried" if one is None else cell(one.message), "" if one is None or one.vehicle is None else cell(one.vehicle.name)]
        warnings = "" if one is None else cell("; ".join(one.warnings))
        bodies: list[Body | None] = [*one.bodies] if one is not None and one.bodies else [None]
        for body in bodies:
            part = ["", ""] if body is None else [body.part, cell(body.name)]
            values = [""] * (5 * len(QUANTITIES)) if body is None else [v for name in QUANTITIES for v in _value(body.estimates[name])]
            yield _line([*about, *part, warnings, *values])


def _value(item: Value) -> tuple[str, ...]:
    value, sigma, expected = ("" if number is None else repr(number) for number in (item.value, item.sigma, item.expected))
    return value, sigma, item.verdict, expected, "" if item.met is None else str(item.met).lower()


def _line(cells: list[str] | tuple[str, ...]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\r\n").writerow(cells)
    return out.getvalue()
