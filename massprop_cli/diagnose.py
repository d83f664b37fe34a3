"""What is wrong with the vehicle file or the log, where the two don't fit: the right cause, or none.

Every supposition of :mod:`massprop_cli.causes` is held against one reduction of the log (:mod:`massprop_cli.channelwise`). What is left
is counted as a likelihood of free noise levels, with a price for each unknown and for each alternative of its kind. The best are applied
to log and vehicle file and the log is reduced again, so that what counts in the end is exact. One is named only if the log passes its
test once it is mended; those that come near stand beside it. Two at once are tried where no single one suffices. Nothing is acted on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from massprop_cli import causes, change
from massprop_cli.align import LAGS_FORGOTTEN
from massprop_cli.arrays import Array
from massprop_cli.channelwise import Free, free_response, verticals
from massprop_cli.columns import WRENCH
from massprop_cli.contest import Fitted, compared, fitted
from massprop_cli.cures import Case, Cure, applied, cure_of
from massprop_cli.errors import InputError
from massprop_cli.start import first_reference
from massprop_cli.suppositions import Model, Supposition
from massprop_cli.telemetry import Log, Notice
from massprop_cli.timing import Found, Timing, near, search
from massprop_cli.vehicle import Vehicle
from massprop_cli.wording import NEAR, alone, words_of

LONGEST = 1200
"""Cycles that suppositions are tried on."""
MEMORY = 64
"""Cycles before them that commands may come from, under any delay that is tried."""
FITS = (2.0, 6.0)
"""The log fits if what is left is below this many times pure error, and this many sigmas of chance more. The motion within a cycle is taken
as linear, which leaves as much as the noise does where a body turns by 0.06 rad in a cycle."""
NEARLY, PART = 6.0, 1e-3
"""Mended, it fits as well with up to so many times pure error, if that is so small a part of what was left before."""
FLOOR = 1e-6
"""Of the stated noise's variance, what pure error is not below: a log without noise has none."""
LOUD = 4.0
"""Pure error over the stated noise, variances, beyond which the log says too little for a cause that explains but a part."""
FINALISTS = (5, 12)
"""How many are applied in turn until one fits: in free flight; and on a bearing, where a wrong gyro turns gravity too."""
FIRST = 3
"""How many of them are tried with a second one."""
AGAIN = 8
"""How often one is applied anew from where it led."""
STILL = 0.01
"""A change of −2 log likelihood that ends that."""
FURTHER = 1.5
"""Before it is applied a large change looks worse than it is, by up to so much."""
CLEAR = 14.0
"""−2 log of the odds (1 : 1000) by which a cause must come before its rivals to stand alone."""
TRIED = (
    "tried: sign, thrust, place and direction of each channel, groups of channels, delay, rise, lag, clock drift, units, scales, biases, "
    "low-pass and mounting of gyro and accelerometer, IMU position, attitude at the start, steady and rate-proportional torque, fuel use, "
    "a change of the mass properties, and pairs of these"
)
EVEN = 6.0
"""−2 log of the odds (1 : 20) below which two of a kind are named side by side."""
SHARE = 12
"""Mountings that are read anew or fitted."""


class Trial(NamedTuple):
    """A supposition, how it is mended, and what it leaves."""

    fitted: Fitted
    case: Case
    score: float
    """−2 log likelihood, with the price of its freedom."""
    fits: bool


@dataclass(frozen=True)
class Explanation:
    """A cause that has a name."""

    code: str
    message: str
    cure: Cure | None
    """None where neither the vehicle file's keys nor factors on the log's columns mend it."""
    change_s: float | None = None
    """When the mass properties changed at once, if that is what is supposed."""

    @property
    def notice(self) -> Notice:
        """For the reader."""
        return Notice(self.code, self.message)


@dataclass(frozen=True)
class Diagnosis:
    """What was found: several causes are wrong together."""

    explanations: tuple[Explanation, ...] = ()
    detected: Found | None = None
    """What the log says of the command delay, if that is the cause."""
    unknown: str = ""
    """Where log and vehicle file don't fit and nothing explains it: what was tried."""


