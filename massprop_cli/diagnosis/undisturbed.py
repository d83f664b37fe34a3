"""Stretches of a phase that fit, where something else acted between them, or before and after one.

A hand on the table, valves that are shut for a while, a battery that is exchanged while someone holds the vehicle: no body and no
actuator explains such a time, and the rest fits without it. What is wrong all along, or from some moment on, leaves no such time.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from massprop_cli.base.configfile import written
from massprop_cli.diagnosis import change
from massprop_cli.diagnosis.corrections import Correction, shown
from massprop_cli.diagnosis.phaseboundary import BEYOND, LEFT, beyond_noise, phase_of, plainly
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.triangle import Triangle
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider

SHORTEST, PARTS = 40, (0.5, 0.35, 0.25, 0.18, 0.125)
"""Least cycles of a stretch, and the parts of all that may be its beginning."""
CHANCE = 5.0
"""Sigmas within which what a stretch leaves is chance: of a dozen stretches each is to pass."""
MOST = 0.5
"""Part of all cycles that is left out at most."""
EDGE, SHARP = 32, 5.0
"""Cycles further on, as a part of all, within which a stretch that no longer fits leaves so many times what chance may leave: what wanders
slowly leaves hardly more."""
MARGIN = 3
"""Cycles at each edge that are left out as well: what begins softly is not noticed at once."""
OTHER = 6.0
"""Sigmas of chance beyond which two stretches are of two bodies."""


class Undisturbed(NamedTuple):
    """What fits of a phase."""

    phase: Phase | None
    """As stated; None: the only one, which isn't."""
    number: int
    kept_s: tuple[tuple[float, float], ...]
    """Begin and end of one stretch, or of two."""
    own_s: tuple[float, float]
    """When the phase begins and ends, or else the whole log."""
    changed: bool
    """Whether two stretches are of two bodies."""
    answered: float
    """Sigmas of chance by which what is left out at the beginning and the end follows its commands, the less; infinite where nothing is."""

    @property
    def words(self) -> str:
        """For the reader."""
        name = "" if self.phase is None else f" of phase {self.phase.name}"
        ((begin_s, end_s), *more), (first_s, last_s) = self.kept_s, self.own_s
        state = "state what is left under [[phases]]"
        acted = "something held or touched the vehicle, or commands were not executed"
        if not more:
            sides = [side for side, cut in (("before", begin_s > first_s), ("after", end_s < last_s)) if cut]
            return f"the log fits from {shown(begin_s)} to {shown(end_s)} s alone{name}: {' and '.join(sides)} that, {acted}; {state}"
        changed = ", and its mass properties are others since" if self.changed else ""
        return f"the log fits without {shown(end_s)} to {shown(more[0][0])} s{name}: in that time {acted}{changed}; {state}"

    def correction(self, vehicle: Resolved) -> Correction:
        """Phases of what is left. Of a body that became another, what was known is of the first."""
        own = self.phase or Phase(name="all", start_s=self.own_s[0], end_s=self.own_s[1])
        known = {**vehicle.known, **own.known}
        parts = []
        for i, (begin_s, end_s) in enumerate(self.kept_s):
            name = own.name if len(self.kept_s) == 1 else f"{own.name}-{i + 1}"
            kept = {} if self.changed and i else known
            parts.append(Phase(name=name, start_s=begin_s, end_s=end_s, known=kept))
        phases = (*vehicle.phases[: self.number], *parts, *vehicle.phases[self.number + 1 :])
        settings = [f"phases={written([one.model_dump(exclude_defaults=True) for one in phases])}"] + ["known={}"] * bool(vehicle.known)
        for key, part in (("before", parts[-1]), ("after", parts[0])):
            if vehicle.docking is not None and getattr(vehicle.docking, key) == own.name:
                settings.append(f"docking.{key}={written(part.name)}")
        return Correction(tuple(settings))


def undisturbed(screening: Screening, end_s: float) -> Undisturbed | None:
    """The stretches of a look without which it leaves more than noise, where these leave no more; None where there are none.

    ``end_s`` is when the whole log ends, of which the look may have but a stretch.
    """
    plain, count = plainly(screening, screening.piece), screening.piece.stop - screening.piece.start
    if plain is None or count < 4 * SHORTEST or beyond_noise(plain) < BEYOND * np.sqrt(2 * 6 * count):
        return None
    looks = _Looks(plain)
    kept = looks.between() or looks.around()
    if not kept or any(stretch.stop - stretch.start < SHORTEST for stretch in kept):
        return None
    return _placed(plain, kept, end_s)


