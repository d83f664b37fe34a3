"""Reader of MATLAB files, versions 5 to 7.3, by mat-io (BSD). Paths are MATLAB's: ``imu.gyro(:,1)``, ``runs(2).t``, ``ts.Data(:,1)``."""

import io
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import matio
import numpy as np
import pandas as pd

from massprop_cli.base import limits
from massprop_cli.inputs.formats.recording import Numbers, Read, RecordedStream, stream, whole

_HDF5 = b"\x89HDF\r\n\x1a\n"
_HEADER, _TAG = 128, 8
"""Length of a version 5 file header and of an element's tag, bytes."""
_COMPRESSED = 15
"""Type of a zlib-compressed element."""
_DEEPEST = 16
_REMEDY = "save its numbers in MATLAB as a struct, of a timeseries ts as s = struct('time', ts.Time, 'data', ts.Data); save('log.mat', 's')"
_TIME_UNITS = {
    "nanoseconds": ("ns", 1), "microseconds": ("us", 1), "milliseconds": ("ms", 1), "seconds": ("s", 1),
    "minutes": ("s", 60), "hours": ("s", 3600), "days": ("s", 86400), "weeks": ("s", 604800),
}  # fmt: skip
"""massprop's unit for each of MATLAB's time units, and the factor to it."""
_MOST = 64
"""Maximum number of components per sample; more are images, not signals."""


def read(path: Path, data: bytes) -> Read:
    """Read all vectors and matrix columns of numbers, at any depth."""
    _check_size(path, data)
    with tempfile.TemporaryDirectory() as aside:
        file = Path(aside) / "recording.mat"
        file.write_bytes(data)
        variables = matio.load_from_mat(str(file), add_table_attrs=True)
    found = _Variables()
    streams = [one for name, value in variables.items() if not name.startswith("__") for one in found.streams(name, value)]
    return Read(streams, unread=found.unread)


