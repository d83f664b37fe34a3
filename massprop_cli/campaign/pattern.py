"""Patterns of paths, as a shell has them."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import PurePosixPath

ANY = "**"
"""Fits any number of folders."""


def fitting(files: Sequence[str], pattern: str) -> list[str]:
    """Of these paths those that fit a pattern, and those in folders that do.

    "*" fits within one part of a path, "**" any number of folders, neither what begins with a dot.
    """
    wanted = PurePosixPath(pattern).parts
    return [file for file in files if _fits(file.split("/"), wanted)]


def _fits(parts: Sequence[str], wanted: Sequence[str]) -> bool:
    """Whether a file, or a folder that it is in, fits; in a time that grows as path times pattern."""
    reached = [n == 0 for n in range(len(parts) + 1)]  # how many parts of the path may have been fitted so far
    for n, one in enumerate(wanted):
        if True not in reached:
            return False
        if one == ANY:
            # the last one is all that lies below; another leaves the path's own name
            first = reached.index(True)
            reached = [at >= first and (at < len(parts) or n == len(wanted) - 1) for at in range(len(parts) + 1)]
        else:
            reached = [False, *(reached[at] and _is(part, one) for at, part in enumerate(parts))]
    return any(reached)


def _is(part: str, wanted: str) -> bool:
    return (wanted.startswith(".") or not part.startswith(".")) and fnmatchcase(part, wanted)
