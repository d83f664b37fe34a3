"""One log, from what it is read from to what is said of it: the result, what it was held against, and the exit code.

The command, a campaign and Python all come through here, so that the same log with the same demands ends in the same words everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from massprop_cli import analysis, exits, extremes, files, judge, tablefile, telemetry
from massprop_cli import vehicle as vehicles
from massprop_cli.analysis import Analysis, Progress
from massprop_cli.expect import Expectations
from massprop_cli.report import result
from massprop_cli.report.result import Result
from massprop_cli.tablefile import Table
from massprop_cli.vehicle import VehicleSource


@dataclass(frozen=True)
class Demands:
    """What is asked of a result."""

    required: tuple[str, ...] = ()
    """Quantities that must be converged in every phase (:func:`massprop_cli.require.quantities`)."""
    expected: Expectations | None = None


@dataclass(frozen=True)
class Judged:
    """One log, estimated and held against what was demanded."""

    result: Result
    """The whole of result.json."""
    analysis: Analysis = field(repr=False)
    """Everything in between: the log, aligned samples, histories, as read-only arrays."""
    unconverged: tuple[str, ...] = ()
    """Required quantities that are anything but converged, a phrase each."""
    missed: tuple[str, ...] = ()
    """What is not as expected, a phrase each."""

    @property
    def exit_code(self) -> int:
        """By the contract: 4 goes before 5."""
        return exits.NOT_CONVERGED if self.unconverged else exits.NOT_EXPECTED if self.missed else 0

    @property
    def message(self) -> str:
        """Why the exit code isn't 0; empty where it is."""
        reasons = [f"required but not converged: {'; '.join(self.unconverged)}"] if self.unconverged else []
        reasons += [f"not as expected: {'; '.join(self.missed)}"] if self.missed else []
        return ". ".join(reasons)


def of_file(
    log: Path,
    vehicle: Path | None = None,
    assignments: Sequence[str] = (),
    demands: Demands | None = None,
    progress: Progress | None = None,
    map_file: Path | None = None,
) -> Judged:
    """A log read from its file, with the vehicle that is named or belongs to it; :class:`InputError` where either can't be used."""
    files.check_name(str(log))
    if progress is not None:
        progress("reading", 0.0)
    table = tablefile.read_table(log, map_file)
    return of_table(table, vehicles.find(log, vehicle, table.embedded_vehicle, assignments), assignments, demands, progress)


def of_table(
    table: Table,
    source: VehicleSource,
    assignments: Sequence[str] = (),
    demands: Demands | None = None,
    progress: Progress | None = None,
) -> Judged:
    """The same of a log and a vehicle at hand."""
    # what overflows or divides by zero ends as "nothing can be said", not as noise on stderr
    with np.errstate(all="ignore"), extremes.refused(table.path, source):
        return _judged(analysis.examine(telemetry.read(table, source.vehicle), source, assignments, progress), demands or Demands())


def _judged(found: Analysis, demands: Demands) -> Judged:
    told = result.result(found)
    held = told if demands.expected is None else judge.judge(told, demands.expected)
    return Judged(held, found, tuple(unconverged(held, demands.required)), tuple(judge.missed(held)))


def unconverged(found: Result, required: Sequence[str]) -> list[str]:
    """Required quantities whose verdict is another than converged, phase by phase; those that share a reason are named together."""
    said = []
    for phase in found.phases:
        alike: dict[tuple[str, str], list[str]] = {}
        for name in required:
            item = phase.estimates[name]
            if item.verdict != "converged":
                alike.setdefault((item.verdict, item.reason), []).append(name)
        for (verdict, reason), names in alike.items():
            said.append(f"{', '.join(names)} in phase {phase.name} {'is' if len(names) == 1 else 'are'} {verdict} ({reason})")
    return said
