"""How large a Parquet file is once it is unpacked, by its headers alone (github.com/apache/parquet-format, parquet.thrift).

Arrow believes what the headers say and allocates it, and some end the whole process in Arrow's own reader. So it is counted here before:
cells by the footer, values and bytes by the header of every page, since the footer need not agree with those. Headers are in Thrift's
compact protocol (github.com/apache/thrift, thrift-compact-protocol.md).
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from massprop_cli.base import limits
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.lazy import pa, pq
from massprop_cli.base.spill import Content

_MARK = b"PAR1"
_TAIL = 8
"""Bytes at the end: the footer's length and the file's mark."""
_TEXT = 6
"""The physical type BYTE_ARRAY; the only other whose values may be longer than two numbers is FIXED_LEN_BYTE_ARRAY."""
_DATA, _DICTIONARY, _DATA_2 = 0, 2, 3
_BY_PREFIXES = 7
"""The encoding DELTA_BYTE_ARRAY."""
_DEEPEST, _LISTED = 16, 2**14
"""Levels of structs, and items of a list, that a header may have."""
_BINARY, _LIST, _SET, _STRUCT = 8, 9, 10, 12
_FIXED = {1: 1, 2: 1, 3: 1, 7: 8, 13: 16}
"""Bytes of a truth value in a list, a byte, a double and a UUID."""
_Fields = Mapping[int, Any]


@dataclass(frozen=True)
class _Column:
    """A column without columns below it."""

    path: str
    kind: int
    width: int
    """Numbers of 8 bytes that a value takes; of text one, as it stays in its dictionary."""


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


class ParquetColumns:
    """A file's columns, each unpacked when it is asked for. What Arrow raises, and ValueError, say that the file is damaged."""

    def __init__(self, place: str, data: Content) -> None:
        # text stays in its dictionary: one long text on a million rows would be as many texts
        texts = checked(place, data)
        try:
            # pq.read_table() would import pyarrow.dataset and with it pandas, and its threads may abort the process at exit
            self._file = pq.ParquetFile(
                pa.BufferReader(pa.py_buffer(data)), pre_buffer=False, thrift_container_size_limit=_LISTED, read_dictionary=texts
            )
        except KeyError as error:
            raise ValueError(f"column {error} cannot be found") from None
        self.names: list[str] = self._file.schema_arrow.names
        self.rows: int = self._file.metadata.num_rows
        kinds = ((field.name, field.type) for field in self._file.schema_arrow)
        self.instants = {name: str(kind.unit) for name, kind in kinds if pa.types.is_timestamp(kind) or pa.types.is_duration(kind)}
        """Columns of times, with their units: s, ms, us or ns."""
        self.metadata: Mapping[bytes, bytes] = self._file.schema_arrow.metadata or {}

    def column(self, name: str) -> Any:
        """Arrow's chunked array of a column whose name no other has."""
        found = self._file.read(columns=[name], use_threads=False).column(name)
        if len(found) != self.rows:
            raise ValueError(f"column {name} has {len(found)} of {self.rows} rows")
        return found


def checked(place: str, data: Content) -> list[str]:
    """Paths of text columns, to be read as dictionaries; :class:`InputError` beyond the limits, ValueError for a damaged header."""
    length = int.from_bytes(data[-_TAIL:-4], "little")
    if len(data) < _TAIL + len(_MARK) or data[-4:] != _MARK or length > len(data) - _TAIL:
        raise ValueError("it does not end as one")
    limits.FOOTER.check(place, length)
    footer, _ = _struct(data[len(data) - _TAIL - length : len(data) - _TAIL], 0)
    columns = list(_columns(_structs(footer, 2)))
    groups = _structs(footer, 4)
    limits.COLUMNS.check(place, len(columns))
    limits.NUMBERS.check(place, len(columns) * sum(_count(group, 3) for group in groups))
    _check_pages(place, data, columns, groups)
    return [column.path for column in columns if column.kind == _TEXT]


