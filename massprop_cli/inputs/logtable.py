"""A table of telemetry by the contract's names of its columns, under a log's own names and scales."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import nearest
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import FIXED
from massprop_cli.inputs.section import LEAST
from massprop_cli.inputs.tablefile import Table
from massprop_cli.inputs.vehicle import Column

GAP, LONG = 2.5, 1.5
"""Times the median interval: a record that is longer than that is a gap, or has lost one before it."""


class LogTable:
    """Contract columns of a table, under this log's own names and scales."""

    def __init__(self, table: Table, columns: Mapping[str, Column]) -> None:
        self.table, self.columns = table, columns
        for known, column in columns.items():
            if column.from_ not in table.columns:
                hint = nearest(column.from_, table.columns, "the nearest present is")
                raise InputError(f"{table.path}: column {column.from_!r} is missing, which [columns] maps to {known}{hint}")

    def name(self, column: str) -> str:
        """What this log calls a column."""
        mapped = self.columns.get(column)
        return mapped.from_ if mapped else column

    @property
    def logged(self) -> list[str]:
        """All columns, by the contract's names where the vehicle file maps them."""
        mapped = {column.from_: name for name, column in self.columns.items()}
        return [mapped.get(name, name) for name in self.table.columns]

    def has(self, column: str) -> bool:
        """Whether the log has it."""
        return self.name(column) in self.table.columns

    def place(self, row: int) -> str:
        """How a person finds a row."""
        return self.table.places.of(row)

    def error(self, row: int, column: str, problem: str) -> InputError:
        """What is wrong with a cell."""
        return InputError(f"{self.table.path}, {self.place(row)}, column {self.name(column)}: {problem}")

    def optional(self, column: str) -> Array:
        """The column, scaled, with NaN for null."""
        name = self.name(column)
        if name not in self.table.columns:
            used = {self.name(known) for known in FIXED if self.has(known)} | {n for n in self.table.columns if n.startswith("jet_")}
            spare = [present for present in self.table.columns if present not in used - {name}]
            hint = nearest(name, spare, "the nearest that is not in use is")
            cure = "rename it, or map it under [columns] of the vehicle file, or add it" if spare else "no other is left to be it; add it"
            cure += ", with 0 in each row if that jet never fired" * name.startswith("jet_")
            raise InputError(f"{self.table.path}: column {name!r} is missing{hint}; {cure}")
        numbers: Array = self.table.columns[name].numbers()
        scaled = np.multiply(numbers, self.columns[column].scale if column in self.columns else 1.0, out=spill.empty(len(numbers)))
        # what underflows when it is squared is a zero that was calculated
        scaled[(scaled < LEAST) & (scaled > -LEAST)] = 0.0
        return scaled

    def required(self, column: str) -> Array:
        """The column, scaled; every cell must be a finite number."""
        values = self.optional(column)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            cell = "nan or an empty cell" if np.isnan(values[bad[0]]) else f"{values[bad[0]]}"
            raise self.error(int(bad[0]), column, f"{cell} is not a finite number; mend or cut the record")
        return values

    def increments(self, names: Sequence[str], rates: Sequence[str], interval_s: Array) -> Array:
        """(n, 3) increments, or rates times the interval where the increments are absent."""
        as_rates = not any(self.has(name) for name in names) and any(self.has(name) for name in rates)
        found = self.stacked(rates if as_rates else names)
        if as_rates:
            for part in spill.parts(len(found)):
                found[part] *= interval_s[part, None]
        return found

    def stacked(self, columns: Sequence[str]) -> Array:
        """(n, columns) required columns side by side."""
        found = spill.empty(self.table.rows, len(columns))
        for place, column in enumerate(columns):
            values = self.required(column)
            for part in spill.parts(len(values)):
                found[part, place] = values[part]
        return found
