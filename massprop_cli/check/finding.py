"""Models of a check's result; they are the schema (``massprop schema check``)."""

from typing import Literal

from pydantic import Field

from massprop_cli.base.arrays import BoolArray, runs
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.inputs.tablefile import Place
from massprop_cli.result.schema import Item

Subject = Literal["reading", "sampling", "imu", "commands", "timing", "attitude", "model", "excitation"]
SUBJECTS: dict[Subject, str] = {
    "reading": "what the file holds",
    "sampling": "time of the records",
    "imu": "gyro and accelerometer",
    "commands": "commands",
    "timing": "delay, lag and clocks",
    "attitude": "attitude against gyro and gravity",
    "model": "log against vehicle file",
    "excitation": "what the motion shows",
}
Grade = Literal["unusable", "fault", "note"]


class Finding(Item):
    """One defect or note."""

    subject: Subject
    code: str
    grade: Grade = Field(description="unusable: no estimate is possible; fault: values or sigmas may be wrong; note: for information")
    what: str
    where: str = Field(description='rows, as "row 120 to 130, and 3 more", or a phase; empty: the whole log')
    sure: str = Field(description='"certain", or the chance of error, or competing hypotheses')
    remedy: str


class ExpectedQuantity(Item):
    """Expected sigma and verdict of one quantity."""

    phase: str
    quantity: str
    unit: str
    sigma: float | None = Field(description="one standard deviation; null: not estimated")
    verdict: Verdict
    wanted: str | None = Field(description='wanted precision as stated, "2%"; empty: convergence alone; null: nothing wanted')
    wanted_sigma: float | None
    reached: bool | None = Field(description="converged with the wanted precision; null: nothing wanted")
    reason: str


class Check(Item):
    """Document that ``massprop check --json`` prints."""

    schema_: Literal["massprop/check/1"] = Field("massprop/check/1", alias="schema")
    massprop: str
    log: str
    input_sha256: str
    vehicle: str
    rows: int
    usable: bool
    fit: bool = Field(description="usable, without faults and with all wanted precisions reached")
    findings: list[Finding]
    expected: list[ExpectedQuantity]
    delay: str = Field(description="command delay that the log supports, in words; empty: none")
    low_passes: list[str] = Field([], description="cutoff and latency of each sensor that the log supports, in words; empty: none")
    exit_code: int


def finding(subject: Subject, code: str, grade: Grade, what: str, remedy: str, where: str = "", sure: str = "certain") -> Finding:
    """Make a finding; by default it is certain and concerns the whole log."""
    return Finding(subject=subject, code=code, grade=grade, what=what, where=where, sure=sure, remedy=remedy)


def rows(where: BoolArray, place: Place) -> str:
    """Text for the first run of True rows and the number of further runs; ``place`` names a row."""
    spans = runs(where).tolist()
    if not spans:
        return ""
    first, last = spans[0][0], spans[0][1] - 1
    named = place(first) if first == last else f"{place(first)} to {place(last).partition(' ')[2]}"
    more = len(spans) - 1
    return f"{named}, and {more} more place{'s' if more > 1 else ''}" if more else named
