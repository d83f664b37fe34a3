"""Where a campaign's results go. A result folder appears whole or not at all, whatever happens to the process or the machine."""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Protocol

from massprop_cli.base import files
from massprop_cli.base.errors import InputError
from massprop_cli.base.files import check_own
from massprop_cli.campaign import outcome

RESULTS = "results"
"""Folder of all result folders."""
_TABLES = ("campaign.parquet", "campaign.csv", "campaign.html", "campaign.json")
_ASIDE, _LOCK = ".partial", ".lock"


class Place(Protocol):
    """A folder somewhere. Paths in it are relative, with "/" between their parts; a result folder's path is ``results/NAME``."""

    def lock(self) -> AbstractContextManager[None]:
        """Hold the place against other batches; :class:`InputError` where one is at work. What a killed one left half is cleared."""

    def folders(self) -> Mapping[str, frozenset[str]]:
        """The result folders in place, by name, with the names of their files."""

    def read(self, path: str) -> bytes:
        """A file's content; FileNotFoundError where there is none."""

    def put_folder(self, name: str, files: Mapping[str, bytes]) -> None:
        """Put a result folder in place of the one that may be there, whole."""

    def put_file(self, path: str, content: Iterable[bytes]) -> None:
        """Put a file in place, whole, from its pieces."""


class LocalPlace:
    """A folder on this machine: everything is written aside in it, synced to the disk, and renamed into place."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._aside = folder / _ASIDE

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Held by the kernel for as long as this process lives, so a killed batch leaves none behind."""
        check_own(self.folder, [name for name in _TABLES if not (self.folder / name).is_dir()], RESULTS)
        # the folder of results under the lock: who is turned away would clear it away while it is empty
        with (
            files.writing(self.folder),
            files.made(self.folder),
            files.lock(self.folder / _LOCK, self.folder, 0.0),
            files.made(self.folder / RESULTS),
        ):
            taken = [name for name in _TABLES if (self.folder / name).is_dir()]
            if taken:
                raise InputError(f"{self.folder / taken[0]}: is a folder; move it, or choose another folder", option="out")
            try:
                shutil.rmtree(self._aside, ignore_errors=True)
                self._aside.mkdir()
                yield
            finally:
                shutil.rmtree(self._aside, ignore_errors=True)

    def folders(self) -> dict[str, frozenset[str]]:
        """See :class:`Place`."""
        results = [path for path in (self.folder / RESULTS).iterdir() if path.is_dir()]
        return {path.name: frozenset(file.name for file in path.iterdir()) for path in results}

    def read(self, path: str) -> bytes:
        """See :class:`Place`."""
        return (self.folder / path).read_bytes()

    def put_folder(self, name: str, files: Mapping[str, bytes]) -> None:
        """See :class:`Place`. Killed between the two renames, the folder is missing, and the next batch makes it again."""
        place = self.folder / RESULTS / name
        if place.is_dir():
            check_own(place, [path.name for path in place.iterdir()], outcome.FILE)
        staged = Path(tempfile.mkdtemp(dir=self._aside))
        staged.chmod(0o755)
        for file, content in files.items():
            _save(staged / file, [content])
        _sync(staged)
        if place.exists():
            place.rename(Path(tempfile.mkdtemp(dir=self._aside)) / "old")
        staged.rename(place)
        _sync(place.parent)

    def put_file(self, path: str, content: Iterable[bytes]) -> None:
        """See :class:`Place`."""
        handle, name = tempfile.mkstemp(dir=self._aside)
        os.close(handle)
        staged = Path(name)
        _save(staged, content)
        staged.chmod(0o644)
        staged.replace(self.folder / path)
        _sync((self.folder / path).parent)


def _save(path: Path, content: Iterable[bytes]) -> None:
    with path.open("wb") as file:
        file.writelines(content)
        file.flush()
        os.fsync(file.fileno())


def _sync(folder: Path) -> None:
    """Make renames in a folder last through a power cut, where a folder can be opened at all (on Windows none can)."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
