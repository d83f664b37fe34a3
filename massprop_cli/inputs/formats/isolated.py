"""Isolated process for readers that use third-party libraries, with limits of memory and processor time.

A damaged or hostile file can cause an endless loop, gigabytes of memory or a crash in such a library. That ends only this process, and
massprop reports a damaged file. ``python -m massprop_cli.inputs.formats.isolated`` is the process. It reads the file from stdin and writes
into a folder: ``streams.json`` describes the streams, and ``numbers`` has their values one after the other.
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

_HAS_LIMITS = os.name == "posix"
"""Whether the operating system can limit a process."""
_INDEX, _NUMBERS = "streams.json", "numbers"
_BYTES_A_SECOND, _MEMORY_A_BYTE = 500_000, 32
"""Additional limits per byte of the file: the slowest reader (ROS messages) is ten times as fast and needs about as much memory."""


def read(path: Path, data: bytes, found: Kind) -> Read:
    """Streams of a file, read in an isolated process. Raises :class:`InputError` if it cannot be read."""
    allowed = limits.READER_SECONDS.most + len(data) // _BYTES_A_SECOND, limits.READER_MEMORY.most + _MEMORY_A_BYTE * len(data)
    with tempfile.TemporaryDirectory(prefix="massprop-", ignore_cleanup_errors=True) as folder:
        code = run_reader([str(path), found.module, folder, *map(str, allowed)], data)
        index = Path(folder) / _INDEX
        if code or not index.exists():
            spent = f"{allowed[0]} s or {allowed[1] / 2**20:.0f} MiB"
            raise MachineError(
                f"{path}: not a readable {found.name} (its reader crashed, or took more than {spent}); copy it again from the recorder, or "
                f"if it is whole, set {limits.READER_SECONDS.variable} and {limits.READER_MEMORY.variable}"
            )
        return _read(path, found, json.loads(index.read_bytes()), Path(folder) / _NUMBERS)


def run_reader(arguments: list[str], data: bytes) -> int:
    """Run the isolated process on a file's bytes and return its exit code."""
    _, _, folder, seconds, _ = arguments
    # temporary files of a library go into the folder, which is removed even if the process crashes
    settings = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder) | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        # -P: ignore modules in the current folder
        return subprocess.run(
            [sys.executable, "-P", "-m", __name__, *arguments],
            input=data,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | settings,
            timeout=None if _HAS_LIMITS else int(seconds),
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return 1


def _read(path: Path, found: Kind, content: dict[str, Any], numbers: Path) -> Read:
    if "refused" in content:
        raise (MachineError if content["by_machine"] else InputError)(content["refused"])
    if "missing" in content:
        raise MachineError(f"{path}: reading a {found.name} needs the package {content['missing']}; pip install 'massprop[{found.extra}]'")
    streams, at = [], 0
    for one in content["streams"]:
        if "problem" in one:
            message = f"{path}, {one['path']!r}: holds no numbers that can be read ({one['problem']})"
            streams.append(RecordedStream(one["path"], one["rows"], partial(_unreadable, message), one["clock"], one["unit"]))
            continue
        values = np.fromfile(numbers, np.dtype(one["type"]), one["rows"], offset=at)
        at += values.nbytes
        streams.append(recording.stream(one["path"], values, one["clock"], one["unit"]))
    return Read(streams, content["parameters"], content["vehicle"], content["map"], content["unread"])


def _unreadable(message: str) -> Numbers:
    raise InputError(message)


def main(path: Path, module: str, folder: Path, seconds: int, memory: int) -> None:
    """Run in the isolated process: read the file and write the result."""
    _limit(seconds, memory)
    try:
        content = _read_content(path, module, folder / _NUMBERS)
    except InputError as error:
        content = {"refused": str(error), "by_machine": isinstance(error, MachineError)}
    except ImportError as error:
        content = {"missing": error.name}
    (folder / "whole").write_text(json.dumps(content), encoding="ascii")
    (folder / "whole").replace(folder / _INDEX)


def _limit(seconds: int, memory: int) -> None:
    """Limit this process; on systems without limits, the parent process uses a timeout."""
    if not _HAS_LIMITS:
        return
    import resource

    for kind, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_DATA, memory)):
        _, hard = resource.getrlimit(kind)
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _read_content(path: Path, module: str, numbers: Path) -> dict[str, Any]:
    """Description of the file's content; writes the values on the way. Raises InputError or ImportError if it cannot be read."""
    with recording.unremarked():
        reader = import_module(f"{__package__}.{module}")
    kind = next(kind for kind in recording.KINDS.values() if kind.module == module)
    with numbers.open("wb") as file, recording.damaged(path, kind):
        read = reader.read(path, sys.stdin.buffer.read())
        return {
            "streams": [_stream(one, file) for one in recording.counted(path, read.streams)],
            "parameters": dict(read.parameters),
            "vehicle": read.vehicle,
            "map": read.map,
            "unread": dict(read.unread),
        }


def _stream(one: RecordedStream, file: Any) -> dict[str, Any]:
    """Description of a stream; appends its values to ``file``."""
    content = {"path": one.path, "rows": one.rows, "clock": one.clock, "unit": one.unit}
    try:
        values = np.asarray(one.values)
        values = values if values.dtype.kind in "iuf" else values.astype(np.float64)
        if values.shape != (one.rows,):
            raise ValueError(f"of shape {values.shape}")
    except MemoryError:
        raise
    except Exception as error:
        return content | {"problem": recording.reason(error)}
    file.write(np.ascontiguousarray(values).data)
    return content | {"type": values.dtype.str}


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5]))
