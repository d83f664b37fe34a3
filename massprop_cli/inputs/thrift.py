"""Thrift's compact protocol, read only: what Parquet writes its headers in (github.com/apache/thrift, thrift-compact-protocol.md).

Arrow's own reader of these headers can't be asked: some of them make it end the whole process.
"""

from typing import Any

from massprop_cli.base.spill import Content

_DEEPEST, LISTED = 16, 2**14
"""Levels of structs, and items of a list, that a header may have."""
_BINARY, _LIST, _SET, _STRUCT = 8, 9, 10, 12
_FIXED = {3: 1, 7: 8, 13: 16}
"""Bytes of a byte, a double and a UUID."""


def struct(data: Content, at: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Fields of a struct by number (integers, bytes, structs and their lists, else None), and where it ends; ValueError for none."""
    if depth > _DEEPEST:
        raise ValueError("a header is nested too deep")
    found: dict[int, Any] = {}
    number = 0
    while True:
        head, at = _byte(data, at)
        kind = head & 15
        if kind == 0:
            return found, at
        if head >> 4:
            number += head >> 4
        else:
            number, at = _integer(data, at)
        # a field's truth value is told by its kind
        found[number], at = (None, at) if kind in (1, 2) else _value(data, at, kind, depth)


def _value(data: Content, at: int, kind: int, depth: int) -> tuple[Any, int]:
    if kind in (4, 5, 6):
        return _integer(data, at)
    if kind == _BINARY:
        length, at = _unsigned(data, at)
        if length > len(data) - at:
            raise ValueError("a header is cut short")
        return data[at : at + length], at + length
    if kind == _STRUCT:
        return struct(data, at, depth + 1)
    if kind in (_LIST, _SET):
        return _list(data, at, depth)
    if kind in (1, 2):
        return None, at + 1
    if kind in _FIXED:
        return None, at + _FIXED[kind]
    # Parquet has no maps
    raise ValueError("a header has a field of unknown kind")


def _list(data: Content, at: int, depth: int) -> tuple[list[Any], int]:
    head, at = _byte(data, at)
    length, at = _unsigned(data, at) if head >> 4 == 15 else (head >> 4, at)
    if length > LISTED:
        raise ValueError(f"a header lists more than {LISTED} items")
    found = []
    for _ in range(length):
        item, at = _value(data, at, head & 15, depth + 1)
        found.append(item)
    return found, at


def _byte(data: Content, at: int) -> tuple[int, int]:
    if not 0 <= at < len(data):
        raise ValueError("a header is cut short")
    return data[at], at + 1


def _unsigned(data: Content, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte, at = _byte(data, at)
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value, at
        if shift > 63:
            raise ValueError("a header has a number that is too long")


def _integer(data: Content, at: int) -> tuple[int, int]:
    """A signed number: 0, -1, 1, -2 are written as 0, 1, 2, 3."""
    value, at = _unsigned(data, at)
    return (value >> 1) ^ -(value & 1), at
