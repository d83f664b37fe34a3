"""What a check says. The models below are the schema (``massprop schema check``)."""

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
    """One thing that is not as it should be."""

    subject: Subject
    code: str
    grade: Grade = Field(description="unusable: no estimate can be made; fault: values or sigmas may be wrong; note: worth knowing")
    what: str
    where: str = Field(description='rows, as "row 120 to 130, and 3 more", or a phase; empty for the whole log')
    sure: str = Field(description='"certain", or what chance or rivals there are')
    remedy: str


class ExpectedQuantity(Item):
    """What an estimate of this log gives of one quantity."""

    phase: str
    quantity: str
    unit: str
    sigma: float | None = Field(description="one standard deviation; null where nothing can be said")
    verdict: Verdict
    wanted: str | None = Field(description='as it was stated, "2%"; empty for converged alone; null where nothing is wanted')
    wanted_sigma: float | None
    reached: bool | None = Field(description="converged and that precise; null where nothing is wanted")
    reason: str


class Check(Item):
    """The whole of what ``massprop check --json`` prints."""

    schema_: Literal["massprop/check/1"] = Field("massprop/check/1", alias="schema")
    massprop: str
    log: str
    input_sha256: str
    vehicle: str
    rows: int
    usable: bool
    fit: bool = Field(description="usable, and neither a fault nor an unreached want")
    findings: list[Finding]
    expected: list[ExpectedQuantity]
    delay: str = Field(description="what the log shows of its command delay, in words; empty where nothing")
    low_passes: list[str] = Field([], description="what the log shows of each sensor's cutoff and latency, in words; empty where nothing")
    exit_code: int


def finding(subject: Subject, code: str, grade: Grade, what: str, remedy: str, where: str = "", sure: str = "certain") -> Finding:
    """Certain, by default, from the log itself."""
    return Finding(subject=subject, code=code, grade=grade, what=what, where=where, sure=sure, remedy=remedy)


def rows(where: BoolArray, place: Place) -> str:
    """The first run of rows that are True in words, and how many more there are; ``place`` names a row as a person finds it."""
    found = runs(where).tolist()
    if not found:
        return ""
    first, last = found[0][0], found[0][1] - 1
    named = place(first) if first == last else f"{place(first)} to {place(last).partition(' ')[2]}"
    more = len(found) - 1
    return f"{named}, and {more} more place{'s' if more > 1 else ''}" if more else named
