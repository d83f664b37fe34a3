"""A process that works jobs: reads them from stdin, writes what they produced to stdout, until stdin ends.

It ends by itself when whoever started it is gone, however that came about.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from typing import IO, Any

from massprop_cli.campaign import work

_SIZE = 8
"""Bytes that say how long the next message is."""


def send(stream: IO[bytes], message: object) -> None:
    """One message."""
    content = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    stream.write(len(content).to_bytes(_SIZE, "big"))
    stream.write(content)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """The next message; EOFError where there is none, or half of one."""
    size = stream.read(_SIZE)
    content = stream.read(int.from_bytes(size, "big")) if len(size) == _SIZE else b""
    if len(size) < _SIZE or len(content) < int.from_bytes(size, "big"):
        raise EOFError
    return pickle.loads(content)


def main() -> None:
    """Work until told no more. What anything prints goes to stderr, so that it can't disturb the messages."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    messages = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while True:
        try:
            task = receive(sys.stdin.buffer)
            send(messages, work.process(task.job, task.known, task.sent))
        except (EOFError, BrokenPipeError):
            os._exit(0)
