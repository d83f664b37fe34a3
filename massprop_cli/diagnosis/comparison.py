"""Comparison of hypotheses on one reduction of a log, each with its best body and nuisance parameters.

A fit is a few damped Gauss–Newton steps on triangles of constant size, of many hypotheses at once; its slopes are differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, IntArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import tensor
from massprop_cli.diagnosis.channelwise import Free
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.initialbody import begun
from massprop_cli.diagnosis.kernelfits import Fits, PackedTriangles
from massprop_cli.errorparameters.parameter import FittedHypothesis
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import ENTRIES
from massprop_cli.estimate.regression import HEAVIER
from massprop_cli.estimate.whitening import ReducedLeastSquares
from massprop_cli.kernel import kernel
from massprop_cli.model.plant.plant import MOMENT, MU, J

STEPS = 8
"""Most steps of a fit."""
PULL = 0.01
"""Of a body's own size, the inverse of one sigma that holds it near where plain regression puts it."""
STILL, ROUGHLY = 1e-3, 0.1
"""A change of −2 log likelihood that ends it; where hypotheses are but to be ranked."""
SHOWN = {"gyro_bias": slice(0, 3), "drag": slice(0, 3), "accel_bias": slice(3, 6), "slope": slice(3, 5), "tilt": slice(3, 5)}
"""The channels that show each error whose sigma a vehicle file states."""
USUAL = 9.0
"""Square, over that of its sigma, up to which such an error costs nothing."""
HALF_STEP = 1e-6
"""Of each unknown's expected size, the step of a derivative."""


@dataclass(frozen=True)
class Fitted:
    """A hypothesis, with the values that fit best, and what it leaves."""

    hypothesis: Hypothesis
    model: Model
    x: Array
    chi_square: Array
    """(6,) beyond what the free coefficients leave, over the noise, for each channel."""
    spread: Array
    """(d,) one sigma of each of the hypothesis's own unknowns."""

    def value(self, name: str) -> Array:
        """An entry of x."""
        return self.x[self.model.place(name)]

    def error(self, name: str) -> Array:
        """An entry of x less what is stated."""
        return self.value(name) - self.model.stated[self.model.place(name)]

    @cached_property
    def parts(self) -> list[Fitted]:
        """Of two hypotheses at once, each; else itself."""
        if not self.hypothesis.parts:
            return [self]
        parts = self.hypothesis.parts
        spreads = np.split(self.spread, np.cumsum([part.free.shape[1] for part in parts])[:-1])
        return [replace(self, hypothesis=part, spread=own) for part, own in zip(parts, spreads, strict=True)]

    @property
    def unknowns(self) -> int:
        """How many d is."""
        return int(self.hypothesis.free.shape[1])

    @property
    def factors(self) -> Array:
        """What of their stated thrust the channels give that the hypothesis is about."""
        own = np.flatnonzero(self.hypothesis.free[self.model.place("thrust")].any(1))
        return self.value("thrust")[own]

    def sigma(self, name: str) -> Array:
        """One sigma of an entry of x, as far as its own unknowns go."""
        return np.asarray(np.sqrt(((self.hypothesis.free[self.model.place(name)] * self.spread) ** 2).sum(1)))

    def finding(self, names: Sequence[str], stated: Setup, corrected: Setup) -> FittedHypothesis:
        """What sentences and settings are made of; ``names`` of the channels that fired."""
        errors, sigmas = ({name: of(name) for name in ENTRIES} for of in (self.error, self.sigma))
        turns, force = (self.hypothesis.gyro, self.hypothesis.accelerometer), (self.model.force, self.model.wrench(self.x)[1])
        about = (self.hypothesis.subject, tuple(names), errors, sigmas, stated, corrected)
        does = {names[i]: names[other] for i, other in enumerate(self.hypothesis.does) if names and i != other}
        return FittedHypothesis(*about, self.model.mounting, turns, force, float(self.x[MU]), self.model.cg(self.x), does)

    @cached_property
    def moved(self) -> Array:
        """(d,) the unknowns, each over what is to be expected of it."""
        return np.asarray(np.linalg.lstsq(self.hypothesis.free[10:], (self.x - self.model.stated)[10:], rcond=None)[0])

    def along(self, part: float) -> Array:
        """(nx,) x with the unknowns that many times as far from what is stated."""
        x = self.x.copy()
        x[10:] = self.model.stated[10:] + part * (x - self.model.stated)[10:]
        return x

    @property
    def unlikely(self) -> float:
        """Sum of squares of the unknowns over what is to be expected of each."""
        return float((self.moved**2).sum()) if self.unknowns else 0.0


