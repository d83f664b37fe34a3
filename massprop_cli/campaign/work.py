"""Processing of one job: read its log, estimate, and return the result folder as bytes. It writes nothing, so it can run on any machine."""

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
    """The outcome of a job and the files of its result folder."""

    outcome: Outcome
    made: Mapping[str, bytes] = field(default_factory=dict)
    """Contents by file name, without outcome.json."""

    @property
    def files(self) -> dict[str, bytes]:
        """Contents by file name, with outcome.json."""
        return {**self.made, outcome.FILE: outcome.to_json(self.outcome)}


@dataclass(frozen=True)
class Inputs:
    """Contents of all input files of a job."""

    log: bytes
    vehicle: tuple[str, bytes] | None
    """Location and content of the vehicle file, named or in the log's folder; None: there is none."""
    expect: tuple[str, bytes] | None
    """Location and content of the expect file; None: none is named."""
    map: tuple[str, bytes] | None = None
    """Location and content of the map file, named or in the log's folder; None: there is none."""


def process(job: Job, known: str | None = None, sent: Mapping[str, bytes] | None = None) -> Produced | None:
    """Process a job; return None if its fingerprint is ``known``.

    ``sent`` contains files from the client, by location (:func:`local_files`). The exit code is 3 for unusable input and 1 for a bug.
    After a bug, an unreadable file or a limit of this machine, the outcome has no fingerprint, so that the next batch repeats the job.
    """
    mark = outcome.UNKEPT
    sha256 = None
    try:
        inputs = gather(job, sent)
        sha256 = hashlib.sha256(inputs.log).hexdigest()
        mark = fingerprint(job, inputs)
        if mark == known:
            return None
        return _checked(job, inputs, mark) if job.settings.check else _estimated(job, inputs, mark)
    except InputError as error:
        return failed(job, exits.INPUT, str(error), outcome.UNKEPT if isinstance(error, MachineError) else mark, sha256)
    except Exception as error:
        return failed(job, exits.BUG, f"internal error (a bug in massprop): {type(error).__name__}: {error}", input_sha256=sha256)


def failed(job: Job, code: int, message: str, mark: str = outcome.UNKEPT, input_sha256: str | None = None) -> Produced:
    """The outcome of a job without a result."""
    return Produced(Outcome(fingerprint=mark, exit_code=code, message=line(_as_shown(job, message)), input_sha256=input_sha256))


def _as_shown(job: Job, message: str) -> str:
    """Replace the log's location, and its folder, in a message by the path that the campaign shows.

    The pattern requires a separator before the location, since a short folder such as "e/" also occurs within "date/".
    """
    folder, shown = (f"{place.rpartition('/')[0]}/" * ("/" in place) for place in (job.log, job.shown))
    places = [rf"(?P<log>{re.escape(job.log)})(?![\w/\\-]|\.\w)", *([re.escape(folder)] if len(folder) > 1 else [])]
    return re.sub(rf"(?<![^\s'\"(\[{{<=:,;|])(?:{'|'.join(places)})", lambda match: job.shown if match["log"] else shown, message)


def _companions(job: Job) -> Iterator[tuple[str, bool, list[str]]]:
    """For each companion file of a log: its kind, whether the user named it, and its possible locations in order of priority."""
    settings, log = job.settings, job.log
    in_folder = [f"{location.stem(log)}.vehicle.toml", "vehicle.toml"], recording.maps_beside(location.name(log)), ()
    stated = ("vehicle file", settings.vehicle), ("map file", settings.map), ("expect file", settings.expect)
    for (what, named), names in zip(stated, in_folder, strict=True):
        yield what, named is not None, [location.sibling(log, name) for name in names] if named is None else [named]


def local_files(job: Job) -> dict[str, bytes]:
    """Contents of a job's files that only this machine can read, by location; raise :class:`InputError` if one cannot be read."""
    wanted, local = [(job.log, "log")], not location.shared(job.log)
    for what, named, places in _companions(job):
        wanted += [(place, what) for place in places if named or (local and location.exists(place))]
    return {place: location.read(place, what) for place, what in wanted if not location.shared(place)}


def gather(job: Job, sent: Mapping[str, bytes] | None = None) -> Inputs:
    """Read a job's inputs, from ``sent`` if they are in it; raise :class:`InputError` if one cannot be read."""

    def read(place: str, what: str) -> bytes:
        return sent[place] if sent is not None and place in sent else location.read(place, what)

    def exists(place: str) -> bool:
        # this machine does not have the folder of a log in sent
        return place in sent if sent is not None and job.log in sent else location.exists(place)

    files.check_name(job.log, job.shown)
    log = read(job.log, "log")
    vehicle, mapping, expected = (
        next(((place, read(place, what)) for place in places if named or exists(place)), None) for what, named, places in _companions(job)
    )
    return Inputs(log, vehicle, expected, mapping)


