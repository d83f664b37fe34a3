"""campaign.parquet and campaign.csv: a row for each log's phases and docked object, and one for each log without a result."""

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

_TOGETHER = 250
"""Logs whose rows are held, and written, together."""


def parquet(found: Summary) -> bytes:
    """Name, log, tags, exit_code (null: not tried), message, then per quantity value and sigmas in SI, verdict, and whether it met its
    expectation. Inertia is about the CG in body axes, products are tensor elements, the CG is from O. Of campaigns with a
    bearing or pedestal the same of the nine values about the pivot, pivot_ixx … pivot_moment_z.
    """  # noqa: D205
    out = io.BytesIO()
    with ExitStack() as stack:
        writer, names = None, quantities(found)
        for start in range(0, len(found.logs), _TOGETHER):
            part = _part(found.logs[start : start + _TOGETHER], names)
            writer = writer or stack.enter_context(pq.ParquetWriter(out, part.schema, compression="zstd"))
            writer.write_table(part)
    return out.getvalue()


def _texts(row: CampaignRow, found: Outcome | None, body: PhaseQuantities | None) -> dict[str, str | None]:
    """The texts of a row; None where there is none."""
    vehicle = found.vehicle if found else None
    return {
        "name": row.name,
        "log": row.log,
        "tags": "; ".join(row.tags),
        "message": found.message if found else "not tried",
        "vehicle": vehicle.name if vehicle else None,
        "environment": vehicle.environment if vehicle else None,
        "method": found.method if found else None,
        "part": body.part if body else None,
        "phase": body.name if body else None,
        "warnings": "; ".join(found.warnings) if found else None,
        "input_sha256": found.input_sha256 if found else None,
        "vehicle_sha256": vehicle.sha256 if vehicle else None,
    }


def _column(quantity: str) -> str:
    """The beginning of a quantity's column names: about the pivot as in history.parquet."""
    return quantity.replace(PIVOT, "pivot_")


def _part(rows: Sequence[CampaignRow], names: Sequence[str]) -> Any:
    """The table of some rows."""
    lines = [(row, row.outcome, body) for row in rows for body in _bodies(row.outcome)]
    texts = [_texts(*line) for line in lines]
    columns: dict[str, Any] = {name: arrow.text([text[name] for text in texts]) for name in texts[0]}
    for name in ("exit_code", "duration_s", "cycles", "delay_cycles"):
        column = _numbers([getattr(outcome, name, None) for _, outcome, _ in lines])
        columns[name] = column.cast(pa.int64()) if name in ("exit_code", "cycles") else column
    every = [{} if body is None else body.items for *_, body in lines]
    for quantity in names:
        columns |= _quantity(_column(quantity), [told.get(quantity) for told in every])
    return pa.table(columns)


def _bodies(found: Outcome | None) -> Sequence[PhaseQuantities | None]:
    return [*found.bodies] if found is not None and found.bodies else [None]


def _quantity(quantity: str, values: Sequence[Value | None]) -> dict[str, Any]:
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
_ABOUT = ("number", "name", "log", "tags", "outcome", "exit_code", "message", "vehicle", "part", "phase", "warnings")


def columns(names: Sequence[str]) -> tuple[str, ...]:
    """The columns of campaign.csv in their order."""
    pairs = ((_column(name), SPELT[ALL_UNITS[name]]) for name in names)
    each = ((f"{name}_{unit}", f"{name}_sigma_{unit}", *(f"{name}_{part}" for part in _PARTS)) for name, unit in pairs)
    return (*_ABOUT, *(column for of_one in each for column in of_one))


def csv_rows(found: Summary) -> Iterator[str]:
    """A row for each log's phases and docked object, one for each log without a result; RFC 4180, log by log."""
    names = quantities(found)
    yield _line(columns(names))
    for number, row in enumerate(found.logs, 1):
        one = row.outcome
        for body in _bodies(one):
            said = {name: cell(text or "") for name, text in _texts(row, one, body).items()}
            said |= {"number": str(number), "outcome": state(one), "exit_code": "" if one is None else str(one.exit_code)}
            told = {} if body is None else body.items
            values = [value for name in names for value in _value(told.get(name))]
            yield _line([*(said[name] for name in _ABOUT), *values])


def _value(item: Value | None) -> tuple[str, ...]:
    if item is None:
        return ("",) * (2 + len(_PARTS))
    value, sigma, expected = ("" if number is None else repr(number) for number in (item.value, item.sigma, item.expected))
    return value, sigma, item.verdict, expected, "" if item.met is None else str(item.met).lower()


def _line(cells: list[str] | tuple[str, ...]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\r\n").writerow(cells)
    return out.getvalue()
