"""Standard input to estimates, cycle by cycle, and to a recording that is estimated in the end."""

import json
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from itertools import chain
from pathlib import Path
from typing import BinaryIO

from massprop_cli import ABOUT_PIVOT, QUANTITIES
from massprop_cli.base import files
from massprop_cli.base.errors import InputError
from massprop_cli.estimate import kernelflight
from massprop_cli.export import resolve
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import kernel
from massprop_cli.live.cycles import Gatherer, RecordedCycle
from massprop_cli.live.legs import Completed, Legs
from massprop_cli.live.records import RecordError, StreamReader
from massprop_cli.model.kernelargs import StatusError

KEPT = "massprop gives no values from here on, but records all data and estimates at the end"


def follow(lines: Iterable[str], source: VehicleSource, keep: Callable[[str], object], warn: Callable[[str], None]) -> Iterator[str]:
    """A line of JSON for each estimated cycle; ``keep`` gets lines of CSV, ``warn`` what is left out.

    :class:`InputError` where nothing can begin, or be kept. Where values can't go on, what comes is kept all the same.
    """
    if kernel().library is None:
        raise InputError(f"massprop live needs the compiled kernel, but {kernel().name} runs here; install a C compiler and massprop again")
    resolve.stated(source, records=1)
    numbered = ((number, line) for number, line in enumerate(lines, 1) if line.strip())
    number, first = next(numbered, (0, ""))
    if not number:
        raise InputError("standard input: no data; a log needs at least two control cycles")
    try:
        reader = StreamReader(source.vehicle, first)
    except RecordError as error:
        raise InputError(f"standard input, line {number}: {error}; begin with the names of all columns, or with a JSON object") from None
    columns = reader.columns
    gatherer = Gatherer(columns, source.vehicle.cycle.period_s)

    @cache
    def live() -> Legs:
        return Legs(resolve.stated(source, columns.jets, gatherer.records))

    keep(reader.header)
    for at, line in chain([(number, first)] if reader.is_json else [], numbered):
        yield from _one(at, line, reader, gatherer, live, keep, warn)
    yield from _flown(gatherer.started(), gatherer, live, warn)
    yield from map(_line, live().last() if gatherer.records and not gatherer.ended else [])


def _one(
    number: int,
    line: str,
    reader: StreamReader,
    gatherer: Gatherer,
    live: Callable[[], Legs],
    keep: Callable[[str], object],
    warn: Callable[[str], None],
) -> Iterator[str]:
    try:
        found = reader.read(line)
        cycles = gatherer.add(found)
    except RecordError as error:
        warn(f"standard input, line {number}: left out: {error}")
        return
    except InputError as error:
        if not gatherer.records:
            raise
        cycles = gatherer.end(found.time_s)
        warn(f"{error}; {KEPT}")
    keep(found.row)
    yield from _flown(cycles, gatherer, live, warn)


def _flown(cycles: Iterable[RecordedCycle], gatherer: Gatherer, live: Callable[[], Legs], warn: Callable[[str], None]) -> Iterator[str]:
    for cycle in cycles:
        if cycle.lacking:
            warn(
                f"standard input: a record before {cycle.end_s:.9g} s is missing, with its commands; values of this phase are contradicted "
                "from here on, because they would use a wrong command"
            )
        try:
            yield from map(_line, live().add(cycle))
        except StatusError as error:
            warn(f"standard input: the cycle to {cycle.end_s:.9g} s cannot be used ({error}); {KEPT}")
            gatherer.end(cycle.end_s)
            return


def _line(completed: Completed) -> str:
    """The line of JSON of a cycle."""
    found = completed.found
    estimates = {
        name: {
            "value": _said(value),
            "sigma": _said(sigma),
            "verdict": "contradicted" if completed.lacking and math.isfinite(value) else kernelflight.VERDICTS[int(verdict)],
        }
        for name, value, sigma, verdict in zip(
            ABOUT_PIVOT if completed.about_pivot else QUANTITIES, found.values[-1], found.sigmas[-1], found.verdicts[-1], strict=False
        )
    }
    key = "about_pivot" if completed.about_pivot else "estimates"
    return json.dumps({"time_s": completed.end_s, "phase": completed.phase, key: estimates})


def _said(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


RECORDED = "record.csv"


@contextmanager
def recording(folder: Path) -> Iterator[Callable[[str], None]]:
    """A function that keeps a line in record.csv whole; :class:`InputError` where a recording is there, or no room for one."""
    path = folder / RECORDED
    with ExitStack() as stack:
        with files.writing(path):
            stack.enter_context(files.made(folder))
            if path.exists():
                raise InputError(
                    f"{path}: exists already, and massprop does not overwrite a recording; choose another folder", option="out"
                )
        opened = cache(lambda: stack.enter_context(path.open("xb", buffering=0)))

        def keep(line: str) -> None:
            with files.writing(path):
                _keep(opened(), path, line.encode("utf-8", "replace"))

        yield keep


def _keep(file: BinaryIO, path: Path, line: bytes) -> None:
    whole = file.tell()
    try:
        while line:
            line = line[file.write(line) :]
    except OSError as error:
        file.truncate(whole)
        if not whole:
            path.unlink()
            raise
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); it holds the data before. Free disk space, and start again"
        ) from None