def diagnose(log: Log, vehicle: Vehicle, timing: Timing, pieces: Sequence[slice]) -> Diagnosis:
    """Why the piece that fits worst doesn't fit. Noise levels must be set in ``vehicle``, and no disturbance beyond what it states."""
    case = Case(log, vehicle, timing)
    looks = [look for piece in pieces if (look := _looked(*_busiest(case, piece))) is not None]
    if not looks:
        return Diagnosis()
    look = max(looks, key=lambda one: one.misfit)
    if look.fits:
        return Diagnosis()
    return look.single() or look.much_later() or look.changed() or look.pair() or Diagnosis(unknown=look.in_vain())


def _busiest(case: Case, piece: slice) -> tuple[Case, slice]:
    """The ``LONGEST`` cycles of a piece in which most is commanded, in a log that holds no more than it takes to read them.

    Where the attitude is integrated from the log's beginning on, the first ones.
    """
    log, vehicle, timing = case
    integrated = vehicle.on_air_bearing and log.attitude_wxyz is None
    first, stop = piece.start, min(piece.start + LONGEST, piece.stop)
    if stop < piece.stop and not integrated:
        effort = (np.abs(log.command[piece]) / np.maximum(np.abs(log.command).max(0), np.finfo(float).tiny)).sum(1)
        total = np.concatenate([[0.0], np.cumsum(effort)])
        first = piece.start + int(np.argmax(total[LONGEST:] - total[:-LONGEST]))
        stop = first + LONGEST
    begin = 0 if integrated else max(first - MEMORY - int(timing.delay + LAGS_FORGOTTEN * timing.lag), 0)
    end = min(stop + 1, log.cycles)
    return case._replace(log=log.part(begin, end)), slice(first - begin, stop - begin)


def _looked(case: Case, piece: slice) -> _Look | None:
    """A case reduced; None where it is too short."""
    try:
        free = free_response(case.log, case.vehicle, case.timing, piece)
    except (InputError, np.linalg.LinAlgError):
        return None
    model = Model.of(free, case.vehicle, case.log.command_kind == "jets")
    noise = np.repeat([case.vehicle.imu.gyro_noise_rad_s or 0.0, case.vehicle.imu.accel_noise_m_s2 or 0.0], 3) ** 2
    variance = np.maximum(free.variance, FLOOR * noise)
    (stated,) = fitted(model, free, variance, [Supposition("", (), np.zeros((len(model.stated), 0)))])
    return _Look(case, piece, free, model, noise, variance, stated)


