"""Output folder of a campaign at a URL. Stores have no rename, so a result folder is valid only with outcome.json, which is written last.

The lock is an object with a token and a renewal count, which its holder increments periodically. Another batch watches the object for
longer than the renewal interval, and takes over a lock that does not change; this needs no common clock. A batch that reads another token
stops before its next write. This also covers stores whose "create" replaces an existing object.
"""

import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from massprop_cli.base.errors import InputError
from massprop_cli.campaign import location, outcome, remote
from massprop_cli.campaign.place import RESULTS, LocalPlace, Place

RENEWED_S, SILENT_S = 10.0, 35.0
"""Renewal interval of the lock, and the time without renewal after which another batch takes it over, s."""
_POLL_S = 2.0
"""Longest time between two reads of a watched lock, s."""


class Lease:
    """The lock object at a URL."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._token = uuid.uuid4().hex
        self._lost = False

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold the lock, and renew it in a thread; raise :class:`InputError` if another batch holds it."""
        with remote.opened(self.url, "folder") as (files, path):
            self._take(files, path)
        stop = threading.Event()
        renewing = threading.Thread(target=self._renew, args=(files, path, stop), daemon=True)
        renewing.start()
        try:
            yield
        finally:
            stop.set()
            renewing.join()
            with suppress(Exception):
                if self._has_token(remote.content_at(files, path)):
                    files.rm_file(path)

    def check(self) -> None:
        """Raise :class:`InputError` if another batch took the lock over."""
        if self._lost:
            raise InputError(f"{self.url}: another batch took over, since this one could not renew its lock; wait for it, then run again")

    def _take(self, files: Any, path: str) -> None:
        """Create the lock object, after the removal of one without renewals; raise :class:`InputError` if it is renewed."""
        while not self._create(files, path):
            content = remote.content_at(files, path)
            if content is not None and self._is_alive(files, path, content):
                raise InputError(
                    f"{self.url}: another batch is writing there ({_holder(content)}); wait for it, or choose another folder",
                    option="out",
                )
            if content is not None and remote.content_at(files, path) == content:
                files.rm_file(path)

    def _create(self, files: Any, path: str) -> bool:
        """Create the lock object; return whether this batch holds it."""
        if remote.content_at(files, path) is not None:
            return False
        with suppress(Exception):  # if the store refuses because the object exists, the reads below show it
            files.pipe_file(path, self._content(0), mode="create")
            return self._has_token(remote.content_at(files, path))
        if remote.content_at(files, path) is None:
            files.pipe_file(path, self._content(0))  # for a store without exclusive creation; any other error occurs again here
        return self._has_token(remote.content_at(files, path))

    def _is_alive(self, files: Any, path: str, content: bytes) -> bool:
        """Whether the lock's content changes within :data:`SILENT_S`."""
        until = time.monotonic() + SILENT_S
        while time.monotonic() < until:
            time.sleep(min(_POLL_S, SILENT_S / 4))
            now = remote.content_at(files, path)
            if now is None:
                return False
            if now != content:
                return True
        return False

    def _renew(self, files: Any, path: str, stop: threading.Event) -> None:
        """Renew the lock until ``stop`` is set or another batch has taken it over."""
        renewals = 0
        while not stop.wait(RENEWED_S):
            renewals += 1
            with suppress(Exception):  # retry after the next interval if the store is temporarily unavailable
                if not self._has_token(remote.content_at(files, path)):
                    self._lost = True
                    return
                files.pipe_file(path, self._content(renewals))

    def _content(self, renewals: int) -> bytes:
        holder = {"token": self._token, "host": socket.gethostname(), "process": os.getpid(), "renewals": renewals}
        return (json.dumps(holder) + "\n").encode()

    def _has_token(self, content: bytes | None) -> bool:
        """Whether the lock object is from this batch."""
        return content is not None and self._token.encode() in content


def _holder(content: bytes) -> str:
    """The process and host in a lock object, for messages."""
    try:
        holder = json.loads(content)
        return f"process {holder['process']} on {holder['host']}"
    except (ValueError, KeyError, TypeError):
        return "whose is unknown"


LOCK = ".lock"


def at(out: str) -> Place:
    """The output folder at a local path or a URL."""
    if not location.is_url(out):
        return LocalPlace(Path(out))
    if out.startswith(("file://", "local://")):
        return LocalPlace(Path(remote.store(out)[1]))
    return UrlPlace(out)


class UrlPlace:
    """A folder of an object store, with the same files as a local folder."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self._lease = Lease(self._url_of(LOCK))

    @contextmanager
    def lock(self) -> Iterator[None]:
        """See :class:`massprop_cli.campaign.place.Place`, and :mod:`massprop_cli.campaign.urlplace`."""
        with remote.opened(self.url, "bucket") as (files, path):
            bucket = path.strip("/").split("/")[0]
            # check first: on a write, some stores create a misspelt bucket, and others give an unclear error
            if "/" not in path[:1] and not files.exists(bucket):
                raise InputError(f"{self.url}: no bucket {bucket!r} that these credentials may use; create it, or correct the URL")
        with self._lease.held():
            yield

    def folders(self) -> dict[str, frozenset[str]]:
        """See :class:`massprop_cli.campaign.place.Place`."""
        by_name: dict[str, set[str]] = {}
        for file in remote.below(self._url_of(RESULTS)):
            name, _, rest = file.partition("/")
            by_name.setdefault(name, set()).add(rest)
        return {name: frozenset(files) for name, files in by_name.items()}

    def read(self, path: str) -> bytes:
        """See :class:`massprop_cli.campaign.place.Place`."""
        with remote.opened(self._url_of(path), "file") as (files, place):
            content = remote.content_at(files, place)
        if content is None:
            raise FileNotFoundError(self._url_of(path))
        return content

    def put_folder(self, name: str, files: Mapping[str, bytes]) -> None:
        """See :class:`massprop_cli.campaign.place.Place`.

        outcome.json is deleted first and written last, so a folder without it is incomplete.
        """
        folder = f"{RESULTS}/{name}"
        existing = remote.below(self._url_of(folder))
        for file in sorted(set(existing) & {outcome.FILE}) + sorted(set(existing) - set(files) - {outcome.FILE}):
            self._lease.check()
            with remote.opened(self._url_of(f"{folder}/{file}"), "file") as (store, path):
                store.rm_file(path)
        for file in sorted(files, key=lambda file: (file == outcome.FILE, file)):
            self.put_file(f"{folder}/{file}", [files[file]])

    def put_file(self, path: str, content: Iterable[bytes]) -> None:
        """See :class:`massprop_cli.campaign.place.Place`. A store writes an object completely or not at all."""
        self._lease.check()
        whole = b"".join(content)
        with remote.opened(self._url_of(path), "bucket") as (store, place):
            try:
                store.pipe_file(place, whole)
            except FileNotFoundError:  # the store has folders, and this one does not exist
                store.makedirs(place.rpartition("/")[0], exist_ok=True)
                store.pipe_file(place, whole)

    def _url_of(self, path: str) -> str:
        return location.join(self.url, path)
