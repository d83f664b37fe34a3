"""What ``massprop report`` rendered beside a result, known by the result's run.json: so that no page outlives the result it tells of."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from massprop_cli.base import escape, files, limits
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError

TEXTS = {"html": "report.html", "md": "report.md", "csv": "report.csv", "junit": "report.junit.xml"}
"""Formats of text and the files that they are written to."""
RUN = "run.json"
_KEY = "rendered"


@dataclass(frozen=True)
class Cleared:
    """The pages of an earlier result that were removed, and those that were left."""

    removed: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    """Those that may be someone's own: not written by massprop, or changed since."""


def run(folder: Path) -> dict[str, Any]:
    """The content of run.json; empty where it is missing or not massprop's."""
    try:
        said = json.loads(limits.content(folder / RUN, RUN))
    except (OSError, ValueError, RecursionError, InputError):
        return {}
    return said if isinstance(said, dict) else {}


def listed(folder: Path) -> dict[str, str]:
    """SHA-256 of the files that were rendered into a result's folder, by their names there."""
    said = run(folder).get(_KEY)
    found = said.items() if isinstance(said, dict) else ()
    return {name: digest for name, digest in found if isinstance(digest, str) and Path(name).name == name}


def record(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Note what was just rendered into a result's folder; nothing where it has no run.json."""
    said = run(folder)
    if said:
        digests = listed(folder) | {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
        write_run(folder, said, digests)


def write_run(folder: Path, said: Mapping[str, Any], digests: Mapping[str, str]) -> None:
    """Write run.json."""
    files.text(folder / RUN, run_text(said, digests))


def run_text(said: Mapping[str, Any], digests: Mapping[str, str]) -> str:
    """The text of run.json."""
    more = {_KEY: dict(sorted(digests.items()))} if digests else {}
    text = escape.json(json.dumps({key: value for key, value in said.items() if key != _KEY} | more, indent=1, ensure_ascii=False))
    return text + "\n"


def clear(folder: Path) -> Cleared:
    """Remove what was rendered and is as it was written; what massprop did not write, or someone has changed, is left."""
    removed = []
    for name, digest in listed(folder).items():
        file = folder / name
        if file.is_file() and hashlib.sha256(file.read_bytes()).hexdigest() == digest:
            file.unlink()
            removed.append(name)
    known = dict.fromkeys([*listed(folder), *TEXTS.values()])
    return Cleared(tuple(removed), tuple(name for name in known if (folder / name).is_file()))
