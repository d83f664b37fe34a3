"""Arrow columns from buffers; pa.array() would import pandas if it is installed, which takes longer than one estimate."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.lazy import pa


def text(values: Sequence[str | None]) -> Any:
    """Text column, null for None."""
    encoded = [(value or "").encode() for value in values]
    offsets = np.concatenate([[0], np.cumsum([len(value) for value in encoded])]).astype(np.int32)
    bits = pa.py_buffer(np.packbits([value is not None for value in values], bitorder="little").tobytes())
    return pa.Array.from_buffers(pa.string(), len(values), [bits, pa.py_buffer(offsets.tobytes()), pa.py_buffer(b"".join(encoded))])


def numbers(values: Array) -> Any:
    """Column of numbers, null for NaN and infinity."""
    known = np.isfinite(values)
    bits = pa.py_buffer(np.packbits(known, bitorder="little").tobytes())
    data = pa.py_buffer(np.where(known, values, 0.0).astype(np.float64).tobytes())
    return pa.Array.from_buffers(pa.float64(), len(values), [bits, data])


def held(values: Array) -> Any:
    """Column that shares the memory of a float64 array."""
    return pa.Array.from_buffers(pa.float64(), len(values), [None, pa.py_buffer(values)])


def floats(column: Any) -> Array:
    """(rows,) numbers of a float64 column, NaN for null; to_numpy() and fill_null() would also import pandas."""
    valid, values = column.buffers()
    part = slice(column.offset, column.offset + len(column))
    numbers = np.frombuffer(values, np.float64)[part]
    if column.null_count == 0:
        return numbers
    return np.where(np.unpackbits(np.frombuffer(valid, np.uint8), bitorder="little")[part] == 1, numbers, np.nan)
