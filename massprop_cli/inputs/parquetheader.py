"""Uncompressed size of a Parquet file from its headers (github.com/apache/parquet-format, parquet.thrift).

Arrow trusts the headers and allocates what they state, and some crash its reader. massprop therefore counts first: cells from the footer,
values and bytes from each page header, which may differ. Headers use github.com/apache/thrift, thrift-compact-protocol.md.
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
"""Length of the file's end, bytes: length of the footer, and magic number."""
_TEXT = 6
"""Physical type BYTE_ARRAY; only FIXED_LEN_BYTE_ARRAY has other values longer than 16 bytes."""
_DATA, _DICTIONARY, _DATA_2 = 0, 2, 3
_BY_PREFIXES = 7
"""Encoding DELTA_BYTE_ARRAY."""
_DEEPEST, _LISTED = 16, 2**14
"""Maximum nesting of structs, and maximum length of a list in a header."""
_BINARY, _LIST, _SET, _STRUCT = 8, 9, 10, 12
_FIXED = {1: 1, 2: 1, 3: 1, 7: 8, 13: 16}
"""Length of a Boolean in a list, a byte, a double and a UUID, bytes."""
_Fields = Mapping[int, Any]


@dataclass(frozen=True)
class _Column:
    """Leaf column."""

    path: str
    kind: int
    width: int
    """Number of 8-byte words per value; 1 for text, which stays in its dictionary."""


class ParquetColumns:
    """Columns of a file, decompressed on demand. ValueError and Arrow's exceptions mean a damaged file."""

    def __init__(self, place: str, data: Content) -> None:
        # text stays in its dictionary, because one long text may occur in a million rows
        texts = checked(place, data)
        try:
            # pq.read_table() imports pyarrow.dataset and pandas, and its threads may abort the process at exit
            self._file = pq.ParquetFile(
                pa.BufferReader(pa.py_buffer(data)), pre_buffer=False, thrift_container_size_limit=_LISTED, read_dictionary=texts
            )
        except KeyError as error:
            raise ValueError(f"column {error} cannot be found") from None
        self.names: list[str] = self._file.schema_arrow.names
        self.rows: int = self._file.metadata.num_rows
        kinds = ((field.name, field.type) for field in self._file.schema_arrow)
        self.instants = {name: str(kind.unit) for name, kind in kinds if pa.types.is_timestamp(kind) or pa.types.is_duration(kind)}
        """Units (s, ms, us or ns) of columns with times."""
        self.metadata: Mapping[bytes, bytes] = self._file.schema_arrow.metadata or {}

    def column(self, name: str) -> Any:
        """Arrow's chunked array of a column with a unique name."""
        found = self._file.read(columns=[name], use_threads=False).column(name)
        if len(found) != self.rows:
            raise ValueError(f"column {name} has {len(found)} of {self.rows} rows")
        return found


def checked(place: str, data: Content) -> list[str]:
    """Paths of text columns, to read as dictionaries. Raises :class:`InputError` beyond the limits, ValueError for a damaged header."""
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
    """Leaf columns of a schema, which lists its tree depth first."""
    path: list[str] = []
    remaining: list[int] = []
    for element in schema[1:]:
        name = element.get(4)
        path.append(name.decode() if isinstance(name, bytes) else "")
        if _count(element, 5):
            remaining.append(_count(element, 5))
            continue
        yield _Column(".".join(path), _count(element, 1), max(1, -(-_count(element, 2) // 8)))
        path.pop()
        while remaining:
            remaining[-1] -= 1
            if remaining[-1]:
                break
            remaining.pop()
            path.pop()


def _check_pages(place: str, data: Content, columns: Sequence[_Column], groups: Sequence[_Fields]) -> None:
    cells = unpacked = pages = 0
    for group in groups:
        chunks = _structs(group, 1)
        if len(chunks) != len(columns):
            raise ValueError("its row groups have other columns than its schema")
        for column, chunk in zip(columns, chunks, strict=True):
            for kind, size, values, encoding in _pages(data, chunk):
                pages += 1
                unpacked += size
                cells += values * column.width
                limits.PAGES.check(place, pages)
                limits.NUMBERS.check(place, max(cells, unpacked // 8))
                if encoding == _BY_PREFIXES and kind != _DICTIONARY:
                    raise InputError(
                        f"{place}, column {column.path}: text packed as DELTA_BYTE_ARRAY, whose size cannot be known before it is "
                        "unpacked; drop the column, or write it with a dictionary"
                    )


def _pages(data: Content, chunk: _Fields) -> Iterator[tuple[int, int, int, int]]:
    """Kind, uncompressed size (bytes), number of values and encoding of each page of a column chunk, in Arrow's order."""
    metadata = chunk.get(3)
    if not isinstance(metadata, dict):
        raise ValueError("a column does not say where it is")
    at, dictionary = _count(metadata, 9), _count(metadata, 11)
    if 0 < dictionary < at:
        at = dictionary
    end, remaining = at + _count(metadata, 7), _count(metadata, 5)
    if end > len(data):
        raise ValueError("a column lies outside of the file")
    while remaining > 0 and at < end:
        fields, at = _struct(data, at)
        kind = _count(fields, 1)
        of_page = fields.get({_DATA: 5, _DICTIONARY: 7, _DATA_2: 8}.get(kind, 0))
        of_kind: _Fields = of_page if isinstance(of_page, dict) else {}
        values, packed = _count(of_kind, 1), _count(fields, 3)
        yield kind, _count(fields, 2), values, _count(of_kind, 4 if kind == _DATA_2 else 2)
        at += packed
        remaining -= values if kind in (_DATA, _DATA_2) else 0


def _count(fields: _Fields, number: int) -> int:
    """Count or size in a field; 0 if missing."""
    value = fields.get(number, 0)
    if not isinstance(value, int) or value < 0:
        raise ValueError("a header has a negative size")
    return value


def _structs(fields: _Fields, number: int) -> list[_Fields]:
    """List of structs in a field."""
    found = fields.get(number, [])
    if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
        raise ValueError("a header cannot be read")
    return found


def _struct(data: Content, at: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Fields of a struct by number (integers, bytes, structs and their lists, else None), and its end. Raises ValueError if damaged."""
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
        # the type of a Boolean field is its value
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
    # Parquet does not use maps
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
    """Signed integer in zigzag encoding: 0, -1, 1, -2 are stored as 0, 1, 2, 3."""
    value, at = _unsigned(data, at)
    return (value >> 1) ^ -(value & 1), at
