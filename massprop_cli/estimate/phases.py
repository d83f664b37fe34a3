"""Estimation of every phase: noise levels, off-line fits, disturbances, and the causal pass."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import CHANCE, ITERATIONS
from massprop_cli.estimate import disturbances, engine, noiselevels, offline
from massprop_cli.estimate.history import History
from massprop_cli.estimate.historyrecorder import with_observability
from massprop_cli.estimate.initial import early_reference
from massprop_cli.estimate.offline import Start
from massprop_cli.estimate.sizing import likeliest_levels
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

QUIET = 1 / 50
"""Variance of the rate residuals over the stated one, below which the stated noise is implausible: a seventh of its sigma."""
SIZING = 2
"""Passes of an off-line fit from which disturbances are estimated."""
BEGINNING, LONGER = 1024, 4
"""Cycles of the first fit of a long phase, and the factor on their number for the next ones."""
Progress = Callable[[str, float], None]
"""Called with the stage and its completed part, 0 to 1."""


Used = TypeVar("Used", bound=Vehicle, covariant=True)


class AsStated(NamedTuple):
    """Off-line fits of every phase with the stated noise and disturbances."""

    used: Resolved
    fits: list[offline.OfflineFit | None]
    """By phase; None without motion."""
    excess: Array
    """(6,) of :func:`massprop_cli.estimate.disturbances.misfit`."""
    gross: Array
    """(6,) of :func:`massprop_cli.estimate.disturbances.gross_misfit`."""
    notices: list[Notice]
    settled: bool
    """Whether the fits have converged or had all their passes."""

    @property
    def misfit(self) -> bool:
        """Whether the stated noise does not explain the log."""
        return not (np.isnan(self.excess).all() and np.isnan(self.gross).all())

    @property
    def chi_square(self) -> float:
        """Sum of the squared normalised innovations of all fits."""
        return sum(fit.history.chi_square() for fit in self.fits if fit is not None)

    @property
    def left(self) -> float:
        """Mean squared normalised innovation."""
        fitted = [fit.history for fit in self.fits if fit is not None]
        count = sum(one.moments().count * int((~one.unread).sum()) for one in fitted)
        return self.chi_square / max(count, 1)

    @property
    def dubious(self) -> bool:
        """Whether there is a misfit, or a phase without a fit or whose fit diverged."""
        return self.misfit or any(fit is None or fit.history.moments().count == 0 for fit in self.fits)

    @property
    def quiet(self) -> bool:
        """Whether rates vary about an axis far less than the stated noise: the noise may be in another unit, and hide a misfit."""
        moments = [fit.history.moments() for fit in self.fits if fit is not None]
        count = sum(one.count for one in moments)
        if count == 0:
            return False
        read = ~next(fit.history.unread[:3] for fit in self.fits if fit is not None)
        return bool((np.sum([one.count * one.variance[:3] for one in moments], 0) < QUIET * count)[read].any())


class _Fitting(NamedTuple):
    """Off-line fits of every phase with the same settings."""

    samples: Source
    phases: Sequence[tuple[Phase, slice]]
    used: Resolved
    consider: Consider

    def starts(self) -> list[Start | None]:
        """The start of each phase's fit: from its first cycles, or from the causal pass; None without motion."""
        starts = []
        for phase, cycles in self.phases:
            used = self.used.in_phase(phase)
            reference = (
                early_reference(self.samples, cycles, self.used)
                or engine.replay(self.samples, cycles, phase, used, self.consider).reference
            )
            starts.append(_start(self.samples, cycles, reference, used))
        return starts

    def fits(self, starts: Sequence[Start | None], passes: int) -> list[offline.OfflineFit | None]:
        """Fits of at most ``passes`` passes."""
        return [
            start
            and offline.fit(self.samples, cycles, phase, start.reference, self.used.in_phase(phase), self.consider, passes, start.tied)
            for (phase, cycles), start in zip(self.phases, starts, strict=True)
        ]

    def continued(self, fits: Sequence[offline.OfflineFit | None]) -> list[offline.OfflineFit | None]:
        """Fits of :data:`SIZING` passes, continued to the most passes; the result equals that of a single fit."""
        starts = [
            None if fit is None or fit.converged or fit.history.reference is None else Start(fit.history.reference, fit.tied)
            for fit in fits
        ]
        return [more or fit for more, fit in zip(self.fits(starts, ITERATIONS - SIZING), fits, strict=True)]

    def misfit(self, fits: Sequence[offline.OfflineFit | None], sized: bool = False) -> Array:
        """(6,) of :func:`massprop_cli.estimate.disturbances.misfit`."""
        return disturbances.misfit([fit.history for fit in fits if fit is not None], self.used, sized)


