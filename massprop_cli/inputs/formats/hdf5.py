"""Reader of HDF5 by h5py (BSD): one stream per column (per row if wider than long), table field, or component of an array field.

Attribute ``unit`` or ``units`` gives the unit.
"""

import io
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from massprop_cli.base import limits
from massprop_cli.inputs.formats.recording import Numbers, Read, RecordedStream, whole

VEHICLE, MAP = "massprop.vehicle", "massprop.map"
"""Attributes of the file with embedded vehicle and map files."""


def read(path: Path, data: bytes) -> Read:
    """Streams of all numeric columns, each read on demand."""
    file = h5py.File(io.BytesIO(data), "r")
    found: list[h5py.Dataset] = []
    # no links into other files or virtual datasets, which may have any size
    file.visititems(lambda _, item: found.append(item) if _is_own(item) else None)
    limits.NUMBERS.check(str(path), sum(item.size * _numbers(item.dtype) for item in found))
    return Read([one for item in found for one in _streams(item)], vehicle=_text(file, VEHICLE), map=_text(file, MAP))


def _numbers(dtype: np.dtype[Any]) -> int:
    """Number of values in each element."""
    if not dtype.names:
        return 1
    return sum(int(np.prod(dtype[field].shape)) for field in dtype.names)


def _is_own(item: Any) -> bool:
    return isinstance(item, h5py.Dataset) and not item.is_virtual and item.external is None and item.ndim in (1, 2) and item.size > 0


def _streams(item: h5py.Dataset) -> Iterator[RecordedStream]:
    path = item.name.lstrip("/")
    unit = _text(item, "unit") or _text(item, "units") or ""
    # dimension scale of the first dimension, if attached
    clock = str(item.dims[0][0].name).lstrip("/") if len(item.dims) and len(item.dims[0].keys()) else ""
    if item.dtype.names:
        if item.ndim == 1:
            for field in item.dtype.names:
                base, shape = item.dtype[field].subdtype or (item.dtype[field], ())
                if base.kind not in "iufb" or len(shape) > 1:
                    continue
                view = item.fields(field)
                for n in range(shape[0]) if shape else [None]:
                    name = f"{path}/{field}" if n is None else f"{path}/{field}[{n}]"
                    yield RecordedStream(name, len(item), partial(_part, view, (), () if n is None else (slice(None), n)), clock, unit)
    elif item.dtype.kind in "iufb":
        rows, columns = (item.shape[0], 1) if item.ndim == 1 else item.shape
        if item.ndim == 1:
            yield RecordedStream(path, rows, partial(_part, item, ()), clock, unit)
        elif rows >= columns:
            yield from (RecordedStream(f"{path}[:,{n}]", rows, partial(_part, item, (slice(None), n)), clock, unit) for n in range(columns))
        else:
            yield from (RecordedStream(f"{path}[{n},:]", columns, partial(_part, item, (n,)), clock, unit) for n in range(rows))


def _part(item: Any, at: tuple[Any, ...], within: tuple[Any, ...] = ()) -> Numbers:
    """Values at ``at``, and of these a component."""
    return whole(np.asarray(item[at] if at else item[:])[within])


def _text(item: Any, name: str) -> str | None:
    found = item.attrs.get(name)
    if isinstance(found, bytes):
        return found.decode("utf-8", "replace")
    return found if isinstance(found, str) else None