class _Looks:
    """At stretches of one look."""

    def __init__(self, screening: Screening) -> None:
        self.screening, self.piece = screening, screening.piece
        self.count = self.piece.stop - self.piece.start
        self.all = beyond_noise(screening)
        self.integrated = _integrated(screening)
        """Then free coefficients judge alone."""

    def between(self) -> tuple[slice, ...]:
        """The longest stretch with the middle of all that fits; empty where there is none."""
        first, stop, most = self.piece.start, self.piece.stop, int(MOST / 2 * self.count)
        if not self.fits(slice(first + most, stop - most)):
            return ()
        early = _longest(most, lambda more: self.fits(slice(first + most - more, stop - most)))
        begin = first + most - early
        end = stop - most + _longest(most, lambda more: self.fits(slice(begin, stop - most + more)))
        edge = max(self.count // EDGE, 1)
        sharp = (begin == first or self.misses(slice(max(begin - edge, first), end))) and (
            end == stop or self.misses(slice(begin, min(end + edge, stop)))
        )
        begin, end = begin + MARGIN * (begin > first), end - MARGIN * (end < stop)
        kept = slice(begin, end)
        return (kept,) if sharp and kept != self.piece and self.fires([kept]) else ()

    def around(self) -> tuple[slice, ...]:
        """The longest stretches from the beginning and up to the end that fit; empty where they meet, or leave out too much."""
        first, stop, edge = self.piece.start, self.piece.stop, max(self.count // EDGE, 1)
        end = first + self._from_a_part(lambda cycles: self.fits(slice(first, first + cycles)))
        begin = stop - self._from_a_part(lambda cycles: self.fits(slice(stop - cycles, stop)))
        if end == first or begin == stop:
            return ()
        if not 0 < begin - end < MOST * self.count:
            return ()
        sharp = self.misses(slice(first, min(end + edge, stop))) and self.misses(slice(max(begin - edge, first), stop))
        kept = slice(first, end - MARGIN), slice(begin + MARGIN, stop)
        return kept if sharp and self.fires(kept) else ()

    def _from_a_part(self, fits: Callable[[int], bool]) -> int:
        """The most cycles that fit, from the largest part that does on; 0 where none does."""
        least = next((cycles for part in PARTS if (cycles := int(part * self.count)) >= SHORTEST and fits(cycles)), 0)
        return least and least + _longest(self.count - least, lambda more: fits(least + more))

    def fits(self, piece: slice) -> bool:
        """Whether a stretch leaves no more than noise, or as little as counts for nothing beside all."""
        there = plainly(self.screening, piece)
        if there is None or not there.constant or beyond_noise(there) > LEFT * self.all:
            return False
        return self.integrated or there.misfit < 1 + CHANCE * np.sqrt(2 / there.freedom)

    def misses(self, piece: slice) -> bool:
        """Whether it leaves far more."""
        there = plainly(self.screening, piece)
        if there is None:
            return True
        left = float(np.max(there.free.pure / there.noise)) if self.integrated else there.misfit
        return bool(left > 1 + SHARP * CHANCE * np.sqrt(2 / there.freedom))

    def fires(self, kept: list[slice] | tuple[slice, ...]) -> bool:
        """Whether all that fires does so in what is left."""
        there = [plainly(self.screening, piece) for piece in kept]
        fired = set().union(*(one.free.fired.tolist() for one in there if one is not None))
        return fired == set(self.screening.free.fired.tolist())


def _longest(most: int, fits: Callable[[int], bool]) -> int:
    """The most, up to so many, that fits, where none does."""
    if fits(most):
        return most
    low, high = 0, most
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _integrated(screening: Screening) -> bool:
    """Whether the vertical drifts as a gyro bias has it, which a look does not know of."""
    return screening.case.vehicle.pivoted and screening.case.log.attitude_wxyz is None


def _two_bodies(screening: Screening, kept: tuple[slice, ...]) -> bool:
    """Whether stretches fit one body far worse than each its own; not known where the vertical drifts."""
    log, vehicle, timing, *_ = screening.case
    samples = timing.of(log, vehicle)
    reference = first_reference(samples, kept[0], vehicle)
    if reference is None or len(kept) < 2 or _integrated(screening):
        return False
    triangle = Triangle(samples, screening.piece, vehicle, Consider())
    begun, whole = triangle.begin(reference), triangle.phase_system(reference)
    told = [triangle.segment_triangle(begun, whole, piece) for piece in kept]
    first, second, both = change.least(np.stack([*told, change.joined(*told)]), reference, vehicle)
    return bool(both - first - second > 10 + OTHER * np.sqrt(2 * 10))


def _placed(screening: Screening, kept: tuple[slice, ...], end_s: float) -> Undisturbed | None:
    """In the vehicle file; None where the look begins, or ends, elsewhere than its phase, and is cut there."""
    placed = phase_of(screening, end_s)
    if placed is None:
        return None
    log, vehicle, timing, *_ = screening.case
    executed = timing.of(log, vehicle).executed
    piece, last = screening.piece, kept[-1]
    begins, ends = kept[0].start > piece.start, last.stop < piece.stop
    if (begins and not placed.begins) or (ends and not placed.ends):
        return None
    own = (log.origin_s, end_s) if placed.phase is None else (placed.phase.start_s, placed.phase.end_s)
    times = [
        [float(executed.start_s[one.start]), float(executed.start_s[one.stop - 1] + executed.duration_s[one.stop - 1])] for one in kept
    ]
    times[0][0] = times[0][0] if begins else own[0]
    times[-1][1] = times[-1][1] if ends else own[1]
    rest = [plainly(screening, one) for one in (slice(piece.start, kept[0].start), slice(last.stop, piece.stop)) if one.start < one.stop]
    return Undisturbed(
        placed.phase,
        placed.number,
        tuple((round(begin, 6), round(end, 6)) for begin, end in times),
        own,
        _two_bodies(screening, kept),
        min((one.free.answered for one in rest if one is not None), default=np.inf),
    )
