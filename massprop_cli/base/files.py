"""Files that appear whole or not at all, in folders that a lock of the kernel holds; what a killed process left, the next one clears."""

import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from massprop_cli.base.errors import InputError

_LOCK = ".massprop.lock"
_BEGIN, _PARTIAL = ".massprop-", ".partial"
"""How the name of what is not whole yet begins and ends."""
_PATIENCE_S = 30.0
"""Writing takes less than a second; who holds a folder for longer than this is stuck."""


def text(path: Path, content: str) -> None:
    """Write UTF-8 text whole."""
    whole(path, lambda temporary: save_text(temporary, content))


def whole(path: Path, save: Callable[[Path], object]) -> None:
    """Let ``save`` write a temporary file beside ``path``, then move it there."""
    temporary = _temporary(path.parent)
    try:
        save(temporary)
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


class Staged:
    """Several files of a folder that belong together. The last is the mark that all are there: it goes first and comes last."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._temporary: dict[str, Path] = {}

    def save(self, name: str, content: str | bytes | Callable[[Path], object]) -> None:
        """Write a file aside: text, bytes, or what a function writes; :class:`InputError` where a folder of its name is in the way."""
        if (self.folder / name).is_dir():
            raise InputError(f"{self.folder / name}: is a folder; nothing was written. Move it, or choose another folder", option="out")
        self._temporary[name] = temporary = _temporary(self.folder)
        if isinstance(content, str):
            save_text(temporary, content)
        elif isinstance(content, bytes):
            temporary.write_bytes(content)
        else:
            content(temporary)
        temporary.chmod(0o644)

    def place(self) -> None:
        """Move all into place, in the order in which they were saved."""
        (self.folder / list(self._temporary)[-1]).unlink(missing_ok=True)
        for name, temporary in self._temporary.items():
            temporary.replace(self.folder / name)

    def clear(self) -> None:
        """Remove what was not placed."""
        for temporary in self._temporary.values():
            temporary.unlink(missing_ok=True)


@contextmanager
def staged(folder: Path) -> Iterator[Staged]:
    """Files of a folder, which is held meanwhile, to write together; what is not placed in the end is gone."""
    stage = Staged(folder)
    with writing(folder), held(folder):
        try:
            yield stage
        finally:
            stage.clear()


@contextmanager
def writing(place: Path, what: str = "folder", option: str = "out") -> Iterator[None]:
    """:class:`InputError` where a file, or a folder, can't be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{place}: cannot be written ({error.strerror or error}); choose another {what}", option) from None


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a folder where there is none; if it stays empty, because the disk is full for instance, it is removed again."""
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for path in new:
            with suppress(OSError):
                path.rmdir()


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Make a folder, hold it against other processes, and clear what a killed process left half-written."""
    with made(folder), lock(folder / _LOCK, folder, _PATIENCE_S):
        for left in folder.glob(f"{_BEGIN}*{_PARTIAL}"):
            left.unlink(missing_ok=True)
        yield


def clear(folder: Path) -> None:
    """Clear what a killed process left in a folder that isn't written to now; a process that is at work there is waited for."""
    if any(map(is_left_over, folder.iterdir())):
        with held(folder):
            pass


@contextmanager
def lock(file: Path, folder: Path, patience_s: float) -> Iterator[None]:
    """Hold a lock on a file, which is removed in the end; :class:`InputError` names the ``folder`` where another holds it for too long."""
    from filelock import FileLock, Timeout

    holding = FileLock(file, timeout=patience_s)
    try:
        holding.acquire()
    except Timeout:
        raise InputError(f"{folder}: another massprop is at work there; wait for it, or choose another folder", option="out") from None
    try:
        yield
    finally:
        with suppress(OSError):  # where the system does not remove open files, the release does
            file.unlink()
        holding.release()


def check_own(folder: Path, names: Iterable[str], mark: str) -> None:
    """:class:`InputError` where files are someone's own: massprop's have the ``mark`` beside them, or the lock of a process."""
    own = (folder / name for name in (_LOCK, mark, _LOCK))  # the lock again: its process may just have set to work
    foreign = [name for name in names if (folder / name).exists()]
    if foreign and not any(path.exists() for path in own):
        raise InputError(
            f"{folder / foreign[0]}: is there already, and massprop did not write it; move it, or choose another folder", option="out"
        )


def is_left_over(path: Path) -> bool:
    """Whether a file is a killed process's lock, or what it had not written whole."""
    return path.name == _LOCK or (path.name.startswith(_BEGIN) and path.name.endswith(_PARTIAL))


def check_name(log: str, shown: str | None = None) -> None:
    """:class:`InputError` where a log's path could not be written into a result."""
    try:
        log.encode()
    except UnicodeEncodeError:
        raise InputError(f"{shown or log}: the file's name is not UTF-8; rename it") from None


def _temporary(folder: Path) -> Path:
    # not after the file that it becomes, whose name may be as long as a name can be
    handle, name = tempfile.mkstemp(prefix=_BEGIN, suffix=_PARTIAL, dir=folder)
    os.close(handle)
    return Path(name)


def save_text(path: Path, content: str) -> None:
    """UTF-8, the same bytes on every system."""
    path.write_text(content, encoding="utf-8", newline="\n")
