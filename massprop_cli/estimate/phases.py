"""Noise levels, off-line fits, and the causal pass through every phase: all that is estimated before anything is judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.estimate import disturbances, engine, noiselevels, offline
from massprop_cli.estimate.history import History
from massprop_cli.estimate.historyrecorder import informed
from massprop_cli.estimate.initial import beginning
from massprop_cli.estimate.offline import Led
from massprop_cli.estimate.sizing import likeliest_levels
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

QUIET = 1 / 50
"""Of the stated variance of the rates' noise, what is that of none that was stated with care: a seventh of its sigma."""
ROUNDS = 8
"""How often disturbances may be raised until the innovations are explained."""
SIZING = 2
"""Passes of an off-line fit that disturbances are sized by."""
LOST = 3.0
"""Sigmas by which the causal estimate of a whole phase may differ from the off-line fit of the same data. They use the same measurements,
so where both hold they differ by much less than one."""
BEGINNING, LONGER = 1024, 4
"""Cycles that a long phase is fitted over first, and how many times as many come next."""
Progress = Callable[[str, float], None]
"""Told the stage and how much of it is done, 0 to 1."""


Used = TypeVar("Used", bound=Vehicle, covariant=True)


class AsStated(NamedTuple):
    """Off-line fits of every phase with the noise that is stated, and nothing beside it."""

    used: Resolved
    fits: list[offline.Settled | None]
    """None of a phase without motion."""
    excess: Array
    """(6,) of :func:`massprop_cli.estimate.disturbances.misfit`."""
    gross: Array
    """(6,) of :func:`massprop_cli.estimate.disturbances.gross_misfit`."""
    notices: list[Notice]
    settled: bool
    """Whether they have had all the passes that they may have."""

    @property
    def misfit(self) -> bool:
        """Whether the stated noise doesn't explain the log."""
        return not (np.isnan(self.excess).all() and np.isnan(self.gross).all())

    @property
    def chi_square(self) -> float:
        """Squares of the residual of the fits, over the noise."""
        return sum(fit.history.left() for fit in self.fits if fit is not None)

    @property
    def left(self) -> float:
        """Mean of them."""
        fitted = [fit.history for fit in self.fits if fit is not None]
        count = sum(one.moments().count * int((~one.unread).sum()) for one in fitted)
        return self.chi_square / max(count, 1)

    @property
    def dubious(self) -> bool:
        """Whether it doesn't, or a phase tells of no body at all, or of one that is lost."""
        return self.misfit or any(fit is None or fit.history.moments().count == 0 for fit in self.fits)

    @property
    def quiet(self) -> bool:
        """Whether rates vary about an axis so much less than is stated that they may be in another unit, and a misfit drown in it."""
        left = [fit.history.moments() for fit in self.fits if fit is not None]
        count = sum(of_one.count for of_one in left)
        if count == 0:
            return False
        read = ~next(fit.history.unread[:3] for fit in self.fits if fit is not None)
        return bool((np.sum([of_one.count * of_one.variance[:3] for of_one in left], 0) < QUIET * count)[read].any())


class _Fitting(NamedTuple):
    """Off-line fits of every phase with the same settings; None of a phase without motion."""

    samples: Source
    phases: Sequence[tuple[Phase, slice]]
    used: Resolved
    consider: Consider

    def first(self) -> list[Led | None]:
        """What each phase is fitted about first: where its first cycles tell of none, what the causal pass comes to."""
        found = []
        for phase, cycles in self.phases:
            own = self.used.in_phase(phase)
            reference = (
                beginning(self.samples, cycles, self.used) or engine.replay(self.samples, cycles, phase, own, self.consider).reference
            )
            found.append(_led_up(self.samples, cycles, reference, own))
        return found

    def fits(self, starts: Sequence[Led | None], passes: int) -> list[offline.Settled | None]:
        """Of so many passes."""
        return [
            start
            and offline.settle(self.samples, cycles, phase, start.reference, self.used.in_phase(phase), self.consider, passes, start.bound)
            for (phase, cycles), start in zip(self.phases, starts, strict=True)
        ]

    def further(self, fits: Sequence[offline.Settled | None]) -> list[offline.Settled | None]:
        """Those of few passes led on until they stand: the very same as if all were done in a row."""
        starts = [
            None if fit is None or fit.stands or fit.history.reference is None else Led(fit.history.reference, fit.bound) for fit in fits
        ]
        return [led or fit for led, fit in zip(self.fits(starts, offline.SETTLINGS - SIZING), fits, strict=True)]

    def left(self, fits: Sequence[offline.Settled | None], sized: bool = False) -> Array:
        """(6,) what they leave beyond the noise."""
        return disturbances.misfit([fit.history for fit in fits if fit is not None], self.used, sized)


