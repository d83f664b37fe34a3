"""Search for logs in the files, folders, globs and campaign files that the user names; names with numbers sort by value."""

import glob
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path, PurePath, PurePosixPath

from massprop_cli.base.errors import InputError
from massprop_cli.campaign import campaignfile, location, remote
from massprop_cli.campaign.plan import FoundLog, Job, Settings, jobs
from massprop_cli.inputs.formats.recording import SUFFIXES

WRITTEN = {"history.parquet": "result.json", "campaign.parquet": "campaign.json", "campaign.csv": "campaign.json", "report.csv": ""}
"""Tables that massprop writes: each file's name, and the file that is then in the same folder ("": always a table of massprop)."""
_KINDS = ", ".join(f"*{suffix}" for suffix in SUFFIXES)
_MAGIC = re.compile(r"[*?\[]")


def plan(named: Sequence[str], over: Settings) -> tuple[str, list[Job]]:
    """The campaign's name and jobs; ``over`` overrides campaign files.

    Raise :class:`InputError` if a named place does not exist or has no log.
    """
    logs: list[FoundLog] = []
    titles = []
    for text in named:
        if text.lower().endswith(".toml") and not Path(text).is_dir():
            title, logs_of_file = _campaign(text)
            logs += logs_of_file
            titles.append(title)
        else:
            logs += _expanded(text)
    return " and ".join(dict.fromkeys(titles)) or "campaign", jobs([replace(log, settings=overlaid(log.settings, over)) for log in logs])


def overlaid(under: Settings, over: Settings) -> Settings:
    """Merge two settings; values stated in ``over`` replace those of ``under``, and assignments add up."""
    return Settings(
        vehicle=under.vehicle if over.vehicle is None else over.vehicle,
        map=under.map if over.map is None else over.map,
        assignments=(*under.assignments, *over.assignments),
        expect=under.expect if over.expect is None else over.expect,
        require=over.require or under.require,
        report=under.report or over.report,
        check=over.check,
        allow_contradicted=under.allow_contradicted or over.allow_contradicted,
    )


def _campaign(place: str) -> tuple[str, list[FoundLog]]:
    """Title and logs of a campaign file."""
    file = campaignfile.load(place)
    base = location.folder(place)
    logs = [log for named in file.logs for log in _expanded(location.join(base, named))]
    paths = [location.below(log.location, base) for log in logs]
    for number, rule in enumerate(file.match):
        if not any(campaignfile.matches(rule.logs, path) for path in paths):
            raise InputError(f"{place}: match.{number}.logs = {list(rule.logs)}: matches none of the {len(logs)} logs; correct the pattern")
    title = file.name or location.stem(place)
    return title, [campaignfile.applied(file, base, log, path) for log, path in zip(logs, paths, strict=True)]


def _expanded(named: str) -> list[FoundLog]:
    """The logs of one file, folder, glob or URL; raise :class:`InputError` if there is none."""
    if location.is_url(named):
        return _expanded_url(named)
    path = Path(named)
    exists = path.exists()
    if exists and not path.is_dir():
        return [_found(path, path.parent)]
    wild = not exists and bool(_MAGIC.search(named))
    root = Path(*_leading(path.parts)) if wild else path
    logs = sorted(_matching(path, root) if wild else _walk(path), key=lambda log: _natural(log.parts))
    if not logs:
        raise _no_log(str(path), wild, exists, "path")
    return [_found(log, root) for log in logs]


def _no_log(named: str, wild: bool, exists: bool, what: str) -> InputError:
    """The error for a pattern or folder without logs."""
    if wild:
        return InputError(f"{named}: no log matches this pattern; check it, and that it names logs ({_KINDS})")
    if exists:
        return InputError(f"{named}: holds no log ({_KINDS}); name the folder that does")
    return InputError(f"{named}: no such file or folder; check the {what}")


def _matching(path: Path, root: Path) -> set[Path]:
    """Logs that match a pattern, and those in folders that match; ``root`` is the part of the pattern without wildcards."""
    if ANY in path.parts:
        below = {log.relative_to(root).as_posix(): log for log in _walk(root, links=True)}
        return {below[file] for file in matching(list(below), path.relative_to(root).as_posix())}
    matches = [Path(match) for match in glob.glob(str(path))]  # noqa: PTH207 as a shell does it
    logs = {match for match in matches if match.is_file() and _is_log(match)}
    return logs | {log for match in matches if match.is_dir() for log in _walk(match)}


