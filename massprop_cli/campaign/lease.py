"""A lock on a store that has none: an object that its holder renews, so that a killed batch's lock is known by its silence.

The object says who holds it and how often it was renewed. A newcomer who finds one watches it for longer than a renewal takes: if it
changes, another batch is at work; if not, its holder is gone and it is taken over. Clocks of two machines are never compared. Where the
store creates an object only if there is none (S3 does), two newcomers can't both have it; where it doesn't, or where a takeover crosses
another, the one that finds a token other than its own stops before it writes anything more.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from massprop_cli.base.errors import InputError
from massprop_cli.campaign import remote

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
        files, path = remote.store(self.url)
        with remote.told(self.url, "folder"):
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
                if self._is_own(_content(files, path)):
                    files.rm_file(path)

    def check(self) -> None:
        """:class:`InputError` where another batch has taken it over."""
        if self._lost:
            raise InputError(f"{self.url}: another batch took over, since this one could not renew its lock; wait for it, then run again")

    def _take(self, files: Any, path: str) -> None:
        while not self._create(files, path):
            found = _content(files, path)
            if found is not None and self._is_alive(files, path, found):
                raise InputError(
                    f"{self.url}: another batch is at work there ({_holder(found)}); wait for it, or choose another folder",
                    option="out",
                )
            if found is not None and _content(files, path) == found:
                files.rm_file(path)

    def _create(self, files: Any, path: str) -> bool:
        """Whether it is ours now."""
        if _content(files, path) is not None:
            return False
        with suppress(Exception):  # where it is refused because there is one, what is read next says so
            files.pipe_file(path, self._said(0), mode="create")
            return self._is_own(_content(files, path))
        if _content(files, path) is None:
            files.pipe_file(path, self._said(0))  # a store that can't create only, or whose error is told now
        return self._is_own(_content(files, path))

    def _is_alive(self, files: Any, path: str, found: bytes) -> bool:
        """Whether it is renewed, or given back and taken anew, while we watch."""
        until = time.monotonic() + SILENT_S
        while time.monotonic() < until:
            time.sleep(min(_LOOK_S, SILENT_S / 4))
            now = _content(files, path)
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
                if not self._is_own(_content(files, path)):
                    self._lost = True
                    return
                files.pipe_file(path, self._said(renewals))

    def _said(self, renewals: int) -> bytes:
        told = {"token": self._token, "host": socket.gethostname(), "process": os.getpid(), "renewals": renewals}
        return (json.dumps(told) + "\n").encode()

    def _is_own(self, found: bytes | None) -> bool:
        return found is not None and self._token.encode() in found


def _content(files: Any, path: str) -> bytes | None:
    files.invalidate_cache()
    try:
        return bytes(files.cat_file(path))
    except FileNotFoundError:
        return None


def _holder(found: bytes) -> str:
    try:
        told = json.loads(found)
        return f"process {told['process']} on {told['host']}"
    except (ValueError, KeyError, TypeError):
        return "whose is unknown"
