"""What a campaign does: one :class:`Job` for each log, under a name that tells it from all others."""

from collections import Counter
from collections.abc import Sequence

from massprop_cli.base import foldername
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.require import Requirement


@dataclass(frozen=True)
class Settings:
    """How logs are to be worked, whichever they are."""

    vehicle: str | None = None
    """Location of a vehicle file; None: the log's own."""
    assignments: tuple[str, ...] = ()
    """``dotted.key=value`` on top of the vehicle file, the later the stronger."""
    expect: str | None = None
    """Location of an expect file."""
    require: tuple[Requirement, ...] = ()
    """What must converge, and how precisely, in every phase."""
    report: bool = False
    """Whether to render report.html."""
    map: str | None = None
    """Location of a map file; None: the log's own, if it has one."""
    check: bool = False
    """Whether to say if the log is fit, and no more."""
    allow_contradicted: bool = False
    """Whether a log that contradicts its vehicle file is accepted."""


@dataclass(frozen=True)
class Job:
    """One log with all that decides its result."""

    name: str
    """Of the result folder: unique in the campaign, one component of a path."""
    log: str
    """Location of the log: a path, or a URL."""
    shown: str
    """What to call the log in tables and messages: its path below what was named, the same on every machine."""
    settings: Settings = Settings()
    tags: tuple[str, ...] = ()
    """Words of the user's own, for tables; they don't change the result."""


@dataclass(frozen=True)
class FoundLog:
    """A log before it has a name."""

    location: str
    parts: tuple[str, ...]
    """Its path as components from the root of the file system on, the last the file's name."""
    below: int
    """How many of the last ``parts`` lie below what the user named."""
    settings: Settings = Settings()
    tags: tuple[str, ...] = ()


def jobs(found: Sequence[FoundLog]) -> list[Job]:
    """A job for each log, in their order; a log that was found twice is done once, by what was said of it last."""
    last = {log.parts: log for log in found}
    logs = list(last.values())
    # what is no UTF-8 becomes "?", that any file can hold it
    shown = ["/".join(log.parts[-log.below :]).encode("utf-8", "replace").decode() for log in logs]
    return [Job(name, log.location, path, log.settings, log.tags) for name, path, log in zip(names(logs), shown, logs, strict=True)]


def names(logs: Sequence[FoundLog]) -> list[str]:
    """Names of result folders, unique whatever the case: paths below what was named, joined by "-"; log.parquet goes by its folder.

    Equal ones take their suffix in one folder, else one more folder in front, all of them, until they differ; then a digest of their path.
    """
    depth = [max(log.below, 1) for log in logs]
    stems = [(*log.parts[:-1], foldername.same(foldername.stem(log.parts[-1]))) for log in logs]
    twins = [times > 1 for times in map(Counter(stems).__getitem__, stems)]
    found = [_name(*one) for one in zip(logs, depth, twins, strict=True)]
    for _ in range(max((len(log.parts) for log in logs), default=0)):
        same = _shared(found)
        if not same:
            return found
        depth = [min(deep + (n in same), len(log.parts)) for n, (log, deep) in enumerate(zip(logs, depth, strict=True))]
        found = [_name(*one) for one in zip(logs, depth, twins, strict=True)]
    same = _shared(found)
    return [f"{name}-{foldername.digest('/'.join(logs[n].parts))}" if n in same else name for n, name in enumerate(found)]


def _shared(found: Sequence[str]) -> set[int]:
    """Which have a name that another has too."""
    counts = Counter(map(foldername.same, found))
    return {n for n, name in enumerate(found) if counts[foldername.same(name)] > 1}


def _name(log: FoundLog, deep: int, twin: bool) -> str:
    """The name by the last ``deep`` parts of the path; with its suffix where a ``twin`` in its folder has its stem."""
    *folders, file = log.parts[-deep:]
    stem, above = foldername.stem(file), log.parts[:-1]
    suffix = [file[len(stem) + 1 :].lower().replace(".", "-")] if twin else []
    if stem.lower() == "log" and above:
        folders, stem = (folders[:-1], folders[-1]) if folders else ([], above[-1])
    return foldername.safe("-".join(part for part in (*folders, stem, *suffix) if part.strip("/")))