def _columns(schema: Sequence[_Fields]) -> Iterator[_Column]:
    """The leaves of a schema, which lists a tree depth first."""
    path: list[str] = []
    left: list[int] = []
    for element in schema[1:]:
        name = element.get(4)
        path.append(name.decode() if isinstance(name, bytes) else "")
        if _count(element, 5):
            left.append(_count(element, 5))
            continue
        yield _Column(".".join(path), _count(element, 1), max(1, -(-_count(element, 2) // 8)))
        path.pop()
        while left:
            left[-1] -= 1
            if left[-1]:
                break
            left.pop()
            path.pop()


def _check_pages(place: str, data: Content, columns: Sequence[_Column], groups: Sequence[_Fields]) -> None:
    cells = unpacked = pages = 0
    for group in groups:
        chunks = _structs(group, 1)
        if len(chunks) != len(columns):
            raise ValueError("its row groups have other columns than its schema")
        for column, chunk in zip(columns, chunks, strict=True):
            for page in _pages(data, chunk):
                pages += 1
                unpacked += page.unpacked
                cells += page.values * column.width
                limits.PAGES.check(place, pages)
                limits.NUMBERS.check(place, max(cells, unpacked // 8))
                if page.encoding == _BY_PREFIXES and page.kind != _DICTIONARY:
                    raise InputError(
                        f"{place}, column {column.path}: text packed as DELTA_BYTE_ARRAY, whose size cannot be known before it is "
                        "unpacked; drop the column, or write it with a dictionary"
                    )


def _pages(data: Content, chunk: _Fields) -> Iterator[_Page]:
    """The pages of a column chunk, as Arrow would read them."""
    said = chunk.get(3)
    if not isinstance(said, dict):
        raise ValueError("a column does not say where it is")
    at, dictionary = _count(said, 9), _count(said, 11)
    if 0 < dictionary < at:
        at = dictionary
    end, left = at + _count(said, 7), _count(said, 5)
    if end > len(data):
        raise ValueError("a column lies outside of the file")
    while left > 0 and at < end:
        page, at = _page(data, at)
        yield page
        at += page.packed
        left -= page.values if page.kind in (_DATA, _DATA_2) else 0


def _page(data: Content, at: int) -> tuple[_Page, int]:
    """A page's header, and where its content begins."""
    fields, at = _struct(data, at)
    kind = _count(fields, 1)
    said = fields.get({_DATA: 5, _DICTIONARY: 7, _DATA_2: 8}.get(kind, 0))
    of_kind: _Fields = said if isinstance(said, dict) else {}
    encoding = _count(of_kind, 4 if kind == _DATA_2 else 2)
    return _Page(kind, _count(fields, 2), _count(fields, 3), _count(of_kind, 1), encoding), at


def _count(fields: _Fields, number: int) -> int:
    """A field that is a count or a size, 0 where it is missing."""
    value = fields.get(number, 0)
    if not isinstance(value, int) or value < 0:
        raise ValueError("a header has a negative size")
    return value


def _structs(fields: _Fields, number: int) -> list[_Fields]:
    """A field that is a list of structs."""
    found = fields.get(number, [])
    if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
        raise ValueError("a header cannot be read")
    return found


def _struct(data: Content, at: int, depth: int = 0) -> tuple[dict[int, Any], int]:
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
        return _struct(data, at, depth + 1)
    if kind in (_LIST, _SET):
        return _list(data, at, depth)
    if kind in _FIXED:
        return None, at + _FIXED[kind]
    # Parquet has no maps
    raise ValueError("a header has a field of unknown kind")


def _list(data: Content, at: int, depth: int) -> tuple[list[Any], int]:
    head, at = _byte(data, at)
    length, at = _unsigned(data, at) if head >> 4 == 15 else (head >> 4, at)
    if length > _LISTED:
        raise ValueError(f"a header lists more than {_LISTED} items")
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
