"""The outcome of one log, stored as outcome.json in its result folder, with all data of the campaign's tables."""

import zlib
from collections.abc import Iterable, Sequence
from typing import Literal, TypeVar, overload

from pydantic import BaseModel, ConfigDict, Field

from massprop_cli.base import escape, exits
from massprop_cli.campaign.plan import Job
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.inputs.equipment import EnvironmentKind
from massprop_cli.result.judge import together

FILE = "outcome.json"
CHECKED = "check.json"
"""Replaces result.json in a campaign that only checks its logs."""
UNKEPT = ""
"""Fingerprint of an outcome that the next batch always repeats, because the failure may not lie in the log."""


class OutcomePart(BaseModel):
    """Part of an outcome; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


_Kind = TypeVar("_Kind", bound=OutcomePart)


class Value(OutcomePart):
    """One quantity, SI, products as tensor elements; sigma is one standard deviation."""

    value: float | None
    sigma: float | None
    shared: float | None = Field(
        None, description="of sigma, what all logs of this vehicle file have in common (thrust scale, known quantities); null: not known"
    )
    alike: float = Field(
        0.0,
        description="of the rest of sigma, what an uncertain vehicle file (jets, IMU, delay) makes, as stated or by a model discrepancy: "
        "all logs may have it in common",
    )
    verdict: Verdict
    met: bool | None = Field(None, description="its expectation; null without one")
    expected: float | None = Field(None, description="what was expected of it; null without an expectation")


class PhaseQuantities(OutcomePart):
    """Ten quantities of a phase, or of the docked object; of a phase on a bearing or pedestal, nine more."""

    part: Literal["phase", "docked"]
    name: str
    estimates: dict[str, Value]
    about_pivot: dict[str, Value] = Field({}, description="inertia and first moment about the pivot; empty without one")

    @property
    def items(self) -> dict[str, Value]:
        """All quantities; the names of those about the pivot have a prefix."""
        return together(self.estimates, self.about_pivot)


class StatedVehicle(OutcomePart):
    """The vehicle as its file states it."""

    name: str
    sha256: str
    environment: EnvironmentKind
    bearing_mass_kg: float


class Outcome(OutcomePart):
    """One log: its exit code by the contract, and what was found."""

    schema_: Literal["massprop/outcome/1"] = Field("massprop/outcome/1", alias="schema")
    fingerprint: str = Field(description="sha256 of log, vehicle, expectations, settings and program; empty: to be tried again")
    exit_code: int
    message: str = Field(description="why exit_code isn't 0, on one line")
    input_sha256: str | None
    vehicle: StatedVehicle | None = None
    method: str | None = None
    duration_s: float | None = None
    cycles: int | None = None
    delay_cycles: float | None = None
    warnings: list[str] = Field([], description="codes")
    missed: list[str] = Field([], description="what is not converged or not as expected, a phrase each")
    bodies: list[PhaseQuantities] = []
    files: list[str] = Field([], description="of the result folder, outcome.json aside")


STATES = {1: "internal error", 3: "unusable", 6: "contradicted", 4: "not converged", 5: "not as expected", None: "not tried", 0: "done"}
"""Meaning of each exit code, the most serious first."""


def contradicted(outcome: Outcome | None) -> int:
    """Number of contradicted quantities."""
    return sum(item.verdict == "contradicted" for body in (outcome.bodies if outcome else []) for item in body.items.values())


def state(outcome: Outcome | None) -> str:
    """The outcome in words: the meaning of its exit code, and whether it has contradictions or warnings."""
    code = outcome.exit_code if outcome else None
    accepted = contradicted(outcome) > 0 and code != exits.CONTRADICTED
    doubt = "contradicted" if accepted else "with warnings" if outcome is not None and outcome.warnings else ""
    return STATES[code] + f", {doubt}" * bool(doubt)


def to_json(outcome: Outcome) -> bytes:
    """Canonical JSON text: equal outcomes give equal bytes."""
    return escape.document(outcome).encode()


def from_json(content: bytes) -> Outcome | None:
    """Parse outcome.json; None if another version wrote it or it is damaged, so that the batch repeats the log."""
    try:
        return Outcome.model_validate_json(content)
    except ValueError:
        return None


def packed(item: OutcomePart) -> bytes:
    """Compress an outcome, to about a fifteenth of its size in memory."""
    return zlib.compress(item.model_dump_json(by_alias=True).encode())


def unpacked(kind: type[_Kind], content: bytes) -> _Kind:
    """Decompress the bytes of :func:`packed`."""
    return kind.model_validate_json(zlib.decompress(content))


class CampaignRow(OutcomePart):
    """One log, in the campaign's order."""

    name: str = Field(description="of its result folder in results/")
    log: str = Field(description="path below what was named")
    tags: list[str]
    outcome: Outcome | None = Field(description="null: not tried, after --fail-fast")


class CompressedRows(Sequence[CampaignRow]):
    """Sequence of rows, stored compressed in about 1 kB each instead of 15 kB. Access returns copies."""

    def __init__(self, rows: Iterable[CampaignRow] = ()) -> None:
        self._packed = [packed(row) for row in rows]

    def __len__(self) -> int:
        return len(self._packed)

    @overload
    def __getitem__(self, index: int) -> CampaignRow: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[CampaignRow]: ...
    def __getitem__(self, index: int | slice) -> CampaignRow | Sequence[CampaignRow]:
        """One row, or the rows of a slice."""
        if isinstance(index, slice):
            return [unpacked(CampaignRow, one) for one in self._packed[index]]
        return unpacked(CampaignRow, self._packed[index])

    def __setitem__(self, index: int, row: CampaignRow) -> None:
        self._packed[index] = packed(row)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CompressedRows) and self._packed == other._packed

    __hash__ = None  # type: ignore[assignment]


def row(job: Job, outcome: Outcome | None) -> CampaignRow:
    """The row of a job and its outcome."""
    return CampaignRow(name=job.name, log=job.shown, tags=list(job.tags), outcome=outcome)
