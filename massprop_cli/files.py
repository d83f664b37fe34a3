"""Files that appear whole or not at all: written under a temporary name and moved into place."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from massprop_cli.errors import InputError


def text(path: Path, content: str) -> None:
    """Write UTF-8 text whole."""
    whole(path, lambda temporary: _save(temporary, content))


def whole(path: Path, save: Callable[[Path], object]) -> None:
    """Let ``save`` write a temporary file beside ``path``, then move it there."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        save(temporary)
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def check_name(log: str, shown: str | None = None) -> None:
    """:class:`InputError` where a log's path could not be written into a result."""
    try:
        log.encode()
    except UnicodeEncodeError:
        raise InputError(f"{shown or log}: the file's name is not UTF-8; rename it") from None


def _save(path: Path, content: str) -> None:
    path.write_text(content, encoding="utf-8", newline="\n")