def _check_size(path: Path, data: bytes) -> None:
    """Check the uncompressed size against the limit, from headers or by decompression in pieces."""
    if data[512:520] == _HDF5 or data[:8] == _HDF5:
        sizes: list[int] = []
        with h5py.File(io.BytesIO(data), "r") as file:
            file.visititems(lambda _, item: sizes.append(item.size) if isinstance(item, h5py.Dataset) else None)
        limits.NUMBERS.check(str(path), sum(sizes))
        return
    order: Any = "little" if data[126:128] == b"IM" else "big"
    at, unpacked, most = _HEADER, 0, limits.NUMBERS.most * 8
    while at + _TAG <= len(data):
        kind, size = (int.from_bytes(data[at + n : at + n + 4], order) for n in (0, 4))
        at += _TAG
        if kind == _COMPRESSED:
            unpack, rest = zlib.decompressobj(), data[at : at + size]
            while rest and unpacked <= most:
                unpacked += len(unpack.decompress(rest, 2**20))
                rest = unpack.unconsumed_tail
        else:
            unpacked += size
        limits.NUMBERS.check(str(path), unpacked // 8)
        at += size


class _Variables:
    """Streams of a file's variables."""

    def __init__(self) -> None:
        self.unread: dict[str, str] = {}
        """Unreadable objects by path, with the reason."""
        self._entered: set[int] = set()

    def streams(self, path: str, value: Any, depth: int = 0) -> Iterator[RecordedStream]:
        """Streams of all vectors and matrix columns of numbers in a variable."""
        if depth > _DEEPEST:
            return
        if isinstance(value, pd.DataFrame):
            yield from _table(path, value)
        elif isinstance(value, dict):
            for name, part in value.items():
                yield from self.streams(f"{path}.{name}", part, depth + 1)
        elif _is_object(value):
            yield from self._object(path, value, depth)
        elif isinstance(value, np.ndarray) and value.dtype.names:
            for number, element in enumerate(value.ravel(order="F"), 1):
                place = path if value.size == 1 else f"{path}({number})"
                for name in value.dtype.names:
                    yield from self.streams(f"{place}.{name}", element[name], depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype == object:
            begin, end = "()" if hasattr(value, "classname") else "{}"
            for number, element in enumerate(value.ravel(order="F"), 1):
                yield from self.streams(f"{path}{begin}{number}{end}", element, depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb" and value.size > 1:
            yield from _columns(path, value)

    def _object(self, path: str, value: Any, depth: int) -> Iterator[RecordedStream]:
        """Streams of a timeseries, or of the properties of another object; each object once."""
        if _is_timeseries(value):
            try:
                yield from _timeseries(path, value)
            except _UnreadableError as error:
                self.unread[path] = f"is a MATLAB timeseries {error}; {_REMEDY}"
            return
        if id(value) in self._entered:
            return
        self._entered.add(id(value))
        held = [one for name, part in value.properties.items() for one in self.streams(f"{path}.{name}", part, depth + 1)]
        yield from held
        if not held and not any(name.startswith(f"{path}.") for name in self.unread):
            self.unread[path] = f"is a MATLAB object of class {value.classname}, which only MATLAB reads; {_REMEDY}"


def _columns(path: str, value: Numbers) -> Iterator[RecordedStream]:
    """Stream of a vector, or streams of a matrix's columns (rows if it is wider than long)."""
    values = whole(value)
    if values.ndim == 1 or (1 in values.shape and values.ndim == 2):
        yield stream(path, values.ravel())
    elif values.ndim == 2 and values.shape[0] >= values.shape[1]:
        yield from (stream(f"{path}(:,{n + 1})", values[:, n]) for n in range(values.shape[1]))
    elif values.ndim == 2:
        yield from (stream(f"{path}({n + 1},:)", values[n]) for n in range(values.shape[0]))


def _table(path: str, table: pd.DataFrame) -> Iterator[RecordedStream]:
    """Streams of a table's variables; a timetable's times are their clock."""
    clock = ""
    if isinstance(table.index, pd.TimedeltaIndex | pd.DatetimeIndex):
        clock = f"{path}.{table.index.name or 'Time'}"
        yield stream(clock, table.index.as_unit("ns").asi8, unit="ns")
    units = _units(table)
    for name in table.columns:
        values = table[name].to_numpy()
        if values.dtype == object and len(values) and all(np.ndim(row) == 1 for row in values):
            values = np.stack(values)
        if values.dtype.kind not in "iufb":
            continue
        for one in _columns(f"{path}.{name}", values):
            yield stream(one.path, one.values, clock, units.get(str(name), ""))


def _units(table: pd.DataFrame) -> dict[str, str]:
    stated = table.attrs.get("VariableUnits", table.attrs.get("TableProperties", {}).get("VariableUnits"))
    units = () if stated is None else np.ravel(np.asarray(stated, dtype=object))
    return {str(name): str(np.ravel(unit)[0]) if np.size(unit) else "" for name, unit in zip(table.columns, units, strict=False)}


class _UnreadableError(Exception):
    """Object without readable numbers, with the reason."""


def _is_object(value: Any) -> bool:
    """Whether a value is a class object that mat-io does not convert."""
    return hasattr(value, "classname") and isinstance(getattr(value, "properties", None), dict)


def _is_timeseries(value: Any) -> bool:
    """Whether it is a ``timeseries``, by its class or its properties."""
    held = value.properties
    return value.classname == "timeseries" or ("TimeInfo" in held and ("Data_" in held or "Data" in held))


def _timeseries(path: str, value: Any) -> Iterator[RecordedStream]:
    """Streams ``ts.Time`` and ``ts.Data``, one per component. Raises :class:`_UnreadableError` if one has no numbers."""
    held = value.properties
    data = _numbers(held, "Data_", "Data")
    if data is None:
        raise _UnreadableError("without numbers")
    info = _properties(held.get("TimeInfo"))
    times, unit = _times(held, info, data)
    parts = list(_components(data, len(times), bool(np.any(held.get("IsTimeFirst_", True)))))
    clock = f"{path}.Time"
    yield stream(clock, times, unit=unit)
    own = _text(_properties(held.get("DataInfo")).get("Units"))
    yield from (stream(f"{path}.Data{at}", whole(values), clock, own) for at, values in parts)


def _times(held: Mapping[str, Any], info: Mapping[str, Any], data: Numbers) -> tuple[Numbers, str]:
    """Times and their unit; evenly spaced times are stored as start and increment."""
    name = _text(info.get("Units")) or "seconds"
    if name not in _TIME_UNITS:
        raise _UnreadableError(f"with times in {name}")
    unit, factor = _TIME_UNITS[name]
    own = _numbers(held, "Time_", "Time")
    times = _numbers(info, "Time_", "Time") if own is None else own
    if times is None:
        start, step, length = (_numbers(info, name, name.rstrip("_")) for name in ("Start_", "Increment_", "Length"))
        if step is None or length is None or not 0 < float(length.ravel()[0]) <= data.size:
            raise _UnreadableError("without times")
        begun = 0.0 if start is None else float(start.ravel()[0])
        times = begun + float(step.ravel()[0]) * np.arange(int(length.ravel()[0]))
    return times.ravel() if factor == 1 else times.ravel().astype(float) * factor, unit


def _components(data: Numbers, count: int, time_first: bool) -> Iterator[tuple[str, Numbers]]:
    """MATLAB index and values of each component of the samples: ``(1,1,:)`` for size 3 x 1 x n."""
    if data.size == count:
        yield "", data.ravel()
        return
    first, last = data.shape[0] == count, data.shape[-1] == count
    if not (first or last) or data.size > _MOST * count:
        raise _UnreadableError(f"of {count} times and {' x '.join(map(str, data.shape))} numbers")
    axis = 0 if first and (time_first or not last) else data.ndim - 1
    samples = np.moveaxis(data, axis, 0)
    for component in sorted(np.ndindex(samples.shape[1:]), key=lambda at: at[::-1]):
        index = [str(number + 1) for number in component]
        index.insert(axis, ":")
        yield f"({','.join(index)})", samples[(slice(None), *component)]


def _numbers(held: Mapping[str, Any], *names: str) -> Numbers | None:
    """Values of the first of these properties that has numbers."""
    values = (held.get(name) for name in names)
    return next((one for one in values if isinstance(one, np.ndarray) and one.dtype.kind in "iufb" and one.size), None)


def _properties(value: Any) -> Mapping[str, Any]:
    """Properties of an object within an object."""
    value = value.item() if isinstance(value, np.ndarray) and value.dtype == object and value.size == 1 else value
    return value.properties if _is_object(value) else {}


def _text(value: Any) -> str:
    """MATLAB text; empty for other values."""
    value = value.ravel()[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return str(value) if isinstance(value, str) else ""
