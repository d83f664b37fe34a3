"""Jobs of a campaign: one :class:`Job` per log, with a unique name."""

from collections import Counter
from collections.abc import Sequence

from massprop_cli.base import foldername
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.require import Requirement


@dataclass(frozen=True)
class Settings:
    """Settings of an estimate that do not depend on the log."""

    vehicle: str | None = None
    """Location of a vehicle file; None: embedded in the log, or in its folder."""
    assignments: tuple[str, ...] = ()
    """Overrides of vehicle-file keys, ``dotted.key=value``; of two for one key, the later one applies."""
    expect: str | None = None
    """Location of an expect file."""
    require: tuple[Requirement, ...] = ()
    """Quantities that must converge in every phase, with the required precision."""
    report: bool = False
    """Whether to render report.html."""
    map: str | None = None
    """Location of a map file; None: in the log's folder, if there is one."""
    check: bool = False
    """Whether to check the log without an estimate."""
    allow_contradicted: bool = False
    """Whether a log that contradicts its vehicle file is accepted."""


@dataclass(frozen=True)
class Job:
    """One log with everything that determines its result."""

    name: str
    """Name of the result folder, unique in the campaign."""
    log: str
    """Location of the log: a path, or a URL."""
    shown: str
    """Name of the log in tables and messages: its path below the folder that the user named, equal on all machines."""
    settings: Settings = Settings()
    tags: tuple[str, ...] = ()
    """The user's labels for tables; they do not affect the result."""


@dataclass(frozen=True)
class FoundLog:
    """A log without a job's name."""

    location: str
    parts: tuple[str, ...]
    """Components of its absolute path, the last the file's name."""
    below: int
    """Number of the last ``parts`` that are below the folder that the user named."""
    settings: Settings = Settings()
    tags: tuple[str, ...] = ()


def jobs(found: Sequence[FoundLog]) -> list[Job]:
    """A job for each log, in their order; a log that was found twice gives one job with the last settings."""
    last = {log.parts: log for log in found}
    logs = list(last.values())
    # replace what is not UTF-8 by "?", since the tables are UTF-8
    shown = ["/".join(log.parts[-log.below :]).encode("utf-8", "replace").decode() for log in logs]
    return [Job(name, log.location, path, log.settings, log.tags) for name, path, log in zip(names(logs), shown, logs, strict=True)]


def names(logs: Sequence[FoundLog]) -> list[str]:
    """Names of result folders, unique regardless of case: the path below the named folder, joined by "-".

    A file named log.parquet takes the name of its folder. Logs with one stem in a folder add their suffix. All logs with equal names add
    one more folder in front until they differ, and at last a digest of the path.
    """
    depth = [max(log.below, 1) for log in logs]
    stems = [(*log.parts[:-1], foldername.same(foldername.stem(log.parts[-1]))) for log in logs]
    twins = [times > 1 for times in map(Counter(stems).__getitem__, stems)]
    chosen = [_name(*one) for one in zip(logs, depth, twins, strict=True)]
    for _ in range(max((len(log.parts) for log in logs), default=0)):
        repeated = _repeated(chosen)
        if not repeated:
            return chosen
        depth = [min(parts + (n in repeated), len(log.parts)) for n, (log, parts) in enumerate(zip(logs, depth, strict=True))]
        chosen = [_name(*one) for one in zip(logs, depth, twins, strict=True)]
    repeated = _repeated(chosen)
    return [f"{name}-{foldername.digest('/'.join(logs[n].parts))}" if n in repeated else name for n, name in enumerate(chosen)]


def _repeated(names: Sequence[str]) -> set[int]:
    """Indices of the names that occur more than once."""
    counts = Counter(map(foldername.same, names))
    return {n for n, name in enumerate(names) if counts[foldername.same(name)] > 1}


def _name(log: FoundLog, depth: int, twin: bool) -> str:
    """The name from the last ``depth`` parts of the path, with the suffix if a ``twin`` in the folder has the same stem."""
    *folders, file = log.parts[-depth:]
    stem, above = foldername.stem(file), log.parts[:-1]
    suffix = [file[len(stem) + 1 :].lower().replace(".", "-")] if twin else []
    if stem.lower() == "log" and above:
        folders, stem = (folders[:-1], folders[-1]) if folders else ([], above[-1])
    return foldername.safe("-".join(part for part in (*folders, stem, *suffix) if part.strip("/")))
