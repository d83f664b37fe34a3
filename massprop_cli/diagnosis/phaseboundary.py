"""A phase boundary stated too early or too late, or a vehicle that is held or caught within a phase.

Of a few cycles no body can be told, so that no search for a change finds them. But without them the rest fits.
"""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY
from massprop_cli.base.configfile import written
from massprop_cli.diagnosis.corrections import Correction, shown
from massprop_cli.diagnosis.screening import Screening, screened
from massprop_cli.estimate.whitening import NONE
from massprop_cli.inputs.vehicle import Phase

LONGEST, MOST = 128, 0.25
"""Most cycles that are left out, and the most of them as a part of all."""
BEYOND = 8.0
"""Sigmas of chance beyond which a look leaves more than noise."""
LEFT = 0.3
"""Part of what is beyond noise that may be left without them."""
NEAR = 3
"""Cycles, beside those whose commands are not known yet, within which a stretch begins with its phase."""


class Border(NamedTuple):
    """Where a phase should begin, or end."""

    phase: Phase | None
    """As stated; None: the only one, which isn't."""
    number: int
    begins: bool
    """Whether it should begin later; else end earlier."""
    time_s: float
    left_out: int
    """Cycles."""
    log_s: tuple[float, float]
    """When the whole log begins and ends."""

    @property
    def key(self) -> str:
        """Of the phase, that is to be corrected."""
        return "start_s" if self.begins else "end_s"

    @property
    def words(self) -> str:
        """For the reader."""
        name = "" if self.phase is None else f" of phase {self.phase.name}"
        which, side = ("first", "from") if self.begins else ("last", "until")
        other = "until then something else was docked" if self.begins else "from then on something else is docked"
        return (
            f"the log fits without the {which} {self.left_out} cycles{name}, that is {side} {shown(self.time_s)} s: {other}, "
            f"the vehicle was held, or a jet failed; correct {self.key} under [[phases]]"
        )

    @property
    def correction(self) -> Correction:
        """The key that corrects it."""
        if self.phase is not None:
            return Correction((f"phases.{self.number}.{self.key}={self.time_s}",))
        begin_s, end_s = self.log_s
        only = {"name": "all", "start_s": begin_s, "end_s": end_s} | {self.key: self.time_s}
        return Correction((f"phases={written([only])}",))


def border(screening: Screening, end_s: float) -> Border | None:
    """Where leaving out the first or the last cycles leaves nothing but noise, of a look that leaves more; None where it doesn't.

    ``end_s`` is when the whole log ends, of which the look may have but a stretch.
    """
    plain, count = plainly(screening, screening.piece), screening.piece.stop - screening.piece.start
    if plain is None:
        return None
    screening, most = plain, min(LONGEST, int(MOST * count))
    if beyond_noise(screening) < BEYOND * np.sqrt(2 * 6 * count) or most < 1:
        return None
    sides = [_fewest(screening, most, begins) for begins in (True, False)]
    found = min((one for one in sides if one is not None), key=lambda one: one[0], default=None)
    if found is not None and beyond_noise(found[2]) > LEFT * beyond_noise(screening):
        return None  # what is left is spread over all of it: noise that was stated too small
    return None if found is None else _placed(screening, *found[:2], end_s)


def beyond_noise(screening: Screening) -> float:
    """Sum of squares that body and commands leave, over the stated noise, beyond that of noise."""
    free = screening.free
    squares = np.concatenate([free.gyro.left, free.accelerometer.left]) + screening.stated.chi_square * free.variance
    return float((squares / np.maximum(screening.noise, TINY)).sum() - 6 * (screening.piece.stop - screening.piece.start))


def plainly(screening: Screening, piece: slice) -> Screening | None:
    """A piece of the same beside the noise alone, or what is stated beside it: a torque that wanders would explain a few cycles, too."""
    case, theta = screening.case, screening.stated.value("theta")
    there = screened(case, piece, (NONE,), theta)
    return there if there is None else screened(case, piece, (NONE,), there.stated.value("theta"))


def _without(screening: Screening, cut: int, begins: bool) -> Screening | None:
    """The look without so many cycles; None where it leaves more than noise, or what fires in them fires nowhere else."""
    first, stop = screening.piece.start, screening.piece.stop
    there = plainly(screening, slice(first + cut, stop) if begins else slice(first, stop - cut))
    if there is None or not np.array_equal(there.free.fired, screening.free.fired):
        return None
    return there if there.chance and there.constant else None


def _fewest(screening: Screening, enough: int, begins: bool) -> tuple[int, bool, Screening] | None:
    """The fewest cycles without which it fits, at which end, and the look without them; None where so many aren't enough."""
    found, too_few = _without(screening, enough, begins), 0
    if found is None:
        return None
    while enough - too_few > 1:
        middle = (too_few + enough) // 2
        there = _without(screening, middle, begins)
        if there is None:
            too_few = middle
        else:
            enough, found = middle, there
    return enough, begins, found


class Placed(NamedTuple):
    """Where in the vehicle file a look is."""

    phase: Phase | None
    """None: the only one, which isn't stated."""
    number: int
    begins: bool
    """Whether it begins with its phase."""
    ends: bool


def phase_of(screening: Screening, end_s: float) -> Placed | None:
    """The phase that holds a look, of a log that ends then; None where none does."""
    log, vehicle, timing, *_ = screening.case
    executed, period = timing.of(log, vehicle).executed, vehicle.cycle.period_s
    ends = executed.start_s + executed.duration_s
    middle = float(ends[(screening.piece.start + screening.piece.stop) // 2])
    number = next((i for i, phase in enumerate(vehicle.phases) if phase.start_s < middle <= phase.end_s), None)
    if vehicle.phases and number is None:
        return None
    phase = None if number is None else vehicle.phases[number]
    known = max(log.origin_s if phase is None else phase.start_s, log.origin_s + timing.delay * period)
    last = end_s if phase is None else min(phase.end_s, end_s)
    begins = float(executed.start_s[screening.piece.start]) <= known + NEAR * period
    return Placed(phase, number or 0, begins, float(ends[screening.piece.stop - 1]) >= last - NEAR * period)


def _placed(screening: Screening, cut: int, begins: bool, end_s: float) -> Border | None:
    """In the vehicle file; None where the stretch that was looked at begins, or ends, elsewhere than its phase."""
    placed = phase_of(screening, end_s)
    if placed is None or not (placed.begins if begins else placed.ends):
        return None
    log, vehicle, timing, *_ = screening.case
    executed = timing.of(log, vehicle).executed
    last = screening.piece.stop - cut - 1
    time = float(executed.start_s[screening.piece.start + cut] if begins else executed.start_s[last] + executed.duration_s[last])
    return Border(placed.phase, placed.number, begins, round(time, 6), cut, (log.origin_s, end_s))
