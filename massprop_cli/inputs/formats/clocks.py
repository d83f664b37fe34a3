"""Clocks of a recording: times in seconds, defects of clocks, and the time that increments cover."""

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.recording import RecordedStream

NEAR, MOSTLY, SHORT = 0.4, 0.9, 0.5
"""Largest relative deviation of an even interval from the median; minimum fraction of these; largest deviation of a usual interval."""
GAP = 2.5
"""Interval over the median interval above which it is a gap, as in a log; not longer than a record, whose motion would be invented."""
MAX_WANDER = 0.75
"""Largest wander of time stamps about even intervals, samples; below the step that a lost sample makes."""
TOGETHER = 0.1
"""Interval over the mean interval below which samples come together; ..."""
_PAIRED, _SEVERAL = 0.3, 20
"""... fraction of such samples for sensors that alternate or bursts, and minimum number of samples."""
_WRAPPED = 1e-3
_ROUNDED = 0.01
"""Fraction of repeated times above which the times are rounded instead of a row repeated."""
_USUAL = 0.98
"""Fraction of the shortest intervals that determine the usual interval."""
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
"""Remedy by the number of seconds that a clock jumps back, within a thousandth."""
_LENGTH = re.compile(r"[_.]?(integral_?)?dt(_(s|ms|us|ns))?(\s*[\[(].*)?", re.IGNORECASE)
"""Suffix of a stream with the interval of each increment (PX4: ``delta_angle[0]``, ``delta_angle_dt``)."""
_COVERAGE = 0.05
"""Largest relative difference of the interval that increments cover from the interval of their time stamps: more than drift and scatter of
clocks, less than every twentieth increment missing."""


@dataclass(frozen=True)
class Times:
    """Times of a clock, s."""

    path: str
    s: Array
    """(n,) strictly increasing times after ``zero_s``, s."""
    zero_s: float

    @property
    def step_s(self) -> float:
        """Usual interval, s: mean without gaps (a lost row, if intervals are even), because the median of rounded times is biased."""
        steps = np.diff(self.s)
        usual = median(steps)
        off = np.abs(steps / usual - 1)
        even = (off < NEAR).mean() > MOSTLY
        return float(steps[off <= SHORT if even else steps <= GAP * usual].mean())

    def span(self) -> str:
        """First and last time on the clock itself, as text."""
        return f"{self.s[0] + self.zero_s:.13g} to {self.s[-1] + self.zero_s:.13g} s by {self.path!r}"


def outlying(times_s: Array) -> tuple[BoolArray, str]:
    """(n,) times so large that float64 does not resolve the usual interval there, and a text for a message after the value."""
    with np.errstate(over="ignore"):
        usual = median(np.abs(np.diff(times_s))) if len(times_s) > 1 else 0.0
    far: BoolArray = (np.spacing(np.abs(times_s)) > usual) & (usual > 0)
    return far, f"is not a time of this log (usual interval {usual:.6g} s); correct or cut the record"


def problem(times_s: Array, place: Callable[[int], str], zero_s: float, sensor: bool) -> str:
    """Defect of times (n,), with a remedy; empty if they are valid.

    ``place`` names a row, ``zero_s`` was subtracted from the times. Times of a ``sensor`` may not come in pairs or bursts.
    """
    steps = np.diff(times_s)
    if not len(steps):
        return "time has one sample only; name another clock"
    back = np.flatnonzero(steps <= 0)
    if back.size:
        first = int(back[0])
        jump = median(np.abs(steps)) - float(steps[first])
        wrapped = next((remedy for length, remedy in WRAPS.items() if abs(jump / length - 1) < _WRAPPED), None)
        remedy = wrapped or "name another clock, or sort and cut the recording"
        if (steps >= 0).all():
            remedy = "remove the repeated row, or name another clock"
            if len(back) > _ROUNDED * len(steps):
                remedy = (
                    "its times are rounded: state even = true, or name another clock; a table with one signal a row (its name and value) "
                    "must have a column for each signal first"
                )
        if not steps.any():
            remedy = "all its times are the same: write them with more digits, or name another clock"
        fall = f"from {times_s[first] + zero_s:.13g} to {times_s[first + 1] + zero_s:.13g} s"
        return f"time repeats or goes back at {place(first + 1)}, {fall}; {remedy}"
    # limited to usual intervals, so that a pause does not make all others short
    together = steps < TOGETHER * np.sort(steps)[: 1 + int(_USUAL * (len(steps) - 1))].mean()
    if not sensor or len(steps) < _SEVERAL or float(together.mean()) <= _PAIRED:
        return ""
    return (
        f"{100 * together.mean():.0f} % of its samples come right after another ({median(steps[together]):.3g} s, and "
        f"{median(steps[~together]):.3g} s between the others): if these are two sensors in one table, keep the rows of one; if they "
        "arrived in bursts, state even = true under the clock, or the clock of the sensor itself"
    )


def interval_stream(streams: Mapping[str, RecordedStream], paths: Sequence[str]) -> RecordedStream | None:
    """Stream with the interval that each increment of ``paths`` covers; None without one."""
    same = [len(set(letters)) == 1 for letters in zip(*paths, strict=False)]
    stem = paths[0][: [*same, False].index(False)].rstrip("_.[( ")
    rows = streams[paths[0]].rows
    called = [one for path, one in streams.items() if path.startswith(stem) and _LENGTH.fullmatch(path, len(stem))]
    return next((one for one in called if stem and one.rows == rows), None)


def covered_interval(length: RecordedStream) -> float:
    """Median interval that an increment covers, in the stream's unit."""
    values = np.asarray(length.values, np.float64)
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else np.nan


def coverage_defect(streams: Mapping[str, RecordedStream], paths: Sequence[str], step_s: float) -> str:
    """Reason why increments do not cover the whole time, if the file gives the covered intervals; else empty."""
    length = interval_stream(streams, paths) if paths else None
    if length is None or covers_all(length, [step_s]):
        return ""
    covered = covered_interval(length)
    return (
        f"an increment covers {covered:.6g} by {length.path!r}, and they come every {step_s:.6g} s: the motion in between is "
        'lost. Log all of them, or map rates instead (values = "sample" or "mean"), or correct the clock'
    )


def covers_all(length: RecordedStream, step_s: Sequence[float]) -> bool:
    """Whether increments cover one of the intervals ``step_s``, s; tries all time units if none is recorded."""
    recorded = units.factor(length.unit, units.TIME)
    factors = [recorded] if recorded is not None else list(units.TIME.values())
    return any(abs(covered_interval(length) * factor / step - 1) < _COVERAGE for factor in factors for step in step_s if step > 0)