def compared(model: Model, free: Free, variance: Array, supposed: Sequence[Hypothesis]) -> Array:
    """(H, 6) chi-square of each hypothesis before anything is fitted but a body by plain regression."""
    rows = _Rows.of_all(model, free, variance, supposed)
    x, _ = rows.begun(supposed)
    return np.asarray((rows.left(x) ** 2).sum(1) + rows.rest)


def fitted(
    model: Model,
    free: Free,
    variance: Array,
    supposed: Sequence[Hypothesis],
    theta: Array | None = None,
    still: float = STILL,
    there: bool = False,
) -> list[Fitted]:
    """Each hypothesis with the body and the unknowns of its own that fit best; noise ``variance`` (6,).

    A fit begins with the body that plain regression gives, or with ``theta`` (10,) where that leaves less, or always if ``there``.
    Those that need the same columns are fitted side by side.
    """
    alike = [(model.columns(one.moved), one.does, one.spun) for one in supposed]
    found: dict[int, Fitted] = {}
    for key in dict.fromkeys(alike):
        which = [i for i, own in enumerate(alike) if own == key]
        used = (model.wired(*key[1:]), free.anew) if any(key[1:]) else (model, free)
        found |= zip(which, _beside(*used, variance, [supposed[i] for i in which], theta, still, there), strict=True)
    return [found[i] for i in range(len(supposed))]


def _beside(
    model: Model, free: Free, variance: Array, supposed: Sequence[Hypothesis], theta: Array | None, still: float, there: bool
) -> list[Fitted]:
    own = max(s.free.shape[1] for s in supposed)
    rows = _Rows.of_all(model, free, variance, supposed)
    x, sizes = _begun(rows, supposed, theta, there)
    uncertain = model.uncertain
    common = 10 + uncertain.shape[1]
    moves = np.zeros((len(supposed), x.shape[1], common + own))
    others = uncertain * ~np.array([one.moved for one in supposed])[..., None]
    moves[:, :, 10:common] = others
    moves[:, range(10), range(10)] = sizes * model.plant.observable  # the others are in nothing, and stay
    for i, one in enumerate(supposed):
        moves[i, :, common : common + one.free.shape[1]] = one.free
    pulled = np.concatenate([np.full(10, PULL), np.ones(common + own - 10)])
    ended = rows.posed.fitted(x, moves, pulled, (still, rows.spare, STEPS)) if compiled() else _descended(rows, moves, pulled, x, still)
    spread, per_channel = ended.spread[:, common:], (ended.left**2).sum(1) + rows.rest
    # what is uncertain anyway is no part of what is supposed
    beside = others.any(2)
    per_channel = per_channel + _taken(model, np.where(beside, ended.x - x, 0.0))
    found = np.where(beside, x, ended.x)
    return [Fitted(one, model, found[i], per_channel[i], spread[i, : one.free.shape[1]]) for i, one in enumerate(supposed)]


def _taken(model: Model, moved: Array) -> Array:
    """(H, 6) squares beyond chance of what fits that moved x so (H, nx) take for errors whose sigmas are stated, over these."""
    found = np.zeros((len(moved), 6))
    for name, sigma in model.nuisances.items():
        found[:, SHOWN[name]] += np.maximum((moved[:, model.place(name)] / sigma) ** 2 - USUAL, 0.0)
    return found


def compiled() -> bool:
    """Whether the kernel's equations run instead of what stands here."""
    return kernel().library is not None


def _descended(rows: _Rows, moves: Array, pulled: Array, x: Array, still: float) -> Fits:
    descent = _Descent(rows, moves, pulled, x.copy())
    active = np.arange(len(x))
    for _ in range(STEPS):
        gained = descent.step(active)
        # as much as it changes the likelihood of free noise levels
        active = active[gained > still * (1 + descent.cost[active] / rows.spare)]
        if not len(active):
            break
    return Fits(descent.x, descent.left, descent.spread())


