"""What came, as it came: record.csv in the result's folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import BinaryIO

from massprop_cli.base import files
from massprop_cli.base.errors import InputError

RECORDED = "record.csv"


@contextmanager
def recording(folder: Path) -> Iterator[Callable[[str], None]]:
    """What keeps a line: it is in record.csv, whole, before this returns. Where nothing comes, neither file nor folder is made.

    :class:`InputError` where there is a recording already, or no room for one.
    """
    path = folder / RECORDED
    with ExitStack() as stack:
        with files.writing(path):
            stack.enter_context(files.made(folder))
            if path.exists():
                raise InputError(f"{path}: is there already, and a recording is not written over; choose another folder", option="out")
        opened = cache(lambda: stack.enter_context(path.open("xb", buffering=0)))

        def keep(line: str) -> None:
            with files.writing(path):
                _keep(opened(), path, line.encode("utf-8", "replace"))

        yield keep


def _keep(file: BinaryIO, path: Path, line: bytes) -> None:
    whole = file.tell()
    try:
        while line:
            line = line[file.write(line) :]
    except OSError as error:
        file.truncate(whole)
        if not whole:
            path.unlink()
            raise
        raise InputError(f"{path}: cannot be written ({error.strerror}); it holds what came before. Make room, and begin anew") from None
