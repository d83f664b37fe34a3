"""Arrays and files as long as a log, of which memory holds no more than is worked on.

A large one is a mapped temporary file without a name, whose memory is given back part by part; where the system or the disk allows none, it
is an array like any other.
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
"""Bytes from which on an array lies in a file."""
PART = 8192
"""Rows that are worked on at a time."""
PIECE = 2**22
"""Bytes of a file that are read at a time."""
Content = bytes | mmap.mmap
"""What a file holds."""
_held: WeakSet[mmap.mmap] = WeakSet()


def empty(*shape: int) -> Array:
    """An array of float64 of this shape, whose numbers are anything yet."""
    import numpy as np  # files are read before anything needs it

    size = 8 * prod(shape)
    file = _file(size)
    return np.empty(shape) if file is None else np.ndarray(shape, np.float64, file)


def copied(file: BinaryIO, size: int) -> Content:
    """The first ``size`` bytes of a file, as they are now; OSError where it ends before."""
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
    """The content of a file from a place on, in pieces that end with a line where one ends."""
    while first < len(data):
        line = data.rfind(b"\n", first, first + PIECE) if first + PIECE < len(data) else -1
        end = line + 1 or min(first + PIECE, len(data))
        yield data[first:end]
        give_back()
        first = end


def digest(data: Content) -> str:
    """SHA-256 of what a file holds."""
    found = hashlib.sha256()
    for piece in pieces(data):
        found.update(piece)
    return found.hexdigest()


def parts(count: int, first: int = 0) -> Iterator[slice]:
    """Rows ``first`` to before ``count``, some thousand at a time; after each the memory that large arrays took for it is given back."""
    for begin in range(first, count, PART):
        yield slice(begin, min(begin + PART, count))
        give_back()


def give_back() -> None:
    """Gives back the memory that large arrays take at present; they hold the same numbers as before."""
    for file in _held:
        file.madvise(mmap.MADV_DONTNEED)


def _file(size: int) -> mmap.mmap | None:
    """A nameless file of ``size`` bytes, allocated on the disk; None where that is not possible, and for a small size."""
    if size < LARGE or not hasattr(mmap, "MADV_DONTNEED"):
        return None
    import tempfile  # a dozen modules that a short log does without

    try:
        with tempfile.TemporaryFile() as file:
            # a full disk is told here; beneath a mapping it would end the process
            os.posix_fallocate(file.fileno(), 0, size)
            found = mmap.mmap(file.fileno(), size)
    except (OSError, AttributeError, ValueError):
        return None
    _held.add(found)
    return found