class Estimates(NamedTuple, Generic[Used]):
    """Estimates of every phase."""

    used: Used
    """The vehicle with the estimated noise levels and disturbances."""
    histories: tuple[History, ...]
    """Causal passes; about the off-line fit's estimate where a pass diverged, or geometry or ``uncertain`` values are unknowns. With
    ``estimator.refine`` the off-line fits."""
    settled: list[History]
    """Off-line fits against which they are tested, or the causal pass where there is none; empty for the thesis's method."""
    notices: list[Notice]


def as_stated(samples: Source, phases: Sequence[tuple[Phase, slice]], stated: Vehicle, consider: Consider) -> AsStated:
    """Noise levels and off-line fits with the stated disturbances."""
    pieces = [cycles for _, cycles in phases]
    used, notices = noiselevels.with_noise_levels(samples, pieces, stated)
    fitting = _Fitting(samples, phases, used, consider)
    # before convergence, the log seems to inform unknowns that it cannot tell from the mass properties
    passes = ITERATIONS if consider.restated else SIZING
    fits = fitting.fits(fitting.starts(), passes)
    excess = fitting.misfit(fits)
    gross, settled = np.full(6, np.nan), _converged(fits) or passes > SIZING
    if not (settled and np.isnan(excess).all()):  # the rates alone need no test where converged fits explain the log
        gross = disturbances.gross_misfit(samples, pieces, used)
        if not (settled or np.isnan([excess, gross]).all()):
            # residuals of a fit that has not converged are not those of the log
            fits, settled = fitting.continued(fits), True
            excess = fitting.misfit(fits)
        if _converged(fits) and np.isnan(excess).all():
            gross = np.full_like(gross, np.nan)
    return AsStated(used, fits, excess, gross, notices, settled)


def rough_fits(samples: Source, phases: Sequence[tuple[Phase, slice]], used: Resolved) -> list[offline.OfflineFit | None]:
    """Off-line fits of one pass, for a first comparison."""
    fitting = _Fitting(samples, phases, used, Consider())
    return fitting.fits(fitting.starts(), 1)


def _converged(fits: Sequence[offline.OfflineFit | None]) -> bool:
    """Whether all fits have converged."""
    return all(fit is None or fit.converged for fit in fits)


def estimates(
    samples: Source, phases: Sequence[tuple[Phase, slice]], plain: AsStated, consider: Consider, say: Progress, *, size: bool, noisier: bool
) -> Estimates[Resolved]:
    """Causal pass through every phase, and the off-line fits against which it is tested.

    With ``size``, disturbances are first raised until off-line fits explain the log where the stated noise does not. With ``noisier``, the
    gyro noise may exceed the stated one.
    """
    used, fits, excess = _sized(samples, phases, plain, size, noisier, consider)
    histories, settled = [], []
    for (phase, cycles), fit in zip(phases, fits, strict=True):
        vehicle = used.in_phase(phase)
        causal = None
        about_fit = fit if fit is not None and fit.converged and not used.estimator.refine else None
        # where linearisations differ, the log seems to inform an unknown that it cannot tell from the mass properties, as all thrust
        if about_fit is None or not consider.kinds:
            causal = engine.replay(samples, cycles, phase, vehicle, consider, partial(say, f"estimating, phase {phase.name}"))
        if about_fit is not None and (causal is None or _diverged(causal, about_fit.history, vehicle)):
            causal = _about_fit(samples, cycles, phase, vehicle, consider, about_fit)
        assert causal is not None
        first, last = with_observability((causal, causal if fit is None else fit.history), samples, vehicle)
        histories.append(last if used.estimator.refine else first)
        settled.append(last)
    notices = disturbances.disturbance_notices(plain.used, used, excess, samples) if size else []
    return Estimates(used, tuple(histories), settled, plain.notices + notices)


