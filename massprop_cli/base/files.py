"""Atomic writing of files in locked folders; partial files of a killed process are removed by the next one."""

import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from massprop_cli.base.errors import InputError

_LOCK = ".massprop.lock"
_BEGIN, _PARTIAL = ".massprop-", ".partial"
"""Prefix and suffix of partial files."""
_PATIENCE_S = 30.0
"""Timeout of a folder's lock, s. Writing takes less than a second."""


def text(path: Path, content: str) -> None:
    """Write UTF-8 text atomically."""
    whole(path, lambda temporary: save_text(temporary, content))


def whole(path: Path, save: Callable[[Path], object]) -> None:
    """Let ``save`` write a temporary file in the folder of ``path``, then move it to ``path``."""
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
        """Write text, bytes, or the output of a function to a temporary file; :class:`InputError` if a folder has its name."""
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
        """Move all files into place, in the order in which they were saved."""
        (self.folder / list(self._temporary)[-1]).unlink(missing_ok=True)
        for name, temporary in self._temporary.items():
            temporary.replace(self.folder / name)

    def clear(self) -> None:
        """Remove the temporary files that were not placed."""
        for temporary in self._temporary.values():
            temporary.unlink(missing_ok=True)


@contextmanager
def staged(folder: Path) -> Iterator[Staged]:
    """Write several files of a locked folder together; those not placed at the end are removed."""
    stage = Staged(folder)
    with writing(folder), held(folder):
        try:
            yield stage
        finally:
            stage.clear()


@contextmanager
def writing(place: Path, what: str = "folder", option: str = "out") -> Iterator[None]:
    """Turn an OSError of a write into an :class:`InputError` that names ``place``."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{place}: cannot be written ({error.strerror or error}); choose another {what}", option) from None


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Create a folder if necessary, and remove it again if it stays empty, as with a full disk."""
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
    """Create and lock a folder, and remove partial files of a killed process."""
    with made(folder), lock(folder / _LOCK, folder, _PATIENCE_S):
        for left in folder.glob(f"{_BEGIN}*{_PARTIAL}"):
            left.unlink(missing_ok=True)
        yield


def clear(folder: Path) -> None:
    """Remove the lock and partial files of a killed process; wait for a process that uses the folder."""
    if any(map(is_left_over, folder.iterdir())):
        with held(folder):
            pass


@contextmanager
def lock(file: Path, folder: Path, patience_s: float) -> Iterator[None]:
    """Hold a lock file, removed at the end; :class:`InputError` names the ``folder`` if another process holds it for ``patience_s``."""
    from filelock import FileLock, Timeout

    holding = FileLock(file, timeout=patience_s)
    try:
        holding.acquire()
    except Timeout:
        raise InputError(f"{folder}: another massprop is writing there; wait for it, or choose another folder", option="out") from None
    try:
        yield
    finally:
        with suppress(OSError):  # a system that cannot remove open files removes it on release
            file.unlink()
        holding.release()


def check_own(folder: Path, names: Iterable[str], mark: str) -> None:
    """Raise :class:`InputError` if files ``names`` exist that massprop did not write: neither the file ``mark`` nor a lock exists."""
    own = (folder / name for name in (_LOCK, mark, _LOCK))  # the lock again: another process may have started meanwhile
    foreign = [name for name in names if (folder / name).exists()]
    if foreign and not any(path.exists() for path in own):
        raise InputError(
            f"{folder / foreign[0]}: exists already, and massprop did not write it; move it, or choose another folder", option="out"
        )


def is_left_over(path: Path) -> bool:
    """Whether a file is a lock or a partial file."""
    return path.name == _LOCK or (path.name.startswith(_BEGIN) and path.name.endswith(_PARTIAL))


def check_name(log: str, shown: str | None = None) -> None:
    """Raise :class:`InputError` if a log's path is not valid UTF-8, which a result needs."""
    try:
        log.encode()
    except UnicodeEncodeError:
        raise InputError(f"{shown or log}: the file's name is not UTF-8; rename it") from None


def _temporary(folder: Path) -> Path:
    # independent of the final name, which may have the largest possible length
    handle, name = tempfile.mkstemp(prefix=_BEGIN, suffix=_PARTIAL, dir=folder)
    os.close(handle)
    return Path(name)


def save_text(path: Path, content: str) -> None:
    """Write UTF-8 text with the same bytes on every system."""
    path.write_text(content, encoding="utf-8", newline="\n")
