"""Tables campaign.parquet and campaign.csv: a row for each phase and docked object of a log, and one for each log without a result."""

import csv
import io
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np

from massprop_cli import ALL_UNITS, PIVOT
from massprop_cli.base import arrow
from massprop_cli.base.escape import cell
from massprop_cli.base.lazy import pa, pq
from massprop_cli.campaign.outcome import CampaignRow, Outcome, PhaseQuantities, Value, state
from massprop_cli.campaign.summary import Summary, quantities
from massprop_cli.report.spreadsheet import SPELT

_BLOCK = 250
"""Number of logs in memory at a time, and in a row group."""


def parquet(summary: Summary) -> bytes:
    """Content of campaign.parquet.

    Columns: name, log, tags, exit_code (null: not tried), message; then for each quantity its value and sigmas in SI, its verdict, and
    whether it met its expectation. Inertia is about the CG in body axes, products are tensor elements, and the CG is from O. With a bearing
    or pedestal, the columns pivot_ixx … pivot_moment_z contain the nine quantities about the pivot.
    """
    out = io.BytesIO()
    with ExitStack() as stack:
        writer, names = None, quantities(summary)
        for start in range(0, len(summary.logs), _BLOCK):
            part = _part(summary.logs[start : start + _BLOCK], names)
            writer = writer or stack.enter_context(pq.ParquetWriter(out, part.schema, compression="zstd"))
            writer.write_table(part)
    return out.getvalue()


def _texts(row: CampaignRow, outcome: Outcome | None, body: PhaseQuantities | None) -> dict[str, str | None]:
    """Text columns of a row; None for an empty cell."""
    vehicle = outcome.vehicle if outcome else None
    return {
        "name": row.name,
        "log": row.log,
        "tags": "; ".join(row.tags),
        "message": outcome.message if outcome else "not tried",
        "vehicle": vehicle.name if vehicle else None,
        "environment": vehicle.environment if vehicle else None,
        "method": outcome.method if outcome else None,
        "part": body.part if body else None,
        "phase": body.name if body else None,
        "warnings": "; ".join(outcome.warnings) if outcome else None,
        "input_sha256": outcome.input_sha256 if outcome else None,
        "vehicle_sha256": vehicle.sha256 if vehicle else None,
    }


def _column(quantity: str) -> str:
    """Prefix of a quantity's column names; quantities about the pivot are named as in history.parquet."""
    return quantity.replace(PIVOT, "pivot_")


def _part(rows: Sequence[CampaignRow], names: Sequence[str]) -> Any:
    """Arrow table of some logs."""
    lines = [(row, row.outcome, body) for row in rows for body in _bodies(row.outcome)]
    texts = [_texts(*line) for line in lines]
    columns: dict[str, Any] = {name: arrow.text([text[name] for text in texts]) for name in texts[0]}
    for name in ("exit_code", "duration_s", "cycles", "delay_cycles"):
        column = _numbers([getattr(outcome, name, None) for _, outcome, _ in lines])
        columns[name] = column.cast(pa.int64()) if name in ("exit_code", "cycles") else column
    every = [{} if body is None else body.items for *_, body in lines]
    for quantity in names:
        columns |= _quantity(_column(quantity), [items.get(quantity) for items in every])
    return pa.table(columns)


def _bodies(outcome: Outcome | None) -> Sequence[PhaseQuantities | None]:
    """One element per row of a log: its phases and docked object, or None without a result."""
    return [*outcome.bodies] if outcome is not None and outcome.bodies else [None]


def _quantity(quantity: str, values: Sequence[Value | None]) -> dict[str, Any]:
    """Arrow columns of one quantity."""
    return {
        quantity: _numbers([item.value if item else None for item in values]),
        f"{quantity}_sigma": _numbers([item.sigma if item else None for item in values]),
        f"{quantity}_shared_sigma": _numbers([item.shared if item else None for item in values]),
        f"{quantity}_verdict": arrow.text([item.verdict if item else None for item in values]),
        f"{quantity}_met": _numbers([item.met if item else None for item in values]).cast(pa.bool_()),
    }


def _numbers(values: Sequence[float | None]) -> Any:
    return arrow.numbers(np.array(values, dtype=float))


_PARTS = ("verdict", "expected", "met")
"""Columns of a quantity in campaign.csv, in addition to value and sigma."""
_LOG_COLUMNS = ("number", "name", "log", "tags", "outcome", "exit_code", "message", "vehicle", "part", "phase", "warnings")


def columns(names: Sequence[str]) -> tuple[str, ...]:
    """Column names of campaign.csv."""
    pairs = ((_column(name), SPELT[ALL_UNITS[name]]) for name in names)
    each = ((f"{name}_{unit}", f"{name}_sigma_{unit}", *(f"{name}_{part}" for part in _PARTS)) for name, unit in pairs)
    return (*_LOG_COLUMNS, *(column for of_one in each for column in of_one))


def csv_rows(summary: Summary) -> Iterator[str]:
    """Lines of campaign.csv with their line ends (RFC 4180), the header first."""
    names = quantities(summary)
    yield _line(columns(names))
    for number, row in enumerate(summary.logs, 1):
        outcome = row.outcome
        for body in _bodies(outcome):
            texts = {name: cell(text or "") for name, text in _texts(row, outcome, body).items()}
            texts |= {"number": str(number), "outcome": state(outcome), "exit_code": "" if outcome is None else str(outcome.exit_code)}
            items = {} if body is None else body.items
            values = [value for name in names for value in _value(items.get(name))]
            yield _line([*(texts[name] for name in _LOG_COLUMNS), *values])


def _value(item: Value | None) -> tuple[str, ...]:
    """Cells of one quantity; empty without an estimate."""
    if item is None:
        return ("",) * (2 + len(_PARTS))
    value, sigma, expected = ("" if number is None else repr(number) for number in (item.value, item.sigma, item.expected))
    return value, sigma, item.verdict, expected, "" if item.met is None else str(item.met).lower()


def _line(cells: list[str] | tuple[str, ...]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\r\n").writerow(cells)
    return out.getvalue()
