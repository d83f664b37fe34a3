"""Screening: a segment reduced once, and every hypothesis fitted on it, the most likely first.

What is left is counted as a likelihood of free noise levels, with a price for each unknown and for each alternative of its kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from massprop_cli.base.arrays import TINY, Array, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis import hypotheses, normalised, segment
from massprop_cli.diagnosis.channelwise import Free, beside_torques, free_response
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import ROUGHLY, STILL, Fitted, compared, fitted
from massprop_cli.diagnosis.corrections import certain
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.ranking import CLEAR, Ranking
from massprop_cli.diagnosis.verticals import verticals
from massprop_cli.errorparameters.sensor import DEGREE, GRAVITY
from massprop_cli.errorparameters.setup import LAG
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.phases import as_stated
from massprop_cli.estimate.whitening import Disturbance
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.plant.plant import MOMENT
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.actuators import channel_names, pushing
from massprop_cli.prepare.stream import Stream

LONGEST = 1200
"""Cycles that hypotheses are tried on."""
FITS = (2.0, 6.0)
"""The log fits if what is left is below this many times pure error, and this many sigmas of chance more. The motion within a cycle is taken
as linear, which leaves as much as the noise does where a body turns by 0.06 rad in a cycle."""
CLOSE = 1.4
"""The same where the motion within the cycles is a body's own: beside a torque, and of a log that is corrected."""
BY_CHANCE = 3.0
"""Sigmas of chance beyond which it is more than that."""
LOUD = 4.0
"""Pure error over the stated noise, variances, beyond which the log says too little for a cause that explains but a part."""
NOISY = 1.2
"""The same, beyond which noise itself was stated too small: five sigma of chance in 1,000 cycles."""
AS_STATED = 3.5
"""Sigmas of chance within which pure error is the stated noise in each of the channels."""
SHARE = 12
"""Mountings that are fitted."""
UPRIGHT, AS_WELL, UPSET = 4, 1.05, 0.8
"""Mountings that are put to the test because gravity is where it should be, and channels beside which; parts of what it leaves as stated
that are as well and less."""


TOLD = 2.0, 0.1
"""Sigmas from 1, and sigma, of a scale that the log tells to be 1."""
END = 5
"""Cycles of a piece that are its end."""


def busiest(case: Case, piece: slice, longest: int = LONGEST) -> tuple[Case, slice]:
    """A case of so many cycles of a piece, those in which most is commanded, up to what is commanded at the end alone.

    Under a longer delay that would have no part in it, and nothing could be held against what there is without.
    """
    log, found = segment.busiest(case.log, case.vehicle, case.timing, piece, longest)
    if log.command_s is None:
        commanded = log.command[found] != 0
        first = found.start + commanded.argmax(0)[commanded.any(0)]
        found = slice(found.start, int(min(found.stop, *first[first >= found.stop - END], found.stop)))
    return case._replace(log=log, whole=(case.log, piece) if piece.stop - piece.start > longest else None), found


def screened(case: Case, piece: slice, likely: Sequence[Disturbance] = (), theta: Array | None = None) -> Screening | None:
    """A case reduced as :func:`free_response` does; None where it is too short."""
    try:
        free = free_response(case, piece, likely, theta)
    except (InputError, np.linalg.LinAlgError):
        return None
    return _screening(case, piece, free, theta)


def _screening(case: Case, piece: slice, free: Free, theta: Array | None) -> Screening:
    model = Model.of(free, case.vehicle, float(case.setup.value(LAG)[0]) / case.vehicle.cycle.period_s, case.log.command_kind)
    if not len(free.fired) and case.vehicle.swings:
        body = first_reference(case.timing.of(case.log, case.vehicle), piece, case.vehicle)
        model = replace(model, released=None if body is None else model.plant.theta(body))
    noise = np.repeat([case.vehicle.imu.gyro_noise_rad_s, case.vehicle.imu.accel_noise_m_s2], 3) ** 2
    (stated,) = fitted(model, free, free.variance, [Hypothesis("", (), np.zeros((len(model.stated), 0)))], theta)
    return Screening(case, piece, free, model, noise, stated)


def about_its_body(screening: Screening) -> Screening:
    """The look with the motion within the cycles that its own body as stated has, where that explains more and leaves less.

    What hardly is a body, where the log tells of none, moves so much that only a torque explains it.
    """
    again = screened(screening.case, screening.piece, theta=screening.stated.value("theta"))
    return again if again is not None and again.cost < screening.cost and again.misfit < screening.misfit else screening


