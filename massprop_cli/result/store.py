"""Atomic writing of result folders; run.json names the log of each, so that another log does not overwrite it."""

import platform
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from massprop_cli.base import files, foldername
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.flow import Analysis
from massprop_cli.kernel import kernel
from massprop_cli.result import historyfile, rendered
from massprop_cli.result.rendered import RUN, Cleared

BASE = Path("massprop-out")
_RESERVED = ("results",)
"""Names in the base folder reserved for campaigns."""


@dataclass(frozen=True)
class StoredResult:
    """Folder of a result, and the pages of an earlier result in it."""

    folder: Path
    pages: Cleared


def write(out: Path | None, analysis: Analysis, result_json: str) -> StoredResult:
    """Write run.json, history.parquet and, last, result.json into ``out`` or a default folder; remove pages of another result."""
    log = analysis.log.path
    with files.writing(out or BASE):
        if out is not None:
            files.check_own(out, ("history.parquet",) if not _is(out / "history.parquet", log) else (), "result.json")
        folder = _claimed(log) if out is None else out
        with files.staged(folder) as stage:
            return StoredResult(folder, _placed(stage, analysis, result_json))


def _placed(stage: files.Staged, analysis: Analysis, result_json: str) -> Cleared:
    """Write temporary files, then remove the earlier result's pages and move the files into place; an error changes nothing."""
    folder = stage.folder
    for name in ("history.parquet", RUN, "result.json"):
        if _is(folder / name, analysis.log.path):
            raise InputError(f"{folder / name}: is the log itself; nothing was written. Choose another folder", option="out")
    there, content = folder / "result.json", result_json.encode()
    # reading a pipe or a device may never end
    unchanged = there.is_file() and there.stat().st_size == len(content) and there.read_bytes() == content
    run: dict[str, Any] = _run(analysis.log.path, analysis.source.source)
    if analysis.log.made is not None:
        run |= {"map": analysis.log.made.map, "mapped": list(analysis.log.made.conversions)}
    run_text = rendered.run_text(run, rendered.listed(folder) if unchanged else {})
    stage.save("history.parquet", lambda path: historyfile.write_history(analysis, path))
    stage.save(RUN, run_text)
    stage.save("result.json", result_json)
    pages = Cleared() if unchanged else rendered.clear(folder)
    stage.place()
    return pages


def _is(file: Path, other: Path) -> bool:
    return file.exists() and other.exists() and file.samefile(other)


def plain(log: Path) -> Path:
    """Default folder of a log, unless another log uses it."""
    return BASE / foldername.safe(foldername.stem(log.name))


def _claimed(log: Path) -> Path:
    """The folder that the log already has, else the first free one of massprop-out/STEM, FOLDER-STEM, and FOLDER-STEM-DIGEST."""
    own = [folder for folder in _candidates(log) if rendered.run(folder).get("log") == _identity(log)]
    if own:
        files.clear(BASE)
        return own[0]
    with files.held(BASE):
        for folder in _candidates(log):
            # a folder with only partial files of a killed process is free
            if folder.exists() and not (folder.is_dir() and all(map(files.is_left_over, folder.iterdir()))):
                continue
            folder.mkdir(exist_ok=True)
            # write the log's name at once, for the next process
            rendered.write_run(folder, _run(log, ""), {})
            return folder
    raise InputError(f"{plain(log)}: is taken, and so is every other name for this log; choose a folder", option="out")


def _candidates(log: Path) -> Iterator[Path]:
    whole = _identity(log)
    own = foldername.stem(log.name)
    both = f"{Path(whole).parent.name}-{own}"
    names = (own, both, *(f"{foldername.safe(both)}-{foldername.digest(whole, length)}" for length in (8, 64)))
    yield from (BASE / name for name in map(foldername.safe, names) if foldername.same(name) not in _RESERVED)


def _identity(log: Path) -> str:
    """Absolute path of a log. A link is a log of its own, because another vehicle file may be next to it."""
    return str(log.parent.resolve() / log.name).encode("utf-8", "backslashreplace").decode()


def _run(log: Path, vehicle: str) -> dict[str, str]:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return {"time": now, "host": platform.node(), "kernel": kernel().name, "log": _identity(log), "vehicle": vehicle}