@dataclass(frozen=True)
class _Look:
    """A stretch of a case: what it says, and what is left of it as stated."""

    case: Case
    piece: slice
    free: Free
    model: Model
    noise: Array
    """(6,) variance of the IMU's noise, as stated."""
    variance: Array
    """(6,) pure error."""
    stated: Fitted

    @property
    def names(self) -> list[str]:
        """Of the channels that fired."""
        every = [jet.name for jet in self.case.vehicle.jets] if self.case.log.command_kind == "jets" else list(WRENCH)
        return [every[i] for i in self.free.fired]

    @property
    def misfit(self) -> float:
        """What is left over what is to be expected."""
        return float(self.stated.chi_square.sum() / self._freedom)

    @cached_property
    def _freedom(self) -> int:
        ranks = [int(np.linalg.matrix_rank(told.triangle)) for told in (self.free.gyro, self.free.accelerometer)]
        return max(3 * sum(ranks) - 10, 1)

    @property
    def fits(self) -> bool:
        """Whether what is left is chance."""
        return bool(self.misfit < FITS[0] + FITS[1] * np.sqrt(2 / self._freedom))

    @property
    def cost(self) -> float:
        """−2 log likelihood of free noise levels, as stated."""
        further = self.stated.chi_square * self.variance
        return self.free.gyro.cost(further[:3]) + self.free.accelerometer.cost(further[3:])

    def score(self, left: Array, found: Fitted, alternatives: int = 1) -> float:
        """−2 log of how likely a supposition is that leaves chi-square ``left`` (6,): of free noise levels, times what is to be expected.

        Each unknown has its price (Schwarz 1978), but none that is just what a jet does that is dead or mounted the other way round.
        """
        price = np.log(2) if _at_once(found) else found.unlikely + found.unknowns * np.log(self.free.gyro.spare)
        return self._cost(left) + float(price + 2 * np.log(alternatives))

    @property
    def loud(self) -> bool:
        """Whether pure error is far above the stated noise: something is wrong that no coefficient stands for."""
        return bool((self.variance > LOUD * self.noise).any())

    def _cost(self, left: Array) -> float:
        """−2 log likelihood of free noise levels, of chi-square (6,)."""
        counts = np.repeat([self.free.gyro.spare, self.free.accelerometer.spare], 3)
        return float((counts * np.log1p(left / counts)).sum())

    @cached_property
    def ranked(self) -> list[tuple[float, Fitted]]:
        """Every supposition that leaves less than what is stated, the likeliest first."""
        supposed = [*causes.listed(self.model, self.names, self.case.log.command_kind == "jets"), *self._likely_turns()]
        kinds = [one.code for one in supposed]
        found = fitted(self.model, self.free, self.variance, supposed)
        scores = [self.score(one.chi_square, one, kinds.count(one.supposed.code)) for one in found]
        least = self.score(self.stated.chi_square, self.stated) - CLEAR
        order = sorted(range(len(found)), key=lambda i: (scores[i], i))
        return [(scores[i], found[i]) for i in order if scores[i] < least]

    def _likely_turns(self) -> list[Supposition]:
        """The few units and mountings that leave least before any is fitted well; on a bearing, as far as gravity is where it should be."""
        every = [*causes.units(self.model), *causes.mountings(self.model)]
        if self.model.bearing is not None:
            rough = self._by_gravity(every)
        else:
            rough = [self._cost(left) for left in compared(self.model, self.free, self.variance, every)]
        return [every[i] for i in np.argsort(rough, kind="stable")[:SHARE]]

    def _by_gravity(self, supposed: Sequence[Supposition]) -> list[float]:
        """Mean square of what is left of the specific force once the vertical, integrated from the rates as supposed, is taken out."""
        samples = self.case.timing.of(self.case.log, self.case.vehicle)
        rate, force = samples.rate_rad_s[: self.piece.stop], samples.specific_force_m_s2[: self.piece.stop]
        turns = np.linalg.inv(np.stack([one.gyro for one in supposed]))
        different, which = np.unique(turns.round(9).reshape(len(turns), 9), axis=0, return_inverse=True)
        rates = np.einsum("nij,kj->nki", different.reshape(-1, 3, 3), rate)
        ups = verticals(rates, samples.executed.duration_s[: self.piece.stop], samples.up_b[0])
        means = (ups[:, 1:] + ups[:, :-1]) / 2
        left = [
            force @ np.linalg.inv(one.accelerometer).T - self.model.gravity * means[i]
            for one, i in zip(supposed, which.ravel(), strict=True)
        ]
        return [float((part**2).mean()) for part in left]

    def single(self) -> Diagnosis | None:
        """One cause that makes the log fit, with what comes near it."""
        best: list[Trial] = []
        most = FINALISTS[self.model.bearing is not None]
        for rough, found in self.ranked:
            if len(best) >= most or (any(t.fits for t in best) and rough > FURTHER * min(t.score for t in best if t.fits) + CLEAR):
                break
            trial = self.applied(found)
            if trial is not None:
                best.append(trial)
        return self.chosen(best)

    def chosen(self, trials: Sequence[Trial]) -> Diagnosis | None:
        """The likeliest of those with which the log fits."""
        fitting = sorted((trial for trial in trials if trial.fits), key=lambda trial: trial.score)
        if not fitting:
            return None
        rivals = [trial for trial in fitting[1:] if trial.score < fitting[0].score + CLEAR]
        first = fitting[0]
        detected = None
        if first.fitted.supposed.code == "delay-mismatch":
            before, after = self.misfit, float(first.fitted.chi_square.sum() / self._freedom)
            by = first.case.timing.delay - self.case.timing.delay
            detected = near(self.case.timing, by, float(first.fitted.spread[0]), before, after)
        return Diagnosis((self.explained(first, rivals),), detected)

    def much_later(self) -> Diagnosis | None:
        """Another command delay, further off than a small step leads to: where free coefficients leave least."""
        log, vehicle, timing = self.case
        at = search(log, vehicle, [timing.lag], pieces=[self.piece])
        if at is None:
            return None
        x = self.stated.x.copy()
        x[self.model.place("delay")] = at.delay - timing.delay
        supposed = Supposition("delay-mismatch", (), causes.along(self.model, ("delay", np.ones(1))))
        begun = Fitted(supposed, self.model, x, self.stated.chi_square, np.zeros(1))
        trial = self._trial(begun, self.case._replace(timing=timing._replace(delay=at.delay)))
        return None if trial is None else self.chosen([trial])

    def applied(self, found: Fitted) -> Trial | None:
        """A supposition with its best values in log and vehicle file; None where that can't be written down."""
        case = applied(self.case, found, self.free.fired)
        if case is None:
            return Trial(found, self.case, self.score(found.chi_square, found), self._passes(found))
        return self._trial(found, case)

    def _passes(self, found: Fitted) -> bool:
        freedom = self._freedom - found.unknowns
        left = float(found.chi_square.sum() / freedom)
        return left < FITS[0] + FITS[1] * np.sqrt(2 / freedom) and (left < PART * self.misfit or not self.loud)

    def _trial(self, found: Fitted, case: Case) -> Trial | None:
        """What is left once the case is reduced anew, its unknowns moved on from there until they stand."""
        look = _looked(case, self.piece)
        if look is None or look.model.places != self.model.places:
            return None
        spread = found.spread
        for _ in range(AGAIN if found.unknowns else 0):
            (more,) = fitted(look.model, look.free, look.variance, [found.supposed])
            spread = more.spread
            further = replace(found, x=_together(found.x, more.x, self.model))
            then = applied(self.case, further, self.free.fired)
            there = None if then is None else _looked(then, self.piece)
            if then is None or there is None or there.cost > look.cost - STILL:
                break
            found, case, look = further, then, there
        found = replace(found, chi_square=look.stated.chi_square, spread=spread * np.sqrt(max(look.misfit, 1.0)))
        if _at_once(found):
            x = found.x.copy()
            thrust = self.model.place("thrust")
            x[thrust] = np.where(x[thrust] == 1.0, 1.0, x[thrust].round())
            found = replace(found, x=x)
            case = applied(self.case, found, self.free.fired) or case
        much = look.misfit < PART * self.misfit
        fits = (look.fits and not look.loud) or (much and (look.fits or look.misfit < NEARLY))
        return Trial(found, case, look.score(look.stated.chi_square, found), fits)

    def explained(self, trial: Trial, rivals: Sequence[Trial] = ()) -> Explanation:
        """In words, with the settings that mend it."""
        code, message = words_of(trial.fitted, self.names, self.case, trial.case)
        beside = []
        for rival in rivals:
            its_code, other = words_of(rival.fitted, self.names, self.case, rival.case)
            if rival.fitted.supposed.subject == trial.fitted.supposed.subject and its_code == code:
                continue  # the same, found from elsewhere
            if its_code == code and rival.score < trial.score + EVEN:
                message += f", or else {other}"
            else:
                beside.append(f"{other} (odds {np.exp((trial.score - rival.score) / 2):.2g} to 1)")
        message = f"the log fits if {message}"
        if beside:
            message += "; rivals that the log can't rule out: " + "; or ".join(beside[:2])
        return Explanation(code, message, cure_of(self.case, trial.case, trial.fitted))

    def changed(self) -> Diagnosis | None:
        """Another body from some moment on."""
        log, vehicle, timing = self.case
        samples = timing.of(log, vehicle)
        reference = first_reference(samples, self.piece, vehicle)
        at = None if reference is None else change.likeliest(samples, self.piece, reference, vehicle)
        if at is None:
            return None
        sides = [_looked(self.case, part) for part in (slice(self.piece.start, at), slice(at, self.piece.stop))]
        if not all(side is not None and side.fits for side in sides):
            return None
        time = round(float(samples.executed.start_s[at]), 9)
        message = (
            f"the log fits if the mass properties change at once at {time:.6g} s, as by docking or release; give the vehicle file "
            "[[phases]] that end and begin there (estimator.split_on_change = true does it): what is estimated over the change is no body's"
        )
        return Diagnosis((Explanation("mass-change", message, Cure(("estimator.split_on_change=true",)), time),))

    def pair(self) -> Diagnosis | None:
        """Two causes at once: the likeliest few, each with what explains the rest; or any two channels."""
        found: list[tuple[float, Trial, _Look, Trial]] = []
        for _, first in self.ranked[:FIRST]:
            trial = self.applied(first)
            look = None if trial is None or trial.case is self.case else _looked(trial.case, self.piece)
            if trial is None or look is None:
                continue
            for _, second in look.ranked[:2]:
                other = look.applied(second)
                if other is not None and other.fits:
                    price = first.unknowns * np.log(self.free.gyro.spare)
                    found.append((other.score + price, trial, look, other))
                    break
        if not found:
            return self.two_channels()
        _, trial, look, other = min(found, key=lambda one: one[0])
        one, two = self.explained(trial), look.explained(other)
        both = one.cure.followed_by(two.cure) if one.cure is not None and two.cure is not None else None
        message = f"{one.message}, and {two.message.removeprefix('the log fits if ')} as well"
        return Diagnosis((Explanation(one.code, message, both), Explanation(two.code, message, both)))

    def two_channels(self) -> Diagnosis | None:
        """The thrust of any two channels at once."""
        supposed = causes.two_channels(self.model, self.names)
        if not supposed:
            return None
        found = fitted(self.model, self.free, self.variance, supposed)
        best = min(found, key=lambda one: (self._cost(one.chi_square), one.supposed.subject))
        trial = self.applied(best)
        if trial is None or not trial.fits:
            return None
        both = cure_of(self.case, trial.case, trial.fitted)
        return Diagnosis(
            tuple(
                Explanation(code, f"the log fits if {words}", both)
                for name in best.supposed.subject
                for code, words in [words_of(alone(trial.fitted, name), self.names, self.case, trial.case)]
            )
        )

    def in_vain(self) -> str:
        """What was tried, and what came nearest."""
        nearest = []
        for _, found in self.ranked[:2]:
            code, _ = words_of(found, self.names, self.case, self.case)
            nearest.append(f"{code} leaves {100 * found.chi_square.sum() / self.stated.chi_square.sum():.2g} %")
        near = f"; nearest: {', '.join(nearest)} of the misfit" if nearest else ""
        return f"log and vehicle file don't fit, cause unknown: what the model leaves is {self.misfit:.3g} times pure error{near}; {TRIED}"


def _at_once(found: Fitted) -> bool:
    """Whether it says of channels that they are dead or push the other way round, and nothing else."""
    return found.supposed.code == "thrust-scale" and bool((np.abs(found.factors[:, None] - [-1.0, 0.0]).min(1) < NEAR).all())


def _together(x: Array, more: Array, model: Model) -> Array:
    """Both changes of x one after the other; the second was found with the first in place."""
    found = more.copy()
    own = slice(10, None)
    found[own] = x[own] + more[own] - model.stated[own]
    thrust = model.place("thrust")
    found[thrust] = x[thrust] * more[thrust]
    return found