class Estimates(NamedTuple, Generic[Used]):
    """Of every phase."""

    used: Used
    """With the noise levels and disturbances that were found."""
    histories: tuple[History, ...]
    """The causal pass, about the off-line fit's estimate where it lost its way; the off-line fits with ``estimator.refine``."""
    settled: list[History]
    """The off-line fits that it is judged by; the causal pass where there is none; nothing by the thesis's method."""
    notices: list[Notice]


def as_stated(samples: Source, phases: Sequence[tuple[Phase, slice]], stated: Vehicle, consider: Consider) -> AsStated:
    """Noise levels and off-line fits, before anything is sized."""
    pieces = [cycles for _, cycles in phases]
    used, notices = noiselevels.with_noise_levels(samples, pieces, stated)
    fitting = _Fitting(samples, phases, used, consider)
    fits = fitting.fits(fitting.first(), SIZING)
    excess = fitting.left(fits)
    gross, settled = np.full(6, np.nan), _stand(fits)
    if not (settled and np.isnan(excess).all()):  # fits that stand and explain the log leave nothing to a look at the rates alone
        gross = disturbances.gross_misfit(samples, pieces, used)
        if not (settled or np.isnan([excess, gross]).all()):
            # a fit that is still on its way leaves what isn't in the log, as that look does
            fits, settled = fitting.further(fits), True
            excess = fitting.left(fits)
        if _stand(fits) and np.isnan(excess).all():
            gross = np.full_like(gross, np.nan)
    return AsStated(used, fits, excess, gross, notices, settled)


def roughly(samples: Source, phases: Sequence[tuple[Phase, slice]], used: Resolved) -> list[offline.Settled | None]:
    """Off-line fits of one pass, which tell whether it is worth while to lead them on."""
    fitting = _Fitting(samples, phases, used, Consider())
    return fitting.fits(fitting.first(), 1)


def _stand(fits: Sequence[offline.Settled | None]) -> bool:
    """Whether another pass would change none of those that there are."""
    return all(fit is None or fit.stands for fit in fits)


def estimates(
    samples: Source, phases: Sequence[tuple[Phase, slice]], plain: AsStated, consider: Consider, say: Progress, *, size: bool, noisier: bool
) -> Estimates[Resolved]:
    """The estimator once through every phase, and the off-line fits that it is judged by.

    With ``size`` disturbances are raised first until off-line fits explain the log where the stated noise can't; with ``noisier`` the gyro
    may be noisier than stated.
    """
    used, fits, excess = _sized(samples, phases, plain, size, noisier, consider)
    histories, settled = [], []
    for (phase, cycles), fit in zip(phases, fits, strict=True):
        own = used.in_phase(phase)
        causal = engine.replay(samples, cycles, phase, own, consider, partial(say, f"estimating, phase {phase.name}"))
        if fit is not None and fit.stands and not used.estimator.refine and _lost(causal, fit.history, own):
            causal = _led(samples, cycles, phase, own, consider, fit)
        first, last = informed((causal, causal if fit is None else fit.history), samples, own)
        histories.append(last if used.estimator.refine else first)
        settled.append(last)
    notices = disturbances.disturbance_notices(plain.used, used, excess, samples) if size else []
    return Estimates(used, tuple(histories), settled, plain.notices + notices)


