"""How large a Parquet file is once it is unpacked, told from its headers alone (github.com/apache/parquet-format, parquet.thrift).

A few kilobytes may say that they are a billion rows, or truly be that. Arrow believes what the headers say and allocates it, so it is
counted here before: cells by the footer, values and bytes by the header of every page, since the footer need not agree with those.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from massprop_cli import limits
from massprop_cli.errors import InputError

_TAIL = 8
"""Bytes at the end: the footer's length and the file's mark."""
_LISTED = 2**14
"""Most items of a list in the footer: a schema nested deeper would overflow Arrow's stack."""
_DATA, _DICTIONARY, _DATA_2 = 0, 2, 3
_BY_PREFIXES = 7
"""The encoding DELTA_BYTE_ARRAY."""
_DEEPEST = 16


@dataclass(frozen=True)
class _Page:
    """What a page's header says of it."""

    kind: int
    unpacked: int
    """Bytes."""
    packed: int
    """Bytes that follow the header."""
    values: int
    encoding: int


def checked(place: str, data: bytes) -> list[str]:
    """The file's columns of text; :class:`InputError` where more would be unpacked than the limits allow.

    ValueError or what Arrow raises where the file is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    footer_length = int.from_bytes(data[-_TAIL:-4], "little")
    if data[-4:] == b"PAR1" and footer_length < len(data):
        limits.FOOTER.check(place, footer_length)
    file = pq.ParquetFile(pa.BufferReader(data), pre_buffer=False, thrift_container_size_limit=_LISTED)
    footer, schema = file.metadata, file.schema
    limits.COLUMNS.check(place, footer.num_columns)
    groups = [footer.row_group(number) for number in range(footer.num_row_groups)]
    limits.NUMBERS.check(place, footer.num_columns * sum(max(group.num_rows, 0) for group in groups))
    cells = unpacked = pages = 0
    for group in groups:
        if group.num_columns != footer.num_columns:
            raise ValueError("its row groups have other columns than its schema")
        for number in range(group.num_columns):
            # of values with a length of their own, such as FIXED_LEN_BYTE_ARRAY, in numbers of 8 bytes
            width = -(-max(schema.column(number).length, 8) // 8)
            for page in _pages(data, group.column(number)):
                pages += 1
                unpacked += page.unpacked
                cells += page.values * width
                limits.PAGES.check(place, pages)
                limits.NUMBERS.check(place, max(cells, unpacked // 8))
                if page.encoding == _BY_PREFIXES and page.kind != _DICTIONARY:
                    name = schema.column(number).path
                    raise InputError(
                        f"{place}, column {name}: text packed as DELTA_BYTE_ARRAY, whose size can't be told before it is unpacked; "
                        "drop the column, or write it with a dictionary"
                    )
    return [schema.column(number).path for number in range(footer.num_columns) if schema.column(number).physical_type == "BYTE_ARRAY"]


def _pages(data: bytes, chunk: Any) -> Iterator[_Page]:
    """The pages of a column chunk, as Arrow would read them."""
    at = chunk.data_page_offset
    if chunk.dictionary_page_offset is not None and 0 < chunk.dictionary_page_offset < at:
        at = chunk.dictionary_page_offset
    end, left = at + chunk.total_compressed_size, chunk.num_values
    if not (0 <= at <= end <= len(data)) or left < 0:
        raise ValueError("a column lies outside of the file")
    while left > 0 and at < end:
        page, at = _page(data, at)
        yield page
        at += page.packed
        left -= page.values if page.kind in (_DATA, _DATA_2) else 0


def _page(data: bytes, at: int) -> tuple[_Page, int]:
    """A page's header, and where its content begins."""
    fields, at = _struct(data, at, 0)
    kind, unpacked, packed = (fields.get(number, 0) for number in (1, 2, 3))
    if not all(isinstance(value, int) and value >= 0 for value in (kind, unpacked, packed)):
        raise ValueError("a page with a negative size")
    said: Any = fields.get({_DATA: 5, _DICTIONARY: 7, _DATA_2: 8}.get(kind, 0), {})
    values = said.get(1, 0) if isinstance(said, dict) else 0
    encoding = said.get(4 if kind == _DATA_2 else 2, 0) if isinstance(said, dict) else 0
    if not (isinstance(values, int) and values >= 0):
        raise ValueError("a page with a negative number of values")
    return _Page(kind, unpacked, packed, values, encoding), at


def _struct(data: bytes, at: int, depth: int) -> tuple[dict[int, Any], int]:
    """Integers and structs of a Thrift struct by their number, in the compact protocol; whatever else is in it is passed over."""
    if depth > _DEEPEST:
        raise ValueError("a page header that is nested too deep")
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
        found[number], at = _value(data, at, kind, depth)


def _value(data: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    if kind in (1, 2):  # a truth value is told by its kind
        return None, at
    if kind in (4, 5, 6):
        return _integer(data, at)
    if kind == 12:
        return _struct(data, at, depth + 1)
    if kind == 8:
        length, at = _unsigned(data, at)
        return None, at + length
    if kind in (3, 7):
        return None, at + (1 if kind == 3 else 8)
    # a list, set or map: no page header of the format has one
    raise ValueError("a page header that can't be read")


def _byte(data: bytes, at: int) -> tuple[int, int]:
    if not 0 <= at < len(data):
        raise ValueError("a page header that is cut short")
    return data[at], at + 1


def _unsigned(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte, at = _byte(data, at)
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value, at
        if shift > 63:
            raise ValueError("a page header with a number that is too long")


def _integer(data: bytes, at: int) -> tuple[int, int]:
    """A signed number: 0, -1, 1, -2 are written as 0, 1, 2, 3."""
    value, at = _unsigned(data, at)
    return (value >> 1) ^ -(value & 1), at
