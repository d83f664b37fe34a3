"""A campaign's logs, a row each, held packed: a campaign takes hardly more memory for many logs than for few."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import overload

from pydantic import Field

from massprop_cli.campaign.outcome import Item, Outcome, packed, unpacked
from massprop_cli.campaign.plan import Job


class Row(Item):
    """One log, in the campaign's order."""

    name: str = Field(description="of its result folder in results/")
    log: str = Field(description="path below what was named")
    tags: list[str]
    outcome: Outcome | None = Field(description="null: not tried, after --fail-fast")


class Rows(Sequence[Row]):
    """Rows, compressed: about 1 kB each, where a row in the open takes 15 kB. What is taken out is a copy."""

    def __init__(self, rows: Iterable[Row] = ()) -> None:
        self._packed = [packed(row) for row in rows]

    def __len__(self) -> int:
        return len(self._packed)

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Row]: ...
    def __getitem__(self, index: int | slice) -> Row | Sequence[Row]:
        """One row, or some."""
        if isinstance(index, slice):
            return [unpacked(Row, one) for one in self._packed[index]]
        return unpacked(Row, self._packed[index])

    def __setitem__(self, index: int, row: Row) -> None:
        self._packed[index] = packed(row)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rows) and self._packed == other._packed

    __hash__ = None  # type: ignore[assignment]


def row(job: Job, outcome: Outcome | None) -> Row:
    """A job with what became of it."""
    return Row(name=job.name, log=job.shown, tags=list(job.tags), outcome=outcome)
