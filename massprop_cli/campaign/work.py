"""One job: read its log, estimate, and hand back its result folder as bytes. Pure, so that it may run anywhere."""

import hashlib
import re
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import field
from functools import cache
from pathlib import Path

from massprop_cli import __version__
from massprop_cli.base import configfile, escape, exits, files
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError, MachineError
from massprop_cli.base.escape import line
from massprop_cli.campaign import location, outcome
from massprop_cli.campaign.outcome import Outcome
from massprop_cli.campaign.plan import Job
from massprop_cli.inputs import expect, logfile, vehiclefile
from massprop_cli.inputs.expect import Expectations
from massprop_cli.inputs.formats import mapfile, recording
from massprop_cli.inputs.tablefile import Table
from massprop_cli.inputs.vehiclefile import VehicleSource


@dataclass(frozen=True)
class Produced:
    """The outcome of a job and the files it made."""

    outcome: Outcome
    made: Mapping[str, bytes] = field(default_factory=dict)
    """By file name, outcome.json aside."""

    @property
    def files(self) -> dict[str, bytes]:
        """The whole result folder."""
        return {**self.made, outcome.FILE: outcome.to_json(self.outcome)}


@dataclass(frozen=True)
class Inputs:
    """Everything that a result depends on, as bytes."""

    log: bytes
    vehicle: tuple[str, bytes] | None
    """Location and content of the vehicle file that is named, or lies beside the log; None: neither."""
    expect: tuple[str, bytes] | None
    """The same of the expect file, which is named, ..."""
    map: tuple[str, bytes] | None = None
    """... and of the map file."""


def process(job: Job, known: str | None = None, sent: Mapping[str, bytes] | None = None) -> Produced | None:
    """Work a job; None where its fingerprint is ``known``. ``sent`` holds files that came with it, by location (:func:`own_files`).

    Unusable input is an outcome with exit code 3, a bug one with 1. A bug, an unreadable file, and what this machine doesn't take, have no
    fingerprint and are tried again.
    """
    mark = outcome.UNKEPT
    sha256 = None
    try:
        inputs = gather(job, sent)
        sha256 = hashlib.sha256(inputs.log).hexdigest()
        mark = fingerprint(job, inputs)
        if mark == known:
            return None
        return _checked(job, inputs, mark) if job.settings.check else _worked(job, inputs, mark)
    except InputError as error:
        return failed(job, exits.INPUT, str(error), outcome.UNKEPT if isinstance(error, MachineError) else mark, sha256)
    except Exception as error:
        return failed(job, exits.BUG, f"internal error (a bug in massprop): {type(error).__name__}: {error}", input_sha256=sha256)


def failed(job: Job, code: int, message: str, mark: str = outcome.UNKEPT, input_sha256: str | None = None) -> Produced:
    """The outcome of a job without a result."""
    return Produced(Outcome(fingerprint=mark, exit_code=code, message=line(_as_shown(job, message)), input_sha256=input_sha256))


def _as_shown(job: Job, message: str) -> str:
    """The message with places as the campaign shows them, where one stands as a path or its beginning: "e/" is in "date/" too."""
    folder, shown = (f"{place.rpartition('/')[0]}/" * ("/" in place) for place in (job.log, job.shown))
    places = [rf"(?P<log>{re.escape(job.log)})(?![\w/\\-]|\.\w)", *([re.escape(folder)] if len(folder) > 1 else [])]
    return re.sub(rf"(?<![^\s'\"(\[{{<=:,;|])(?:{'|'.join(places)})", lambda found: job.shown if found["log"] else shown, message)


def _companions(job: Job) -> Iterator[tuple[str, bool, list[str]]]:
    """The files that belong to a log: kind, whether it is named, and the places to look, in order."""
    settings, log = job.settings, job.log
    beside = [f"{location.stem(log)}.vehicle.toml", "vehicle.toml"], recording.maps_beside(location.name(log)), ()
    stated = ("vehicle file", settings.vehicle), ("map file", settings.map), ("expect file", settings.expect)
    for (what, named), names in zip(stated, beside, strict=True):
        yield what, named is not None, [location.beside(log, name) for name in names] if named is None else [named]


def own_files(job: Job) -> dict[str, bytes]:
    """Files of a job that only this machine can read, by location; :class:`InputError` where one can't be."""
    wanted, here = [(job.log, "log")], not location.shared(job.log)
    for what, named, places in _companions(job):
        wanted += [(place, what) for place in places if named or (here and location.exists(place))]
    return {place: location.read(place, what) for place, what in wanted if not location.shared(place)}


def gather(job: Job, sent: Mapping[str, bytes] | None = None) -> Inputs:
    """Read a job's inputs, or take them from what was sent; :class:`InputError` where one can't be."""

    def read(place: str, what: str) -> bytes:
        return sent[place] if sent is not None and place in sent else location.read(place, what)

    def exists(place: str) -> bool:
        # beside a log that was sent, only what was sent with it counts
        return place in sent if sent is not None and job.log in sent else location.exists(place)

    files.check_name(job.log, job.shown)
    log = read(job.log, "log")
    vehicle, by, expected = (
        next(((place, read(place, what)) for place in places if named or exists(place)), None) for what, named, places in _companions(job)
    )
    return Inputs(log, vehicle, expected, by)


