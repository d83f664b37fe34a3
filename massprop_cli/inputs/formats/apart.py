"""A reader that rests on another's library works in a process of its own, with so much memory and processor time and no more.

What a damaged or hostile file does to such a library (an endless loop, gigabytes, a crash in its compiled part) ends that process and is
told as any other damage. ``python -m massprop_cli.inputs.formats.apart`` is that process: it reads the file from stdin and leaves what it
finds in a folder, the streams in ``streams.json`` and their numbers one after the other in ``numbers``.
"""

import json
import os
import subprocess
import sys
import tempfile
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError, MachineError
from massprop_cli.inputs.formats import recording
from massprop_cli.inputs.formats.recording import Kind, Numbers, Read, RecordedStream

_CONFINES = os.name == "posix"
"""Whether the system limits a process."""
_INDEX, _NUMBERS = "streams.json", "numbers"
_BYTES_A_SECOND, _MEMORY_A_BYTE = 500_000, 32
"""By which a reader's limits grow with the file: the slowest (messages of ROS) reads ten times as fast, and takes about as much."""


def read(path: Path, data: bytes, found: Kind) -> Read:
    """The streams of a file's bytes by the reader of its kind; :class:`InputError` where it can't be read."""
    allowed = limits.READER_SECONDS.most + len(data) // _BYTES_A_SECOND, limits.READER_MEMORY.most + _MEMORY_A_BYTE * len(data)
    with tempfile.TemporaryDirectory(prefix="massprop-", ignore_cleanup_errors=True) as folder:
        code = ended([str(path), found.module, folder, *map(str, allowed)], data)
        index = Path(folder) / _INDEX
        if code or not index.exists():
            spent = f"{allowed[0]} s or {allowed[1] / 2**20:.0f} MiB"
            raise MachineError(
                f"{path}: not a readable {found.name} (its reader crashed, or took more than {spent}); copy it again from the recorder, or "
                f"if it is whole, set {limits.READER_SECONDS.variable} and {limits.READER_MEMORY.variable}"
            )
        return _read(path, found, json.loads(index.read_bytes()), Path(folder) / _NUMBERS)


def ended(arguments: list[str], data: bytes) -> int:
    """Run the process that reads on a file's bytes; its exit code."""
    _, _, folder, seconds, _ = arguments
    # a library's own files go where they are cleared away, even if it can't do so any more
    settings = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder) | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        # -P: what lies in the current folder is no module
        return subprocess.run(
            [sys.executable, "-P", "-m", __name__, *arguments],
            input=data,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | settings,
            timeout=None if _CONFINES else int(seconds),
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return 1


def _read(path: Path, found: Kind, told: dict[str, Any], numbers: Path) -> Read:
    if "refused" in told:
        raise (MachineError if told["by_machine"] else InputError)(told["refused"])
    if "missing" in told:
        raise MachineError(f"{path}: reading a {found.name} needs the package {told['missing']}; pip install 'massprop[{found.extra}]'")
    streams, at = [], 0
    for one in told["streams"]:
        if "problem" in one:
            said = f"{path}, {one['path']!r}: holds no numbers that can be read ({one['problem']})"
            streams.append(RecordedStream(one["path"], one["rows"], partial(_unreadable, said), one["clock"], one["unit"]))
            continue
        values = np.fromfile(numbers, np.dtype(one["type"]), one["rows"], offset=at)
        at += values.nbytes
        streams.append(recording.stream(one["path"], values, one["clock"], one["unit"]))
    return Read(streams, told["parameters"], told["vehicle"], told["map"], told["unread"])


def _unreadable(said: str) -> Numbers:
    raise InputError(said)


def main(path: Path, module: str, folder: Path, seconds: int, memory: int) -> None:
    """The process that reads."""
    _confine(seconds, memory)
    try:
        told = _told(path, module, folder / _NUMBERS)
    except InputError as error:
        told = {"refused": str(error), "by_machine": isinstance(error, MachineError)}
    except ImportError as error:
        told = {"missing": error.name}
    (folder / "whole").write_text(json.dumps(told), encoding="ascii")
    (folder / "whole").replace(folder / _INDEX)


def _confine(seconds: int, memory: int) -> None:
    """Where the system has no limits of a process, the one that started it looks at the clock."""
    if not _CONFINES:
        return
    import resource

    for kind, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_DATA, memory)):
        _, hard = resource.getrlimit(kind)
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _told(path: Path, module: str, numbers: Path) -> dict[str, Any]:
    """What the file holds, its numbers written on the way; InputError and ImportError say why it can't be told."""
    with recording.unremarked():
        reader = import_module(f"{__package__}.{module}")
    kind = next(kind for kind in recording.KINDS.values() if kind.module == module)
    with numbers.open("wb") as file, recording.damaged(path, kind):
        said = reader.read(path, sys.stdin.buffer.read())
        return {
            "streams": [_stream(one, file) for one in recording.counted(path, said.streams)],
            "parameters": dict(said.parameters),
            "vehicle": said.vehicle,
            "map": said.map,
            "unread": dict(said.unread),
        }


def _stream(one: RecordedStream, file: Any) -> dict[str, Any]:
    """What is told of a stream, its numbers appended to the file."""
    told = {"path": one.path, "rows": one.rows, "clock": one.clock, "unit": one.unit}
    try:
        values = np.asarray(one.values)
        values = values if values.dtype.kind in "iuf" else values.astype(np.float64)
        if values.shape != (one.rows,):
            raise ValueError(f"of shape {values.shape}")
    except MemoryError:
        raise
    except Exception as error:
        return told | {"problem": recording.reason(error)}
    file.write(np.ascontiguousarray(values).data)
    return told | {"type": values.dtype.str}


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5]))
