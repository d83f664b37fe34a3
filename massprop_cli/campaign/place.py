"""Output folder of a campaign. A result folder is complete or absent, even after a crash of the process or a power failure."""

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
"""Name of the folder that contains all result folders."""
_TABLES = ("campaign.parquet", "campaign.csv", "campaign.html", "campaign.json")
_ASIDE, _LOCK = ".partial", ".lock"


class Place(Protocol):
    """Output folder of a campaign. Paths are relative to it, with "/" separators; a result folder's path is ``results/NAME``."""

    def lock(self) -> AbstractContextManager[None]:
        """Lock the folder, and remove incomplete files of a killed batch; raise :class:`InputError` if another batch holds the lock."""

    def folders(self) -> Mapping[str, frozenset[str]]:
        """File names of each result folder, by its name."""

    def read(self, path: str) -> bytes:
        """Content of a file; raise FileNotFoundError if it does not exist."""

    def put_folder(self, name: str, files: Mapping[str, bytes]) -> None:
        """Write a complete result folder; it replaces an earlier one."""

    def put_file(self, path: str, content: Iterable[bytes]) -> None:
        """Write a complete file from its pieces; it replaces an earlier one."""


class LocalPlace:
    """A local folder: files go to a temporary folder in it first, and are renamed after a sync to the disk."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._aside = folder / _ASIDE

    @contextmanager
    def lock(self) -> Iterator[None]:
        """See :class:`Place`. The operating system releases the lock when this process ends."""
        check_own(self.folder, [name for name in _TABLES if not (self.folder / name).is_dir()], RESULTS)
        # create the results folder under the lock: a batch that is refused the lock would otherwise remove it while it is empty
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
        """See :class:`Place`. If the process is killed between the two renames, the folder is absent and the next batch repeats it."""
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
    """Write a file and sync it to the disk."""
    with path.open("wb") as file:
        file.writelines(content)
        file.flush()
        os.fsync(file.fileno())


def _sync(folder: Path) -> None:
    """Sync renames in a folder to the disk; Windows cannot open a folder for this."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
