"""Patterns of paths in a recording: ``*`` is any text within a level, ``**`` any text, ``?`` one character."""

import re
from collections.abc import Sequence

_IN_BRACKETS, _SLASH = re.compile(r"\[[^\[\]]*\]|\([^()]*\)"), "\0"
"""A slash of a unit, as in ``gyro_x [deg/s]``, parts no levels."""


def fitting(pattern: str, paths: Sequence[str]) -> list[str]:
    """The paths that a pattern fits, 2 before 10."""
    if pattern in paths:
        return [pattern]
    parts = [part for part in re.split(r"(\*\*|\*|\?)", pattern) if part]
    return sorted((path for path in paths if _fits(parts, path)), key=natural)


def _fits(parts: Sequence[str], path: str) -> bool:
    """Whether a pattern's parts fit a path, in a time that grows as the product of their lengths: a regular expression's may explode."""
    ends = {0}
    path = _IN_BRACKETS.sub(lambda unit: unit[0].replace("/", _SLASH), path)
    for part in parts:
        if part == "**":
            ends = set(range(min(ends), len(path) + 1))
        elif part == "*":
            ends = _within_level(ends, path)
        elif part == "?":
            ends = {end + 1 for end in ends if path[end : end + 1] not in ("", "/")}
        else:
            ends = {end + len(part) for end in ends if path[end : end + len(part)].replace(_SLASH, "/") == part}
        if not ends:
            return False
    return len(path) in ends


def _within_level(starts: set[int], path: str) -> set[int]:
    """Where any text without a slash may end that begins at one of these."""
    found, reached = set(), False
    for at in range(len(path) + 1):
        reached = at in starts or (reached and path[at - 1] != "/")
        if reached:
            found.add(at)
    return found


def natural(path: str) -> list[tuple[int, str]]:
    """Sorts x2 before x10."""
    return [(int(part), "") if part.isdecimal() and part.isascii() else (-1, part) for part in re.split(r"(\d+)", path)]
