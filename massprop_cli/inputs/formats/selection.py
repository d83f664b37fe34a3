"""Tables with interleaved rows of several sensors: selection of one sensor's rows, and detection of the column that identifies sensors."""

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
"""Maximum number of values in a message, and of sensors in a table."""
_SAMPLE = 1000
"""Number of cells that show whether a column has many values."""
_ALTERNATES, _SHARE = 0.2, 0.2
"""Minimum rate of change from row to row of a column that identifies sensors, and minimum share of each value over an equal share."""
_EVEN, _MOSTLY = 0.2, 0.7
"""Relative tolerance of a usual interval, and minimum fraction of usual intervals."""
_CALLED = re.compile(
    r"(?:.*[_ .])?(?:(?:i|imu|sensor|instance|source|src|node|device|dev)(?:[_ ]?(?:id|no|nr|num|number|index|idx|name))?|id)",
    re.IGNORECASE,
)
"""Names of columns that number sensors (ArduPilot: ``I``)."""


def rows_of(recording: Recording, where: Where, count: int) -> BoolArray | str:
    """(count,) rows that ``where`` of a map selects, or the reason why it selects none."""
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
    """(rows,) numbers, or stripped texts if some cells are not numbers."""
    try:
        return np.asarray(stream.load(), np.float64)  # not cached, because the values are needed only here
    except InputError:
        if stream.texts is None:
            raise
        return np.array([(cell or "").strip() for cell in stream.texts()])


def stated(values: Sequence[float | str], between: str = ", ") -> str:
    """Values as in a map file."""
    return between.join(json.dumps(one, ensure_ascii=False) if isinstance(one, str) else f"{one:.15g}" for one in values)


@dataclass(frozen=True)
class SensorColumn:
    """Column that probably identifies the sensors of a table."""

    column: str
    values: tuple[float | str, ...]

    @property
    def message(self) -> str:
        """Message with the observation and the remedy."""
        count, column, of_one = len(self.values), json.dumps(self.column, ensure_ascii=False), stated(self.values[:1])
        return (
            f"{count} sensors seem to be in one table: column {self.column!r} has {count} values ({stated(self.values)}) that alternate "
            f"with the records; select one sensor with where = {{ column = {column}, is = {of_one} }} under [gyro] and [accelerometer]; if "
            f"all rows are of one sensor, state is = [{stated(self.values)}]"
        )


def sensors(streams: Mapping[str, RecordedStream], count: int, rows: IntArray, times_s: Array | None) -> SensorColumn | None:
    """Column that identifies sensors in a table of ``count`` rows: few values, which alternate with the records in ``rows`` (n,).

    Its name must fit. If the ``times_s`` (n,) of all rows are not a valid clock, any column counts that separates them into valid clocks.
    """
    in_doubt = times_s is not None and _is_invalid(times_s)
    like = [one for one in streams.values() if one.rows == count and (in_doubt or _has_sensor_name(one))]
    for stream in sorted(like, key=_has_sensor_name, reverse=True):
        try:
            cells = _cells(stream)[rows]
        except InputError:
            continue
        values, code = _few(cells)
        if not len(values):
            continue
        each = np.bincount(code, minlength=len(values)) / len(code)
        alternates = float((np.diff(code) != 0).mean()) >= _ALTERNATES and float(each.min()) >= _SHARE / len(values)
        wrong = times_s is None or any(_is_invalid(times_s[code == n]) for n in range(len(values)))
        if alternates and (_has_sensor_name(stream) or not wrong):
            return SensorColumn(stream.path, values)
    return None


def _is_invalid(times_s: Array) -> bool:
    """Whether times repeat, go back, come in pairs, or rarely have the usual interval."""
    steps = np.diff(times_s)
    if clocks.problem(times_s, str, 0.0, sensor=True):
        return True
    return float((np.abs(steps / median(steps) - 1) < _EVEN).mean()) < _MOSTLY


def _has_sensor_name(stream: RecordedStream) -> bool:
    return _CALLED.fullmatch(listing.leaf(stream.path)) is not None


def _few(cells: Array) -> tuple[tuple[float | str, ...], IntArray]:
    """Distinct values, if they are few integers or texts, and (n,) index of each cell's value; else empty."""
    none: IntArray = np.zeros(0, int)
    if len(np.unique(cells[:_SAMPLE])) > _SHOWN:
        return (), none
    values, code = np.unique(cells, return_inverse=True)
    if not 2 <= len(values) <= _SHOWN or (values.dtype.kind == "f" and not (values % 1 == 0).all()):
        return (), none
    return tuple(values.tolist()), code
