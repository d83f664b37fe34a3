"""Result folders: every file is written under a temporary name and moved into place whole."""

from __future__ import annotations

import json
import os
import platform
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from massprop_cli.analysis import Analysis
from massprop_cli.errors import InputError
from massprop_cli.report import result


def write(folder: Path, analysis: Analysis, result_json: str) -> None:
    """Write history.parquet, run.json and, last, result.json."""
    run = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "host": platform.node(), "log": str(analysis.log.path.resolve())}
    run |= {"vehicle": analysis.source.source}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("history.parquet", "run.json", "result.json"):
            if (folder / name).is_dir():
                raise InputError(f"{folder / name}: is a folder; nothing was written. Move it, or choose another folder with --out")
        _whole(folder / "history.parquet", lambda path: result.write_history(analysis, path))
        _whole(folder / "run.json", lambda path: _text(path, json.dumps(run, indent=1, ensure_ascii=False) + "\n"))
        _whole(folder / "result.json", lambda path: _text(path, result_json))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); choose another folder with --out") from None


def _text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def _whole(path: Path, save: Callable[[Path], None]) -> None:
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        save(temporary)
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