def fingerprint(job: Job, inputs: Inputs) -> str:
    """SHA-256 of everything that determines the result folder's bytes: input files, settings, program and library versions."""
    settings = job.settings
    by_vehicle, by_map = (b"beside" if named is None else b"named" for named in (settings.vehicle, settings.map))
    parts = [job.shown.encode("utf-8", "surrogatepass"), inputs.log, by_vehicle]
    for file in (inputs.vehicle, inputs.expect):
        parts += [b""] if file is None else [_file_name(file[0]), file[1]]
    parts += [] if inputs.map is None else [b"map", _file_name(inputs.map[0]), inputs.map[1], by_map]
    stated = (settings.assignments, [str(item) for item in settings.require], settings.report, sorted(versions(settings.report).items()))
    parts += [b"check"] if settings.check else []
    parts += [b"contradicted"] if settings.allow_contradicted else []
    digest = hashlib.sha256()
    for part in (*parts, repr(stated).encode("utf-8", "surrogatepass")):
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()


def _file_name(place: str) -> bytes:
    return place.replace("\\", "/").rpartition("/")[2].encode("utf-8", "surrogatepass")


@cache
def versions(report: bool = False) -> dict[str, str]:
    """Versions of massprop and of the libraries that determine the bytes of a result, and of its page with ``report``."""
    import platform
    from importlib.metadata import version

    from massprop_cli.kernel import kernel

    libraries = ("numpy", "pyarrow", *(("matplotlib", "jinja2") if report else ()))
    program = {"massprop": __version__, "kernel": kernel().name, "python": platform.python_version()}
    return program | {name: version(name) for name in libraries}


def _estimated(job: Job, inputs: Inputs, mark: str) -> Produced:
    """Estimate the log; result folder with result.json, history.parquet and, if requested, report.html."""
    from massprop_cli.campaign import kept
    from massprop_cli.job import Demands, of_table
    from massprop_cli.result import historyfile

    settings, (table, source, expected) = job.settings, _read(job, inputs)
    judged = of_table(table, source, settings.assignments, Demands(settings.require, expected, settings.allow_contradicted))
    made = {"result.json": escape.document(judged.result).encode(), "history.parquet": historyfile.content(judged.analysis)}
    if settings.report:
        made["report.html"] = _report(job, made)
    result, analysis = judged.result, judged.analysis
    bodies = kept.bodies(result, analysis.vehicle, analysis.source.vehicle)
    return Produced(kept.of_result(result, judged.unmet, bodies, sorted(made), result.provenance.method, mark), made)


def _checked(job: Job, inputs: Inputs, mark: str) -> Produced:
    """Check the log; result folder with check.json, and an outcome with predicted sigmas without values."""
    from massprop_cli.campaign import kept
    from massprop_cli.check import flow

    table, source, expected = _read(job, inputs)
    required = job.settings.require + (() if expected is None else expected.required)
    allowed = job.settings.allow_contradicted
    check = flow.of_table(table, source, required, job.settings.assignments, allow_contradicted=allowed)
    checked = Outcome(
        fingerprint=mark,
        exit_code=check.exit_code,
        message=line(flow.message(check)),
        input_sha256=check.input_sha256,
        vehicle=kept.stated(source),
        method="check",
        warnings=list(dict.fromkeys(one.code for one in check.findings if one.grade != "note")),
        missed=[one.reason for one in check.expected if one.reached is False],
        bodies=kept.expected(check.expected),
        files=[outcome.CHECKED],
    )
    return Produced(checked, {outcome.CHECKED: escape.document(check).encode()})


def _read(job: Job, inputs: Inputs) -> tuple[Table, VehicleSource, Expectations | None]:
    """Parse the log, its vehicle file and its expect file."""
    table = table_of(job, inputs)
    source = vehicle_of(job, inputs, table.embedded_vehicle)
    if inputs.expect is None:
        return table, source, None
    place, content = inputs.expect
    return table, source, expect.parse(configfile.decoded(content, place, "expect file"), location.path(place))


def table_of(job: Job, inputs: Inputs) -> Table:
    """The log's table; messages name the log as the campaign shows it."""
    if inputs.map is None:
        return logfile.parse(Path(job.shown), inputs.log)
    place, content = inputs.map
    mapping = mapfile.parse(configfile.decoded(content, place, "map file"), place, named=job.settings.map is not None)
    return logfile.parse(Path(job.shown), inputs.log, mapping)


def vehicle_of(job: Job, inputs: Inputs, embedded: str | None) -> VehicleSource:
    """The vehicle, in order of priority: the named file, the one embedded in the log, the file in the log's folder."""
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
    """Render report.html from the files of a result folder."""
    from massprop_cli.report import html
    from massprop_cli.result import read

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / job.name
        folder.mkdir()
        for name, content in made.items():
            (folder / name).write_bytes(content)
        recorded = [read.read(folder)]
        return html.stamped(html.page(recorded), recorded).encode()
