"""One log, from what it is read from to what is said of it: the result, what it was tested against, and the exit code.

The command, a campaign and Python all come through here, so that the same log with the same demands ends in the same words everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massprop_cli import QUANTITIES, flow
from massprop_cli.base import exits, files
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.flow import Analysis, Progress
from massprop_cli.inputs import logfile, telemetry, vehiclefile
from massprop_cli.inputs.require import Requirement
from massprop_cli.inputs.tablefile import Table, give_back
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.result import build, judge
from massprop_cli.result.schema import EstimateItem, PhaseItem, Result

if TYPE_CHECKING:
    from massprop_cli.inputs.expect import Expectations


@dataclass(frozen=True)
class Demands:
    """What is asked of a result."""

    required: tuple[Requirement, ...] = ()
    """What must be converged, and how precisely, in every phase (:func:`massprop_cli.inputs.require.requirements`)."""
    expected: Expectations | None = None
    allow_contradicted: bool = False
    """Whether a log that contradicts its vehicle file is accepted."""


@dataclass(frozen=True)
class Unmet:
    """What of the demands a result does not meet, a phrase each. This alone decides exit code and message."""

    contradicted: tuple[str, ...] = ()
    """Phases, and the docked object, in which log and vehicle file contradict each other."""
    unconverged: tuple[str, ...] = ()
    """Required quantities that are not converged."""
    imprecise: tuple[str, ...] = ()
    """Required quantities that are converged, but not as precisely as they must be."""
    missed: tuple[str, ...] = ()
    """What is not as expected."""

    @property
    def exit_code(self) -> int:
        """By the contract: 6 goes before 4, and 4 before 5."""
        if self.contradicted:
            return exits.CONTRADICTED
        return exits.NOT_CONVERGED if self.unconverged or self.imprecise else exits.NOT_EXPECTED if self.missed else 0

    @property
    def message(self) -> str:
        """Why the exit code isn't 0; empty where it is."""
        said = {
            "the log contradicts the vehicle file: ": self.contradicted,
            "required but not converged: ": self.unconverged,
            "required but not precise enough: ": self.imprecise,
            "not as expected: ": self.missed,
        }
        return ". ".join(f"{what}{'; '.join(phrases)}" for what, phrases in said.items() if phrases)

    @property
    def phrases(self) -> list[str]:
        """All of them."""
        return [*self.contradicted, *self.unconverged, *self.imprecise, *self.missed]


@dataclass(frozen=True)
class Judged:
    """One log, estimated and tested against what was demanded."""

    result: Result
    """The whole of result.json."""
    analysis: Analysis = field(repr=False)
    """Everything in between: the log, aligned samples, histories, as read-only arrays."""
    unmet: Unmet = Unmet()

    @property
    def exit_code(self) -> int:
        """What the command ends with."""
        return self.unmet.exit_code

    @property
    def message(self) -> str:
        """Why the exit code isn't 0; empty where it is."""
        return self.unmet.message


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
    table = logfile.read_table(log, map_file)
    source = vehiclefile.find(log, vehicle, table.embedded_vehicle, assignments)
    with _guarded(table.path, source):
        read = telemetry.read(table, source.vehicle)
        del table  # as large as its file once more
        give_back()
        return _judged(flow.examine(read, source, assignments, progress), demands or Demands())


def of_table(table: Table, source: VehicleSource, assignments: Sequence[str] = (), demands: Demands | None = None) -> Judged:
    """The same of a log and a vehicle at hand."""
    with _guarded(table.path, source):
        return _judged(flow.examine(telemetry.read(table, source.vehicle), source, assignments), demands or Demands())


@contextmanager
def _guarded(log: Path, source: VehicleSource) -> Iterator[None]:
    """What overflows or divides by zero ends as "nothing can be said", not as noise on stderr."""
    with np.errstate(all="ignore"), vehiclefile.refused(log, source):
        yield


def _judged(found: Analysis, demands: Demands) -> Judged:
    told = build.result(found)
    told = told if demands.expected is None else judge.judge(told, demands.expected)
    return Judged(told, found, unmet(told, demands))


def unmet(found: Result, demands: Demands) -> Unmet:
    """What of the demands a result does not meet; what is expected must stand in it already (:func:`massprop_cli.result.judge.judge`)."""
    required = demands.required + (demands.expected.required if demands.expected is not None else ())
    return Unmet(
        contradicted=() if demands.allow_contradicted else tuple(contradicted(found)),
        unconverged=tuple(unconverged(found, [item.quantity for item in required])),
        imprecise=tuple(imprecise(found, required)),
        missed=(*judge.missed(found), *filter(None, judge.unpredicted(found).values())),
    )


def contradicted(found: Result) -> list[str]:
    """Phases, and the docked object, with a contradicted quantity: which these are, and the cause."""
    said = []
    for part, body in judge.parts(found):
        told = {name: item for name, item in judge.items(body).items() if item.verdict != "unobservable"}
        names = [name for name, item in told.items() if item.verdict == "contradicted"]
        if names:
            listed = "all quantities" if len(names) == len(told) else ", ".join(names)
            said.append(f"{listed} in {part} ({judge.contradiction(body)})")
    return said


def unconverged(found: Result, required: Sequence[str]) -> list[str]:
    """Required quantities whose verdict is another than converged, phase by phase; those that share a reason are named together."""
    said = []
    for phase in found.phases:
        alike: dict[tuple[str, str], list[str]] = {}
        for name in dict.fromkeys(required):
            item = _required(phase, name)
            if item.verdict != "converged":
                alike.setdefault((item.verdict, item.reason), []).append(name)
        for (verdict, reason), names in alike.items():
            said.append(f"{', '.join(names)} in phase {phase.name} {'is' if len(names) == 1 else 'are'} {verdict} ({reason})")
    return said


def _required(phase: PhaseItem, name: str) -> EstimateItem:
    found = judge.items(phase).get(name)
    if found is None:
        raise InputError(
            f"{name} is required, and phase {phase.name} has no pivot (environment.kind); require only {', '.join(QUANTITIES)}"
        )
    return found


def imprecise(found: Result, required: Sequence[Requirement]) -> list[str]:
    """Required quantities that are converged in a phase, but with a sigma above the one that is wanted."""
    said = []
    for phase in found.phases:
        for item in required:
            estimate = _required(phase, item.quantity)
            if item.precision is None or estimate.verdict != "converged" or estimate.value is None:
                continue
            wanted, sigma, unit = item.precision.sigma(estimate.value), estimate.sigma, estimate.unit
            if sigma is None or not sigma <= wanted:
                has = "no sigma" if sigma is None else f"a sigma of {sigma:.3g} {unit}"
                said.append(f"{item.quantity} in phase {phase.name} has {has}, and {item} requires {wanted:.3g} {unit} at most")
    return said
