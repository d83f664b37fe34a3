"""Pages that ``massprop report`` wrote into a result's folder, listed in its run.json, so that a new result removes them."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from massprop_cli.base import escape, files, limits
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError

TEXTS = {"html": "report.html", "md": "report.md", "csv": "report.csv", "junit": "report.junit.xml"}
"""File of each text format."""
RUN = "run.json"
_KEY = "rendered"


@dataclass(frozen=True)
class Cleared:
    """Removed and kept pages of an earlier result."""

    removed: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    """Kept pages: not written by massprop, or changed since."""


def run(folder: Path) -> dict[str, Any]:
    """Content of run.json; empty if it is missing or invalid."""
    try:
        content = json.loads(limits.content(folder / RUN, RUN))
    except (OSError, ValueError, RecursionError, InputError):
        return {}
    return content if isinstance(content, dict) else {}


def listed(folder: Path) -> dict[str, str]:
    """SHA-256 of the rendered pages in a result's folder, by file name."""
    entry = run(folder).get(_KEY)
    pairs = entry.items() if isinstance(entry, dict) else ()
    return {name: digest for name, digest in pairs if isinstance(digest, str) and Path(name).name == name}


def record(folder: Path, contents: Mapping[str, bytes]) -> None:
    """List rendered pages in run.json; no effect without a run.json."""
    content = run(folder)
    if content:
        digests = listed(folder) | {name: hashlib.sha256(page).hexdigest() for name, page in contents.items()}
        write_run(folder, content, digests)


def write_run(folder: Path, content: Mapping[str, Any], digests: Mapping[str, str]) -> None:
    """Write run.json."""
    files.text(folder / RUN, run_text(content, digests))


def run_text(content: Mapping[str, Any], digests: Mapping[str, str]) -> str:
    """Text of run.json; ``digests``: SHA-256 of the rendered pages, by file name."""
    more = {_KEY: dict(sorted(digests.items()))} if digests else {}
    text = escape.json(json.dumps({key: value for key, value in content.items() if key != _KEY} | more, indent=1, ensure_ascii=False))
    return text + "\n"


def clear(folder: Path) -> Cleared:
    """Remove the rendered pages that are unchanged; keep pages that massprop did not write or that were edited."""
    removed = []
    for name, digest in listed(folder).items():
        file = folder / name
        if file.is_file() and hashlib.sha256(file.read_bytes()).hexdigest() == digest:
            file.unlink()
            removed.append(name)
    known = dict.fromkeys([*listed(folder), *TEXTS.values()])
    return Cleared(tuple(removed), tuple(name for name in known if (folder / name).is_file()))
