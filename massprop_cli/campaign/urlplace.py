"""Results at a URL. Stores have no rename, so a result folder counts only with the object that is written last, outcome.json.

The lock is an object that its holder renews, with how often. A newcomer watches it for longer than a renewal takes; one that stands still
is taken over, so that clocks are never compared. Who finds a token other than its own, as where a store creates over what is there,
stops before it writes anything more.
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
"""Seconds from one renewal to the next, and without any until a lock counts as left behind."""
_LOOK_S = 2.0


class Lease:
    """The lock object at a URL."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._token = uuid.uuid4().hex
        self._lost = False

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold it; :class:`InputError` where another batch does."""
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
                if self._is_own(remote.content_at(files, path)):
                    files.rm_file(path)

    def check(self) -> None:
        """:class:`InputError` where another batch has taken it over."""
        if self._lost:
            raise InputError(f"{self.url}: another batch took over, since this one could not renew its lock; wait for it, then run again")

    def _take(self, files: Any, path: str) -> None:
        while not self._create(files, path):
            found = remote.content_at(files, path)
            if found is not None and self._is_alive(files, path, found):
                raise InputError(
                    f"{self.url}: another batch is writing there ({_holder(found)}); wait for it, or choose another folder",
                    option="out",
                )
            if found is not None and remote.content_at(files, path) == found:
                files.rm_file(path)

    def _create(self, files: Any, path: str) -> bool:
        """Create the lock object; whether it is this batch's own now."""
        if remote.content_at(files, path) is not None:
            return False
        with suppress(Exception):  # where it is refused because there is one, what is read next says so
            files.pipe_file(path, self._said(0), mode="create")
            return self._is_own(remote.content_at(files, path))
        if remote.content_at(files, path) is None:
            files.pipe_file(path, self._said(0))  # a store that can't create only, or whose error is told now
        return self._is_own(remote.content_at(files, path))

    def _is_alive(self, files: Any, path: str, found: bytes) -> bool:
        """Whether the lock is renewed, or taken anew, while this batch watches it."""
        until = time.monotonic() + SILENT_S
        while time.monotonic() < until:
            time.sleep(min(_LOOK_S, SILENT_S / 4))
            now = remote.content_at(files, path)
            if now is None:
                return False
            if now != found:
                return True
        return False

    def _renew(self, files: Any, path: str, stop: threading.Event) -> None:
        renewals = 0
        while not stop.wait(RENEWED_S):
            renewals += 1
            with suppress(Exception):  # a store that is out of reach for a while is asked again
                if not self._is_own(remote.content_at(files, path)):
                    self._lost = True
                    return
                files.pipe_file(path, self._said(renewals))

    def _said(self, renewals: int) -> bytes:
        told = {"token": self._token, "host": socket.gethostname(), "process": os.getpid(), "renewals": renewals}
        return (json.dumps(told) + "\n").encode()

    def _is_own(self, found: bytes | None) -> bool:
        return found is not None and self._token.encode() in found


def _holder(found: bytes) -> str:
    try:
        told = json.loads(found)
        return f"process {told['process']} on {told['host']}"
    except (ValueError, KeyError, TypeError):
        return "whose is unknown"


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
        """See :class:`massprop_cli.campaign.place.Place`, and :mod:`massprop_cli.campaign.urlplace`."""
        with remote.opened(self.url, "bucket") as (files, path):
            bucket = path.strip("/").split("/")[0]
            # writing would make a bucket that is misspelt in some stores, and in others fail with less to say
            if "/" not in path[:1] and not files.exists(bucket):
                raise InputError(f"{self.url}: no bucket {bucket!r} that these credentials may use; create it, or correct the URL")
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
        with remote.opened(self._of(path), "file") as (files, place):
            found = remote.content_at(files, place)
        if found is None:
            raise FileNotFoundError(self._of(path))
        return found

    def put_folder(self, name: str, files: Mapping[str, bytes]) -> None:
        """See :class:`massprop_cli.campaign.place.Place`. outcome.json goes first and comes last; killed in between, it is missing."""
        folder = f"{RESULTS}/{name}"
        there = remote.below(self._of(folder))
        for file in sorted(set(there) & {outcome.FILE}) + sorted(set(there) - set(files) - {outcome.FILE}):
            self._lease.check()
            with remote.opened(self._of(f"{folder}/{file}"), "file") as (store, path):
                store.rm_file(path)
        for file in sorted(files, key=lambda file: (file == outcome.FILE, file)):
            self.put_file(f"{folder}/{file}", [files[file]])

    def put_file(self, path: str, content: Iterable[bytes]) -> None:
        """See :class:`massprop_cli.campaign.place.Place`. Stores put an object in place whole."""
        self._lease.check()
        whole = b"".join(content)
        with remote.opened(self._of(path), "bucket") as (store, place):
            try:
                store.pipe_file(place, whole)
            except FileNotFoundError:  # where folders must be made first
                store.makedirs(place.rpartition("/")[0], exist_ok=True)
                store.pipe_file(place, whole)

    def _of(self, path: str) -> str:
        return location.join(self.url, path)