def _diverged(causal: History, settled: History, vehicle: Vehicle) -> bool:
    """Whether a causal pass has no estimate, or one that differs from the off-line fit of the same data."""
    # a free oscillation informs ratios much better than size: the linearisation's error does not show in the sigmas
    never = not np.isfinite(causal.values).any()
    return vehicle.swings or never or bool((deviation(causal, settled) > CHANCE).any())


def deviation(causal: History, settled: History) -> Array:
    """(10,) sigmas between the causal estimate of a whole phase and the off-line fit of the same data; NaN without an estimate.

    The larger of the estimates from the log alone and of those with known values. Of a free oscillation, only the second shows it.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        log_alone = np.abs(causal.bare[0] - settled.bare[0]) / np.sqrt(np.diag(settled.bare[1]))
        with_known = np.abs(causal.values[-1] - settled.values[-1]) / settled.sigmas[-1]
    return np.asarray(np.fmax(log_alone, with_known))


def _about_fit(samples: Source, cycles: slice, phase: Phase, used: Resolved, consider: Consider, fit: offline.OfflineFit) -> History:
    """Causal estimates linearised about the off-line fit's estimate; about their own they diverged."""
    refined = used.model_copy(update={"estimator": used.estimator.model_copy(update={"refine": True})})
    assert fit.history.reference is not None
    return offline.fit(samples, cycles, phase, fit.history.reference, refined, consider, 1, fit.tied).history


def by_thesis(samples: Source, phases: Sequence[tuple[Phase, slice]], stated: Vehicle) -> Estimates[Vehicle]:
    """The thesis's filters, phase by phase, with its own settings."""
    from massprop_cli.estimate import thesis

    histories: list[History] = []
    filters = None
    for phase, cycles in phases:
        history, filters = thesis.replay(samples, cycles, phase, stated, filters)
        histories.append(history)
    return Estimates(stated, tuple(histories), [], [])


def _sized(
    samples: Source, phases: Sequence[tuple[Phase, slice]], plain: AsStated, size: bool, noisier: bool, consider: Consider
) -> tuple[Resolved, list[offline.OfflineFit | None], Array]:
    """The vehicle with disturbances raised until off-line fits explain the log, these fits, and the remaining misfit (6,)."""
    pieces = [cycles for _, cycles in phases]
    used, fits, excess = plain.used, plain.fits, plain.excess
    if size and plain.misfit:
        # the misfit of a fit far from the truth is large in every channel: first use the rates' own, where it is significant
        likeliest = likeliest_levels(samples, pieces, noisier)
        used = disturbances.with_disturbances(excess if np.isnan(plain.gross).all() else plain.gross, used, likeliest)
        fitting = _Fitting(samples, phases, used, consider)
        starts = fitting.starts()
        for _ in range(ITERATIONS):
            fits = fitting.fits(starts, SIZING)
            excess = fitting.misfit(fits, sized=True)
            raised = disturbances.with_disturbances(excess, used, likeliest)
            if raised == used:
                break
            used, starts = raised, [None if fit is None or fit.history.reference is None else Start(fit.history.reference) for fit in fits]
            fitting = fitting._replace(used=used)
    fitting = _Fitting(samples, phases, used, consider)
    if fits is plain.fits and not plain.settled:
        fits = fitting.continued(fits)
        excess = fitting.misfit(fits)
    elif fits is not plain.fits and (used != plain.used or not _converged(fits)):
        # start again, so that a run with these settings stated gives the same result
        fits = fitting.fits(fitting.starts(), ITERATIONS)
        excess = fitting.misfit(fits, sized=used != plain.used)
    return used, fits, excess


def _start(samples: Source, cycles: slice, reference: Reference | None, vehicle: Resolved) -> Start | None:
    """Start of a long phase's fit: errors of the reference grow along the phase, so its first part is fitted first."""
    if reference is None:
        return None
    start, length = Start(reference), BEGINNING
    while length * LONGER <= cycles.stop - cycles.start:
        begun = slice(cycles.start, cycles.start + length)
        start = offline.start_after(samples, begun, start, vehicle, SIZING)
        length *= LONGER
    return start
