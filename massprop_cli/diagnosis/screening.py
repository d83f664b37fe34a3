"""Screening: fit of every hypothesis to one reduction of a segment, ranked by likelihood.

The criterion is −2 log likelihood with free noise levels, plus penalties for each unknown (Schwarz 1978) and for alternatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from massprop_cli.base.arrays import TINY, Array, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import CERTAIN, CHANCE, CLEAR, CONTRADICTION, EDGE, GROSS, SHORT
from massprop_cli.diagnosis import hypotheses, normalised, segment
from massprop_cli.diagnosis.channelwise import FreeResponse, free_response, free_responses_by_torque
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import ROUGHLY, STILL, Fitted, compared, fitted
from massprop_cli.diagnosis.corrections import is_certain
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.ranking import Ranking
from massprop_cli.diagnosis.verticals import verticals
from massprop_cli.errorparameters.sensor import DEGREE, GRAVITY
from massprop_cli.errorparameters.setup import LAG
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.phases import as_stated
from massprop_cli.estimate.whitening import EXPLAINED, Disturbance
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.plant.plant import MOMENT
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.actuators import channel_names, pushing
from massprop_cli.prepare.stream import Stream

FITS = 2.0
"""Misfit limit: this multiple of pure error, in addition to chance. The linear motion within a cycle leaves as much as the noise
if a body turns 0.06 rad in a cycle."""
CLOSE = 1.4
"""The same multiple if the columns hold the body's own intra-cycle motion."""
SHARE = 12
"""Number of units and mountings that are fitted."""
UPRIGHT, AS_WELL, UPSET = 4, 1.05, 0.8
"""On a bearing: number of mountings refitted by gravity, and limits of the gravity residual over the stated one that count as no worse and
as better."""


UNIT_SCALE = 2.0, 0.1
"""Sigmas from 1 and largest sigma of a scale that the log confirms to be 1."""


def busiest(case: Case, piece: slice, longest: int = SHORT) -> tuple[Case, slice]:
    """The most commanded cycles of a piece, cut before a channel that fires only at the end.

    Under a longer delay such a channel would not act, and no hypothesis could be compared with the stated case.
    """
    log, cycles = segment.busiest(case.log, case.vehicle, case.timing, piece, longest)
    if log.command_s is None:
        commanded = log.command[cycles] != 0
        first = cycles.start + commanded.argmax(0)[commanded.any(0)]
        cycles = slice(cycles.start, int(min(cycles.stop, *first[first >= cycles.stop - EDGE], cycles.stop)))
    return case._replace(log=log, whole=(case.log, piece) if piece.stop - piece.start > longest else None), cycles


def screened(case: Case, piece: slice, likely: Sequence[Disturbance] = (), theta: Array | None = None) -> Screening | None:
    """Screening of cycles ``piece``, reduced as by :func:`free_response`; None if they are too few."""
    try:
        free = free_response(case, piece, likely, theta)
    except (InputError, np.linalg.LinAlgError):
        return None
    return _screening(case, piece, free, theta)


def _screening(case: Case, piece: slice, free: FreeResponse, theta: Array | None) -> Screening:
    model = Model.of(free, case.vehicle, float(case.setup.value(LAG)[0]) / case.vehicle.cycle.period_s, case.log.command_kind)
    if not len(free.fired) and case.vehicle.swings:
        reference = first_reference(case.timing.of(case.log, case.vehicle), piece, case.vehicle)
        model = replace(model, released=None if reference is None else model.plant.theta(reference))
    noise = np.repeat([case.vehicle.imu.gyro_noise_rad_s, case.vehicle.imu.accel_noise_m_s2], 3) ** 2
    (stated,) = fitted(model, free, free.variance, [Hypothesis("", (), np.zeros((len(model.stated), 0)))], theta)
    return Screening(case, piece, free, model, noise, stated)


def relinearised(screening: Screening) -> Screening:
    """The screening with the intra-cycle motion of its own body, if that lowers cost and misfit.

    An ill-determined body may imply so much motion that only a torque explains it.
    """
    again = screened(screening.case, screening.piece, theta=screening.stated.value("theta"))
    return again if again is not None and again.cost < screening.cost and again.misfit < screening.misfit else screening


def under_likeliest_torque(screening: Screening) -> Screening:
    """The screening under the disturbance torque that gives the least cost; unchanged if that is no torque."""
    best = _best_torque(screening, screening)
    near = best.free.disturbances[0] if best.free.disturbances else None
    return best if near is None else _best_torque(best, screening, near)