def _expanded_url(named: str) -> list[FoundLog]:
    """The logs at a URL, by the rules for a path."""
    if remote.exists(named):
        return [_found_url(location.folder(named), location.name(named))]
    place, *outer = named.split("::", 1)
    wild = bool(_MAGIC.search(place))
    root = "::".join(["/".join(_leading(place.split("/"))), *outer])
    all_below = remote.below(root)
    files = matching(all_below, location.below(named, root)) if wild else all_below
    existing = set(all_below)
    visible = [file for file in files if not any(part.startswith(".") for part in file.split("/"))]
    logs = [file for file in visible if _may_be_log(PurePosixPath(file), lambda sibling: str(sibling) in existing)]
    if not logs:
        raise _no_log(named, wild, bool(files), "URL")
    return [_found_url(root, log) for log in sorted(logs, key=lambda log: _natural(log.split("/")))]


def _found_url(root: str, path: str) -> FoundLog:
    whole = location.join(root, path)
    scheme, _, rest = whole.partition("://")
    below = path.split("/")
    return FoundLog(whole, (f"{scheme}://", *(part for part in rest.split("::", 1)[0].split("/") if part)), len(below))


def _leading(parts: Sequence[str]) -> Iterator[str]:
    """The parts of a pattern before the first that has a wildcard."""
    for part in parts:
        if _MAGIC.search(part):
            return
        yield part


def _walk(folder: Path, links: bool = False) -> Iterator[Path]:
    """Logs in a folder and below, except hidden ones; with ``links``, follow links and visit each folder once."""
    seen = {os.path.realpath(folder)}
    for place, folders, files in os.walk(folder, followlinks=links):
        folders[:] = [name for name in sorted(folders) if not name.startswith(".")]
        if links:
            new = {os.path.realpath(Path(place, name)): name for name in reversed(folders)}
            folders[:] = sorted(name for where, name in new.items() if where not in seen)
            seen |= new.keys()
        yield from (log for log in (Path(place) / name for name in files if not name.startswith(".")) if _is_log(log))


def _is_log(file: Path) -> bool:
    return _may_be_log(file, lambda sibling: Path(sibling).exists())


def _may_be_log(file: PurePath, exists: Callable[[PurePath], bool]) -> bool:
    """Whether a file has a log's suffix and is not a table of massprop; ``exists`` tests for another file in its folder."""
    sibling = WRITTEN.get(file.name)
    written = sibling is not None and (sibling == "" or exists(file.with_name(sibling)))
    return file.name.lower().endswith(SUFFIXES) and not written


def _found(log: Path, root: Path) -> FoundLog:
    whole = _absolute(log)
    return FoundLog(str(log), whole.parts, len(whole.relative_to(_absolute(root)).parts))


def _absolute(path: Path) -> Path:
    """The absolute path without "..", with links not resolved."""
    return Path(os.path.abspath(path))  # noqa: PTH100


def _natural(parts: Sequence[str]) -> list[tuple[int, str] | tuple[int, int, str]]:
    """Sort key that puts run-2 before run-10, folder by folder."""
    return [
        (0, int(piece), piece) if piece.isdecimal() and piece.isascii() else (1, piece)
        for part in parts
        for piece in [*re.split(r"(\d+)", part), ""]
    ]


ANY = "**"
"""Wildcard for any number of folders."""


def matching(files: Sequence[str], pattern: str) -> list[str]:
    """Paths that match a pattern, and those in folders that match: "*" within one part, "**" for any folders.

    "*" does not match a name that begins with a dot; "**" does, so callers leave out hidden files.
    """
    wanted = PurePosixPath(pattern).parts
    return [file for file in files if _matches(file.split("/"), wanted)]


def _matches(parts: Sequence[str], wanted: Sequence[str]) -> bool:
    """Whether a file, or a folder that contains it, matches; the time is proportional to len(parts) × len(wanted)."""
    reached = [n == 0 for n in range(len(parts) + 1)]  # whether the pattern so far can match the first n parts of the path
    for n, one in enumerate(wanted):
        if True not in reached:
            return False
        if one == ANY:
            # at the end of the pattern, ** matches the file's name too; before that, it leaves the name to the next part
            first = reached.index(True)
            reached = [at >= first and (at < len(parts) or n == len(wanted) - 1) for at in range(len(parts) + 1)]
        else:
            reached = [False, *(reached[at] and _part_matches(part, one) for at, part in enumerate(parts))]
    return any(reached)


def _part_matches(part: str, wanted: str) -> bool:
    """Whether one part of a path matches; a hidden one needs a pattern that begins with a dot."""
    return (wanted.startswith(".") or not part.startswith(".")) and fnmatchcase(part, wanted)
