"""Dates and times as text: ISO 8601 and similar forms of loggers."""

import re
from typing import Any

from massprop_cli.base.lazy import pa, pc

_TIME = r"\d\d:\d\d:\d\d(?:[.,]\d{1,9})?"
_ZONE = r"\s*(?:Z|UTC|[+-]\d\d:?(?:\d\d)?)?"
_DATES = (r"\d{4}-\d\d-\d\d", r"\d{4}/\d\d/\d\d", r"\d{4}-\d{3}")
_INSTANT = re.compile(rf"\s*(?:(?:(?:{'|'.join(_DATES)})[ T])?{_TIME}|\d{{8}}T\d{{6}}(?:[.,]\d{{1,9}})?){_ZONE}\s*$", re.ASCII)
_LIKE = re.compile(r"\d[:/.-]\w+[:/.-]\d|\d:\d\d|\d\s*(AM|PM|s|sec|days?)\b|\d{8}T\d", re.IGNORECASE)
FORMS = (
    "a date and time is ISO 8601's, 2024-05-01T12:00:00.125 (or 2024/05/01, 2024-122; with Z, UTC or an offset), or 12:00:00.125 of one day"
)
_DAY_NS = 86_400 * 10**9


def is_instant(text: str) -> bool:
    """Whether a text is a date and time, or a time, in a form of :func:`instants`."""
    return _INSTANT.match(text) is not None


def is_like(text: str) -> bool:
    """Whether a text resembles a date or time in any form."""
    return _LIKE.search(text) is not None


def instants(text: Any) -> Any:
    """Arrow array of times, ns; None if a text is not a time or if forms differ."""
    plain = pc.replace_substring(pc.utf8_trim_whitespace(text), ",", ".")
    plain = pc.replace_substring_regex(plain, r"^(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)", r"\1-\2-\3T\4:\5:\6")
    plain = pc.replace_substring_regex(plain, r"^(\d{4})/(\d\d)/(\d\d)", r"\1-\2-\3")
    plain = pc.replace_substring_regex(plain, r"\s*(UTC|Z)$", "Z")
    plain = pc.if_else(pc.match_substring_regex(plain, r"^\d\d:"), pc.binary_join_element_wise("1970-01-01", plain, " "), plain)
    day = pc.struct_field(pc.extract_regex(plain, r"^\d{4}-(?P<day>\d{3})[ T]"), "day")
    if day.null_count == plain.null_count < len(plain):
        return _of_days(pc.replace_substring_regex(plain, r"^(\d{4})-\d{3}", r"\1-01-01"), day.cast(pa.int64()))
    return _cast(plain)


def _cast(text: Any) -> Any:
    """Times from texts with month and day; None if a text is not a time, or if only some have a time zone."""
    for kind in (pa.timestamp("ns", "UTC"), pa.timestamp("ns")):
        try:
            return text.cast(kind)
        except pa.ArrowException:
            continue
    return None


def _of_days(begun: Any, day: Any) -> Any:
    """Times from texts on 1 January with the day of the year added; None if a year has no such day."""
    first = _cast(begun)
    if first is None:
        return None
    found = pc.add(first, pc.multiply(pc.subtract(day, 1), _DAY_NS).cast(pa.duration("ns")))
    return found if pc.all(pc.equal(pc.year(found), pc.year(first))).as_py() else None
