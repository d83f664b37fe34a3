"""Rows of a table that holds several sensors one after the other: those of one of them, and columns that seem to tell them apart."""

import json
import re
from collections.abc import Mapping, Sequence

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import clocks, listing
from massprop_cli.inputs.formats.mapfile import Where
from massprop_cli.inputs.formats.recording import RecordedStream, Recording

_SHOWN = 8
"""Values of a column that a message lists; sensors of one table are no more."""
_LOOK = 1000
"""Cells by which most columns are seen to have many values."""
_ALTERNATES, _SHARE = 0.2, 0.2
"""Part of the rows from which to the next a column that tells sensors apart changes, and of an equal share that each value has at least."""
_EVEN, _MOSTLY = 0.2, 0.7
"""Part of the usual interval by which intervals may differ from it, and the part of them that must not differ by more."""
_CALLED = re.compile(
    r"(?:.*[_ .])?(?:(?:i|imu|sensor|instance|source|src|node|device|dev)(?:[_ ]?(?:id|no|nr|num|number|index|idx|name))?|id)",
    re.IGNORECASE,
)
"""How a column is called that numbers sensors (ArduPilot's ``I``)."""


def rows_of(recording: Recording, where: Where, count: int) -> BoolArray | str:
    """(count,) the rows that a map's ``where`` selects, or why it selects none."""
    stream = recording.streams.get(where.column)
    if stream is None:
        return f"where names no path of this {recording.kind}, {where.column!r}; massprop columns lists all"
    if stream.rows != count:
        return f"where: {where.column!r} has {stream.rows} rows beside {count}; name a column of the same table"
    cells = _cells(stream)
    found = np.zeros(count, dtype=bool)
    for one in where.values:
        same = cells == one if isinstance(one, str) == (cells.dtype.kind != "f") else np.zeros(count, dtype=bool)
        if not np.any(same):
            listed = [one for one in np.unique(cells).tolist() if one == one and one != ""]
            shown = f"{stated(listed[:_SHOWN])}{', …' if len(listed) > _SHOWN else ''}"
            return f"where: no row has {stated([one])} in column {where.column!r}, which holds {shown}; state one of these"
        found |= same
    return found


def _cells(stream: RecordedStream) -> Array:
    """(rows,) numbers, or texts without the spaces around them where some cells are no numbers."""
    try:
        return np.asarray(stream.load(), np.float64)  # held no longer than it is looked at
    except InputError:
        if stream.texts is None:
            raise
        return np.array([(cell or "").strip() for cell in stream.texts()])


def stated(values: Sequence[float | str], between: str = ", ") -> str:
    """Values as a map file has them."""
    return between.join(json.dumps(one, ensure_ascii=False) if isinstance(one, str) else f"{one:.15g}" for one in values)


@dataclass(frozen=True)
class SensorColumn:
    """A column that seems to tell the sensors of one table apart."""

    column: str
    values: tuple[float | str, ...]

    @property
    def said(self) -> str:
        """What it looks like, and what to do in either case."""
        count, column, of_one = len(self.values), json.dumps(self.column, ensure_ascii=False), stated(self.values[:1])
        return (
            f"{count} sensors seem to be in one table: column {self.column!r} has {count} values ({stated(self.values)}) that alternate "
            f"with the records; select one sensor with where = {{ column = {column}, is = {of_one} }} under [gyro] and [accelerometer]; if "
            f"all rows are of one sensor, state is = [{stated(self.values)}]"
        )


def sensors(streams: Mapping[str, RecordedStream], count: int, rows: IntArray, times_s: Array | None) -> SensorColumn | None:
    """The column of a table of ``count`` rows that numbers sensors: its few values alternate with the records in ``rows`` (n,).

    It is called like one. Where the ``times_s`` (n,) of all rows are no clock, it may have any name if its values part them into clocks.
    """
    in_doubt = times_s is not None and _is_wrong(times_s)
    like = [one for one in streams.values() if one.rows == count and (in_doubt or _is_called(one))]
    for stream in sorted(like, key=_is_called, reverse=True):
        try:
            cells = _cells(stream)[rows]
        except InputError:
            continue
        values, code = _few(cells)
        if not len(values):
            continue
        each = np.bincount(code, minlength=len(values)) / len(code)
        alternates = float((np.diff(code) != 0).mean()) >= _ALTERNATES and float(each.min()) >= _SHARE / len(values)
        wrong = times_s is None or any(_is_wrong(times_s[code == n]) for n in range(len(values)))
        if alternates and (_is_called(stream) or not wrong):
            return SensorColumn(stream.path, values)
    return None


def _is_wrong(times_s: Array) -> bool:
    """Whether times stand still, go back, come in pairs, or mostly in other intervals than the usual one."""
    steps = np.diff(times_s)
    if clocks.problem(times_s, str, 0.0, sensor=True):
        return True
    return float((np.abs(steps / median(steps) - 1) < _EVEN).mean()) < _MOSTLY


def _is_called(stream: RecordedStream) -> bool:
    return _CALLED.fullmatch(listing.leaf(stream.path)) is not None


def _few(cells: Array) -> tuple[tuple[float | str, ...], IntArray]:
    """Its values where they are few whole numbers or texts, and (n,) the number of each cell's; none where they are not."""
    none: IntArray = np.zeros(0, int)
    if len(np.unique(cells[:_LOOK])) > _SHOWN:
        return (), none
    values, code = np.unique(cells, return_inverse=True)
    if not 2 <= len(values) <= _SHOWN or (values.dtype.kind == "f" and not (values % 1 == 0).all()):
        return (), none
    return tuple(values.tolist()), code