def fingerprint(job: Job, inputs: Inputs) -> str:
    """sha256 of all that decides the result folder's bytes: log, vehicle, expectations, settings, program and library versions."""
    settings = job.settings
    by_vehicle, by_map = (b"beside" if named is None else b"named" for named in (settings.vehicle, settings.map))
    parts = [job.shown.encode("utf-8", "surrogatepass"), inputs.log, by_vehicle]
    for file in (inputs.vehicle, inputs.expect):
        parts += [b""] if file is None else [_base(file[0]), file[1]]
    parts += [] if inputs.map is None else [b"map", _base(inputs.map[0]), inputs.map[1], by_map]
    said = (settings.assignments, [str(item) for item in settings.require], settings.report, sorted(versions(settings.report).items()))
    parts += [b"check"] if settings.check else []
    parts += [b"contradicted"] if settings.allow_contradicted else []
    digest = hashlib.sha256()
    for part in (*parts, repr(said).encode("utf-8", "surrogatepass")):
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()


def _base(place: str) -> bytes:
    return place.replace("\\", "/").rpartition("/")[2].encode("utf-8", "surrogatepass")


@cache
def versions(report: bool = False) -> dict[str, str]:
    """Versions of massprop and of the libraries that decide a result's bytes, and its page's where there is one."""
    import platform
    from importlib.metadata import version

    from massprop_cli.kernel import kernel

    libraries = ("numpy", "pyarrow", *(("matplotlib", "jinja2") if report else ()))
    own = {"massprop": __version__, "kernel": kernel().name, "python": platform.python_version()}
    return own | {name: version(name) for name in libraries}


def _worked(job: Job, inputs: Inputs, mark: str) -> Produced:
    from massprop_cli.campaign import kept
    from massprop_cli.job import Demands, of_table
    from massprop_cli.result import historyfile

    settings, (table, source, expected) = job.settings, _read(job, inputs)
    judged = of_table(table, source, settings.assignments, Demands(settings.require, expected, settings.allow_contradicted))
    made = {"result.json": escape.document(judged.result).encode(), "history.parquet": historyfile.content(judged.analysis)}
    if settings.report:
        made["report.html"] = _report(job, made)
    found, analysis = judged.result, judged.analysis
    bodies = kept.bodies(found, analysis.vehicle, analysis.source.vehicle)
    return Produced(kept.of_result(found, judged.unmet, bodies, sorted(made), found.provenance.method, mark), made)


def _checked(job: Job, inputs: Inputs, mark: str) -> Produced:
    """The check alone: check.json, and what it expects of each quantity without its value."""
    from massprop_cli.campaign import kept
    from massprop_cli.check import flow

    table, source, expected = _read(job, inputs)
    wants = job.settings.require + (() if expected is None else expected.required)
    allowed = job.settings.allow_contradicted
    found = flow.of_table(table, source, wants, job.settings.assignments, allow_contradicted=allowed)
    told = Outcome(
        fingerprint=mark,
        exit_code=found.exit_code,
        message=line(flow.message(found)),
        input_sha256=found.input_sha256,
        vehicle=kept.stated(source),
        method="check",
        warnings=list(dict.fromkeys(one.code for one in found.findings if one.grade != "note")),
        missed=[one.reason for one in found.expected if one.reached is False],
        bodies=kept.expected(found.expected),
        files=[outcome.CHECKED],
    )
    return Produced(told, {outcome.CHECKED: escape.document(found).encode()})


def _read(job: Job, inputs: Inputs) -> tuple[Table, VehicleSource, Expectations | None]:
    """A log with its vehicle, and what is expected of it."""
    table = table_of(job, inputs)
    source = vehicle_of(job, inputs, table.embedded_vehicle)
    if inputs.expect is None:
        return table, source, None
    place, content = inputs.expect
    return table, source, expect.parse(configfile.decoded(content, place, "expect file"), location.path(place))


def table_of(job: Job, inputs: Inputs) -> Table:
    """The log's table, called as the campaign shows it."""
    if inputs.map is None:
        return logfile.parse(Path(job.shown), inputs.log)
    place, content = inputs.map
    by = mapfile.parse(configfile.decoded(content, place, "map file"), place, named=job.settings.map is not None)
    return logfile.parse(Path(job.shown), inputs.log, by)


def vehicle_of(job: Job, inputs: Inputs, embedded: str | None) -> VehicleSource:
    """The vehicle, in the contract's order: the named file, the log's own, the file next to the log."""
    stated = job.settings.assignments
    if embedded is not None and job.settings.vehicle is None:
        return vehiclefile.parse(embedded, f"{job.log} (embedded vehicle)", stated)
    if inputs.vehicle is None:
        raise InputError(
            f"{job.log}: no vehicle file; looked for {location.stem(job.log)}.vehicle.toml and vehicle.toml beside it. "
            "Name one for all, or in a campaign file",
            option="vehicle",
        )
    place, content = inputs.vehicle
    return vehiclefile.parse(configfile.decoded(content, place, "vehicle file"), place, stated)


def _report(job: Job, made: Mapping[str, bytes]) -> bytes:
    from massprop_cli.report import html
    from massprop_cli.result import read

    with tempfile.TemporaryDirectory() as aside:
        folder = Path(aside) / job.name
        folder.mkdir()
        for name, content in made.items():
            (folder / name).write_bytes(content)
        recorded = [read.read(folder)]
        return html.stamped(html.page(recorded), recorded).encode()