def beside_a_torque(screening: Screening) -> Screening:
    """The look beside the torque, wandering or white, beside which its body as stated explains most; itself where it does so without."""
    best = _likeliest_beside(screening, screening)
    near = best.free.beside[0] if best.free.beside else None
    return best if near is None else _likeliest_beside(best, screening, near)


def _likeliest_beside(best: Screening, screening: Screening, near: Disturbance | None = None) -> Screening:
    """Of torques of a few levels, or ``near`` one, or what was the ``best``."""
    theta, cost = screening.stated.value("theta"), partial(free_cost, noise=screening.noise)
    for free in sorted(beside_torques(screening.case, screening.piece, theta, near), key=cost):
        if cost(free) >= best.cost:
            break  # no body leaves less than free coefficients
        one = _screening(screening.case, screening.piece, free, theta)
        explains = one.cost < best.cost and (one.close or one.misfit < screening.misfit)
        best = one if explains else best
    return best


def free_cost(free: Free, noise: Array) -> float:
    """−2 log likelihood of free noise levels and free coefficients, beyond that of ``noise`` (6,) alone.

    With another delay the log holds a cycle more or less of which the commands are known: so that is worth nothing. A torque that wanders
    has the price of its beginnings, as a steady one has of its axes.
    """
    begun = 3 * float(np.log(free.gyro.spare)) * sum(one.walk > 0 for one in free.beside)
    return float((_counts(free) * np.log(free.variance / noise)).sum()) + free.gyro.volume + free.accelerometer.volume + begun


def _counts(free: Free) -> Array:
    """(6,) measurements less coefficients."""
    return np.repeat([free.gyro.spare, free.accelerometer.spare], 3).astype(float)


