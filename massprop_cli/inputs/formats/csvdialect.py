"""CSV dialects of spreadsheets and loggers: compressed, UTF-16, other delimiters, decimal commas."""

import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError
from massprop_cli.base.lazy import pa, pc
from massprop_cli.base.spill import Content

_GZIP = b"\x1f\x8b"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_PREFACE = re.compile(rb"(?:\xef\xbb\xbf)?(?:(?:#|sep=)[^\n]*\n)+", re.IGNORECASE)
"""Comments before the header, and a spreadsheet's line that states the delimiter."""
_PREFACE_MOST = 2**16
_NAMED, _NUMBER = re.compile(rb"#+[ \t]*"), re.compile(rb"\s*[+-]?\.?\d")
_BLANK_END = re.compile(rb"(?:\r?\n[ \t,;|]*)+\Z")
"""Lines of delimiters only at the end of a file, as from empty rows of a spreadsheet."""
_DECIMALS = {mark: rf"^\s*[+-]?(\d+[{mark}]\d*|[{mark}]\d+)([eE][+-]?\d+)?\s*$" for mark in (",", ".")}
"""Numbers with a decimal comma, and with a decimal point."""


def utf8(path: Path, data: Content) -> Content:
    """Text as UTF-8, decompressed within the limit of a log."""
    if data[:2] == _GZIP:
        data = _unpacked(path, bytes(data))
    if data[:2] in _UTF16:
        try:
            return str(data, "utf-16").encode()
        except UnicodeError as error:
            raise InputError(f"{path}: not a readable CSV file ({error}); save the log as UTF-8 text") from None
    return data


def body(data: Content) -> tuple[Content, int]:
    """Text from the header to the last row, and the number of lines before it. NumPy writes the header as the last comment."""
    before = _PREFACE.match(data[:_PREFACE_MOST])
    end = data[-_PREFACE_MOST:]
    blank = _BLANK_END.search(end)
    empty = len(end) - blank.start() if blank and len(blank[0].strip(b"\r\n")) else 0
    if before is None and not empty:
        return data, 0
    first = lines = 0
    if before is not None:
        first, lines = before.end(), before[0].count(b"\n")
        last = before[0].rindex(b"\n", 0, -1) + 1 if lines > 1 else len(before[0]) - len(before[0].lstrip(b"\xef\xbb\xbf"))
        named = _NAMED.match(before[0], last)
        if named and _NUMBER.match(data[first : first + _PREFACE_MOST]):
            first, lines = named.end(), lines - 1
    return data[first : len(data) - empty] + b"\n", lines


def _unpacked(path: Path, data: bytes) -> bytes:
    most = limits.LOG.most
    parts, size = [], 0
    while data:
        unpack = zlib.decompressobj(wbits=31)
        try:
            part = unpack.decompress(data, most + 1 - size)
        except zlib.error as error:
            raise InputError(f"{path}: not a readable gzip file ({error}); copy it again from the recorder") from None
        size += len(part)
        limits.LOG.check(f"{path}, unpacked", size)
        if not unpack.eof:
            raise InputError(f"{path}: not a readable gzip file (it ends too early); copy it again from the recorder")
        parts.append(part)
        data = unpack.unused_data
    return b"".join(parts)


def delimiter(header: str) -> str:
    """Delimiter of a header line: the most frequent of comma, tab, semicolon and bar."""
    return max(",\t;|", key=header.count) if header.strip() else ","


def with_points(path: Path, table: Any, cut: str, place: Callable[[int], str]) -> Any:
    """Table of texts with decimal points. Raises :class:`InputError` if commas and points occur, because "1.234" is ambiguous."""
    if cut == ",":
        return table

    first: dict[str, tuple[str, int]] = {}
    columns = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        at = {mark: pc.index(pc.match_substring_regex(column, pattern), True).as_py() for mark, pattern in _DECIMALS.items()}
        first |= {mark: (name, row) for mark, row in at.items() if row >= 0 and mark not in first}
        columns.append(pc.replace_substring(column, ",", ".") if at[","] >= 0 else column)
    if len(first) == 2:
        (one, at_one), (other, at_other) = first[","], first["."]
        raise InputError(
            f"{path}: {place(at_one)}, column {one}, has a decimal comma, {place(at_other)}, column {other}, a point; write all with one"
        )
    return pa.table(columns, names=[str(n) for n in range(len(columns))]).rename_columns(table.column_names)
