"""Segments of a phase that fit, if something disturbed the vehicle between them, or before and after one.

Examples are a hand on the table, valves shut for a while, or a battery exchanged while someone holds the vehicle. No body and no actuator
explains such a time, and the rest fits without it. An error from some moment on leaves no such time.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from massprop_cli.base.configfile import written
from massprop_cli.base.levels import CERTAIN, EDGE, ENOUGH, MAIN_PART, PARTS
from massprop_cli.diagnosis import change
from massprop_cli.diagnosis.corrections import Correction, time_text
from massprop_cli.diagnosis.phaseboundary import BEYOND, LEFT, beyond_noise, phase_of, under_stated_noise
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.triangle import Triangle
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider

OUTER = (0.5, 0.35, 0.25, 0.18, 0.125)
"""Parts of all cycles that an outer segment may start with."""
SHARP = 5.0
"""Multiple of the chance limit that a segment extended by one of :data:`PARTS` must exceed. Slow disturbances exceed it by little."""


class Undisturbed(NamedTuple):
    """The undisturbed part of a phase."""

    phase: Phase | None
    """Phase as stated; None if none is stated."""
    number: int
    kept_s: tuple[tuple[float, float], ...]
    """Start and end of one segment or of two, s."""
    span_s: tuple[float, float]
    """Start and end of the phase, or of the whole log, s."""
    changed: bool
    """Whether two segments have two bodies."""
    command_significance: float
    """Least significance, in sigmas, with which the parts left out at start and end follow their commands; infinite without such parts."""

    @property
    def words(self) -> str:
        """Message text."""
        name = "" if self.phase is None else f" of phase {self.phase.name}"
        ((begin_s, end_s), *more), (first_s, last_s) = self.kept_s, self.span_s
        remedy = "state the undisturbed times under [[phases]]"
        cause = "something held or touched the vehicle, or commands were not executed"
        if not more:
            sides = [side for side, cut in (("before", begin_s > first_s), ("after", end_s < last_s)) if cut]
            return (
                f"the log fits only from {time_text(begin_s)} to {time_text(end_s)} s{name}: {' and '.join(sides)} that, {cause}; {remedy}"
            )
        changed = ", and its mass properties changed" if self.changed else ""
        return f"the log fits without {time_text(end_s)} to {time_text(more[0][0])} s{name}: in that time {cause}{changed}; {remedy}"

    def correction(self, vehicle: Resolved) -> Correction:
        """Phases of the undisturbed segments. After a change of the body, known values belong to the first."""
        phase = self.phase or Phase(name="all", start_s=self.span_s[0], end_s=self.span_s[1])
        known = {**vehicle.known, **phase.known}
        parts = []
        for i, (begin_s, end_s) in enumerate(self.kept_s):
            name = phase.name if len(self.kept_s) == 1 else f"{phase.name}-{i + 1}"
            known_of_part = {} if self.changed and i else known
            parts.append(Phase(name=name, start_s=begin_s, end_s=end_s, known=known_of_part))
        phases = (*vehicle.phases[: self.number], *parts, *vehicle.phases[self.number + 1 :])
        settings = [f"phases={written([one.model_dump(exclude_defaults=True) for one in phases])}"] + ["known={}"] * bool(vehicle.known)
        for key, part in (("before", parts[-1]), ("after", parts[0])):
            if vehicle.docking is not None and getattr(vehicle.docking, key) == phase.name:
                settings.append(f"docking.{key}={written(part.name)}")
        return Correction(tuple(settings))


def undisturbed(screening: Screening, end_s: float) -> Undisturbed | None:
    """Undisturbed segments of a screening that has a misfit; None if there are none.

    ``end_s``: end of the whole log, s, of which the screening may have a segment only.
    """
    under_noise, count = under_stated_noise(screening, screening.piece), screening.piece.stop - screening.piece.start
    if under_noise is None or count < 4 * ENOUGH or beyond_noise(under_noise) < BEYOND * np.sqrt(2 * 6 * count):
        return None
    tests = _SegmentTests(under_noise)
    kept = tests.between() or tests.around()
    if not kept or any(segment.stop - segment.start < ENOUGH for segment in kept):
        return None
    return _located(under_noise, kept, end_s)


class _SegmentTests:
    """Tests of segments of one screening."""

    def __init__(self, screening: Screening) -> None:
        self.screening, self.piece = screening, screening.piece
        self.count = self.piece.stop - self.piece.start
        self.all = beyond_noise(screening)
        self.integrated = _integrated(screening)
        """Whether free coefficients alone decide."""

    def between(self) -> tuple[slice, ...]:
        """The longest fitting segment around the middle; empty without one."""
        first, stop, most = self.piece.start, self.piece.stop, int(MAIN_PART / 2 * self.count)
        if not self.fits(slice(first + most, stop - most)):
            return ()
        early = _longest(most, lambda more: self.fits(slice(first + most - more, stop - most)))
        begin = first + most - early
        end = stop - most + _longest(most, lambda more: self.fits(slice(begin, stop - most + more)))
        edge = max(self.count // PARTS, 1)
        sharp = (begin == first or self.clearly_misfits(slice(max(begin - edge, first), end))) and (
            end == stop or self.clearly_misfits(slice(begin, min(end + edge, stop)))
        )
        begin, end = begin + EDGE * (begin > first), end - EDGE * (end < stop)
        kept = slice(begin, end)
        return (kept,) if sharp and kept != self.piece and self.all_channels_act([kept]) else ()

    def around(self) -> tuple[slice, ...]:
        """The longest fitting segments at start and end; empty if they meet or leave out too much."""
        first, stop, edge = self.piece.start, self.piece.stop, max(self.count // PARTS, 1)
        end = first + self._longest_from_part(lambda cycles: self.fits(slice(first, first + cycles)))
        begin = stop - self._longest_from_part(lambda cycles: self.fits(slice(stop - cycles, stop)))
        if end == first or begin == stop:
            return ()
        if not 0 < begin - end < MAIN_PART * self.count:
            return ()
        sharp = self.clearly_misfits(slice(first, min(end + edge, stop))) and self.clearly_misfits(slice(max(begin - edge, first), stop))
        kept = slice(first, end - EDGE), slice(begin + EDGE, stop)
        return kept if sharp and self.all_channels_act(kept) else ()

    def _longest_from_part(self, fits: Callable[[int], bool]) -> int:
        """Most cycles that fit, extended from the largest of :data:`OUTER` that fits; 0 if none does."""
        start = next((cycles for part in OUTER if (cycles := int(part * self.count)) >= ENOUGH and fits(cycles)), 0)
        return start and start + _longest(self.count - start, lambda more: fits(start + more))

    def fits(self, piece: slice) -> bool:
        """Whether a segment leaves no more than noise, and little of the excess of all."""
        part = under_stated_noise(self.screening, piece)
        if part is None or not part.constant or beyond_noise(part) > LEFT * self.all:
            return False
        return self.integrated or part.misfit < 1 + CERTAIN * np.sqrt(2 / part.degrees_of_freedom)

    def clearly_misfits(self, piece: slice) -> bool:
        """Whether a segment leaves far more than noise."""
        part = under_stated_noise(self.screening, piece)
        if part is None:
            return True
        misfit = float(np.max(part.free.pure_error / part.noise)) if self.integrated else part.misfit
        return bool(misfit > 1 + SHARP * CERTAIN * np.sqrt(2 / part.degrees_of_freedom))

    def all_channels_act(self, kept: list[slice] | tuple[slice, ...]) -> bool:
        """Whether all channels that act do so in the segments kept."""
        parts = [under_stated_noise(self.screening, piece) for piece in kept]
        fired = set().union(*(one.free.fired.tolist() for one in parts if one is not None))
        return fired == set(self.screening.free.fired.tolist())


def _longest(most: int, fits: Callable[[int], bool]) -> int:
    """Largest number up to ``most`` that fits, by bisection."""
    if fits(most):
        return most
    low, high = 0, most
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _integrated(screening: Screening) -> bool:
    """Whether the vertical is integrated, so that it drifts by a gyro bias that a screening ignores."""
    return screening.case.vehicle.pivoted and screening.case.log.attitude_wxyz is None


def _two_bodies(screening: Screening, kept: tuple[slice, ...]) -> bool:
    """Whether two bodies fit the segments far better than one; False if the vertical is integrated."""
    log, vehicle, timing, *_ = screening.case
    samples = timing.of(log, vehicle)
    reference = first_reference(samples, kept[0], vehicle)
    if reference is None or len(kept) < 2 or _integrated(screening):
        return False
    triangle = Triangle(samples, screening.piece, vehicle, Consider())
    start, system = triangle.begin(reference), triangle.phase_system(reference)
    triangles = [triangle.segment_triangle(start, system, piece) for piece in kept]
    first, second, both = change.least_chi_squares(np.stack([*triangles, change.joined(*triangles)]), reference, vehicle)
    return bool(both - first - second > 10 + CERTAIN * np.sqrt(2 * 10))


def _located(screening: Screening, kept: tuple[slice, ...], end_s: float) -> Undisturbed | None:
    """The segments in the vehicle file; None if the screening does not reach the edge of its phase and is cut there."""
    location = phase_of(screening, end_s)
    if location is None:
        return None
    log, vehicle, timing, *_ = screening.case
    executed = timing.of(log, vehicle).executed
    piece, last = screening.piece, kept[-1]
    begins, ends = kept[0].start > piece.start, last.stop < piece.stop
    if (begins and not location.begins) or (ends and not location.ends):
        return None
    span_s = (log.origin_s, end_s) if location.phase is None else (location.phase.start_s, location.phase.end_s)
    times = [
        [float(executed.start_s[one.start]), float(executed.start_s[one.stop - 1] + executed.duration_s[one.stop - 1])] for one in kept
    ]
    times[0][0] = times[0][0] if begins else span_s[0]
    times[-1][1] = times[-1][1] if ends else span_s[1]
    left_out = [
        under_stated_noise(screening, one)
        for one in (slice(piece.start, kept[0].start), slice(last.stop, piece.stop))
        if one.start < one.stop
    ]
    return Undisturbed(
        location.phase,
        location.number,
        tuple((round(begin, 6), round(end, 6)) for begin, end in times),
        span_s,
        _two_bodies(screening, kept),
        min((one.free.command_significance for one in left_out if one is not None), default=np.inf),
    )