def _best_torque(best: Screening, screening: Screening, near: Disturbance | None = None) -> Screening:
    """The best of ``best`` and screenings under torques of a few levels, or of levels near ``near``."""
    theta, cost = screening.stated.value("theta"), partial(free_cost, noise=screening.noise)
    for free in sorted(free_responses_by_torque(screening.case, screening.piece, theta, near), key=cost):
        if cost(free) >= best.cost:
            break  # a body never has less cost than free coefficients
        candidate = _screening(screening.case, screening.piece, free, theta)
        better = candidate.cost < best.cost and (candidate.fits_closely or candidate.misfit < screening.misfit)
        best = candidate if better else best
    return best


def free_cost(free: FreeResponse, noise: Array) -> float:
    """−2 log likelihood with free noise levels and free coefficients, relative to that of ``noise`` (6,).

    It is relative so that a cycle more or fewer under another delay has no effect. A random-walk torque has a penalty for its three initial
    values, as a steady torque has for its three components.
    """
    begun = 3 * float(np.log(free.gyro.spare)) * sum(one.walk > 0 for one in free.disturbances)
    return float((_degrees_of_freedom(free) * np.log(free.variance / noise)).sum()) + free.gyro.volume + free.accelerometer.volume + begun


def _degrees_of_freedom(free: FreeResponse) -> Array:
    """(6,) degrees of freedom with free coefficients."""
    return np.repeat([free.gyro.spare, free.accelerometer.spare], 3).astype(float)