@dataclass(frozen=True)
class Screening:
    """A stretch of a case: what it says, and what is left of it as stated."""

    case: Case
    piece: slice
    free: Free
    model: Model
    noise: Array
    """(6,) variance of the IMU's noise, as stated."""
    stated: Fitted

    @property
    def names(self) -> list[str]:
        """Of the channels that fired."""
        every = channel_names(self.case.log, self.case.vehicle)
        return [every[i] for i in self.free.fired]

    def fitted(self, supposed: Sequence[Hypothesis], theta: Array | None = None, still: float = STILL) -> list[Fitted]:
        """Hypotheses fitted to the stretch (:func:`massprop_cli.diagnosis.comparison.fitted`)."""
        return fitted(self.model, self.free, self.free.variance, supposed, theta, still)

    def supposing(self, supposed: Hypothesis, **moved: float) -> Fitted:
        """A hypothesis before anything is fitted to it, with entries of x moved by so much."""
        x = self.stated.x.copy()
        for name, by in moved.items():
            x[self.model.place(name)] += by
        return Fitted(supposed, self.model, x, self.stated.chi_square, np.zeros(supposed.free.shape[1]))

    def next_step(self, found: Fitted) -> tuple[Fitted, float]:
        """The next step of a hypothesis that is in place here, and by how much it promises to lower −2 log likelihood."""
        (more,) = self.fitted([found.hypothesis.moves], found.value("theta"))
        return more, self.likelihood(self.stated.chi_square) - self.likelihood(more.chi_square)

    @property
    def misfit(self) -> float:
        """What is left over what is to be expected."""
        return float(self.stated.chi_square.sum() / self.freedom)

    @cached_property
    def freedom(self) -> int:
        """How many squares of chance are expected of what is left: equations of the triangles less the body's ten.

        A column that others are the sum of leaves an equation, too: of some direction of the noise.
        """
        return max(3 * sum(len(told.triangle) for told in (self.free.gyro, self.free.accelerometer)) - 10, 1)

    @property
    def excess(self) -> float:
        """Chi-square beyond what is to be expected."""
        return max(self.misfit - 1.0, 0.0) * self.freedom

    @property
    def fits(self) -> bool:
        """Whether what is left is chance."""
        return bool(self.misfit < FITS[0] + FITS[1] * np.sqrt(2 / self.freedom))

    @property
    def close(self) -> bool:
        """The same where the motion within the cycles is a body's own."""
        return bool(self.misfit < CLOSE + FITS[1] * np.sqrt(2 / self.freedom))

    @property
    def chance(self) -> bool:
        """Whether it is no more than chance leaves by itself."""
        return bool(self.misfit < 1 + BY_CHANCE * np.sqrt(2 / self.freedom))

    @property
    def constant(self) -> bool:
        """Whether free coefficients leave no more nor less than the stated noise, in whatever units.

        Then whatever is wrong is so all along: commands that come cycles later, a sensor's low-pass and another body from some moment on
        make a response that no coefficients stand for.
        """
        ratio = np.log(np.maximum(self.free.pure / self.noise, TINY)).reshape(2, 3)
        unit = 2 * np.log([[DEGREE], [GRAVITY]])
        away = np.abs(ratio - unit * np.rint(ratio.mean(1, keepdims=True) / unit))
        spare = np.array([[self.free.gyro.spare], [self.free.accelerometer.spare]])
        return bool((away < AS_STATED * np.sqrt(2 / spare)).all())

    @cached_property
    def free_cost(self) -> float:
        """−2 log likelihood of free noise levels and free coefficients."""
        return free_cost(self.free, self.noise)

    @property
    def cost(self) -> float:
        """−2 log likelihood of free noise levels, as stated."""
        return self.free_cost + self.likelihood(self.stated.chi_square)

    def score(self, left: Array, found: Fitted, alternatives: int = 1) -> float:
        """−2 log of how likely a hypothesis is that leaves chi-square ``left`` (6,): of free noise levels, times what is to be expected.

        Each unknown has its price (Schwarz 1978), but none that is just what a jet does that is dead or mounted the other way round.
        """
        each = np.log(self.free.gyro.spare)
        price = sum(
            np.log(2) if certain(part) else part.unlikely + (part.unknowns + len(part.hypothesis.further)) * each for part in found.parts
        )
        rare = sum(part.hypothesis.rare for part in found.parts)
        return self.likelihood(left) + float(price + rare + 2 * np.log(alternatives))

    @property
    def noisy(self) -> bool:
        """Whether pure error is above the stated noise in most channels."""
        return bool(median(self.free.pure / self.noise) > NOISY)

    @cached_property
    def exact(self) -> Array | None:
        """(N, 6) normalised innovations of an off-line fit, as exact as the estimator is; None where there is none."""
        log, vehicle, timing, *_ = self.case
        phase = Phase(name="piece", start_s=0.0, end_s=1.0)
        try:
            (fit,) = as_stated(Stream.of(log, vehicle, timing), [(phase, self.piece)], vehicle, Consider()).fits
        except np.linalg.LinAlgError:
            return None
        return None if fit is None else fit.history.normalised[np.isfinite(fit.history.normalised).all(1)]

    @property
    def loud(self) -> bool:
        """Whether pure error is far above the stated noise: something is wrong that no coefficient stands for."""
        return bool((self.free.pure > LOUD * self.noise).any())

    def likelihood(self, left: Array) -> float:
        """−2 log likelihood of free noise levels, of chi-square (6,), beyond that of free coefficients."""
        return float(self.likelihoods(left))

    def likelihoods(self, left: Array) -> Array:
        """The same (...,) of each (..., 6)."""
        return np.asarray((self._counts * np.log1p(left / self._counts)).sum(-1))

    @cached_property
    def _counts(self) -> Array:
        return _counts(self.free)

    @cached_property
    def ranked(self) -> Ranking:
        """Every hypothesis that leaves less than what is stated, the most likely first."""
        listed = hypotheses.listed(self.model, self.names)
        own = normalised.suspected(self.names, (self.case.whole or (self.case.log,))[0])
        every = [*listed, *normalised.supposed(self.model, self.names, own), *self._likely_turns(), *self._pushing_more()]
        supposed = normalised.renamed(every, self.names, own)
        most = self.score(self.stated.chi_square, self.stated) - CLEAR
        return Ranking(self.model, self.free, supposed, self.score, self.likelihood, most)

    @property
    def scales_told(self) -> bool:
        """Whether the log tells the scale of columns whose largest value is 1, and it is 1.

        Where that is all that is commanded, whether it tells that of torques beside forces: no one number normalises both.
        """
        own = normalised.suspected(self.names, (self.case.whole or (self.case.log,))[0])
        supposed = normalised.supposed(self.model, self.names, own)[:1]
        if not supposed or (len(own) == len(self.names) and len({"torque" in name for name in own}) < 2):
            return False
        (found,) = self.fitted(supposed, self.stated.value("theta"))
        near = np.abs(found.moved) < TOLD[0] * found.spread
        return bool((near & (normalised.SIZE * found.spread < TOLD[1])).all())

    def _pushing_more(self) -> list[Hypothesis]:
        """The channels that push giving another part of what is stated than those that only turn, from where it is most likely on.

        Of k times the force the CG c and the mass m look like k c and m / k, with the IMU (k − 1) c away from its place. So where that
        explains the log this does too, and a small step leads from the one to the other no more than along a curved valley.
        """
        stored = range(self.model.thrusting, len(self.names))
        if self.model.thrusting and stored:  # as much less of what stores momentum is the same motion, and may be nearer
            (other,) = self.fitted([hypotheses.scaled(self.model, self.names, stored)], still=ROUGHLY)
            part = float(other.factors[0])
            return [hypotheses.scaled(self.model, self.names, range(self.model.thrusting), 1 / part)] if part > 0 else []
        group = pushing(self.model.wrench(self.model.stated)[1], self.model.together)
        if self.model.bearing is not None or not group:
            return []
        (away,) = self.fitted([hypotheses.imu_position(self.model)], still=ROUGHLY)
        centre, by = away.value("theta")[MOMENT], away.value("imu")
        share = float(np.dot(by, centre)) / max(float(np.dot(centre, centre)), TINY)
        return [hypotheses.scaled(self.model, self.names, group, 1 / (1 - share))] if share < 1 else []

    def _likely_turns(self) -> list[Hypothesis]:
        """The few units and mountings that leave least; on a bearing, as far as gravity is where it should be.

        In free flight each is fitted: by another unit a body is far from the one that regression begins with.
        """
        every = self.turns
        if self.model.bearing is not None:
            rough = np.array(self._gravity[: len(every)])
        else:
            rough = self.likelihoods(np.array([one.chi_square for one in self.fitted(every, still=ROUGHLY)]))
        return [every[i] for i in np.argsort(rough, kind="stable")[:SHARE]]

    @cached_property
    def upright(self) -> list[Fitted]:
        """Units and mountings by which, on a bearing, gravity is found where it should be as well as as stated; the most likely first.

        They turn the vertical that the log was reduced with, so that nothing is fitted to it.
        """
        if self.model.bearing is None:
            return []
        *rough, stated = self._gravity
        order = [i for i in np.argsort(rough, kind="stable")[:UPRIGHT] if rough[i] < stated * AS_WELL]
        return [self.supposing(self.turns[i]) for i in order]

    @cached_property
    def turned_beside_a_channel(self) -> list[Hypothesis]:
        """The unit or mounting that leaves least whatever one of the channels does; none on a bearing (:attr:`upright`)."""
        turns, channels = [] if self.model.bearing is not None else self.turns, range(len(self.names))
        if not turns or not channels:
            return []
        every = [turn.whatever(channel) for turn in turns for channel in channels]
        roughly = self.likelihoods(compared(self.model, self.free, self.free.variance, every))
        of_each = roughly.reshape(len(turns), len(channels))
        likely = np.argsort(of_each.min(1), kind="stable")[:UPRIGHT]
        some = [(i, j) for i in likely for j in np.argsort(of_each[i], kind="stable")[:UPRIGHT]]
        near = self.fitted([every[i * len(channels) + j] for i, j in some], still=ROUGHLY)
        best = int(np.argmin([self.likelihood(one.chi_square) for one in near]))
        return [turns[some[best][0]]]

    @property
    def upset(self) -> bool:
        """Whether gravity is not where it should be, and is for some other unit or mounting."""
        return bool(self.upright) and min(self._gravity) < UPSET * self._gravity[-1]

    @cached_property
    def turns(self) -> list[Hypothesis]:
        """Units and mountings, but of what shows nothing: on a table a gyro's axes X and Y."""
        log, same, about = self.case.log, np.eye(3), self.model.turns
        units = hypotheses.units(self.model, median(log.interval_s), log.rate_columns[0].startswith("delta"))
        every = [*units, *hypotheses.mountings(self.model)]
        return [one for one in every if not (np.allclose(one.gyro[about], same[about]) and np.allclose(one.accelerometer, same))]

    @cached_property
    def _gravity(self) -> list[float]:
        """Mean square of what is left of the specific force once the vertical, integrated from the rates, is taken out.

        Under each of ``turns``, and as stated.
        """
        supposed = [*self.turns, self.stated.hypothesis]
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