def _begun(rows: _Rows, supposed: Sequence[Hypothesis], theta: Array | None, there: bool) -> tuple[Array, Array]:
    """(H, nx) x that fits begin with, and (H, 10) the sizes of θ."""
    x, sizes = rows.begun(supposed)
    if rows.model.released is not None:
        x[:, :10] = rows.model.released if theta is None else theta
        inverse, mu = tensor(rows.model.released[J]), rows.model.released[MU]
        size = np.sqrt(np.trace(np.linalg.inv(inverse)) / mu)
        return x, np.repeat(np.repeat([np.trace(inverse), size, mu], [6, 3, 1])[None], len(x), 0)
    if theta is not None and there:
        x[:, :10] = theta
        return x, sizes
    balanced = x.copy()  # where force or weight hardly tell where the CG is, regression may find it anywhere
    balanced[:, MOMENT] = 0.0
    x = _least(rows, x, balanced)
    suspecting = np.array([i for i, one in enumerate(supposed) if one.suspects], int)
    if len(suspecting):  # from all channels, or from those that nobody suspects
        own = rows.of(suspecting)
        others, _ = own.begun([supposed[i] for i in suspecting], trusting=True)
        x[suspecting] = _least(own, x[suspecting], others)
    if theta is not None:
        others = x.copy()
        others[:, :10] = theta
        x = _least(rows, x, others)
    return x, sizes


def _least(rows: _Rows, x: Array, others: Array) -> Array:
    """(H, nx) of each two beginnings the one that leaves less."""
    better = (rows.left(others) ** 2).sum((1, 2)) < (rows.left(x) ** 2).sum((1, 2))
    return np.where(better[:, None], others, x)


class _Descent:
    """Damped Gauss–Newton steps (Levenberg 1944) of H fits side by side; each unknown is pulled to where it began by its expected size."""

    def __init__(self, rows: _Rows, moves: Array, pulled: Array, x: Array) -> None:
        self.rows, self.moves, self.pulled, self.x = rows, moves, pulled, x
        count, size = len(x), moves.shape[2]
        self.offset, self.damping = np.zeros((count, size)), np.full(count, 1e-6)
        self.left = rows.left(x)
        self.cost = (self.left**2).sum((-2, -1))
        self.slopes = np.empty((count, *self.left.shape[1:], size))
        self.due = np.ones(count, dtype=bool)

    def step(self, which: IntArray) -> Array:
        """One step of some; by how much the cost of each fell, infinite where it was no step."""
        self._renew(which)
        slopes, left, offset = self.slopes[which], self.left[which], self.offset[which]
        flat = slopes.reshape(len(which), -1, slopes.shape[-1])
        normal = np.swapaxes(flat, 1, 2) @ flat + np.diag(self.pulled**2)
        gradient = (np.swapaxes(flat, 1, 2) @ left.reshape(len(which), -1, 1))[..., 0] + self.pulled**2 * offset
        diagonal = np.einsum("hii->hi", normal)
        damped = normal + self.damping[which, None, None] * (diagonal[:, :, None] * np.eye(len(self.pulled)))
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        tried = self.x[which] + np.einsum("hxi,hi->hx", self.moves[which], step)
        # a mass that the log doesn't tell may be any; what it does tell must not wait for it
        tried[:, MU] = np.maximum(tried[:, MU], self.x[which][:, MU] / HEAVIER)
        wrong = ~is_body(tried[:, :10])
        tried[wrong] = self.x[which][wrong]
        with np.errstate(over="ignore", invalid="ignore"):  # a step so long that it can't be computed is none
            left = self.rows.of(which).left(tried)
            cost = (left**2).sum((-2, -1)) + ((self.pulled * (offset + step)) ** 2).sum(-1)
        before = self.cost[which]
        better = (cost < before) & ~wrong
        gained = np.where(better, before - cost, np.where(wrong | ~(cost <= before * (1 + 1e-9)), np.inf, 0.0))
        moved = which[better]
        self.x[moved], self.left[moved], self.cost[moved] = tried[better], left[better], cost[better]
        self.offset[moved] += step[better]
        self.damping[which] = np.where(better, self.damping[which] / 10, self.damping[which] * 10 + 1e-4)
        self.due[moved] = True
        return gained

    def _renew(self, which: IntArray) -> None:
        """Slopes where they are due."""
        due = which[self.due[which]]
        if len(due):
            self.slopes[due] = self.rows.of(due).slopes(self.x[due], self.moves[due], self.left[due])
            self.due[due] = False

    def spread(self) -> Array:
        """(H, n) one sigma of each unknown, by the slopes of the last step."""
        flat = self.slopes.reshape(len(self.x), -1, self.slopes.shape[-1])
        covariance = np.linalg.inv(np.swapaxes(flat, 1, 2) @ flat + np.diag(self.pulled**2))
        return np.asarray(np.sqrt(np.maximum(np.einsum("hii->hi", covariance), 0.0)))