@dataclass(frozen=True)
class Screening:
    """Reduction of a segment, and the fit of the stated case to it."""

    case: Case
    piece: slice
    free: FreeResponse
    model: Model
    noise: Array
    """(6,) stated variance of the IMU noise."""
    stated: Fitted

    @property
    def names(self) -> list[str]:
        """Names of the channels that act."""
        every = channel_names(self.case.log, self.case.vehicle)
        return [every[i] for i in self.free.fired]

    def fitted(self, hypotheses_to_fit: Sequence[Hypothesis], theta: Array | None = None, tolerance: float = STILL) -> list[Fitted]:
        """Fit hypotheses to the segment (:func:`massprop_cli.diagnosis.comparison.fitted`)."""
        return fitted(self.model, self.free, self.free.variance, hypotheses_to_fit, theta, tolerance)

    def unfitted(self, hypothesis: Hypothesis, **shifts: float) -> Fitted:
        """A hypothesis before any fit, with entries of x shifted."""
        x = self.stated.x.copy()
        for name, shift in shifts.items():
            x[self.model.place(name)] += shift
        return Fitted(hypothesis, self.model, x, self.stated.chi_square, np.zeros(hypothesis.directions.shape[1]))

    def next_step(self, applied: Fitted) -> tuple[Fitted, float]:
        """The next step of an applied hypothesis, and the decrease of −2 log likelihood that it predicts."""
        (further,) = self.fitted([applied.hypothesis.unknowns_only], applied.value("theta"))
        return further, self.likelihood(self.stated.chi_square) - self.likelihood(further.chi_square)

    @property
    def misfit(self) -> float:
        """Chi-square of the stated case over its expectation."""
        return float(self.stated.chi_square.sum() / self.degrees_of_freedom)

    @cached_property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom of that chi-square: equations of the triangles less ten mass properties.

        A dependent column leaves an equation, too, along some direction of the noise.
        """
        return max(3 * sum(len(sensor.triangle) for sensor in (self.free.gyro, self.free.accelerometer)) - 10, 1)

    @property
    def excess(self) -> float:
        """Chi-square of the stated case beyond its expectation."""
        return max(self.misfit - 1.0, 0.0) * self.degrees_of_freedom

    @property
    def fits(self) -> bool:
        """Whether the stated case fits (:data:`FITS`)."""
        return bool(self.misfit < FITS + CERTAIN * np.sqrt(2 / self.degrees_of_freedom))

    @property
    def fits_closely(self) -> bool:
        """The same if the columns hold the body's own intra-cycle motion (:data:`CLOSE`)."""
        return bool(self.misfit < CLOSE + CERTAIN * np.sqrt(2 / self.degrees_of_freedom))

    @property
    def within_chance(self) -> bool:
        """Whether the misfit is within :data:`CHANCE` sigmas."""
        return bool(self.misfit < 1 + CHANCE * np.sqrt(2 / self.degrees_of_freedom))

    @property
    def constant(self) -> bool:
        """Whether pure error is the stated noise, in whatever unit.

        Then the error is the same throughout. A delay of cycles, a sensor's low-pass or a change of the body gives a response that no free
        coefficients describe.
        """
        ratio = np.log(np.maximum(self.free.pure_error / self.noise, TINY)).reshape(2, 3)
        log_unit = 2 * np.log([[DEGREE], [GRAVITY]])
        difference = np.abs(ratio - log_unit * np.rint(ratio.mean(1, keepdims=True) / log_unit))
        degrees = np.array([[self.free.gyro.spare], [self.free.accelerometer.spare]])
        return bool((difference < CONTRADICTION * np.sqrt(2 / degrees)).all())

    @cached_property
    def free_cost(self) -> float:
        """−2 log likelihood with free noise levels and free coefficients."""
        return free_cost(self.free, self.noise)

    @property
    def cost(self) -> float:
        """−2 log likelihood of the stated case, with free noise levels."""
        return self.free_cost + self.likelihood(self.stated.chi_square)

    def score(self, chi_square: Array, fit: Fitted, alternatives: int = 1) -> float:
        """−2 log posterior odds of a hypothesis with chi-square (6,), relative to free coefficients.

        Each unknown has a penalty (Schwarz 1978) and a prior. A jet that is exactly dead or reversed has no unknown.
        """
        penalty = np.log(self.free.gyro.spare)
        penalties = sum(
            np.log(2) if is_certain(part) else part.prior_chi_square + (part.unknowns + len(part.hypothesis.sigma_key_values)) * penalty
            for part in fit.parts
        )
        prior_odds = sum(part.hypothesis.prior_odds for part in fit.parts)
        return self.likelihood(chi_square) + float(penalties + prior_odds + 2 * np.log(alternatives))

    @property
    def exceeds_noise(self) -> bool:
        """Whether pure error exceeds the stated noise in most channels."""
        return bool(median(self.free.pure_error / self.noise) > EXPLAINED)

    @cached_property
    def innovations(self) -> Array | None:
        """(N, 6) normalised innovations of an off-line fit; None if it fails."""
        log, vehicle, timing, *_ = self.case
        phase = Phase(name="piece", start_s=0.0, end_s=1.0)
        try:
            (fit,) = as_stated(Stream.of(log, vehicle, timing), [(phase, self.piece)], vehicle, Consider()).fits
        except np.linalg.LinAlgError:
            return None
        return None if fit is None else fit.history.normalised[np.isfinite(fit.history.normalised).all(1)]

    @property
    def far_exceeds_noise(self) -> bool:
        """Whether pure error far exceeds the stated noise in a channel, so that no free coefficients describe the error."""
        return bool((self.free.pure_error > GROSS * self.noise).any())

    def likelihood(self, chi_square: Array) -> float:
        """−2 log likelihood of chi-square (6,), with free noise levels, relative to free coefficients."""
        return float(self.likelihoods(chi_square))

    def likelihoods(self, chi_square: Array) -> Array:
        """The same (...,) of chi-squares (..., 6)."""
        return np.asarray((self._counts * np.log1p(chi_square / self._counts)).sum(-1))

    @cached_property
    def _counts(self) -> Array:
        return _degrees_of_freedom(self.free)

    @cached_property
    def ranked(self) -> Ranking:
        """Hypotheses that explain more than the stated case, ranked."""
        listed = hypotheses.listed(self.model, self.names)
        suspected = normalised.suspected(self.names, (self.case.whole or (self.case.log,))[0])
        every = [
            *listed,
            *normalised.scale_hypotheses(self.model, self.names, suspected),
            *self._likely_imu_hypotheses(),
            *self._force_scales(),
        ]
        listed_hypotheses = normalised.renamed(every, self.names, suspected)
        limit = self.score(self.stated.chi_square, self.stated) - CLEAR
        return Ranking(self.model, self.free, listed_hypotheses, self.score, self.likelihood, limit)

    @property
    def unit_scales_confirmed(self) -> bool:
        """Whether the log gives the scales of columns whose largest value is 1, and they are 1.

        If nothing else is commanded, only the ratio of torques to forces can be tested, since a common scale has no effect.
        """
        suspected = normalised.suspected(self.names, (self.case.whole or (self.case.log,))[0])
        scale = normalised.scale_hypotheses(self.model, self.names, suspected)[:1]
        if not scale or (len(suspected) == len(self.names) and len({"torque" in name for name in suspected}) < 2):
            return False
        (fit,) = self.fitted(scale, self.stated.value("theta"))
        equal = np.abs(fit.scaled) < UNIT_SCALE[0] * fit.spread
        return bool((equal & (normalised.SIZE * fit.spread < UNIT_SCALE[1])).all())

    def _force_scales(self) -> list[Hypothesis]:
        """The pushing channels with another part of their stated force than turning ones, from the most likely value on.

        With k times the force, the CG c becomes k c, the mass m becomes m / k, and the IMU appears (k − 1) c away from its place. A fit
        from the stated value would have to follow a curved valley, so the IMU's apparent place gives the initial k.
        """
        stored = range(self.model.thrusting, len(self.names))
        if self.model.thrusting and stored:  # the inverse factor on stored momentum gives the same motion, and may be nearer
            (momentum,) = self.fitted([hypotheses.scaled(self.model, self.names, stored)], tolerance=ROUGHLY)
            factor = float(momentum.factors[0])
            return [hypotheses.scaled(self.model, self.names, range(self.model.thrusting), 1 / factor)] if factor > 0 else []
        group = pushing(self.model.wrench(self.model.stated)[1], self.model.together)
        if self.model.bearing is not None or not group:
            return []
        (moved_imu,) = self.fitted([hypotheses.imu_position(self.model)], tolerance=ROUGHLY)
        centre, shift = moved_imu.value("theta")[MOMENT], moved_imu.value("imu")
        share = float(np.dot(shift, centre)) / max(float(np.dot(centre, centre)), TINY)
        return [hypotheses.scaled(self.model, self.names, group, 1 / (1 - share))] if share < 1 else []

    def _likely_imu_hypotheses(self) -> list[Hypothesis]:
        """The units and mountings of least cost; on a bearing, of least gravity residual.

        In free flight each is fitted, since another unit puts the body far from the initial regression.
        """
        candidates = self.imu_hypotheses
        if self.model.bearing is not None:
            costs = np.array(self._gravity[: len(candidates)])
        else:
            costs = self.likelihoods(np.array([one.chi_square for one in self.fitted(candidates, tolerance=ROUGHLY)]))
        return [candidates[i] for i in np.argsort(costs, kind="stable")[:SHARE]]

    @cached_property
    def gravity_candidates(self) -> list[Fitted]:
        """On a bearing, units and mountings whose gravity residual is no worse than the stated one, best first.

        They turn the vertical that the log was reduced with, so nothing is fitted.
        """
        if self.model.bearing is None:
            return []
        *residuals, stated = self._gravity
        order = [i for i in np.argsort(residuals, kind="stable")[:UPRIGHT] if residuals[i] < stated * AS_WELL]
        return [self.unfitted(self.imu_hypotheses[i]) for i in order]

    @cached_property
    def turn_with_free_channel(self) -> list[Hypothesis]:
        """In free flight, the unit or mounting of least cost with the effect of one channel free."""
        turns, channels = [] if self.model.bearing is not None else self.imu_hypotheses, range(len(self.names))
        if not turns or not channels:
            return []
        pairs = [turn.with_free_channel(channel) for turn in turns for channel in channels]
        costs = self.likelihoods(compared(self.model, self.free, self.free.variance, pairs))
        by_turn = costs.reshape(len(turns), len(channels))
        best_turns = np.argsort(by_turn.min(1), kind="stable")[:UPRIGHT]
        likely_pairs = [(i, j) for i in best_turns for j in np.argsort(by_turn[i], kind="stable")[:UPRIGHT]]
        fits = self.fitted([pairs[i * len(channels) + j] for i, j in likely_pairs], tolerance=ROUGHLY)
        best = int(np.argmin([self.likelihood(one.chi_square) for one in fits]))
        return [turns[likely_pairs[best][0]]]

    @property
    def gravity_misplaced(self) -> bool:
        """Whether another unit or mounting explains gravity better than the stated one."""
        return bool(self.gravity_candidates) and min(self._gravity) < UPSET * self._gravity[-1]

    @cached_property
    def imu_hypotheses(self) -> list[Hypothesis]:
        """Units and mountings that change a measured axis; on a table the gyro's X and Y are not."""
        log, identity, turning = self.case.log, np.eye(3), self.model.turns
        units = hypotheses.units(self.model, median(log.interval_s), log.rate_columns[0].startswith("delta"))
        candidates = [*units, *hypotheses.mountings(self.model)]
        return [
            one
            for one in candidates
            if not (np.allclose(one.gyro[turning], identity[turning]) and np.allclose(one.accelerometer, identity))
        ]

    @cached_property
    def _gravity(self) -> list[float]:
        """Gravity residual of each of ``imu_hypotheses``, and of the stated mounting, (m/s²)².

        It is the mean square of specific force less the vertical that is integrated from the rates.
        """
        candidates = [*self.imu_hypotheses, self.stated.hypothesis]
        samples = self.case.timing.of(self.case.log, self.case.vehicle)
        rate, force = samples.rate_rad_s[: self.piece.stop], samples.specific_force_m_s2[: self.piece.stop]
        back = np.linalg.inv(np.stack([one.gyro for one in candidates]))
        different, which = np.unique(back.round(9).reshape(len(back), 9), axis=0, return_inverse=True)
        rates = np.einsum("nij,kj->nki", different.reshape(-1, 3, 3), rate)
        ups = verticals(rates, samples.executed.duration_s[: self.piece.stop], samples.up_b[0])
        means = (ups[:, 1:] + ups[:, :-1]) / 2
        residuals = [
            force @ np.linalg.inv(one.accelerometer).T - self.model.gravity * means[i]
            for one, i in zip(candidates, which.ravel(), strict=True)
        ]
        return [float((part**2).mean()) for part in residuals]
