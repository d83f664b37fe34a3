"""A phase boundary stated too early or too late, or a vehicle held at the start or end of a phase.

A few cycles do not determine a body, so no search for a change finds them. But the rest fits without them.
"""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY
from massprop_cli.base.configfile import written
from massprop_cli.base.levels import EDGE
from massprop_cli.diagnosis.corrections import Correction, time_text
from massprop_cli.diagnosis.screening import Screening, screened
from massprop_cli.estimate.whitening import NONE
from massprop_cli.inputs.vehicle import Phase

LONGEST, MOST = 128, 0.25
"""Most cycles that are left out, absolute and relative."""
BEYOND = 8.0
"""Sigmas of chance beyond which a screening leaves more than noise."""
LEFT = 0.3
"""Part of the excess that may remain without the cycles left out."""


class PhaseBoundary(NamedTuple):
    """A corrected start or end of a phase."""

    phase: Phase | None
    """Phase as stated; None if none is stated."""
    number: int
    begins: bool
    """Whether the phase must start later; otherwise it must end earlier."""
    time_s: float
    left_out: int
    """Number of cycles left out."""
    log_s: tuple[float, float]
    """Start and end of the whole log, s."""

    @property
    def key(self) -> str:
        """Key of the phase that is corrected."""
        return "start_s" if self.begins else "end_s"

    @property
    def words(self) -> str:
        """Message text."""
        name = "" if self.phase is None else f" of phase {self.phase.name}"
        which, side = ("first", "from") if self.begins else ("last", "until")
        other = "another object was docked until then" if self.begins else "another object is docked from then on"
        return (
            f"the log fits without the {which} {self.left_out} cycles{name} ({side} {time_text(self.time_s)} s): {other}, the vehicle was "
            f"held, or a jet failed; correct {self.key} under [[phases]]"
        )

    @property
    def correction(self) -> Correction:
        """Corrected key."""
        if self.phase is not None:
            return Correction((f"phases.{self.number}.{self.key}={self.time_s}",))
        begin_s, end_s = self.log_s
        only = {"name": "all", "start_s": begin_s, "end_s": end_s} | {self.key: self.time_s}
        return Correction((f"phases={written([only])}",))


def phase_boundary(screening: Screening, end_s: float) -> PhaseBoundary | None:
    """The boundary of a phase without whose first or last cycles a screening leaves only noise; None without one.

    ``end_s``: end of the whole log, s, of which the screening may have a segment only.
    """
    under_noise, count = under_stated_noise(screening, screening.piece), screening.piece.stop - screening.piece.start
    if under_noise is None:
        return None
    screening, most = under_noise, min(LONGEST, int(MOST * count))
    if beyond_noise(screening) < BEYOND * np.sqrt(2 * 6 * count) or most < 1:
        return None
    sides = [_fewest(screening, most, begins) for begins in (True, False)]
    fewest = min((one for one in sides if one is not None), key=lambda one: one[0], default=None)
    if fewest is not None and beyond_noise(fewest[2]) > LEFT * beyond_noise(screening):
        return None  # the misfit is spread over all cycles, as by understated noise
    return None if fewest is None else _boundary(screening, *fewest[:2], end_s)


def beyond_noise(screening: Screening) -> float:
    """Squared residuals over the stated noise, beyond their expectation."""
    free = screening.free
    squares = np.concatenate([free.gyro.left, free.accelerometer.left]) + screening.stated.chi_square * free.variance
    return float((squares / np.maximum(screening.noise, TINY)).sum() - 6 * (screening.piece.stop - screening.piece.start))


def under_stated_noise(screening: Screening, piece: slice) -> Screening | None:
    """Screening of a piece under the stated noise only; a random-walk torque would explain a few cycles, too."""
    case, theta = screening.case, screening.stated.value("theta")
    first = screened(case, piece, (NONE,), theta)
    return first if first is None else screened(case, piece, (NONE,), first.stated.value("theta"))


def _without(screening: Screening, cut: int, begins: bool) -> Screening | None:
    """Screening without some cycles at one end; None if it leaves more than noise, or if a channel acts in those cycles only."""
    first, stop = screening.piece.start, screening.piece.stop
    rest = under_stated_noise(screening, slice(first + cut, stop) if begins else slice(first, stop - cut))
    if rest is None or not np.array_equal(rest.free.fired, screening.free.fired):
        return None
    return rest if rest.within_chance and rest.constant else None


def _fewest(screening: Screening, enough: int, begins: bool) -> tuple[int, bool, Screening] | None:
    """The fewest cycles without which the rest fits, their end, and that screening; None if ``enough`` are not enough."""
    rest, too_few = _without(screening, enough, begins), 0
    if rest is None:
        return None
    while enough - too_few > 1:
        middle = (too_few + enough) // 2
        trial = _without(screening, middle, begins)
        if trial is None:
            too_few = middle
        else:
            enough, rest = middle, trial
    return enough, begins, rest


class PhaseLocation(NamedTuple):
    """Place of a screening in the vehicle file."""

    phase: Phase | None
    """Phase as stated; None if none is stated."""
    number: int
    begins: bool
    """Whether the screening starts with its phase."""
    ends: bool


def phase_of(screening: Screening, end_s: float) -> PhaseLocation | None:
    """Phase that holds a screening, in a log that ends at ``end_s``; None without one."""
    log, vehicle, timing, *_ = screening.case
    executed, period = timing.of(log, vehicle).executed, vehicle.cycle.period_s
    ends = executed.start_s + executed.duration_s
    middle = float(ends[(screening.piece.start + screening.piece.stop) // 2])
    number = next((i for i, phase in enumerate(vehicle.phases) if phase.start_s < middle <= phase.end_s), None)
    if vehicle.phases and number is None:
        return None
    phase = None if number is None else vehicle.phases[number]
    known_from_s = max(log.origin_s if phase is None else phase.start_s, log.origin_s + timing.delay * period)
    end_of_phase_s = end_s if phase is None else min(phase.end_s, end_s)
    begins = float(executed.start_s[screening.piece.start]) <= known_from_s + EDGE * period
    return PhaseLocation(phase, number or 0, begins, float(ends[screening.piece.stop - 1]) >= end_of_phase_s - EDGE * period)


def _boundary(screening: Screening, cut: int, begins: bool, end_s: float) -> PhaseBoundary | None:
    """The boundary in the vehicle file; None if the screening does not reach that end of its phase."""
    location = phase_of(screening, end_s)
    if location is None or not (location.begins if begins else location.ends):
        return None
    log, vehicle, timing, *_ = screening.case
    executed = timing.of(log, vehicle).executed
    last = screening.piece.stop - cut - 1
    time = float(executed.start_s[screening.piece.start + cut] if begins else executed.start_s[last] + executed.duration_s[last])
    return PhaseBoundary(location.phase, location.number, begins, round(time, 6), cut, (log.origin_s, end_s))
