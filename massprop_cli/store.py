"""Result folders: every file is written under a temporary name and moved into place whole."""

from __future__ import annotations

import json
import platform
from datetime import UTC, datetime
from pathlib import Path

from massprop_cli import files
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
        files.whole(folder / "history.parquet", lambda path: result.write_history(analysis, path))
        files.text(folder / "run.json", json.dumps(run, indent=1, ensure_ascii=False) + "\n")
        files.text(folder / "result.json", result_json)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); choose another folder with --out") from None
