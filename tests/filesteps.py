"""A process that ends itself at one of its steps with files: opening to write, renaming, removing, making folders."""

import os
import shutil
import sys
from pathlib import Path
from typing import Any

STEPS = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.chmod", "os.truncate")


def end(folder: Path, step: int, signal_number: int) -> None:
    """From now on this process sends itself a signal before it takes the given step below the folder, counted from 1."""
    steps = _Steps(folder)

    def take(event: str, arguments: tuple[Any, ...]) -> None:
        if steps.take(event, arguments) and steps.taken == step:
            os.kill(os.getpid(), signal_number)

    sys.addaudithook(take)


def count(folder: Path, into: Path) -> None:
    """From now on this process counts its steps below the folder; a line of a file for each."""
    steps, file = _Steps(folder), os.open(into, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)

    def take(event: str, arguments: tuple[Any, ...]) -> None:
        if steps.take(event, arguments):
            os.write(file, f"{event} {arguments[0]}\n".encode())

    sys.addaudithook(take)


class _Steps:
    def __init__(self, folder: Path) -> None:
        self.folder, self.taken = folder, 0

    def take(self, event: str, arguments: tuple[Any, ...]) -> bool:
        """Whether it is a step, which counts."""
        if event == "open":
            writes = isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        else:
            writes = event in STEPS
        if not writes or not isinstance(arguments[0], str | os.PathLike):
            return False
        path = os.fspath(arguments[0])
        inside = not Path(path).is_absolute() or Path(path).is_relative_to(self.folder)
        self.taken += inside
        return inside


def vanish(folder: Path, step: int, below: str) -> None:
    """A folder below this one is gone before the given step."""
    steps = _Steps(folder)

    def take(event: str, arguments: tuple[Any, ...]) -> None:
        if steps.taken < step and steps.take(event, arguments) and steps.taken == step:
            shutil.rmtree(folder / below, ignore_errors=True)

    sys.addaudithook(take)
