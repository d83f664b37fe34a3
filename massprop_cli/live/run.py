"""Flow of ``massprop live``: standard input to an estimate after each cycle, and to a recording for the final estimate."""

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
from massprop_cli.live.cycles import CycleAssembler, RecordedCycle
from massprop_cli.live.estimator import CycleEstimate, FlightEstimator
from massprop_cli.live.records import RecordError, StreamReader
from massprop_cli.model.kernelargs import StatusError

ONLY_RECORDING = "massprop gives no values from here on, but records all data and estimates at the end"


def follow(lines: Iterable[str], source: VehicleSource, keep: Callable[[str], object], warn: Callable[[str], None]) -> Iterator[str]:
    """Yield a line of JSON after each estimated cycle.

    ``keep`` receives the lines of the recording, ``warn`` the messages. Raise :class:`InputError` if the estimate cannot begin. After a
    later problem, the function only records.
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
    assembler = CycleAssembler(columns, source.vehicle.cycle.period_s)

    @cache
    def estimator() -> FlightEstimator:
        return FlightEstimator(resolve.stated(source, columns.jets, assembler.records))

    keep(reader.header)
    for at, line in chain([(number, first)] if reader.is_json else [], numbered):
        yield from _one(at, line, reader, assembler, estimator, keep, warn)
    yield from _estimated(assembler.start(), assembler, estimator, warn)
    yield from map(_line, estimator().last() if assembler.records and not assembler.ended else [])


def _one(
    number: int,
    line: str,
    reader: StreamReader,
    assembler: CycleAssembler,
    estimator: Callable[[], FlightEstimator],
    keep: Callable[[str], object],
    warn: Callable[[str], None],
) -> Iterator[str]:
    """Process one line; leave out an invalid record, and only record after an unusable one."""
    try:
        record = reader.read(line)
        cycles = assembler.add(record)
    except RecordError as error:
        warn(f"standard input, line {number}: left out: {error}")
        return
    except InputError as error:
        if not assembler.records:
            raise
        cycles = assembler.end(record.time_s)
        warn(f"{error}; {ONLY_RECORDING}")
    keep(record.row)
    yield from _estimated(cycles, assembler, estimator, warn)


def _estimated(
    cycles: Iterable[RecordedCycle], assembler: CycleAssembler, estimator: Callable[[], FlightEstimator], warn: Callable[[str], None]
) -> Iterator[str]:
    """Estimate some cycles; end the estimate at a cycle that the kernel refuses."""
    for cycle in cycles:
        if cycle.command_lost:
            warn(
                f"standard input: a record before {cycle.end_s:.9g} s is missing, with its commands; values of this phase are contradicted "
                "from here on, because they would use a wrong command"
            )
        try:
            yield from map(_line, estimator().add(cycle))
        except StatusError as error:
            warn(f"standard input: the cycle to {cycle.end_s:.9g} s cannot be used ({error}); {ONLY_RECORDING}")
            assembler.end(cycle.end_s)
            return


def _line(estimate: CycleEstimate) -> str:
    """The line of JSON of an estimate."""
    reported = estimate.reported
    names = ABOUT_PIVOT if estimate.about_pivot else QUANTITIES
    estimates = {
        name: {
            "value": _finite(value),
            "sigma": _finite(sigma),
            "verdict": "contradicted" if estimate.command_lost and math.isfinite(value) else kernelflight.VERDICTS[int(verdict)],
        }
        for name, value, sigma, verdict in zip(names, reported.values[-1], reported.sigmas[-1], reported.verdicts[-1], strict=False)
    }
    key = "about_pivot" if estimate.about_pivot else "estimates"
    return json.dumps({"time_s": estimate.end_s, "phase": estimate.phase, key: estimates})


def _finite(value: float) -> float | None:
    """The value, None if it is not finite."""
    return float(value) if math.isfinite(value) else None


RECORDED = "record.csv"
"""Name of the recording."""


@contextmanager
def recording(folder: Path) -> Iterator[Callable[[str], None]]:
    """A function that appends a complete line to record.csv; raise :class:`InputError` if the file exists or cannot be written."""
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
    """Append a line, or restore the file's length and raise :class:`InputError` if it cannot be written."""
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
