"""Large arrays and files in mapped temporary files, of which memory holds only the part in use.

An array is an ordinary one if it is small, or if the system or the disk does not allow a mapping.
"""

from __future__ import annotations

import hashlib
import mmap
import os
from collections.abc import Iterator
from math import prod
from typing import TYPE_CHECKING, BinaryIO
from weakref import WeakSet

if TYPE_CHECKING:
    from massprop_cli.base.arrays import Array

LARGE = 2**21
"""Least size of a mapped array, bytes."""
PART = 8192
"""Rows processed at a time."""
PIECE = 2**22
"""Bytes of a file read at a time."""
Content = bytes | mmap.mmap
"""Content of a file."""
_held: WeakSet[mmap.mmap] = WeakSet()


def empty(*shape: int) -> Array:
    """Uninitialised float64 array of this shape."""
    import numpy as np  # reading files does not need it

    size = 8 * prod(shape)
    file = _file(size)
    return np.empty(shape) if file is None else np.ndarray(shape, np.float64, file)


def copied(file: BinaryIO, size: int) -> Content:
    """Copy of the first ``size`` bytes of a file; OSError if it ends before."""
    held = _file(size)
    if held is None:
        data = file.read(size)
        found = len(data)
    else:
        while piece := file.read(min(PIECE, size - held.tell())):
            held.write(piece)
            give_back()
        found = held.tell()
    if found < size:
        raise OSError(f"it ended after {found} of {size} bytes while it was read")
    return data if held is None else held


def pieces(data: Content, first: int = 0) -> Iterator[bytes]:
    """Yield the content from the byte ``first`` on, in pieces that end at a line end if they contain one."""
    while first < len(data):
        line = data.rfind(b"\n", first, first + PIECE) if first + PIECE < len(data) else -1
        end = line + 1 or min(first + PIECE, len(data))
        yield data[first:end]
        give_back()
        first = end


def digest(data: Content) -> str:
    """SHA-256 of a content."""
    found = hashlib.sha256()
    for piece in pieces(data):
        found.update(piece)
    return found.hexdigest()


def parts(count: int, first: int = 0) -> Iterator[slice]:
    """Yield the rows ``first`` to ``count`` − 1 in parts; release the memory of large arrays after each part."""
    for begin in range(first, count, PART):
        yield slice(begin, min(begin + PART, count))
        give_back()


def give_back() -> None:
    """Release the memory that mapped arrays use; their content stays in the files."""
    for file in _held:
        file.madvise(mmap.MADV_DONTNEED)


def _file(size: int) -> mmap.mmap | None:
    """Mapping of an unnamed file of ``size`` bytes, allocated on the disk; None if that is not possible or ``size`` is small."""
    if size < LARGE or not hasattr(mmap, "MADV_DONTNEED"):
        return None
    import tempfile  # a dozen modules, not needed for a short log

    try:
        with tempfile.TemporaryFile() as file:
            # raises an error if the disk is full; a write to the mapping would then end the process
            os.posix_fallocate(file.fileno(), 0, size)
            found = mmap.mmap(file.fileno(), size)
    except (OSError, AttributeError, ValueError):
        return None
    _held.add(found)
    return found
