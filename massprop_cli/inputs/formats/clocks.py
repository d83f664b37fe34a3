"""Clocks of a recording: times in seconds, what is wrong with those that are none, and whether increments cover all the time."""

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.recording import RecordedStream

NEAR, MOSTLY, SHORT = 0.4, 0.9, 0.5
"""Part of the median interval within which intervals are near it; part of them that are; how far off one of these is at most."""
GAP = 2.5
"""Times the median interval, as in a log: more is a gap. None may be longer than a record, or that would be made up."""
LEAPT = 0.75
"""Samples by which stamps may wander from even intervals: less than by one that was lost."""
TOGETHER = 0.1
"""Part of the mean interval below which samples come together; ..."""
_PAIRED, _SEVERAL = 0.3, 20
"""... the part of them that do, of sensors that take turns or of bursts, and how many samples tell."""
_WRAPPED = 1e-3
_ROUNDED = 0.01
"""Part of the times that stand still, from which on it is no row that stands twice."""
_USUAL = 0.98
"""Part of the steps, the shortest, that tell the usual one."""
WRAPS = {
    **{
        2.0**bits * factor: f"its counter wraps: add 2^{bits} {unit} to all that follows"
        for bits in (16, 24, 31, 32)
        for unit, factor in units.TIME.items()
    },
    604800.0: "a week of GPS time ends: add 604800 s to all that follows",
    86400.0: "it passes midnight: add a day to all that follows, or write dates",
    1.0: "it holds the part of a second: name the whole seconds as path, and nanoseconds = this one",
}
"""What to do about a clock that goes back by so many seconds, to a thousandth of them."""
_LENGTH = re.compile(r"[_.]?(integral_?)?dt(_(s|ms|us|ns))?(\s*[\[(].*)?", re.IGNORECASE)
"""How a stream is called, after its increments, of the time that each covers (PX4: ``delta_angle[0]``, ``delta_angle_dt``)."""
_COVERS = 0.05
"""Part by which what increments cover may differ from their stamps' intervals: that much clocks drift and scatter, and the least that a
logger leaves out is every twentieth."""


@dataclass(frozen=True)
class Times:
    """A clock, in seconds."""

    path: str
    s: Array
    """(n,) strictly increasing, less the recording's zero."""
    zero_s: float

    @property
    def step_s(self) -> float:
        """The usual interval: the mean of all but gaps, since rounded times have a biased median.

        Where nearly all intervals are alike, one lost row is a gap.
        """
        steps = np.diff(self.s)
        usual = median(steps)
        off = np.abs(steps / usual - 1)
        even = (off < NEAR).mean() > MOSTLY
        return float(steps[off <= SHORT if even else steps <= GAP * usual].mean())

    def span(self) -> str:
        """From when to when, by the clock itself."""
        return f"{self.s[0] + self.zero_s:.13g} to {self.s[-1] + self.zero_s:.13g} s by {self.path!r}"


def outlying(times_s: Array) -> tuple[BoolArray, str]:
    """(n,) whether each time is so large that numbers there are farther apart than records, and what to say of it after its value."""
    with np.errstate(over="ignore"):
        usual = median(np.abs(np.diff(times_s))) if len(times_s) > 1 else 0.0
    far: BoolArray = (np.spacing(np.abs(times_s)) > usual) & (usual > 0)
    return far, f"is not a time of this log (usual interval {usual:.6g} s); correct or cut the record"


def problem(times_s: Array, place: Callable[[int], str], zero_s: float, sensor: bool) -> str:
    """Why times (n,) are none, with what to do; empty where they are.

    ``place`` names one of them, ``zero_s`` is what was taken off; those of a ``sensor`` may not come in pairs or bursts.
    """
    steps = np.diff(times_s)
    if not len(steps):
        return "time has one sample only; name another clock"
    back = np.flatnonzero(steps <= 0)
    if back.size:
        first = int(back[0])
        fallen = median(np.abs(steps)) - float(steps[first])
        wrapped = next((cure for length, cure in WRAPS.items() if abs(fallen / length - 1) < _WRAPPED), None)
        cure = wrapped or "name another clock, or sort and cut the recording"
        if (steps >= 0).all():
            cure = "remove the repeated row, or name another clock"
            if len(back) > _ROUNDED * len(steps):
                cure = (
                    "its times are rounded: state even = true, or name another clock; a table with one signal a row (its name and value) "
                    "must have a column for each signal first"
                )
        if not steps.any():
            cure = "all its times are the same: write them with more digits, or name another clock"
        fall = f"from {times_s[first] + zero_s:.13g} to {times_s[first + 1] + zero_s:.13g} s"
        return f"time repeats or goes back at {place(first + 1)}, {fall}; {cure}"
    # a pause makes no pairs of all that is not
    together = steps < TOGETHER * np.sort(steps)[: 1 + int(_USUAL * (len(steps) - 1))].mean()
    if not sensor or len(steps) < _SEVERAL or float(together.mean()) <= _PAIRED:
        return ""
    return (
        f"{100 * together.mean():.0f} % of its samples come right after another ({median(steps[together]):.3g} s, and "
        f"{median(steps[~together]):.3g} s between the others): if these are two sensors in one table, keep the rows of one; if they "
        "arrived in bursts, state even = true under the clock, or the clock of the sensor itself"
    )


def covering(streams: Mapping[str, RecordedStream], paths: Sequence[str]) -> RecordedStream | None:
    """The stream that says how long each increment of these covers; None where none is called so."""
    same = [len(set(letters)) == 1 for letters in zip(*paths, strict=False)]
    stem = paths[0][: [*same, False].index(False)].rstrip("_.[( ")
    rows = streams[paths[0]].rows
    called = [one for path, one in streams.items() if path.startswith(stem) and _LENGTH.fullmatch(path, len(stem))]
    return next((one for one in called if stem and one.rows == rows), None)


def covered(length: RecordedStream) -> float:
    """What an increment covers, as recorded."""
    values = np.asarray(length.values, np.float64)
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else np.nan


def uncovered(streams: Mapping[str, RecordedStream], paths: Sequence[str], step_s: float) -> str:
    """Why increments don't cover the time since the one before, where the file says what they cover; else empty."""
    length = covering(streams, paths) if paths else None
    if length is None or covers_all(length, [step_s]):
        return ""
    return (
        f"an increment covers {covered(length):.6g} by {length.path!r}, and they come every {step_s:.6g} s: the motion in between is "
        'lost. Log all of them, or map rates instead (values = "sample" or "mean"), or correct the clock'
    )


def covers_all(length: RecordedStream, step_s: Sequence[float]) -> bool:
    """Whether increments cover their interval, for any of these; their lengths' unit is seldom recorded, and any is taken."""
    recorded = units.factor(length.unit, units.TIME)
    factors = [recorded] if recorded is not None else list(units.TIME.values())
    return any(abs(covered(length) * factor / step - 1) < _COVERS for factor in factors for step in step_s if step > 0)