def is_body(theta: Array) -> BoolArray:
    """(H,) whether θ (H, 10) may be a body's."""
    good = np.isfinite(theta).all(-1)
    principal = np.linalg.eigvalsh(tensor(np.nan_to_num(theta[:, J])))
    return np.asarray(good & (principal[:, 0] > 1e-4 * np.abs(principal[:, 2])) & (theta[:, MU] > 0))


@dataclass(frozen=True)
class _Rows:
    """Residuals of the triangles, over the noise, as far as the model's columns go."""

    model: Model
    told: tuple[ReducedLeastSquares, ReducedLeastSquares]
    """Of gyro and accelerometer."""
    variance: Array
    gyro: Array
    accelerometer: Array
    rest: Array
    """(6,) chi-square that these columns explain nothing of."""
    spare: int
    """Measurements less coefficients."""
    regressed: dict[tuple[object, ...], Array]
    """Of the log (:class:`Free`)."""
    freed: tuple[Array, Array] | None = None
    """(p, H) of each, the unit vector along which a channel that is free takes whatever is left; None where there is none."""

    @staticmethod
    def of_all(model: Model, free: Free, variance: Array, supposed: Sequence[Hypothesis]) -> _Rows:
        """Of all the columns that they need."""
        count = max(model.columns(one.moved) for one in supposed)
        model = replace(model, places={name: place for name, place in model.places.items() if place.stop <= count})
        each = (free.gyro, free.accelerometer)
        # of a triangle, what is left of its first columns stands in its first rows
        told = [one._replace(triangle=one.triangle[:count, :count], measured=one.measured[:count]) for one in each]
        rest = np.concatenate([(one.measured[count:] ** 2).sum(0) for one in each]) / variance
        gyro, accelerometer = (np.stack(turns) for turns in ([s.gyro for s in supposed], [s.accelerometer for s in supposed]))
        spare = 3 * sum(one.spare for one in each)
        rows = _Rows(model, (told[0], told[1]), variance, gyro, accelerometer, rest, spare, free.regressed)
        if all(one.freed is None for one in supposed):
            return rows
        which = [model.places["channels"].start + (one.freed or 0) for one in supposed]
        along = [one.triangle[:, which] * [one.freed is not None for one in supposed] for one in told]
        return replace(rows, freed=tuple(part / np.maximum(np.linalg.norm(part, axis=0), TINY) for part in along))

    def of(self, which: IntArray) -> _Rows:
        """Of some fits."""
        freed = self.freed and (self.freed[0][:, which], self.freed[1][:, which])
        return replace(self, gyro=self.gyro[which], accelerometer=self.accelerometer[which], freed=freed)

    @cached_property
    def posed(self) -> PackedTriangles:
        """As the kernel has them."""
        return PackedTriangles(self.model, self.told, self.variance, self.gyro, self.accelerometer, self.freed)

    def begun(self, supposed: Sequence[Hypothesis], trusting: bool = False) -> tuple[Array, Array]:
        """(H, nx) x to begin with, and (H, 10) the sizes of θ; ``trusting`` the channels that are suspected."""
        return begun(self.model, self.told, self.regressed, self.posed if compiled() else None, supposed, trusting)

    def left(self, x: Array) -> Array:
        """(H, p, 6) for x (H, nx)."""
        if compiled():
            return self.posed.left(x)
        return self._against(self.model.coefficients(x, self.gyro, self.accelerometer))

    def slopes(self, x: Array, free_x: Array, left: Array) -> Array:
        """(H, p, 6, n) derivative along the columns of ``free_x`` (H, nx, n)."""
        moved = x[:, None, :] + HALF_STEP * np.swapaxes(free_x, 1, 2)
        there = self._against(self.model.coefficients(moved, self.gyro[:, None], self.accelerometer[:, None]))
        return np.moveaxis((there - left[:, None]) / HALF_STEP, 1, -1)

    def _against(self, coefficients: Array) -> Array:
        root = np.sqrt(self.variance)
        found = np.zeros(coefficients.shape)
        for told, axes, freed in zip(self.told, (slice(0, 3), slice(3, 6)), self.freed or (None, None), strict=True):
            rows = len(told.triangle)
            # all at once: one product of two matrices takes a fraction of the time of many small ones
            own = np.moveaxis(coefficients[..., axes], -2, 0)
            left = np.moveaxis((told.triangle @ own.reshape(len(own), -1)).reshape(rows, *own.shape[1:]), 0, -2) - told.measured
            if freed is not None:
                along = freed.T.reshape(-1, *[1] * (left.ndim - 3), rows, 1)
                left -= along * (along * left).sum(-2, keepdims=True)
            found[..., :rows, axes] = left / root[axes]
        return found