def _lost(causal: History, settled: History, own: Vehicle) -> bool:
    """Whether a causal estimate is worth nothing beside the off-line fit of the same data: begun nowhere, or led astray."""
    # a swing tells ratios far better than any size, so that what is linear about another ratio shows in no sigma
    never = not np.isfinite(causal.values).any()
    return own.swings or never or bool((astray(causal, settled) > LOST).any())


def astray(causal: History, settled: History) -> Array:
    """(10,) sigmas between the causal estimate of a whole phase and the off-line fit of the same data; NaN where nothing is told.

    By the log alone, or beside what is known: of a free swing, which tells ratios alone, that shows by the second.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        alone = np.abs(causal.bare[0] - settled.bare[0]) / np.sqrt(np.diag(settled.bare[1]))
        beside = np.abs(causal.values[-1] - settled.values[-1]) / settled.sigmas[-1]
    return np.asarray(np.fmax(alone, beside))


def _led(samples: Source, cycles: slice, phase: Phase, used: Resolved, consider: Consider, fit: offline.Settled) -> History:
    """A causal estimate about that of the whole phase: equations that are linear about its own on the way led it astray."""
    refined = used.model_copy(update={"estimator": used.estimator.model_copy(update={"refine": True})})
    assert fit.history.reference is not None
    return offline.settle(samples, cycles, phase, fit.history.reference, refined, consider, 1, fit.bound).history


def by_thesis(samples: Source, phases: Sequence[tuple[Phase, slice]], stated: Vehicle) -> Estimates[Vehicle]:
    """The thesis's own filters, one after the other, with its own matrices."""
    from massprop_cli.estimate import thesis

    histories: list[History] = []
    filters = None
    for phase, cycles in phases:
        history, filters = thesis.replay(samples, cycles, phase, stated, filters)
        histories.append(history)
    return Estimates(stated, tuple(histories), [], [])


def _sized(
    samples: Source, phases: Sequence[tuple[Phase, slice]], plain: AsStated, size: bool, noisier: bool, consider: Consider
) -> tuple[Resolved, list[offline.Settled | None], Array]:
    """The vehicle with disturbances raised until off-line fits explain the log; these; and what is left."""
    pieces = [cycles for _, cycles in phases]
    used, fits, excess = plain.used, plain.fits, plain.excess
    if size and plain.misfit:
        # a fit far from the truth leaves much in every channel: where rates alone show it, what is left after that counts
        likeliest = likeliest_levels(samples, pieces, noisier)
        used = disturbances.with_disturbances(excess if np.isnan(plain.gross).all() else plain.gross, used, likeliest)
        fitting = _Fitting(samples, phases, used, consider)
        starts = fitting.first()
        for _ in range(ROUNDS):
            fits = fitting.fits(starts, SIZING)
            excess = fitting.left(fits, sized=True)
            raised = disturbances.with_disturbances(excess, used, likeliest)
            if raised == used:
                break
            used, starts = raised, [None if fit is None or fit.history.reference is None else Led(fit.history.reference) for fit in fits]
            fitting = fitting._replace(used=used)
    fitting = _Fitting(samples, phases, used, consider)
    if fits is plain.fits and not plain.settled:
        fits = fitting.further(fits)
        excess = fitting.left(fits)
    elif fits is not plain.fits and (used != plain.used or not _stand(fits)):
        # from the beginning again, so that the settings that were found give the very same when they are given back
        fits = fitting.fits(fitting.first(), offline.SETTLINGS)
        excess = fitting.left(fits, sized=used != plain.used)
    return used, fits, excess


def _led_up(samples: Source, cycles: slice, reference: Reference | None, vehicle: Resolved) -> Led | None:
    """A reference that a long phase may be fitted about: an error of it is carried along, so the phase's beginning is fitted first."""
    if reference is None:
        return None
    start, length = Led(reference), BEGINNING
    while length * LONGER <= cycles.stop - cycles.start:
        begun = slice(cycles.start, cycles.start + length)
        start = offline.led(samples, begun, start, vehicle, SIZING)
        length *= LONGER
    return start
