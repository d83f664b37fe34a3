"""Results at a URL. Stores have no rename, so a result folder counts only with the object that is written last, outcome.json."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from massprop_cli.base.errors import InputError
from massprop_cli.campaign import location, outcome, remote
from massprop_cli.campaign.lease import Lease
from massprop_cli.campaign.place import RESULTS, LocalPlace, Place

LOCK = ".lock"


def at(out: str) -> Place:
    """The place that is named: a folder of this machine, or a URL."""
    if not location.is_url(out):
        return LocalPlace(Path(out))
    if out.startswith(("file://", "local://")):
        return LocalPlace(Path(remote.store(out)[1]))
    return UrlPlace(out)


class UrlPlace:
    """A folder of a store: objects below a URL, byte for byte what a local folder would hold."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self._lease = Lease(self._of(LOCK))

    @contextmanager
    def lock(self) -> Iterator[None]:
        """See :class:`massprop_cli.campaign.place.Place`, and :mod:`massprop_cli.campaign.lease`."""
        files, path = remote.store(self.url)
        bucket = path.strip("/").split("/")[0]
        with remote.told(self.url, "bucket"):
            # writing would make a bucket that is misspelt in some stores, and in others fail with less to say
            if "/" not in path[:1] and not files.exists(bucket):
                raise InputError(f"{self.url}: no bucket {bucket!r} that these credentials may use; create it, or mend the URL")
        with self._lease.held():
            yield

    def folders(self) -> dict[str, frozenset[str]]:
        """See :class:`massprop_cli.campaign.place.Place`."""
        found: dict[str, set[str]] = {}
        for file in remote.below(self._of(RESULTS)):
            name, _, rest = file.partition("/")
            found.setdefault(name, set()).add(rest)
        return {name: frozenset(files) for name, files in found.items()}

    def read(self, path: str) -> bytes:
        """See :class:`massprop_cli.campaign.place.Place`."""
        found = remote.content(self._of(path))
        if found is None:
            raise FileNotFoundError(self._of(path))
        return found

    def put_folder(self, name: str, files: Mapping[str, bytes]) -> None:
        """See :class:`massprop_cli.campaign.place.Place`. outcome.json goes first and comes last; killed in between, it is missing."""
        folder = f"{RESULTS}/{name}"
        there = remote.below(self._of(folder))
        for file in sorted(set(there) & {outcome.FILE}) + sorted(set(there) - set(files) - {outcome.FILE}):
            self._lease.check()
            remote.asked(self._of(f"{folder}/{file}"), "file", lambda store, path: store.rm_file(path))
        for file in sorted(files, key=lambda file: (file == outcome.FILE, file)):
            self.put_file(f"{folder}/{file}", [files[file]])

    def put_file(self, path: str, content: Iterable[bytes]) -> None:
        """See :class:`massprop_cli.campaign.place.Place`. Stores put an object in place whole."""
        self._lease.check()
        whole = b"".join(content)
        remote.asked(self._of(path), "bucket", lambda store, place: _put(store, place, whole))

    def _of(self, path: str) -> str:
        return location.join(self.url, path)


def _put(store: Any, path: str, content: bytes) -> None:
    try:
        store.pipe_file(path, content)
    except FileNotFoundError:  # where folders must be made first
        store.makedirs(path.rpartition("/")[0], exist_ok=True)
        store.pipe_file(path, content)
